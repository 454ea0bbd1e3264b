"""Algebra, element groups, node loops and contact functions of the kernels against plain NumPy."""
from __future__ import annotations

import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numpy.polynomial import legendre as np_legendre

from fastbeam.compile.compile import compile_scene
from fastbeam.compile.tracks import Track
from fastbeam.kernels.algebra import lanes as rows
from fastbeam.kernels.algebra import vectors as al
from fastbeam.kernels.algebra.blocks import SIX
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.element_loop import ElementTables, element_groups
from fastbeam.kernels.beams.inner_nodes import NoInner
from fastbeam.kernels.beams.motions import OverStep, Still
from fastbeam.kernels.beams.nodes import NO_VELOCITIES, NODES_SCRATCH, add_bodies, advance, predict, spread, update_nodes
from fastbeam.kernels.beams.strain_measures import GREEN_LAGRANGE, SIMO_REISSNER
from fastbeam.kernels.beams.ties import tie_arm, tie_coordinates
from fastbeam.kernels.contact.curves import Curves, find_element, legendre, point_on_curve, step_basis
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.layout import layout_of
from fastbeam.kernels.state import LastIncrement
from fastbeam.kernels.terms import Conserving, Equilibrium, NoTies, tie_increments
from fastbeam.model.model import Model
from fastbeam.model.tables import pack_curves
from fastbeam.model.workspace import scratch_of
from fastbeam.scene import BallJoint, Beam, RigidBody, RigidConnection, Scene, Section

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive import (  # noqa: E402
    Twin,
    beam_forms,
    beam_strains,
    cay,
    cayley_vector,
    form_matrix,
    increments,
    internal_forces,
    project,
    skew,
    strains_of,
    stresses_of_forms,
)

Array = np.ndarray
EXACT = 1e-14  # a handful of operations on numbers of order one
SECTION = Section(EA=200.0, GA2=150.0, GA3=130.0, GJ=50.0, EI2=60.0, EI3=70.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)


# --------------------------------------------------------------------------------------------------------------- algebra
@numba.njit
def formulas_of_eight_lanes(u, v, m, t, out):
    """u, v [3, 8], m [9, 8], t [8] -> out [*, 8]."""
    x = al.vld3(u, 0, 8)
    y = al.vld3(v, 0, 8)
    a = al.vldm(m, 0, 8)
    s = al.vld(t, 0, 0)
    al.vst(out, 0, 0, al.dot(x, y))
    al.vst3(out, 8, 8, al.cross(x, y))
    al.vstm(out, 32, 8, al.outer(x, y))
    al.vstm(out, 104, 8, al.add_iso(a, s))
    al.vstm(out, 176, 8, al.add_skew(a, x))
    al.vst3(out, 248, 8, x + y)
    al.vst3(out, 272, 8, x - y)
    al.vst3(out, 296, 8, s * x)
    al.vst3(out, 320, 8, 2.5 * x)
    al.vstm(out, 344, 8, s * a)
    al.vst(out, 416, 0, (s + 1.0) * s / (2.0 - s))
    al.vst(out, 424, 0, 1.0 / s - s * 3.0)
    al.vst3(out, 432, 8, al.vzero3() + x)
    al.vst_matrix(out, 456, 48, 8, a)
    al.vst_matrix(out, 456 + 24, 48, 8, al.vzerom())
    al.vadd_matrix(out, 456 + 24, 48, 8, a)
    al.vadd_matrix(out, 456 + 24, 48, 8, a)
    al.vst3(out, 600, 16, x)
    al.vadd3(out, 600, 16, y)
    al.vst(out, 648, 0, al.vzero())
    al.vst(out, 656, 0, 7.0)


@numba.njit
def formulas_of_one_lane(u, v, m, out):
    """u, v [3], m [9] -> out."""
    x = al.ld3(u, 0, 1)
    y = al.ld3(v, 0, 1)
    a = al.add_skew(al.add_iso(al.outer(x, y), 2.0), y)
    al.st3(out, 0, 1, al.cross(x, y))
    out[3] = al.dot(x, y)
    out[4] = al.component0(x)
    out[5] = al.component1(x)
    out[6] = al.component2(x)
    al.add_matrix(out, 7, 3, 1, a)
    al.st3(out, 16, 2, x - 3 * y)
    al.add3(out, 16, 2, y)
    al.add_matrix(out, 22, 1, 4, al.zerom() - a + a + a)
    al.st3(out, 34, 1, al.zero3() + 0.5 * x)


def lanes(*arrays: Array) -> Array:
    return np.concatenate([a.reshape(-1, 8) for a in arrays])


def test_lane_formulas_equal_numpy() -> None:
    rng = np.random.default_rng(0)
    u, v, m, t = rng.standard_normal((3, 8)), rng.standard_normal((3, 8)), rng.standard_normal((9, 8)), rng.uniform(0.5, 1.5, 8)
    out = np.full((83, 8), np.nan)
    formulas_of_eight_lanes(u.reshape(-1), v.reshape(-1), m.reshape(-1), t, out.reshape(-1))
    one = np.eye(3).reshape(9, 1)
    a, twice = m.reshape(3, 3, 8), 2.0 * m.reshape(3, 3, 8)
    twist = np.array([skew(x) for x in u.T]).transpose(1, 2, 0)
    expected = lanes((u * v).sum(axis=0), np.cross(u, v, axis=0), u[:, None] * v, m + t * one, a + twist, u + v, u - v, t * u,
                     2.5 * u, t * m, (t + 1.0) * t / (2.0 - t), 1.0 / t - 3.0 * t, u, np.concatenate((a, twice), axis=1))
    np.testing.assert_allclose(out[:len(expected)], expected, rtol=EXACT, atol=EXACT)
    np.testing.assert_allclose(out[[75, 77, 79]], u + v, rtol=EXACT, atol=EXACT)
    assert np.isnan(out[[76, 78, 80]]).all()
    assert np.array_equal(out[81:], np.repeat([[0.0], [7.0]], 8, axis=1))


