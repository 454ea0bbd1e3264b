"""Supports that hold single axes of space: rollers, guided ends, and what they leave alone."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive import Step, Twin, cayley_vector
from restarts import assert_goes_on

import fastbeam as fb
from fastbeam.dynamics.reactions import ReactingStepper
from fastbeam.results.observe.observer import Observer

Array = np.ndarray
SOFT = fb.Section(EA=1e3, GA2=500.0, GA3=500.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def section(EA: float, GA: float, EI: float, rhoI: float = 0.0) -> fb.Section:
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1.0, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=rhoI, rhoI3=rhoI)


# --- exact answers --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("guided", [False, True])
def test_columns_on_rollers_buckle_under_their_exact_loads(guided: bool) -> None:
    """pi^2 EI/L^2 between a pin and a roller, and between a clamp and a guided end that gives way across; with EA = GA shear and
    shortening cancel."""
    L, EI = 2.0, 3.0
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=section(1e5, 1e5, EI), elements=16)
    exact = np.pi**2 * EI / L**2
    supports = [fb.Clamp(column.start), fb.Clamp(column.end, axes="y")] if guided else [fb.Pin(column.start),
                                                                                       fb.Pin(column.end, axes="xy")]
    scene = fb.Scene(column, *supports, fb.Load("press", column.end, force=(0, 0, -2.0 * exact)))
    # with the guide it gives way across the plane that the scene would be put in
    planar: Any = "auto" if not guided else False
    result = fb.solve_path(fb.compile_scene(scene, planar=planar), to=0.6)
    found, = result.info["critical_points"]
    assert found["kind"] == "bifurcation" and abs(2.0 * found["load_factor"] - 1.0) < 2e-8
    # between pins to all sides, and it may spin about its axis
    for level, unstable in ((0.45, 0), (0.55, 1 if guided else 2)):
        half = fb.solve_static(fb.compile_scene(replace_load(scene, level), planar=planar))
        assert half.info["unstable_directions"] == unstable and half.info["free_directions"] == int(not guided)


def replace_load(scene: fb.Scene, factor: float) -> fb.Scene:
    return fb.Scene(*(replace(part, force=factor * part.force) if isinstance(part, fb.Load) else part for part in scene.parts))


def test_deflection_frequencies_and_reactions_of_a_simply_supported_beam() -> None:
    L, EI, GA, load = 2.0, 3.0, 1e6, 1e-4
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=section(1e6, GA, EI), elements=16)
    roller = fb.Pin(beam.end, axes="yz")
    assert roller.name == "pin of beam 'beam' node 48 along yz"
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), roller, fb.DistributedLoad("q", beam, force=(0, 0, -load))))
    assert model.plane is not None
    run = fb.solve_static(model, observe=("energy", "reaction"), points={"middle": (beam, L / 2)})
    exact = -5.0 * load * L**4 / (384.0 * EI) - load * L**2 / (8.0 * GA)
    assert abs(run.point("middle")[-1, 2] / exact - 1.0) < 1e-9
    np.testing.assert_allclose(run.reaction(roller)["force"][-1], (0.0, 0.0, 0.5 * load * L), rtol=0, atol=1e-13)
    assert run.reaction(roller)["force"][-1, 0] == 0.0
    np.testing.assert_allclose(run.reaction("pin of beam 'beam' node 0")["force"][-1], (0, 0, 0.5 * load * L), rtol=0, atol=1e-9)
    still = fb.modes(fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), roller)), n=4)
    k = np.repeat((1, 2), 2) * np.pi / L
    np.testing.assert_allclose(still.angular, np.sqrt(k**4 * EI / (1.0 + k**2 * EI / GA)), rtol=2e-7)


def test_a_roller_is_a_slider_on_a_stiff_rail() -> None:
    """Bent far beyond the linear, in the plane and in space; the end comes in by a quarter of the span."""
    found = []
    for planar in ("auto", False):
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=section(1e4, 1e4, 1.0), elements=8)
        for rail in (False, True):
            parts: list[Any] = [fb.Pin(beam.end, axes="yz")]
            if rail:
                steel = fb.Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=section(1e12, 1e12, 1e12), elements=1, degree=1)
                parts = [steel, fb.Clamp(steel.start), fb.Clamp(steel.end), fb.Slider("roller", beam.end, steel, at=2.0)]
            keep = [] if planar else [fb.RevoluteJoint(fb.GROUND, beam.start, "hinge", axis=(0, 1, 0))]
            scene = fb.Scene(beam, *(keep or [fb.Pin(beam.start)]), *parts,
                             fb.DistributedLoad("q", beam, force=(0, 0, -8.0)))
            run = fb.solve_static(fb.compile_scene(scene, planar=planar), points={"end": beam.end, "middle": (beam, 1.0)})
            found.append(np.concatenate((run.point("end")[-1], run.point("middle")[-1])))
    assert found[0][0] < 1.7
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0, atol=2e-9)


def test_a_guided_end_moves_across_without_turning() -> None:
    """F L^3/(12 EI) + F L/GA; the clamp takes half of F L, the guide as much."""
    L, EI, GA, force = 1.5, 2.0, 1e5, 1e-4
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=section(1e6, GA, EI), elements=4)
    guide = fb.Clamp(beam.end, "guide", axes="y")
    scene = fb.Scene(beam, fb.Clamp(beam.start), guide, fb.Load("push", beam.end, force=(0, 0, force)))
    for planar in ("auto", False):
        run = fb.solve_static(fb.compile_scene(scene, planar=planar), observe=("energy", "reaction"), points={"end": beam.end})
        assert abs(run.point("end")[-1, 2] / (force * L**3 / (12.0 * EI) + force * L / GA) - 1.0) < 1e-7
        np.testing.assert_allclose(run.reaction("guide")["force"][-1], 0.0, rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.reaction("guide")["moment"][-1], (0.0, 0.5 * force * L, 0.0), rtol=0, atol=1e-12)
        assert np.array_equal(run.directors[-1, -1], run.directors[0, -1])


@pytest.mark.parametrize("order", [2, 4])
def test_a_bead_on_a_straight_wire(order: int) -> None:
    """x'' = -k x/m along x, whatever pulls across; a body with a roller spins as it will."""
    k, m, T = 30.0, 0.7, 1.5
    bead = fb.PointMass("bead", mass=m, position=(0.3, 0, 0), velocity=(0.5, 0, 0))
    post = fb.PointMass("post", mass=1.0, position=(-0.7, 0, 0))
    model = fb.compile_scene(fb.Scene(bead, post, fb.Clamp(post), fb.Pin(bead, "wire", axes="zy"), gravity=(0, 1, -9.81)).add(
        fb.Spring(post, bead, stiffness=k, length=0.7)))
    w = np.sqrt(k / m)
    exact = 0.3 * np.cos(w * T) + 0.5 / w * np.sin(w * T)
    errors = []
    for steps in (100, 200):
        run = fb.simulate(model, t_end=T, step=T / steps, order=order, points={"bead": bead}, progress=False,
                          observe=("energy", "reaction") if order == 2 else ("energy",))
        errors.append(abs(float(run.point("bead")[-1, 0]) - exact))
        assert run.drift("total") < 1e-12 and np.array_equal(run.phi[-1, 0, 1:], (0.0, 0.0))
        if order == 2:
            np.testing.assert_allclose(run.reaction("wire")["force"], np.tile((0.0, -m, 9.81 * m), (len(run.t), 1)), atol=1e-11)
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.3 and errors[1] < (2e-3 if order == 2 else 2e-6)


# --- momentum along what is free -------------------------------------------------------------------------------------------
def rolling(planar: bool = False) -> fb.Scene:
    """A beam that rolls along x on both ends, with a body on one and a bead that slides on it."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=6)
    body = fb.RigidBody("body", mass=0.4, inertia=(0.02, 0.03, 0.04), position=(2, 0, 0))
    bead = fb.PointMass("bead", mass=0.3)
    side = 0.0 if planar else 0.6
    push = fb.InitialVelocity(beam, velocity=lambda s: np.outer(np.ones_like(s), (0.7, 0, 0))
                              + np.outer(np.sin(np.pi * s), (0, 1, side)))
    return fb.Scene(beam, body, bead, fb.RigidConnection(beam.end, body), fb.Slider("slide", bead, beam, at=0.5, rate=0.8), push,
                    fb.Pin(beam.start, axes="yz"), fb.Pin(body, axes="yz"), project_velocities=True)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("planar", [True, False])
