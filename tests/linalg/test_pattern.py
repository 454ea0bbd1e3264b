"""Order of elimination, fill and its limits."""
from __future__ import annotations

import numpy as np
import pytest

from fastbeam.compile.compile import compile_scene
from fastbeam.interface.errors import SceneError
from fastbeam.linalg.pattern import build_pattern
from fastbeam.scene import BallJoint, Beam, RigidConnection, Scene, Section, Slider

Array = np.ndarray
SECTION = Section(EA=200.0, GA2=150.0, GA3=130.0, GJ=50.0, EI2=60.0, EI3=70.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)


def chain(n: int) -> Array:
    return np.stack((np.arange(n - 1), np.arange(1, n)), axis=1)


def grid(m: int) -> Array:
    k = np.arange(m * m).reshape(m, m)
    neighbours = ((k[:, :-1], k[:, 1:]), (k[:-1], k[1:]))
    return np.concatenate([np.stack((a.reshape(-1), b.reshape(-1)), axis=1) for a, b in neighbours])


def random_pairs(n: int, m: int, seed: int) -> Array:
    return np.random.default_rng(seed).integers(0, n, (m, 2))


def filled(n: int, row_of: Array, pairs: Array) -> Array:
    """Non-zero blocks [n, n] of the LU factors, by rows, from elimination on a matrix of booleans."""
    a = np.eye(n, dtype=bool)
    a[row_of[pairs[:, 0]], row_of[pairs[:, 1]]] = a[row_of[pairs[:, 1]], row_of[pairs[:, 0]]] = True
    for k in range(n):
        behind = k + 1 + np.flatnonzero(a[k + 1:, k])
        a[np.ix_(behind, behind)] = True
    return a


CASES = {"chain": (12, chain(12)), "net": (36, grid(6)), "sparse": (20, random_pairs(20, 25, 1)),
         "dense": (9, random_pairs(9, 60, 2)), "no pairs": (5, np.zeros((0, 2), np.int64)),
         "repeats and diagonals": (4, np.array([(0, 1), (1, 0), (2, 2), (0, 1), (3, 1)]))}


@pytest.mark.parametrize("name", CASES)
def test_plan_holds_exactly_the_fill_of_its_order(name: str) -> None:
    n, pairs = CASES[name]
    p = build_pattern(n, pairs, 1)
    assert sorted(p.row_of) == list(range(n))
    assert p.n == n
    expected = filled(n, p.row_of, pairs)
    assert np.array_equal(p.keys, np.flatnonzero(expected))
    assert np.array_equal(p.rows * n + p.columns, p.keys)
    plan = p.plan
    assert plan is not None
    assert np.array_equal(p.keys[plan.diagonal], np.arange(n) * (n + 1))
    for i in range(n):
        k = slice(plan.start[i], plan.start[i + 1])
        columns = plan.column[k]
        assert np.array_equal(columns, i + 1 + np.flatnonzero(expected[i, i + 1:]))
        assert np.array_equal(p.keys[plan.upper[k]], i * n + columns)
        assert np.array_equal(p.keys[plan.lower[k]], columns * n + i)
        targets = plan.target[plan.target_start[i]:plan.target_start[i] + columns.size**2]
        assert np.array_equal(p.keys[targets], (columns[:, None] * n + columns).reshape(-1))


@pytest.mark.parametrize("allow", [True, False])
def test_block_finds_every_coupled_pair(allow: bool) -> None:
    pairs = random_pairs(15, 20, 3)
    p = build_pattern(15, pairs, 1, allow_elimination=allow)
    for a, b in [*pairs, *pairs[:, ::-1], *np.repeat(np.arange(15), 2).reshape(-1, 2)]:
        k = p.block(a, b)
        assert (p.rows[k], p.columns[k]) == (p.row_of[a], p.row_of[b])


def test_a_chain_is_eliminated_from_both_ends_and_has_no_fill() -> None:
    p = build_pattern(1000, chain(1000), 1)
    assert p.plan is not None
    assert np.array_equal(np.argsort(p.row_of)[:4], [0, 999, 1, 998])
    assert np.array_equal(np.argsort(p.row_of)[-2:], [499, 500])
    assert p.keys.size == 1000 + 2 * 999


def test_a_chain_in_bad_order_is_sorted() -> None:
    shuffled = np.random.default_rng(4).permutation(1000)
    p = build_pattern(1000, shuffled[chain(1000)], 1)
    assert p.plan is not None
    assert p.keys.size == 1000 + 2 * 999


def test_cubic_elements_keep_their_order() -> None:
    pairs = np.array([(3 * e + a, 3 * e + b) for e in range(100) for a in range(4) for b in range(a)])
    p = build_pattern(301, pairs, 3)
    assert np.array_equal(p.row_of, np.arange(301))
    assert p.keys.size == 301 + 2 * len(pairs)


