"""Supports that move as functions of time, and signals: functions from tables."""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import (
    LARGEST,
    Count,
    Flag,
    Name,
    Number,
    Numbers,
    Refusal,
    Vector,
    Word,
    checked,
    numbers,
    shown,
    take,
)
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.bodies import Node
from fastbeam.scene.checks import Array, Named, NodeField, UntilLike, as_rotation, called, noun, tried
from fastbeam.scene.slider_forces import FORWARD, SHORT
from fastbeam.scene.supports import AXES, as_axes, as_until, check_since, mask_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# fewest values of accelerations
FEWEST = 4
INTERPOLATIONS = ("linear", "cubic", "pchip")
# degrees of corrections of accelerations, which the spline of their sum keeps exactly; points that integrate (v + w)^2 exactly
MOST_DEGREE, GAUSS = 3, 5
# jumps of the rate below this share of the largest rate of a table are round-off
KINK = 1e-9
TIME = Number(unit="s")


@dataclass(frozen=True)
class _Components:
    """Check of `count` finite numbers; a single one also without brackets. None: three at most. `axes`: their axes, if not
    all."""

    count: int | None = 3
    axes: str = ""

    def __call__(self, value: Any) -> Array:
        found = numbers(value)
        if found is not None and found.ndim == 0:
            found = found.reshape(1)
        fits = found is not None and found.ndim == 1 and (found.size == self.count if self.count else 0 < found.size < 4)
        if found is None or not fits or not np.all(np.abs(found) <= LARGEST):
            need = "a finite number" if self.count == 1 else f"{self.count or 'up to 3'} finite numbers"
            many = f", one for each of axes={self.axes!r}" if self.axes else ""
            raise Refusal(f"must return {need}{many}, got {shown(value)}")
        return found


_three = _Components()


def _rate(x: Array, size: float) -> Array:
    """Return derivatives at 0 of the columns of x [5, 3], numbers of this size; 0 where they are round-off, or negligible next to
    the values of the column."""
    rate = FORWARD @ x / SHORT
    noise = (20.0 * float(np.finfo(float).eps) * size + 1e-9 * np.max(np.abs(x - x[0]), axis=0)) / SHORT
    return np.where(np.abs(rate) > noise, rate, 0.0)


def axial(turn: Array) -> Array:
    """Return twice the sine of the angle of rotations [..., 3, 3] times their axis, [..., 3]."""
    x = turn - np.swapaxes(turn, -1, -2)
    return np.stack((x[..., 2, 1], x[..., 0, 2], x[..., 1, 0]), axis=-1)


def _turning(value: Any) -> tuple[Array, Array | None]:
    """Return a rotation matrix (3, 3) from a rotation vector or from itself, and the vector, None if there is none."""
    found = numbers(value)
    if found is not None and found.shape == (3, 3):
        return np.array(as_rotation(value)), None
    r = _three(value)
    angle = float(np.linalg.norm(r))
    x = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
    # sin(a)/a and (1 - cos(a))/a^2 without cancellation
    return np.eye(3) + np.sinc(angle / np.pi) * x + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * (x @ x), r


@dataclass(frozen=True)
class Moving:
    """Check of a function of t that returns numbers, or with `turns` a rotation; it is tried at t = 0."""

    turns: bool = False

    def __call__(self, value: Any) -> Callable[[float], Any]:
        what = "a rotation vector (3,) or a rotation matrix (3, 3)" if self.turns else "3 numbers, or one for each of axes="
        if not callable(value) or isinstance(value, type):
            raise Refusal(f"must be a function of t that returns {what}, got {shown(value)}")
        checks.refuse_jumps(value)
        try:
            (_turning if self.turns else _Components(None))(tried(value, "at t = 0", 0.0))
        except Refusal as refusal:
            raise Refusal(f"at t = 0 {refusal}" if "must not fail" not in str(refusal) else str(refusal)) from refusal.__cause__
        return value


@checked(name=Name(), at=Node(), position=Moving(), displacement=Moving(), rotation=Moving(turns=True), axes=as_axes,
         until=as_until, since=as_until)
