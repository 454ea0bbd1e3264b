"""Work arrays of constraints with multipliers, and their entries: derivatives of a row of the residual by the forces (its
columns), and of the constraint equations by the unknowns of the row (its lines).

`Contact` keeps every entry as two blocks of numbers, whatever a constraint is. Where all constraints are sliders,
`FactoredContact` of factored.py keeps the few numbers that the blocks of an entry are made of.

Arrays: out, block [*], blocks of rows of 8 numbers, of `add_column_times` numbers; y [7 S], unknowns of all constraints; q [12
N], in a plane [4 N].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import cross_product, dim, put, put_cross_matrix
from fastbeam.kernels.algebra.vectors import vld, vst
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import ARM, POSITION
from fastbeam.kernels.terms import NoTies, System


class Contact(NamedTuple):
    """Work of all constraints with multipliers: the sliders come first, then joints, then moments of sleeves; S constraints, `E`
    entries each at most."""

    basis: np.ndarray       # float64 [5, n]: N(s_n), N(s_n+1), N'(s_n+1), N[s_n, s_n+1], its derivative by s_n+1
    legendre: np.ndarray    # float64 [3, n_coef]
    entries: np.ndarray     # int64 [S]: number of entries
    row: np.ndarray         # int64 [S, E]: row of the residual
    column: np.ndarray      # float64 [S, 48 E]: column[6 x 8] of every entry, derivative of the rows by the border unknowns
    line: np.ndarray        # float64 [S, 48 E]: derivative of the border equations by the unknowns of the row, transposed
    corner: np.ndarray      # float64 [S, 64]
    residual: np.ndarray    # float64 [S, 8]
    element: np.ndarray     # int64 [S]: element of s_n, a hint
    forces: np.ndarray      # int64 [S]: number of forces, as many equations come first, gaps
    first: np.ndarray       # int64 [S]: number of the first unknown among those of all constraints; -1 for sliders that are
    #                         eliminated with their beams (linalg/carriers.py)
    first_force: np.ndarray  # int64 [S]: number of the first force
    compliance: np.ndarray  # float64 [S]: compliance of the parts that each slider joins, in a step
    softness: np.ndarray    # float64 [S]: share of augmented[0] that it has
    remaining: np.ndarray   # float64 [S]: gap that the augmented Lagrangian leaves after the last iteration
    full: np.ndarray        # int64 [1]: 1 where a slider had more entries than there is room for
    augmented: np.ndarray   # float64 [4]: 1/factor of theory.md (5.5), least compliance of the parts, 1 in the first iteration,
    #                         largest increment of s
    pair: np.ndarray        # int64 [O, 2]: of every sleeve its slider and the constraint of its moments
    cross: np.ndarray       # float64 [O, 2, 8]: derivatives of the sliding equation by the unknowns of the moments, and of the
    #                         equations of the moments by s
    strong: np.ndarray      # int64 [S]: number of entries that the order of elimination follows, where that are not all
    before: np.ndarray = np.zeros(0)  # float64 [S]: for joints the remaining gap at the last check in this step


class ContactInRows(Contact):
    """Contact of scenes whose constraints are rows of the block matrix (linalg/constraints.py), not a dense border."""


ContactInRows.reads = System  # type: ignore[attr-defined]


class ContactAtRest(Contact):
    """Contact in statics, which solves for nodes and constraints outside of compiled code."""


class ContactInMatrix(Contact):
    """Contact of scenes whose constraints are rows and columns of one sparse matrix, which is solved outside of compiled code
    (stepping/constraint_matrix.py)."""


class ContactOfCarriers(Contact):
    """Contact of scenes whose sliders are all eliminated with their beams (linalg/carriers.py): it has no entries."""


class Weights(NamedTuple):
    """Weights of a node in a contact."""

    mean: float     # share of the force; the mean gap changes with -mean/2 of its position
    end: float      # the gap at the end of the step changes with -end of its position
    slope: float    # derivative of `mean` by the place of the slider at the end
    along: float    # share of the node in the derivative of the sliding equation by a position


class Frame(NamedTuple):
    """Quantities that all nodes under a slider share."""

    force: Any      # contact force F
    gap: Any        # g_mean
    moment: Any     # g_mean x F
    slide: Any      # derivative of the sliding equation by a position, for `Weights.along` = 1
    across: Any     # 4 times the derivative of the sliding equation by the Cayley vector of the frame


@generic
def tied_arm(ties, e, q):
    """Return the offset of entry e of tied nodes of kind ARM, a point carried on an arm, at coordinates q."""


@kernel
def new_entry(contact, k, row, dofs):
    """Return the offset of a new entry of slider k, filled with zeros. If the arrays are full it is the last entry again, and
    `full` is set."""
    m = contact.entries[k]
    if m == contact.row.shape[1]:
        contact.full[0] = 1
        m -= 1
    n = 8 * len(dofs)
    contact.entries[k] = m + 1
    contact.row[k, m] = row
    for i in range(n * m, n * m + n):
        contact.column[k, i] = 0.0
        contact.line[k, i] = 0.0
    return n * m


@kernel
def entry_of(contact, k, row, dofs):
    """Return the offset of the entry of constraint k for a row, the present one or a new one."""
    for m in range(contact.entries[k]):
        if contact.row[k, m] == row:
            return 8 * len(dofs) * m
    return new_entry(contact, k, row, dofs)


@generic
def put_position(contact, k, row, weights, f, slide, dofs):
    """Store the entry of a position, which takes weights.mean of the force f; weights.along slide: derivative of the sliding
    equation by the position. Return its offset or place."""


@put_position.register(Contact)
@kernel
def put_position_blocks(contact, k, row, weights, f, slide, dofs):
    o = new_entry(contact, k, row, dofs)
    d = dim(dofs)
    column = contact.column[k]
    line = contact.line[k]
    for i in range(d):
        column[o + 8 * i + i] = weights.mean
        line[o + 8 * i + i] = -weights.end
        line[o + 8 * i + d + 1 + i] = 0.5 * weights.mean
    put(column, o + d, 8, weights.slope * f)
    put(line, o + d, 8, weights.along * slide)
    return o


@generic
def put_arm(contact, k, row, arm_mid, arm_end, weights, f, slide, dofs):
    """Store the entry of the spin of a node that carries the position of `put_position` on an arm."""


@put_arm.register(Contact)
@kernel
def put_arm_blocks(contact, k, row, arm_mid, arm_end, weights, f, slide, dofs):
    d = dim(dofs)
    o = new_entry(contact, k, row, dofs) + 8 * d
    column = contact.column[k]
    line = contact.line[k]
    put_cross_matrix(column, o, weights.mean, arm_mid)
    put(column, o + d, 8, cross_product.call(arm_mid, weights.slope * f))
    put_cross_matrix(line, o, -weights.end, arm_end)
    put_cross_matrix(line, o + d + 1, 0.5 * weights.mean, arm_end)
    put(line, o + d, 8, cross_product.call(arm_end, weights.along * slide))


@generic
def put_translation(ties, contact, k, node, row, work, weights, f, slide, dofs):
    """Store the entry of the position of one node as in `put_position`; tied nodes pass it on. Return the value of `put_position`
    for the node's own entry, -1 for a tied node."""


