"""Block elimination and the borders of sliders against dense linear algebra."""
from __future__ import annotations

import numba
import numpy as np
import pytest

from fastbeam.kernels.algebra.blocks import SIX, THREE, lu_rows, lu_two
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.nodes import Held, clear_held
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.linalg.border import fill_panel, solve_border, solve_dense
from fastbeam.kernels.linalg.chain import HIGH, LOW, NoSide, OneSide, RightSides, back_substitute, factor, multiply, solve
from fastbeam.linalg.pattern import Pattern, build_pattern

Array = np.ndarray
BORDER = 7  # unknowns of a slider: force, position, mean gap
ACCURATE = 1e-11  # of the solution: matrices below have condition numbers under 1e4


def chain(n: int, first: int = 0) -> list[tuple[int, int]]:
    return [(first + i, first + i + 1) for i in range(n - 1)]


def cubic_elements(n: int) -> list[tuple[int, int]]:
    # all pairs within elements of four nodes that share their ends
    return [(3 * e + a, 3 * e + b) for e in range(n) for a in range(4) for b in range(a)]


# nodes, coupled pairs, couplings to one side
PATTERNS = {
    "one node": (1, [], 1),
    "chain": (9, chain(9), 1),
    "chain in shuffled numbers": (9, [(4, 7), (7, 0), (0, 2), (2, 8), (8, 1), (1, 5), (5, 3), (3, 6)], 1),
    "cubic elements": (13, cubic_elements(4), 3),
    "tree": (11, [(0, 1), (1, 2), (1, 3), (3, 4), (3, 5), (5, 6), (0, 7), (7, 8), (7, 9), (9, 10)], 1),
    "star": (8, [(0, k) for k in range(1, 8)], 1),
    "two chains": (11, chain(5) + chain(6, 5), 1),
    "closed loop": (8, chain(8) + [(7, 0)], 1),
    "ladder": (10, chain(5) + chain(5, 5) + [(k, k + 5) for k in range(5)], 1),
}


def pattern_of(name: str) -> Pattern:
    n, pairs, band = PATTERNS[name]
    pattern = build_pattern(n, np.array(pairs, np.int64).reshape(-1, 2), band)
    assert pattern.plan is not None
    return pattern


def random_blocks(pattern: Pattern, name: str, rng: np.random.Generator, pivoting: bool = False, k: int = 6) -> Array:
    """Blocks [n_blocks, k, 8] with numbers where nodes are coupled and zeros where elimination fills in."""
    n, pairs, _ = PATTERNS[name]
    blocks = np.zeros((pattern.keys.size, k, 8))
    for a, b in [*pairs, *((b, a) for a, b in pairs)]:
        blocks[pattern.block(a, b), :, :k] = rng.standard_normal((k, k))
    for a in range(n):
        own = rng.standard_normal((k, k))
        if pivoting:
            # large entries only where no pivot stands: without row exchanges the first pivot is zero
            own = 12.0 * np.roll(np.eye(k), 1 + a % (k - 2), axis=0) + 0.1 * own
            own[0, 0] = 0.0
        else:
            own += 12.0 * np.eye(k)
        blocks[pattern.block(a, a), :, :k] = own
    # the padding must not matter
    blocks[:, :, k:] = rng.standard_normal((len(blocks), k, 8 - k))
    return blocks


def dense(pattern: Pattern, blocks: Array) -> Array:
    n, k = pattern.n, blocks.shape[1]
    a = np.zeros((n, k, n, k))
    a[pattern.rows, :, pattern.columns, :] = blocks[:, :, :k]
    return a.reshape(k * n, k * n)


