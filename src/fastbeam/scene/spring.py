"""Springs and dampers along the line of two points."""
from __future__ import annotations

from dataclasses import KW_ONLY
from itertools import islice
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import LARGEST, Flag, Name, Number, Refusal, Word, checked, constant, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene.bodies import Node
from fastbeam.scene.checks import Array, OptionalArray, noun
from fastbeam.scene.links import Link

ENDS = Name("a spring has two ends, write one for every pair")
INTERPOLATIONS = ("linear", "spline")
# rows of a table
MOST_POINTS = 100_000


def as_table(value: Any) -> Array:
    """Check of two rows of numbers of one length: arguments that grow, and values."""
    need = "must be two rows of at least 2 finite numbers each, elongations in m that grow and forces in N"
    try:
        rows = [] if isinstance(value, (str, bytes, dict)) else [numbers(row) for row in islice(value, 3)]
    except Exception:          # objects that cannot be looped over
        rows = []
    if len(rows) != 2 or any(row is None or row.ndim != 1 for row in rows):
        raise Refusal(f"{need}, got {shown(value)}")
    x, y = rows
    if x.size != y.size or not 2 <= x.size <= MOST_POINTS or not all(np.all(np.abs(row) <= LARGEST) for row in rows):
        raise Refusal(f"{need}, got {x.size} elongations and {y.size} forces" + (
            "" if x.size != y.size or x.size < 2 else f", finite ones of at most {LARGEST:g}, at most {MOST_POINTS} of them"))
    back = np.flatnonzero(~(np.diff(x) > 1e-12 * np.ptp(x)))
    if back.size:
        k = int(back[0])
        raise Refusal(f"{need}; elongation {k + 1} is {x[k + 1]:.6g} m after {x[k]:.6g} m")
    return constant(np.array(rows))


@checked(a=Node(fixed=True), b=Node(fixed=True), name=ENDS,
         stiffness=Number(least=0.0, unit="N/m"), length=Number(least=0.0, unit="m"), damping=Number(least=0.0, unit="N s/m"),
         tension_only=Flag(), compression_only=Flag(), table=as_table, interpolation=Word(INTERPOLATIONS))
@noun
class Spring(Link):
    """Spring without mass between two points: nodes of beams, points of bodies, masses.

    It pulls and pushes along the line of both points. Its energy is 1/2 stiffness (distance - length)^2, or the integral of a
    table; energy and momenta are kept by steps of any size, through slack and over kinks too (theory.md (4.18)).
    `result.spring(name)` has its length, force, energy and loss.

    Parameters
    ----------
    a, b : NodeRef, RigidBody or PointMass
        Its ends; one may be `GROUND.point((x, y, z))`.
    name : str, optional
    stiffness : float
        N/m, >= 0. Left out where there is a table.
    length : float, optional
        Length without elongation, m, >= 0; default: the distance of its ends at t = 0.
    damping : float
        Damper beside it, N s/m, >= 0: the force damping times the rate of the length. Steps of order 2 alone.
    tension_only, compression_only : bool
        Neither force nor damping where it is shorter (longer) than `length`: a rope, a buffer.
    table : two rows (n,), optional
        Elongations distance - length, m, growing, and forces there, N, positive where it pulls. Outside the table the force goes
        on with the slope at its end.
    interpolation : {'linear', 'spline'}
        Interpolation of the table: straight lines, or the cubic spline with continuous curvature (not-a-knot: four points of a
        cubic give the cubic).

    Raises
    ------
    SceneError
        An end is no node, body or mass, both ends are the same, a number is out of range, elongations do not grow; stiffness and
        table are both given or both missing, a table is to pull (push) alone.

    Examples
    --------
    >>> from fastbeam.scene import Clamp, PointMass, Scene, Spring
    >>> anchor, bob = PointMass('anchor', mass=1.0, position=(0, 0, 0)), PointMass('bob', mass=2.0, position=(0, 0, -1))
    >>> scene = Scene(anchor, bob, Clamp(anchor), Spring(anchor, bob, 'spring', stiffness=200.0), gravity=(0, 0, -9.81))
    >>> scene.check()
    """

    kind: ClassVar[str] = "spring"

    _: KW_ONLY
    stiffness: float | None = None
    length: float | None = None
    damping: float = 0.0
    tension_only: bool = False
    compression_only: bool = False
    table: OptionalArray = None
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.stiffness is None) == (self.table is None):
            which = "got both" if self.table is not None else "got none"
            raise SceneError(f"{self.label}: needs stiffness= (N/m) or table=, {which}")
        if self.tension_only and self.compression_only:
            raise SceneError(f"{self.label}: tension_only and compression_only together leave no force; give one of them")
        if self.table is not None and (self.tension_only or self.compression_only):
            raise SceneError(f"{self.label}: a table defines one-sided behaviour itself: give forces of 0 there, and leave "
                             f"{('tension_only' if self.tension_only else 'compression_only')} out")
        if self.table is None and self.interpolation != "linear":
            raise SceneError(f"{self.label}: interpolation={self.interpolation!r} is for a table only; leave it out")

    @property
    def side(self) -> int:
        """1 where it only pulls, -1 where it only pushes, 0: both."""
        return int(self.tension_only) - int(self.compression_only)

    @property
    def is_damped(self) -> bool:
        """True if it dissipates energy."""
        return self.damping > 0.0

    @property
    def has_law(self) -> bool:
        """True if it is more than a linear spring."""
        return self.is_damped or self.side != 0 or self.table is not None


@checked(a=Node(fixed=True), b=Node(fixed=True), name=ENDS, damping=Number(least=0.0, unit="N s/m"))
@noun
class Damper(Link):
    """Linear damper along the line of two points: the force `damping` times the rate of their distance. Steps of order 2 alone.

    Parameters
    ----------
    a, b, name
        See `Spring`.
    damping : float
        N s/m, >= 0.

    Raises
    ------
    SceneError
        An end is no node, body or mass, both ends are the same, a number is out of range.
    """

    kind: ClassVar[str] = "damper"
    stiffness: ClassVar[float] = 0.0
    length: ClassVar[None] = None
    table: ClassVar[None] = None
    side: ClassVar[int] = 0
    has_law: ClassVar[bool] = True

    _: KW_ONLY
    damping: float

    @property
    def is_damped(self) -> bool:
        """True if it dissipates energy."""
        return self.damping > 0.0
