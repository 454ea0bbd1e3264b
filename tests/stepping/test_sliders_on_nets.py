"""Sliders on beams of nets, eliminated with their beams: the same increments as the dense border around SuperLU, the same bits on
any number of threads, and the balances of a conserving step."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_condensed import ROD, grid

import fastbeam as fb
from fastbeam.compile import carriers
from fastbeam.kernels import loop as kernels
from fastbeam.model import workspace
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
STEP = 2e-3
PLACES = ((1, 0.4), (1, 0.7), (5, 0.3), (8, 0.0), (11, 0.52))


def scene(bodies: bool = True, curve: str = "c1", rate: float = 0.3, hook: str = "", twice: bool = False, free: bool = False,
          gravity: bool = True, places: Any = PLACES, mass: float = 0.3, along: Any = (), sleeves: Any = (), border: Any = (),
          **net_options: Any) -> fb.Scene:
    """Masses on beams of a net, one at an end, and bodies that slide with one point and with two; along: what sliders have along
    their beams, one after the other; sleeves: what sleeves on other beams have; border: what cannot be carried, of `bordered`."""
    net = grid(3, **({"elements": 4} | net_options | ({"clamps": np.zeros(0, int)} if free else {})))
    flat = bool(net_options.get("flat"))
    parts: list[Any] = [net]
    for k, (beam, at) in enumerate(places):
        bead = fb.PointMass(f"m{k}", mass=mass)
        forces = along[k % len(along)] if along else {}
        parts += [bead, fb.Slider(f"s{k}", bead, net.beam(beam), at=at, **({"rate": rate} | forces), curve=curve)]
        if twice:
            parts.append(fb.Slider(f"again{k}", bead, net.beam(beam), at=at, rate=rate, curve=curve))
    for k, (beam, places_of_body) in enumerate(((2, (0.3,)), (5, (0.2, 0.8))) if bodies else ()):
        start, end = net.nodes[net.edges[beam]]
        along = (end - start) / np.linalg.norm(end - start)
        aside = 0.1 * np.array([-along[1], along[0], 0.0]) if flat else np.array([0.0, 0.0, 0.1])
        place = start + places_of_body[0] * along + aside
        body = fb.RigidBody(f"g{k}", mass=0.4, inertia=0.004 * np.eye(3), position=tuple(place))
        parts.append(body)
        for j, at in enumerate(places_of_body):
            parts.append(fb.Slider(f"t{k}{j}", body.point(tuple(start + at * along - place)), net.beam(beam), at=at, curve=curve))
    if hook:
        # beam 23 ends there
        block = fb.RigidBody("hook", mass=1.0, inertia=0.01 * np.eye(3), position=tuple(net.nodes[15] + (0.3, 0.0, 0.0)))
        joint = fb.RigidConnection if hook == "rigid" else fb.BallJoint
        bead = fb.PointMass("bead", mass=mass)
        parts += [block, joint(block.point((-0.3, 0.0, 0.0)), net.node(15)), bead,
                  fb.Slider("near", bead, net.beam(len(net.edges) - 1), at=0.9, curve=curve)]
    for k, options in enumerate(sleeves):
        beam = (3, 4, 7, 1, 9)[k]
        start, end = net.nodes[net.edges[beam]]
        body = fb.RigidBody(f"c{k}", mass=0.5, inertia=0.003 * np.eye(3), position=tuple(0.4 * start + 0.6 * end))
        at = 0.6 * float(net.lengths[beam])
        parts += [body, fb.Sleeve(f"around {k}", body, net.beam(beam), at=at, curve=curve, rate=0.2, **options)]
    for kind in border:
        parts += bordered(net, kind)
    pull = (0.5, -9.81, 0.0) if flat else (0.5, 0.3, -9.81)
    return fb.Scene(*parts, gravity=pull if gravity else (0, 0, 0), project_velocities=True)


def bordered(net: fb.Net, kind: str) -> list[Any]:
    """What slides on other beams of the net and is no business of one beam alone."""
    beam = {"wire": 13, "sleeve": 17, "two beams": 20, "pushed": 22, "loop": 0, "path": 18}[kind]
    start, end = net.nodes[net.edges[beam]]
    place = 0.5 * (start + end)
    at = 0.5 * float(net.lengths[beam])
    if kind == "wire":
        wire = fb.Beam.straight("wire", place, place + (0.0, 0.0, 1.0), section=ROD, elements=2, degree=1)
        return [wire, fb.Slider("of wire", wire.start, net.beam(beam), at=at, friction=0.1)]
    if kind == "pushed":
        bead = fb.PointMass("pushed", mass=0.2)
        return [bead, fb.Slider("lies on", bead, net.beam(beam), at=at, one_sided=(0, 0, 1))]
    if kind == "path":
        # two beams along one line of the net
        bead = fb.PointMass("on path", mass=0.2)
        return [bead, fb.Slider("runs", bead, fb.Path("way", (net.beam(beam), net.beam(beam + 1))), at=at, rate=0.3)]
    if kind == "loop":
        blocks = [fb.RigidBody(f"block{k}", mass=1.0, inertia=0.1 * np.eye(3), position=(20.0 + k, 0.0, 0.0)) for k in range(2)]
        return [*blocks, *(fb.BallJoint(blocks[0].point((0.5, y, 0.0)), blocks[1].point((-0.5, y, 0.0)), f"ball {y}")
                           for y in (0.0, 0.2))]
    body = fb.RigidBody(kind, mass=0.4, inertia=0.004 * np.eye(3), position=tuple(place))
    if kind == "sleeve":
        return [body, fb.Sleeve("around", body, net.beam(beam), at=at, keyed=False, friction=0.2, length=0.2, radius=0.02)]
    other = 21
    there = net.nodes[net.edges[other]].mean(axis=0)
    return [body, fb.Slider("a", body, net.beam(beam), at=at),
            fb.Slider("b", body.point(tuple(there - place)), net.beam(other), at=0.5 * float(net.lengths[other]))]


SLEEVES: tuple[dict[str, Any], ...] = (
    {}, {"keyed": False}, {"length": 0.0}, {"length": 0.3, "friction": 0.2}, {"length": 0.2, "drive": fb.Drive(force=1.0)})
BORDERED = {"wire", "sleeve", "two beams", "pushed", "block0", "on path"}
FORCES: tuple[dict[str, Any], ...] = (
    {"friction": 0.2}, {"friction": fb.Friction(viscous=3.0), "stops": fb.Stops(0.2, 0.75, stiffness=1e3)},
    {"friction": fb.Friction(0.1, smoothing=0.05)}, {"drive": fb.Drive(force=2.0)}, {"drive": fb.Drive(speed=0.4), "rate": 0.4},
    {})
CASES: dict[str, dict[str, Any]] = {
    "linear": {"degree": 1},
    "quadratic": {"degree": 2},
    "cubic, own curve": {"degree": 3, "curve": "own"},
    "ball joints": {"joints": "ball"},
    "other strains": {"degree": 2, "strain": "green_lagrange"},
    "one element a beam": {"elements": 1, "curve": "own"},
    "elements are crossed": {"degree": 2, "rate": 180.0, "curve": "own", "bodies": False, "places": ((1, 0.4), (5, 0.3))},
    "end on a body": {"hook": "rigid"},
    "end on a body by a ball": {"hook": "ball", "joints": "ball"},
    "light": {"mass": 4e-7, "bodies": False},
    "heavy": {"mass": 4e5, "bodies": False},
    "sleeves and forces along the beams": {"sleeves": SLEEVES, "along": FORCES, "degree": 2},
    "sleeves alone": {"sleeves": SLEEVES[:3], "bodies": False, "places": ()},
    "sleeves and forces along the beams in a plane": {"sleeves": SLEEVES, "flat": True, "along": FORCES},
    "sleeves, forces and a border": {"sleeves": SLEEVES, "along": FORCES,
                                     "border": ("wire", "sleeve", "two beams", "pushed", "path")},
    "in a plane": {"flat": True, "degree": 2},
    "in a plane, ball joints": {"flat": True, "joints": "ball"},
}


def model_of(some: fb.Scene, **options: Any) -> Any:
    model = fb.compile_scene(some, condense=True, **options)
    assert model.carriers is not None and (model.columns > 1) is any(x.name in BORDERED for x in some.parts)
    return model


def iterate(stepper: Stepper) -> tuple[Array, ...]:
    """Unknowns after the second Newton iteration of a step with random forces."""
    stepper._augment(STEP)
    stepper.parts.start(STEP)
    state, work = stepper.core_state, stepper.work
    state.force[:] = 0.3 * np.random.default_rng(4).standard_normal(state.force.size)
    for _ in range(2):
        stepper.parts.assemble(STEP)
        assert stepper.parts.solve()
        assert stepper.parts.update() >= 0.0
    return work.dphi.copy(), work.theta.copy(), work.s_end - state.s, state.force.copy()


@pytest.mark.parametrize("name", CASES)
def test_increments_are_those_of_the_dense_border(name: str) -> None:
    planar = "auto" if "plane" in name else False
    some = scene(**CASES[name])
    model = model_of(some, planar=planar)
    assert model.uneliminated is not None
    one = Stepper(model, np.ones(1), augmentation=0.0, threads=1)
    other = Stepper(model.uneliminated(planar=planar), np.ones(1), backend="superlu", augmentation=0.0)
    assert (one.plane is not None) == ("plane" in name)
    for kind, a, b in zip(("position", "turn", "slide", "force"), iterate(one), iterate(other)):
        size = max(np.max(np.abs(b)), 1e-6 if kind != "force" else 0.1)
        assert np.max(np.abs(a - b)) < (1e-7 if name in ("light", "heavy") else 1e-9) * size, kind


def run(model: Any, n: int, **options: Any) -> Stepper:
    stepper = Stepper(model, np.ones(1), **options)
    outcome = stepper.advance(0.0, STEP, n)
    assert (outcome.status, outcome.steps, stepper.linear.fallbacks) == (kernels.OK, n, 0)
    return stepper


OTHERS: dict[str, Any] = {"along": FORCES, "sleeves": SLEEVES, "border": ("wire", "sleeve", "two beams", "pushed", "loop")}


@pytest.mark.parametrize("others", [{}, OTHERS], ids=["carried", "with others"])
def test_steps_are_those_of_the_dense_border(others: dict[str, Any]) -> None:
    model = model_of(scene(rate=2.0, **others), planar=False)
    one, other = run(model, 20, threads=1), run(model.uneliminated(planar=False), 20, backend="superlu")
    for name, tolerance in (("q", 1e-10), ("v", 1e-8), ("s", 1e-10), ("force", 1e-6)):
        a, b = getattr(one.state, name), getattr(other.state, name)
        assert np.max(np.abs(a - b)) < tolerance * max(1.0, np.max(np.abs(b))), name


@pytest.mark.parametrize("others", [{}, OTHERS], ids=["carried", "with others"])
def test_threads_and_pauses_do_not_change_bits(others: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(carriers, "LEAST_CARRIERS", 1)
    model = model_of(scene(rate=2.0, **others), planar=False)
    assert model.carriers.group[-1] > 0
    one, two, pausing = run(model, 10, threads=1), run(model, 10, threads=2), run(model, 4, threads=2)
    again = Stepper(model, np.ones(1), pausing.copy_state(), memory=pausing.memory, threads=1)
    assert again.advance(0.0, STEP, 6, 4).status == kernels.OK
    for other in (two, again):
        assert all(np.array_equal(a, b) for a, b in zip(one.state, other.state))


@pytest.mark.parametrize("others", [{}, {"along": FORCES, "sleeves": SLEEVES, "border": ("wire", "two beams", "loop")}],
                         ids=["carried", "with others"])
def test_balances(others: dict[str, Any]) -> None:
    model = model_of(scene(rate=2.0, free=True, gravity=False, **others), planar=False)
    result = fb.simulate(model, t_end=0.1, step=STEP, observe=("energy", "momentum", "slider"), progress=False,
                         solver=fb.Solver(threads=1))
    assert result.info.get("fallbacks", 0) == 0
    for name in ("balance" if others else "total", "lin_mom", "ang_mom"):
        x = np.asarray(result.series[name]).reshape(len(result.t), -1)
        assert np.max(np.abs(x - x[0])) < 1e-10 * max(1.0, np.max(np.abs(x))), name
    if others:
        free = fb.simulate(model.uneliminated(planar=False), t_end=0.1, step=STEP, progress=False)
        for name in ("friction_loss", "drive_work", "friction_force", "drive_force", "stop_force"):
            a, b = np.asarray(result.series[name]), np.asarray(free.series[name])
            assert np.max(np.abs(a - b)) < 1e-6 * np.max(np.abs(b)) and np.max(np.abs(b)) > 0.0, name


def test_rigid_stops_locks_releases_and_controllers_of_carried_sliders() -> None:
    forces: tuple[dict[str, Any], ...] = (
        {"release": fb.Release("end"), "rate": 6.0}, {"stops": fb.Stops(0.1, 0.85, restitution=0.6), "rate": 4.0},
        {"lock": fb.Lock("end"), "stops": fb.Stops(end=0.8), "rate": 5.0},
        {"drive": fb.Drive(position=1.0, stiffness=40.0, damping=2.0)},
        {"stops": fb.Stops(0.1, 0.8, restitution=0.0), "friction": 0.3, "rate": 3.0})
    one, other = (fb.simulate(fb.compile_scene(scene(along=forces, degree=2), condense=condense, planar=False), t_end=0.12,
                              step=STEP, progress=False) for condense in (True, False))
    events = [[(x["kind"], x.get("slider"), round(x["time"], 8)) for x in result.events] for result in (one, other)]
    assert events[0] == events[1] and {kind for kind, _, _ in events[0]} >= {"impact", "locked", "released"}
    assert one.drift("balance") < 1e-12 and np.max(np.abs(one.state.q - other.state.q)) < 1e-10
    for name in ("stop_loss", "lock_loss", "friction_loss", "drive_work"):
        a, b = one.series[name], other.series[name]
        assert np.max(np.abs(a - b)) < 1e-9 * np.max(np.abs(b)) and np.max(np.abs(b)) > 0.0, name


def test_dependent_sliders_move_as_with_the_dense_border_and_are_named_without_the_augmented_lagrangian() -> None:
    model = model_of(scene(twice=True, bodies=False))
    one, other = run(model, 5, threads=1), run(model.uneliminated(planar=False), 5, backend="superlu")
    assert np.max(np.abs(one.state.q - other.state.q)) < 1e-9
    assert np.max(np.abs(one.state.s - other.state.s)) < 1e-9
    with pytest.raises(fb.ConvergenceError, match="s0|again0"):
        fb.simulate(model, t_end=STEP, step=STEP, solver=fb.Solver(augmentation=0.0), progress=False)


def test_a_slider_at_the_end_of_its_beam_ends_the_run() -> None:
    results = [fb.simulate(fb.compile_scene(scene(rate=8.0, bodies=False, places=((1, 0.9), (5, 0.3))), condense=condense),
                           t_end=0.1, step=STEP, progress=False) for condense in (True, False)]
    one, other = (next(x for x in result.events if x["kind"] == "slider_end") for result in results)
    assert one["time"] == pytest.approx(other["time"], rel=1e-8) and one["slider"] == "s0"


def test_what_concerns_more_than_one_beam_is_a_border_and_other_sliders_are_not() -> None:
    for kinds, constraints in ((("wire",), 1), (("path",), 1), (("sleeve",), 2), (("two beams",), 2), (("pushed",), 1),
                               (("loop",), 1), (("wire", "sleeve", "two beams", "pushed", "loop"), 7)):
        model = model_of(scene(border=kinds), planar=False)
        assert model.n_bordered == constraints and model.columns == 1 + 7 * constraints, kinds
        # five masses and bodies with three points
        assert model.carried.sum() == 8, kinds


@pytest.mark.parametrize("condense", [False, True])
def test_a_sleeve_that_rubs_where_its_beam_turns_leaves_alone_one_that_does_not(condense: bool) -> None:
    spins = []
    for others in ((), ("sleeve",)):
        some = scene(degree=3, sleeves=SLEEVES[1:3], border=others)
        model = fb.compile_scene(some, condense=condense, planar=False)
        state = run(model, 5, threads=1).state
        node = model.numbers.number(some.nets[0].beam(3).node(5))
        spins.append(float(state.v.reshape(-1, 4, 3)[node, 2] @ state.q.reshape(-1, 4, 3)[node, 3]))
    # they feel each other through the net
    assert spins[1] == pytest.approx(spins[0], rel=1e-3) and abs(spins[0]) > 2e-3


@pytest.mark.parametrize("kind", ["spring", "pinned"])
def test_a_beam_that_more_than_elements_touch_is_not_condensed(kind: str) -> None:
    net = grid(3, elements=4)
    bead, other = fb.PointMass("m", mass=0.3), fb.PointMass("n", mass=0.3)
    parts = [net, bead, fb.Slider("s", bead, net.beam(1), at=0.4), other, fb.Slider("free", other, net.beam(5), at=0.4)]
    parts.append(fb.Spring(bead, net.node(15), stiffness=10.0) if kind == "spring" else fb.Pin(net.beam(1).node(2)))
    model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -9.81), project_velocities=True), condense=True)
    assert model.carried.tolist() == [False, True]


def test_the_report_and_the_supports_know_carriers() -> None:
    model = model_of(scene())
    assert "carriers           5 beams with sliders" in str(model)


@pytest.mark.parametrize("options", [{"border": ("wire", "sleeve", "two beams", "pushed", "loop", "path"), "hook": "ball"},
                                     {"border": ("wire", "sleeve", "two beams", "path"), "twice": True},
                                     {"flat": True, "sleeves": SLEEVES, "along": FORCES}])
def test_many_constraints_are_in_one_sparse_matrix(monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]) -> None:
    model = fb.compile_scene(scene(**options), condense=True)
    assert "in one matrix" not in str(model)
    runs = []
    for slow in (np.inf, -1.0):
        monkeypatch.setattr(workspace, "SLOW", slow)
        runs.append(fb.simulate(model, t_end=0.1, step=STEP, progress=False))
    border, matrix = runs
    assert "nodes and constraints" in matrix.info["solver"] and "nodes and constraints" not in border.info["solver"]
    assert matrix.info["iterations"] <= border.info["iterations"] + 2
    for one, other, size in zip(matrix.state[:4], border.state[:4], (1e-11, 1e-8, 1e-11, 1e-8)):
        np.testing.assert_allclose(one, other, atol=size * max(1.0, float(np.max(np.abs(other)))), rtol=0.0)
    assert matrix.drift("balance" if "balance" in matrix.series else "total") < 1e-12
    if "lifted" not in [event["kind"] for event in matrix.events]:
        half = fb.simulate(model, t_end=0.05, step=STEP, progress=False)
        again = fb.simulate(model, start=half.checkpoint, t_end=0.1, step=STEP, progress=False)
        for one, other in zip(again.state, matrix.state):
            np.testing.assert_array_equal(one, other)


def net_of(joints: int, beams: int) -> fb.Net:
    """Beams of one element between any two of so many points."""
    rng = np.random.default_rng(0)
    pairs = np.stack(np.triu_indices(joints, 1), axis=1)
    return fb.Net("net", 5.0 * rng.random((joints, 3)), pairs[rng.permutation(len(pairs))[:beams]], section=ROD, elements=1,
                  degree=1, clamps=[0, 1])


@pytest.mark.parametrize(("net", "rows"), [(grid(6, elements=10, degree=1), True), (grid(20, elements=1, degree=1), True),
                                           (net_of(100, 900), False)])
def test_in_nets_below_a_thousand_elements_sliders_are_rows_where_elimination_does_not_fill_up(net: fb.Net, rows: bool) -> None:
    parts: list[Any] = [net]
    for k in range(20):
        bead = fb.PointMass(f"m{k}", mass=0.1)
        parts += [bead, fb.Slider(f"s{k}", bead, net.beam(k), at=0.4 * float(net.lengths[k]))]
    model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0.1, -9.81)))
    assert 800 <= sum(net.elements) < 1000
    assert model.by_rows is rows and model.carriers is None and ("sparse solver      PARDISO" in str(model)) is not rows
