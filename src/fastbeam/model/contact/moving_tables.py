"""Tables of beams whose elements move with contacts (moving_beam.py), and their momenta at the start."""
from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.algebra.dimensions import PLANE, SPACE
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import NoInner
from fastbeam.kernels.beams.strain_measures import SIMO_REISSNER
from fastbeam.kernels.contact.moving_beam import MovingBeam
from fastbeam.kernels.contact.moving_places import FROM_END, FROM_START, LENGTH, NODE_AT, place_at, place_of, slope_of
from fastbeam.kernels.contact.slider import Following
from fastbeam.kernels.layout import CONSTANTS, FACTORS, layout_of
from fastbeam.model.numbering import NodeList
from fastbeam.model.plane import Plane, strain_maps
from fastbeam.model.tables import TablePool, strains_by_nodes, strains_of
from fastbeam.model.workspace import scratch_of_moving
from fastbeam.scene import Beam, Slider
from fastbeam.scene.interpolation.basis import Basis, build_basis

Array = np.ndarray
# largest differences of reference strains along a beam with uniform strains
UNIFORM = 1e-7
# powers of the length by which strains of the reference are described
POWERS = 12
# up to this turn of an element, rad
LARGEST_TURN = 2.0
# smallest distance between two contacts as a share of the beam; a run ends below it
SHORTEST = 5e-4
# distance that element ends at contacts keep from the ends of the beam, as a share of the mean length of an element
KEPT = 0.25


