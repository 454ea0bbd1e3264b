"""A slow twin of the conserving step in plain NumPy, to be read next to theory.md: one short function per equation.

It shares data with the compiled code, no formulas: the interpolation tables of a beam, the nouns of the scene, the numbers of
the nodes and which of the coordinates that joints connect is the dependent one. Coordinates are [N, 4, 3]: phi, d1, d2, d3
of every node.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from fastbeam.scene import AddedMass, Beam, Drag, Path, PointMass, RigidBody, Scene, Slider
from fastbeam.scene.interpolation.basis import CurveBasis

Array = np.ndarray


@dataclass(frozen=True)
class Step:
    """A trial step from t_n to t_n + h: q_n, v_n [N, 4, 3], increments dphi, theta [N, 3] (m, Cayley vector), s_n, s_end [S] (m),
    contact forces [S, 3] (N)."""

    q_n: Array
    v_n: Array
    dphi: Array
    theta: Array
    s_n: Array
    s_end: Array
    force: Array
    h: float


# ------------------------------------------------------------------------------------------------------------- rotations
def skew(x: Array) -> Array:
    """Matrix of x cross."""
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def cay(theta: Array) -> Array:
    """Rotation of a Cayley vector, (I - theta^/2) R = I + theta^/2; theory.md (4.2)."""
    return np.linalg.solve(np.eye(3) - 0.5 * skew(theta), np.eye(3) + 0.5 * skew(theta))


def cayley_vector(rotation: Array) -> Array:
    """The inverse of `cay`: theta^/2 = (R - I)(R + I)^-1."""
    s = 2.0 * (rotation - np.eye(3)) @ np.linalg.inv(rotation + np.eye(3))
    return np.array([s[2, 1], s[0, 2], s[1, 0]])


def reciprocal(d: Array) -> Array:
    """Rows d^i with d^i . d_j = delta_ij."""
    return np.linalg.inv(d).T


def increments(q: Array, dphi: Array, theta: Array) -> Array:
    """D q of every node: D phi given, D d_i = (cay(theta) - I) d_i; theory.md (4.2)."""
    turn = np.array([cay(t) for t in theta]) - np.eye(3)
    return np.concatenate((dphi[:, None], np.einsum("nij,nkj->nki", turn, q[:, 1:])), axis=1)


def project(q_mid: Array, f: Array) -> Array:
    """P(qbar)^T f: force and moment sum dbar_i x f_i of every node, [N, 6]; theory.md (4.2)."""
    return np.concatenate((f[:, 0], np.cross(q_mid[:, 1:], f[:, 1:]).sum(axis=1)), axis=1)


# ----------------------------------------------------------------------------------------------------------------- beams
def quadratic_forms(kind: str, phi_s: Array, d: Array, d_s: Array) -> Array:
    """The quadratic forms [..., 7] that the strains are made of, from phi' [..., 3], directors and their derivatives [..., 3, 3];
    theory.md (2.1), (2.4)."""
    def dot(a: Array, b: Array) -> Array:
        return np.einsum("...c,...c->...", a, b)

    d1, d2, d3 = (d[..., i, :] for i in range(3))
    d1_s, d2_s, d3_s = (d_s[..., i, :] for i in range(3))
    kappa1 = 0.5 * (dot(d2_s, d3) - dot(d3_s, d2))
    if kind == "simo_reissner":
        kappa2, kappa3 = 0.5 * (dot(d3_s, d1) - dot(d1_s, d3)), 0.5 * (dot(d1_s, d2) - dot(d2_s, d1))
    else:
        kappa2, kappa3 = dot(phi_s, d3_s), -dot(phi_s, d2_s)
    squares = dot(d1, d1) + dot(d2, d2) + dot(d3, d3)
    return np.stack((0.5 * dot(phi_s, phi_s), dot(phi_s, d2), dot(phi_s, d3), kappa1, kappa2, kappa3, squares), axis=-1)


def stretch(forms: Array) -> Array:
    """sqrt(phi'.phi' - Gamma_2^2 - Gamma_3^2); theory.md (2.2)."""
    return np.sqrt(2.0 * forms[..., 0] - forms[..., 1]**2 - forms[..., 2]**2)


def length_factor(forms: Array) -> Array:
    """c = 7/4 - (d1.d1 + d2.d2 + d3.d3)/4; theory.md (2.2)."""
    return 1.75 - 0.25 * forms[..., 6]


def strains_of(kind: str, forms: Array) -> Array:
    """The six strains [..., 6] from the quadratic forms; theory.md (2.1), (2.2)."""
    if kind == "simo_reissner":
        axial, curvatures = stretch(forms) - 1.0, length_factor(forms)[..., None] * forms[..., 3:6]
        return np.concatenate((axial[..., None], forms[..., 1:3], curvatures), axis=-1)
    return np.concatenate(((forms[..., 0] - 0.5)[..., None], forms[..., 1:6]), axis=-1)


def beam_forms(beam: Beam, q: Array) -> Array:
    """Quadratic forms [..., e, nq, 7] at the quadrature points of all elements for coordinates [..., e, nn, 4, 3]; theory.md
    (1.1)."""
    b = beam.basis
    phi_s = np.einsum("egn,...enc->...egc", b.phi_s, q[..., 0, :])
    d = np.einsum("egn,...enic->...egic", b.dir, q[..., 1:, :])
    return quadratic_forms(beam.strain, phi_s, d, np.einsum("egn,...enic->...egic", b.dir_s, q[..., 1:, :]))


def beam_strains(beam: Beam, q: Array) -> Array:
    """Strains of the same points."""
    return strains_of(beam.strain, beam_forms(beam, q))


def form_matrix(beam: Beam, q_mid: Array) -> Array:
    """B(qbar) of all elements, [12 nn, e, nq, 7]: exactly B(qbar) x = (Q(qbar + x) - Q(qbar - x)) / 2, as Q is quadratic."""
    nn = q_mid.shape[1]
    x = np.eye(12 * nn).reshape(-1, 1, nn, 4, 3)
    return 0.5 * (beam_forms(beam, q_mid + x) - beam_forms(beam, q_mid - x))


def stresses_of_forms(kind: str, stress: Array, forms: tuple[Array, Array]) -> Array:
    """What multiplies the derivatives of the quadratic forms [..., 7], so that its work is that of the mean stress:
    s . DQ = Sbar . DE; theory.md (4.7). `forms`: at both ends of the step."""
    s, mean = np.zeros(forms[0].shape), 0.5 * (forms[0] + forms[1])
    s[..., :6] = stress
    if kind == "simo_reissner":
        s[..., 0] /= 0.5 * (stretch(forms[0]) + stretch(forms[1]))
        s[..., 1:3] -= s[..., :1] * mean[..., 1:3]
        s[..., 3:6] *= length_factor(mean)[..., None]
        s[..., 6] = -0.25 * np.sum(stress[..., 3:] * mean[..., 3:6], axis=-1)
    return s


def viscosity(beam: Beam) -> Array:
    """D [6, 6] from a retardation time, six of them, or D itself; theory.md (2.5)."""
    given = np.asarray(beam.section.damping)
    return given if given.ndim == 2 else np.diag(np.broadcast_to(np.sqrt(given), 6)) @ beam.section.C @ np.diag(
        np.broadcast_to(np.sqrt(given), 6))


def dissipation(beam: Beam, q_n: Array, q_n1: Array, h: float) -> float:
    """Energy that damping takes in a step, int DE . D DE/h ds; theory.md (2.6)."""
    nodes = beam.basis.element_nodes
    change = beam_strains(beam, q_n1[nodes]) - beam_strains(beam, q_n[nodes])
    return float(np.einsum("egi,ij,egj,eg->", change, viscosity(beam), change, beam.basis.weight)) / h


def internal_forces(beam: Beam, q_ref: Array, q_n: Array, q_n1: Array, h: float = np.inf) -> Array:
    """int B(qbar)^T s ds with the stresses of Sbar = C (E_n + E_n+1)/2 + D DE/h on the nodes of a beam, [n, 4, 3]; theory.md
    (4.1), (2.6)."""
    nodes = beam.basis.element_nodes
    forms = beam_forms(beam, q_n[nodes]), beam_forms(beam, q_n1[nodes])
    start, end = (strains_of(beam.strain, x) for x in forms)
    stress = (0.5 * (start + end) - beam_strains(beam, q_ref[nodes])) @ beam.section.C + (end - start) @ viscosity(beam) / h
    b = form_matrix(beam, 0.5 * (q_n[nodes] + q_n1[nodes]))
    f = np.zeros_like(q_n)
    s = stresses_of_forms(beam.strain, stress, forms)
    np.add.at(f, nodes, np.einsum("xegi,egi,eg->ex", b, s, beam.basis.weight).reshape(*nodes.shape, 4, 3))
    return f


# --------------------------------------------------------------------------------------------------------------- sliders
@cache
def curve_of(slider: Slider) -> CurveBasis:
    """The curve a slider runs on."""
    return slider.beam.basis.curve(slider.curve)


def curve_shape(slider: Slider, s: float) -> Array:
    """N~_A(s) of all nodes of the slider's beam; theory.md (3.1). Of a path those of its beams one after the other, where beams
    do not share a tangent; theory.md 5.7."""
    if isinstance(slider.beam, Path):
        beams, directions = slider.beam.beams, slider.beam.directions
        length = sum(beam.length for beam in beams)
        s = s % length if slider.beam.closed else s
        k = 0
        while k < len(beams) - 1 and s > beams[k].length:
            s -= beams[k].length
            k += 1
        on = [Slider(slider.name, slider.point, beam, at=0.0, curve=slider.curve) for beam in beams]
        parts = [np.zeros(beam.n_nodes) for beam in beams]
        parts[k] = curve_shape(on[k], s if directions[k] > 0 else beams[k].length - s)
        return np.concatenate(parts)
    n = slider.beam.n_nodes
    first, values, _ = curve_of(slider).evaluate(s)
    out = np.zeros(n + values.shape[1])
    out[first[0]:first[0] + values.shape[1]] = values[0]
    return out[:n]


def divided_difference(slider: Slider, s0: float, s1: float) -> Array:
    """N[s0, s1] of all nodes, for s1 well away from s0; theory.md (5.3)."""
    return (curve_shape(slider, s1) - curve_shape(slider, s0)) / (s1 - s0)


def multipliers(d_mid: Array, force: Array) -> Array:
    """lam_i of F = sum lam_i dbar_i; theory.md (5.2)."""
    return reciprocal(d_mid) @ force


def mean_gap(n_mean: Array, point_mid: Array, phi_mid: Array) -> Array:
    """gbar = phibar_S - sum Nbar_A phibar_A; theory.md (5.2)."""
    return point_mid - n_mean @ phi_mid


def sliding_equation(lam: Array, d: tuple[Array, Array], n_divided: Array, phi: tuple[Array, Array]) -> float:
    """sum_k 1/2 [sum lam_i d_i(k)] . [sum N[s_n, s_n+1]_A phi_A(k)] over both ends of the step; theory.md (5.3)."""
    return float(sum(0.5 * (lam @ d_k) @ (n_divided @ phi_k) for d_k, phi_k in zip(d, phi)))


def gap_components(d: Array, n: Array, point: Array, phi: Array) -> Array:
    """g_i = sum N_A pi_iA with pi_iA = d_i . (phi_S - phi_A); theory.md (5.1)."""
    return n @ ((point - phi) @ d.T)


def augmented_increment(tangent: Array, residual: Array, force: Array, r: Array) -> tuple[Array, Array]:
    """Newton increment of the augmented Lagrangian with r [S], theory.md (5.5), and the gaps [S, 3] that it leaves in the linear
    equations; unknowns and rows are those of the free nodes, then F and s, gap and sliding, of every slider. `force` [S, 3]
    answers the gap together with its increment: F in the first iteration of a step, then zero."""
    n = len(tangent) - 4 * len(r)
    augmented, right = tangent.copy(), -residual
    for k in range(len(r)):
        at = n + 4 * k + np.arange(3)
        augmented[at, at] += 1.0 / r[k]
        right[at] -= force[k] / r[k]
    x = np.linalg.solve(augmented, right)
    return x, (residual + tangent @ x)[n:].reshape(-1, 4)[:, :3]


def compliances(tangent: Array, sliders: int) -> Array:
    """Largest diagonal entry of the gaps' change by their own forces, [S]."""
    n = len(tangent) - 4 * sliders
    c = tangent[n:, n:] - tangent[n:, :n] @ np.linalg.solve(tangent[:n, :n], tangent[:n, n:])
    return np.array([np.max(np.abs(np.diag(c)[4 * k:4 * k + 3])) for k in range(sliders)])


