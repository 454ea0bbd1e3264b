"""Slider forces along the beam: friction, drives and stops."""
from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Number, Refusal, checked, numbers, real, shown, take
from fastbeam.interface.errors import SceneError
from fastbeam.scene.checks import OfTimeLike, Takes, as_factor, called, called_with, refuse_jumps, tried

if TYPE_CHECKING:
    from fastbeam.scene.beams import Beam
    from fastbeam.scene.paths import Path

NOT_NEGATIVE, LENGTH = Number(least=0.0), Number()
# derivative from values at steps of SHORT s from now on, of fourth order
SHORT, FORWARD = 1e-4, np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0


@checked(coefficient=NOT_NEGATIVE, viscous=Number(least=0.0, unit="N s/m"), smoothing=Number(above=0.0, unit="m/s"))
@dataclass(frozen=True)
class Friction:
    """Friction of a slider: `Slider(..., friction=0.3)` is the short form of `friction=Friction(0.3)`.

    Coulomb's law with stick and slip: a slider that sticks does not creep, one that slides feels coefficient x contact force
    across the beam, against its velocity (theory.md 5.6). It has no regularisation parameter.

    Parameters
    ----------
    coefficient : float
        Coefficient of Coulomb friction, >= 0; static and kinetic.
    viscous : float
        Force against the motion per velocity, N s/m, >= 0.
    smoothing : float, optional
        m/s, > 0: friction coefficient x force x tanh(velocity/smoothing) in the place of Coulomb's law. Such a slider creeps.

    Raises
    ------
    SceneError
        A number is out of range.
    """

    kind: ClassVar[str] = "friction"
    __repr__ = called_with

    coefficient: float = 0.0
    _: KW_ONLY
    viscous: float = 0.0
    smoothing: float | None = None


@dataclass(frozen=True)
class OfTime:
    """Check of a number, or a function of time, which may jump if it is a force, or if that is allowed."""

    unit: str
    jumps: bool = False

    def __call__(self, value: Any) -> Any:
        if callable(value):
            if not (self.jumps or self.unit.startswith("N")):
                refuse_jumps(value)
            return as_factor(value)
        try:
            return Number(unit=self.unit)(value)
        except Refusal as refusal:
            raise Refusal(f"{refusal} (or a function of t)") from None


def as_driving_force(value: Any) -> Any:
    """Check of a number, a function of time, or one of (t, s, ds/dt) that numba can compile."""
    if not callable(value):
        return OfTime("N")(value)
    if isinstance(value, type):
        raise Refusal(f"must be a number, a function of t or one of (t, s, rate), got {shown(value)}")
    n = needed_arguments(value)
    if n not in (1, 3):
        raise Refusal(f"must take one argument (t) or three (t, s, rate), this function takes {n}")
    if n == 1:
        return as_factor(value)
    found = real(tried(value, "at t = 0, s = 0, rate = 0", 0.0, 0.0, 0.0))
    if found is None or not np.isfinite(found):
        raise Refusal("must return a finite number at t = 0, s = 0, rate = 0")
    return value


def needed_arguments(function: Callable[..., Any]) -> int:
    """Return the number of arguments that a function needs, 1 if that cannot be told."""
    try:
        kinds = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return 1
    known = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(x.kind in known and x.default is inspect.Parameter.empty for x in kinds)


@checked(position=OfTime("m", True), speed=OfTime("m/s", True), force=as_driving_force, stiffness=Number(least=0.0, unit="N/m"),
         damping=Number(least=0.0, unit="N s/m"), limit=Number(above=0.0, unit="N"))