class Mesh:
    """Beam with the sliders that its elements move with, in the order of their places. Raises SceneError: the curvature of the
    beam changes along it, or no element ends at a slider."""

    def __init__(self, beam: Beam, sliders: list[Slider]) -> None:
        self.beam, self.sliders = beam, sorted(sliders, key=lambda x: x.at)
        self.reference = _reference(beam)
        ends, at = beam.basis.element_ends, [x.at for x in self.sliders]
        low, high = (kept_from(beam, x) for x in (at[0], beam.length - at[-1]))
        self.reach = np.zeros((len(at), 4))
        self.reach[:, LENGTH], self.reach[0, FROM_START], self.reach[-1, FROM_END] = beam.length, low, high
        places = [place_at(x, beam.length, of[FROM_START], of[FROM_END]) for x, of in zip(at, self.reach)]
        self.end = np.array([int(np.argmin(np.abs(ends - x))) for x in places])
        for slider, place, end in zip(self.sliders, places, ends[self.end]):
            if abs(place - end) > 1e-9 * beam.length:
                raise SceneError(f"moving mesh of {beam.label}: slider {slider.name!r} begins at={slider.at:.10g} m and needs an "
                                 f"element end at {place:.10g} m; put one there with elements=[...], or use "
                                 "with_moving_meshes(scene)")
        self.reach[:, NODE_AT] = ends[self.end]

    @property
    def contacts(self) -> Array:
        """Nodes of the contacts, counted along the beam, int64 [S]."""
        return self.end * self.beam.degree

    def slots(self) -> tuple[Array, Array]:
        """Return the contacts around every element, -1 for ends of the beam, [E, 2], and places of its ends between them, 0 to 1,
        [E, 2]."""
        ends = self.beam.basis.element_ends
        fixed = np.concatenate(([0], self.end, [len(ends) - 1]))
        slot, share = [], []
        for k, (a, b) in enumerate(zip(fixed[:-1], fixed[1:])):
            f = (ends[a:b + 1] - ends[a]) / (ends[b] - ends[a])
            f[-1] = 1.0
            share += zip(f[:-1], f[1:])
            slot += [(k - 1, k if k < len(self.end) else -1)] * (b - a)
        return np.array(slot, np.int64), np.array(share)

    def way(self) -> Array:
        """Return the displacement of every node along the beam for that of each contact, dx/ds [n, S]."""
        slot, share = self.slots()
        p, out = self.beam.degree, np.zeros((self.beam.n_nodes, len(self.end)))
        local = build_basis("lagrange", p, 1, 1.0).node_s
        for e, (of, f) in enumerate(zip(slot, share)):
            at = f[0] + local * (f[1] - f[0])
            for side, part in ((0, 1.0 - at), (1, at)):
                if of[side] >= 0:
                    out[p * e:p * e + p + 1, of[side]] = part
        return out

    def around(self) -> list[Array]:
        """Return the nodes of the elements between every contact and its neighbours, counted along the beam, element ends
        first."""
        nodes, (slot, _) = self.beam.basis.element_nodes, self.slots()
        found = [np.unique(nodes[(slot == k).any(axis=1)]) for k in range(len(self.end))]
        return [some[np.argsort(some % self.beam.degree != 0, kind="stable")] for some in found]

    def nodes(self, numbers: NodeList) -> Array:
        """Return the nodes of every element, int64 [E, p + 1]."""
        return np.asarray(numbers.start(self.beam) + self.beam.basis.element_nodes, np.int64)

    def table(self, numbers: NodeList, tables: ElementTables, gravity: Array, sliders: Array, following: Following) -> MovingBeam:
        """Build the constants of the term; tables: of its elements; sliders: their numbers [S]. Places in the history and numbers
        of contacts are set later."""
        beam, at = self.beam, self.nodes(numbers)
        n, p = beam.degree + 1, beam.degree
        unit: Basis = build_basis("lagrange", p, 1, 1.0)
        slot, share = self.slots()
        entry = np.full((len(at), 2, n), -1)
        for k, nodes in enumerate(self.around()):
            e, side = np.nonzero(slot == k)
            entry[e, side] = np.argsort(nodes)[np.searchsorted(np.sort(nodes), beam.basis.element_nodes[e])]
        _, values, slopes = unit.curve("own").evaluate(unit.mass_point_s[0])
        section, edge = beam.section, unit.curve("own").evaluate(np.array((0.0, 1.0)))[2]
        rho = np.array((section.inertia[0], 0.0, *section.inertia[1:]), dtype=float)
        reference, weight = self.reference - beam.start_strain, unit.weight[0].copy()
        return MovingBeam(
            SIMO_REISSNER, tables, NoInner(), following, _lanes(len(at)), np.ascontiguousarray(at),
            entry, np.array((0, numbers.start(beam), beam.n_nodes, 0, 0), np.int64), slot, sliders,
            np.zeros(1, np.int64), share, np.array((beam.length, SHORTEST * beam.length)),
            np.ascontiguousarray(np.stack((values, slopes))), np.stack((unit.mass_point_s[0], unit.mass_weight[0])),
            np.ascontiguousarray(np.stack((unit.phi[0], unit.phi_s[0]))), edge, weight, np.array(section.C, dtype=float),
            reference,
            *self._rest(unit, float(np.max(share[:, 1] - share[:, 0])) * beam.length), rho,
            rho[0] * np.asarray(gravity, dtype=float), np.zeros(36),
            scratch_of_moving(n, weight.size, unit.mass_weight.shape[1]), np.zeros(len(tables.meta) * 2 * (n - 2) * 48))

    def _rest(self, unit: Basis, longest: float) -> tuple[Array, Array, Array]:
        """Describe length times strains of an element whose nodes lie on the reference, which its interpolation does not strain:
        by powers of its length [K, points, 6] up to a length [1], at most `longest`, and the derivative there [points, 6]."""
        beam, x, bent = self.beam, unit.node_s, float(np.linalg.norm(self.reference[3:]))
        shape = unit.phi.shape[1], 6
        if not bent:
            slope = np.broadcast_to(self.reference - beam.start_strain, shape).copy()
            return np.stack((0.0 * slope, slope)), np.array([np.inf]), slope
        until = min(longest, LARGEST_TURN / bent)
        at = 0.5 - 0.5 * np.cos(np.pi * (np.arange(2 * POWERS) + 0.5) / (2 * POWERS))
        found = []
        for h in until * at:
            phi, triads = (np.asarray(y) for y in beam.reference(h * x))
            slopes = [np.einsum("gn,n...->g...", unit.phi_s[0], y - y[:1]) for y in (phi, triads)]
            strains = strains_of(beam.strain, slopes[0], np.einsum("gn,nkc->gkc", unit.phi[0], triads), slopes[1])
            found.append(strains / h - beam.start_strain)
        fit = np.linalg.lstsq(np.vander(at, POWERS, increasing=True), np.reshape(found, (at.size, -1)), rcond=None)[0]
        powers = np.arange(POWERS)[:, None, None]
        rest = np.concatenate((np.zeros((1, *shape)), fit.reshape(POWERS, *shape) / until**powers))
        return rest, np.array([until]), np.sum((powers + 1) * rest[1:] * until**powers, axis=0)


