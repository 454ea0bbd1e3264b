"""Beams of nets and pieces of long beams condensed to their ends: the matrix is the Schur complement, steps and equilibria are
the same, on any number of threads to the last bit."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.linalg import substructures as beams
from fastbeam.linalg import linear_system as linsolve
from fastbeam.linalg.mkl import SMALL, load_mkl
from fastbeam.stepping import condensed
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
TUBE = fb.Section.circle(radius=0.03, E=5e7, rho=1000.0)
ROD = fb.Section.circle(radius=0.02, E=8e7, rho=2000.0)
# against each other two orders of elimination differ by round-off times the condition of the matrix
SAME = 1e-9


def grid(m: int, flat: bool = False, seed: int = 0, name: str = "net", **changes: Any) -> fb.Net:
    """Beams between (m + 1)^2 nodes, held along one side."""
    k = np.arange((m + 1)**2).reshape(m + 1, m + 1)
    x, y = np.divmod(k, m + 1)
    z = np.zeros(x.shape) if flat else 0.2 * np.random.default_rng(seed).standard_normal(x.shape)
    edges = np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])
    options = {"section": TUBE, "elements": 3, "degree": 1, "clamps": np.arange(m + 1)} | changes
    return fb.Net(name, np.stack((x, y, z), axis=-1).reshape(-1, 3), edges, **options)


def random_scene(seed: int, strain: str, degree: int, sliders: bool) -> fb.Scene:
    """Beams of one to three elements and two sections, welds and ball joints, masses, loads inside beams, a second net with the
    other strains, a slider on a beam and another at a node inside of one."""
    rng = np.random.default_rng(seed)
    m = 4
    n, count = (m + 1)**2, 2 * m * (m + 1)
    joints = rng.choice(["rigid", "ball"], n).tolist()
    net = grid(m, seed=seed, strain=strain, degree=degree, elements=rng.integers(1, 4, count), section=[TUBE, ROD],
               section_of=rng.integers(0, 2, count), joints=joints, masses=rng.uniform(0.0, 2.0, n),
               velocity=0.2 * rng.standard_normal((n, 3)))
    long = net.beam(int(np.argmax(net.elements)))
    parts: list[Any] = [net, fb.Load("push", long.node(1), force=(1.0, 2.0, -3.0)),
                        fb.DistributedLoad("wind", net.beam(1), force=(0.5, 0.0, 1.0))]
    if strain == "green_lagrange":
        parts.append(grid(3, name="other", degree=2))
    if sliders:
        bead = fb.PointMass("bead", mass=0.3)
        first, second = (net.beam(int(k)) for k in np.flatnonzero(net.elements == 3)[:2])
        ends = net.nodes[net.edges[second.index]]
        there, along = ends[0] + (ends[1] - ends[0]) / 3.0, np.array([0.3, 0.4, 1.2])
        wire = fb.Beam.straight("wire", there - along, there + along, section=ROD, elements=2, degree=degree, strain=strain)
        parts += [bead, wire, fb.Clamp(wire.start), fb.Clamp(wire.end), fb.Slider("bead on net", bead, first, at=0.4),
                  fb.Slider("net on wire", second.node(degree), wire, at=1.3)]
    return fb.Scene(*parts, gravity=(0.5, 0.3, -9.81), project_velocities=True)


def models(scene: fb.Scene, **options: Any) -> tuple[Any, Any]:
    """The same scene with and without condensed beams."""
    one, other = (fb.compile_scene(scene, condense=condense, **options) for condense in (True, False))
    assert one.substructures is not None and other.substructures is None
    assert one.pattern.n < other.pattern.n
    return one, other


def assert_same(one: fb.Result, other: fb.Result, tolerance: float = SAME) -> None:
    for name in ("q", "v", "s", "force"):
        x, y = getattr(one.state, name), getattr(other.state, name)
        assert np.max(np.abs(x - y), initial=0.0) <= tolerance * max(1.0, np.max(np.abs(y), initial=0.0)), name


def same_bits(one: fb.Result, other: fb.Result) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(one.state, other.state))


# ------------------------------------------------------------------------------------------------------- the condensation
def dense(stepper: Stepper) -> tuple[Array, Array]:
    """Matrix and residual of the rows that the solver sees."""
    model = stepper.core
    pattern, n = model.pattern, len(model.dofs)
    matrix = np.zeros((pattern.n, n, pattern.n, n))
    matrix[pattern.rows, :, pattern.columns] = stepper.work.blocks[:8 * n * pattern.keys.size].reshape(-1, n, 8)[:, :, :n]
    rest = stepper.work.r[:8 * pattern.n].reshape(-1, 8)[:, :n]
    return matrix.reshape(n * pattern.n, -1), rest.reshape(-1)


@pytest.mark.parametrize(("changes", "planar"), [
    ({"degree": 1}, False), ({"degree": 3, "joints": "ball"}, False), ({"degree": 2, "strain": "green_lagrange"}, False),
    ({"degree": 1, "elements": 1}, False), ({"degree": 2, "flat": True}, True)])
def test_condensed_matrix_is_the_schur_complement_and_its_interior_solves_the_whole_system(changes: Any, planar: bool) -> None:
    scene = fb.Scene(grid(3, **changes), gravity=(0.0, -9.81, 0.0))
    one = fb.compile_scene(scene, condense=True)
    whole = fb.compile_scene(scene, condense=False, eliminate_inner=False, solver="sparse")
    assert (one.plane is not None) == planar
    a, b = Stepper(one, np.ones(1), threads=2), Stepper(whole, np.ones(1))
    n = len(a.core.dofs)
    seen = one.pattern.row_of < one.pattern.n

    def numbers(rows: Array) -> Array:
        return (n * rows[:, None] + np.arange(n)).reshape(-1)

    for stepper in (a, b):
        stepper.parts.start(0.02)
    moved = 0.0
    for _ in range(2):
        # the second tangent takes the stresses that the first increment led to; of the same increment, or residuals differ by
        # stiffness times round-off
        for mine, other in zip((b.work.dphi, b.work.theta, b.work.increment.control), (a.work.dphi, a.work.theta,
                                                                                       a.work.increment.control)):
            mine[:] = other
        b.work.increment.x.reshape(-1, 8)[whole.pattern.row_of] = a.work.increment.x.reshape(-1, 8)[one.pattern.row_of]
        a.parts.assemble(0.02)
        b.parts.assemble(0.02)
        condensed_matrix, condensed_rest = dense(a)
        matrix, rest = dense(b)
        # of every row of the condensed system one node
        node = np.zeros(one.pattern.n, np.int64)
        node[one.pattern.row_of[seen]] = np.flatnonzero(seen)
        ends = numbers(whole.pattern.row_of[node])
        inside = np.setdiff1d(np.arange(len(matrix)), ends)
        recovered = np.linalg.solve(matrix[np.ix_(inside, inside)], np.column_stack((matrix[np.ix_(inside, ends)], rest[inside])))
        schur = matrix[np.ix_(ends, ends)] - matrix[np.ix_(ends, inside)] @ recovered[:, :-1]
        right = rest[ends] - matrix[np.ix_(ends, inside)] @ recovered[:, -1]
        np.testing.assert_allclose(condensed_matrix, schur, rtol=0.0, atol=1e-12 * np.max(np.abs(matrix)))
        # stresses of the last increment are sums of stiffness times it, in another order in each
        round_off = 16.0 * np.finfo(float).eps * np.max(np.abs(matrix)) * moved
        np.testing.assert_allclose(condensed_rest, right, rtol=0.0, atol=1e-12 * np.max(np.abs(rest)) + round_off)
        x = np.linalg.solve(matrix, rest)
        # its own error, of the condition of the matrix, is corrected with a residual in more digits
        x += np.linalg.solve(matrix, (rest - matrix.astype(np.longdouble) @ x).astype(float))
        assert a.parts.solve() and b.parts.solve()
        a.parts.update(), b.parts.update()
        found = a.work.increment.x.reshape(-1, 8)[one.pattern.row_of, :n]
        expected = -x.reshape(-1, n)[whole.pattern.row_of]
        free = ~np.isin(np.arange(one.n_nodes), one.ties.slave if one.ties is not None else [])
        soft = np.max(np.abs(np.linalg.inv(matrix)).sum(axis=1))
        largest = np.max(np.abs(expected))
        np.testing.assert_allclose(found[free], expected[free], rtol=0.0, atol=1e-11 * largest + soft * round_off)
        moved = largest


def test_beam_whose_elimination_fails_is_told_apart_from_the_others() -> None:
    stepper = Stepper(fb.compile_scene(fb.Scene(grid(3)), condense=True, planar=False), np.ones(1))
    tables, group = stepper.core.simo, stepper.parts.subs.group
    stepper.parts.start(0.01)
    stepper.parts.assemble(0.01)
    assert stepper.parts.is_regular
    # reference strains of the second group's first element; constants are shared
    at = tables.meta[group[1, 0], 7]
    strains = stepper.work.reference_strains
    before = strains[at:at + 48].copy()
    strains[at:at + 48] = np.nan
    stepper.parts.assemble(0.01)
    assert stepper.parts.subs.state.tolist() == [1.0, 0.0, *[1.0] * (len(group) - 2)]
    assert not stepper.parts.solve()
    strains[at:at + 48] = before
    stepper.parts.assemble(0.01)
    assert stepper.parts.solve()


# --------------------------------------------------------------------------------------------------- steps and equilibria
@pytest.mark.parametrize(("seed", "strain", "degree", "sliders"), [
    (1, "simo_reissner", 1, False), (2, "green_lagrange", 2, False), (3, "simo_reissner", 3, True)])
def test_steps_of_random_nets_are_the_same(seed: int, strain: str, degree: int, sliders: bool) -> None:
    results = [fb.simulate(model, t_end=0.05, step=5e-3, progress=False, solver=fb.Solver(threads=2))
               for model in models(random_scene(seed, strain, degree, sliders))]
    assert_same(*results)
    assert results[0].info["fallbacks"] == results[1].info["fallbacks"] == 0
    assert results[0].info["iterations"] == results[1].info["iterations"]


@pytest.mark.parametrize("kind", ["springs", "drag", pytest.param("bushing", marks=pytest.mark.slow),
                                  pytest.param("loops", marks=pytest.mark.slow)])
def test_what_couples_nodes_of_a_net_acts_where_it_is_condensed(kind: str) -> None:
    net = grid(4)
    corner = net.nodes[15]
    body = fb.RigidBody("body", mass=1.0, inertia=(0.1, 0.1, 0.1), position=corner + (0.0, 0.0, -1.0))
    ground = fb.PointMass("ground", mass=1.0, position=corner + (0.0, 0.0, 2.0))
    parts: list[Any] = [net]
    if kind == "springs":
        parts += [ground, fb.Clamp(ground), fb.Spring(net.node(15), ground, stiffness=50.0, length=1.0)]
    if kind == "bushing":
        parts += [body, fb.Bushing(net.node(15), body, "mount", stiffness=(9, 8, 7, 0.2, 0.3, 0.4),
                                   damping=(0.1, 0.1, 0.1, 0.01, 0.01, 0.01))]
    if kind == "drag":
        rope = fb.Beam.straight("rope", corner, corner + (0.0, 0.0, -2.0), section=net.sections[0], elements=4)
        parts += [rope, fb.RigidConnection(net.node(15), rope.start), fb.Drag("air", rope, normal=2.0, air=(1, 0, 0))]
    if kind == "loops":
        parts += [body, fb.BallJoint(net.node(15), body.point((0, 0, 1))),
                  fb.BallJoint(net.node(14), body.point(net.nodes[14] - body.position)), fb.DistanceJoint(net.node(3), body)]
    scene = fb.Scene(*parts, gravity=(0, 0, -2))
    runs = [fb.simulate(model, t_end=0.05, step=0.01, progress=False) for model in models(scene, planar=False)]
    assert_same(*runs)
    assert np.max(np.abs(runs[0].phi[-1] - runs[0].phi[0])) > 1e-4


def test_steps_of_order_four_in_a_plane_are_the_same() -> None:
    scene = fb.Scene(grid(4, flat=True, degree=2), gravity=(0.0, -9.81, 0.0))
    results = [fb.simulate(model, t_end=0.02, step=5e-3, order=4, progress=False) for model in models(scene)]
    assert_same(*results)
    assert results[0].drift("total") < 1e-12


@pytest.mark.parametrize("flat", [False, True])
def test_equilibria_are_the_same(flat: bool) -> None:
    scene = fb.Scene(grid(4, flat=flat, degree=2), gravity=(0.0, -0.5, 0.0) if flat else (0.1, 0.2, -0.5))
    one, other = models(scene)
    results = [fb.solve_static(one, threads=1), fb.solve_static(one, threads=2), fb.solve_static(other)]
    assert_same(results[0], results[2])
    assert same_bits(results[0], results[1])
    assert results[0].info["unstable_directions"] == results[2].info["unstable_directions"] == 0


def test_other_solvers_and_methods_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = fb.Scene(grid(4), gravity=(0.3, 0.2, -9.81))
    one, other = models(scene, solver="sparse")
    options: dict[str, Any] = {"t_end": 0.01, "step": 5e-3, "progress": False}
    expected = fb.simulate(other, **options)
    for backend in ("auto", "superlu"):
        assert_same(fb.simulate(one, solver=backend, **options), expected)
    # the methods for comparison run without
    assert same_bits(*(fb.simulate(model, method="midpoint", **options) for model in (one, other)))


def test_step_that_cannot_be_condensed_is_taken_by_superlu(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = models(fb.Scene(grid(4), gravity=(0.3, 0.2, -9.81)))
    real, calls = beams.condense, [0]

    def fails_once_in_a_while(subs: Any, *arguments: Any) -> None:
        real(subs, *arguments)
        calls[0] += 1
        if calls[0] % 20 == 0:
            subs.state[0] = 0.0

    monkeypatch.setattr(condensed.beams, "condense", fails_once_in_a_while)
    result = fb.simulate(one, t_end=0.04, step=5e-3, progress=False, solver=fb.Solver(threads=1))
    monkeypatch.undo()
    assert result.info["steps"] == 8
    assert_same(result, fb.simulate(other, t_end=0.04, step=5e-3, progress=False))

    def never_regular(subs: Any, *arguments: Any) -> None:
        real(subs, *arguments)
        subs.state[0] = 0.0

    monkeypatch.setattr(condensed.beams, "condense", never_regular)
    result = fb.simulate(one, t_end=0.01, step=5e-3, progress=False)
    assert result.info["fallbacks"] == 2
    assert_same(result, fb.simulate(other, t_end=0.01, step=5e-3, progress=False))
    static = [fb.solve_static(fb.compile_scene(fb.Scene(grid(3), gravity=(0, 0, -0.1)), condense=c)) for c in (True, False)]
    assert_same(*static)


@pytest.mark.parametrize("halves", [False, True])
def test_results_are_the_same_bits_on_any_number_of_threads(halves: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    # more than one chunk of everything, and a matrix large enough for PARDISO to use its threads, or cut in two
    monkeypatch.setattr(linsolve, "HALVES_FROM", 0 if halves else np.inf)
    joints = np.random.default_rng(0).choice(["rigid", "ball"], 31**2).tolist()
    scene = fb.Scene(grid(30, joints=joints, elements=2), gravity=(0.3, 0.2, -9.81))
    model = fb.compile_scene(scene, condense=True, solver="sparse")
    steppers = [Stepper(model, np.ones(1), threads=k) for k in (1, 2, 3)]
    parts = steppers[0].parts
    assert min(len(x) for x in (parts._groups, parts._nodes, parts._moves, parts._terms)) > 1
    assert 6 * model.pattern.n > SMALL
    if load_mkl() is not None:
        assert all((stepper.linear.pardiso.halves is not None) == halves for stepper in steppers)
    for k in range(3):
        # in turn: each keeps its own number of threads
        for stepper in steppers:
            assert stepper.advance(0.0, 5e-3, 1, done=k).status == 0
    first = steppers[0].state
    assert all(np.array_equal(x, y) for other in steppers[1:] for x, y in zip(first, other.state))


def test_run_goes_on_bit_for_bit() -> None:
    scene = random_scene(3, "simo_reissner", 3, True)
    model = fb.compile_scene(scene, condense=True)
    options: dict[str, Any] = {"step": 5e-3, "progress": False}
    through = fb.simulate(model, t_end=0.04, **options)
    half = fb.simulate(model, t_end=0.02, **options)
    assert same_bits(fb.simulate(fb.compile_scene(scene, condense=True), start=half.checkpoint, t_end=0.04, **options), through)


# ------------------------------------------------------------------------------------------------------------ what is chosen
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_pieces_of_a_long_beam_leave_everything_the_same(degree: int, strain: str) -> None:
    # a body at an end of an element, a pin within one: pieces lie between them; loads anywhere
    beam = fb.Beam.straight("beam", (0, 0, 0), (9, 0, 0), section=TUBE, elements=300, degree=degree, strain=strain)
    body = fb.RigidBody("body", mass=3.0, inertia=(0.1, 0.2, 0.25), position=(3.0, 0.0, 0.0))
    wind = fb.DistributedLoad("wind", beam, force=(0.5, 1.0, -0.4))
    scene = fb.Scene(beam, body, fb.Clamp(beam.start), fb.RigidConnection(beam.node(100 * degree), body),
                     fb.Pin(beam.node(200 * degree + degree // 2)), wind, fb.Load("push", beam.node(77), force=(3.0, 2.0, 5.0)),
                     gravity=(0, 0, -9.81))
    one, other = models(scene, planar=False)
    assert one.condensed_elements > 250
    options: dict[str, Any] = {"t_end": 0.05, "step": 0.01, "progress": False}
    runs = [fb.simulate(model, **options) for model in (one, other)]
    assert_same(*runs)
    assert runs[0].info["iterations"] == runs[1].info["iterations"]
    assert same_bits(runs[0], fb.simulate(one, solver=fb.Solver(threads=2), **options))
    assert_same(*(fb.solve_static(model) for model in (one, other)))


def test_beams_that_something_touches_are_not_condensed() -> None:
    net = grid(4)
    bead = fb.PointMass("bead", mass=1.0)
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=net.nodes[net.edges[2]].mean(axis=0))
    touched = [fb.Slider("slider", bead, net.beam(0), at=0.5), fb.Pin(net.beam(1).node(1)),
               fb.RigidConnection(net.beam(2).node(2), body)]
    model = fb.compile_scene(fb.Scene(net, bead, body, *touched), condense=True)
    ends = model.simo.nodes.reshape(-1, 2, 8)[model.substructures.group[:, 0], 0]
    beam_of = np.searchsorted(net.node_start, ends.reshape(-1), side="right") - 1
    # the carrier of the slider is one more
    assert model.substructures.beam.size - 1 == beam_of.size == (len(net.edges) - 3) // 8 * 8 == len(set(beam_of.tolist()))
    assert not {0, 1, 2} & set(beam_of.tolist())
    assert f"{beam_of.size} beams or pieces of them condensed" in str(model)


def test_condensing_is_left_to_large_nets() -> None:
    assert fb.compile_scene(fb.Scene(grid(10, elements=4))).substructures is None
    assert fb.compile_scene(fb.Scene(grid(10, elements=5))).substructures is not None


def test_arguments_out_of_range_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SceneError, match="condense: must be 'auto', True or False, got 'yes'"):
        fb.compile_scene(fb.Scene(grid(2)), condense="yes")
    model = fb.compile_scene(fb.Scene(grid(3)), condense=True)
    with pytest.raises(SceneError, match="threads"):
        fb.simulate(model, t_end=0.1, step=0.01, solver=fb.Solver(threads=0))
    monkeypatch.setenv("FASTBEAM_THREADS", "many")
    with pytest.raises(SceneError, match="FASTBEAM_THREADS: must be a whole number >= 1, got 'many'"):
        fb.simulate(model, t_end=0.1, step=0.01)
    monkeypatch.setenv("FASTBEAM_THREADS", "3")
    assert condensed.thread_count(None, 10) == 3 and condensed.thread_count(2, 10) == 2
    monkeypatch.delenv("FASTBEAM_THREADS")
    assert condensed.thread_count(None, 10) == 1 <= condensed.thread_count(None, 10**6)