@dataclass(frozen=True)
class Drive:
    """Drive of a slider along its beam, or of a revolute or prismatic joint; positive forces and speeds point in the direction of
    growing s, of joints of a growing angle or distance, with rad and N m in the place of m and N of an angle.

    Drive(position=f)     the place on the beam is s = f(t), m: prescribed, whatever force that takes
    Drive(speed=v)        ds/dt = v, a number or a function of t, m/s: prescribed
    Drive(force=F)        a force along the beam, N: a number, a function of t, or one of (t, s, rate), which numba compiles
    Drive(position=f, speed=v, stiffness=k, damping=d, limit=F)     a controller: the force k (f(t) - s) + d (v(t) - ds/dt), at
                          most F; either part may be left out

    The force acts between the sliding point and the beam, or the parts of a joint. `result.slider(name)` and `result.joint(name)`
    hold it and its work. Joints are moved as prescribed by their `angle=`, `distance=` and `speed=`.

    Raises
    ------
    SceneError
        Nothing is given, or what is given contradicts each other.
    """

    kind: ClassVar[str] = "drive"
    __repr__ = called_with

    _: KW_ONLY
    position: OfTimeLike | None = None
    speed: OfTimeLike | None = None
    force: OfTimeLike | Callable[[float, float, float], float] | None = None
    stiffness: float = 0.0
    damping: float = 0.0
    limit: float | None = None

    def __post_init__(self) -> None:
        given = [x for x in ("position", "speed", "force") if getattr(self, x) is not None]
        if not given:
            raise SceneError("drive: give position=, speed= or force=")
        if "force" in given and (len(given) > 1 or self.is_controlled):
            raise SceneError("drive: force= cannot be combined with a controller, which follows position= or speed= with "
                             "stiffness= and damping=; leave one of them out")
        if not self.is_controlled:
            if len(given) > 1:
                raise SceneError("drive: position= and speed= both prescribe the motion; give one of them, or add stiffness= and "
                                 "damping= for a controller that follows both")
            if given[0] != "force":
                take(refuse_jumps, f"drive: {given[0]}", getattr(self, given[0]))
            if self.limit is not None:
                raise SceneError("drive: limit= bounds the force of a controller, and there is none; give stiffness= or damping= "
                                 "too")
        elif self.stiffness > 0.0 and self.position is None:
            raise SceneError("drive: a controller with stiffness= needs position=")

    @property
    def is_controlled(self) -> bool:
        """True if it is a controller."""
        return self.stiffness > 0.0 or self.damping > 0.0

    @property
    def takes_state(self) -> bool:
        """True if the force is a function of (t, s, rate)."""
        return callable(self.force) and needed_arguments(self.force) == 3

    @property
    def is_timed(self) -> bool:
        """True if it depends on time."""
        return any(callable(x) for x in (self.position, self.speed, self.force)) or self.speed is not None

    @property
    def is_prescribed(self) -> bool:
        """True if the motion is prescribed and the force an unknown."""
        return self.force is None and not self.is_controlled


def initial_rate(drive: Drive, who: str) -> float:
    """Return ds/dt at t = 0 of a prescribed motion, m/s; who: name in messages."""
    value, what = (drive.speed, "speed") if drive.position is None else (drive.position, "position")
    return rate_at_start(value, what, who)


def rate_at_start(value: Any, what: str, who: str, fades: float = 0.0) -> float:
    """Return the rate at t = 0 of a number or a function of time: a place, or its rate where `what` is 'speed'. fades: a rate
    below this share of the largest right afterwards is an error of differences of a function whose rate begins with zero."""
    if not callable(value):
        return float(value) if what == "speed" else 0.0
    found = [real(called(who, what, value, k * SHORT)) for k in range(5)]
    if any(x is None or not np.isfinite(x) for x in found):
        raise SceneError(f"{who}: {what}(t) of its drive must return finite numbers")
    if what == "speed":
        return float(found[0])
    rate = float(np.dot(FORWARD, found)) / SHORT
    # the rate is zero within round-off of the positions
    noise = 20.0 * float(np.finfo(float).eps) * max(abs(float(x)) for x in found) / SHORT  # type: ignore[arg-type]
    follows = float(np.max(np.abs(np.diff(np.array(found, float))))) / SHORT
    return rate if abs(rate) > max(noise, fades * follows) else 0.0


