"""Damping of sections and drag: tables, names of their energies, and offsets of these in `State.history`."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fastbeam.kernels.beams.damping import Dissipation
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.section_laws import KELVIN_VOIGT
from fastbeam.kernels.beams.strain_measures import GreenLagrange, SimoReissner
from fastbeam.kernels.forces.drag import AirSchedule, Drag, NoWind, Wind
from fastbeam.kernels.layout import LIST
from fastbeam.model.analyses import Analysis, Lack, dissipating, timed_loads, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Feature, OfRun, Span, Stand
from fastbeam.model.forces.loads import factor_at, mean_factors
from fastbeam.model.forces.user_forces import wind_of
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import Elements, node_lengths
from fastbeam.scene import Beam, Net, Scene

Array = np.ndarray
# coefficients of drag
COEFFICIENTS = "normal", "tangential", "linear"


def _air_moves(what: str, text: str, instead: str, moves: Callable[[Dragged], Array]) -> Lack:
    """Declare that the damping of small motions by drag in moving air is not known; moves: bool [D]."""
    return Lack((Analysis.DAMPED,), what, text, instead,
                lambda dragged, asked: [dragged.labels[k] for k in np.unique(dragged.part[moves(dragged)])])


@dataclass(frozen=True)
class Damped(Feature):
    """Beams and nets with damping."""

    key, title, order = "damped", "damping of sections", 30
    lacks = (
        unknown_to_methods("damping", lambda damped, asked: damped.losses),
        dissipating("damping", lambda damped, asked: damped.losses),
        Lack((Analysis.FILTERED,), "damping", "rho_inf: {name} has material damping, which grows with the frequency already",
             "leave rho_inf out, or leave out damping of sections", lambda damped, asked: damped.labels))

    labels: tuple[str, ...]
    strains: tuple[str, ...]  # strain sets of the beams and nets
    part: Array  # int64 [N]: number of the beam or net of every node, -1: none

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of the dissipated energies in the balance."""
        return tuple(f"damping of {label}" for label in self.labels)

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the terms that account the energies of damped elements."""
        model = run.model
        if run.static:
            return []
        sets = ("simo_reissner", SimoReissner, model.simo), ("green_lagrange", GreenLagrange, model.green)
        return [(Stand.LOSSES, self._account(kind(KELVIN_VOIGT), tables, model.losses_for(Damped)))
                for name, kind, tables in sets if tables is not None and name in self.strains]

    def section_law(self, strain: str, law: Any, static: bool) -> Any:
        """Return the law with damping, in statics the elastic one."""
        return KELVIN_VOIGT if strain in self.strains and not static else law

    def _account(self, strains: Any, tables: ElementTables, first: int) -> Dissipation:
        meta = tables.meta
        lanes = meta[:, LIST, None] + np.arange(8)
        part = self.part[tables.nodes[lanes]]
        # idle lanes have the row behind the last
        live = tables.rows[lanes] < self.part.size
        return Dissipation(strains, tables, np.where((part >= 0) & live, first + part, -1).reshape(-1))


def damped_of(scene: Scene, nodes: NodeList) -> Damped | None:
    """Build the feature of damped sections; None where no section has damping."""
    parts: list[Beam | Net] = [beam for beam in scene.beams if np.any(beam.section.damping)]
    parts += [net for net in scene.nets if any(np.any(section.damping) for section in net.sections)]
    if not parts:
        return None
    number = np.full(len(nodes), -1)
    for k, part in enumerate(parts):
        number[nodes.span(part)] = k
    return Damped(tuple(part.label for part in parts), tuple(part.strain for part in parts), number)


@dataclass(frozen=True)
class Dragged(Feature):
    """Nodes with drag."""

    key, title, order = "dragged", "drag", 50
    lacks = (
        Lack((Analysis.PLANAR,), "wind=", "wind= of a drag may lead out of a plane", "use planar='auto'",
             lambda dragged, asked: dragged.labels[:dragged.windy]),
        unknown_to_methods("drag", lambda dragged, asked: dragged.labels),
        dissipating("drag", lambda dragged, asked: dragged.labels),
        timed_loads(lambda dragged, asked: dragged.labels if dragged.blows and dragged.timed else ()),
        Lack((Analysis.TIME_SPAN,), "air that changes in time",
             "{who}: the air of {name} changes in time, so its force between two times depends on more than these times",
             "give one time; the air velocity then grows from zero",
             lambda dragged, asked: dragged.labels if dragged.blows and (dragged.timed or dragged.windy) else ()),
        Lack((Analysis.STEADY,), "drag", "{who}: drag of {name} would brake the steady motion itself",
             "leave it out", lambda dragged, asked: dragged.labels),
        _air_moves("wind=", "{name}: its air moves by wind=, and damping of small motions by such air is not implemented",
                   "leave wind= out, or run in time", lambda dragged: dragged.asks_wind),
        _air_moves("air=", "{name}: its air moves, and damping of small motions by moving air is not implemented",
                   "leave air= out, or run in time", lambda dragged: np.any(dragged.air != 0.0, axis=1)),
        without_adjoint("air that changes in time",
                        lambda dragged, asked: ["air that changes in time"] * (dragged.timed or dragged.windy)))

    labels: tuple[str, ...]  # labels of the drags
    # node, part, int64 [D]: nodes, and number of the drag of each
    node: Array
    part: Array
    coefficient: Array  # float64 [D, 3]: normal, tangential and linear coefficients of whole nodes
    slender: Array  # int64 [D]: 1 where drag depends on d1
    air: Array  # float64 [D, 3]: velocity of the air, m/s
    times: tuple[Any, ...] = ()  # factor of the air velocity of every drag as a function of time
    wind: Wind | NoWind = NoWind()  # velocities of the air by user functions
    table: Drag | None = None  # the term
    called_laws: Mapping[type, Any] = field(default_factory=dict)  # laws of wind

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of the dissipated energies in the balance."""
        return self.labels

    @property
    def asks_wind(self) -> Array:
        """True for nodes whose air velocity a function gives, bool [D]."""
        return self.wind.laws.address != 0 if isinstance(self.wind, Wind) else np.zeros(self.node.size, bool)

    @property
    def timed(self) -> bool:
        """True if the velocity of the air has a time factor."""
        return any(time is not None for time in self.times)

    @property
    def blows(self) -> bool:
        """True if the air moves: it exerts forces at rest."""
        return self.windy or bool(np.any(self.air))

    @property
    def turns(self) -> bool:
        """True if the forces of moving air at rest depend on the shape."""
        return self.blows and (self.windy or bool(np.any(self.slender)))

    @property
    def windy(self) -> bool:
        """True if functions of place and time give the velocity of the air."""
        return isinstance(self.wind, Wind)

    def in_plane(self, plane: Any, model: Any, constraints: int) -> Dragged:
        """Return a copy whose table has the velocity of the air in a plane."""
        assert self.table is not None
        return replace(self, table=self.table._replace(air=(self.table.air.reshape(-1, 3) @ plane.axes[:2].T).reshape(-1)))

    def factors_at(self, t: float) -> Array:
        """Return the time factor of the air at time t, s, for every node, [D]."""
        return np.array([1.0 if time is None else factor_at(time, t, f"of {label}")
                         for time, label in zip(self.times, self.labels)])[self.part]

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the term of drag; in statics that of moving air."""
        if self.table is None or run.static and not self.blows:
            return []
        term = self.table
        if run.static:
            # coefficients and air velocity depend on load factor and time
            term = term._replace(**{name: getattr(term, name).copy() for name in (*COEFFICIENTS, "air")})
        elif self.timed:
            # every run has its own air velocity
            term = term._replace(air=term.air.copy())
        if isinstance(term.wind, Wind) and run.law_work is not None:
            term = term._replace(wind=term.wind._replace(work=run.law_work))
        return [(Stand.AIR, term)]

    def schedules(self, span: Span) -> list[tuple[Stand, Any]]:
        """Tabulate the velocity of air that changes in time."""
        if not self.timed:
            return []
        assert self.table is not None
        own = next(term for term in span.terms if isinstance(term, Drag))
        factors = np.ones((len(span.starts), len(self.times)))
        for k, time in enumerate(self.times):
            if time is not None:
                factors[:, k] = mean_factors(time, span.starts, span.lengths, f"of {self.labels[k]}")
        return [(Stand.AIR, AirSchedule(own.air, self.table.air, self.part, factors))]

    def with_table(self, row_of: Array, block: Array, first: int) -> Dragged:
        """Return a copy with its table; block: diagonal blocks [D]; first: offset of the first drag in the history."""
        return replace(self, table=Drag(self.node, row_of[self.node], block, *np.ascontiguousarray(self.coefficient.T),
                                        self.slender, self.air.reshape(-1), first + self.part, self.wind))


def in_fluid(parts: list[Any], nodes: NodeList, elements: list[Elements]) -> tuple[Array, Array, Array, Array]:
    """Return the nodes of drags or added masses, the number of the part of each, whether its coefficients are per length, and the
    length that they count with, or 1."""
    length = sum((node_lengths(x.nodes, x.mass_phi, len(nodes)) for x in elements), np.zeros(len(nodes)))
    node = [np.arange(len(nodes))[nodes.span(x.on)] for x in parts]
    part = np.repeat(np.arange(len(node)), [x.size for x in node])
    every = np.concatenate(node)
    slender = np.array([x.is_slender for x in parts])[part]
    return every, part, slender, np.where(slender, length[every], 1.0)


def dragged_of(scene: Scene, nodes: NodeList, elements: list[Elements]) -> Dragged | None:
    """Build the feature of drag; None without drag. elements: of every beam, then of every net."""
    if not scene.drags:
        return None
    every, part, slender, size = in_fluid(scene.drags, nodes, elements)
    given = np.array([(drag.normal, drag.tangential, drag.linear) for drag in scene.drags])[part]
    return Dragged(tuple(f"{drag.label} on {drag.on.label}" for drag in scene.drags), every, part,
                   size[:, None] * given, slender.astype(np.int64),
                   np.array([drag.air for drag in scene.drags], dtype=float)[part], tuple(drag.time for drag in scene.drags),
                   wind_of(scene.drags, part, nodes.phi[every]))
