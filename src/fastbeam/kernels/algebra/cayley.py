"""Finite turns by Cayley vectors, d_n+1 = cay(theta) d_n (theory.md (4.2)), of one node or of 8 in lanes."""
from __future__ import annotations

from fastbeam.kernels.algebra.vectors import cross, dot, perp, root
from fastbeam.kernels.jit.decorators import kernel


@kernel
def director_increment(c, t, d):
    """Return cay(t) d - d without cancellation; c = 1/(1 + t . t/4)."""
    x = cross(t, d)
    return c * (x + 0.5 * cross(t, x))


@kernel
def cayley_increment(t, turn):
    """Change of a Cayley vector by a small spin of the end: d theta = (I - 1/2 theta^ + 1/4 theta theta^T) delta phi."""
    return turn - 0.5 * cross(t, turn) + (0.25 * dot(t, turn)) * t


@kernel
def planar_turn(t, u):
    """Return increment of a director for a Cayley number: cay(t) u - u without cancellation."""
    return (t / (1.0 + 0.25 * t * t)) * (perp(u) - (0.5 * t) * u)


@kernel
def turned_back(own, along):
    """Return the inverse of the rotation by which a small spin phi has changed the Cayley vector of a step to theta, in lanes:
    (y, g) such that it adds g (phi x (phi x d) / 2 - y phi x d) to a vector d. own = phi . phi, along = theta . phi.

    With theta before, the turn from one to the other has the Cayley vector phi/y, y = 1 + a/4, a = theta_before . phi, and
    along = a + own + a^2/4. That has two solutions, a > -2 is taken: the other one belongs to increments that bring a triad back
    by more than it had turned, in steps that turn it by more than a right angle.
    """
    y = 0.5 + 0.5 * root(1.0 + along - own)
    return y, 1.0 / (y * y + 0.25 * own)
