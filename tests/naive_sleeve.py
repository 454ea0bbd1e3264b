"""A slow twin of the conserving step with sleeves in plain NumPy, built on `naive.py`: one short function an equation.

A sleeve holds a point of a beam and the direction of its section there: its holder, a body or a node of another beam, with the
triad D_1, D_2, D_3, sits at arc length s, D_1 along the beam. Every condition is a sum of a basis along the beam and of quadratic
invariants of a holder and a node, c = sum_A N_A(s) pi_A(q), and all of them share one discrete gradient.
"""
from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from naive import Step, Twin, beam_strains, increments, skew
from naive_methods import newton, spins

from fastbeam.scene import Beam, Scene
from fastbeam.scene.interpolation.averaged_curves import averaged_curve
from fastbeam.scene.interpolation.basis import CurveBasis

Array = np.ndarray
Ends = tuple[Array, Array]  # the same quantity at the start and at the end of a step


@dataclass(frozen=True, eq=False)
class Sleeve:
    """`holder`, a body or a node of another beam, slides on `beam` from arc length `at` on. D_i = sum_k turn_ik d_k of the
    holder; keyed: the twist is held, too."""

    holder: Any
    beam: Beam
    at: float
    keyed: bool = True
    curve: str = "c1"
    bore: float = 0.0
    turn: Array = field(default_factory=lambda: np.eye(3))

    @property
    def pairs(self) -> list[list[tuple[float, int, int]]]:
        """(factor, i, j), counted from 0, of the products D_i . d_j(s) in every condition."""
        return [[(1.0, 0, 1)], [(1.0, 0, 2)]] + [[(0.5, 1, 2), (-0.5, 2, 1)]] * self.keyed

    @cached_property
    def basis(self) -> CurveBasis:
        """The basis of positions and directors along the beam, averaged over the bore where there is one."""
        return averaged_curve(self.beam.basis, self.bore) if self.bore else self.beam.basis.curve(self.curve)

    @lru_cache(maxsize=64)  # noqa: B019
    def shape(self, s: float, slope: bool = False) -> Array:
        """N_A(s) of all nodes of the beam, or its slope."""
        first, *tables = self.basis.evaluate(s)
        out = np.zeros(self.beam.n_nodes + tables[0].shape[1])
        out[first[0]:first[0] + tables[0].shape[1]] = tables[slope][0]
        return out[:self.beam.n_nodes]

    @lru_cache(maxsize=64)  # noqa: B019
    def divided_difference(self, s0: float, s1: float) -> Array:
        """N[s0, s1] by Gauss quadrature of the slope, split at the element ends in between; theory.md (5.3)."""
        if s0 == s1:
            return self.shape(s0, slope=True)
        ends = self.basis.element_ends
        inner = np.sort(ends[(ends > min(s0, s1)) & (ends < max(s0, s1))])
        cuts = [s0, *(inner if s1 > s0 else inner[::-1]), s1]
        x, w = np.polynomial.legendre.leggauss(self.basis.coef.shape[2])
        return sum(0.5 * b * (right - left) / (s1 - s0) * self.shape(left + 0.5 * (1.0 + a) * (right - left), slope=True)
                   for left, right in pairwise(cuts) for a, b in zip(x, w))


# ---------------------------------------------------------------------------------------------------- conditions and forces
def invariants(sleeve: Sleeve, x: Array, triad: Array, phi: Array, d: Array) -> Array:
    """pi_A [n, 3 + pairs]: D_k . (x - phi_A) for k = 1 to 3, then sums of D_i . d_jA."""
    across = [sum(f * d[:, j] @ triad[i] for f, i, j in some)[:, None] for some in sleeve.pairs]
    return np.concatenate(((x - phi) @ triad.T, *across), axis=1)