@noun
class PrescribedMotion(Named):
    """Prescribed motion of a node as a function of time: base excitation, moving supports, displacement control in time
    (theory.md (4.11)).

    It holds the node like a `Pin` that moves; with `rotation`, or a `Clamp` of the same node beside it, like a clamp. The work of
    its reaction is in `result.balance()`. `solve_static(at_time=t)` moves it to its place at that time with the load factor;
    without a time it is held where it is.

    Parameters
    ----------
    name : str
    at : NodeRef, RigidBody, PointMass
        A body by its centre.
    position, displacement : callable
        t -> (3,) m, the place, or its difference to that at t = 0; one of the two, or neither where only the rotation is given.
        Velocities must be continuous: a jump of the velocity makes forces alternate from step to step for ever.
    rotation : callable, optional
        t -> rotation vector (3,) in rad, or matrix (3, 3), in space: what turns the triad at t = 0 to that at t. A vector counts
        full turns, and must not jump back by one: from one evaluation to the next it changes by less than pi. A matrix cannot
        tell how often the triad has turned: from one evaluation to the next, and from one equilibrium to the next, it goes the
        shorter way.
    axes : str
        Letters of the axes of space along which the place is prescribed, as in axes="y": `position` and `displacement` return one
        number for each then. Along the others the node is free, or held by a `Pin` or `Clamp` of its own, or moved by another
        motion.
    until : float or callable
        When it lets go for good, as for a `Clamp`: the node goes on with its velocity.
    since : float or callable
        When it takes hold, as for a `Clamp`: the node takes the velocity of the motion, and moves by what `displacement` and
        `rotation` change by from then on.

    Raises
    ------
    SceneError
        A function does not return what it should at t = 0, or neither place nor rotation is given.

    Examples
    --------
    >>> import numpy as np
    >>> from fastbeam.scene import Beam, Clamp, PrescribedMotion, Scene, Section
    >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
    >>> mast = Beam.straight('mast', (0, 0, 0), (0, 0, 2), section=bar, elements=4)
    >>> shake = PrescribedMotion('shake', mast.start, displacement=lambda t: (0.01 * np.sin(9 * t)**2, 0, 0))
    >>> Scene(mast, Clamp(mast.start), shake)
    <scene 'scene': 1 beam ('mast'), 1 clamp, 1 prescribed motion ('shake')>
    """

    kind: ClassVar[str] = "prescribed motion"

    name: str
    at: NodeField
    _: KW_ONLY
    position: Callable[[float], ArrayLike] | None = None
    displacement: Callable[[float], ArrayLike] | None = None
    rotation: Callable[[float], ArrayLike] | None = None
    axes: str = AXES
    until: UntilLike | None = None
    since: UntilLike | None = None

    def __post_init__(self) -> None:
        check_since(self.label, self.since, self.until)
        if self.since is not None and self.position is not None:
            raise SceneError(f"{self.label}: since: the motion starts from wherever the node is at that time; give displacement "
                             "instead of position")
        if self.position is not None and self.displacement is not None:
            raise SceneError(f"{self.label}: give position or displacement, not both")
        if self.position is None and self.displacement is None and self.rotation is None:
            raise SceneError(f"{self.label}: give position, displacement or rotation, as a function of t")
        if not self.at.is_center:
            raise SceneError(f"{self.label}: a body is moved by its centre, got {self.at}; prescribe the centre, or move a "
                             "PointMass that a BallJoint joins to the body")
        self.place(0.0)

    @property
    def mask(self) -> int:
        """Bits of the six unknowns of its node that it prescribes."""
        return mask_of(self.axes) | (56 if self.rotation is not None else 0)

    @checked(t=TIME)
    def place(self, t: float) -> Array:
        """Return the position, or displacement, at time t: (3,) m, zero along axes that are not prescribed.

        Raises
        ------
        SceneError
            The function fails, or returns something else.
        """
        function = self.displacement if self.position is None else self.position
        if function is None:
            return np.zeros(3)
        what = "displacement" if self.position is None else "position"
        returned = called(self.label, what, function, t)
        need = _Components(len(self.axes), "" if self.axes == AXES else self.axes)
        found = take(need, f"{self.label}: {what}(t) at t = {t:.6g} s", returned)
        if self.axes == AXES:
            return found
        out = np.zeros(3)
        out[[AXES.index(letter) for letter in self.axes]] = found
        return out

    @checked(t=TIME)
    def turn(self, t: float) -> Array:
        """Return the rotation from the triad at t = 0 at time t: (3, 3).

        Raises
        ------
        SceneError
            The function fails, or returns something else.
        """
        return self.turning(t)[0]

    @checked(t=TIME)
    def turning(self, t: float) -> tuple[Array, Array | None]:
        """Return the rotation `turn(t)` and its rotation vector (3,), rad; None if it is defined by a matrix.

        Raises
        ------
        SceneError
            The function fails, or returns something else.
        """
        if self.rotation is None:
            return np.eye(3), np.zeros(3)
        return take(_turning, f"{self.label}: rotation(t) at t = {t:.6g} s", called(self.label, "rotation", self.rotation, t))

    @checked(t=TIME)
    def rates(self, t: float = 0.0) -> tuple[Array, Array]:
        """Return velocity, m/s, and angular velocity in space, rad/s, at time t."""
        times = t + SHORT * np.arange(5)
        places, turns = np.array([self.place(t) for t in times]), np.array([self.turn(t) for t in times])
        spins = axial(turns @ turns[0].T) / 2.0
        # differences of sin(angle) times the axis, whose first four derivatives at 0 give that of the angle
        velocity, spin = (_rate(x, size) for x, size in ((places, float(np.max(np.abs(places)))), (spins, 1.0)))
        return velocity, spin