def test_scalar_formulas_equal_numpy() -> None:
    rng = np.random.default_rng(1)
    u, v = rng.standard_normal((2, 3))
    out = np.zeros(37)
    formulas_of_one_lane(u, v, np.zeros(9), out)
    a = np.outer(u, v) + 2.0 * np.eye(3) + skew(v)
    expected = np.zeros(37)
    expected[:3], expected[3], expected[4:7], expected[7:16] = np.cross(u, v), u @ v, u, a.reshape(-1)
    expected[16:21:2] = u - 2.0 * v
    for i in range(3):
        expected[22 + i:22 + i + 9:4] = a[i]
    expected[34:] = 0.5 * u
    np.testing.assert_allclose(out, expected, rtol=EXACT, atol=EXACT)


@numba.njit
def scatter(source, offset, index, first, scale, shift, target):
    rows.scatter_rows(source, offset, index, first, scale, shift, target, SIX)


@numba.njit
def gather(source, index, first, scale, target, offset, size):
    rows.gather_lanes(source, index, first, scale, target, offset, size)


def test_scatter_adds_six_numbers_to_the_row_of_every_lane() -> None:
    rng = np.random.default_rng(2)
    source, target = rng.standard_normal(5 + 48), rng.standard_normal(16 * 12)
    index = np.array([99, 3, 11, 0, 3, 7, 7, 7, 2])  # rows that repeat collect all of their lanes
    expected = target.copy().reshape(12, 16)
    for lane, row in enumerate(index[1:]):
        expected[row, 8:14] += source[5:].reshape(6, 8)[:, lane]
    scatter(source, 5, index, 1, 16, 8, target)
    np.testing.assert_allclose(target.reshape(12, 16), expected, rtol=EXACT, atol=EXACT)


@pytest.mark.parametrize(("n", "scale"), [(12, 12), (4, 4), (18, 18), (6, 8), (3, 8), (3, 3), (2, 2), (1, 1)])
def test_gather_takes_one_row_per_lane(n: int, scale: int) -> None:
    rng = np.random.default_rng(3)
    # short rows are read as longer ones
    room = rng.standard_normal(10 * scale + 8)
    source = room[:-8].reshape(10, scale)
    index = np.array([99, 99, 4, 0, 9, 4, 2, 3, 1, 8])
    target = np.full(4 + 8 * n + 4, np.nan)
    gather(room, index, 2, scale, target, 4, (0,) * n)
    assert np.array_equal(target[4:-4].reshape(n, 8), source[index[2:], :n].T)
    assert np.isnan(target[:4]).all() and np.isnan(target[-4:]).all()


@numba.njit
def there_and_back(source, first, distance, lanes, target, size):
    rows.load_rows(source, first, distance, lanes, 8, size)
    rows.store_rows(lanes, 8, target, first, distance, size)


@pytest.mark.parametrize(("n", "distance"), [(12, 12), (4, 12), (3, 3)])
def test_rows_to_lanes_and_back(n: int, distance: int) -> None:
    source = np.random.default_rng(6).standard_normal(5 + 8 * distance)
    lanes, target = np.full(8 + 8 * n, np.nan), np.full_like(source, np.nan)
    there_and_back(source, 5, distance, lanes, target, (0,) * n)
    expected = source[5:].reshape(8, distance)[:, :n]
    assert np.array_equal(lanes[8:].reshape(n, 8), expected.T)
    assert np.array_equal(target[5:].reshape(8, distance)[:, :n], expected)
    assert np.isnan(target).sum() == target.size - 8 * n


# ------------------------------------------------------------------------------------------------------------ node loops
def random_triads(n: int, rng: np.random.Generator) -> Array:
    q = rng.standard_normal((n, 4, 3))
    q[:, 1:] = np.linalg.qr(q[:, 1:])[0]
    return q


def test_directors_turn_by_the_cayley_rotation() -> None:
    rng = np.random.default_rng(4)
    q = random_triads(5, rng)
    # tiny, small and large turns
    theta = rng.standard_normal((5, 3)) * np.array([0.0, 1e-9, 0.3, 2.0, 50.0])[:, None]
    mid, end, u = np.zeros((3, 5, 4, 3))
    # a step of size one from rest: u is twice the increment
    spread(q.reshape(-1), np.zeros(60), np.ones(15), theta.reshape(-1), 1.0, 0, 5, mid.reshape(-1), end.reshape(-1),
           u.reshape(-1))
    dq = 0.5 * u
    expected = np.einsum("nij,nkj->nki", np.array([cay(t) for t in theta]) - np.eye(3), q[:, 1:])
    assert (dq[:, 0] == 1.0).all()
    # directors that turn by half a turn change by 2, in sums of some ten terms, here and in the twin
    np.testing.assert_allclose(dq[:, 1:], expected, rtol=0.0, atol=5e-15)
    # without cancellation: a tiny turn is accurate relative to itself
    np.testing.assert_allclose(dq[1, 1:], np.cross(theta[1], q[1, 1:]), rtol=1e-8)
    assert np.array_equal(dq[0, 1:], np.zeros((3, 3)))