# -------------------------------------------------------------------------------------------------------- the whole scene
def turn(before: Array, after: Array) -> Array:
    """The Cayley vector that leads three directors [3, 3] to others; of a tied node it is that of its target."""
    mean = 0.5 * (before + after)
    # theta x m = - skew(m) theta
    rows = -np.array([[[0, -z, y], [z, 0, -x], [-y, x, 0]] for x, y, z in mean]).reshape(9, 3)
    return np.asarray(np.linalg.lstsq(rows, (after - before).reshape(9), rcond=None)[0])


class Twin:
    """All equations of one scene; `model` only numbers the nodes and says which connected coordinates are dependent."""

    def __init__(self, scene: Scene, model: Any) -> None:
        self.scene, self.n = scene, model.n_nodes
        self.node_of_label = {label: k for k, label in enumerate(model.labels)}
        self.spin_root = model.spin_root
        self.reference = {beam.name: self._reference(beam) for beam in scene.beams}
        self.q0 = model.q0.reshape(-1, 4, 3)
        self.arms = sorted({(self.number(body), point) for body in scene.bodies for point in self._points_of(body)})
        tied = [] if model.ties is None else [int(k) for k in model.ties.slave]
        self.tie = self._tie_map(tied)
        self.free = self._free_unknowns(tied)
        self.mass = self._mass_matrix()

    # --- numbers of nodes
    def number(self, node: Any) -> int:
        """Global number of a beam node, body, mass or point of a body."""
        return self.node_of_label[node.label]

    def of_beam(self, beam: Beam) -> slice:
        """All nodes of a beam."""
        return slice(self.number(beam.start), self.number(beam.end) + 1)

    def _points_of(self, body: RigidBody) -> list[int]:
        """Numbers of all points of a body off its centre that something uses."""
        scene = self.scene
        used = [s.point for s in scene.sliders] + [load.at for load in scene.loads]
        used += [x for joint in [*scene.balls, *scene.rigid] for x in (joint.a, joint.b)]
        return [self.number(p) for p in used if p.owner is body and not p.is_center]

    @staticmethod
    def _reference(beam: Beam) -> Array:
        phi, d = beam.reference(beam.node_s)
        return np.concatenate((beam.basis.fit_positions(phi)[:, None], d), axis=1)

    # --- joints: q = L q with dependent coordinates on the left
    def _joint_equations(self) -> Array:
        """Rows a of sum_x a_x q_x = 0 over the vectors x = 4 node + (phi, d1, d2, d3), from the geometry at t = 0."""
        rows = []

        def offset_in(k: int, point: Array) -> Array:
            """Position of node k plus a fixed vector in its triad, the vector from k to `point`."""
            row = np.zeros(4 * self.n)
            row[4 * k] = 1.0
            row[4 * k + 1:4 * k + 4] = self.q0[k, 1:] @ (point - self.q0[k, 0])
            return row

        def position(k: int) -> Array:
            return offset_in(k, self.q0[k, 0])

        pairs = [(self.number(j.a), self.number(j.b), isinstance(j.b.owner, PointMass)) for j in self.scene.rigid]
        pairs += [(body, point, False) for body, point in self.arms]
        for a, b, without_triad in pairs:
            rows.append(offset_in(a, self.q0[b, 0]) - position(b))
            if not without_triad:
                turn = self.q0[b, 1:] @ self.q0[a, 1:].T
                for i in range(3):
                    row = np.zeros(4 * self.n)
                    row[4 * a + 1:4 * a + 4] = turn[i]
                    row[4 * b + 1 + i] -= 1.0
                    rows.append(row)
        rows += [position(self.number(j.a)) - position(self.number(j.b)) for j in self.scene.balls]
        return np.array(rows).reshape(-1, 4 * self.n)

    def _tie_map(self, tied: list[int]) -> Array:
        """L [4 N, 4 N]: identity on the free vectors, dependent ones solved from the equations of the joints."""
        equations = self._joint_equations()
        dependent = [4 * k for k in tied] + [4 * k + i for k in tied if self.spin_root[k] != k for i in (1, 2, 3)]
        independent = np.setdiff1d(np.arange(4 * self.n), dependent)
        tie = np.eye(4 * self.n)
        if dependent:
            assert np.linalg.matrix_rank(equations) == len(dependent) == np.linalg.matrix_rank(equations[:, dependent])
            tie[dependent] = 0.0
            tie[np.ix_(dependent, independent)] = -np.linalg.pinv(equations[:, dependent]) @ equations[:, independent]
            assert np.max(np.abs(equations @ tie)) < 1e-12
        return tie

    def _free_unknowns(self, tied: list[int]) -> Array:
        """[N, 6] bool: False for clamps, pins, triads of point masses and dependent coordinates."""
        free = np.ones((self.n, 6), dtype=bool)
        for mass in self.scene.masses:
            free[self.number(mass), 3:] = False
        for clamp in self.scene.clamps:
            node = clamp.at.owner if isinstance(clamp.at.owner, RigidBody) else clamp.at
            held = ["xyz".index(letter) for letter in clamp.axes]
            free[self.spin_root[self.number(node)], [*held, 3, 4, 5]] = False
        for pin in self.scene.pins:
            free[self.number(pin.at), ["xyz".index(letter) for letter in pin.axes]] = False
        free[tied, :3] = False
        free[[k for k in tied if self.spin_root[k] != k], 3:] = False
        return free

    # --- inertia and loads
    def _mass_matrix(self) -> Array:
        """M [4 N, 4 N] over the vectors of all nodes; theory.md (1.2), bodies with Euler tensor 1/2 tr(J) I - J."""
        m = np.zeros((self.n, 4, self.n, 4))
        for beam in self.scene.beams:
            first = self.number(beam.start)
            for e, nodes in enumerate(beam.basis.element_nodes):
                at = np.ix_(first + nodes, first + nodes)
                m[:, 0, :, 0][at] += beam.section.rhoA * beam.basis.mass_phi[e]
                m[:, 2, :, 2][at] += beam.section.rhoI2 * beam.basis.mass_dir[e]
                m[:, 3, :, 3][at] += beam.section.rhoI3 * beam.basis.mass_dir[e]
        for part in [*self.scene.masses, *self.scene.bodies]:
            k = self.number(part)
            m[k, 0, k, 0] += part.mass
            if isinstance(part, RigidBody):
                m[k, 1:, k, 1:] += 0.5 * np.trace(part.inertia) * np.eye(3) - part.inertia
        return m.reshape(4 * self.n, 4 * self.n)

    def dead_loads(self, factor: Any = lambda time: 1.0) -> tuple[Array, Array]:
        """Forces and torques on the nodes, [N, 3] each; `factor` gives the mean of a time function over the step."""
        scene = self.scene
        force, torque = np.zeros((self.n, 3)), np.zeros((self.n, 3))
        for beam in scene.beams:
            b, first = beam.basis, self.number(beam.start)
            loads = [(load.force_at, load.moment_at, factor(load.time)) for load in scene.distributed if load.beam is beam]
            weight = beam.section.rhoA * scene.gravity
            for e, nodes in enumerate(b.element_nodes):
                lumps = b.mass_weight[e][:, None] * b.mass_phi_values[e]     # int N_A ds, point by point
                force[first + nodes] += factor(scene.gravity_time) * lumps.sum(axis=0)[:, None] * weight
                for force_at, moment_at, f in loads:
                    force[first + nodes] += f * lumps.T @ force_at(b.mass_point_s[e])
                    # a moment works on the spin of the directors, which have a basis of their own
                    torque[first + nodes] += f * (b.weight[e][:, None] * b.dir[e]).T @ moment_at(b.point_s[e])
        for part in [*scene.bodies, *scene.masses]:
            force[self.number(part)] += factor(scene.gravity_time) * part.mass * scene.gravity
        for load in scene.loads:
            force[self.number(load.at)] += factor(load.time) * load.force
            torque[self.number(load.at)] += factor(load.time) * load.moment
        return force, torque

    @staticmethod
    def load_forces(q_mid: Array, force: Array, torque: Array) -> Array:
        """Loads on the coordinates: f_i = 1/2 tau x dbar^i gives sum dbar_i x f_i = tau exactly; theory.md (4.4)."""
        f = np.zeros_like(q_mid)
        f[:, 0] = force
        f[:, 1:] = 0.5 * np.cross(torque[:, None], [reciprocal(d) for d in q_mid[:, 1:]])
        return f

    # --- sliders
    def slider_terms(self, slider: Slider, s_n: float, s_end: float, force: Array, q_n: Array,
                     q_n1: Array) -> tuple[Array, Array]:
        """(constraint forces [N, 4, 3], the three gaps in space at n+1 and the sliding equation [4]); theory.md (5.1)-(5.4).

        The frame turns with the mean of the nodes of the curve: its directors are the axes at t_n, cay(theta) of them at t_n+1.
        """
        at, point = np.concatenate([np.arange(self.n)[self.of_beam(b)] for b in slider.beams]), self.number(slider.point)
        q_mid = 0.5 * (q_n + q_n1)
        n_mean = 0.5 * (curve_shape(slider, s_n) + curve_shape(slider, s_end))
        turns = np.array([cayley_vector(b.T @ a) for a, b in zip(q_n[at, 1:], q_n1[at, 1:])])
        frame = (np.eye(3), cay(n_mean @ turns).T)
        frame_mid = 0.5 * (frame[0] + frame[1])
        lam = multipliers(frame_mid, force)
        f = np.zeros_like(q_n)
        f[point, 0] += lam @ frame_mid
        f[at, 0] -= np.outer(n_mean, lam @ frame_mid)
        # forces lam_i gbar on the frame's directors are a torque; each node of the curve takes its share
        torque = np.cross(frame_mid, np.outer(lam, mean_gap(n_mean, q_mid[point, 0], q_mid[at, 0]))).sum(axis=0)
        f[at] += self.load_forces(q_mid[at], np.zeros((len(n_mean), 3)), np.outer(n_mean, torque))
        sliding = sliding_equation(lam, frame, divided_difference(slider, s_n, s_end), (q_n[at, 0], q_n1[at, 0]))
        gaps = gap_components(frame[1], curve_shape(slider, s_end), q_n1[point, 0], q_n1[at, 0])
        return f, np.append(gaps @ frame[1], sliding)

    # --- the equations
    def connected(self, x: Array) -> Array:
        """Coordinates, increments or rates with the dependent ones set from the others."""
        return (self.tie @ x.reshape(4 * self.n, 3)).reshape(self.n, 4, 3)

    def beam_forces(self, q_n: Array, q_n1: Array, h: float = np.inf) -> Array:
        """Internal forces of all beams, [N, 4, 3]."""
        f = np.zeros_like(q_n)
        for beam in self.scene.beams:
            at = self.of_beam(beam)
            f[at] += internal_forces(beam, self.reference[beam.name], q_n[at], q_n1[at], h)
        return f

    def resistance(self, drag: Drag, velocity: Array, d1: Array) -> Array:
        """Minus the forces of the air on all nodes [N, 3]; theory.md (4.12)."""
        f = np.zeros((self.n, 3))
        size = self.sizes(drag.on)
        for k in np.flatnonzero(size):
            w = velocity[k] - drag.air
            t = d1[k] / np.linalg.norm(d1[k]) * isinstance(drag.on, Beam)
            along, across = (w @ t) * t, w - (w @ t) * t
            f[k] = size[k] * (drag.normal * np.linalg.norm(across) * across + drag.tangential * np.linalg.norm(along) * along
                              + drag.linear * w)
        return f

    def of_fluid(self, fluid: AddedMass, step: Step, q_n1: Array) -> tuple[Array, Array]:
        """Forces and moments of the fluid on all nodes [N, 3] each, in a step that begins with the momenta of its velocities;
        theory.md (4.34)."""
        force, moment = np.zeros((self.n, 3)), np.zeros((self.n, 3))
        h = step.h
        for k, size in enumerate(self.sizes(fluid.on)):
            normal, along = size * fluid.normal, size * (fluid.tangential - fluid.normal)
            v, w = step.v_n[k, 0], (q_n1[k, 0] - step.q_n[k, 0]) / h
            d0, d1 = step.q_n[k, 1], q_n1[k, 1]
            theta = turn(step.q_n[k, 1:], q_n1[k, 1:])
            g0 = along * (d0 @ v)
            g1 = 2.0 * along * (w @ (0.5 * (d0 + d1) - 0.25 * np.cross(theta, d1 - d0))) - g0
            p0, p1 = normal * v + g0 * d0, normal * (2.0 * w - v) + g1 * d1
            force[k] = (p0 - p1) / h
            moment[k] = -np.cross(w, 0.5 * (p0 + p1))
        return force, moment

    def sizes(self, on: Any) -> Array:
        """Of all nodes the length of a beam that they stand for, or 1 for a body [N]."""
        size = np.zeros(self.n)
        if isinstance(on, Beam):
            np.add.at(size, self.number(on.start) + on.basis.element_nodes, on.basis.mass_phi.sum(axis=2))
        else:
            size[self.number(on)] = 1.0
        return size

    def reduced(self, q_mid: Array, f: Array) -> Array:
        """Forces of dependent coordinates moved to the others, projected, held unknowns removed: [N, 6]."""
        moved = (self.tie.T @ f.reshape(4 * self.n, 3)).reshape(self.n, 4, 3)
        return np.where(self.free, project(q_mid, moved), 0.0)

    def residual(self, step: Step, factor: Any = lambda time: 1.0) -> tuple[Array, Array]:
        """Residual of the conserving step: nodes [N, 6] and sliders [S, 4] (gap, sliding); theory.md (4.1), (5.1)-(5.4)."""
        dq = self.connected(increments(step.q_n, step.dphi, step.theta))
        q_n1, q_mid = step.q_n + dq, step.q_n + 0.5 * dq
        inertia = self.mass @ (2.0 / step.h**2 * (dq - step.h * step.v_n)).reshape(4 * self.n, 3)
        f = inertia.reshape(self.n, 4, 3) + self.beam_forces(step.q_n, q_n1, step.h)
        f -= self.load_forces(q_mid, *self.dead_loads(factor))
        for drag in self.scene.drags:
            f[:, 0] += self.resistance(drag, dq[:, 0] / step.h, q_mid[:, 1])
        for fluid in self.scene.added_masses:
            f -= self.load_forces(q_mid, *self.of_fluid(fluid, step, q_n1))
        contact = np.zeros((len(self.scene.sliders), 4))
        for k, slider in enumerate(self.scene.sliders):
            pull, contact[k] = self.slider_terms(slider, step.s_n[k], step.s_end[k], step.force[k], step.q_n, q_n1)
            f -= pull
        return self.reduced(q_mid, f), contact

    def static_residual(self, q: Array) -> Array:
        """Out-of-balance forces [N, 6] of a configuration at rest; theory.md 8."""
        return self.reduced(q, self.beam_forces(q, q) - self.load_forces(q, *self.dead_loads()))