def as_place(value: Any) -> float | tuple[str, float]:
    """Check of an arc length, or one on a track of a Switch: (track, s) with the track or its name, kept as (name, s)."""
    if not isinstance(value, (tuple, list)):
        return LENGTH(value)
    name = getattr(value[0], "name", value[0]) if len(value) == 2 else None
    if not isinstance(name, str):
        raise Refusal(f"must be an arc length, m, or (track, s) on a Switch with a track or its name, got {shown(value)}")
    try:
        return name, LENGTH(value[1])
    except Refusal as refusal:
        raise Refusal(f"of (track, s): s {refusal}") from None


@checked(start=as_place, end=as_place, stiffness=Number(above=0.0),
         restitution=Number(least=0.0, most=1.0))
@dataclass(frozen=True)
class Stops:
    """Stops of a slider or of a joint with an axis, elastic with `stiffness`, else rigid.

    An elastic stop is a spring between the arc length and the point once it is beyond it. At a rigid one the step ends where it
    is met, and the velocity along the beam, or of the joint, jumps to -restitution times what it was; the loss is in the balance.
    A slider or joint that comes to rest against a stop stays there until a force pulls it away.

    On a `Switch` a number is an arc length of the way, which begins with `at` of the slider and goes on from track to track. A
    place on a track, (track, s), is a wall there: what came onto the track on its other side meets it from there.

    Parameters
    ----------
    start, end : float, tuple or None
        Arc lengths, m; of joints distances, m, or angles, rad, which may be negative; on a `Switch` also (track, s) with a track
        or its name. None: no stop there.
    stiffness : float, optional
        N/m, of angles N m/rad, > 0.
    restitution : float, optional
        Restitution of rigid stops, from 0 (default: it does not bounce) to 1 (without loss).

    Raises
    ------
    SceneError
        No stop is given, `start` does not lie before `end`, or a number is out of range.
    """

    kind: ClassVar[str] = "stops"
    __repr__ = called_with

    start: Takes[float | tuple[Beam | Path | str, float] | None, float | tuple[str, float] | None] = None
    end: Takes[float | tuple[Beam | Path | str, float] | None, float | tuple[str, float] | None] = None
    _: KW_ONLY
    stiffness: float | None = None
    restitution: float | None = None

    @property
    def is_rigid(self) -> bool:
        """True if velocities jump there."""
        return self.stiffness is None

    @property
    def between(self) -> tuple[float, float]:
        """Both arc lengths; infinite where there is none, or one on a track."""
        return self.start if isinstance(self.start, float) else -np.inf, self.end if isinstance(self.end, float) else np.inf

    @property
    def on_tracks(self) -> bool:
        """True if a stop stands on a track of a switch."""
        return isinstance(self.start, tuple) or isinstance(self.end, tuple)

    def __post_init__(self) -> None:
        if self.stiffness is not None and self.restitution is not None:
            raise SceneError("stops: give stiffness= for elastic stops or restitution= for rigid ones, not both")
        if self.start is None and self.end is None:
            raise SceneError("stops: give start=, end= or both, arc lengths in m")
        (on, start), (by, end) = (x if isinstance(x, tuple) else ("", x) for x in (self.start, self.end))
        if start is not None and end is not None and on == by and not start < end:
            raise SceneError(f"stops: start must lie before end, got {start:.6g} and {end:.6g} m")


def as_friction(value: Any) -> Friction:
    """Check of a coefficient, or a Friction."""
    if isinstance(value, Friction):
        return value
    if real(value) is None:
        raise Refusal(f"must be a coefficient >= 0 or a Friction, got {shown(value)}")
    return Friction(NOT_NEGATIVE(value))


def as_drive(value: Any) -> Drive:
    """Check of a Drive."""
    if not isinstance(value, Drive):
        several = isinstance(value, (list, tuple)) and sum(isinstance(x, Drive) for x in value) > 1
        hint = "; a slider has one drive, give the sum of both forces as force=" if several else ""
        raise Refusal(f"must be a Drive, as in drive=fb.Drive(speed=0.5), got {shown(value)}{hint}")
    return value


def as_stops(value: Any) -> Stops:
    """Check of Stops."""
    if not isinstance(value, Stops):
        hint = "; write fb.Stops(start, end)" if numbers(value) is not None else ""
        raise Refusal(f"must be Stops, got {shown(value)}{hint}")
    return value
