"""What a feature of a compiled scene tells about itself: the compiler, steps, rows and analyses ask all features the same
questions and know none of them by name."""
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
    """Where terms stand among those of a run, and schedules among those of a span; sums are formed in this order."""

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
    """What the terms of a run are made from.

    Attributes
    ----------
    model : Model
    static : bool
        Only what has a part in statics.
    inner : Inner or None
        Eliminated nodes with the work arrays of the run.
    own : dict
        What `Feature.work` has made, by the keys of features.
    law_work : float64 or None
        The work array of laws.
    known : bool
        Without equations for the forces that hold coordinates of joints, which are those of the state.
    """

    model: Any
    static: bool = False
    inner: Any = None
    own: Mapping[str, Any] = MappingProxyType({})
    law_work: Any = None
    known: bool = False


@dataclass(frozen=True)
class Span:
    """n steps of size h, the first from time t + done h, of a run.

    Attributes
    ----------
    own, terms : dict, tuple
        As of `OfRun`, and the terms of the run.
    plane : Plane or None
    weights : float64 [m]
        Substeps of a step as fractions of it.
    """

    own: Mapping[str, Any]
    terms: tuple[Any, ...]
    plane: Any
    weights: Array
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
        """Time at which the last one ends."""
        return self.t + self.h * (self.done + self.n)


class Feature:
    """Something that a scene may have: tables, numbers in `State.history`, terms of a step, rows, and what does not go with it.

    Attributes
    ----------
    key : str
        By which others find it in a model.
    title : str
        In a table of features.
    order : int
        Features stand in this order: their numbers in the history, and what they add to sums.
    lacks : tuple of Lack
        What analyses cannot do with it.
    opens : bool
        Whether its numbers open the history, before the energies.
    is_told_first : bool
        Whether messages name it before others, which belong to it: joints of moving meshes, friction of sleeves that twist.
    called_laws : dict of type -> failed_laws.Lawful
        Laws of the user's own that its tables call, by the kinds of tables.
    """

    key: ClassVar[str]
    title: ClassVar[str]
    order: ClassVar[int]
    lacks: ClassVar[tuple[Lack, ...]] = ()
    opens: ClassVar[bool] = False
    is_told_first: ClassVar[bool] = False
    called_laws: Mapping[type, Any] = MappingProxyType({})

    @property
    def history_size(self) -> int:
        """Numbers in `State.history`."""
        return 0

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of what takes energy away."""
        return ()

    @property
    def works(self) -> tuple[str, ...]:
        """Names of what puts energy in."""
        return ()

    @property
    def exchanges(self) -> bool:
        """Whether the total energy changes by more than its losses and works say."""
        return False

    def work(self, model: Any, plane: Any, static: bool) -> Any:
        """Arrays of one run of a model; plane: that of the scene, where the run is planar; static: of an equilibrium."""
        return None

    def terms(self, run: OfRun) -> Iterable[tuple[Stand, Any]]:
        """What it adds to the terms of a run, and where these stand."""
        return ()

    def link_of_run(self, table: Any, run: OfRun) -> Any:
        """A table of links with the arrays of a run where the feature knows it; else as it is."""
        return table

    def schedules(self, span: Span) -> Iterable[tuple[Stand, Any]]:
        """What its terms are given in the steps of a span, in the order of these terms."""
        return ()

    def describe(self) -> Iterable[tuple[str, str, Sequence[str]]]:
        """Lines of `print(model)`: a word or two, what stands before the names of parts, and these."""
        return ()

    # --- rows ---------------------------------------------------------------------------------------------------------
    def series(self, kinds: Collection[str], model: Any) -> Mapping[str, tuple[int, ...]]:
        """Shapes of its series in rows of these kinds (`simulate(observe=...)`)."""
        return {}

    def read(self, kinds: Collection[str], model: Any, t: float, state: State) -> Mapping[str, Array]:
        """Its series in the row of a state at time t, but for forces that are unknowns."""
        return {}

    def add_motion(self, model: Any, state: State, out: Array) -> None:
        """Add its kinetic energy and momenta to those of nodes, [9] as `energies.motion` puts them."""

    def weight(self, model: Any, q: Array) -> float:
        """Its energy in constant gravity at coordinates [12 N], J."""
        return 0.0

    def stored(self, state: State) -> float:
        """What it stores that is no strain, J."""
        return 0.0

    def booked(self, model: Any, state: State, row: Mapping[str, Any]) -> tuple[list[float], list[float]]:
        """What it took away less what it put in, numbers that the balance of a row adds, J, and sizes of these parts."""
        return [], []

    # --- in a plane, and at the start ---------------------------------------------------------------------------------
    def in_plane(self, plane: Any, model: Any, constraints: int) -> Self:
        """The same in the tables of a plane; model: in space; constraints: all that are left there but moments of sleeves."""
        return self

    def link_in_plane(self, table: Any, plane: Any) -> Any:
        """A table of links for a plane where the feature knows it, None where nothing is left of it; else as it is."""
        return table

    def start_history(self, own: Array, q: Array, v: Array) -> None:
        """Put what its numbers of the history are at the start into them, at coordinates and rates [12 N], in a plane [4 N]."""

    def start_momenta(self, own: Array, q: Array, v: Array) -> None:
        """Put momenta that follow from coordinates and rates into its numbers of the history."""

    def misfit(self, own: Array, q: Array, v: Array) -> float:
        """The largest difference between velocities and those of the momenta in its numbers, m/s."""
        return 0.0


def every_feature() -> list[type[Feature]]:
    """All kinds of features that have been imported, in their order; variants of a kind share its key and are left out."""
    def below(kind: type[Feature]) -> Iterator[type[Feature]]:
        for one in kind.__subclasses__():
            if "key" in vars(one):
                yield one
            yield from below(one)
    return sorted(below(Feature), key=lambda kind: (kind.order, kind.key))
