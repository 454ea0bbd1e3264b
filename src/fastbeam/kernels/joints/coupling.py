"""Couplings of two coordinates of joints with axes, of screws and gears, theory.md 4: one linear relation with one multiplier.

    a x + b y = 0,     forces a mu on x and b mu on y                                                                   (4.36)

The coordinates x and y are zero at t = 0, angles are counted over turns. Both forces act as in forces.py, so that their work is
mu (a Dx + b Dy), which vanishes.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.contact.point_entries import begin_joint, is_closed, take_forces_of
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.joints.coordinates import VALUE, JointMotion, gradient_in_step, missing, push, put_entries
from fastbeam.kernels.joints.drives import round_off_of
from fastbeam.kernels.terms import Conserving, Equilibrium, WithContact, assemble, first_guess, is_settled, take_unknowns


class JointCouplings(NamedTuple):
    """D relations between two coordinates each."""

    motion: JointMotion
    which: np.ndarray      # int64 [D, 2]: of the coordinates of `motion`
    factor: np.ndarray     # float64 [D, 2]: a and b, 1, m/rad or rad/m
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


JointCouplings.reads = WithContact  # type: ignore[attr-defined]


@first_guess.register(JointCouplings)
@kernel
def begin_couplings(term, system, h, c):
    for i in range(term.which.shape[0]):
        system.contact.before[term.first[0] + i] = np.inf


@assemble.register(JointCouplings, Conserving)
@assemble.register(JointCouplings, Equilibrium)
@kernel
def assemble_couplings(term, method, system, h):
    motion, contact, state = term.motion, system.contact, system.state
    for i in range(term.which.shape[0]):
        k = term.first[0] + i
        begin_joint(contact, k, 1)
        force = state.force[contact.first_force[k]]
        # increments are small beside values of many turns, and are summed apart from them
        before = 0.0
        ways = 0.0
        for side in range(2):
            c, factor = term.which[i, side], term.factor[i, side]
            push(motion, c, system, gradient_in_step(motion, c, system), factor * force, 0.0)
            put_entries(term, c, system, k, 0, factor, factor)
            value = state.history[motion.place[c] + VALUE]
            before += factor * value
            ways += factor * missing(motion, c, system.dofs, system.work.q_end, value)
        contact.residual[k, 0] = before + ways


@is_settled.register(JointCouplings)
@kernel
def couplings_are_closed(term, system):
    settled = True
    for i in range(term.which.shape[0]):
        allowed = 0.0
        for side in range(2):
            allowed += abs(term.factor[i, side]) * round_off_of(term.motion, term.which[i, side], system)
        settled = is_closed(system.contact, term.first[0] + i, allowed) and settled
    return settled


@take_unknowns.register(JointCouplings)
@kernel
def take_couplings(term, system):
    take_forces_of(term.first[0], term.which.shape[0], system)
