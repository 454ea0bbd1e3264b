"""The naive twin of constraints in an equilibrium: the equations of theory.md 5.1 with both ends of the step equal, as matrices.

    gap         g_k = phi_S - sum_A N_A(s_k) phi_A = 0
    force       +F_k on the point, -N_A F_k on node A
    sliding     F_k . c'(s_k) = 0,   c' = sum_A N'_A phi_A

They make W - (loads) - sum_k F_k . g_k stationary. Of a slider that slips with friction the last one has the term sigma mu F_n
|c'|, sigma the direction of the slip. Tied nodes and held unknowns pass through the map from the unknowns of the rows to the
positions of all nodes; how that map changes with the shape belongs to the tangent of the nodes, which is assembled with the
contact forces among the loads.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.joints.coordinates import LINE, NO_SWING, SWING
from fastbeam.model.contact.sleeve_conditions import CONDITIONS, Section, sections
from fastbeam.model.joints.constraints import Distance, ConstrainedJoint, Together
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.joints.tables import Conditions
from fastbeam.model.mapping import shapes_at
from fastbeam.model.maps import tie_map, velocity_map
from fastbeam.model.model import Model

Array = np.ndarray
# a part of the contact force across the beam that is round-off of the force
ALONG_ONLY = 1e-12


class Border(NamedTuple):
    """Of all sliders at one shape; d = 3 components in space, 2 in a plane, m unknowns of the nodes."""

    gap: Array        # float64 [S, d], m
    tangent: Array    # float64 [S, d]: c'(s)
    sliding: Array    # float64 [S], N: F . c'
    bend: Array       # float64 [S], N/m: F . c''
    gradient: Any     # sparse [F, m]: derivative of the gaps, of joints and sleeves too, by the unknowns of the nodes
    slide: Any        # sparse [S, m]: of the sliding equations
    joint_gap: Array  # float64 [F - d S]: of joints with multipliers, m, and directions in sleeves, rad
    bent: Any         # sparse [m, m]: second derivative of - sum F . gap of joints and sleeves, N/m
    turns: Any        # sparse [F, S]: minus the derivative of directions in sleeves by s, rad/m
    idle: Array       # int64 [I]: multipliers that stay zero
    normal: Any = None    # float64 [S], N: F_n |c'|, what presses and rubs, with the moments of sleeves
    size: Any = None      # float64 [S], N: of the contact forces
    rubbing: Any = None   # sparse [S, m]: of friction in the sliding equations, by the unknowns of the nodes; None without
    by_force: Any = None  # sparse [S, F]: the same by the multipliers

    @property
    def gaps(self) -> Array:
        """Of sliders, joints and sleeves [F], in the order of the multipliers."""
        return np.concatenate((self.gap.reshape(-1), self.joint_gap))


class Weights(NamedTuple):
    """Of all sliders at their places: maps from the positions of all nodes, and from the rates of the coordinates of those nodes
    that take part, once tied ones have theirs from their targets."""

    gap: Any      # sparse [3 S, 12 N]
    tangent: Any  # sparse [3 S, 12 N]
    second: Any   # sparse [3 S, 12 N]: second derivatives of the curves
    by_nodes: Any  # sparse [6 S, 12 T]: gaps, then tangents
    nodes: Array  # int64 [T]
    by_unknowns: tuple[Any, Any] | None  # derivatives by the unknowns of the rows, where they do not depend on the shape


class StaticContacts:
    """The sliders of a model in statics.

    Parameters
    ----------
    model : Model
        In space.
    axes : float64 [3, 3], optional
        Of the plane where nodes have 3 unknowns: two in it and its normal, by rows.

    Attributes
    ----------
    ties : sparse [12 N, 12 N]
        `maps.tie_map`.
    rows : sparse [6 N, m]
        Unknowns of the rows -> positions and spins of all nodes; held ones stand still, but in `every`.
    """

    def __init__(self, model: Model, axes: Array | None) -> None:
        from scipy import sparse
        self.model, self.axes = model, axes
        n, rows = model.n_nodes, model.pattern.n
        self.ties = tie_map(model)
        pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.pattern.row_of)), shape=(n, rows))
        # three unknowns of a row in the plane -> six
        within = np.eye(6)
        if axes is not None:
            within = np.zeros((6, 3))
            within[:3, 0], within[:3, 1], within[3:, 2] = axes
        # held ones too
        self.every = sparse.kron(pick, within, format="csr")
        self.rows = (self.every @ sparse.diags(self.free(within.shape[1]))).tocsr()
        self._s: Array | None = None
        self._weights: Weights | None = None
        ends = np.array([link.node for link in model.kept], np.int64).reshape(-1)
        at = (12 * np.unique(ends)[:, None] + np.arange(12)).reshape(-1)
        # what joints are given, in their order; None: they stay
        self.given: Array | None = None
        # of sections that friction holds in their sleeves, by the number of the sleeve, rad
        self.angles: dict[int, float] = {}
        # which of those that friction or rigid stops may hold are free, None: none
        self.loose: Array | None = None
        self._joint_ties, self._joint_nodes = reduced(sparse.csr_matrix(
            (np.ones(at.size), (at, at)), shape=(12 * n, 12 * n)) @ self.ties)

    def free(self, size: int) -> Array:
        """1 for free unknowns of the rows, 0 for held ones [size rows]."""
        core = self.model if self.axes is None else self.model.plane.model
        free = np.ones((core.pattern.n, size))
        if core.static_held is not None:
            held = core.static_held.mask[:, None] >> np.arange(size) & 1
            free[core.static_held.row] *= 1 - held
        return free.reshape(-1)

    def weights(self, s: Array) -> Weights:
        """At s [S]; the last ones where s is the same."""
        if self._weights is None or self._s is None or not np.array_equal(s, self._s):
            self._s, self._weights = s.copy(), self._weights_at(s)
        return self._weights

    def _weights_at(self, s: Array) -> Weights:
        from scipy import sparse
        n = self.model.n_nodes
        entries: list[list[tuple[Array, Array, Array]]] = [[], [], []]
        points = np.zeros(0, np.int64) if self.model.sliders is None else self.model.sliders.point
        for k in range(s.size):
            nodes, values = shapes_at(self.model, k, float(s[k]))
            of = np.full(nodes.size, k)
            entries[0] += [(of, nodes, -values[0]), (np.full(1, k), points[k:k + 1], np.ones(1))]
            entries[1].append((of, nodes, values[1]))
            entries[2].append((of, nodes, values[2]))
        out = []
        c = np.arange(3)
        for part in entries:
            nothing = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
            k, nodes, values = (np.concatenate(x) for x in zip(nothing, *part))
            out.append(sparse.csr_matrix((np.repeat(values, 3), ((3 * k[:, None] + c).reshape(-1),
                                                                 (12 * nodes[:, None] + c).reshape(-1))), (3 * s.size, 12 * n)))
        by_nodes, nodes = reduced(sparse.vstack(out[:2], format="csr") @ self.ties)
        # where no triad takes part nothing depends on the shape
        fixed = not np.any(by_nodes.indices % 12 >= 3)
        found = Weights(*out, by_nodes, nodes, None)
        return found._replace(by_unknowns=self._by_unknowns(found, self.model.q0)) if fixed else found

    def _by_unknowns(self, weights: Weights, q: Array) -> tuple[Any, Any]:
        """Derivatives of gaps and of tangents by the unknowns of the rows, sparse [d S, m]; q [12 N]."""
        from scipy import sparse
        both = weights.by_nodes @ self._rates(q, weights.nodes)
        n = both.shape[0] // 2
        gradient, turn = both[:n], both[n:]
        if self.axes is not None:
            within = sparse.kron(sparse.eye(n // 3), self.axes[:2], format="csr")
            gradient, turn = within @ gradient, within @ turn
        return gradient, turn

    def _rates(self, q: Array, nodes: Array) -> Any:
        """Unknowns of the rows -> rates of the coordinates of some nodes [T], sparse [12 T, m]; q [12 N]."""
        unknowns = (6 * nodes[:, None] + np.arange(6)).reshape(-1)
        return velocity_map(q.reshape(-1, 4, 3)[nodes]) @ self.rows[unknowns]

    def border(self, weights: Weights, q: Array, force: Array, slip: Array | None = None) -> Border:
        """At coordinates q [12 N] and forces of all constraints; slip [S]: coefficients of friction with the sign of the slip."""
        from scipy import sparse
        gap, tangent, second = ((w @ q).reshape(-1, 3) for w in weights[:3])
        gradient, turn = weights.by_unknowns or self._by_unknowns(weights, q)
        if self.axes is not None:
            gap, tangent, second = (x @ self.axes[:2].T for x in (gap, tangent, second))
        s, d = gap.shape
        f = force[:s * d].reshape(s, d)
        pick = sparse.csr_matrix((force[:s * d], (np.repeat(np.arange(s), d), np.arange(s * d))), shape=(s, s * d))
        joint_gap, of_joints, bent = self._joints(q, force[s * d:])
        idle = s * d + self._loose_forces()
        border = Border(gap, tangent, np.sum(f * tangent, axis=1), np.sum(f * second, axis=1),
                        sparse.vstack((gradient, of_joints), format="csr"), pick @ turn, joint_gap, bent,
                        sparse.csr_matrix((force.size, s)), idle)
        if self.model.sleeves is not None:
            border = self._with_sleeves(border, q, force)
        return border if slip is None else self._with_friction(border, slip, force, turn, second)

    def _with_friction(self, border: Border, slip: Array, force: Array, turn: Any, second: Array) -> Border:
        """The same with what presses and rubs; turn: derivative of the tangents by the unknowns of the nodes [d S, m]; second: of
        the tangents by s [S, d]."""
        from scipy import sparse
        t, (s, d) = border.tangent, border.tangent.shape
        f = force[:s * d].reshape(s, d)
        long, size = np.linalg.norm(t, axis=1), np.linalg.norm(f, axis=1)
        part = np.sum(f * t, axis=1) / long**2
        across = f - part[:, None] * t
        normal = np.linalg.norm(across, axis=1)
        edges, of_edges = self._edges(force)
        # the derivatives of (|F_across| + edges) |c'|
        bare = np.where(normal > ALONG_ONLY * size, normal, np.inf)
        by_force = (slip * long / bare)[:, None] * across
        by_tangent = (slip * (normal + edges) / long)[:, None] * t - (slip * part * long / bare)[:, None] * across
        of, column = np.repeat(np.arange(s), d), np.arange(s * d)
        rubbing = sparse.csr_matrix((by_tangent.reshape(-1), (of, column)), shape=(s, s * d)) @ turn
        pressed = sparse.csr_matrix((by_force.reshape(-1), (of, column)), shape=(s, force.size))
        normal = (normal + edges) * long
        return border._replace(normal=normal, size=size + edges, sliding=border.sliding + slip * normal, rubbing=rubbing,
                               bend=border.bend + np.sum(by_tangent * second, axis=1),
                               by_force=pressed + sparse.diags(slip * long) @ of_edges)

    def _edges(self, force: Array) -> tuple[Array, Any]:
        """What the moments of sleeves press on the edges of their bores, N [S], and its derivative by the multipliers [S, F]."""
        from scipy import sparse
        model = self.model
        press, value, row, column = np.zeros(model.n_sliders), [], [], []
        count = 3 if self.axes is None else 1
        first = force.size - count * len(model.sleeve_pairs)
        for o, k in enumerate(model.sleeve_pairs[:, 0].tolist()):
            at = first + count * o + np.arange(count)
            bore, key = model.sleeves.edges[2 * o:2 * o + 2]
            bending = float(np.linalg.norm(force[at[:2]]))
            press[k] = bore * bending + (key * abs(force[at[2]]) if count == 3 else 0.0)
            value += [*(bore * force[at[:2]] / (bending or 1.0)), *(key * np.sign(force[at[2:]]))]
            row += [k] * count
            column += at.tolist()
        return press, sparse.csr_matrix((value, (row, column)), shape=(model.n_sliders, force.size))

    def _with_sleeves(self, border: Border, q: Array, force: Array) -> Border:
        """The same with the directions that sleeves hold, whose multipliers come last."""
        from scipy import sparse
        model = self.model
        n, s = model.n_nodes, len(border.gap)
        first = border.gradient.shape[0]
        value, lead, slide, turned, turns, idle = [border.joint_gap], [border.gradient], [], [], [], []
        sliding, bend = border.sliding.copy(), border.bend.copy()
        for k, section, within, mu in self._sections(q, force):
            value.append(within @ section.values())
            lead.append(sparse.csr_matrix(within) @ row_of(section, 0, n) @ self.rows)
            turned.append(section.turned(mu, n))
            turns.append(-within @ section.values(1))
            pick = sparse.csr_matrix((-mu[:section.pairs], (np.full(section.pairs, k), np.arange(section.pairs))),
                                     shape=(s, section.pairs))
            slide.append(pick @ row_of(section, 1, n))
            sliding[k] -= mu[:section.pairs] @ section.values(1)
            bend[k] -= mu[:section.pairs] @ section.values(2)
            if section.pairs == 2 and self.axes is None:
                idle.append(first + sum(map(len, turns)))
                value.append(np.zeros(1)); lead.append(sparse.csr_matrix((1, self.rows.shape[1]))); turns.append(np.zeros(1))
        of = np.repeat(self.model.sleeve_pairs[:, 0], 3 if self.axes is None else 1)
        flat = np.concatenate(turns)
        bent = border.bent + self.rows.T @ sum(turned) @ self.rows
        return border._replace(
            gradient=sparse.vstack(lead, format="csr"), joint_gap=np.concatenate(value), sliding=sliding, bend=bend,
            slide=border.slide + sum(slide) @ self.rows, bent=bent.tocsr(),
            idle=np.concatenate((border.idle, np.array(idle, np.int64))),
            turns=sparse.csr_matrix((flat, (first + np.arange(flat.size), of)), shape=(force.size, s)))

    def _sections(self, q: Array, force: Array) -> list[tuple[int, Section, Array, Array]]:
        """Every sleeve at coordinates q [12 N]: number of its slider, the section in it, what its equations take of the
        conditions, and its multipliers in space."""
        model = self.model
        out = []
        count = 3 if self.axes is None else 1
        at = force.size - count * len(model.sleeve_pairs)
        assert self._s is not None
        for o, ((k, _), section) in enumerate(zip(model.sleeve_pairs, sections(model, self._s, q.reshape(-1, 4, 3)))):
            mine = force[at + count * o:at + count * (o + 1)]
            section = section.turned_by(self.angles[o]) if o in self.angles else section
            within = np.eye(section.pairs) if self.axes is None else model.plane.moments[o:o + 1, :section.pairs]
            out.append((int(k), section, within, mine if self.axes is None else mine[0] * model.plane.moments[o]))
        return out

    def _joints(self, q: Array, force: Array) -> tuple[Array, Any, Any]:
        """Of joints with multipliers: gaps, their derivatives by the unknowns of the nodes, and second ones of -force . gap."""
        from scipy import sparse
        kept, x = self.model.kept, q.reshape(-1, 4, 3)
        m = self.rows.shape[1]
        if not kept:
            return np.zeros(0), sparse.csr_matrix((0, m)), sparse.csr_matrix((m, m))
        at_start = self.model.q0.reshape(-1, 4, 3)
        gaps, within = [np.zeros(0)], []
        given = iter([] if self.given is None else self.given)
        free = self._loose_links()
        second: list[tuple[list[int], Array]] = []
        for k, (link, part) in enumerate(zip(kept, self._parts(force))):
            pair = list(link.node)
            gap = gap_of(link.law, x[pair], at_start[pair])
            if isinstance(link.law, Coordinate) and self.given is not None:
                gap = np.array([misses(link.law, x[pair], next(given))])
            takes = self._within(link) * (k not in free)
            gaps.append(takes @ gap)
            within.append(takes)
            if not link.law.is_vector:
                second.append((pair, -curvature(link.law, x[pair], part)))
        lift = self._joint_ties @ self._rates(q, self._joint_nodes)
        lead = sparse.block_diag(within, format="csr") @ gap_matrix(kept, x) @ lift
        bent = sparse.csr_matrix((m, m))
        if second:
            at = (12 * np.array([pair for pair, _ in second])[:, :, None] + np.arange(12)).reshape(-1, 24)
            values = np.array([bend for _, bend in second])
            rows, columns = np.broadcast_arrays(at[:, :, None], at[:, None])
            curved = sparse.csr_matrix((values.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(q.size, q.size))
            bent = (lift.T @ curved @ lift + self.rows.T @ self._turned(x, force) @ self.rows).tocsr()
        return np.concatenate(gaps), lead, bent

    def _loose_links(self) -> set[int]:
        """Numbers of joints whose force is none: coordinates between rigid stops."""
        if self.loose is None:
            return set()
        rubs = [k for k, link in enumerate(self.model.kept) if isinstance(link.law, Coordinate) and not link.law.holds]
        return {k for k, is_free in zip(rubs, self.loose) if is_free}

    def _loose_forces(self) -> Array:
        """Numbers of their forces among those of joints."""
        free = self._loose_links()
        out, at = [np.zeros(0, np.int64)], 0
        for k, link in enumerate(self.model.kept if free else ()):
            m = len(self._within(link))
            out += [np.arange(at, at + m)] if k in free else []
            at += m
        return np.concatenate(out)

    def _within(self, link: ConstrainedJoint) -> Array:
        """What the equations take of the conditions of a joint, [m, m in space]."""
        return np.eye(link.forces(3)) if self.axes is None else link.law.within(self.axes)

    def _turned(self, x: Array, force: Array) -> Any:
        """What - force . gap of joints gets from the second change of directors with the spins, sparse [6 N, 6 N]; coordinates x
        [N, 4, 3]."""
        from scipy import sparse
        n = self.model.n_nodes
        roots, blocks = [np.zeros(0, np.int64)], [np.zeros((0, 3, 3))]
        for link, part in zip(self.model.kept, self._parts(force)):
            if link.law.is_vector or isinstance(link.law, Distance):
                continue
            pair = list(link.node)
            push = np.einsum("m,msic->sic", part, link.law.lead(x[pair]))[:, 1:]
            d = x[pair, 1:]
            roots.append(self.model.spin_root[pair])
            # of the moment d x push by a spin, as in the tangent of beams; only the sum of all of them is symmetric
            blocks.append(np.einsum("sic,sic->s", push, d)[:, None, None] * np.eye(3) - np.einsum("sic,sie->sce", d, push))
        at = 6 * np.concatenate(roots)[:, None] + 3 + np.arange(3)
        values = np.concatenate(blocks)
        rows, columns = np.broadcast_arrays(at[:, :, None], at[:, None])
        return sparse.csr_matrix((values.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(6 * n, 6 * n))

    def _parts(self, force: Array) -> list[Array]:
        """Forces of every joint with multipliers in space from all of them."""
        out, at = [], 0
        for link in self.model.kept:
            within = self._within(link)
            out.append(within.T @ force[at:at + len(within)])
            at += len(within)
        return out

    def loads(self, weights: Weights, q: Array, force: Array, at_roots: bool = True, row_of: Array | None = None) -> Array:
        """The forces of all constraints as loads on the rows, flat as `Work.f_ext` [8 (N + 1)]; moments at the nodes that spins
        belong to, or at the nodes themselves, whose connections have to carry them. row_of: int [N], other rows of the nodes."""
        n = self.model.n_nodes
        row_of = self.model.pattern.row_of if row_of is None else row_of
        root_of = self.model.spin_root if at_roots else np.arange(n)
        flat = self.axes is not None
        own = self.model.n_sliders * (2 if flat else 3)
        f = force[:own].reshape(-1, 2) @ self.axes[:2] if self.axes is not None else force[:own]
        of_node = (weights[0].T @ f.reshape(-1)).reshape(n, 12)[:, :3]
        x = q.reshape(-1, 4, 3)
        turning: list[tuple[int, Array]] = []
        for link, part in zip(self.model.kept, self._parts(force[own:])):
            for node, by_v, by_spin in link.by_velocities(x[list(link.node)]):
                of_node[node] += by_v.T @ part
                turning.append((int(root_of[node]), by_spin.T @ part))
        if flat:
            of_node = of_node @ self.axes[:2].T  # type: ignore[index]
        out = np.zeros((n + 1, 8))
        d = of_node.shape[1]
        np.add.at(out[:, :d], row_of, of_node)
        for root, moment in turning:
            out[row_of[root], d:d + (1 if flat else 3)] += self.axes[2:] @ moment if flat else moment
        for _, section, _, mu in [] if self.model.sleeves is None else self._sections(q, force):
            of_nodes, of_holder = section.by_spins()
            moments = np.einsum("p,pac->ac", mu[:section.pairs], np.concatenate((of_nodes, of_holder[:, None]), axis=1))
            if self.axes is not None:
                moments = moments @ self.axes[2:].T
            np.add.at(out[:, d:d + moments.shape[1]], row_of[root_of[section.nodes]], moments)
        return out.reshape(-1)


def row_of(section: Section, derivative: int, size: int) -> Any:
    """Derivative of `Section.values` by the unknowns (position, spin) of all nodes, sparse [P, 6 size]."""
    from scipy import sparse
    of_nodes, of_holder = section.by_spins(derivative)
    values = np.concatenate((of_nodes, of_holder[:, None]), axis=1)
    column = np.broadcast_to(6 * section.roots[:, None] + 3 + np.arange(3), values.shape)
    row = np.broadcast_to(np.arange(section.pairs)[:, None, None], values.shape)
    return sparse.csr_matrix((values.reshape(-1), (row.reshape(-1), column.reshape(-1))), shape=(section.pairs, 6 * size))


def gap_of(law: Any, x: Array, at_start: Array) -> Array:
    """Gap of a joint [m], m or rad, at coordinates x [2, 4, 3], from those of the reference; 0 of a given coordinate."""
    r = x[1, 0] - x[0, 0]
    if isinstance(law, Together):
        return r
    if isinstance(law, Distance):
        return np.array([np.linalg.norm(r) - np.linalg.norm(at_start[1, 0] - at_start[0, 0])])
    if isinstance(law, Coordinate):
        return np.zeros(1)
    a, b = np.einsum("sik,skc->sic", law.turn, x[:, 1:])
    return np.array([a[i] @ (r if j < 0 else b[j]) for i, j in law.pairs]) - law.value


def largest_gap(model: Model, q: Array) -> float:
    """The largest gap of all joints with multipliers at coordinates q [12 N], m or rad."""
    x, start = (y.reshape(-1, 4, 3) for y in (q, model.q0))
    return max(float(np.max(np.abs(gap_of(link.law, x[list(link.node)], start[list(link.node)])))) for link in model.kept)


def gap_matrix(kept: list[ConstrainedJoint], q: Array) -> Any:
    """Derivative of all gaps [m, 12 N] by the coordinates, sparse, at coordinates q [N, 4, 3]."""
    from scipy import sparse
    rows, columns, data = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    m = 0
    for link in kept:
        lead = link.law.lead(q[list(link.node)]).reshape(-1, 24)
        i, j = np.nonzero(lead)
        rows.append(m + i)
        columns.append(12 * np.array(link.node)[j // 12] + j % 12)
        data.append(lead[i, j])
        m += len(lead)
    return sparse.csr_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(m, 12 * len(q)))


def curvature_of_coordinate(law: Coordinate, x: Array, force: Array) -> Array:
    """Second derivative [24, 24] of force times a coordinate."""
    of_y, of_z = (np.kron(sum((np.outer(a, b) + np.outer(b, a) for a, b in pairs), np.zeros((8, 8))), np.eye(3))
                  for pairs in law._pairs)
    if law.kind == LINE:
        return np.asarray(force[0] * of_y)
    (y, z), (a, b) = law._sums(x), law._leads(x)
    if law.kind == SWING:
        sine = max(y, NO_SWING)
        return np.asarray(-force[0] / sine * (of_z + z / sine**2 * np.outer(b, b)))
    n = y * y + z * z
    mixed = np.outer(a, b)
    bent = (z * of_y - y * of_z) / n
    bent += (2.0 * y * z * (np.outer(b, b) - np.outer(a, a)) + (y * y - z * z) * (mixed + mixed.T)) / n**2
    return np.asarray(force[0] * bent)


def curvature(law: Any, x: Array, force: Array) -> Array:
    """Second derivative [24, 24] of force . gap of a joint by the coordinates x [2, 4, 3]."""
    if isinstance(law, Coordinate):
        return curvature_of_coordinate(law, x, force)
    if isinstance(law, Distance):
        r = x[1, 0] - x[0, 0]
        length = np.linalg.norm(r)
        bent = force[0] / length * (np.eye(3) - np.outer(r, r) / length**2)
        out = np.zeros((24, 24))
        for i in (0, 12):
            for j in (0, 12):
                out[i:i + 3, j:j + 3] = bent if i == j else -bent
        return out
    out = np.zeros((8, 8))
    for f, (i, j) in zip(force, law.pairs) if isinstance(law, Conditions) else ():
        other = np.array([-1.0, 0, 0, 0, 1, 0, 0, 0]) if j < 0 else np.concatenate((np.zeros(5), law.turn[1, j]))
        out += f * np.outer(np.concatenate(([0.0], law.turn[0, i], np.zeros(4))), other)
    return np.kron(out + out.T, np.eye(3))


def misses(law: Coordinate, x: Array, value: float) -> float:
    """A coordinate of a joint less a value, of an angle the nearest of all turns."""
    y, z = law._sums(x)
    if law.kind == LINE:
        return float(y - law.at_start - value)
    u, w = np.cos(value), np.sin(value)
    return float(np.arctan2(y * u - z * w, z * u + y * w))


def reduced(matrix: Any) -> tuple[Any, Array]:
    """The columns of the nodes that a sparse matrix [k, 12 N] has entries for, [k, 12 T], and these nodes [T]."""
    nodes = np.unique(matrix.indices // 12).astype(np.int64)
    return matrix[:, (12 * nodes[:, None] + np.arange(12)).reshape(-1)], nodes


def gaps_and_rates(model: Model, q: Array, s: Array) -> tuple[Array, Array]:
    """Gaps of all constraints [F] and their derivatives by the rates of the coordinates [F, 12 N], at coordinates q [12 N] in
    space and places s [S]; sliders follow their points along the beams. 0 where nothing is held, or a function of time says what.
    """
    x, at_start = q.reshape(-1, 4, 3), model.q0.reshape(-1, 4, 3)
    n, count = len(x), model.n_sliders
    values, rates, way = [], [], np.zeros((count, n, 4, 3))
    for k in range(count):
        nodes, shapes = shapes_at(model, k, float(s[k]))
        point = int(model.sliders.point[k])  # type: ignore[union-attr]
        row = np.zeros((3, n, 4, 3))
        for c in range(3):
            row[c, nodes, 0, c], row[c, point, 0, c] = -shapes[0], 1.0
        tangent = shapes[1] @ x[nodes, 0]
        way[k] = np.tensordot(tangent, row, 1) / (tangent @ tangent)
        values.append(x[point, 0] - shapes[0] @ x[nodes, 0])
        rates.append(row)
    for link in model.kept:
        pair = list(link.node)
        row = np.zeros((link.forces(3), n, 4, 3))
        row[:, pair] = link.law.lead(x[pair])
        gap = gap_of(link.law, x[pair], at_start[pair])
        if isinstance(link.law, Distance):
            # (l^2 - L^2)/(2 L)
            length = float(np.linalg.norm(at_start[pair][1, 0] - at_start[pair][0, 0]))
            row, gap = (1.0 + gap / length) * row, gap * (1.0 + 0.5 * gap / length)
        values.append(gap)
        rates.append(row)
    for (k, _), section in zip(model.sleeve_pairs, sections(model, s, x)):
        d, held = np.einsum("a,ajc->jc", section.shapes[0], section.d), np.zeros(3)
        row = np.zeros((3, n, 4, 3))
        for p, some in enumerate(CONDITIONS[:section.pairs]):
            for f, i, j in some:
                row[p, section.nodes[:-1], 1 + j] += f * np.outer(section.shapes[0], section.axes[i])
                row[p, section.nodes[-1], 1:] += f * np.outer(section.turn[i], d[j])
            row[p] += section.values(1)[p] * way[k]
        held[:section.pairs] = section.values()
        values.append(held)
        rates.append(row)
    return np.concatenate(values), np.concatenate(rates).reshape(-1, 12 * n)