@pytest.mark.parametrize("size", [SIX, THREE], ids=["space", "plane"])
@pytest.mark.parametrize("width", [None, 8, 16])
@pytest.mark.parametrize("pivoting", [False, True], ids=["plain", "pivoting"])
@pytest.mark.parametrize("name", PATTERNS)
def test_elimination_solves_the_system(name: str, pivoting: bool, width: int | None, size: tuple[int, ...]) -> None:
    pattern = pattern_of(name)
    k = len(size)
    rng = np.random.default_rng(1)
    blocks = random_blocks(pattern, name, rng, pivoting, k)
    if width is None:
        # a single right-hand side takes the first column of the padding
        blocks[:, :, k] = 0.0
    right = rng.standard_normal((k * pattern.n, width or 1))
    expected = np.linalg.solve(dense(pattern, blocks), right)
    panel = right.reshape(-1).copy()
    blocks = blocks.reshape(-1)
    pivots = np.zeros(k * pattern.n, np.int64)
    sides = OneSide(panel) if width is None else RightSides(panel, width)
    worst = factor(pattern.plan, blocks, pivots, sides, size)
    back_substitute(pattern.plan, blocks, sides, size)
    assert 1e-4 < worst <= 1.0
    assert np.max(np.abs(panel.reshape(-1, width or 1) - expected)) < ACCURATE * np.max(np.abs(expected))
    # rows change their places where they have to, and only there
    assert np.all((pivots.reshape(-1, k)[:, 0] > 0) == pivoting)


@numba.njit
def two_blocks(blocks: Array, size: tuple[int, ...]) -> bool:
    return lu_two(blocks, 0, 48, LOW, HIGH, size)


@numba.njit
def one_block(blocks: Array, at: int, size: tuple[int, ...]) -> bool:
    return lu_rows(blocks, at, LOW, HIGH, size)


@pytest.mark.parametrize("zero", [None, 0, 1])
@pytest.mark.parametrize("size", [SIX, THREE], ids=["space", "plane"])
def test_two_blocks_are_factored_like_one(size: tuple[int, ...], zero: int | None) -> None:
    rng = np.random.default_rng(5)
    blocks = np.zeros((2, 6, 8))
    blocks[:, :6, :6] = rng.standard_normal((2, 6, 6)) + 10.0 * np.eye(6)
    if zero is not None:
        # needs exchanges: neither may change
        blocks[zero, 1, 1] = 0.0
        blocks[zero, 0, 1] = 0.0
    found, expected = blocks.reshape(-1).copy(), blocks.reshape(-1).copy()
    assert two_blocks(found, size) == (zero is None)
    if zero is None:
        assert one_block(expected, 0, size) and one_block(expected, 48, size)
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-16)
    else:
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("pivoting", [False, True], ids=["plain", "pivoting"])
@pytest.mark.parametrize("size", [SIX, THREE], ids=["space", "plane"])
def test_factors_serve_several_right_hand_sides(size: tuple[int, ...], pivoting: bool) -> None:
    pattern = pattern_of("tree")
    k = len(size)
    rng = np.random.default_rng(2)
    blocks = random_blocks(pattern, "tree", rng, pivoting, k)
    a = dense(pattern, blocks)
    blocks, pivots = blocks.reshape(-1), np.zeros(k * pattern.n, np.int64)
    factor(pattern.plan, blocks, pivots, NoSide(), size)
    factors = blocks.copy()
    for _ in range(2):
        x = rng.standard_normal((k * pattern.n, 8))
        panel = (a @ x).reshape(-1)
        solve(pattern.plan, blocks, pivots, panel, 8, size)
        assert np.max(np.abs(panel.reshape(-1, 8) - x)) < ACCURATE
    assert np.array_equal(blocks, factors)


@pytest.mark.parametrize("damage", ["row", "column", "equal rows", "zero", "nan", "one nan"])
@pytest.mark.parametrize("node", [0, 2, 4])
@pytest.mark.parametrize("pairs", [[], chain(5)], ids=["loose", "chain"])
def test_a_singular_block_is_reported(pairs: list[tuple[int, int]], node: int, damage: str) -> None:
    pattern = build_pattern(5, np.array(pairs, np.int64).reshape(-1, 2), 1)
    rng = np.random.default_rng(3)
    blocks = np.zeros((pattern.keys.size, 6, 8))
    blocks[:, :, :6] = rng.standard_normal((len(blocks), 6, 6))
    blocks[pattern.plan.diagonal, :, :6] += 12.0 * np.eye(6)
    bad = blocks[pattern.block(node, node)]
    if damage == "row":
        bad[3] = 0.0
    elif damage == "column":
        bad[:, 2] = 0.0
    elif damage == "equal rows":
        bad[5] = bad[1]
    elif damage == "zero":
        bad[:] = 0.0
    elif damage == "nan":
        bad[:] = np.nan
    else:
        bad[2, 4] = np.nan
    if "nan" not in damage:
        # nothing from the neighbours may repair the block
        near = (pattern.rows == pattern.row_of[node]) ^ (pattern.columns == pattern.row_of[node])
        blocks[near] = 0.0
    worst = factor(pattern.plan, blocks.reshape(-1), np.zeros(54, np.int64), NoSide(), SIX)
    # what the Newton loop tests
    assert not worst > 1e-14