def test_momentum_along_a_free_axis_is_kept_to_round_off(order: int, planar: bool) -> None:
    model = fb.compile_scene(rolling(planar))
    assert (model.plane is not None) == planar
    run = fb.simulate(model, t_end=0.5, step=0.005, order=order, progress=False)
    momentum = run.series["lin_mom"]
    assert np.ptp(momentum[:, 0]) < 1e-13 * momentum[0, 0] and np.ptp(momentum[:, 1]) > 0.1
    assert run.drift("total") < 1e-12 and run.drift("gap") < 1e-13 and "lin_mom" not in run.info["conserved"]
    ends = run.phi[:, [0, int(model.names["bodies"][0]["node"])]]
    assert not np.any(ends[:, :, 1:]) and np.ptp(ends[:, 0, 0]) > 0.1


def test_the_plane_has_the_numbers_of_space() -> None:
    flat, space = (fb.simulate(fb.compile_scene(rolling(True), planar=planar), t_end=0.3, step=0.005, progress=False,
                               observe=("energy", "reaction")) for planar in ("auto", False))
    np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0, atol=1e-11)
    for name in ("pin of beam 'beam' node 0 along yz", "pin of body 'body' along yz"):
        np.testing.assert_allclose(flat.reaction(name)["force"], space.reaction(name)["force"], rtol=0, atol=1e-8)


