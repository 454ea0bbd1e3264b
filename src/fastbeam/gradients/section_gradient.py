"""Gradients by the sections of all beams at once, from one adjoint shape (theory.md (13.6))."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.contact.moving_beam import MovingBeam
from fastbeam.kernels.layout import CONSTANTS, LIST, NODES, POINTS, REFERENCE, layout_of
from fastbeam.kernels.state import State
from fastbeam.model.contact.moving_tables import element_lengths, rest_strains, slopes_of
from fastbeam.model.model import Model
from fastbeam.model.tables import strains_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray
# a complex step: derivatives without differences
TINY = 1e-40


def _entry(k: int) -> Any:
    """Make a property: derivatives by an entry of the diagonal of C, [beams]."""
    return property(lambda found: found.stiffness[:, k, k])


class SectionGradient(NamedTuple):
    """Derivatives by the section of every beam of a part, [beams] each: of a beam one, of a net one of each beam. The strains of
    the reference stay: with `prestress=` P that is C^-1 P, which a parameter of `sensitivity` changes with C.

    Attributes
    ----------
    stiffness : float64 [beams, 6, 6]
        Derivatives by C (theory.md (2.3)): the change is the sum of its products with those of a symmetric change of C.
    EA, GA2, GA3, GJ, EI2, EI3 : float64 [beams]
        Derivatives by the entries of its diagonal, per N and N m^2.
    rhoA : float64 [beams]
        Derivatives by the mass per length, through gravity.
    prestrain : float64 [beams, 6]
        Derivatives by e of theory.md (2.8): the first column is that by `prestrain=`, and minus it over the length of a beam that
        by its unstressed length, with the same mass; e of `prestress=` P is C^-1 (P, 0, 0, 0, 0, 0).
    """

    stiffness: Array
    rhoA: Array  # noqa: N815  the field's symbols
    prestrain: Array

    EA, GA2, GA3, GJ, EI2, EI3 = (_entry(k) for k in range(6))

    def by(self, sections: tuple[ArrayLike, ArrayLike]) -> Array:
        """Return derivatives by a parameter of the sections, [beams].

        Parameters
        ----------
        sections : tuple
            Derivative of C by the parameter, (6, 6) or one of every beam, and that of rhoA.
        """
        stiffness, density = sections
        return np.sum(self.stiffness * np.asarray(stiffness), axis=(1, 2)) + self.rhoA * np.asarray(density)


class Lanes(NamedTuple):
    """Elements with equal numbers of nodes and points. Along a motion of their mesh arrays are complex, with its rates times
    `TINY`."""

    strain: str
    nodes: Array      # int [E, nn]
    weight: Array     # float64 [E, nq], m
    shapes: Array     # float64 [E, nq, nn, 3]: phi_s, dir, dir_s
    reference: Array  # float64 [E, nq, 6]
    mass: Array       # float64 [E, nn, nn], m: of positions
    turning: Array    # float64 [E, nn, nn], m: of directors
    stiffness: Array  # float64 [E, 6, 6]


def lanes_of(model: Model) -> list[Lanes]:
    """Return all elements of a model in space, read from its tables (kernels/layout.py)."""
    out = []
    for name, tables in (("simo_reissner", model.simo), ("green_lagrange", model.green)):
        if tables is None:
            continue
        for nn, nq in np.unique(tables.meta[:, [NODES, POINTS]], axis=0).tolist():
            meta = tables.meta[(tables.meta[:, NODES] == nn) & (tables.meta[:, POINTS] == nq)]
            at = layout_of(SPACE, nn, nq)

            def rows(begin: int, column: int, count: int, meta: Array = meta, tab: Array = tables.tab) -> Array:
                """Return `count` rows of 8 lanes of every group: [groups 8, count]."""
                where = meta[:, column][:, None] + begin + np.arange(8 * count)
                return tab[where].reshape(len(meta), count, 8).transpose(0, 2, 1).reshape(-1, count)

            points = rows(at.point, CONSTANTS, nq * at.point_size // 8).reshape(-1, nq, at.point_size // 8)
            where = meta[:, LIST][:, None] + np.arange(8 * nn)
            nodes = tables.nodes[where].reshape(len(meta), nn, 8).transpose(0, 2, 1).reshape(-1, nn)
            live = tables.rows[where].reshape(len(meta), nn, 8)[:, 0].reshape(-1) != model.n_nodes
            out.append(Lanes(name, nodes[live], points[live, :, 0], points[live, :, 1:1 + 3 * nn].reshape(-1, nq, nn, 3),
                              rows(0, REFERENCE, 6 * nq, tab=model.reference_strains).reshape(-1, nq, 6)[live],
                              *(rows(x, CONSTANTS, nn * nn).reshape(-1, nn, nn)[live] for x in (at.masses, at.director_masses)),
                              moduli_of(tables._replace(meta=meta), 6)[live]))
    return out


def moving_lanes(table: MovingBeam, s: Array, along: Array) -> Lanes:
    """Return the elements of a beam that move, at places of all sliders [S], along the motion of these [S]."""
    h = element_lengths(table, s)
    # lengths are linear in the places of element ends
    ends = np.append(slopes_of(table, s) * along[table.slider], 0.0)[table.slot]
    h = h + 1j * TINY * (table.share[:, 1] - table.share[:, 0]) * (ends[:, 1] - ends[:, 0])
    of_length = h[:, None, None]
    values, slopes = table.shape[0] + 0.0 * of_length, table.shape[1] / of_length
    mass = np.einsum("g,gn,gm->nm", table.mass_point[1], table.mass_shape[0], table.mass_shape[0]) * of_length
    return Lanes("simo_reissner", table.node, h[:, None] * table.weight, np.stack((slopes, values, slopes), axis=3),
                 rest_strains(table, h), mass, mass, np.broadcast_to(table.stiffness, (h.size, 6, 6)))


def moduli_of(tables: ElementTables, size: int) -> Array:
    """Return C of all elements of tables with so many strains, [8 groups, size, size]."""
    where = tables.meta[:, CONSTANTS][:, None] + np.arange(8 * size * size)
    return np.asarray(tables.tab[where].reshape(-1, size, size, 8).transpose(0, 3, 1, 2).reshape(-1, size, size))


def beam_numbers(model: Model) -> tuple[Array, dict[str, slice]]:
    """Return the number of the beam of every node (-1: none), int [N], and which numbers belong to which beam or net."""
    of, parts = np.full(model.n_nodes, -1), {}
    count = 0
    for entry in model.names.get("beams", []):
        of[entry["first"]:entry["first"] + entry["count"]] = count
        parts[entry["name"]] = slice(count, count + 1)
        count += 1
    for entry in model.names.get("nets", []):
        starts = np.asarray(entry["starts"])
        sizes = np.diff(np.append(starts, entry["count"]))
        of[entry["first"]:entry["first"] + entry["count"]] = count + np.repeat(np.arange(starts.size), sizes)
        parts[entry["name"]] = slice(count, count + starts.size)
        count += starts.size
    return of, parts


def section_gradients(model: Model, state: State, adjoint: Array, energy: float, gravity: Array) -> dict[str, SectionGradient]:
    """Return the gradients of an objective by the sections of all beams.

    model: Model in space, without condensed beams.
    state: the equilibrium.
    adjoint: float64 [12 N + S], rates of all coordinates and places of sliders along the adjoint solution.
    energy: weight of the strain energy in the objective.
    gravity: float64 [3], gravity times its load factor, m/s^2.
    """
    of, parts = beam_numbers(model)
    n = max((x.stop for x in parts.values()), default=0)
    stiffness, prestrain, density = np.zeros((n, 6, 6)), np.zeros((n, 6)), np.zeros(n)
    along, places = np.split(adjoint, [state.q.size])
    q = (state.q + 1j * TINY * along).reshape(-1, 4, 3)
    moving = () if model.moving is None else model.moving.tables
    for lanes in [*lanes_of(model), *(moving_lanes(table, state.s, places) for table in moving)]:
        x = q[lanes.nodes]
        f = np.einsum("egn,enc->egc", lanes.shapes[..., 0], x[:, :, 0])
        d, k = (np.einsum("egn,enkc->egkc", lanes.shapes[..., i], x[:, :, 1:]) for i in (1, 2))
        strain = strains_of(lanes.strain, f, d, k) - lanes.reference
        # derivatives of the strain energy, and along the adjoint solution of that and of the energy of gravity
        by_c = 0.5 * np.einsum("eg,egi,egj->eij", lanes.weight, strain, strain)
        by_strain = np.einsum("eij,eg,egj->ei", lanes.stiffness, lanes.weight, strain)
        height = np.einsum("en,enc,c->e", lanes.mass.sum(axis=2), x[:, :, 0], gravity)
        own = of[lanes.nodes[:, 0]]
        np.add.at(stiffness, own, energy * by_c.real - by_c.imag / TINY)
        np.add.at(prestrain, own, energy * by_strain.real - by_strain.imag / TINY)
        np.add.at(density, own, height.imag / TINY)
    return {name: SectionGradient(stiffness[part], density[part], prestrain[part]) for name, part in parts.items()}