def kept_from(beam: Beam, at: float) -> float:
    """Return the distance that the element end of a contact keeps from an end of its beam, m; at: distance of the contact at the
    start, of which it is at most half where an element ends there."""
    ends = beam.basis.element_ends[1:-1]
    own = at > 0.0 and bool(np.min(np.abs(np.concatenate((ends, beam.length - ends)) - at), initial=np.inf) < 1e-9 * beam.length)
    return min(KEPT * beam.length / beam.n_elements, 0.5 * at if own else np.inf)


def table_in_plane(table: MovingBeam, plane: Plane) -> MovingBeam:
    """Return the term of a beam for nodes with 3 unknowns in a plane, in which it lies and stays."""
    n, points, first = table.node.shape[1], table.weight.size, int(table.node[0, 0])
    cos, sin = float(plane.factor[first, 1].imag), float(plane.normal[first, 1])
    within = strain_maps(np.array(cos), np.array(sin))[0]
    space, flat = layout_of(SPACE, n, points), layout_of(PLANE, n, points)
    meta, pool = table.tables.meta.copy(), TablePool()
    shares = np.array((cos * cos, sin * sin))
    for k, offset in enumerate(meta[:, CONSTANTS].tolist()):
        of = table.tables.tab[offset:offset + space.table_size].reshape(-1, 8)
        C = np.einsum("ia,ijl,jb->abl", within, of[:36].reshape(6, 6, 8), within).reshape(9, 8)
        inertia, behind = of[space.inertia // 8:space.masses // 8], of[space.masses // 8:]
        rows = np.concatenate((C, of[36:space.inertia // 8], inertia[:1], shares @ inertia[1:], behind), axis=None)
        meta[k, CONSTANTS] = pool.append(rows[None])[0]
    # where they stand is scaled as in `planar._inner`
    meta[:, FACTORS] = np.where(meta[:, FACTORS] >= 0, meta[:, FACTORS] // 4, -1)
    rho = np.array((table.rho[0], shares @ table.rho[2:]))
    # vectors of the history by coordinates of the plane, a + i b by those along x and y
    turned = np.concatenate(((1.0,), plane.factor[first] * (table.rho[1:] != 0.0)))[:, None] * np.array((1.0, 1j))
    to_space = np.stack((turned.real, turned.imag), axis=2) @ plane.axes[:2]
    place = table.place.copy()
    inert = 1 + int(np.argmax(np.abs(turned[1:, 0])))
    place[4] = 3 * inert
    to_plane = np.concatenate((to_space[0], np.linalg.pinv(to_space[inert]).T))
    assert rows.size == flat.table_size
    return table._replace(tables=table.tables._replace(meta=meta, tab=pool.array()), rest=table.rest @ within,
                          rest_slope=table.rest_slope @ within, rho=rho, weighs=plane.axes[:2] @ table.weighs,
                          place=place, within=np.concatenate((to_plane, to_space), axis=None))


def _lanes(elements: int) -> Array:
    """Return the element of every lane of groups of 8; idle lanes repeat the last."""
    return np.minimum(np.arange(-(-elements // 8) * 8), elements - 1)


def _reference(beam: Beam) -> Array:
    """Return the strains of the reference, uniform along the beam, [6]."""
    fine = build_basis("lagrange", 8, 16, beam.length)
    phi, triads = beam.reference(fine.node_s)
    q = np.concatenate((phi[:, None], triads), axis=1)[fine.element_nodes]
    slopes = np.einsum("egn,enic->egic", fine.phi_s, q - q[:, :1])
    found = strains_of(beam.strain, slopes[:, :, 0], np.einsum("egn,enic->egic", fine.phi, q)[:, :, 1:], slopes[:, :, 1:])
    strains = found.reshape(-1, 6)
    mean = np.asarray(strains.mean(axis=0))
    scale = np.array((1.0, 1.0, 1.0, *[1.0 / beam.length] * 3)) + np.abs(mean)
    if np.max(np.abs(strains - mean) / scale) > UNIFORM:
        raise SceneError(f"moving mesh of {beam.label}: its reference curvature varies along the beam, but reference strains of "
                         "moving elements must not; use a straight beam, an arc or a helix")
    mean[np.abs(mean) < UNIFORM * 1e-3 * scale] = 0.0
    return mean


def places_of(table: MovingBeam, s: Array) -> Array:
    """Return the places of the element ends at the contacts of a beam, with the places of all sliders: [S], m."""
    return np.array([place_of(table.following, table.first[0] + j, s[k]) for j, k in enumerate(table.slider)])


def slopes_of(table: MovingBeam, s: Array) -> Array:
    """Return the derivatives of `places_of` by the places of the contacts, [S]."""
    return np.array([slope_of(table.following, table.first[0] + j, s[k]) for j, k in enumerate(table.slider)])


def element_lengths(table: MovingBeam, s: Array) -> Array:
    """Return the lengths of elements between contacts, with the places of all sliders: [E], m."""
    ends = np.where(table.slot >= 0, places_of(table, s)[table.slot], (0.0, table.length[0]))
    return np.asarray((table.share[:, 1] - table.share[:, 0]) * (ends[:, 1] - ends[:, 0]))


def element_ends(table: MovingBeam, s: Array) -> Array:
    """Return the ends of the elements of a beam, with the places of all sliders: [E + 1], m."""
    return np.concatenate(([0.0], np.cumsum(element_lengths(table, s))[:-1], table.length[:1]))


def node_places(table: MovingBeam, s: Array) -> Array:
    """Return the arc lengths of the nodes of a beam, with the places of all sliders: [n], m."""
    at, _ = unit_element(table.node.shape[1] - 1)
    inside = element_ends(table, s)[:-1, None] + element_lengths(table, s)[:, None] * at[:-1]
    return np.append(inside.reshape(-1), table.length[0])


class OfRates(NamedTuple):
    """Momenta of the points of an element, by mass, as linear functions of some rates."""

    columns: Array  # int64 [m]: numbers of the rates among those of all coordinates, then places of contacts, [12 N + F]
    matrix: Array  # float64 [points, 4, 3, m]: zero for fields without inertia
    length: float  # length of the element, m


def of_rates(table: MovingBeam, q: Array, s: Array) -> Iterator[OfRates]:
    """Yield the momenta of all elements at coordinates [N, 4, 3] and places of all sliders, theory.md (5.19): h a less x_t g."""
    values, slopes = table.mass_shape
    x, n = table.mass_point[0], table.node.shape[1]
    vector, component = np.divmod(np.arange(12), 3)
    along = slopes_of(table, s)
    for nodes, slots, (begin, end), h in zip(table.node, table.slot, table.share, element_lengths(table, s)):
        live = slots >= 0
        columns = np.concatenate(((12 * nodes[:, None] + np.arange(12)).reshape(-1), 12 * len(q) + table.first[0] + slots[live]))
        matrix = np.zeros((x.size, 4, 3, columns.size))
        for i in range(n):
            matrix[:, vector, component, 12 * i + np.arange(12)] = h * values[:, i, None]
        f = begin + x * (end - begin)
        slope = np.einsum("gn,nkc->gkc", slopes, q[nodes])
        matrix[..., 12 * n:] = -slope[..., None] * (np.stack((1.0 - f, f), axis=1)[:, live] * along[slots[live]])[:, None, None]
        yield OfRates(columns, matrix * (table.rho != 0.0)[:, None, None], float(h))


@cache
def unit_element(degree: int) -> tuple[Array, Any]:
    """Return the nodes of an element of length 1 [n], and its shape functions as a curve."""
    unit = build_basis("lagrange", degree, 1, 1.0)
    return unit.node_s, unit.curve("own")


def ways_of(table: MovingBeam, q: Array, s: Array, nodes: int) -> Any:
    """Return the motion of the nodes of a beam along it, (v, spin) of so many nodes for ds/dt of its contacts, sparse
    [6 nodes, S], at coordinates [N, 4, 3] and places of all sliders. At element ends slopes are means of both sides."""
    n, (begin, end) = table.node.shape[1], table.share.T
    at, curve = unit_element(n - 1)
    slopes = curve.evaluate(at)[2]
    # d/ds of the coordinates at the nodes of every element
    found = np.einsum("ab,ebkc->eakc", slopes, q[table.node]) / element_lengths(table, s)[:, None, None, None]
    d = q[table.node][:, :, 1:]
    motion = np.concatenate((found[:, :, 0], 0.5 * np.cross(d, found[:, :, 1:]).sum(axis=2)), axis=2)
    share = begin[:, None] + at * (end - begin)[:, None]
    count = np.bincount(table.node.reshape(-1), minlength=nodes)
    motion /= count[table.node][:, :, None]
    rows, columns, values, along = [], [], [], slopes_of(table, s)
    for side, part in ((0, 1.0 - share), (1, share)):
        e = np.flatnonzero(table.slot[:, side] >= 0)
        rows.append(6 * table.node[e][:, :, None] + np.arange(6))
        columns.append(np.broadcast_to(table.slot[e, side][:, None, None], rows[-1].shape))
        values.append(motion[e] * (part[e] * along[table.slot[e, side], None])[:, :, None])
    flat = [np.concatenate([x.reshape(-1) for x in some]) for some in (values, rows, columns)]
    return sparse.csr_matrix((flat[0], (flat[1], flat[2])), shape=(6 * nodes, table.slider.size))


def rest_strains(table: MovingBeam, h: Array) -> Array:
    """Return the reference strains of elements of these lengths [E], which may be complex, [E, points, 6]."""
    h = h[:, None, None]
    x, value = np.where(h.real < table.rest_until, h, table.rest_until), np.zeros((1, *table.rest.shape[1:]))
    for power in table.rest[::-1]:
        value = value * x + power
    beyond = np.where(h.real < table.rest_until, 0.0, h - x)
    return np.asarray((value + beyond * table.rest_slope) / h)


class Elements(NamedTuple):
    """Elements of a beam where they are, with points of the stored energy."""

    slopes: Array  # float64 [E, points, n]: derivatives of shape functions by the arc length
    values: Array  # float64 [E, points, n]: shape functions
    weights: Array  # float64 [E, points]: lengths that points stand for, m
    stiffness: Array  # float64 [6, 6]
    columns: Array  # int64 [E, 12 n]: numbers of the coordinates

    def strains_by(self, q: Array) -> Array:
        """Return the derivatives of strains at coordinates [E, n, 4, 3] by these, [E, points, 6, 12 n]."""
        return strains_by_nodes("simo_reissner", q, self.slopes, self.values, self.slopes)


def elements_at(table: MovingBeam, s: Array) -> Elements:
    """Return the elements of a beam with the places of all sliders."""
    h = element_lengths(table, s)
    slopes = table.shape[1] / h[:, None, None]
    columns = (12 * table.node[:, :, None] + np.arange(12)).reshape(len(h), -1)
    return Elements(slopes, np.broadcast_to(table.shape[0], slopes.shape), h[:, None] * table.weight, table.stiffness, columns)


def material_stiffness(table: MovingBeam, q: Array, s: Array) -> Any:
    """Assemble the stiffness of the material of a beam at coordinates [N, 4, 3], without that by its stresses, the elements where
    they are with the places of all sliders: sparse [12 N, 12 N]."""
    of = elements_at(table, s)
    by = of.strains_by(q[table.node])
    blocks = np.einsum("eg,egij,ik,egkl->ejl", of.weights, by, of.stiffness, by, optimize=True)
    return by_elements(blocks, of.columns, q.size)


def by_elements(blocks: Array, columns: Array, size: int) -> Any:
    """Sum matrices of elements [E, m, m] with these numbers of their rows and columns [E, m], sparse [size, size]."""
    row, column = np.broadcast_arrays(columns[:, :, None], columns[:, None, :])
    return sparse.csr_matrix((blocks.reshape(-1), (row.reshape(-1), column.reshape(-1))), shape=(size, size))


def momenta(table: MovingBeam, q: Array, s: Array, rates: Array) -> Array:
    """Return the momenta by mass of points of the elements, as in the history, [E, points, 4, 3], at coordinates [N, 4, 3],
    places of all sliders, and rates of both [12 N + F]; 0 for fields without inertia."""
    return np.array([one.matrix @ rates[one.columns] for one in of_rates(table, q, s)])


def masses(table: MovingBeam) -> Array:
    """Return the masses of the points of an element for its length 1, by fields, [points, 4], kg/m."""
    return np.outer(table.mass_point[1], table.rho)


def mass_matrix(table: MovingBeam, q: Array, s: Array, size: int) -> Any:
    """Assemble the mass matrix for the rates of all coordinates and places of contacts at coordinates [N, 4, 3] and places of all
    sliders, (5.20): sparse [size, size]."""
    c, rows, columns, entries = masses(table), [], [], []
    for one in of_rates(table, q, s):
        block = np.einsum("gk,gkci,gkcj->ij", c / one.length, one.matrix, one.matrix, optimize=True)
        i, j = np.broadcast_arrays(one.columns[:, None], one.columns)
        rows.append(i.reshape(-1))
        columns.append(j.reshape(-1))
        entries.append(block.reshape(-1))
    at = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_matrix((np.concatenate(entries), at), shape=(size, size))
