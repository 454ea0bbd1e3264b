"""Equilibria of scenes with sliders: they make the energy stationary, sliders are held and released by name, what has no rest is
refused."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.state import State
from fastbeam.linalg.factors import factoriser_for
from fastbeam.linalg.mkl import load_mkl
from fastbeam.linalg.pattern import build_pattern
from fastbeam.linalg.saddle import Saddle
from fastbeam.linalg.scaling import equilibrated
from fastbeam.model.mapping import contact, follow
from fastbeam.model.maps import free_unknowns, share_map
from fastbeam.model.model import Model
from fastbeam.results.observe.observer import Observer
from fastbeam.statics.slider_friction import with_friction
from fastbeam.stepping.assembled import Constraints, Equations, SaddleMatrix, entries_of_matrix
from fastbeam.stepping.stepper import Stepper

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import SECTION, bead, cantilever, straight  # noqa: E402

Array = np.ndarray
GRAVITY = (0.0, 0.0, -9.81)
SOFT = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=5.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def rope(name: str = "rope", start: tuple[float, ...] = (0, 0, 0), end: tuple[float, ...] = (3, 0, 0), **changes: Any) -> fb.Beam:
    return fb.Beam.straight(name, start, end, **{"section": SOFT, "elements": 6, "degree": 2, **changes})


def ring_on_rope(at: float = 0.8, mass: float = 5.0, *more: Any, clamped: bool = False) -> fb.Scene:
    """A ring on a rope whose right end is higher."""
    b, ring = rope(end=(3, 0, 0.2)), fb.PointMass("ring", mass=mass)
    ends = [fb.Clamp(b.start), fb.Clamp(b.end)] if clamped else [fb.Pin(b.start), fb.Pin(b.end)]
    return fb.Scene(b, ring, *ends, fb.Slider("run", ring, b, at=at), *more, gravity=GRAVITY, name="ring on rope")


def mechanism(side: float) -> fb.Scene:
    """Sliding points that are a mass, points of a body at arms, a node of another beam with a ball joint below, and one more on a
    beam that itself slides; side: a force out of the plane."""
    b, low = rope(elements=8, end=(4, 0, 0.2)), rope("low", (0, 0, -2), (4, 0, -2.2))
    ring = fb.PointMass("ring", mass=2.0)
    box = fb.RigidBody("box", mass=3.0, inertia=(0.5, 0.6, 0.7), position=(2.5, 0, -0.5))
    hanger = straight("hanger", (1.4, 0, 0.07), (1.4, 0, -1.0), section=SOFT, elements=2)
    weight = fb.PointMass("weight", mass=2.0, position=(1.4, 0, -1.0))
    return fb.Scene(b, low, ring, box, hanger, weight, fb.Clamp(b.start), fb.Clamp(b.end), fb.Clamp(low.start), fb.Clamp(low.end),
                    fb.BallJoint(hanger.end, weight), fb.Slider("run", ring, low, at=1.0),
                    fb.Slider("left", box.point((-0.5, 0, 0.6)), b, at=0.5 * b.length),
                    fb.Slider("right", box.point((0.5, 0, 0.65)), b, at=0.75 * b.length),
                    fb.Slider("hook", hanger.start, b, at=0.35 * b.length), fb.Load("wind", b.node(7), force=(0, side, 0)),
                    fb.Load("push", box, force=(0.5 * side, side, 0)), gravity=GRAVITY, name="mechanism")


def solve(scene: fb.Scene, planar: Any = "auto", **arguments: Any) -> fb.Result:
    return fb.solve_static(fb.compile_scene(scene, planar=planar), **arguments)


# ------------------------------------------------------------------------------------------------- the twin: energies alone
def moved(model: Model, state: State, unknown: int, by: float) -> Array:
    """Coordinates [N, 4, 3] with one unknown of a node moved or turned; what is tied follows."""
    q = state.q.reshape(-1, 4, 3).copy()
    step = np.zeros(6 * model.n_nodes)
    step[unknown] = by
    step = (share_map(model) @ step).reshape(-1, 6)
    q[:, 0] += step[:, :3]
    for i in np.flatnonzero(np.any(step[:, 3:], axis=1)):
        axis = step[i, 3:] / by
        k = np.cross(axis, np.eye(3)).T
        q[i, 1:] = q[i, 1:] @ (np.eye(3) + np.sin(by) * k + (1.0 - np.cos(by)) * k @ k).T
    return follow(model, q)


def lagrangian(model: Model, q: Array, s: Array, force: Array) -> float:
    """Energy of strain, weight and loads less the work of the contact forces on the gaps."""
    loads = float(np.sum(q[:, 0] * (model.gravity_weight[:, None] * model.gravity + model.constant_load)))
    gaps = [contact(model, k, float(s[k]), q, q)[0] for k in range(s.size)]
    stored = Observer(model, ("energy",), None).strain_energy(q.reshape(-1))
    return stored - loads - float(np.sum(np.array(gaps) * force.reshape(-1, 3)))


def slopes(model: Model, state: State) -> tuple[Array, Array]:
    """Derivatives of the Lagrangian by all free unknowns, and by all s."""
    h = 1e-5

    def slope(f: Any) -> float:
        return (8.0 * (f(h) - f(-h)) - f(2.0 * h) + f(-2.0 * h)) / (12.0 * h)

    by_node = [slope(lambda x, u=u: lagrangian(model, moved(model, state, u, x), state.s, state.force))
               for u in free_unknowns(model)]
    q = state.q.reshape(-1, 4, 3)
    unit = np.eye(state.s.size)
    by_s = [slope(lambda x, k=k: lagrangian(model, q, state.s + x * unit[k], state.force)) for k in range(state.s.size)]
    return np.array(by_node), np.array(by_s)


@pytest.mark.parametrize(("scene", "planar"), [(ring_on_rope(), True), (ring_on_rope(clamped=True), False),
                                               (mechanism(0.0), True), (mechanism(5.0), False)])
def test_an_equilibrium_makes_the_energy_stationary(scene: fb.Scene, planar: bool) -> None:
    model = fb.compile_scene(scene, planar=planar)
    result = fb.solve_static(model)
    by_node, by_s = slopes(model, result.state)
    assert np.max(np.abs(by_node)) < 1e-6 and np.max(np.abs(by_s)) < 1e-6, "forces of 50 N"
    assert np.max(result.series["gap"][-1]) < 1e-14
    assert result.info["unstable_directions"] == 0


def constraints_of(plain: Model) -> Constraints:
    return Constraints(Stepper(plain, np.ones(1), backend="superlu", static=True))


def equations_at(constraints: Constraints, q: Array, s: Array, force: Array, slip: Array | None = None) -> Equations:
    """Equations at coordinates [N, 4, 3] in space."""
    state, plane = constraints.stepper.core_state, constraints.stepper.plane
    there = constraints.stepper.state._replace(q=q.reshape(-1))
    state.q[:] = there.q if plane is None else plane.reduce(there).q
    state.s[:], state.force[:] = s, force
    found = constraints.at()
    return found if slip is None else with_friction(constraints, found, slip)


def components(plain: Model, planar: bool) -> Array:
    """Unknowns of a node in space -> those of its row [n, 6]."""
    if not planar:
        return np.eye(6)
    axes = plain.plane.axes
    return np.concatenate((np.pad(axes[:2], ((0, 0), (0, 3))), np.pad(axes[2:], ((0, 0), (3, 0)))))


@pytest.mark.parametrize("planar", [True, False])
def test_equations_of_sliders_have_their_derivatives(planar: bool) -> None:
    model = fb.compile_scene(mechanism(0.0), planar=planar)
    assert model.uneliminated is not None
    plain = model.uneliminated(planar=planar)
    constraints, turn = constraints_of(plain), components(plain, planar)
    state, h = plain.state(), 1e-6
    force = np.random.default_rng(1).standard_normal(8 if planar else 12)

    def equations(q: Array, s: Array) -> Equations:
        return equations_at(constraints, q, s, force)

    at = equations(state.q, state.s)
    size = len(turn) * plain.pattern.n
    gradient, slide = at.gradient.matrix(force.size, size).toarray(), at.slide.matrix(4, size).toarray()
    for u in free_unknowns(plain):
        node, c = divmod(int(u), 6)
        if not turn[:, c].any():
            continue
        column = len(turn) * int(plain.pattern.row_of[node])
        up, down = (equations(moved(plain, state, u, x), state.s) for x in (h, -h))
        for found, change in ((gradient, (up.gap - down.gap).reshape(-1)), (slide, up.sliding - down.sliding)):
            np.testing.assert_allclose(found[:, column:column + len(turn)] @ turn[:, c], change / (2 * h), rtol=0.0, atol=1e-8)
    up, down = (equations(state.q, state.s + x) for x in (h, -h))
    np.testing.assert_allclose(at.bend, (up.sliding - down.sliding) / (2 * h), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(-at.tangent, (up.gap - down.gap) / (2 * h), rtol=0.0, atol=1e-8)
    # as loads on the rows they do the work that they do on the gaps
    q1 = moved(plain, state, int(6 * plain.sliders.point[0]), 1.0)
    first = (q1 - state.q.reshape(-1, 4, 3))[:, 0]
    there = equations(q1, state.s)
    work = at.loads.reshape(-1, 8)[plain.pattern.row_of]
    d = at.gap.shape[1]
    along = np.sum((first @ turn[:d, :3].T) * work[:, :d])
    assert along == pytest.approx(np.sum((there.gap - at.gap).reshape(-1) * force))


def in_a_sleeve() -> fb.Scene:
    rod = rope(end=(2, 0, 0))
    body = fb.RigidBody("holder", mass=1, inertia=(1, 1, 1), position=(1, 0, 0))
    return fb.Scene(rod, body, fb.Clamp(rod.start), fb.Sleeve("sleeve", body, rod, at=1.0, length=0.3, friction=0.3,
                                                              key_radius=0.02))


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("scene", [mechanism(0.0), in_a_sleeve()], ids=["sliders", "sleeve"])
def test_friction_has_the_derivatives_of_its_equations(scene: fb.Scene, planar: bool) -> None:
    plain = fb.compile_scene(scene, planar=planar).uneliminated(planar=planar)
    constraints, turn = constraints_of(plain), components(plain, planar)
    state, h = plain.state(), 1e-6
    count = plain.plane.model.n_forces if planar else plain.n_forces
    force, slip = np.random.default_rng(1).standard_normal(count), np.array([0.3, -0.2, 0.4, -0.5])[:state.s.size]

    def equations(q: Array, s: Array, force: Array) -> Equations:
        return equations_at(constraints, q, s, force, slip)

    at = equations(state.q, state.s, force)
    up, down = (equations(state.q, state.s + x, force) for x in (h, -h))
    np.testing.assert_allclose(at.bend, (up.sliding - down.sliding) / (2 * h), rtol=0.0, atol=1e-6)
    sliders, d = at.tangent.shape
    size = len(turn) * plain.pattern.n
    by_force = at.by_force.matrix(sliders, count).toarray() + at.turns.matrix(count, sliders).toarray().T
    for k, tangent in enumerate(at.tangent):
        by_force[k, d * k:d * k + d] += tangent
    for j, unit in enumerate(h * np.eye(count)):
        up, down = (equations(state.q, state.s, force + x * unit) for x in (1, -1))
        np.testing.assert_allclose(by_force[:, j], (up.sliding - down.sliding) / (2 * h), rtol=0.0, atol=1e-8)
    by_node = at.slide.matrix(sliders, size).toarray() + at.rubbing.matrix(sliders, size).toarray()
    for u in free_unknowns(plain):
        node, c = divmod(int(u), 6)
        if not turn[:, c].any():
            continue
        up, down = (equations(moved(plain, state, u, x), state.s, force) for x in (h, -h))
        column = len(turn) * int(plain.pattern.row_of[node])
        np.testing.assert_allclose(by_node[:, column:column + len(turn)] @ turn[:, c], (up.sliding - down.sliding) / (2 * h),
                                   rtol=0.0, atol=1e-8)


# ------------------------------------------------------------------------------------------------------------ the saddle
def dense(n: int, m: int, seed: int, negative: int = 0, free: int = 0) -> tuple[Array, Array, int]:
    """[A, B^T; B, 0] with units far apart, its multipliers, and the negative directions of A where B x = 0."""
    rng = np.random.default_rng(seed)
    b = rng.standard_normal((m, n))
    null = np.linalg.svd(b)[2][m:].T
    values = np.concatenate((-np.ones(negative), np.zeros(free), rng.uniform(0.5, 2.0, n - m - negative - free)))
    turn = np.linalg.qr(rng.standard_normal((n - m, n - m)))[0]
    across = rng.standard_normal((m, n))
    a = null @ (turn * values) @ turn.T @ null.T
    if not free:
        a += across.T @ b + b.T @ across
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[n:, :n], whole[:n, n:] = a, b, b.T
    scale = 10.0**rng.uniform(-3.0, 3.0, n + m)
    return whole * scale * scale[:, None], np.arange(n + m) >= n, negative


@pytest.mark.parametrize("negative", [0, 1, 3])
def test_directions_are_counted_among_the_motions_that_constraints_allow(negative: int) -> None:
    from scipy import sparse
    for seed in range(5):
        matrix, multiplier, _ = dense(12, 4, seed, negative)
        assert Saddle(sparse.csr_matrix(matrix), multiplier).signs() == (negative, 0)
    matrix, multiplier, _ = dense(12, 4, 9, 0, free=2)
    assert Saddle(sparse.csr_matrix(matrix), multiplier).signs() == (0, 2)


def test_directions_of_an_unsymmetric_matrix_follow_from_its_determinant() -> None:
    from scipy import sparse
    # x, y, z on the plane z = 0: a skew part that makes the symmetric part undecided
    for own, skew, found in ((1.0, 0.5, (0, 0)), (-1.0, 0.5, (1, 0)), (-1.0, 3.0, None)):
        matrix = np.zeros((4, 4))
        matrix[:2, :2] = [[1.0, skew], [-skew, own]]
        matrix[2, 2], matrix[2, 3], matrix[3, 2] = 1.0, 1.0, 1.0
        assert Saddle(sparse.csr_matrix(matrix), np.arange(4) == 3).signs(symmetric=False) == found


BACKENDS = ["superlu", pytest.param("pardiso", marks=pytest.mark.skipif(load_mkl() is None, reason="no MKL"))]


@pytest.mark.parametrize("backend", BACKENDS)
def test_saddle_is_solved_whatever_the_units(backend: str) -> None:
    from scipy import sparse
    matrix, multiplier, _ = dense(12, 4, 3)
    x = np.random.default_rng(0).standard_normal(16)
    # of the size of the units
    x *= np.sqrt(1.0 / np.abs(matrix).max(axis=0))
    saddle = Saddle(sparse.csr_matrix(matrix), multiplier, factoriser_for(backend, threads=1))
    found = saddle.solve(matrix @ x)
    assert found is not None and not saddle.is_singular
    np.testing.assert_allclose(found / x, 1.0, rtol=0.0, atol=1e-9)
    row, column = equilibrated(sparse.csr_matrix(matrix))
    np.testing.assert_array_equal(row, column)
    largest = (np.abs(matrix) * row[:, None] * column).max(axis=0)
    assert np.all((largest > 0.4) & (largest < 2.1))
    assert saddle.solve(np.full(16, np.nan)) is None
    assert Saddle(sparse.csr_matrix(np.full((2, 2), np.nan)), np.zeros(2, bool)).solve(np.ones(2)) is None


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_a_singular_saddle_is_not_asked_for_stays_small(backend: str) -> None:
    from scipy import sparse
    # the same constraint twice, and a coordinate that nothing holds
    matrix = np.zeros((5, 5))
    matrix[0, 0], matrix[3, 0], matrix[4, 0] = 2e6, 1.0, 1.0
    matrix[0, 3:] = 1.0
    matrix[1, 1] = 5e3
    factors = factoriser_for(backend, threads=1)
    saddle = Saddle(sparse.csr_matrix(matrix), np.array([False, False, False, True, True]), factors)
    x = saddle.solve(np.array([7.0, 1.0, 0.0, 0.0, 0.0]))
    assert x is not None and saddle.is_singular
    np.testing.assert_allclose(x, [0.0, 2e-4, 0.0, 3.5, 3.5], rtol=0.0, atol=1e-7)
    assert factors is None or factors.refused == 1


@pytest.mark.skipif(load_mkl() is None, reason="no MKL")
def test_pardiso_gives_the_solution_of_superlu_and_analyses_a_structure_once() -> None:
    from scipy import sparse
    factors = factoriser_for("pardiso")
    assert factors is not None
    for seed in range(6):
        matrix, multiplier, _ = dense(30, 8, seed, seed % 2)
        right = np.sum(np.abs(matrix), axis=1)
        one, other = (Saddle(sparse.csr_matrix(matrix), multiplier, x).solve(right) for x in (factors, None))
        assert one is not None and other is not None
        np.testing.assert_allclose(one * np.abs(matrix).max(axis=0), other * np.abs(matrix).max(axis=0), rtol=1e-7, atol=1e-7)
    assert factors.refused == 0 and factors.count >= 6
    analyses = factors.analyses
    assert Saddle(sparse.csr_matrix(matrix), multiplier, factors).solve(right) is not None
    assert factors.analyses == analyses
    assert Saddle(sparse.csr_matrix(matrix[:-1, :-1]), multiplier[:-1], factors).solve(right[:-1]) is not None
    assert factors.analyses == analyses + 1


def test_a_stiffened_saddle_keeps_its_structure() -> None:
    from scipy import sparse
    matrix, multiplier, _ = dense(12, 4, 2)
    saddle = Saddle(sparse.csr_matrix(matrix), multiplier)
    stiff = saddle.stiffened(1e-3)
    np.testing.assert_array_equal(stiff.matrix.indices, saddle.matrix.indices)
    np.testing.assert_array_equal(stiff.matrix.indptr, saddle.matrix.indptr)
    more = (stiff.matrix - saddle.matrix).toarray() * saddle.row[:, None] * saddle.column
    np.testing.assert_allclose(more, np.diag(np.where(multiplier, 0.0, 1e-3)), rtol=0.0, atol=1e-15)


def test_blocks_and_constraints_are_put_together_as_they_stand_in_the_equations() -> None:
    from scipy import sparse
    rng = np.random.default_rng(0)
    pairs = [(i, j) for i in range(5) for j in range(5) if abs(i - j) <= 1]
    pattern = build_pattern(5, np.array(pairs), 2, allow_elimination=False)
    size, s, m = 3, 2, 5
    blocks = rng.standard_normal((pattern.keys.size + 1, size, 8))
    assembled = SaddleMatrix(pattern, size, s, m)
    for density in (0.2, 0.5, 0.2):
        gradient, slide = (sparse.random(k, 15, density, random_state=rng, format="csr") for k in (m, s))
        bent = sparse.random(15, 15, 0.1, random_state=rng, format="csr")
        tangent, bend = rng.standard_normal((s, 2)), rng.standard_normal(s)
        # a direction in a sleeve that depends on s of the second slider
        turns = sparse.csr_matrix((rng.standard_normal(1), ([m - 1], [1])), shape=(m, s))
        equations = Equations(np.zeros((s, 2)), tangent, np.zeros(s), bend, np.zeros(m), *map(entries_of_matrix, (
            gradient, slide, turns)), np.zeros(0, np.int64), np.zeros(0), entries_of_matrix(bent))
        for sliding in (np.array([True, False]), np.array([False, False]), np.array([True, True])):
            nodes = np.zeros((15, 15))
            for k, (i, j) in enumerate(zip(pattern.rows, pattern.columns)):
                nodes[3 * i:3 * i + 3, 3 * j:3 * j + 3] = 2.0 * blocks[k, :, :3]
            whole = np.zeros((22, 22))
            push = slide.toarray() * sliding[:, None]
            whole[:15, :15], whole[15:17, :15], whole[:15, 15:17] = nodes + bent.toarray(), push, push.T
            whole[17:, :15], whole[:15, 17:] = -gradient.toarray(), -gradient.toarray().T
            whole[15:17, 15:17] = np.diag(np.where(sliding, bend + 0.5, 1.0))
            for k in range(s):
                whole[15 + k, 17 + 2 * k:19 + 2 * k] = whole[17 + 2 * k:19 + 2 * k, 15 + k] = tangent[k] * sliding[k]
            whole[16, 21] = whole[21, 16] = turns[m - 1, 1] * sliding[1]
            found = assembled.of(blocks.reshape(-1), equations, sliding, 0.5)
            np.testing.assert_allclose(found.toarray(), whole, rtol=1e-14, atol=1e-15)
            assert found.has_sorted_indices


# -------------------------------------------------------------------------------------------------------------- plane, space
def test_plane_and_space_agree() -> None:
    flat, full = solve(ring_on_rope(clamped=True)), solve(ring_on_rope(clamped=True), planar=False)
    np.testing.assert_allclose(flat.state.q, full.state.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(flat.state.s, full.state.s, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(flat.state.force, full.state.force, rtol=0.0, atol=1e-9)
    assert flat.info["counted_in"] == full.info["counted_in"] == "space"


def test_a_force_from_the_side_takes_the_ring_out_of_the_plane() -> None:
    scene = ring_on_rope(clamped=True)
    scene.add(fb.Load("side", scene.masses[0], force=(0, 20, 0)))
    result = solve(scene)
    np.testing.assert_allclose(result.slider("run")["force"][-1], (0, -20, 5 * 9.81), atol=1e-9)
    assert result.slider("run")["position"][-1, 1] > 1e-3


# --------------------------------------------------------------------------------------------------------- held and released
def test_the_answer_does_not_depend_on_where_the_slider_starts() -> None:
    found = [solve(ring_on_rope(at)).state.s[0] for at in (0.0, 0.3, 1.9, 2.9)]
    assert np.ptp(found) < 1e-9 and 0.2 < found[0] < 1.4


def test_a_held_slider_stays_and_its_force_has_a_part_along_the_beam() -> None:
    free, held = solve(ring_on_rope()), solve(ring_on_rope(), held="run")
    assert held.state.s[0] == 0.8 and free.state.s[0] != 0.8
    np.testing.assert_allclose(held.state.force, (0, 0, 5 * 9.81), atol=1e-9)
    assert free.series["total"][-1] < held.series["total"][-1]
    for names in (True, ("run",), ["run"], {"run"}):
        np.testing.assert_array_equal(solve(ring_on_rope(), held=names).state.s, held.state.s)
    for names in (False, (), []):
        np.testing.assert_array_equal(solve(ring_on_rope(), held=names).state.s, free.state.s)


def test_the_place_of_rest_has_the_least_energy_of_all() -> None:
    model = fb.compile_scene(ring_on_rope())
    rest = fb.solve_static(model)
    at = rest.state.s[0]
    around = {d: fb.solve_static(fb.compile_scene(ring_on_rope(at + d)), held=True).series["total"][-1] for d in (-1e-2, 1e-2)}
    assert all(energy > rest.series["total"][-1] for energy in around.values())
    # the middle of a parabola through three energies
    low, middle, high = around[-1e-2], rest.series["total"][-1], around[1e-2]
    assert abs(0.5e-2 * (low - high) / (low - 2.0 * middle + high)) < 2e-4


def test_some_are_held_and_others_slide() -> None:
    b, rings = rope(), [fb.PointMass(name, mass=3.0) for name in "ab"]
    scene = fb.Scene(b, *rings, fb.Pin(b.start), fb.Pin(b.end), fb.Slider("A", rings[0], b, at=0.7),
                     fb.Slider("B", rings[1], b, at=2.0), gravity=GRAVITY)
    one = solve(scene, held=("A",))
    assert one.state.s[0] == 0.7 and one.state.s[1] != 2.0
    for name, sliding in (("A", True), ("B", False)):
        model = fb.compile_scene(scene)
        k = model.names["sliders"].index(name)
        tangent = contact(model, k, one.state.s[k], one.state.q.reshape(-1, 4, 3), np.zeros((model.n_nodes, 4, 3)))[1]
        assert (abs(tangent @ one.state.force[3 * k:3 * k + 3]) > 1e-3) == sliding
    assert solve(scene).state.s[0] == pytest.approx(1.5, abs=1e-6)


@pytest.mark.parametrize(("held", "message"), [
    ("ring", "held: scene 'ring on rope' has no slider 'ring'; its sliders are 'run'"),
    (("run", "ring"), "has no slider 'ring'"), (3, r"held: must be True \(all\), False \(none\), or names of sliders"),
    ("", "held: must be True"), ((1,), "held: must be True"), (b"run", "held: must be True")])
def test_sliders_that_do_not_exist_are_refused(held: Any, message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        solve(ring_on_rope(), held=held)


def test_a_scene_without_sliders_has_none_to_hold() -> None:
    with pytest.raises(fb.SceneError, match="held: scene 'cantilever' has no slider 'run'; it has no sliders"):
        solve(cantilever(), held="run")
    np.testing.assert_array_equal(solve(cantilever(), held=True).state.q, solve(cantilever()).state.q)


def test_what_a_run_of_a_beam_and_a_bead_in_flight_has_is_no_support() -> None:
    with pytest.raises(fb.SceneError, match="beam 'rail': it is not supported in statics"):
        solve(bead())


def test_backends_are_checked_with_sliders_too() -> None:
    with pytest.raises(fb.SceneError, match="backend 'mumps' does not exist"):
        solve(ring_on_rope(), backend="mumps")


# --------------------------------------------------------------------------------------------------------- no place of rest
def hanging(at: float = 1.0) -> fb.Scene:
    b, ring = rope(end=(0, 0, -3)), fb.PointMass("ring", mass=5.0)
    return fb.Scene(b, ring, fb.Clamp(b.start), fb.Slider("run", ring, b, at=at), gravity=GRAVITY, name="hanging")


def test_a_ring_on_a_vertical_cable_runs_off() -> None:
    with pytest.raises(fb.ConvergenceError, match=r"slider 'run' leaves its beam: .*held=\('run',\)") as caught:
        solve(hanging())
    assert caught.value.state.s[0] == 1.0 and caught.value.result.t[-1] == caught.value.time == 0.0
    held = solve(hanging(), held="run")
    assert held.info["unstable_directions"] == 0
    np.testing.assert_allclose(held.state.force, (0, 0, 5 * 9.81), atol=1e-9)


def test_a_ring_at_the_end_of_its_beam_leaves_it_where_it_can() -> None:
    result = solve(ring_on_rope(3.0))
    assert result.state.s[0] < 1.4
    with pytest.raises(fb.ConvergenceError, match="slider 'run' leaves its beam"):
        solve(hanging(3.0))


def test_a_ring_without_weight_on_a_straight_wire_is_free() -> None:
    b, ring = rope(), fb.PointMass("ring", mass=5.0)
    scene = fb.Scene(b, ring, fb.Clamp(b.start), fb.Clamp(b.end), fb.Slider("run", ring, b, at=0.8), name="wire")
    result = solve(scene, planar=False)
    assert result.state.s[0] == pytest.approx(0.8, abs=1e-12)
    assert result.info["free_directions"] == 1 and result.info["unstable_directions"] == 0
    assert any(event["kind"] == "free" for event in result.events)
    np.testing.assert_allclose(result.state.force, 0.0, atol=1e-12)


def test_a_ring_on_top_of_an_arch_is_unstable() -> None:
    arch = fb.Beam.arc("arch", (-1, 0, 0), (0.6, 0, 0.8), (0.8, 0, -0.6), radius=1.25, angle=2 * np.arctan2(0.8, 0.6),
                       section=SECTION, elements=6, degree=2)
    ring = fb.PointMass("ring", mass=1.0)
    scene = fb.Scene(arch, ring, fb.Clamp(arch.start), fb.Clamp(arch.end), fb.Slider("run", ring, arch, at=0.5 * arch.length),
                     gravity=GRAVITY)
    result = solve(scene)
    assert result.state.s[0] == pytest.approx(0.5 * arch.length, abs=1e-9) and result.info["unstable_directions"] == 1
    off = fb.Scene(arch, ring, *scene.clamps, fb.Slider("run", ring, arch, at=0.45 * arch.length), gravity=GRAVITY)
    with pytest.raises(fb.ConvergenceError, match="leaves its beam"):
        solve(off)


def test_a_kink_of_the_curve_is_no_place_of_rest() -> None:
    b, ring = rope(elements=7, degree=1, section=SECTION), fb.PointMass("ring", mass=5.0)
    parts = (b, ring, fb.Clamp(b.start), fb.Clamp(b.end), fb.Load("more", b.node(3), force=(0, 0, -100)))
    message = "slider 'run' is pushed to the same place from both sides, near s = 1.285.*'c1'"
    with pytest.raises(fb.ConvergenceError, match=message):
        solve(fb.Scene(*parts, fb.Slider("run", ring, b, at=0.8, curve="own"), gravity=GRAVITY))
    smooth = solve(fb.Scene(*parts, fb.Slider("run", ring, b, at=0.8), gravity=GRAVITY))
    assert 1.0 < smooth.state.s[0] < 2.0


def test_moments_in_space_leave_the_number_of_directions_to_the_symmetric_part() -> None:
    scene = ring_on_rope(0.8, 5.0, clamped=True)
    scene.add(fb.Load("twist", scene.beams[0].node(6), moment=(0.3, 0.2, 0.1)))
    result = solve(scene)
    assert result.info["unstable_directions"] == 0 and result.info["counted_in"] == "space"


# -------------------------------------------------------------------------------------------------------------- rows, start
def test_rows_tell_place_and_force_of_every_load_step() -> None:
    result = solve(ring_on_rope(), levels=(0.25, 0.5))
    found = result.slider("run")
    assert len(found["s"]) == len(result.t) and {0.25, 0.5, 1.0} <= set(result.t.tolist())
    np.testing.assert_allclose(found["force"], result.t[:, None] * np.array([0, 0, 5 * 9.81]), atol=1e-9)
    assert np.max(found["gap"]) < 1e-13
    assert result.info["contact_force"] == "of the equilibrium" and "SuperLU" in result.info["solver"]
    only = solve(ring_on_rope(), observe=())
    assert "total" not in only.series and "s_slide" in only.series


def test_an_equilibrium_is_a_start_of_the_next_one() -> None:
    model = fb.compile_scene(ring_on_rope())
    cold = fb.solve_static(model)
    warm = fb.solve_static(model, start=cold.state, load_step=1.0)
    np.testing.assert_allclose(warm.state.q, cold.state.q, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(warm.state.s, cold.state.s, rtol=0.0, atol=1e-10)
    heavier = fb.compile_scene(ring_on_rope(mass=8.0))
    again = fb.solve_static(heavier, start=cold.state_for(heavier))
    np.testing.assert_allclose(again.state.s, solve(ring_on_rope(mass=8.0)).state.s, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(model.s0, [0.8])


def test_a_run_that_starts_at_rest_stays_at_rest() -> None:
    for scene in (ring_on_rope(), mechanism(5.0)):
        model = fb.compile_scene(scene)
        rest = fb.solve_static(model)
        run = fb.simulate(model, t_end=0.2, step=0.01, start=rest.state, progress=False)
        assert np.max(run.series["kinetic"]) < 1e-18
        np.testing.assert_allclose(run.series["s_slide"] - rest.state.s, 0.0, atol=1e-11)
        np.testing.assert_allclose(run.series["contact_force"][-1].reshape(-1), rest.state.force, atol=1e-6)
        assert run.is_conserved("total")


def test_time_functions_of_loads_are_taken_at_their_time() -> None:
    scene, plain = ring_on_rope(), ring_on_rope()
    scene.add(fb.Load("pull", scene.masses[0], force=(20, 0, 0), time=lambda t: t))
    plain.add(fb.Load("pull", plain.masses[0], force=(10, 0, 0)))
    np.testing.assert_allclose(solve(scene, at_time=0.5).state.s, solve(plain).state.s, rtol=0.0, atol=1e-10)
    assert solve(plain).state.s[0] > solve(ring_on_rope()).state.s[0] + 0.1
