"""Border of the linear system: columns of the sliders in the panel, their Schur complement, the augmented Lagrangian.

Constraints of sliders that are eliminated with their beams (linalg/carriers.py) have no unknowns in it: their `Contact.first` is
-1.

Arrays: r, x_out [8 (rows + 1)]; panel, panel_out [rows, n, width] flat, n unknowns a node; force [*], forces of all constraints;
of the border of m = 7 B unknowns, B constraints in it, 5 B in a plane, border_rows [m + 1, width] flat, schur, a [m, m], y, y_out
[m].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.algebra.vectors import put_first, total, vld, vst, vzero
from fastbeam.kernels.jit.decorators import inlined, kernel

# a pivot of the scaled Schur complement below this is round-off, that of dependent sliders; without the augmented Lagrangian
# their pivots are larger (docs/reports/stress.md)
LEAST_PIVOT, LEAST_UNAUGMENTED = 1e-14, 1e-5


@kernel
def fill_residual(r, panel_out, dofs):
    """Store the residual as the only right-hand side, in a scene without sliders."""
    n = len(dofs)
    for i in range(panel_out.shape[0] // n):
        for c in range(n):
            panel_out[n * i + c] = r[8 * i + c]


@kernel
def fill_panel(contact, r, width, panel_out, dofs):
    """Store the residual in column 0, the border columns of slider k behind."""
    n = len(dofs)
    border = 2 * dim(dofs) + 1
    for i in range(panel_out.shape[0] // (n * width)):
        for c in range(n):
            o = (n * i + c) * width
            put_first(panel_out, o, r[8 * i + c])
            for j in range(8, width, 8):
                vst(panel_out, o + j, 0, 0.0)
    for k in range(contact.entries.shape[0]):
        for m in range(contact.entries[k]):
            for c in range(n):
                o = (n * contact.row[k, m] + c) * width + 1 + contact.first[k]
                for j in range(border):
                    panel_out[o + j] += contact.column[k, 8 * (n * m + c) + j]


@kernel
def take_solution(panel, width, factor, x_out, dofs):
    """Store `factor` times column 0 of the panel in rows of x."""
    n = len(dofs)
    for i in range(panel.shape[0] // (n * width)):
        for c in range(n):
            x_out[8 * i + c] = factor * panel[(n * i + c) * width]


@kernel
def augment(contact, force, schur, y, dofs):
    """Add 1/r to the complement of every slider, theory.md (5.5), and write its force columns in units of 1/compliance; in the
    first iteration the whole force answers the gap. Return -1, or a slider whose force moves nothing."""
    n = schur.shape[0]
    for k in range(contact.entries.shape[0]):
        o = contact.first[k]
        if o < 0:
            continue
        largest = 0.0
        for j in range(o, o + contact.forces[k]):
            largest = max(largest, abs(schur[j, j]))
        if not largest > contact.augmented[1]:
            return k
        contact.compliance[k] = largest
        soft = contact.augmented[0] * contact.softness[k]
        first = contact.augmented[2] * soft * largest
        for j in range(contact.forces[k]):
            y[o + j] -= first * force[contact.first_force[k] + j]
        for j in range(o, o + contact.forces[k]):
            schur[j, j] += soft * largest
            for i in range(n):
                schur[i, j] /= largest
    return -1


@inlined
def couple_sleeves(contact, width, border, border_rows, dofs):
    """Add derivatives of the sliding equations of sleeves by the moments, and of the equations of the moments by s."""
    for o in range(contact.pair.shape[0]):
        if contact.first[contact.pair[o, 0]] < 0:
            continue
        slide = contact.first[contact.pair[o, 0]] + dim(dofs)
        moments = contact.first[contact.pair[o, 1]]
        for a in range(border):
            border_rows[slide * width + 1 + moments + a] += contact.cross[o, 0, a]
            border_rows[(moments + a) * width + 1 + slide] += contact.cross[o, 1, a]


@kernel
def constraint_of(contact, first):
    """Return the constraint whose unknowns begin at `first`."""
    for k in range(contact.entries.shape[0]):
        if contact.first[k] == first:
            return k
    return -1


@inlined
def put_equations(contact, k, panel, width, border_rows, dofs):
    """Store rows of constraint k in the complement like those of the panel: minus the right-hand side, then the entries."""
    nu = len(dofs)
    border = 2 * dim(dofs) + 1
    first = contact.first[k] * width
    for i in range(border):
        border_rows[first + i * width] = contact.residual[k, i]
        for j in range(border):
            border_rows[first + i * width + 1 + contact.first[k] + j] = contact.corner[k, 8 * i + j]
    for m in range(contact.entries[k]):
        for c in range(nu):
            o = (nu * contact.row[k, m] + c) * width
            for i in range(border):
                line = contact.line[k, 8 * (nu * m + c) + i]
                if line != 0.0:
                    for j in range(0, width, 8):
                        p = first + i * width + j
                        vst(border_rows, p, 0, vld(border_rows, p, 0) - line * vld(panel, o + j, 0))


@kernel
def solve_border(contact, force, panel, width, border_rows, schur, y_out, x_out, dofs):
    """Solve the Schur complement of the borders; the panel holds K^-1 (r, columns). The structural increments go to rows of x_out
    and the border unknowns to y_out. Return -1, or a slider that makes the complement singular. border_rows: work, one row of the
    panel more than the border has unknowns."""
    nu = len(dofs)
    border = 2 * dim(dofs) + 1
    n = schur.shape[0]
    for i in range((n + 1) * width):
        border_rows[i] = 0.0
    for k in range(contact.entries.shape[0]):
        if contact.first[k] >= 0:
            put_equations(contact, k, panel, width, border_rows, dofs)
    couple_sleeves(contact, width, border, border_rows, dofs)
    for i in range(n):
        y_out[i] = -border_rows[i * width]
        for j in range(n):
            schur[i, j] = border_rows[i * width + 1 + j]
    singular = augment(contact, force, schur, y_out, dofs)
    if singular >= 0:
        return singular
    singular = solve_dense(schur, y_out, n, LEAST_PIVOT if contact.augmented[0] > 0.0 else LEAST_UNAUGMENTED)
    if singular >= 0:
        return constraint_of(contact, singular // border * border)
    for k in range(contact.entries.shape[0]):
        o = contact.first[k]
        if o < 0:
            continue
        contact.remaining[k] = 0.0
        for i in range(contact.forces[k]):
            y_out[o + i] /= contact.compliance[k]
            before = contact.augmented[2] * force[contact.first_force[k] + i]
            left = contact.augmented[0] * contact.softness[k] * contact.compliance[k] * (y_out[o + i] + before)
            contact.remaining[k] = max(contact.remaining[k], abs(left))
    contact.augmented[2] = 0.0
    last = n * width
    border_rows[last] = 1.0
    for j in range(n):
        border_rows[last + 1 + j] = y_out[j]
    for i in range(panel.shape[0] // (nu * width)):
        for c in range(nu):
            o = (nu * i + c) * width
            x = vzero()
            for j in range(0, width, 8):
                x += vld(panel, o + j, 0) * vld(border_rows, last + j, 0)
            x_out[8 * i + c] = -total(x)
    return -1


@kernel
def solve_dense(a, y, n, least):
    """Solve by Gauss elimination with row scaling and row exchange. Return -1, or the row or unknown whose pivot is not above
    `least`."""
    for i in range(n):
        t = 0.0
        for j in range(n):
            t = max(t, abs(a[i, j]))
        if not t > 0.0:
            return i
        for j in range(n):
            a[i, j] /= t
        y[i] /= t
    for k in range(n):
        m = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[m, k]):
                m = i
        if not abs(a[m, k]) > least:
            return k
        if m != k:
            for j in range(n):
                t = a[k, j]; a[k, j] = a[m, j]; a[m, j] = t
            t = y[k]; y[k] = y[m]; y[m] = t
        for i in range(k + 1, n):
            f = a[i, k] / a[k, k]
            if f != 0.0:
                for j in range(k + 1, n):
                    a[i, j] -= f * a[k, j]
                y[i] -= f * y[k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            y[i] -= a[i, j] * y[j]
        y[i] /= a[i, i]
    return -1