def sleeve_forces(sleeve: Sleeve, m: Array, n_mean: Array, x: Array, triad: Array, phi: Array, d: Array) -> tuple[Array, Array]:
    """Forces of multipliers m on the holder [4, 3] and on the nodes of the beam [n, 4, 3], sum_A m Nbar_A grad pi_A at the mean
    coordinates."""
    holder, nodes = np.zeros((4, 3)), np.zeros((len(phi), 4, 3))
    force = m[:3] @ triad
    holder[0], nodes[:, 0] = force, -np.outer(n_mean, force)
    holder[1:] = np.outer(m[:3], x - n_mean @ phi)
    for mu, i, j in ((mu * f, i, j) for mu, some in zip(m[3:], sleeve.pairs) for f, i, j in some):
        holder[1 + i] += mu * (n_mean @ d[:, j])
        nodes[:, 1 + j] += mu * np.outer(n_mean, triad[i])
    holder[1:] = sleeve.turn.T @ holder[1:]
    return holder, nodes


def sliding(m: Array, n_divided: Array, pi: Ends) -> float:
    """m . sum_A N[s0, s1]_A mean(pi_A)."""
    return float(m @ (n_divided @ (0.5 * (pi[0] + pi[1]))))


# ------------------------------------------------------------------------------------------------------------ the whole scene
@dataclass(frozen=True)
class State:
    """Coordinates and rates [N, 4, 3], s [S] and the multipliers of the last step, [3 + pairs] of every sleeve in a row."""

    q: Array
    v: Array
    s: Array
    m: Array

    def reversed(self) -> State:
        """The same with the opposite rates."""
        return State(self.q, -self.v, self.s, self.m)