@put_translation.register(NoTies)
@kernel
def put_free_translation(ties, contact, k, node, row, work, weights, f, slide, dofs):
    return put_position.call(contact, k, row, weights, f, slide, dofs)


@kernel
def put_tied_translation(ties, contact, k, node, row, work, weights, f, slide, dofs):
    """Run `put_translation` in a scene with tied nodes."""
    if ties.start[node + 1] > ties.start[node]:
        for t in range(ties.start[node], ties.start[node + 1]):
            if ties.kind[t] == POSITION:
                put_position.call(contact, k, ties.target_row[t], weights, f, slide, dofs)
            elif ties.kind[t] == ARM:
                put_arm.call(contact, k, ties.target_row[t], tied_arm.call(ties, t, work.q_mid),
                             tied_arm.call(ties, t, work.q_end), weights, f, slide, dofs)
        return -1
    return put_position.call(contact, k, row, weights, f, slide, dofs)


@generic
def put_frame(contact, k, frame, dofs):
    """Store quantities that all nodes under slider k share, before `put_node`."""


@put_frame.register(Contact)
@kernel
def put_frame_nowhere(contact, k, frame, dofs):
    pass


@generic
def put_node(contact, k, row, entry, turned, weights, frame, dofs):
    """Store the share of a node under slider k in the frame: its moment weights.mean g_mean x F, its theta in the sliding
    equation, `turned`; row: of its spin; entry: of its position as in `put_translation`, -1 if that belongs to other rows."""


@put_node.register(Contact)
@kernel
def put_node_blocks(contact, k, row, entry, turned, weights, frame, dofs):
    o = entry
    if o < 0:
        o = new_entry(contact, k, row, dofs)
    d = dim(dofs)
    column = contact.column[k]
    put_cross_matrix(column, o + 8 * d, weights.mean, frame.gap)
    put_cross_matrix(column, o + 9 * d + 1, -weights.mean, frame.force)
    put(column, o + 9 * d, 8, weights.slope * frame.moment)
    put(contact.line[k], o + 9 * d, 8, turned)


