"""A force between the two points of a link, and its derivative.

Arrays: q [12 N], in a plane [4 N].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.dimensions import add_stiffness, add_to, position
from fastbeam.kernels.jit.decorators import kernel


@kernel
def difference(link, k, q, dofs):
    """Return x_b - x_a of link k at coordinates q."""
    return position(q, link.node[k, 1], dofs) - position(q, link.node[k, 0], dofs)


@kernel
def add_pair(link, k, force, iso, x, y, work, dofs):
    """Add `force` on b and its opposite on a to the residual, and iso I + x y^T, its derivative by the end position of b, to the
    tangent."""
    add_to(work.r, 8 * link.row[k, 1], 1, force)
    add_to(work.r, 8 * link.row[k, 0], 1, -1.0 * force)
    for e in range(4):
        sign = 1.0 if e == 0 or e == 3 else -1.0
        add_stiffness(work.blocks, 8 * len(dofs) * link.block[k, e], sign * iso, sign * x, y)