def test_prediction_moves_and_spins_on() -> None:
    rng = np.random.default_rng(5)
    q, h = random_triads(4, rng), 0.1
    velocity, omega = rng.standard_normal((2, 4, 3))
    v = np.concatenate((velocity[:, None], np.cross(omega[:, None], q[:, 1:])), axis=1)
    inert = np.array([0, 0, 1, 0], np.int8)
    theta, dphi = np.zeros((2, 4, 3))
    predict(q.reshape(-1), v.reshape(-1), h, np.nan, np.zeros(5 + 6 * len(q)), inert, 0, len(q), theta.reshape(-1),
            dphi.reshape(-1))
    expected = np.where(inert[:, None], 0.0, h * omega)
    np.testing.assert_allclose(theta, expected, rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(dphi, h * velocity, rtol=0.0, atol=EXACT)


@pytest.mark.parametrize(("first", "last"), [(0, 19), (2, 10), (1, 19), (3, 18), (7, 8)])
def test_spread_and_advance_are_the_midpoint_relations(first: int, last: int) -> None:
    rng = np.random.default_rng(6)
    n, h = 19, 0.2
    q = random_triads(n, rng)
    v, (dphi, theta) = rng.standard_normal((n, 4, 3)), 0.5 * rng.standard_normal((2, n, 3))
    dq = increments(q, dphi, theta)
    mid, end, u = np.full((3, n, 4, 3), np.nan)
    some = slice(first, last)
    spread(q.reshape(-1), v.reshape(-1), dphi.reshape(-1), theta.reshape(-1), h, first, last, mid.reshape(-1), end.reshape(-1),
           u.reshape(-1))
    np.testing.assert_allclose(mid[some], (q + 0.5 * dq)[some], rtol=0, atol=EXACT)
    np.testing.assert_allclose(end[some], (q + dq)[some], rtol=0, atol=EXACT)
    assert np.isnan(mid[:first]).all() and np.isnan(u[last:]).all()
    q1, v1, still = q.copy(), v.copy(), q.copy()
    advance(q1.reshape(-1), v1.reshape(-1), dphi.reshape(-1), theta.reshape(-1), h, first, last, np.zeros(NODES_SCRATCH))
    # D q = h vbar, and u = 2/h^2 (D q - h v) is D v / h
    np.testing.assert_allclose(q1[some], end[some], rtol=0, atol=EXACT)
    np.testing.assert_allclose((q1 - q)[some], 0.5 * h * (v + v1)[some], rtol=0, atol=5e-15)
    np.testing.assert_allclose(u[some], ((v1 - v) / h)[some], rtol=0, atol=1e-12)
    # in statics there are no velocities
    advance(still.reshape(-1), NO_VELOCITIES, dphi.reshape(-1), theta.reshape(-1), 0.0, first, last, np.zeros(NODES_SCRATCH))
    np.testing.assert_allclose(still, q1, rtol=0, atol=1e-15)
    for x, y in ((q1, q), (v1, v)):
        assert np.array_equal(x[:first], y[:first]) and np.array_equal(x[last:], y[last:])


def test_update_turns_the_end_triad_by_the_spin() -> None:
    rng = np.random.default_rng(7)
    n = 4
    theta = 0.5 * rng.standard_normal((n, 3))
    dphi = rng.standard_normal((n, 3))
    row_of = np.array([2, 0, 3, 1])
    eps = 1e-6
    change = rng.standard_normal((n, 6)) * np.repeat((1.0, eps), 3)
    rows = np.full((n, 8), np.nan)
    rows[row_of, :6] = change
    new_theta, new_dphi = theta.copy(), dphi.copy()
    move, spin = update_nodes(row_of, rows.reshape(-1), 0, n, new_theta.reshape(-1), new_dphi.reshape(-1),
                              np.zeros(NODES_SCRATCH))
    assert move == np.max(np.abs(change[:, :3]))
    assert spin == pytest.approx(np.max(np.linalg.norm(new_theta - theta, axis=1) / np.sqrt(1.0 + np.sum(theta**2, axis=1) / 4)))
    np.testing.assert_allclose(new_dphi, dphi + change[:, :3], rtol=0, atol=1e-15)
    for k in range(n):
        # to first order in the spin: cay(theta + d theta) = cay(spin) cay(theta)
        expected = cayley_vector(cay(change[k, 3:]) @ cay(theta[k]))
        np.testing.assert_allclose(new_theta[k] - theta[k], expected - theta[k], rtol=0, atol=20 * eps**2)


@pytest.mark.parametrize(("first", "last"), [(0, 19), (2, 10), (1, 19), (3, 18)])
def test_eight_nodes_at_a_time_are_updated_like_one(first: int, last: int) -> None:
    rng = np.random.default_rng(8)
    n = 19
    row_of = rng.permutation(n)
    rows = 0.1 * rng.standard_normal((n, 8))
    theta, dphi = 0.5 * rng.standard_normal((2, 3 * n))
    found, expected = [x.copy() for x in (theta, dphi)], [x.copy() for x in (theta, dphi)]
    sizes = update_nodes(row_of, rows.reshape(-1), first, last, *found, np.zeros(NODES_SCRATCH))
    each = [update_nodes(row_of, rows.reshape(-1), i, i + 1, *expected, np.zeros(NODES_SCRATCH)) for i in range(first, last)]
    for x, y in zip(found, expected):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(sizes, np.max(each, axis=0), rtol=1e-15)
    # nodes outside stay as they are
    for x, y in zip(found, (theta, dphi)):
        assert np.array_equal(x[:3 * first], y[:3 * first]) and np.array_equal(x[3 * last:], y[3 * last:])


@pytest.mark.parametrize(("first", "last"), [(0, 19), (2, 10), (1, 19), (3, 18)])
@pytest.mark.parametrize("size", [0.3, 0.0])
def test_first_guess_from_the_rates_of_two_steps(first: int, last: int, size: float) -> None:
    # size: of the step whose increments are the newest rates; with 0 the newest stand where the older do else
    rng = np.random.default_rng(9)
    n, h, c = 19, 0.2, 0.7 if size else 0.0
    theta, dphi = 0.5 * rng.standard_normal((2, n, 3))
    rates = rng.standard_normal((2, n, 3))
    past = np.concatenate(([2.0, 0.0, 0.0, size], rates.reshape(-1), [np.nan]))
    new_theta, new_dphi = theta.copy(), dphi.copy()
    predict(np.zeros(12 * n), np.full(12 * n, np.nan), h, c, past, np.zeros(n, np.int8), first, last, new_theta.reshape(-1),
            new_dphi.reshape(-1))
    newest = np.stack((dphi, theta)) / size if size else rates
    expected = h * (newest + c * (newest - rates))
    some = slice(first, last)
    kept = past[4:-1].reshape(2, n, 3)
    for k, (new, old) in enumerate(((new_dphi, dphi), (new_theta, theta))):
        np.testing.assert_allclose(new[some], expected[k, some], rtol=0, atol=3e-15)
        np.testing.assert_allclose(kept[k, some], newest[k, some], rtol=0, atol=3e-15)
        for x, y in ((new, old), (kept[k], rates[k])):
            assert np.array_equal(x[:first], y[:first]) and np.array_equal(x[last:], y[last:])


def test_a_scene_without_beams_has_room_for_eight_nodes() -> None:
    bodies = [RigidBody(f"b{k}", mass=1.0, inertia=np.eye(3), position=(k, 0, 0)) for k in range(9)]
    model = compile_scene(Scene(*bodies))
    assert scratch_of(model).size >= NODES_SCRATCH
    room = np.full(NODES_SCRATCH + 64, np.nan)
    advance(np.zeros(108), np.zeros(108), np.zeros(27), np.zeros(27), 1.0, 0, 9, room)
    assert not np.isnan(room[:NODES_SCRATCH]).any() and np.isnan(room[NODES_SCRATCH:]).all()


@pytest.mark.parametrize("node", [0, 1, 2, 9, 17])
@pytest.mark.parametrize("component", [0, 4])
def test_update_does_not_lose_nan(node: int, component: int) -> None:
    # NaN is the alarm of the Newton loop: a later finite node must not switch it off
    n = 18
    rows = np.ones((n, 8))
    rows[node, component] = np.nan
    move, spin = update_nodes(np.arange(n), rows.reshape(-1), 0, n, np.zeros(3 * n), np.zeros(3 * n), np.zeros(NODES_SCRATCH))
    assert np.isnan(move + spin)


@pytest.fixture(scope="module")
def tied() -> tuple[Model, Twin]:
    """Beams on bodies on ball joints: all three kinds of entries, offsets and turned triads."""
    rod = Beam.straight("rod", (0, 0, 0), (1, 0.5, 0), section=SECTION, elements=2, degree=2)
    tail = Beam.straight("tail", (3, 1, 0.2), (4, 1, 1), section=SECTION, elements=1, degree=1)
    body = RigidBody("body", mass=1.0, inertia=[[1, 0.1, 0.2], [0.1, 1.2, 0], [0.2, 0, 0.9]], position=(2, 1, 0))
    scene = Scene(rod, body, tail, BallJoint(rod.end, body.point((-1, -0.5, 0))), RigidConnection(body, tail.start))
    model = compile_scene(scene, eliminate_inner=False)
    return model, Twin(scene, model)


def test_tied_coordinates_follow_the_map_of_the_joints(tied: tuple[Model, Twin]) -> None:
    model, twin = tied
    x = np.random.default_rng(8).standard_normal((twin.n, 4, 3))
    found = x.reshape(-1).copy()
    tie_coordinates(model.ties, found)
    np.testing.assert_allclose(found.reshape(x.shape), twin.connected(x), rtol=0, atol=EXACT)
    arms = np.flatnonzero(model.ties.kind == 1)
    assert arms.size >= 2
    for e in arms:
        k = model.ties.target[e]
        offset = model.ties.offset[3 * e:3 * e + 3]
        np.testing.assert_allclose(arm_vector(model.ties, e, x.reshape(-1)), offset @ x[k, 1:], rtol=0, atol=EXACT)


def test_increments_of_tied_nodes_follow_those_of_their_targets(tied: tuple[Model, Twin]) -> None:
    model, twin = tied
    rng = np.random.default_rng(9)
    q = twin.q0.copy()
    dphi, theta = rng.standard_normal((2, twin.n, 3))
    new_dphi, new_theta, off = dphi.copy(), theta.copy(), np.zeros((twin.n, 3))
    tie_increments(model.ties, q.reshape(-1), new_theta.reshape(-1), new_dphi.reshape(-1), off.reshape(-1))
    expected = twin.connected(increments(q, dphi, theta))
    np.testing.assert_allclose(increments(q, new_dphi, new_theta), expected, rtol=0, atol=EXACT)
    # what the joints change of positions that had the increments of rows
    np.testing.assert_allclose(new_dphi - off, dphi, rtol=0, atol=EXACT)
    assert np.flatnonzero(off.any(axis=1)).tolist() == sorted(model.ties.slave.tolist())


@numba.njit
def arm_vector(ties, e, q):
    out = np.zeros(3)
    al.st3(out, 0, 1, tie_arm(ties, e, q))
    return out


def test_inertia_of_a_turning_body(tied: tuple[Model, Twin]) -> None:
    # sum d_i x (E u)_i with u = d/dt (omega x d) is the torque J alpha + omega x J omega
    model, _ = tied
    rng = np.random.default_rng(9)
    q = random_triads(model.n_nodes, rng)
    node = int(model.bodies.node[0])
    d = q[node, 1:] = np.linalg.det(q[node, 1:]) * q[node, 1:]
    omega, alpha, a = rng.standard_normal((3, 3))
    u = np.zeros_like(q)
    u[node, 0], u[node, 1:] = a, np.cross(alpha, d) + np.cross(omega, np.cross(omega, d))
    r, blocks = np.zeros((model.n_nodes + 1, 8)), np.zeros(48 * (model.n_blocks + 1))
    add_bodies(model.bodies, q.reshape(-1), q.reshape(-1), u.reshape(-1), 1.0, r.reshape(-1), blocks)
    inertia = d.T @ np.array([[1, 0.1, 0.2], [0.1, 1.2, 0], [0.2, 0, 0.9]]) @ d
    row = model.bodies.row[0]
    np.testing.assert_allclose(r[row, :3], a, rtol=0, atol=EXACT)
    np.testing.assert_allclose(r[row, 3:6], inertia @ alpha + np.cross(omega, inertia @ omega), rtol=0, atol=1e-13)
    assert not np.any(np.delete(r, row, axis=0))


# -------------------------------------------------------------------------------------------------------- element groups
class Elements:
    """Tables of one beam taken apart into elements, to be packed again in any grouping."""

    def __init__(self, model: Model) -> None:
        t = model.simo if model.simo is not None else model.green
        # reference strains behind the constants, in one array
        t = t._replace(meta=t.meta + t.tab.size * (np.arange(8) == 7), tab=np.concatenate((t.tab, model.reference_strains)))
        self.model, self.tables = model, t
        self.strains = SIMO_REISSNER if model.green is None else GREEN_LAGRANGE
        self.nn, self.nq, self.coupled = int(t.meta[0, 0]), int(t.meta[0, 1]), int(t.meta[0, 5])
        self.layout = layout_of(SPACE, self.nn, self.nq)
        assert len(np.unique(t.meta[:, [0, 1, 5]], axis=0)) == 1
        groups = len(t.meta)

        def per_lane(x: Array) -> Array:
            return x.reshape(groups, -1, 8).transpose(0, 2, 1).reshape(8 * groups, -1)

        # constants, reference strains, nodes, rows, blocks
        own = [t.tab[t.meta[:, k, None] + np.arange(n)] for k, n in ((2, self.layout.table_size), (7, 48 * self.nq))]
        self.parts = [per_lane(x) for x in (*own, *t[2:])]
        self.count = int(np.sum(self.parts[3][:, 0] < model.n_nodes))

    def pack(self, groups: list[list[int]], idle: str = "repeat") -> ElementTables:
        """Tables for groups of up to 8 elements; idle lanes repeat an element or hold NaN."""
        nothing = [None, None, None, self.model.n_nodes, self.model.n_blocks]
        # where a part goes: constants and strains into one array
        to = [0, 0, 1, 2, 3]
        arrays: list[list[Array]] = [[], [], [], []]
        meta = []
        for group in groups:
            at = [sum(x.size for x in arrays[k]) for k in (0, 1, 3)]
            meta.append([self.nn, self.nq, *at, self.coupled, -1, at[0] + 8 * self.parts[0].shape[1]])
            for k, (part, behind) in enumerate(zip(self.parts, nothing)):
                full = np.repeat(part[group[-1:]], 8, axis=0)
                full[:len(group)] = part[group]
                if behind is not None:
                    full[len(group):] = behind
                elif idle == "nan" and k < 2:
                    full[len(group):] = np.nan
                arrays[to[k]].append(full.T.reshape(-1))
        return ElementTables(np.array(meta, np.int64), *(np.ascontiguousarray(np.concatenate(x)) for x in arrays))

    def assemble(self, tables: ElementTables, velocities: bool = True) -> tuple[Array, Array]:
        """Residual rows and blocks at a fixed random state near the reference, without what idle lanes write to."""
        q, moves, v = np.random.default_rng(10).standard_normal((3, 12 * self.model.n_nodes))
        q = self.model.q0 + 0.02 * q
        dphi, theta = np.split(0.02 * moves, 4)[:2]
        line = LastIncrement(np.zeros(3), theta, v, NoTies())
        # rates (dq - 2 v)/2
        return self.at(OverStep(Conserving(), q, dphi, v if velocities else np.zeros_like(v), line, tables.tab, 2.0, 800.0),
                       tables)

    def at(self, motion: OverStep | Still, tables: ElementTables) -> tuple[Array, Array]:
        """Residual rows and blocks."""
        r, blocks = np.zeros((self.model.n_nodes + 1, 8)), np.zeros((self.model.n_blocks + 1, 48))
        element_groups(tables, 0, len(tables.meta), NoInner(), self.strains, motion, r.reshape(-1), blocks.reshape(-1),
                       np.full(self.layout.doubles, np.nan), SPACE)
        return r[:-1], blocks[:-1]


def bar(elements: int, strain: str = "simo_reissner", **kw: object) -> Elements:
    beam = Beam.helix("b", radius=1.0, pitch=0.5, turns=0.6, section=SECTION, elements=elements, strain=strain, **kw)
    return Elements(compile_scene(Scene(beam), eliminate_inner=False))


GROUPINGS = {"as packed": None, "one by one": [[e] for e in range(11)], "backwards": [list(range(10, 2, -1)), [2, 1, 0]],
             "mixed": [[0, 5, 10], [1, 2], [3, 4, 6, 7, 8, 9]]}


@pytest.mark.parametrize("idle", ["repeat", "nan"])
@pytest.mark.parametrize("grouping", GROUPINGS)
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_any_grouping_of_elements_gives_the_same(strain: str, grouping: str, idle: str) -> None:
    elements = bar(11, strain, degree=2)
    assert elements.count == 11
    reference = elements.assemble(elements.tables)
    found = elements.assemble(elements.pack(GROUPINGS[grouping] or [list(range(8)), [8, 9, 10]], idle))
    for x, y in zip(found, reference):
        assert np.max(np.abs(y)) > 1.0
        assert np.max(np.abs(x - y)) < 1e-13 * np.max(np.abs(y))  # the order of sums differs


@pytest.mark.parametrize("elements", [1, 5, 8, 9, 16])
def test_idle_lanes_add_nothing(elements: int) -> None:
    one = bar(elements, degree=1)
    assert one.count == elements
    assert len(one.tables.meta) == -(-elements // 8)
    found, single = one.assemble(one.tables), one.assemble(one.pack([[e] for e in range(elements)], "nan"))
    for x, y in zip(found, single):
        assert np.max(np.abs(x - y)) < 1e-13 * np.max(np.abs(y))


def test_forces_of_inertia_are_the_mass_times_second_rates() -> None:
    elements = bar(3, degree=3)
    tables = elements.tables
    rng = np.random.default_rng(10)
    _, _, v = rng.standard_normal((3, 12 * elements.model.n_nodes))
    resting, moving = elements.assemble(tables, velocities=False), elements.assemble(tables)
    # second rates differ by -v, the position rows by the mass times that
    shift = np.zeros((elements.model.n_nodes, 3))
    basis = Beam.helix("b", radius=1.0, pitch=0.5, turns=0.6, section=SECTION, elements=3, degree=3).basis
    for e, nodes in enumerate(basis.element_nodes):
        shift[nodes] -= SECTION.rhoA * basis.mass_phi[e] @ v.reshape(-1, 12)[nodes, :3]
    row_of = elements.model.pattern.row_of
    np.testing.assert_allclose((moving[0] - resting[0])[row_of, :3], shift, rtol=0, atol=1e-11)
    assert not np.any(resting[0][:, 6:])


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_tangent_with_the_stresses_of_a_straight_line(strain: str, moving: bool) -> None:
    # one element: forces of stresses that follow from a straight line, by central differences; theory.md (4.6)
    rng = np.random.default_rng(11)
    beam = Beam.helix("b", radius=1.0, pitch=0.5, turns=0.1, section=SECTION, elements=1, degree=2, strain=strain)
    elements = Elements(compile_scene(Scene(beam), eliminate_inner=False))
    n = beam.n_nodes
    nodes, reference = beam.basis.element_nodes, elements.model.q0.reshape(n, 4, 3)
    # no point may be compressed to nothing: the element is 0.6 m long
    start = reference + 0.05 * rng.standard_normal((n, 4, 3))
    shift, move, spin, before = np.array([0.03, 0.08, 0.4, 0.2])[:, None, None] * rng.standard_normal((4, n, 3))
    if not moving:
        shift, before = np.zeros((2, n, 3))
    # a Newton iteration adds this to the Cayley vectors of a step
    theta = before + spin - 0.5 * np.cross(before, spin) + 0.25 * np.sum(before * spin, axis=1, keepdims=True) * before
    last, end = start + increments(start, shift, before), start + increments(start, shift + move, theta)
    change = np.concatenate((move[:, None], np.cross(spin[:, None], last[:, 1:])), axis=1)
    mid = 0.5 * (start + end) if moving else end

    def strain_of(q: Array) -> Array:
        return beam_strains(beam, q[nodes]) - beam_strains(beam, reference[nodes])

    def slope_of(q: Array, x: Array) -> Array:
        """Derivative of the strains along x: exact for the quadratic forms, by complex numbers for what they are made into."""
        forms = beam_forms(beam, q[nodes])
        along = np.einsum("xegi,x->egi", form_matrix(beam, q[nodes]), x[nodes].reshape(-1))
        return strains_of(strain, forms + 1e-30j * along).imag / 1e-30

    slope = slope_of(last, change)
    # (E(start) + E(end))/2 from mid and end as the kernel forms it, with the end on the line; at rest the start moves, too
    now = 0.5 * (strain_of(2.0 * mid - end) + strain_of(end)) if moving else strain_of(end)
    on_line = now + (0.5 if moving else 1.0) * (strain_of(last) + slope - strain_of(end))

    def rows(x: Array) -> Array:
        moved = np.concatenate((x[:, None, :3], np.cross(x[:, None, 3:], end[:, 1:])), axis=1)
        at = mid + 0.5 * moved
        stress = (on_line + 0.5 * slope_of(end, moved)) @ SECTION.C
        both = beam_forms(beam, (2.0 * mid - end)[nodes]), beam_forms(beam, (end + moved)[nodes])
        s = stresses_of_forms(strain, stress, both)
        f = np.einsum("xegi,egi,eg->x", form_matrix(beam, at[nodes]), s, beam.basis.weight).reshape(n, 4, 3)
        return project(at, f)

    expected = np.zeros((6 * n, 6 * n))
    for k in range(6 * n):
        x = np.zeros(6 * n)
        x[k] = 1e-5
        expected[:, k] = (rows(x.reshape(n, 6)) - rows(-x.reshape(n, 6))).reshape(-1) / 2e-5
    row_of, pattern = elements.model.pattern.row_of, elements.model.pattern
    # rows of three are read as rows of four
    dphi = np.append(shift + move, 0.0)[:-1]
    x = np.zeros((n + 1, 8))
    x[row_of, :3], x[row_of, 3:6] = move, spin
    line = LastIncrement(np.array([1.0, 0.0, -1.0]), np.append(theta, 0.0)[:-1], x.reshape(-1), NoTies())

    def dense(line: LastIncrement) -> Array:
        motion: OverStep | Still = Still(Equilibrium(), end.reshape(-1), line, elements.tables.tab, 0.0)
        if moving:
            # with the rates of the increment there are no second rates
            motion = OverStep(Conserving(), start.reshape(-1), dphi, (end - start).reshape(-1), line, elements.tables.tab, 1.0,
                              0.0)
        r, blocks = elements.at(motion, elements.tables)
        out = np.zeros((n, 6, n, 6))
        for block, i, j in zip(blocks.reshape(-1, 6, 8), pattern.rows, pattern.columns):
            out[i, :, j] = block[:, :6]
        found = out[row_of][:, :, row_of].reshape(6 * n, 6 * n)
        f = internal_forces(beam, reference, 2.0 * mid - end, end)
        np.testing.assert_allclose(r[row_of, :6], project(mid, f), rtol=0, atol=1e-12 * np.max(np.abs(f)))
        return found

    mixed, plain = dense(line), dense(line._replace(control=np.zeros(3)))
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(mixed, expected, rtol=0, atol=1e-8 * scale)
    assert np.max(np.abs(mixed - plain)) > 1e-2 * scale


# --------------------------------------------------------------------------------------------------------------- contact
@pytest.mark.parametrize("n", [2, 3, 10])
def test_legendre_polynomials_and_derivatives(n: int) -> None:
    table = np.full((3, n), np.nan)
    for xi in (-1.0, -0.3, 0.0, 0.8, 1.0):
        legendre(xi, n, table)
        for k in range(n):
            one = np.eye(n)[k]
            expected = [np_legendre.legval(xi, np_legendre.legder(one, m)) for m in range(3)]
            np.testing.assert_allclose(table[:, k], expected, rtol=1e-13, atol=1e-13)


ENDS = np.array([0.0, 0.5, 0.8, 1.6, 2.0, 2.9, 3.0])
CURVES = {"lagrange1": ("own", {"degree": 1}), "lagrange3": ("own", {"degree": 3}), "lagrange3 c1": ("c1", {"degree": 3}),
          "lagrange2 c1": ("c1", {"degree": 2}), "bspline3": ("own", {"interpolation": "bspline", "degree": 3})}


NO_SLEEVES = np.zeros((0, 2), np.int64), np.zeros((0, 2, 8)), np.full(1, 2**30)


class Rail:
    """Curve tables of one beam with unequal elements."""

    def __init__(self, name: str) -> None:
        kind, family = CURVES[name]
        self.beam = Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=SECTION, elements=ENDS, **family)
        self.curve = self.beam.basis.curve(kind)
        # a second curve in front: offsets must count
        other = Beam.straight("other", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2, degree=4)
        self.curves: Curves = pack_curves([Track(50 + np.arange(other.n_nodes), other.basis.curve("own"), other.basis.node_s),
                                             Track(7 + np.arange(self.beam.n_nodes), self.curve, self.beam.basis.node_s)])
        n = max(self.beam.n_nodes, other.n_nodes)
        none, empty = np.zeros(1, np.int64), np.zeros((1, 48))
        self.contact = Contact(np.full((5, n), np.nan), np.zeros((3, int(self.curves.shape[:, 1].max()))), none,
                               np.zeros((1, 1), np.int64), empty, empty, np.zeros((1, 64)), np.zeros((1, 8)), none, none, none,
                               none, np.zeros(1), np.ones(1), np.zeros(1), np.zeros(1, np.int64), np.zeros(4), *NO_SLEEVES)

    def rows(self, s0: float, s1: float) -> Array:
        """All five rows of shape functions [5, n_nodes] for a step from s0 to s1."""
        c = self.curves
        e0, e1 = find_element(c, 1, s0, 3), find_element(c, 1, s1, 0)
        p = c.meta[1, 3]
        last = p + max(e0, e1)
        lo, hi = c.first[p + min(e0, e1)], c.first[last] + c.count[last]
        out = np.zeros((5, self.beam.n_nodes))
        step_basis(c, 1, s0, s1, e0, e1, lo, hi, self.contact)
        out[:, lo:hi] = self.contact.basis[:, lo:hi]
        return out

    def shape(self, s: float) -> tuple[Array, Array]:
        """N and N' of all nodes by the tables of the basis."""
        first, values, slopes = self.curve.evaluate(s)
        out = np.zeros((2, self.beam.n_nodes + values.shape[1]))
        out[:, first[0]:first[0] + values.shape[1]] = values[0], slopes[0]
        return out[0, :self.beam.n_nodes], out[1, :self.beam.n_nodes]


@pytest.fixture(params=CURVES)
def rail(request: pytest.FixtureRequest) -> Rail:
    return Rail(request.param)


# inside one element, over one end, over several, from end to end; both directions are run
PATHS = [(0.55, 0.75), (0.45, 0.55), (0.1, 1.9), (0.2, 2.95), (0.0, 3.0), (0.5, 1.6), (0.3, 0.5)]


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("path", PATHS)
def test_large_steps_take_the_divided_difference(rail: Rail, path: tuple[float, float], direction: int) -> None:
    s0, s1 = path[::direction]
    rows = rail.rows(s0, s1)
    (n0, _), (n1, n1_s) = rail.shape(s0), rail.shape(s1)
    np.testing.assert_allclose(rows[0], n0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(rows[1], n1, rtol=0, atol=EXACT)
    np.testing.assert_allclose(rows[2], n1_s, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows[3], (n1 - n0) / (s1 - s0), rtol=0, atol=1e-12)
    # partition of unity and linear precision
    assert rows[0].sum() == pytest.approx(1.0, abs=EXACT)
    assert abs(rows[3].sum()) < 1e-12
    assert abs(rows[3] @ rail.beam.node_s - 1.0) < 1e-12
    eps = 1e-6
    if min(s1 - 0.0, 3.0 - s1, np.min(np.abs(ENDS - s1))) > eps:
        change = (rail.rows(s0, s1 + eps)[3] - rail.rows(s0, s1 - eps)[3]) / (2.0 * eps)
        np.testing.assert_allclose(rows[4], change, rtol=0, atol=1e-7 * (1.0 + np.max(np.abs(change))))


@pytest.mark.parametrize("step", [0.0, 1e-15, -1e-12, 1e-9, -1e-7])
@pytest.mark.parametrize("s", [0.3, 0.65, 2.95])
def test_tiny_steps_take_the_derivative(rail: Rail, s: float, step: float) -> None:
    rows = rail.rows(s, s + step)
    eps = 1e-6
    second = (rail.shape(s + eps)[1] - rail.shape(s - eps)[1]) / (2.0 * eps)
    curvature = np.max(np.abs(second)) + 100.0
    np.testing.assert_allclose(rows[3], rail.shape(s)[1], rtol=0, atol=(abs(step) + 1e-13) * curvature)
    # half the second derivative; N''' of these elements is below 1e5
    np.testing.assert_allclose(rows[4], 0.5 * second, rtol=0, atol=1e5 * (abs(step) + 1e-9))


@pytest.mark.parametrize("step", [2e-15, 1e-12, 1e-8])
@pytest.mark.parametrize("end", [0.5, 1.6, 2.9])
@pytest.mark.parametrize("direction", [1, -1])
def test_tiny_steps_over_an_end_mix_both_slopes(rail: Rail, end: float, step: float, direction: int) -> None:
    # three parts before the end, one behind
    s0, s1 = end - 3.0 * step, end + step
    share = (end - s0) / (s1 - s0)
    left, right = rail.shape(s0)[1], rail.shape(s1)[1]
    expected = share * left + (1.0 - share) * right
    found = rail.rows(*(s0, s1)[::direction])
    np.testing.assert_allclose(found[3], expected, rtol=0, atol=1e-10 + 1e4 * step)
    assert np.isfinite(found).all()


def test_elements_are_found_from_any_hint(rail: Rail) -> None:
    for s, expected in ((-0.1, 0), (0.0, 0), (0.2, 0), (0.5, 1), (0.79, 1), (2.95, 5), (3.0, 5), (3.1, 5)):
        assert {find_element(rail.curves, 1, s, hint) for hint in (-5, 0, 2, 5, 99)} == {expected}


@numba.njit
def curve_point(curves, s, q, element, contact, derivative):
    out = np.zeros(3)
    al.st3(out, 0, 1, point_on_curve(curves, 1, s, q, element, contact, derivative, SPACE))
    return out


def test_points_and_tangents_of_a_curve() -> None:
    rail = Rail("lagrange3 c1")
    q = np.random.default_rng(11).standard_normal((7 + rail.beam.n_nodes, 4, 3))
    for s, e in ((0.2, 0), (1.0, 2), (2.95, 5)):
        values, slopes = rail.shape(s)
        for derivative, shape in ((0, values), (1, slopes)):
            np.testing.assert_allclose(curve_point(rail.curves, s, q.reshape(-1), e, rail.contact, derivative), shape @ q[7:, 0],
                                       rtol=1e-12, atol=1e-12)
