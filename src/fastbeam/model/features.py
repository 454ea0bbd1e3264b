"""Features of a model, by name, and offsets of their variables in `State.history`."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

import numpy as np

from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.section_laws import ELASTIC
from fastbeam.kernels.beams.strain_measures import GreenLagrange, SimoReissner
from fastbeam.kernels.joints.coordinates import VALUE
from fastbeam.kernels.state import State
from fastbeam.kernels.terms import LoadVectors
from fastbeam.model.feature import Feature
from fastbeam.model.loading import Loading, Remarks

if TYPE_CHECKING:
    from fastbeam.model.contact.sliders import SlidingContact

T = TypeVar("T")
Array = np.ndarray
# record for a scene without sliders
NO_SLIDERS = SimpleNamespace(curves=None, sliders=None, sleeves=None, slider_lengths=np.zeros(0), spans={}, corners={},
                             curve_s=())


class Found:
    """Descriptor: the feature of a model whose key is the name of the attribute, or None; cached, as a model never changes."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._key = name

    def __get__(self, model: Any, owner: type | None = None) -> Any:
        if model is None:
            return self
        found = vars(model)[self._key] = model.by_key.get(self._key)
        return found


class Part(Generic[T]):
    """Descriptor: an attribute of one record of a model as an attribute of the model, read once."""

    def __init__(self, of: str) -> None:
        self._of = of

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, model: Any, owner: type | None = None) -> T:
        if model is None:
            return self  # type: ignore[return-value]
        found = vars(model)[self._name] = getattr(getattr(model, self._of), self._name)
        return found  # type: ignore[no-any-return]


class Of(Generic[T]):
    """Descriptor: an attribute of the feature with a key, or what stands for it in a model without that feature; read once."""

    def __init__(self, key: str, name: str, without: T) -> None:
        self._key, self._name, self._without = key, name, without

    def __set_name__(self, owner: type, name: str) -> None:
        self._own = name

    def __get__(self, model: Any, owner: type | None = None) -> T:
        if model is None:
            return self  # type: ignore[return-value]
        of = model.by_key.get(self._key)
        found = vars(model)[self._own] = self._without if of is None else getattr(of, self._name)
        return found  # type: ignore[no-any-return]