def test_a_matrix_that_is_singular_as_a_whole_is_reported() -> None:
    # springs between neighbours and nothing that holds the chain: every diagonal block but the last pivot is regular
    pattern = pattern_of("chain")
    spring = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    blocks = np.zeros((pattern.keys.size, 6, 8))
    for a, b in chain(9):
        for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
            blocks[pattern.block(i, j), :, :6] += sign * spring
    held = blocks.copy()
    held[pattern.block(0, 0), :, :6] += spring
    assert not factor(pattern.plan, blocks.reshape(-1), np.zeros(54, np.int64), NoSide(), SIX) > 1e-14
    assert factor(pattern.plan, held.reshape(-1), np.zeros(54, np.int64), NoSide(), SIX) > 0.01


@pytest.mark.parametrize("name", ["chain", "ladder"])
def test_multiply_adds_the_product(name: str) -> None:
    pattern = pattern_of(name)
    rng = np.random.default_rng(4)
    blocks = random_blocks(pattern, name, rng)
    x, y = rng.standard_normal((2, pattern.n, 8))
    expected = y[:, :6].reshape(-1) + dense(pattern, blocks) @ x[:, :6].reshape(-1)
    found = y.copy()
    multiply(pattern.rows, pattern.columns, blocks.reshape(-1), x.reshape(-1), found.reshape(-1))
    assert np.max(np.abs(found[:, :6].reshape(-1) - expected)) < 1e-13 * np.max(np.abs(expected))
    assert np.array_equal(found[:, 6:], y[:, 6:])


# --------------------------------------------------------------------------------------------------------------- borders
@pytest.mark.parametrize("n", [1, 7, 14])
def test_dense_solve_scales_and_exchanges_rows(n: int) -> None:
    rng = np.random.default_rng(5)
    a, y = rng.standard_normal((n, n)), rng.standard_normal(n)
    if n > 1:
        np.fill_diagonal(a, 0.0)
    # equations in different units
    a, y = a * 10.0 ** (6 * np.arange(n) % 13)[:, None], y * 10.0 ** (6 * np.arange(n) % 13)
    expected = np.linalg.solve(a, y)
    found = y.copy()
    assert solve_dense(a.copy(), found, n, 1e-14) == -1
    assert np.max(np.abs(found - expected)) < ACCURATE * np.max(np.abs(expected))


def test_dense_solve_refuses_singular_matrices() -> None:
    regular = np.diag([1.0, 2.0, 3.0]) + 0.5
    for change in (lambda a: a[1].fill(0.0), lambda a: a[:, 2].fill(0.0), lambda a: a[2].fill(np.nan), lambda a: a.fill(0.0)):
        a = regular.copy()
        change(a)
        assert solve_dense(a, np.ones(3), 3, 1e-14) in range(3)
    assert solve_dense(regular.copy(), np.ones(3), 3, 1e-14) == -1


def random_contact(n_rows: int, sliders: int, rng: np.random.Generator) -> Contact:
    """Borders with entries on rows that repeat, as two arms on one body make them."""
    count = 5
    row = rng.integers(0, n_rows, (sliders, count))
    row[:, 1] = row[:, 0]
    column, line = rng.standard_normal((2, sliders, count, 6, 8))
    corner = rng.standard_normal((sliders, 8, 8))
    residual = rng.standard_normal((sliders, 8))
    # the last entry is one too many: only `entries` of them count
    return Contact(np.zeros((5, 1)), np.zeros((3, 2)), np.full(sliders, count - 1), row, column.reshape(sliders, -1),
                   line.reshape(sliders, -1), corner.reshape(sliders, -1), residual, np.zeros(sliders, np.int64),
                   np.full(sliders, 3), 7 * np.arange(sliders), 3 * np.arange(sliders), np.zeros(sliders), np.ones(sliders),
                   np.zeros(sliders), np.zeros(1, np.int64), np.zeros(4), np.zeros((0, 2), np.int64), np.zeros((0, 2, 8)),
                   np.full(sliders, count))


