"""Slow twins of all time integration methods in plain NumPy, built on `naive.py`: one short function per equation, theory.md 7.

The methods share the semi-discrete equations P(q)^T [M q'' + int B^T S ds - f_ext - contact forces] = 0 and differ in where they
are put: the conserving step and the midpoint rule in the increments of a step, the others at its end with accelerations as state.
Here a step is solved by a dense Newton iteration whose tangent is a difference quotient.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from naive import Step, Twin, curve_of, increments, skew
from numpy.polynomial import legendre

from fastbeam.scene import Slider

Array = np.ndarray
METHODS = ("energy_momentum", "midpoint", "trapezoidal", "generalized_alpha")


@dataclass(frozen=True)
class Motion:
    """Where a run stands: t, q and rates v [N, 4, 3], s [S], contact forces of the last step [S, 3]; of the methods with
    accelerations also vel = (phi_t, omega), acc = a and vdot [N, 6]."""

    t: float
    q: Array
    v: Array
    s: Array
    force: Array
    vel: Array | None = None
    acc: Array | None = None
    vdot: Array | None = None


@dataclass(frozen=True)
class Parameters:
    """alpha_m, alpha_f, beta, gamma of an alpha method; theory.md (7.2)."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float


def generalized_alpha(rho_inf: float) -> Parameters:
    """Chung and Hulbert's parameters for a spectral radius rho_inf at infinite frequency."""
    alpha_m, alpha_f = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0), rho_inf / (rho_inf + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return Parameters(alpha_m, alpha_f, 0.25 * (gamma + 0.5)**2, gamma)


TRAPEZOIDAL = Parameters(0.0, 0.0, 0.25, 0.5)


def parameters(method: str, rho_inf: float | None) -> Parameters:
    """Those of a method with accelerations."""
    return generalized_alpha(rho_inf) if method == "generalized_alpha" else TRAPEZOIDAL


# ------------------------------------------------------------------------------------------------------------- rotations
def exponential(psi: Array) -> Array:
    """Rotation about psi by |psi| (Rodrigues), with the series of both factors near zero."""
    x = float(psi @ psi)
    angle = np.sqrt(x)
    a, b = (np.sin(angle) / angle, (1.0 - np.cos(angle)) / x) if x > 1e-4 else (1.0 - x / 6.0 + x**2 / 120.0,
                                                                                0.5 - x / 24.0 + x**2 / 720.0)
    return np.eye(3) + a * skew(psi) + b * skew(psi) @ skew(psi)


def rotated(q: Array, x: Array) -> Array:
    """Nodes moved by x = (D phi, psi) [N, 6]: R_n+1 = exp(psi) R_n with the directors as columns of R."""
    turn = np.array([exponential(psi) for psi in x[:, 3:]])
    return np.concatenate((q[:, :1] + x[:, None, :3], np.einsum("nij,nkj->nki", turn, q[:, 1:])), axis=1)


def rates(q: Array, vel: Array) -> Array:
    """Rates of the coordinates: phi_t and d_i,t = omega x d_i."""
    return np.concatenate((vel[:, None, :3], np.cross(vel[:, None, 3:], q[:, 1:])), axis=1)


def second_rates(q: Array, vel: Array, vdot: Array) -> Array:
    """q'': phi_tt and d_i,tt = omega_t x d_i + omega x (omega x d_i)."""
    d = q[:, 1:]
    omega, omega_t = vel[:, None, 3:], vdot[:, None, 3:]
    return np.concatenate((vdot[:, None, :3], np.cross(omega_t, d) + np.cross(omega, np.cross(omega, d))), axis=1)


def spins(q: Array, v: Array) -> Array:
    """omega = 1/2 sum d_i x d_i,t of every node."""
    return 0.5 * np.cross(q[:, 1:], v[:, 1:]).sum(axis=1)


# --------------------------------------------------------------------------------------------------------------- sliders
@lru_cache(maxsize=32)
def curve_shape(slider: Slider, s: float, derivative: int = 0) -> Array:
    """d^k N~_A / ds^k of all nodes of the slider's beam, from the Legendre coefficients of its element."""
    curve = curve_of(slider)
    e = int(np.clip(np.searchsorted(curve.element_ends, s, side="right") - 1, 0, curve.first_node.size - 1))
    left, right = curve.element_ends[e:e + 2]
    slopes = legendre.legder(curve.coef[e], derivative, axis=1) * (2.0 / (right - left))**derivative
    values = legendre.legval(2.0 * (s - left) / (right - left) - 1.0, slopes.T)
    out = np.zeros(slider.beam.n_nodes)
    out[curve.first_node[e] + np.arange(curve.n_nodes_of[e])] = values[:curve.n_nodes_of[e]]
    return out


def sliding_rate(twin: Twin, slider: Slider, s: float, q: Array, v: Array) -> float:
    """ds/dt from the least squares of v_S - sum N_A v_A = c' ds/dt; theory.md 5.4."""
    at, point = twin.of_beam(slider.beam), twin.number(slider.point)
    tangent = curve_shape(slider, s, 1) @ q[at, 0]
    return float((v[point, 0] - curve_shape(slider, s) @ v[at, 0]) @ tangent / (tangent @ tangent))


def contact_forces(twin: Twin, slider: Slider, s: float, force: Array) -> Array:
    """+F on the point and -N_A(s) F on node A, without a moment, [N, 4, 3]."""
    f = np.zeros((twin.n, 4, 3))
    f[twin.number(slider.point), 0] += force
    f[twin.of_beam(slider.beam), 0] -= np.outer(curve_shape(slider, s), force)
    return f


def gap(twin: Twin, slider: Slider, s: float, q: Array) -> Array:
    """phi_S - sum N_A(s) phi_A, [3]."""
    return q[twin.number(slider.point), 0] - curve_shape(slider, s) @ q[twin.of_beam(slider.beam), 0]


def sliding(twin: Twin, slider: Slider, s: float, force: Array, q: Array) -> float:
    """F . sum N'_A(s) phi_A."""
    return float(force @ (curve_shape(slider, s, 1) @ q[twin.of_beam(slider.beam), 0]))


def contacts(twin: Twin, s: Array, q: Array, s_end: Array, q_end: Array, force: Array) -> tuple[Array, Array]:
    """Forces [N, 4, 3] and equations [S, 4] of all sliders: force and sliding direction at the instant of s and q, the gap at
    the end of the step."""
    f, equations = np.zeros((twin.n, 4, 3)), np.zeros((s.size, 4))
    for k, slider in enumerate(twin.scene.sliders):
        f += contact_forces(twin, slider, s[k], force[k])
        equations[k] = np.append(gap(twin, slider, s_end[k], q_end), sliding(twin, slider, s[k], force[k], q))
    return f, equations


# ---------------------------------------------------------------------------------------------------------- midpoint rule
def midpoint_residual(twin: Twin, step: Step, factor: Callable) -> tuple[Array, Array]:
    """Nodes [N, 6] and sliders [S, 4] of a midpoint step: S = C E(q_mid) and the contact in the middle; theory.md (7.1)."""
    dq = twin.connected(increments(step.q_n, step.dphi, step.theta))
    q_mid = step.q_n + 0.5 * dq
    inertia = twin.mass @ (2.0 / step.h**2 * (dq - step.h * step.v_n)).reshape(4 * twin.n, 3)
    pull, equations = contacts(twin, 0.5 * (step.s_n + step.s_end), q_mid, step.s_end, step.q_n + dq, step.force)
    f = inertia.reshape(twin.n, 4, 3) + twin.beam_forces(q_mid, q_mid) - pull
    f -= twin.load_forces(q_mid, *twin.dead_loads(factor))
    return twin.reduced(q_mid, f), equations


# ----------------------------------------------------------------------------------------------------------- alpha methods
def at_time(t: float) -> Callable:
    """Factor of a time function at one time."""
    return lambda time: 1.0 if time is None else float(time(t))


def mean_over(t: float, h: float) -> Callable:
    """Mean factor of a time function over a step, three Gauss points; theory.md (4.4)."""
    x, w = np.polynomial.legendre.leggauss(3)
    return lambda time: 1.0 if time is None else float(sum(0.5 * b * time(t + 0.5 * h * (1.0 + a)) for a, b in zip(x, w)))


def end_of_step(p: Parameters, m: Motion, x: Array, h: float) -> tuple[Array, Array, Array]:
    """a, v and vdot at the end of a step from its increment x = (D phi, psi), [N, 6] each; theory.md (7.2)."""
    a = (x - h * m.vel - h**2 * (0.5 - p.beta) * m.acc) / (h**2 * p.beta)
    vel = m.vel + h * (1.0 - p.gamma) * m.acc + h * p.gamma * a
    vdot = ((1.0 - p.alpha_m) * a + p.alpha_m * m.acc - p.alpha_f * m.vdot) / (1.0 - p.alpha_f)
    return a, vel, vdot


def inertia_forces(twin: Twin, q: Array, vel: Array, vdot: Array) -> Array:
    """M q'' with the coordinates of tied nodes linear in the others, [N, 4, 3]."""
    return (twin.mass @ twin.connected(second_rates(q, vel, vdot)).reshape(4 * twin.n, 3)).reshape(twin.n, 4, 3)


def alpha_residual(twin: Twin, p: Parameters, m: Motion, x: Array, s_end: Array, force: Array, h: float) -> tuple[Array, Array]:
    """Equilibrium at the end of a step: nodes [N, 6] and sliders [S, 4]; theory.md (7.3)."""
    q = twin.connected(rotated(m.q, x))
    _, vel, vdot = end_of_step(p, m, x, h)
    pull, equations = contacts(twin, s_end, q, s_end, q, force)
    f = inertia_forces(twin, q, vel, vdot) + twin.beam_forces(q, q) - pull
    f -= twin.load_forces(q, *twin.dead_loads(at_time(m.t + h)))
    return twin.reduced(q, f), equations


def gap_acceleration(twin: Twin, slider: Slider, s: float, s_t: float, s_tt: float, q: Array, v: Array, q_tt: Array) -> Array:
    """Second time derivative of phi_S - sum N_A(s) phi_A, [3]."""
    at, point = twin.of_beam(slider.beam), twin.number(slider.point)
    n, n_s, n_ss = (curve_shape(slider, s, k) for k in range(3))
    return (q_tt[point, 0] - n @ q_tt[at, 0] - 2.0 * s_t * (n_s @ v[at, 0]) - s_t**2 * (n_ss @ q[at, 0])
            - s_tt * (n_s @ q[at, 0]))


def initial_accelerations(twin: Twin, t: float, q: Array, v: Array, s: Array) -> tuple[Array, Array]:
    """vdot [N, 6] and contact forces [S, 3] that satisfy equilibrium, the second derivative of the gaps and F . c' = 0 at t."""
    vel = np.where(twin.free, np.concatenate((v[:, 0], spins(q, v)), axis=1), 0.0)
    given = twin.beam_forces(q, q) - twin.load_forces(q, *twin.dead_loads(at_time(t)))
    n, n_s = int(twin.free.sum()), s.size
    slide = [sliding_rate(twin, slider, s[k], q, v) for k, slider in enumerate(twin.scene.sliders)]

    def residual(y: Array) -> Array:
        vdot = np.zeros((twin.n, 6))
        vdot[twin.free] = y[:n]
        force, s_tt = y[n:n + 3 * n_s].reshape(-1, 3), y[n + 3 * n_s:]
        f = given + inertia_forces(twin, q, vel, vdot)
        q_tt = twin.connected(second_rates(q, vel, vdot))
        lines = []
        for k, slider in enumerate(twin.scene.sliders):
            f = f - contact_forces(twin, slider, s[k], force[k])
            lines += [*gap_acceleration(twin, slider, s[k], slide[k], s_tt[k], q, v, q_tt),
                      sliding(twin, slider, s[k], force[k], q)]
        return np.concatenate((twin.reduced(q, f)[twin.free], lines))

    start = residual(np.zeros(n + 4 * n_s))
    matrix = np.array([residual(row) - start for row in np.eye(n + 4 * n_s)]).T
    y = np.linalg.lstsq(matrix, -start, rcond=None)[0]
    vdot = np.zeros((twin.n, 6))
    vdot[twin.free] = y[:n]
    return vdot, y[n:n + 3 * n_s].reshape(-1, 3)


# -------------------------------------------------------------------------------------------------------------- the run
def newton(residual: Callable[[Array], Array], z: Array, matrix: Array | None = None) -> tuple[Array, Array]:
    """Root of `residual`, from z on, and the tangent of forward differences, kept while the increments shrink fourfold."""
    before = np.inf
    for _ in range(40):
        r = residual(z)
        if matrix is None:
            matrix = np.array([(residual(z + row) - r) / 1e-7 for row in 1e-7 * np.eye(z.size)]).T
        dz = -np.linalg.solve(matrix, r)
        z = z + dz
        size = float(np.max(np.abs(dz)) / (1.0 + np.max(np.abs(z))))
        if size < 1e-15 or (size < 1e-11 and size > 0.25 * before):
            return z, matrix
        if size > 0.25 * before:
            matrix = None
        before = size
    raise ArithmeticError(f"the twin did not converge: last increment {before:.3g}")


def start_of(twin: Twin, method: str, state: tuple[Array, Array, Array], t: float = 0.0) -> Motion:
    """The beginning of a run from q, v, s; methods with accelerations start from consistent ones."""
    q, v = (x.reshape(-1, 4, 3).copy() for x in state[:2])
    s = state[2].copy()
    if method not in ("trapezoidal", "generalized_alpha"):
        return Motion(t, q, v, s, np.zeros((s.size, 3)))
    vdot, force = initial_accelerations(twin, t, q, v, s)
    return Motion(t, q, v, s, force, np.where(twin.free, np.concatenate((v[:, 0], spins(q, v)), axis=1), 0.0), vdot, vdot)


def split(twin: Twin, z: Array) -> tuple[Array, Array, Array]:
    """Unknowns of a step: moves (D phi and a rotation vector) [N, 6], contact forces [S, 3], s_n+1 [S]."""
    n, n_s = int(twin.free.sum()), len(twin.scene.sliders)
    x = np.zeros((twin.n, 6))
    x[twin.free] = z[:n]
    return x, z[n:n + 3 * n_s].reshape(-1, 3), z[n + 3 * n_s:]


def advance(twin: Twin, method: str, m: Motion, h: float, rho_inf: float | None = None,
            tangent: Array | None = None) -> tuple[Motion, Array]:
    """One step of a method from a first guess of the tangent; also the last tangent."""
    accelerated = method in ("trapezoidal", "generalized_alpha")
    p = parameters(method, rho_inf) if accelerated else None
    loads = mean_over(m.t, h)

    def trial(z: Array) -> Step:
        x, force, s_end = split(twin, z)
        return Step(m.q, m.v, x[:, :3], x[:, 3:], m.s, s_end, force, h)

    def residual(z: Array) -> Array:
        if accelerated:
            x, force, s_end = split(twin, z)
            nodes, sliders = alpha_residual(twin, p, m, x, s_end, force, h)
        elif method == "midpoint":
            nodes, sliders = midpoint_residual(twin, trial(z), loads)
        else:
            nodes, sliders = twin.residual(trial(z), loads)
        return np.concatenate((nodes[twin.free], sliders.reshape(-1)))

    move = h * np.concatenate((m.v[:, 0], spins(m.q, m.v)), axis=1)
    if accelerated:
        move += 0.5 * h**2 * m.acc
    s = [m.s[k] + h * sliding_rate(twin, slider, m.s[k], m.q, m.v) for k, slider in enumerate(twin.scene.sliders)]
    z, tangent = newton(residual, np.concatenate((move[twin.free], m.force.reshape(-1), s)), tangent)
    x, force, s_end = split(twin, z)
    if accelerated:
        a, vel, vdot = end_of_step(p, m, x, h)
        q = twin.connected(rotated(m.q, x))
        return Motion(m.t + h, q, twin.connected(rates(q, vel)), s_end, force, vel, a, vdot), tangent
    dq = twin.connected(increments(m.q, x[:, :3], x[:, 3:]))
    return Motion(m.t + h, m.q + dq, 2.0 / h * dq - m.v, s_end, force), tangent


def run(twin: Twin, method: str, state: tuple[Array, Array, Array], h: float, n: int, rho_inf: float | None = None) -> Motion:
    """n steps of size h from a state (q, v, s) at t = 0."""
    m, tangent = start_of(twin, method, state), None
    for _ in range(n):
        m, tangent = advance(twin, method, m, h, rho_inf, tangent)
    return m