def test_reactions_are_the_impulse_that_momentum_takes() -> None:
    """What both rollers exert in a step is the change of the momentum across; nothing along x."""
    model, h = fb.compile_scene(rolling()), 0.005
    stepper = ReactingStepper(model, np.ones(1))
    observer = Observer(model, ("momentum",), None)
    for k in range(10):
        before = observer.row(0.0, stepper.state)["lin_mom"]
        outcome = stepper.advance(k * h, h, 1)
        forces = outcome.force[1, model.n_forces:].reshape(-1, 2, 3)
        rollers = [forces[i] for i, name in enumerate(model.reaction_names) if name.startswith("pin")]
        total = rollers[0][0] + rollers[1][0]
        change = (observer.row(0.0, stepper.state)["lin_mom"] - before) / h
        np.testing.assert_allclose(total, change, rtol=0, atol=1e-11)
        assert total[0] == 0.0 and not np.any(rollers[0][1]) and np.max(np.abs(total)) > 0.1


def test_a_step_solves_the_equations_of_the_slow_twin() -> None:
    """Residual of an independent implementation at the end of a step: zero in all free unknowns, and the roller's force in those
    that are held."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=2)
    body = fb.RigidBody("body", mass=0.4, inertia=(0.02, 0.03, 0.04), position=(2, 0.3, 0))
    scene = fb.Scene(beam, body, fb.Pin(beam.start, axes="z"), fb.Clamp(body, axes="xz"), fb.RigidConnection(beam.end, body),
                     fb.Pin(beam.node(3), axes="y"), gravity=(1.0, 2.0, -9.81))
    model, h = fb.compile_scene(scene, planar=False), 0.02
    run = fb.simulate(model, t_end=3 * h, step=h, every=1, progress=False)
    before, after = (fb.simulate(model, t_end=k * h, step=h, progress=False).state for k in (2, 3))
    assert np.array_equal(run.state.q, after.q)
    q0, q1 = (x.q.reshape(-1, 4, 3) for x in (before, after))
    theta = np.array([cayley_vector(b[1:].T @ a[1:]) for a, b in zip(q0, q1)])
    twin = Twin(scene, model)
    step = Step(q0, before.v.reshape(-1, 4, 3), q1[:, 0] - q0[:, 0], theta, before.s, after.s, np.zeros((0, 3)), h)
    residual, _ = twin.residual(step)
    assert np.max(np.abs(residual)) < 1e-9 and np.sum(~twin.free[:, :3]) >= 4
    assert np.max(np.abs(q1[:, 0] - q0[:, 0])) > 1e-3


# --- nets, joints, planes, starts ------------------------------------------------------------------------------------------
def test_nets_on_rollers_are_condensed_to_the_same_numbers() -> None:
    grid = np.array([(x, y, 0.0) for x in range(4) for y in range(3)])
    edges = [(3 * x + y, 3 * x + y + 1) for x in range(4) for y in range(2)]
    edges += [(3 * x + y, 3 * x + y + 3) for x in range(3) for y in range(3)]
    net = fb.Net("net", grid, edges, section=SOFT, elements=4, degree=2, pins=[0])
    scene = fb.Scene(net, *(fb.Pin(net.node(i), axes="z") for i in (2, 5, 9, 11)), fb.Pin(net.node(2), "stop", axes="x"),
                     gravity=(0.5, 0.5, -2))
    runs = [fb.simulate(fb.compile_scene(scene, condense=condense), t_end=0.2, step=0.01, progress=False)
            for condense in (False, True)]
    assert max(run.drift("total") for run in runs) < 1e-12
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0, atol=1e-11)
    numbers = runs[0].names["nets"][0]["junctions"]
    assert not np.any(runs[0].phi[:, [numbers[i] for i in (2, 5, 9, 11)], 2]) and np.ptp(runs[0].phi[:, numbers[9], 1]) > 1e-3
    rest = fb.solve_static(fb.compile_scene(scene), observe=("energy", "reaction"))
    total = sum(rest.reaction(name)["force"][-1] for name in rest.names["reactions"])
    weight = sum(net.lengths) * SOFT.inertia[0]
    np.testing.assert_allclose(total, -weight * np.array((0.5, 0.5, -2)), rtol=0, atol=1e-8)


def test_runs_go_on_and_states_go_over(tmp_path: Path) -> None:
    model = fb.compile_scene(rolling())
    settings: dict[str, Any] = {"t_end": 0.1, "step": 0.005, "every": 1, "progress": False}
    whole = fb.simulate(model, **settings)
    assert_goes_on(model, whole, 7, tmp_path / "c.h5", settings)
    scene = rolling()
    free = fb.Scene(*(part for part in scene.parts if not isinstance(part, fb.Pin)), project_velocities=True)
    state = whole.state_for(fb.compile_scene(free))
    run = fb.simulate(fb.compile_scene(free), start=state, t_end=0.05, step=0.005, progress=False)
    assert run.drift("lin_mom") < 1e-12 and run.drift("total") < 1e-12
    # and back: a roller that is added refuses a velocity across it, and takes none of that along it
    with pytest.raises(fb.SceneError, match="the support of .*: its velocity is"):
        fb.simulate(model, start=run.state_for(model), t_end=0.05, step=0.005, progress=False)
    # a state that stands elsewhere is held there
    moved = model.state()
    moved.q.reshape(-1, 4, 3)[:, 0] += (0.1, 0.2, 0.0)
    again = fb.simulate(model, start=moved, t_end=0.02, step=0.005, progress=False)
    texts = [event["text"] for event in again.events if event["kind"] == "support"]
    assert len(texts) == 1 and "0.2 m away from its place" in texts[0]


def block(**more: Any) -> fb.RigidBody:
    return fb.RigidBody("block", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(2, 0, 0), **more)


def test_supports_of_joined_parts() -> None:
    """A roller on a part that another leads holds what leads it; at a distance only where nothing turns."""
    beam, body = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=3), block()
    for at in (beam.end, body):
        model = fb.compile_scene(fb.Scene(beam, body, fb.RigidConnection(beam.end, body), fb.Pin(at, axes="y"),
                                          fb.Pin(beam.start), gravity=(0, -9.81, 0)))
        run = fb.simulate(model, t_end=0.1, step=0.01, progress=False)
        assert not np.any(run.phi[:, -1, 1]) and run.drift("total") < 1e-12
    away = fb.RigidBody("away", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(2, 0.5, 0))
    with pytest.raises(fb.SceneError, match="both pins together constrain more than one"):
        fb.compile_scene(fb.Scene(beam, away, fb.RigidConnection(beam.end, away), fb.Pin(away, axes="y"), fb.Pin(beam.end)))
    guided = fb.compile_scene(fb.Scene(beam, away, fb.RigidConnection(beam.end, away), fb.Clamp(away, axes="x"),
                                       fb.Pin(beam.end, axes="y"), gravity=(0, 0, -1.0)))
    run = fb.simulate(guided, t_end=0.1, step=0.01, progress=False)
    assert not np.any(np.ptp(run.phi[:, [-1, beam.n_nodes - 1], :2], axis=0)) and run.drift("total") < 1e-12


def test_joints_between_parts_on_rollers() -> None:
    """Loops through supports are closed by multipliers, unless both sides stand still along one axis."""
    def scene(first: str, second: str) -> fb.Scene:
        a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=SOFT, elements=3)
        b = fb.Beam.straight("b", (2, 0, 0), (1, 0, 0), section=SOFT, elements=3)
        return fb.Scene(a, b, fb.Pin(a.start), fb.Pin(b.start), fb.BallJoint(a.end, b.end), fb.Pin(a.end, axes=first),
                        fb.Pin(b.end, axes=second), gravity=(0, 1.0, -9.81))

    run = fb.simulate(fb.compile_scene(scene("z", "y")), t_end=0.2, step=0.01, progress=False)
    ends = [int(np.flatnonzero(np.all(np.abs(run.phi[0] - (1, 0, 0)) < 1e-12, axis=1))[i]) for i in (0, 1)]
    assert np.max(np.abs(run.phi[:, ends, 1:])) < 1e-12 and run.drift("total") < 1e-12
    with pytest.raises(fb.SceneError, match="supports fix both sides along z .* one of the supports"):
        fb.compile_scene(scene("xz", "z"))


@pytest.mark.parametrize(("axes", "planar"), [("y", True), ("xz", True), ("z", False), ("yz", False), ("x", False)])
def test_which_supports_leave_a_scene_in_its_oblique_plane(axes: str, planar: bool) -> None:
    """In the plane that the y axis and (1, 0, 1) span: what holds x alone would push out of it."""
    d = np.array((1.0, 0.0, 1.0)) / np.sqrt(2.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (0, 2, 0), section=SOFT, elements=3, d2=tuple(d))
    scene = fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end, axes=axes), gravity=3.0 * d)
    model = fb.compile_scene(scene)
    assert (model.plane is not None) == planar
    assert planar or "fixes axes that are oblique to the plane" in model.not_planar
    if planar:
        flat, space = (fb.simulate(fb.compile_scene(scene, planar=planar), t_end=0.1, step=0.01, progress=False)
                       for planar in ("auto", False))
        np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0, atol=1e-12)


def test_a_line_takes_the_plane_in_which_its_supports_hold() -> None:
    for axes, normal in (("y", (0, 0, 1)), ("z", (0, 1, 0))):
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=4)
        scene = fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end, axes=axes), fb.Load("pull", beam.end, force=(1, 0, 0)))
        model = fb.compile_scene(scene)
        assert np.array_equal(np.abs(model.plane.axes[2]), normal)
        assert fb.solve_static(model).info["unstable_directions"] == 0


def test_what_holds_too_little_is_told() -> None:
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=4)
    scene = fb.Scene(beam, fb.Pin(beam.start, axes="y"), fb.Pin(beam.end, axes="y"), gravity=(0, -1, 0))
    with pytest.raises(fb.SceneError, match=r"it can move along \(-?1, 0, 0\)"):
        fb.solve_static(fb.compile_scene(scene))


@pytest.mark.parametrize(("make", "says"), [
    (lambda at: fb.Pin(at, axes=""), "must name axes"), (lambda at: fb.Pin(at, axes="yy"), "must name axes"),
    (lambda at: fb.Pin(at, axes="u"), "axes='yz'"), (lambda at: fb.Pin(at, axes=(1, 0, 0)), "oblique direction"),
    (lambda at: fb.Clamp(block().point((1, 0, 0)), axes="x"), "are available at the centre of a body only")])
def test_axes_that_make_no_sense_are_refused(make: Callable[[Any], Any], says: str) -> None:
    with pytest.raises(fb.SceneError, match=says):
        make(block())