def _values(value: Any) -> Array:
    """Check of numbers [n] or [n, 3]."""
    found = numbers(value)
    fits = found is not None and (found.ndim == 1 or found.ndim == 2 and found.shape[1] == 3)
    if found is None or not fits or not np.all(np.abs(found) <= LARGEST):
        raise Refusal(f"must be finite numbers [n] or [n, 3], got {shown(value)}")
    return checks.constant(found)


def _at_start(value: Any) -> Array:
    """Check of a number, or (3,)."""
    found = numbers(value)
    if found is None or found.shape not in ((), (3,)) or not np.all(np.abs(found) <= LARGEST):
        raise Refusal(f"must be a finite number, or three, got {shown(value)}")
    return checks.constant(found)


TIMES = Numbers((None,), "increasing finite numbers [n]")


@checked(times=TIMES, values=_values, direction=Vector, rest=Flag(), interpolation=Word(INTERPOLATIONS))
class Signal:
    """Function of time from a table, along straight lines between its rows by default; accelerations: `from_acceleration`.

    Parameters
    ----------
    times : array_like [n]
        s, increasing, at least two; a jump is two rows at one time, the values before and behind it ("linear" alone).
    values : array_like [n] or [n, 3]
    direction : array_like (3,), optional
        Makes vectors of values [n]: value x direction.
    rest : bool
        True (default): the end values stay before and after the table. False: asking outside the table is an error.
    interpolation : {"linear", "cubic", "pchip"}
        "linear": straight lines, nothing between two rows lies beyond them. "pchip": smooth, with the same bounds. "cubic": the
        cubic spline, of smooth and dense tables the most accurate; it overshoots beside jumps. With `rest=True` both begin and
        end with slope zero, with `rest=False` the spline has no jump of the third derivative at the second and last but one row.

    As the factor of a load any of them is integrated over each step exactly, whatever rows and jumps it contains; at a jump its
    value is that behind it. Loads with `follower=True`, places and prescribed speeds take no jumps. The place of a support, joint
    or slider should come from a smooth one: at a row of straight lines the velocity jumps by dv, which in a step h is a
    blow with the force m dv/h on the mass m that moves along, and makes reactions alternate from step to step afterwards; an
    event `kink` tells the largest jump. With `order=4` a jump of the slope inside a step leaves order 2 there.

    Raises
    ------
    SceneError
        Tables of different length, times that do not increase, three equal ones, less than two; called outside the table with
        rest=False.

    Examples
    --------
    >>> ramp = Signal([0.0, 0.5], [0.0, 1.0])
    >>> ramp(0.25), ramp(2.0)
    (0.5, 1.0)
    >>> import numpy as np
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> push = Signal(t, 0.01 * np.sin(np.pi * t)**2, direction=(0, 0, 1), interpolation="cubic")
    >>> push(0.5).round(6).tolist(), push(2.0).round(6).tolist()
    ([0.0, 0.0, 0.01], [0.0, 0.0, 0.0])
    """

    kind: ClassVar[str] = "signal"

    def __init__(self, times: ArrayLike, values: ArrayLike, *, direction: ArrayLike | None = None, rest: bool = True,
                 interpolation: str = "linear") -> None:
        x = _table("Signal", times, values, direction, 2, interpolation == "linear")
        ends = "clamped" if rest else "not-a-knot"
        self._take(times, x, _through("Signal", times, x, ends, interpolation), rest)

    def _take(self, times: Array, values: Array, curve: Any, rest: bool, velocities: tuple[Array, Array] | None = None) -> None:
        """Store the curve; velocities: before and after the table, None: the value outside is constant, or unknown."""
        self.begin, self.end, self.rest = float(times[0]), float(times[-1]), rest
        self.times, self.values = checks.constant(times), checks.constant(values)
        self._curve, self._outside = curve, velocities
        # times between which it is smooth, for `loads.mean_factors`; times of jumps
        self._rows, self._jumps = self._curve.x, times[1:][np.diff(times) == 0.0]

    @classmethod
    @checked(times=TIMES, acceleration=_values, direction=Vector, velocity=_at_start, displacement=_at_start,
             baseline=Count(0, MOST_DEGREE))
    def from_acceleration(cls, times: ArrayLike, acceleration: ArrayLike, *, direction: ArrayLike | None = None,
                          velocity: ArrayLike = 0.0, displacement: ArrayLike = 0.0, baseline: int | None = None) -> Signal:
        """Make the displacement, m, of accelerations on the cubic spline through a table (not-a-knot), integrated twice exactly.

        Outside the table nothing accelerates: before it the motion has the initial velocity, behind it the final one.

        Parameters
        ----------
        times : array_like [n]
            s, increasing, at least four.
        acceleration : array_like [n] or [n, 3]
            m/s^2; records in shares of g are multiplied by 9.81 first.
        direction : array_like (3,), optional
            Makes vectors of accelerations [n], with the initial values.
        velocity, displacement : float, or array_like (3,) where accelerations are [n, 3]
            At times[0], m/s and m.
        baseline : {0, 1, 2, 3}, optional
            Degree of a polynomial in time that is added to the accelerations, of each component by itself, so that the velocity
            is 0 at the end of the table and, with what this leaves free, has the least mean square (theory.md 4.2). 2 is the
            usual parabolic correction of records. Default: none; a record that is off by a constant a drifts by a t^2/2.

        Raises
        ------
        SceneError
            As `Signal`; initial values of another shape than accelerations at a time.

        Examples
        --------
        >>> import numpy as np
        >>> t = np.linspace(0.0, 2.0, 401)
        >>> quake = Signal.from_acceleration(t, 3.0 * np.sin(np.pi * t), direction=(1, 0, 0), baseline=2)
        >>> bool(np.allclose(quake(5.0), quake(2.0)))
        True
        """
        who = "Signal.from_acceleration"
        x = _table(who, times, acceleration, direction, FEWEST)
        start = [_initial(who, name, value, acceleration, direction) for name, value in
                 (("velocity", velocity), ("displacement", displacement))]
        if baseline is not None:
            x = x + _correction(times, _through(who, times, x, "not-a-knot").antiderivative(), start[0], baseline)
        # constants of the integrals are the last coefficients of all pieces
        rate = _through(who, times, x, "not-a-knot").antiderivative()
        rate.c[-1] += start[0]
        place = rate.antiderivative()
        place.c[-1] += start[1]
        final = np.zeros_like(start[0]) if baseline is not None else rate(times[-1])
        out = cls.__new__(cls)
        out._take(times, place(times), place, True, (start[0], final))
        return out

    @checked(t=TIME)
    def __call__(self, t: float) -> float | Array:
        """Return the value at time t, s: a number, or (3,)."""
        if not self.rest and not self.begin <= t <= self.end:
            raise SceneError(f"Signal: t = {t:.6g} s lies outside its table, {self.begin:.6g} to {self.end:.6g} s; give more "
                             "values, or rest=True if the motion is at rest outside")
        if self.begin <= t < self.end:
            found = self._curve(float(t))
        else:
            # the last row itself, not the value of its polynomial
            found = self.values[0 if t < self.begin else -1]
            if self._outside is not None:
                found = found + self._outside[int(t >= self.end)] * (t - (self.end if t >= self.end else self.begin))
        return float(found) if np.ndim(found) == 0 else np.array(found)

    @cached_property
    def compilable(self) -> Callable[[float], float]:
        """Function of a signal of numbers that numba compiles; NaN where a call is an error."""
        begin, end, times, degree = self.begin, self.end, np.array(self._curve.x), len(self._curve.c) - 1
        pieces, first, last = np.ascontiguousarray(self._curve.c.T), float(self.values[0]), float(self.values[-1])
        before, after = (0.0, 0.0) if self._outside is None else (float(self._outside[0]), float(self._outside[1]))
        rest = self.rest

        def value(t: float) -> float:
            if t < begin or t >= end:
                if not rest and t != end:
                    return math.nan
                return first + before * (t - begin) if t < begin else last + after * (t - end)
            k = np.searchsorted(times, t, side="right") - 1
            out = pieces[k, 0]
            for i in range(1, degree + 1):
                out = out * (t - times[k]) + pieces[k, i]
            return out
        return value

    def __repr__(self) -> str:
        what, outside = "numbers" if self.values.ndim == 1 else "vectors", ", at rest outside" if self.rest else ""
        outside = outside if self._outside is None else ", from accelerations"
        return f"<signal: {len(self.times)} {what}, {self.begin:.6g} to {self.end:.6g} s{outside}>"


