"""Free coordinates of joints with axes, theory.md 4: functions x of products of two vectors that are linear in the coordinates.

Products are D_i . E_j of directions of a and b, or r . D_i. Each belongs to one of two sums y and z, of which x is a function:

    LINE     x = y - const          a distance along an axis, a cosine
    ANGLE    x = atan2(y, z)        an angle, counted over turns
    SWING    x = acos(z)            the angle between two axes

A force G on x does the work G Dx where it acts as forces G g_y on y and G g_z on z with Dx = g_y Dy + g_z Dz
(`CoordinateGradient`); these act on the nodes at the mean shape as in conditions.py. Everything that acts on coordinates goes
through `gradient_of`, `push_parts` and `put_entries`, so that a new kind of coordinate is one more entry there.

Arrays: q, q0, q1, v [12 N], in a plane [4 N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_to, cross_product, dim, position
from fastbeam.kernels.algebra.vectors import V2, V3, cross, cross2, dot, f8
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.joints.conditions import direction, push_along, put_on_end, put_spin, turn_against

LINE, ANGLE, SWING = range(3)
# numbers of a coordinate in `State.history`: its value, m or rad; energy that its damper took away, work of its motor, J
MOTION = 3
VALUE, LOSS, WORK = range(MOTION)
# p/q up to which the arc tangent over p is taken from its series
SMALL_TURN = 3e-3
# a sine that counts as none
NO_SWING = 1e-14


class JointMotion(NamedTuple):
    """C coordinates of joints, functions of P products; the term that follows them."""

    node: np.ndarray       # int64 [C, 2]
    row: np.ndarray        # int64 [C, 2]
    block: np.ndarray      # int64 [C, 4]: blocks a-a, a-b, b-a, b-b
    kind: np.ndarray       # int64 [C]: LINE, ANGLE or SWING
    spin_node: np.ndarray  # int64 [C, 2]: nodes that have their spins
    start: np.ndarray      # int64 [C + 1]: range of a coordinate among the products
    pair: np.ndarray       # int64 [P, 3]: 0 where a product belongs to y, 1 to z; (i, j), or (i, -1) for r . D_i
    sign: np.ndarray       # float64 [P]
    axes: np.ndarray       # float64 [18 C], in a plane [12 C]: as of `JointConditions`
    value: np.ndarray      # float64 [C]: y of a LINE at t = 0, m
    place: np.ndarray      # int64 [C]: where the numbers of a coordinate stand in the history
    stiffness: np.ndarray  # float64 [C], N/m or N m/rad
    damping: np.ndarray    # float64 [C], N s/m or N m s/rad
    rest: np.ndarray       # float64 [C]: value without force of the spring, m or rad
    given: np.ndarray      # float64 [C]: mean force of the motor in a step, N or N m
    hold: np.ndarray       # float64 [64]: work


class Parts(NamedTuple):
    """y and z of a coordinate."""

    y: float
    z: float


class CoordinateGradient(NamedTuple):
    """Derivatives of a joint coordinate between two shapes by its sums y and z."""

    way: float             # Dx
    y: float               # g_y and g_z, Dx = g_y Dy + g_z Dz
    z: float
    yy: float              # their derivatives by y and z at the end
    yz: float
    zy: float
    zz: float
    end_y: float           # derivatives of x there
    end_z: float


@generic
def size_of_cross(x, y):
    """Return |x cross y|."""


@size_of_cross.register(V3[f8])
@kernel
def size_of_cross_in_space(x, y):
    z = cross(x, y)
    return np.sqrt(dot(z, z))


@size_of_cross.register(V2[f8])
@kernel
def size_of_cross_in_plane(x, y):
    return abs(cross2(x, y))


@kernel
def product_of(motion, c, m, dofs, q):
    """Return product m, of coordinate c, at coordinates q."""
    a = direction.call(dofs, motion, c, 0, motion.pair[m, 1], q)
    j = motion.pair[m, 2]
    if j < 0:
        return motion.sign[m] * dot(position(q, motion.node[c, 1], dofs) - position(q, motion.node[c, 0], dofs), a)
    return motion.sign[m] * dot(a, direction.call(dofs, motion, c, 1, j, q))


@kernel
def parts_of(motion, c, dofs, q):
    """Return `Parts` of coordinate c at coordinates q; y of a SWING is the sine."""
    y = 0.0
    z = 0.0
    for m in range(motion.start[c], motion.start[c + 1]):
        x = product_of(motion, c, m, dofs, q)
        if motion.pair[m, 0] == 0:
            y += x
        else:
            z += x
    if motion.kind[c] == SWING:
        y = size_of_cross.call(direction.call(dofs, motion, c, 0, 0, q), direction.call(dofs, motion, c, 1, 0, q))
    return Parts(y, z)


@kernel
def angle_over(p, q):
    """Return atan(p/q)/p and the derivative of it by p, with p/q of any size."""
    x = p / q
    if q > 0.0 and abs(x) < SMALL_TURN:
        y = x * x
        return (1.0 - y * (1.0 / 3.0 - y * (0.2 - y / 7.0))) / q, -x * (2.0 / 3.0 - y * (0.8 - y * 6.0 / 7.0)) / (q * q)
    share = np.arctan2(p, q) / p
    return share, (q / (p * p + q * q) - share) / p


@kernel
def gradient_of(motion, c, dofs, q0, q1):
    """Return `Grip` of coordinate c from coordinates q0 to q1. Where both are the same its derivatives are half of those of the
    slopes of x, as equilibria need them."""
    before = parts_of(motion, c, dofs, q0)
    after = parts_of(motion, c, dofs, q1)
    y0, z0, y1, z1 = before.y, before.z, after.y, after.z
    if motion.kind[c] == LINE:
        return CoordinateGradient(y1 - y0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    if motion.kind[c] == SWING:
        p, q = z1 - z0, max(y0 + y1, NO_SWING)
        share, slope = angle_over(p, q)
        sine = max(y1, NO_SWING)
        by_z = -2.0 * (slope + z1 / sine / (p * p + q * q))
        return CoordinateGradient(-2.0 * share * p, 0.0, -2.0 * share, 0.0, 0.0, 0.0, by_z, 0.0, -1.0 / sine)
    p, q = y1 * z0 - z1 * y0, y1 * y0 + z1 * z0
    share, slope = angle_over(p, q)
    by_q = -1.0 / (p * p + q * q)
    by_y, by_z = slope * z0 + by_q * y0, by_q * z0 - slope * y0
    y, z = 0.5 * (y0 + y1), 0.5 * (z0 + z1)
    n = y1 * y1 + z1 * z1
    return CoordinateGradient(share * p, share * z, -share * y, z * by_y, z * by_z + 0.5 * share, -y * by_y - 0.5 * share,
                              -y * by_z, z1 / n, -y1 / n)


# --- values --------------------------------------------------------------------------------------------------------------
@kernel
def value_of(motion, c, dofs, q, before):
    """Return coordinate c at coordinates q; for an angle the value next to `before`."""
    found = parts_of(motion, c, dofs, q)
    if motion.kind[c] == LINE:
        return found.y - motion.value[c]
    angle = np.arctan2(found.y, found.z)
    if motion.kind[c] == SWING:
        return angle
    return angle + 2.0 * np.pi * np.floor((before - angle) / (2.0 * np.pi) + 0.5)


@kernel
def missing(motion, c, dofs, q, target):
    """Return coordinate c at coordinates q less `target`; for an angle the nearest of all turns."""
    found = parts_of(motion, c, dofs, q)
    if motion.kind[c] == LINE:
        return (found.y - motion.value[c]) - target
    u, w = np.cos(target), np.sin(target)
    return np.arctan2(found.y * u - found.z * w, found.z * u + found.y * w)


@kernel
def rate_of(motion, c, dofs, q, v):
    """Return the rate of coordinate c, m/s or rad/s."""
    a, b = motion.node[c, 0], motion.node[c, 1]
    y = 0.0
    z = 0.0
    for m in range(motion.start[c], motion.start[c + 1]):
        i, j = motion.pair[m, 1], motion.pair[m, 2]
        own, moving = direction.call(dofs, motion, c, 0, i, q), direction.call(dofs, motion, c, 0, i, v)
        if j < 0:
            x = dot(position(v, b, dofs) - position(v, a, dofs), own) + dot(position(q, b, dofs) - position(q, a, dofs), moving)
        else:
            x = dot(direction.call(dofs, motion, c, 1, j, v), own) + dot(direction.call(dofs, motion, c, 1, j, q), moving)
        if motion.pair[m, 0] == 0:
            y += motion.sign[m] * x
        else:
            z += motion.sign[m] * x
    if motion.kind[c] == LINE:
        return y
    found = parts_of(motion, c, dofs, q)
    if motion.kind[c] == SWING:
        return -z / max(found.y, NO_SWING)
    return (found.z * y - found.y * z) / (found.y * found.y + found.z * found.z)


# --- forces --------------------------------------------------------------------------------------------------------------
@kernel
def add_gradient(motion, c, m, dofs, q, o):
    """Add the gradient of product m at coordinates q to `hold` from o on: position and spin of a, then from o + 8 on of b."""
    d = dim(dofs)
    sign, i, j = motion.sign[m], motion.pair[m, 1], motion.pair[m, 2]
    a = direction.call(dofs, motion, c, 0, i, q)
    if j < 0:
        r = position(q, motion.node[c, 1], dofs) - position(q, motion.node[c, 0], dofs)
        add_to(motion.hold, o, 1, -sign * a)
        add_to(motion.hold, o + d, 1, sign * cross_product.call(a, r))
        add_to(motion.hold, o + 8, 1, sign * a)
    else:
        turning = cross_product.call(a, direction.call(dofs, motion, c, 1, j, q))
        add_to(motion.hold, o + d, 1, sign * turning)
        add_to(motion.hold, o + 8 + d, 1, -sign * turning)


@kernel
def add_products(motion, c, system, left, right, factor):
    """Add factor times the products of the patterns in `hold` from `left` and from `right` on to the blocks of coordinate c."""
    n = len(system.dofs)
    for e in range(4):
        o = 8 * n * motion.block[c, e]
        row = left + 8 * (e // 2)
        column = right + 8 * (e % 2)
        for i in range(n):
            for j in range(n):
                system.work.blocks[o + 8 * i + j] += factor * motion.hold[row + i] * motion.hold[column + j]


@kernel
def push_parts(motion, c, system, by_y, by_z, slopes):
    """Add forces `by_y` and `by_z` on the sums of coordinate c; slopes [4]: their derivatives by both at the end, yy, yz, zy,
    zz."""
    work, dofs = system.work, system.dofs
    for i in range(64):
        motion.hold[i] = 0.0
    for m in range(motion.start[c], motion.start[c + 1]):
        of_z = motion.pair[m, 0]
        force = motion.sign[m] * (by_z if of_z else by_y)
        i, j = motion.pair[m, 1], motion.pair[m, 2]
        if j < 0:
            push_along(motion, system, c, i, force)
        else:
            turn_against(motion, system, c, i, j, force)
        add_gradient(motion, c, m, dofs, work.q_mid, 16 * of_z)
        add_gradient(motion, c, m, dofs, work.q_end, 32 + 16 * of_z)
    for e in range(4):
        if slopes[e] != 0.0:
            add_products(motion, c, system, 16 * (e // 2), 32 + 16 * (e % 2), -slopes[e])


@kernel
def push(motion, c, system, gradient, force, slope):
    """Add a force on coordinate c, and its derivative by the coordinate at the end of the step."""
    by_y, by_z = slope * gradient.end_y, slope * gradient.end_z
    slopes = (force * gradient.yy + by_y * gradient.y, force * gradient.yz + by_z * gradient.y,
              force * gradient.zy + by_y * gradient.z, force * gradient.zz + by_z * gradient.z)
    push_parts(motion, c, system, force * gradient.y, force * gradient.z, slopes)


@kernel
def gradient_in_step(motion, c, system):
    """Return `Grip` of coordinate c in this step."""
    return gradient_of(motion, c, system.dofs, system.state.q, system.work.q_end)


@kernel
def gradient_at_rest(motion, c, system):
    """Return `Grip` of coordinate c in an equilibrium."""
    return gradient_of(motion, c, system.dofs, system.work.q_end, system.work.q_end)


@kernel
def put_entries(term, c, system, k, p, share, by_end):
    """Add column and line of force p of constraint k, which acts on coordinate c: `share` times a force on it, and `by_end` times
    the derivative of its value at the end; both may be zero, the rows that it touches are the same."""
    motion, contact, work, dofs = term.motion, system.contact, system.work, system.dofs
    gradient = gradient_in_step(motion, c, system)
    for m in range(motion.start[c], motion.start[c + 1]):
        i, j = motion.pair[m, 1], motion.pair[m, 2]
        push_m = share * motion.sign[m] * (gradient.z if motion.pair[m, 0] else gradient.y)
        end_m = by_end * motion.sign[m] * (gradient.end_z if motion.pair[m, 0] else gradient.end_y)
        one, two = system.row_of[motion.spin_node[c, 0]], system.row_of[motion.spin_node[c, 1]]
        mid = direction.call(dofs, motion, c, 0, i, work.q_mid)
        end = direction.call(dofs, motion, c, 0, i, work.q_end)
        if j >= 0:
            turning = cross_product.call(mid, direction.call(dofs, motion, c, 1, j, work.q_mid))
            at_end = cross_product.call(end, direction.call(dofs, motion, c, 1, j, work.q_end))
            put_spin(contact, k, p, one, -push_m * turning, end_m * at_end, dofs)
            put_spin(contact, k, p, two, push_m * turning, -end_m * at_end, dofs)
        else:
            a, b = motion.node[c, 0], motion.node[c, 1]
            r_mid = position(work.q_mid, b, dofs) - position(work.q_mid, a, dofs)
            r_end = position(work.q_end, b, dofs) - position(work.q_end, a, dofs)
            put_on_end.call(term.ties, motion, system, k, p, c, 1, -push_m * mid, end_m * end)
            put_on_end.call(term.ties, motion, system, k, p, c, 0, push_m * mid, -end_m * end)
            put_spin(contact, k, p, one, -push_m * cross_product.call(mid, r_mid), end_m * cross_product.call(end, r_end), dofs)