def test_a_star_eliminates_its_tips_first() -> None:
    # in natural order the centre would couple all tips: n^2 blocks
    n = 200
    p = build_pattern(n, np.stack((np.zeros(n - 1, int), np.arange(1, n)), axis=1), 1)
    assert p.plan is not None
    assert p.keys.size == n + 2 * (n - 1)
    assert p.row_of[0] >= n - 2


def test_two_chains_stay_apart() -> None:
    pairs = np.concatenate((chain(300), 300 + chain(300)))
    p = build_pattern(600, pairs, 1)
    assert p.keys.size == 600 + 4 * 299


def test_a_closed_loop_costs_one_border() -> None:
    p = build_pattern(1000, np.concatenate((chain(1000), [[999, 0]])), 1)
    assert p.plan is not None
    assert p.keys.size <= 1000 + 2 * 999 + 2 * 1000


def test_a_net_is_left_to_the_sparse_solver() -> None:
    m = 60
    p = build_pattern(m * m, grid(m), 1)
    assert p.plan is None
    # no fill then, and nothing moved
    assert np.array_equal(p.row_of, np.arange(m * m))
    assert p.keys.size == m * m + 2 * len(grid(m))
    assert build_pattern(25, grid(5), 1).plan is not None


def test_many_joints_are_worth_more_fill() -> None:
    """A sparse solver leaves them to a dense border."""
    assert build_pattern(900, grid(30), 1).plan is None
    assert build_pattern(900, grid(30), 1, joints=1740).plan is not None


def test_elimination_can_be_switched_off() -> None:
    p = build_pattern(20, chain(20), 1, allow_elimination=False)
    assert p.plan is None
    assert np.array_equal(p.keys, np.sort([i * 20 + j for i in range(20) for j in (i - 1, i, i + 1) if 0 <= j < 20]))


# ---------------------------------------------------------------------------------------------------------------- scenes
def net(m: int) -> Scene:
    """m beams along x and m along y, joined rigidly at all m x m crossings."""
    scene, x = Scene(), float(m - 1)
    along = [Beam.straight(f"x{k}", (0, k, 0), (x, k, 0), section=SECTION, elements=m - 1, degree=1) for k in range(m)]
    across = [Beam.straight(f"y{k}", (k, 0, 0), (k, x, 0), section=SECTION, elements=m - 1, degree=1) for k in range(m)]
    scene.add(*along, *across)
    return scene.add(*(RigidConnection(a.node(j), b.node(i)) for i, a in enumerate(along) for j, b in enumerate(across)))


def test_the_solver_of_a_scene_follows_its_fill() -> None:
    rod = Scene(Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, elements=50, degree=2))
    assert compile_scene(rod).solver == "chain"
    assert compile_scene(rod, solver="chain").solver == "chain"
    assert compile_scene(rod, solver="sparse").solver == "sparse"
    assert compile_scene(net(3)).solver == "chain"


def test_a_net_of_beams_refuses_the_chain_solver() -> None:
    scene = net(55)
    assert compile_scene(scene).solver == "sparse"
    with pytest.raises(SceneError, match="solver='chain' cannot solve this scene efficiently, because it is a net and its matrix "
                                         "would fill; use solver='auto'"):
        compile_scene(scene, solver="chain")


def test_an_unknown_solver_is_refused() -> None:
    rod = Scene(Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, elements=1))
    with pytest.raises(SceneError, match="solver: 'pardiso' does not exist: choose 'auto', 'chain' or 'sparse'"):
        compile_scene(rod, solver="pardiso")


def test_sliders_and_joints_do_not_couple_beams_in_the_matrix() -> None:
    # a slider is a border, a ball joint moves the tied node's blocks to its target
    a = Beam.straight("a", (0, 0, 0), (3, 0, 0), section=SECTION, elements=6, degree=2)
    b = Beam.straight("b", (1, 0, 0), (1, 2, 0), section=SECTION, elements=6, degree=2)
    c = Beam.straight("c", (3, 0, 0), (3, 2, 0), section=SECTION, elements=6, degree=2)
    model = compile_scene(Scene(a, b, c, Slider("s", b.start, a, at=1.0), BallJoint(a.end, c.start)))
    p = model.pattern
    node_of = np.argsort(p.row_of)
    beam = np.repeat([0, 1, 2], 13)
    i, j = node_of[p.rows], node_of[p.columns]
    assert not np.any((beam[i] == 0) & (beam[j] == 1))
    assert np.any((beam[i] == 0) & (beam[j] == 2))
    assert model.solver == "chain"
