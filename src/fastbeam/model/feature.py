"""Feature of a compiled scene: the questions that the compiler, steps, rows and analyses ask all features, none of which they
know by name."""
from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, auto
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from fastbeam.kernels.state import State
from fastbeam.model.analyses import Lack

Array = np.ndarray


class Stand(IntEnum):
    """Order of terms in a run, and of schedules in a span; sums are formed in this order."""

    MOVING = auto()
    SLIDING = auto()
    INNER = auto()
    BEAMS = auto()
    LOSSES = auto()
    DRIVES = auto()
    MOTORS = auto()
    SUPPORTS = auto()
    LOADS = auto()
    BODIES = auto()
    AIR = auto()
    WATER = auto()
    LINKS = auto()
    JOINTS = auto()
    TIES = auto()
    REACTIONS = auto()
    HELD = auto()


class OfRun(NamedTuple):
    """Data from which features build the terms of a run."""

    model: Any  # Model
    static: bool = False  # true for the terms of an equilibrium
    inner: Any = None  # eliminated nodes with the work arrays of the run
    own: Mapping[str, Any] = MappingProxyType({})  # results of `Feature.work`, by the keys of features
    law_work: Any = None  # work array of laws
    known: bool = False  # true for multipliers of joint coordinates that are taken from the state, without equations for them


@dataclass(frozen=True)
class Span:
    """n steps of size h, the first from time t + done h, of a run."""

    # own, terms: results of `Feature.work`, as in `OfRun`, and the terms of the run
    own: Mapping[str, Any]
    terms: tuple[Any, ...]
    plane: Any  # Plane or None
    weights: Array  # float64 [m]: substeps of a step as fractions of it
    t: float
    h: float
    n: int
    done: int

    @cached_property
    def starts(self) -> Array:
        """Times at which substeps begin, [n m]."""
        begins = np.concatenate(([0.0], np.cumsum(self.weights)))[:-1]
        return (self.t + self.h * (np.arange(self.done, self.done + self.n)[:, None] + begins)).reshape(-1)

    @cached_property
    def lengths(self) -> Array:
        """Sizes of substeps, [n m]."""
        return np.tile(self.weights * self.h, self.n)

    @property
    def end(self) -> float:
        """Time at which the last substep ends."""
        return self.t + self.h * (self.done + self.n)


class Feature:
    """Optional part of a scene: its tables, history variables, terms of a step, rows, and limits of analyses."""

    key: ClassVar[str]  # name by which a model finds it
    title: ClassVar[str]  # name in a table of features
    order: ClassVar[int]  # rank of the feature: in the history, and in sums
    lacks: ClassVar[tuple[Lack, ...]] = ()  # limits of analyses of models with the feature
    opens: ClassVar[bool] = False  # true if its history variables stand before the energies
    # true if messages name it before the parts that belong to it: sliders of moving meshes, friction of sleeves that twist
    is_told_first: ClassVar[bool] = False
    constrains: ClassVar[bool] = False  # true if its terms in an equilibrium have forces that are unknowns
    called_laws: Mapping[type, Any] = MappingProxyType({})  # user laws that its tables call, by the kinds of tables

    @property
    def history_size(self) -> int:
        """Number of history variables."""
        return 0

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of energies that the feature dissipates."""
        return ()

    @property
    def works(self) -> tuple[str, ...]:
        """Names of works that the feature puts in."""
        return ()

    @property
    def exchanges(self) -> bool:
        """True if the feature changes the total energy by more than `losses` and `works` count."""
        return False

    @property
    def constants(self) -> Iterable[Array]:
        """Arrays by which results and checkpoints tell its models apart, besides those that they know."""
        return ()

    def work(self, model: Any, plane: Any, static: bool) -> Any:
        """Allocate the arrays of one run of a model; plane: that of the scene, where the run is planar; static: for an
        equilibrium."""
        return None

    def terms(self, run: OfRun) -> Iterable[tuple[Stand, Any]]:
        """Return the terms that the feature adds to a run, and their order."""
        return ()

    def section_law(self, strain: str, law: Any, static: bool) -> Any:
        """Return the law of beams with a strain set, from that which the features before it make; static: of an equilibrium."""
        return law

    def link_of_run(self, table: Any, run: OfRun) -> Any:
        """Return a table of links with the arrays of a run where the feature knows it, else unchanged."""
        return table

    def schedules(self, span: Span) -> Iterable[tuple[Stand, Any]]:
        """Return the inputs of its terms in the steps of a span, in the order of these terms."""
        return ()

    def describe(self) -> Iterable[tuple[str, str, Sequence[str]]]:
        """Return lines of `print(model)`: a word or two, the text before the names of parts, and these names."""
        return ()

    # --- rows ---------------------------------------------------------------------------------------------------------
    def series(self, kinds: Collection[str], model: Any) -> Mapping[str, tuple[int, ...]]:
        """Return the shapes of its series in rows of these kinds (`simulate(observe=...)`)."""
        return {}

    def read(self, kinds: Collection[str], model: Any, t: float, state: State) -> Mapping[str, Array]:
        """Return its series in the row of a state at time t, except for forces that are unknowns."""
        return {}

    def read_forces(self, kinds: Collection[str], model: Any, force: Array) -> Mapping[str, Array]:
        """Return its series that are forces of constraints, in a row with these of all constraints [F]."""
        return {}

    def named(self, kinds: Collection[str]) -> Mapping[str, list[str]]:
        """Return the names by which a result finds the columns of its series."""
        return {}

    def add_motion(self, model: Any, state: State, out: Array) -> None:
        """Add its kinetic energy, momenta, and strain energy of elements to those of nodes, at the columns of `energies`."""

    def weight(self, model: Any, q: Array) -> float:
        """Return its energy in constant gravity at coordinates [12 N], J."""
        return 0.0

    def stored(self, state: State) -> float:
        """Return its stored energy other than strain energy, J."""
        return 0.0

    def booked(self, model: Any, state: State, row: Mapping[str, Any]) -> tuple[list[float], list[float]]:
        """Return dissipated energy less work put in, as terms of the energy balance of a row, J, and the sizes of these terms."""
        return [], []

    # --- in a plane, and at the start ---------------------------------------------------------------------------------
    def in_plane(self, plane: Any, model: Any, constraints: int) -> Self:
        """Return the feature for the tables of a plane; model: in space; constraints: number of those left in the plane but
        moments of sleeves."""
        return self

    def link_in_plane(self, table: Any, plane: Any) -> Any:
        """Return a table of links for a plane where the feature knows it, None where nothing is left of it; else unchanged."""
        return table

    def start_history(self, own: Array, q: Array, v: Array) -> None:
        """Put the initial values of its history variables into `own`, at coordinates and rates [12 N], in a plane [4 N]."""

    def start_momenta(self, own: Array, q: Array, v: Array, s: Array) -> None:
        """Put momenta that follow from coordinates, rates and places of sliders [S] into its history variables."""

    def misfit(self, own: Array, q: Array, v: Array, s: Array) -> float:
        """Return the largest difference between velocities and those of the momenta in its history variables, m/s."""
        return 0.0


def every_feature() -> list[type[Feature]]:
    """Return all kinds of features that have been imported, in their order; variants of a kind share its key and are left out."""
    def below(kind: type[Feature]) -> Iterator[type[Feature]]:
        for one in kind.__subclasses__():
            if "key" in vars(one):
                yield one
            yield from below(one)
    return sorted(below(Feature), key=lambda kind: (kind.order, kind.key))