class SleeveTwin(Twin):
    """All equations of a scene with sleeves instead of sliders."""

    def __init__(self, scene: Scene, model: Any, *sleeves: Sleeve) -> None:
        super().__init__(scene, model)
        self.sleeves = sleeves
        self.rows = np.cumsum([0] + [3 + len(sleeve.pairs) for sleeve in sleeves])

    def parts(self, sleeve: Sleeve, q: Array) -> tuple[Array, Array, Array, Array]:
        """x, D_i of the holder and phi_A, d_jA of the beam."""
        holder, at = self.number(sleeve.holder), self.of_beam(sleeve.beam)
        return q[holder, 0], sleeve.turn @ q[holder, 1:], q[at, 0], q[at, 1:]

    def conditions(self, q: Array, s: Array) -> Array:
        """c = sum_A N_A(s) pi_A of all sleeves."""
        return np.concatenate([x.shape(at) @ invariants(x, *self.parts(x, q)) for x, at in zip(self.sleeves, s)])

    def step_residual(self, step: Step, m: Array) -> Array:
        """Free nodes, conditions at the end of the step, one equation of sliding a sleeve."""
        dq = self.connected(increments(step.q_n, step.dphi, step.theta))
        q_n1, q_mid = step.q_n + dq, step.q_n + 0.5 * dq
        inertia = self.mass @ (2.0 / step.h**2 * (dq - step.h * step.v_n)).reshape(4 * self.n, 3)
        f = inertia.reshape(self.n, 4, 3) + self.beam_forces(step.q_n, q_n1) - self.load_forces(q_mid, *self.dead_loads())
        slide = []
        for k, sleeve in enumerate(self.sleeves):
            n_mean = 0.5 * (sleeve.shape(step.s_n[k]) + sleeve.shape(step.s_end[k]))
            own = m[self.rows[k]:self.rows[k + 1]]
            holder, nodes = sleeve_forces(sleeve, own, n_mean, *self.parts(sleeve, q_mid))
            f[self.number(sleeve.holder)] -= holder
            f[self.of_beam(sleeve.beam)] -= nodes
            pi = invariants(sleeve, *self.parts(sleeve, step.q_n)), invariants(sleeve, *self.parts(sleeve, q_n1))
            slide.append(sliding(own, sleeve.divided_difference(step.s_n[k], step.s_end[k]), pi))
        return np.concatenate((self.reduced(q_mid, f)[self.free], self.conditions(q_n1, step.s_end), slide))

    def unpack(self, z: Array) -> tuple[Array, Array, Array]:
        """Moves (D phi, theta) [N, 6], multipliers, s at the end of the step."""
        x, n = np.zeros((self.n, 6)), int(self.free.sum())
        x[self.free] = z[:n]
        return x, z[n:n + self.rows[-1]], z[n + self.rows[-1]:]

    def advance(self, state: State, h: float, tangent: Array | None = None) -> tuple[State, Array]:
        """One conserving step from a first guess of the tangent; also the last tangent."""
        def residual(z: Array) -> Array:
            x, m, s_end = self.unpack(z)
            return self.step_residual(Step(state.q, state.v, x[:, :3], x[:, 3:], state.s, s_end, np.zeros((0, 3)), h), m)

        turn = h * spins(state.q, state.v)  # a first guess without strain where the rates have none
        move = [np.linalg.solve(np.eye(3) - 0.5 * skew(a), h * v) for a, v in zip(turn, state.v[:, 0])]
        move = np.concatenate((move, turn), axis=1)
        s = state.s + h * self.sliding_rates(state)
        z, tangent = newton(residual, np.concatenate((move[self.free], state.m, s)), tangent)
        x, m, s_end = self.unpack(z)
        dq = self.connected(increments(state.q, x[:, :3], x[:, 3:]))
        return State(state.q + dq, state.v + 2.0 / h * (dq - h * state.v), s_end, m), tangent

    def sliding_rates(self, state: State) -> Array:
        """ds/dt from the least squares of v_S - sum N_A v_A = c' ds/dt; theory.md 5.4."""
        rates = []
        for sleeve, s in zip(self.sleeves, state.s):
            x_t, _, phi_t, _ = self.parts(sleeve, state.v)
            tangent = sleeve.shape(s, slope=True) @ self.parts(sleeve, state.q)[2]
            rates.append((x_t - sleeve.shape(s) @ phi_t) @ tangent / (tangent @ tangent))
        return np.array(rates)

    def run(self, state: State, h: float, steps: int) -> list[State]:
        """All states of a run."""
        out, tangent = [state], None
        for _ in range(steps):
            state, tangent = self.advance(state, h, tangent)
            out.append(state)
        return out

    def consistent(self, state: State) -> State:
        """The rates nearest to those of the state, in the kinetic energy, that keep all conditions; theory.md 5.4."""
        n, eps, k = int(self.free.sum()), 1e-6, len(self.sleeves)

        def rates(y: Array) -> Array:
            x = self.unpack(np.concatenate((y, np.zeros(self.rows[-1] + k))))[0]
            return self.connected(np.concatenate((x[:, None, :3], np.cross(x[:, None, 3:], state.q[:, 1:])), axis=1))

        def slope(along: Array, s_t: Array) -> Array:  # conditions are cubic in a move along straight rates: exact to eps^2
            after, before = (self.conditions(state.q + x * along, state.s + x * s_t) for x in (eps, -eps))
            return (after - before) / (2.0 * eps)

        basis = np.array([rates(y).reshape(4 * self.n, 3) for y in np.eye(n)])
        mass = np.einsum("xac,ab,ybc->xy", basis, self.mass, basis)
        given = np.einsum("xac,ab,bc->x", basis, self.mass, state.v.reshape(4 * self.n, 3))
        rows = np.array([slope(x.reshape(-1, 4, 3), np.zeros(k)) for x in basis] + [slope(0 * state.q, y) for y in np.eye(k)]).T
        matrix = np.zeros((n + k + len(rows),) * 2)
        matrix[:n, :n], matrix[n + k:, :n + k], matrix[:n + k, n + k:] = mass, rows, rows.T
        y = np.linalg.solve(matrix, np.concatenate((given, np.zeros(k + len(rows)))))
        return State(state.q, rates(y[:n]), state.s, state.m)

    # --- what a run keeps
    def kinetic(self, state: State) -> float:
        """1/2 v . M v."""
        v = state.v.reshape(4 * self.n, 3)
        return 0.5 * float(np.einsum("ac,ab,bc", v, self.mass, v))

    def energy(self, state: State) -> float:
        """Kinetic, strain and load energy."""
        total = self.kinetic(state) - np.sum(self.dead_loads()[0] * state.q[:, 0])
        for beam in self.scene.beams:
            nodes = beam.basis.element_nodes
            strains = beam_strains(beam, state.q[self.of_beam(beam)][nodes])
            strains = strains - beam_strains(beam, self.reference[beam.name][nodes])
            total += 0.5 * np.einsum("eg,egi,ij,egj", beam.basis.weight, strains, beam.section.C, strains)
        return float(total)

    def momenta(self, state: State) -> Array:
        """Linear and angular momentum, [6]; theory.md (4.3)."""
        p = (self.mass @ state.v.reshape(4 * self.n, 3)).reshape(self.n, 4, 3)
        return np.concatenate((p[:, 0].sum(axis=0), np.cross(state.q, p).sum(axis=(0, 1))))