@generic
def put_corner(contact, k, end_s, mean_s, tangent, by_s, dofs):
    """Store the own block of slider k, rows gap, sliding, g_mean against F, s, g_mean: derivatives by s of the curve at the end
    and of the mean of it, of the sliding equation by the force and by s."""


@kernel
def unit_corner(contact, k, first, last):
    """Set the own block of a constraint to zeros, but ones on the diagonal from `first` to before `last`."""
    for i in range(64):
        contact.corner[k, i] = 0.0
    for i in range(first, last):
        contact.corner[k, 9 * i] = 1.0


@put_corner.register(Contact)
@kernel
def put_corner_block(contact, k, end_s, mean_s, tangent, by_s, dofs):
    d = dim(dofs)
    unit_corner(contact, k, d + 1, 2 * d + 1)
    corner = contact.corner[k]
    put(corner, d, 8, -1.0 * end_s)
    put(corner, 8 * d, 1, tangent)
    corner[9 * d] = by_s
    put(corner, 9 * d + 8, 8, mean_s)


@generic
def put_idle_corner(contact, k, dofs):
    """Store the own block of a slider that has left its beam: its force and s stay."""


@put_idle_corner.register(Contact)
@kernel
def put_unit_corner(contact, k, dofs):
    unit_corner(contact, k, 0, 2 * dim(dofs) + 1)


# --- blocks of entries, for solvers ---------------------------------------------------------------------------------------
@generic
def add_column(contact, k, m, out, at, dofs):
    """Add columns of entry m of constraint k, n rows of 8, to out [*] from `at` on."""


@add_column.register(Contact)
@inlined
def add_column_block(contact, k, m, out, at, dofs):
    n = 8 * len(dofs)
    for c in range(0, n, 8):
        vst(out, at + c, 0, vld(out, at + c, 0) + vld(contact.column[k], n * m + c, 0))


@generic
def add_line(contact, k, m, out, at, dofs):
    """Add lines of entry m of constraint k, transposed like the columns, to out [*] from `at` on."""


@add_line.register(Contact)
@inlined
def add_line_block(contact, k, m, out, at, dofs):
    n = 8 * len(dofs)
    for c in range(0, n, 8):
        vst(out, at + c, 0, vld(out, at + c, 0) + vld(contact.line[k], n * m + c, 0))


@inlined
def add_transposed(out, at, block, o, n, m):
    """Add n rows of 8 in block [*] from o on, transposed, to m rows in out [*] from `at` on."""
    for a in range(m):
        for c in range(n):
            out[at + 8 * a + c] += block[o + 8 * c + a]


@generic
def add_line_rows(contact, k, m, out, at, unknowns, dofs):
    """Add lines of entry m of constraint k as rows; unknowns: number of unknowns of the constraint."""


@add_line_rows.register(Contact)
@inlined
def add_line_block_rows(contact, k, m, out, at, unknowns, dofs):
    n = len(dofs)
    add_transposed(out, at, contact.line[k], 8 * n * m, n, unknowns)


@generic
def add_column_times(contact, k, m, y, first, unknowns, out, at, dofs):
    """Add columns of entry m times the unknowns of the constraint in y [*] from `first` on, to n numbers in out [*] from `at`
    on."""


@add_column_times.register(Contact)
@inlined
def add_column_block_times(contact, k, m, y, first, unknowns, out, at, dofs):
    n = len(dofs)
    for c in range(n):
        z = out[at + c]
        for a in range(unknowns):
            z += contact.column[k, 8 * (n * m + c) + a] * y[first + a]
        out[at + c] = z


@generic
def largest_share(contact, k, m, held, forces, dofs):
    """Return the largest share of the forces of a constraint in the free unknowns of the row of entry m; bit c of `held` set:
    fixed."""


@largest_share.register(Contact)
@kernel
def largest_of_columns(contact, k, m, held, forces, dofs):
    n = len(dofs)
    largest = 0.0
    for c in range(n):
        if (held >> c) & 1 == 0:
            for a in range(forces):
                largest = max(largest, abs(contact.column[k, 8 * (n * m + c) + a]))
    return largest


@generic
def put_own_block(contact, k, out, at, unknowns, dofs):
    """Store the own block of constraint k, rows of 8 in out [*] from `at` on."""


@put_own_block.register(Contact)
@inlined
def copy_corner(contact, k, out, at, unknowns, dofs):
    for a in range(unknowns):
        vst(out, at + 8 * a, 0, vld(contact.corner[k], 8 * a, 0))


@generic
def first_of_own_block(contact, k):
    """Return the first number of the own block of constraint k."""


@first_of_own_block.register(Contact)
@inlined
def first_of_corner(contact, k):
    return contact.corner[k, 0]