class WithFeatures:
    """Features of a compiled scene, in their order.

    `State.history` holds the variables of features with `opens`, energies that were dissipated, works that were put in, and the
    variables of the other features.
    """

    features: tuple[Feature, ...]
    simo: ElementTables | None
    green: ElementTables | None
    links: tuple[Any, ...]
    loading: Loading
    remarks: Remarks
    loads = Part[LoadVectors]("loading")
    load_times = Part[list[Callable[[float], float] | None]]("loading")
    load_names = Part[list[str]]("loading")
    load_parts = Part[dict[str, Any]]("loading")
    gravity = Part[Array]("loading")
    gravity_time = Part[Callable[[float], Any] | None]("loading")
    gravity_weight = Part[Array]("loading")
    constant_load = Part[Array]("loading")
    text = Part[str]("remarks")
    not_planar = Part[str]("remarks")
    asked_for_plane = Part[bool]("remarks")
    massless = Part[tuple[str, ...]]("remarks")
    notes = Part[tuple[tuple[str, str], ...]]("remarks")
    joints = Part[dict[int, list[str]]]("remarks")
    curves = Part[Any]("sliding")
    sliders = Part[Any]("sliding")
    sleeves = Part[Any]("sliding")
    slider_lengths = Part[Array]("sliding")
    spans = Part[dict[int, Array]]("sliding")
    corners = Part[dict[tuple[int, int, bool, int], tuple[int, bool]]]("sliding")
    curve_s = Part[tuple[Array, ...]]("sliding")
    slider_forces = Found()
    damped = Found()
    dragged = Found()
    prescribed = Found()
    released = Found()
    motions = Found()
    moving = Found()
    added = Found()
    twisting = Of[Array]("twist", "of", np.zeros(0, np.int64))  # sleeves with friction against twist of their beams, int64 [R]
    user_forces = Of[tuple[str, ...]]("user_laws", "labels", ())  # labels of the forces by user laws
    controllers = Of[tuple[Any, ...]]("control", "parts", ())
    # links.Lines: springs, dampers and line forces whose ends may pass each other, or None
    lines = Of[Any]("link_forces", "lines", None)

    def with_features(self, *more: Feature | None) -> Self:
        """Return the model with additional features; None: no feature."""
        found = [*self.features, *(x for x in more if x is not None)]
        return replace(self, features=tuple(sorted(found, key=lambda x: x.order)))  # type: ignore[type-var]

    def with_loading(self, **changes: object) -> Self:
        """Return the model with other loads; changes: of the attributes of `Loading`."""
        return replace(self, loading=replace(self.loading, **changes))  # type: ignore[type-var]

    def with_remarks(self, **changes: object) -> Self:
        """Return the model with other remarks; changes: of the attributes of `Remarks`."""
        return replace(self, remarks=replace(self.remarks, **changes))  # type: ignore[type-var]

    @property
    def sliding(self) -> SlidingContact | SimpleNamespace:
        """Sliders and sleeves; a record of empty tables without any."""
        return self.by_key.get("sliding", NO_SLIDERS)

    @cached_property
    def by_key(self) -> Mapping[str, Feature]:
        """Features by their keys."""
        return {x.key: x for x in self.features}

    # --- attributes of some features ----------------------------------------------------------------------------------
    @cached_property
    def spring_rows(self) -> list[Any]:
        """Evaluators of springs, dampers, winches and bushings at rows."""
        found: Any = self.by_key.get("link_forces")
        return [] if found is None else found.find_rows(self.links)

    @property
    def accounts_loads(self) -> bool:
        """True if loads have no potential: they change in time, are moments, or follow laws. In a plane as in space, because
        states of both have the same history variables."""
        return "load_account" in self.by_key

    @cached_property
    def laws(self) -> dict[type, Any]:
        """User laws, failed_laws.Lawful, by the kinds of tables that call them."""
        return {kind: lawful for feature in self.features for kind, lawful in feature.called_laws.items()}

    def strain_sets(self, static: bool = False) -> tuple[SimoReissner, GreenLagrange]:
        """Return the strain sets with the section laws of the features; static: of an equilibrium, without damping."""
        laws = {"simo_reissner": ELASTIC, "green_lagrange": ELASTIC}
        for feature in self.features:
            if type(feature).section_law is not Feature.section_law:
                laws = {name: feature.section_law(name, law, static) for name, law in laws.items()}
        return SimoReissner(laws["simo_reissner"]), GreenLagrange(laws["green_lagrange"])

    def sets_of_elements(self, static: bool = False) -> list[tuple[ElementTables, SimoReissner | GreenLagrange]]:
        """Return the tables of elements with their strain sets."""
        return [(x, kind) for x, kind in zip((self.simo, self.green), self.strain_sets(static)) if x is not None]

    # --- places in the history ----------------------------------------------------------------------------------------
    @cached_property
    def losses(self) -> tuple[str, ...]:
        """Names of the energies that features other than sliders dissipate."""
        return tuple(label for feature in self.features for label in feature.losses)

    @cached_property
    def works(self) -> tuple[str, ...]:
        """Names of the works of features other than loads and drives of sliders."""
        return tuple(label for feature in self.features for label in feature.works)

    @property
    def loss_place(self) -> int:
        """Offset of the dissipated energies in the history."""
        return sum(x.history_size for x in self.features if x.opens)

    @property
    def works_place(self) -> int:
        """Offset of the works in the history."""
        return self.loss_place + len(self.losses)

    @cached_property
    def history_size(self) -> int:
        """Number of all history variables."""
        return len(self.losses) + len(self.works) + sum(x.history_size for x in self.features)

    def place_for(self, kind: type[Feature] | Feature) -> int:
        """Return the offset of the variables of a feature in the history, for a feature of the model or an additional one."""
        energies = 0 if kind.opens else self.works_place - self.loss_place + len(self.works)
        before = [x for x in self.features if x.order < kind.order or x.opens and not kind.opens]
        return energies + sum(x.history_size for x in before if x.opens or not kind.opens)

    def losses_for(self, kind: type[Feature]) -> int:
        """Return the offset of the energies that a feature dissipates, for a feature of the model or an additional one."""
        return self.loss_place + sum(len(x.losses) for x in self.features if x.order < kind.order)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {x.key: self.place_for(x) for x in self.features}

    def place(self, key: str) -> int:
        """Return the offset of the variables of a feature that the model has."""
        return self._places[key]

    def own(self, history: Array, key: str) -> Array:
        """Return a view of the variables of a feature in a history; empty where the model does not have the feature."""
        if key not in self.by_key:
            return history[:0]
        return history[self._places[key]:][:self.by_key[key].history_size]

    # --- contents of the history --------------------------------------------------------------------------------------
    def start_history(self, q: Array, v: Array, s: Array) -> Array:
        """Return the history of a start with coordinates and rates [12 N], in a plane [4 N], and places of sliders [S]."""
        out = np.zeros(self.history_size)
        for x in self.features:
            x.start_history(self.own(out, x.key), q, v)
            x.start_momenta(self.own(out, x.key), q, v, s)
        return out

    def start_momenta(self, history: Array, q: Array, v: Array, s: Array) -> None:
        """Put momenta that follow from coordinates and their rates [12 N], in a plane [4 N], and places of sliders [S], into a
        history."""
        for x in self.features:
            x.start_momenta(self.own(history, x.key), q, v, s)

    def stop(self, state: State) -> None:
        """Set the velocities of a state, and the momenta in its history, to zero."""
        state.v[:] = 0.0
        if self.moving is not None:
            self.moving.put_places(state.history, 0.0)
        self.start_momenta(state.history, state.q, state.v, state.s)

    def momenta_misfit(self, state: State) -> float:
        """Return the largest difference between velocities of a state and those of the momenta in its history, m/s."""
        return max((x.misfit(self.own(state.history, x.key), state.q, state.v, state.s) for x in self.features), default=0.0)

    def turns_of(self, history: Array) -> Array:
        """Return the rotation vectors of supports since t = 0 in a history, for motions that turn, [3 K], rad: a view."""
        return self.own(history, "prescribed")

    def keep_turns(self, history: Array, of: Array) -> None:
        """Copy the counted turns of supports and joints from another history."""
        self.turns_of(history)[:] = self.turns_of(of)
        if self.motions is not None:
            place = self.place("motions")
            self.motions.own(history, place)[:, VALUE] = self.motions.own(of, place)[:, VALUE]

    @property
    def balances(self) -> bool:
        """True if the energy has a balance: something dissipates energy or puts some in."""
        return bool(self.losses or self.works) or any(x.opens or x.exchanges for x in self.features)