def largest_kink(of: Signal, begin: float, end: float) -> tuple[float, float]:
    """Return the time in [begin, end) of the largest jump of the rate, s, and its size: 0 without a jump. At the begin it does
    not jump, as moving parts start with the rate behind it."""
    slope = of._curve.derivative()
    before, after = np.zeros((2, *of.values.shape))
    before[1:] = slope(np.nextafter(of.times[1:], -np.inf))
    after[:-1] = slope(of.times[:-1])
    if of._outside is not None:
        before[0], after[-1] = of._outside
    elif not of.rest:
        before[0], after[-1] = after[0], before[-1]
    jump = np.linalg.norm((after - before).reshape(len(of.times), -1), axis=1)
    size = np.linalg.norm(np.maximum(np.abs(before), np.abs(after)).reshape(len(of.times), -1), axis=1)
    scale = max(float(np.max(size)), float(np.max(np.ptp(of.values, axis=0))) / (of.end - of.begin))
    jump = np.where((jump > KINK * scale) & (of.times > begin) & (of.times < end), jump, 0.0)
    k = int(np.argmax(jump))
    return float(of.times[k]), float(jump[k])


def _table(who: str, times: Any, values: Any, direction: Any, fewest: int, jumps: bool = False) -> Array:
    """Return values [n] or [n, 3] of a table; jumps: whether a time may appear twice."""
    step = np.diff(times)
    if len(times) < fewest or not np.all(step >= 0.0 if jumps else step > 0.0) or times[-1] == times[0]:
        asks = who == "Signal" and not jumps and np.any(step == 0.0)
        more = "; a jump, two rows at one time, takes interpolation='linear'" if asks else ""
        raise SceneError(f"{who}: times must increase, and be at least {fewest}, got {shown(times)}{more}")
    if np.any((step[1:] == 0.0) & (step[:-1] == 0.0)):
        raise SceneError(f"{who}: a jump needs exactly two rows at one time, with the values before and after it, but more rows "
                         f"have t = {times[2:][(step[1:] == 0.0) & (step[:-1] == 0.0)][0]:.6g} s")
    if len(values) != len(times):
        what = "values" if who == "Signal" else "accelerations"
        raise SceneError(f"{who}: {what} must be as many as times, got {len(values)} and {len(times)}")
    if direction is None:
        return np.asarray(values)
    if values.ndim == 2:
        raise SceneError(f"{who}: direction is for scalar values [n], but these are vectors already; leave it out")
    return np.asarray(values[:, None] * direction)