def start(twin: SleeveTwin, model: Any) -> State:
    """The state that a scene starts from."""
    v = model.v0.reshape(-1, 4, 3)
    return State(twin.q0.copy(), v.copy(), np.array([x.at for x in twin.sleeves]), np.zeros(twin.rows[-1]))


class CurveFrameTwin(SleeveTwin):
    """The step of the package: the contact force of a sleeve is that of a slider, in a frame that turns with the curve
    (theory.md 5.1), only the moments are those of the triad of the holder."""

    def step_residual(self, step: Step, m: Array) -> Array:
        """As `SleeveTwin.step_residual`; m: force in space, then moments, of every sleeve."""
        dq = self.connected(increments(step.q_n, step.dphi, step.theta))
        q_n1, q_mid = step.q_n + dq, step.q_n + 0.5 * dq
        inertia = self.mass @ (2.0 / step.h**2 * (dq - step.h * step.v_n)).reshape(4 * self.n, 3)
        f = inertia.reshape(self.n, 4, 3) + self.beam_forces(step.q_n, q_n1) - self.load_forces(q_mid, *self.dead_loads())
        turning = np.zeros((self.n, 6))
        gaps, slide = [], []
        for k, sleeve in enumerate(self.sleeves):
            n_mean = 0.5 * (sleeve.shape(step.s_n[k]) + sleeve.shape(step.s_end[k]))
            divided = sleeve.divided_difference(step.s_n[k], step.s_end[k])
            at = self.of_beam(sleeve.beam)
            force, moments = np.split(m[self.rows[k]:self.rows[k + 1]], [3])
            x, triad, phi, d = self.parts(sleeve, q_mid)
            holder, nodes = sleeve_forces(sleeve, np.concatenate((np.zeros(3), moments)), n_mean, x, triad, phi, d)
            f[self.number(sleeve.holder)] -= holder
            f[at] -= nodes
            f[self.number(sleeve.holder), 0] -= force
            f[at, 0] += np.outer(n_mean, force)
            turning[at, 3:] += np.outer(n_mean, np.cross(x - n_mean @ phi, force))
            first, last = (divided @ q[at, 0] for q in (step.q_n, q_n1))
            frame = n_mean @ step.theta[at]
            pi = [invariants(sleeve, *self.parts(sleeve, q))[:, 3:] for q in (step.q_n, q_n1)]
            slide.append(0.5 * force @ (first + last) + 0.25 * np.cross(frame, force) @ (last - first)
                         - sliding(moments, divided, (pi[0], pi[1])))
            x, triad, phi, d = self.parts(sleeve, q_n1)
            own = invariants(sleeve, x, triad, phi, d)
            own[:, :3] = x - phi
            gaps.append(sleeve.shape(step.s_end[k]) @ own)
        return np.concatenate(((self.reduced(q_mid, f) + turning)[self.free], *gaps, slide))