@pytest.mark.parametrize("sliders", [1, 3])
def test_borders_are_solved_with_the_chain(sliders: int) -> None:
    pattern = pattern_of("cubic elements")
    n = pattern.n
    rng = np.random.default_rng(6)
    blocks = random_blocks(pattern, "cubic elements", rng)
    contact = random_contact(n, sliders, rng)
    # row 4: unknowns 0 and 5 held, as the assembly leaves them
    mask = (1 << 0) | (1 << 5)
    held = Held(np.array([4]), np.array([mask]), np.zeros(1, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64),
                np.zeros(0, np.int64))
    fixed = 6 * 4 + np.array([0, 5])
    a = dense(pattern, blocks)
    a[fixed], a[:, fixed] = 0.0, 0.0
    a[fixed, fixed] = 1.0
    for k, (row, column) in enumerate(zip(pattern.rows, pattern.columns)):
        blocks[k, :, :6] = a.reshape(n, 6, n, 6)[row, :, column]
    r = rng.standard_normal((n, 8))
    r.reshape(-1)[8 * 4 + np.array([0, 5])] = 0.0

    size = 6 * n + BORDER * sliders
    whole, right = np.zeros((size, size)), np.zeros(size)
    whole[:6 * n, :6 * n], right[:6 * n] = a, -r[:, :6].reshape(-1)
    for k in range(sliders):
        at = slice(6 * n + BORDER * k, 6 * n + BORDER * (k + 1))
        for e in range(contact.entries[k]):
            rows = slice(6 * contact.row[k, e], 6 * contact.row[k, e] + 6)
            whole[rows, at] += contact.column[k].reshape(-1, 6, 8)[e, :, :BORDER]
            whole[at, rows] += contact.line[k].reshape(-1, 6, 8)[e, :, :BORDER].T
        whole[at, at] = contact.corner[k].reshape(8, 8)[:BORDER, :BORDER]
        right[at] = -contact.residual[k, :BORDER]
    whole[fixed], whole[:, fixed], right[fixed] = 0.0, 0.0, 0.0
    whole[fixed, fixed] = 1.0
    expected = np.linalg.solve(whole, right)

    width = -(-(1 + BORDER * sliders) // 8) * 8
    blocks, panel = blocks.reshape(-1), np.full(6 * n * width, np.nan)
    y = np.zeros(BORDER * sliders)
    pivots = np.zeros(6 * n, np.int64)
    factor(pattern.plan, blocks, pivots, NoSide(), SIX)
    fill_panel(contact, r.reshape(-1), width, panel, SPACE)
    clear_held(held, width, panel, SIX)
    solve(pattern.plan, blocks, pivots, panel, width, SIX)
    x = np.zeros((n, 8))
    assert solve_border(contact, np.zeros(3 * sliders), panel, width, np.zeros((y.size + 1) * width), np.zeros((y.size, y.size)),
                        y, x.reshape(-1), SPACE) == -1
    found = np.concatenate((x[:, :6].reshape(-1), y))
    assert np.max(np.abs(found - expected)) < 1e-9 * np.max(np.abs(expected))


def test_a_singular_border_is_reported() -> None:
    pattern = pattern_of("chain")
    rng = np.random.default_rng(8)
    blocks = random_blocks(pattern, "chain", rng).reshape(-1)
    contact = random_contact(9, 1, rng)
    # an equation that nothing appears in
    contact.corner[0, 8 * 3:8 * 3 + 8] = 0.0
    contact.line[0].reshape(-1, 8)[:, 3] = 0.0
    panel = np.zeros(54 * 8)
    pivots = np.zeros(54, np.int64)
    factor(pattern.plan, blocks, pivots, NoSide(), SIX)
    fill_panel(contact, np.ones(9 * 8), 8, panel, SPACE)
    solve(pattern.plan, blocks, pivots, panel, 8, SIX)
    assert solve_border(contact, np.zeros(3), panel, 8, np.zeros(64), np.zeros((7, 7)), np.zeros(7), np.zeros(72), SPACE) == 0