def _through(who: str, times: Array, values: Array, ends: str, interpolation: str = "cubic") -> Any:
    """Return the curve through a table."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator, PPoly
    try:
        with np.errstate(all="ignore"):
            if interpolation == "linear":
                some = np.diff(times) > 0.0
                step = np.diff(times)[some].reshape(-1, *np.ones(values.ndim - 1, int))
                pieces = np.stack((np.diff(values, axis=0)[some] / step, values[:-1][some]))
                curve = PPoly(pieces, np.append(times[:-1][some], times[-1]))
            elif interpolation == "cubic":
                curve = CubicSpline(times, values, bc_type=ends)
            else:
                slopes = PchipInterpolator(times, values).derivative()(times)
                slopes[[0, -1]] *= float(ends != "clamped")
                curve = CubicHermiteSpline(times, values, slopes)
        good = np.isfinite(curve.c).all()
    except (ValueError, np.linalg.LinAlgError):
        good = False
    if not good:
        raise SceneError(f"{who}: no interpolating curve was found for this table, because its numbers are too large or its "
                         "times too close")
    return curve


def _initial(who: str, name: str, value: Any, acceleration: Array, direction: Any) -> Array:
    """Return an initial value in the shape of the integrand at one time; 0 stands for a vector, too."""
    found, shape = np.asarray(value, dtype=float), acceleration.shape[1:]
    if found.shape != shape and np.any(found):
        need = "(3,), as of accelerations [n, 3]" if shape else "a number, as accelerations [n] have at a time"
        raise SceneError(f"{who}: {name} must be {need}, got {shown(value)}")
    found = found if found.shape == shape else np.zeros(shape)
    return found if direction is None else np.asarray(found * direction)


def _correction(times: Array, rate: Any, velocity: Array, degree: int) -> Array:
    """Return the correction of accelerations: the derivative of w with v + w = 0 at the end and the least integral of (v + w)^2,
    for the velocity v = velocity + rate(t) and w a polynomial of degree + 1 that is 0 at the begin (theory.md 4.2)."""
    begin, span = times[0], times[-1] - times[0]
    x, weight = np.polynomial.legendre.leggauss(GAUSS)
    step = np.diff(times)
    at = (times[:-1, None] + 0.5 * step[:, None] * (1.0 + x)).reshape(-1)
    s = (at - begin) / span
    v, last = velocity + rate(at), velocity + rate(times[-1])
    v, last = v.reshape(len(at), -1), np.reshape(last, (1, -1))
    # the part that meets the end, and those that do not change it: powers of s less s
    v = v - last * s[:, None]
    powers = np.arange(2, degree + 2)
    free = s[:, None]**powers - s[:, None]
    root = np.sqrt(0.5 * step[:, None] * weight).reshape(-1, 1)
    share = -np.linalg.lstsq(root * free, root * v, rcond=None)[0] if degree else np.zeros((0, v.shape[1]))
    s = ((times - begin) / span)[:, None]
    out = (-last + (powers * s**(powers - 1) - 1.0) @ share) / span
    return np.asarray(out.reshape(len(times), *np.shape(velocity)))
