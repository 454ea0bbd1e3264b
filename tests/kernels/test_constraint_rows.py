"""Nodes and constraints as rows of one block matrix against dense linear algebra."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fastbeam.kernels.algebra.blocks import SIX, THREE
from fastbeam.kernels.beams.nodes import Held, NoHeld
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.linalg.constraints import Constraints, fill_constraints, solve_constraints
from fastbeam.linalg.pattern import Pattern, build_pattern
from fastbeam.stepping.constraint_rows import couplings_of, with_capacity

Array = np.ndarray
ACCURATE = 1e-9  # of the solution
INVERSE = 1e-3   # of theory.md (5.5), large enough to be seen


class Saddle:
    """A random matrix of nodes and constraints with its right-hand side: the arrays of the kernels and a dense twin."""

    def __init__(self, n: int, pairs: list[tuple[int, int]], touched: list[list[int]], unknowns: list[tuple[int, int, int]],
                 size: tuple[int, ...], seed: int, held: dict[int, int] | None = None, late: list[list[int]] | None = None,
                 first: float = 1.0, scale: int = 1) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.size, self.k = size, len(size)
        self.pattern = pattern = build_pattern(n, np.array(pairs, np.int64).reshape(-1, 2), 1)
        self.n, self.s = n, len(touched)
        self.m = np.array([x[0] for x in unknowns])
        self.forces, self.in_force = (np.array([x[i] for x in unknowns]) for i in (1, 2))
        self.held = held or {}
        rows = [pattern.row_of[np.array(x)] for x in touched]
        mask = np.zeros(n, np.int64)
        for node, bits in self.held.items():
            mask[pattern.row_of[node]] = bits
        self.node_matrix = self._node_matrix(pairs, mask)
        self.contact = self._contact(rows, first)
        self.force = rng.standard_normal(int(self.forces.sum()))
        self.r = rng.standard_normal((n, 8))
        self.r[:, :self.k][self._is_held(mask)] = 0.0
        self.mask = mask
        end = 8 * self.k * (pattern.keys.size + 1)
        late_rows = [pattern.row_of[np.array(x, np.int64)] for x in (late or [[]] * self.s)]
        self.couplings = couplings_of(pattern, self.k, end, mask, np.full(n, -1), late_rows, self.m, self.forces, self.in_force)
        self.make_room(scale)

    def make_room(self, scale: int) -> None:
        self.rows: Constraints = with_capacity(self.couplings, self.contact.row.shape[1], 0, self.k, scale)

    def _is_held(self, mask: Array) -> Array:
        return (mask[:, None] >> np.arange(self.k)) & 1 == 1

    def _node_matrix(self, pairs: list[tuple[int, int]], mask: Array) -> Array:
        n, k, rng = self.n, self.k, self.rng
        a = np.zeros((n, k, n, k))
        row = self.pattern.row_of
        for i, j in pairs:
            a[row[i], :, row[j]], a[row[j], :, row[i]] = rng.standard_normal((2, k, k))
        for i in range(n):
            a[i, :, i] = rng.standard_normal((k, k)) + 12.0 * np.eye(k)
        a = a.reshape(n * k, n * k)
        fixed = self._is_held(mask).reshape(-1)
        a[fixed], a[:, fixed] = 0.0, 0.0
        a[fixed, fixed] = 1.0
        return a

    def _contact(self, rows: list[Array], first: float) -> Contact:
        s, k, rng = self.s, self.k, self.rng
        most = max(len(x) for x in rows) + 1
        row, entries = np.zeros((s, most), np.int64), np.array([len(x) for x in rows])
        column, line = rng.standard_normal((2, s, most, k, 8))
        corner, residual = rng.standard_normal((s, 8, 8)), rng.standard_normal((s, 8))
        for c, x in enumerate(rows):
            row[c, :len(x)] = x
            column[c, :, :, self.m[c]:] = 0.0
            line[c, :, :, self.m[c]:] = 0.0
        # joints may be held more strongly than sliders
        softness = np.where(self.m == (7 if k == 6 else 5), 1.0, 0.25)
        return Contact(np.zeros((5, 1)), np.zeros((3, 2)), entries, row, column.reshape(s, -1), line.reshape(s, -1),
                       corner.reshape(s, -1), residual, np.zeros(s, np.int64), self.forces, np.cumsum(self.m) - self.m,
                       np.cumsum(self.forces) - self.forces, np.zeros(s), softness, np.zeros(s), np.zeros(1, np.int64),
                       np.array([INVERSE, 0.0, first, 0.0]), np.zeros((0, 2), np.int64), np.zeros((0, 2, 8)), entries)

    def solve(self) -> bool:
        """With the kernels."""
        self.rows.factors.failed[:] = 0
        n, k, pattern = self.n, self.k, self.pattern
        blocks = self.rows.factors.store[:8 * k * (pattern.keys.size + 1)].reshape(-1, k, 8)
        blocks[:] = 0.0
        blocks[:-1, :, :k] = self.node_matrix.reshape(n, k, n, k)[pattern.rows, :, pattern.columns]
        held: Any = NoHeld()
        if self.held:
            fixed = np.flatnonzero(self.mask)
            none = np.zeros(0, np.int64)
            held = Held(fixed, self.mask[fixed], none, none, none, none)
        q = np.zeros(0)
        self.x, self.y = np.zeros((n, 8)), np.zeros(int(self.m.sum()))
        if not fill_constraints(self.contact, self.rows._replace(held=held), self.r.reshape(-1), q, q, self.size):
            return False
        self.first = float(self.contact.augmented[2])
        return bool(solve_constraints(self.contact, self.rows, self.force, self.x.reshape(-1), self.y, self.size))

    def blocks_of(self, c: int) -> tuple[Array, Array]:
        """Columns [n k, m] and lines [m, n k] of one constraint."""
        k, m = self.k, self.m[c]
        column, line = np.zeros((self.n, k, m)), np.zeros((self.n, k, m))
        for e in range(self.contact.entries[c]):
            column[self.contact.row[c, e]] += self.contact.column[c].reshape(-1, k, 8)[e, :, :m]
            line[self.contact.row[c, e]] += self.contact.line[c].reshape(-1, k, 8)[e, :, :m]
        fixed = self._is_held(self.mask)
        column[fixed], line[fixed] = 0.0, 0.0
        return column.reshape(-1, m), line.reshape(-1, m).T

    def dense_solution(self) -> tuple[Array, Array]:
        """With NumPy, from the compliances that the kernels found."""
        nodes = self.n * self.k
        starts = nodes + np.concatenate(([0], np.cumsum(self.m)))
        a, b = np.zeros((starts[-1], starts[-1])), np.zeros(starts[-1])
        a[:nodes, :nodes], b[:nodes] = self.node_matrix, -self.r[:, :self.k].reshape(-1)
        at = 0
        for c in range(self.s):
            here = slice(starts[c], starts[c + 1])
            a[:nodes, here], a[here, :nodes] = self.blocks_of(c)
            a[here, here] = self.contact.corner[c].reshape(8, 8)[:self.m[c], :self.m[c]]
            b[here] = -self.contact.residual[c, :self.m[c]]
            for f in range(self.forces[c]):
                soft = INVERSE * self.contact.softness[c] * self.contact.compliance[c]
                a[starts[c] + f, starts[c] + f] += soft
                b[starts[c] + f] -= self.first * soft * self.force[at + f]
            at += self.forces[c]
        x = np.linalg.solve(a, b)
        return x[:nodes].reshape(self.n, self.k), x[nodes:]

    def check(self) -> None:
        assert self.solve(), self.rows.factors.failed
        x, y = self.dense_solution()
        size = max(np.max(np.abs(x)), np.max(np.abs(y)))
        assert np.max(np.abs(self.x[:, :self.k] - x)) < ACCURATE * size
        assert np.max(np.abs(self.y - y)) < ACCURATE * size


def tree(n: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    return [(int(rng.integers(max(0, i - 4), i)), i) for i in range(1, n)]


SLIDER = {SIX: (7, 3, 1), THREE: (5, 2, 1)}


@pytest.mark.parametrize("size", [SIX, THREE], ids=["space", "plane"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("shape", ["chain", "tree", "loop", "loose"])
def test_solution_is_that_of_the_whole_matrix(shape: str, seed: int, size: tuple[int, ...]) -> None:
    rng = np.random.default_rng(seed)
    n = 14
    pairs = {"chain": [(i, i + 1) for i in range(n - 1)], "tree": tree(n, rng), "loose": [],
             "loop": [(i, (i + 1) % n) for i in range(n)]}[shape]
    touched, unknowns = [], []
    for _ in range(5):
        touched.append(rng.integers(0, n, int(rng.integers(2, 5))).tolist())
        forces = int(rng.integers(1, len(size) // 2 + 1))
        unknowns.append(SLIDER[size] if rng.integers(2) else (forces, forces, 0))
    held = {3: 0b101, 7: 0b010} if seed % 2 else None
    system = Saddle(n, pairs, touched, unknowns, size, 10 + seed, held, scale=8)
    system.check()
    # with the structure of before, then with another one
    system.check()
    system.contact.row[0, 0] = system.pattern.row_of[int(rng.integers(0, n))]
    system.contact.entries[1] -= 1
    system.check()


@pytest.mark.parametrize("size", [SIX, THREE], ids=["space", "plane"])
def test_points_may_be_eliminated_later(size: tuple[int, ...]) -> None:
    n = 12
    pairs = [(i, i + 1) for i in range(n - 2)]
    touched, late = [[k, k + 1, n - 1] for k in range(0, 9, 2)], [[n - 1]] * 5
    system = Saddle(n, pairs, touched, [SLIDER[size]] * 5, size, 3, late=late, scale=8)
    system.check()
    order = system.rows.order
    hub = order.position[system.pattern.row_of[n - 1]]
    assert min(order.position[n:]) < hub
    # no clique of all constraints
    assert np.max(np.diff(order.start)) <= 4


def test_compliance_is_what_the_nodes_give() -> None:
    system = Saddle(9, [(i, i + 1) for i in range(8)], [[3, 4, 5]], [(7, 3, 1)], SIX, 5)
    system.check()
    columns, lines = system.blocks_of(0)
    gives = np.abs(np.diag(lines @ np.linalg.solve(system.node_matrix, columns))[:3])
    # but for what nodes behind the constraint give
    first = system.rows.order.position[9]
    nodes = np.sort(system.rows.order.order[:first])
    keep = (6 * nodes[:, None] + np.arange(6)).reshape(-1)
    gives = np.abs(np.diag(lines[:, keep] @ np.linalg.solve(system.node_matrix[np.ix_(keep, keep)], columns[keep]))[:3])
    np.testing.assert_allclose(system.contact.compliance[0], gives.max(), rtol=1e-12)


def test_a_force_that_moves_nothing_it_waits_for_waits_for_all() -> None:
    held = {0: 0b111111, 1: 0b111111}
    system = Saddle(6, [(0, 1), (1, 2), (2, 3)], [[0, 1, 5]], [(7, 3, 1)], SIX, 7, held, late=[[5]])
    system.check()
    order = system.rows.order
    assert order.position[6] > order.position[system.pattern.row_of[5]]
    assert system.rows.touched.wait[0] == 1


@pytest.mark.parametrize("plain", [False, True])
def test_dependent_constraints_are_named(plain: bool) -> None:
    system = Saddle(9, [(i, i + 1) for i in range(8)], [[2, 3], [5, 6], [5, 6]], [(3, 3, 0)] * 3, SIX, 4)
    system.contact.corner[:] = 0.0
    for table in (system.contact.column, system.contact.line):
        table[2] = table[1]
    system.contact.augmented[0] = 0.0 if plain else 1e-18
    assert not system.solve()
    assert system.rows.factors.failed[1] in (1, 2)
    system = Saddle(9, [(i, i + 1) for i in range(8)], [[2, 3], [5, 6]], [(7, 3, 1)] * 2, SIX, 4)
    system.contact.column[1] = 0.0
    assert not system.solve()
    assert system.rows.factors.failed[1] == 1


def test_a_node_with_a_singular_block_is_no_constraint() -> None:
    system = Saddle(4, [(0, 1), (1, 2)], [[0, 1]], [(7, 3, 1)], SIX, 4)
    lonely = 6 * system.pattern.row_of[3]
    system.node_matrix[lonely:lonely + 6] = 0.0
    assert not system.solve()
    assert system.rows.factors.failed.tolist() == [0, -1]


def test_too_little_room_is_told_and_more_helps() -> None:
    n = 40
    touched = [[k, (7 * k + 5) % n, (11 * k + 2) % n] for k in range(n)]
    system = Saddle(n, [(i, i + 1) for i in range(n - 1)], touched, [(7, 3, 1)] * n, SIX, 9)
    assert not system.solve()
    assert system.rows.factors.failed[0] == 1
    scale = 1
    while system.rows.factors.failed[0]:
        scale *= 2
        system.make_room(scale)
        system.solve()
    system.check()


def test_order_depends_on_what_is_touched_and_nothing_else() -> None:
    first = Saddle(14, [(i, i + 1) for i in range(13)], [[1, 2], [6, 7]], [(7, 3, 1)] * 2, SIX, 9, scale=8)
    first.check()
    expected = [first.rows.order.order.copy(), first.x.copy(), first.y.copy()]
    first.contact.row[0, 0] = first.pattern.row_of[9]
    first.check()
    first.contact.row[0, 0] = first.pattern.row_of[1]
    first.contact.augmented[2] = 1.0
    first.check()
    for found, before in zip((first.rows.order.order, first.x, first.y), expected):
        assert np.array_equal(found, before)


def test_a_chain_keeps_its_structure() -> None:
    n = 200
    touched = [[k, k + 1, n + j] for j, k in enumerate((10, 11, 150))]
    system = Saddle(n + 3, [(i, i + 1) for i in range(n - 1)], touched, [(7, 3, 1)] * 3, SIX, 1)
    system.check()
    assert isinstance(system.pattern, Pattern)
    assert system.rows.order.counts[0] < n + 40
