"""Sliders that are locked on their beam, or leave it, at a time or where a condition holds."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Flag, Number, Refusal, Vector, checked, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene.checks import ArrayField, Condition, Takes, WhenLike, called_with, noun, tried
from fastbeam.scene.slider_forces import Stops, as_place, needed_arguments

if TYPE_CHECKING:
    from fastbeam.scene.beams import Beam
    from fastbeam.scene.paths import Path

TIME = Number(unit="s")
START, END, STOP = "start", "end", "stop"


@dataclass(frozen=True)
class When:
    """Check of a time, a function of (t, s, ds/dt), or one of a few words."""

    words: tuple[str, ...] = ()

    def __call__(self, value: Any) -> Any:
        if isinstance(value, str) and value in self.words:
            return value
        words = "".join(f", {word!r}" for word in self.words)
        if callable(value) and not isinstance(value, type):
            found = truth(value, 0.0, 0.0, 0.0)
            if found is None:
                raise Refusal("must return a finite number, or True or False, at t = 0, s = 0, rate = 0")
            return value
        try:
            return TIME(value)
        except Refusal:
            raise Refusal(f"must be a finite time in s, a function of (t, s, rate){words}, got {shown(value)}") from None


def truth(function: Any, t: float, s: float, rate: float) -> float | None:
    """Return the value of a condition as a number: it holds from 0 on, True is 1 and False is -1. None if it is not finite.
    Raises Refusal: it takes other arguments, or fails."""
    n = needed_arguments(function)
    if n != 3:
        raise Refusal(f"must take three arguments (t, s, rate), this function takes {n}")
    found = tried(function, "at t = {:.6g}, s = {:.6g}, rate = {:.6g}", t, s, rate)
    if isinstance(found, (bool, np.bool_)):
        return 1.0 if found else -1.0
    value = real(found)
    return value if value is not None and np.isfinite(value) else None


@checked(when=When((STOP, START, END)), at=as_place, until=When())
@dataclass(frozen=True)
class Lock:
    """Lock that fixes a slider where it is on its beam: a latch, a clamp, a brake. `Slider(..., lock=fb.Lock(...))`.

    Lock()                        from the start, for good
    Lock(until=1.0)               from the start, let go at t = 1 s
    Lock(2.0, until=3.0)          from 2 s to 3 s
    Lock("stop")                  where it meets one of its rigid stops: it latches there; "start", "end": that one alone
    Lock(at=1.5)                  where it passes s = 1.5 m, on a Switch this arc length of the way, which begins with `at`
    Lock(at=("siding", 1.5))      on a Switch where it passes s = 1.5 m of this track
    Lock(lambda t, s, rate: rate - 3.0)       as soon as the function is not negative (or returns True): above 3 m/s

    Locking a slider that moves is a plastic impact: velocities jump, momenta stay, and the energy that is lost is in
    `result.balance()`. Letting go takes nothing. The step ends where a condition begins to hold, to round-off (theory.md 5.9).

    Parameters
    ----------
    when : float, str or callable
        Time, s; 'stop', 'start', 'end'; or a function of (t, s, ds/dt), which is asked after every step.
    at : float or tuple
        Arc length, m, in the place of `when`; on a `Switch` also (track, s) with a track or its name.
    until : float or callable
        Time, s, or function, with which it is let go; None: for good.

    Raises
    ------
    SceneError
        `when` and `at` are both given, or it would end before it begins.
    """

    kind: ClassVar[str] = "lock"
    __repr__ = called_with

    when: WhenLike | None = None
    _: KW_ONLY
    at: Takes[float | tuple[Beam | Path | str, float] | None, float | tuple[str, float] | None] = None
    until: float | Condition | None = None

    def __post_init__(self) -> None:
        if self.when is not None and self.at is not None:
            raise SceneError("lock: give when= or at=, not both; a function of (t, s, rate) can combine both")
        if isinstance(self.until, float) and isinstance(self.when, float) and not self.until > self.when:
            raise SceneError(f"lock: until={self.until:.6g} s must lie after when={self.when:.6g} s")

    @property
    def from_start(self) -> bool:
        """True if it holds from the start."""
        return self.when is None and self.at is None


@checked(when=When((START, END)))
@dataclass(frozen=True)
class Release:
    """Release of a slider from its beam for good; its point flies on by itself. `Slider(..., release=fb.Release(...))`.

    Release(1.0)                  at t = 1 s
    Release("end")                at the end of its beam or path, instead of ending the run there; "start": at the start. On a
                                  Switch at the end of a track from which none leads on
    Release(lambda t, s, rate: s - 2.0)       as soon as the function is not negative (or returns True)

    Neither momenta nor the energy change (theory.md 5.9). `result.slider(name)["gap"]` tells how far the point is from where it
    left the beam.

    Parameters
    ----------
    when : float, str or callable
        Time, s; 'start' or 'end'; or a function of (t, s, ds/dt), which is asked after every step.
    """

    kind: ClassVar[str] = "release"
    __repr__ = called_with

    when: WhenLike


@checked(side=Vector, restitution=Number(least=0.0, most=1.0), catch=Flag())
@noun
class OneSided:
    """Contact that pushes only: the point lies on one side of the beam, lifts off where it would have to be pulled, and comes
    back. `Slider(..., one_sided=(0, 0, 1))` is the short form of `one_sided=fb.OneSided((0, 0, 1))`.

    A point that comes back hits the beam: across it the velocity jumps to -restitution times what it was, the loss is in
    `result.balance()`. A point that does not bounce slides on. A point may also begin away from the beam, on its side: then `at`
    is where the search for the nearest point begins (theory.md 5.9). `result.slider(name)["gap"]` is the distance.

    In space a point that comes back has to meet the beam itself: one that passes beside it flies on, and an event says so.

    Parameters
    ----------
    side : array_like (3,)
        Direction at t = 0 in which the point may lift off; it turns with the section of the beam.
    restitution : float
        From 0 (default: it does not bounce) to 1 (without loss).
    catch : bool
        Whether a point that is on the beam is held from both sides: it never lifts off.

    Raises
    ------
    SceneError
        `side` is zero, or a number is out of range.
    """

    kind: ClassVar[str] = "one-sided contact"

    side: ArrayField
    _: KW_ONLY
    restitution: float = 0.0
    catch: bool = False

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.side) > 0.0:
            raise SceneError("one-sided contact: side=(0, 0, 0) has no direction; give the direction in which the point may lift "
                             "off")


def as_one_sided(value: Any) -> OneSided:
    """Check of a OneSided, or its side."""
    if isinstance(value, OneSided):
        return value
    try:
        return OneSided(Vector(value))
    except (Refusal, SceneError):
        raise Refusal(f"must be a direction (3 finite numbers, not all 0) or a OneSided, got {shown(value)}") from None


def as_locks(value: Any) -> tuple[Lock, ...]:
    """Check of a Lock, or several that act one after the other, as a tuple."""
    locks = tuple(value) if isinstance(value, (list, tuple)) else (value,)
    if not locks or not all(isinstance(lock, Lock) for lock in locks):
        raise Refusal(f"must be a Lock or a list of them, as in lock=fb.Lock(until=1.0), got {shown(value)}")
    return locks


def as_release(value: Any) -> Release:
    """Check of a Release."""
    if not isinstance(value, Release):
        raise Refusal(f"must be a Release, as in release=fb.Release(1.0), got {shown(value)}")
    return value


def check_locks(who: str, locks: tuple[Lock, ...], stops: Stops | None, ends: tuple[float, float]) -> None:
    """Check that locks of a slider fit each other, its stops and the ends of its beam. Raises SceneError."""
    latest = -np.inf
    for i, lock in enumerate(locks):
        if i and lock.from_start:
            raise SceneError(f"{who}: lock: a lock after another one needs a time, a place or a condition, as in fb.Lock(at=2.0)")
        if i < len(locks) - 1 and lock.until is None:
            raise SceneError(f"{who}: lock: a lock without end (until=None) must be the last one")
        for time in (lock.when, lock.until):
            if isinstance(time, float):
                if time < latest:
                    raise SceneError(f"{who}: lock: times must increase from lock to lock, but {time:.6g} s follows {latest:.6g} "
                                     "s")
                latest = time
        if isinstance(lock.when, str):
            there = [] if stops is None or not stops.is_rigid else [w for w in (START, END) if getattr(stops, w) is not None]
            if lock.when not in (*there, STOP) or not there:
                raise SceneError(f"{who}: lock: {lock.when!r} needs a rigid stop there, as in stops=fb.Stops(end=2.0)")
        if isinstance(lock.at, float) and not ends[0] <= lock.at <= ends[1]:
            raise SceneError(f"{who}: lock: at={lock.at:.6g} m lies beyond its beam ({ends[0]:.6g} to {ends[1]:.6g} m)")


def check_release(who: str, release: Release, stops: Stops | None, closed: bool) -> None:
    """Check that a release at an end of the beam has an end that the slider can reach. Raises SceneError."""
    if not isinstance(release.when, str):
        return
    if closed:
        raise SceneError(f"{who}: release: a closed path has no {release.when} to leave; give a time or a condition")
    if stops is not None and stops.is_rigid and getattr(stops, release.when) is not None:
        raise SceneError(f"{who}: release: the {release.when} of its beam lies behind a rigid stop; leave one of them out")
