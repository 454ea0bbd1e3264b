"""Beams and references to their nodes."""
from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Required, TypedDict, Unpack

import numpy as np

from fastbeam.interface.arguments import (
    LARGEST,
    Anything,
    Instance,
    Name,
    Number,
    Numbers,
    Refusal,
    Vector,
    Word,
    checked,
    numbers,
    shown,
    spell_out,
    whole,
)
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.checks import Array, ArrayField, Named, Takes, noun
from fastbeam.scene.curves import Arc, Curve, FittedCurve, Helix, StraightLine, spline_through
from fastbeam.scene.sections import Section

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fastbeam.scene.bodies import PointMass, RigidBody
    from fastbeam.scene.fixed import Ground
    from fastbeam.scene.interpolation.basis import Basis

DEGREES = {"lagrange": (1, 8), "bspline": (2, 5)}
DIRECTORS = ("greville", "control")
STRAINS = ("simo_reissner", "green_lagrange")
MOST_ELEMENTS = 10**7


def as_elements(value: Any) -> int | Array:
    """Check of a number of elements, or of the arc lengths of their ends."""
    count = whole(value)
    if count is not None:
        if not 1 <= count <= MOST_ELEMENTS:
            raise Refusal(f"must be a whole number >= 1 (at most {MOST_ELEMENTS:g}) or the increasing arc lengths of the "
                          f"element ends, got {shown(value)}")
        return count
    ends = numbers(value)
    if ends is None or ends.ndim != 1:
        raise Refusal("must be a whole number >= 1 or the increasing arc lengths of the element ends, got "
                      f"{shown(value)}")
    return Numbers((None,), "finite arc lengths")(ends)


def as_curve(value: Any) -> Any:
    """Check of an object with `length` and `reference(s)`."""
    if isinstance(value, type) or not callable(getattr(value, "reference", None)) or not hasattr(value, "length"):
        hint = "use Beam.from_curve(...)" if callable(value) else "use Beam.straight(...) or a curve object"
        raise Refusal(f"must have length and reference(s), got {shown(value)}; {hint}")
    Number(above=0.0, unit="m")(value.length)
    return value


def as_arc_lengths(value: Any) -> Array:
    """Check of one arc length or several, as an array [n]."""
    s = numbers(value)
    if s is None or s.ndim > 1 or not np.all(np.abs(s) <= LARGEST):
        raise Refusal(f"must be arc lengths, finite numbers of shape [n], got {shown(value)}")
    return np.atleast_1d(s)


# degree and interpolation belong together
COMMON = {"section": Instance(Section, "a Section", "use Section.rectangle(...) for instance"), "elements": as_elements,
          "degree": Anything(), "interpolation": Anything(), "directors": Word(DIRECTORS), "strain": Word(STRAINS),
          "prestrain": Number(least=-10.0, most=0.99), "prestress": Number(unit="N")}
OWNERS = ("beam", "body", "point mass", "crossing", "point of rope", "drum", "ground")


class BeamOptions(TypedDict, total=False):
    """Arguments that all ways to make a beam share, see `Beam`."""

    section: Required[Section]
    elements: Required[int | Sequence[float] | Array]
    degree: int
    interpolation: str
    directors: str
    strain: str
    prestrain: float
    prestress: float


@checked(owner=Anything(), index=Anything(), offset=Vector)
@noun
class NodeRef:
    """One node of a beam, or a point fixed to a rigid body, point mass or the ground. Made by `beam.start`, `body.point(...)` and
    so on.

    Attributes
    ----------
    owner : Beam, RigidBody or PointMass
    index : int
        Node of the beam, counted from 0; 0 for bodies and masses.
    offset : ndarray (3,)
        Position relative to the centre in the body triad, m; zero except for bodies. Of the ground: the position in space.

    Raises
    ------
    SceneError
        The owner is no beam, body or mass, or has no such node, or the offset is not 3 finite numbers, or one of a beam or mass.
    """

    owner: Beam | RigidBody | PointMass | Ground
    index: int = 0
    offset: ArrayField = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        kind = getattr(self.owner, "kind", None)
        if kind not in OWNERS or isinstance(self.owner, type):
            raise SceneError(f"NodeRef: owner must be a Beam, RigidBody or PointMass, got {shown(self.owner)}; nodes are made by "
                             "beam.start, beam.end, beam.node(i), net.node(i), body.point(offset)")
        last = self.owner.n_nodes - 1 if isinstance(self.owner, Beam) else 0
        index = whole(self.index)
        if index is None or not 0 <= index <= last:
            hint = f"; use its node({index}) to count from the end" if index is not None and -last - 1 <= index < 0 else ""
            raise SceneError(f"NodeRef: {self.owner.label} has no node {shown(self.index)}, nodes run from 0 to {last}{hint}")
        if np.any(self.offset) and kind not in ("body", "ground"):
            raise SceneError(f"NodeRef: {self.owner.label} takes no offset, got {shown(self.offset)}; only bodies do; join a "
                             "RigidBody there with a RigidConnection and use its point(offset)")
        checks.fill(self, index=index)

    @property
    def is_center(self) -> bool:
        """True if the point is the node itself (no offset)."""
        return not self.offset.any()

    @property
    def place(self) -> Array:
        """Position (3,) m at t = 0 of a node of a beam, or of a point of a body or mass with a position."""
        owner: Any = self.owner
        if isinstance(owner, Beam):
            return owner.reference(owner.node_s[self.index])[0][0]
        return owner.position + self.offset @ owner.directors if hasattr(owner, "directors") else owner.position

    @property
    def label(self) -> str:
        """Text for messages and automatic names, without the arc length."""
        if isinstance(self.owner, Beam):
            return f"{self.owner.label} node {self.index}"
        if self.owner.kind == "ground":
            return f"ground at {checks.shown(self.offset)} m"
        return self.owner.label if self.is_center else f"{self.owner.label} at offset {checks.shown(self.offset)} m"

    def __str__(self) -> str:
        if isinstance(self.owner, Beam):
            return f"{self.label} (s = {self.owner.node_s[self.index]:.6g} m)"
        return self.label

    def __repr__(self) -> str:
        return f"<{self}>"

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, NodeRef) and self.owner is other.owner and self.index == other.index
                and np.array_equal(self.offset, other.offset))

    def __hash__(self) -> int:
        return hash((self.owner, self.index, tuple(self.offset.tolist())))


def nearest_on(line: Any, point: Any) -> tuple[float, float]:
    """Return `Beam.nearest` on a beam or path: the best of a thousand places, and the zero of (x - point) . d1 beside it."""
    s = np.linspace(0.0, line.length, 1001)
    best = int(np.argmin(np.linalg.norm(line.reference(s)[0] - point, axis=1)))
    low, high = s[max(best - 1, 0)], s[min(best + 1, s.size - 1)]
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        x, triad = line.reference(middle)
        low, high = (low, middle) if (x[0] - point) @ triad[0, 0] > 0.0 else (middle, high)
    ends = np.array([low, high])
    distance = np.linalg.norm(line.reference(ends)[0] - point, axis=1)
    k = int(np.argmin(distance))
    return float(ends[k]), float(distance[k])


@checked(name=Name(), curve=as_curve, **COMMON)
@noun
class Beam(Named):
    """One beam: a reference curve with triads, a section and an interpolation. The reference is free of stress, unless it is
    given a prestrain or a prestress.

    Parameters
    ----------
    name : str
        Unique in its scene.
    curve : Curve
        Object with `length` and `reference(s)`; usually made by `straight`, `arc`, `helix`, `from_curve`, `through_points`.
    section : Section
    elements : int or array_like
        Number of equal elements, or increasing arc lengths of the element ends from 0 to the length, m.
    degree : int
        Polynomial degree: 1 to 8 ('lagrange'), 2 to 5 ('bspline').
    interpolation : {'lagrange', 'bspline'}
    directors : {'greville', 'control'}
        Where the triads of a 'bspline' are orthonormal (theory.md 3.1); without meaning for 'lagrange'.
    strain : {'simo_reissner', 'green_lagrange'}
        Strain measure, theory.md (2.2) or (2.1).
    prestrain : float
        Axial strain in the reference (theory.md (2.8)): without stress the beam is 1 - prestrain times as long; > 0: taut.
    prestress : float
        Normal force in the reference, N, instead of `prestrain`; > 0: tension.

    Raises
    ------
    SceneError
        An argument is out of its range; the message names it.
    """

    kind: ClassVar[str] = "beam"

    name: str
    curve: Curve
    _: KW_ONLY
    section: Section
    elements: Takes[int | Sequence[float] | Array, int | Array]
    degree: int = 3
    interpolation: str = "lagrange"
    directors: str = "greville"
    strain: str = "simo_reissner"
    prestrain: float = 0.0
    prestress: float = 0.0

    def __post_init__(self) -> None:
        who = checks.label("beam", self.name)
        strained(who, self.section, self.prestrain, self.prestress)
        if not isinstance(self.interpolation, str) or self.interpolation not in DEGREES:
            raise SceneError(f"{who}: interpolation {shown(self.interpolation)} does not exist: choose 'lagrange' (degree 1 to "
                             "8) or 'bspline' (degree 2 to 5)")
        low, high = DEGREES[self.interpolation]
        degree = whole(self.degree)
        if degree is None or not low <= degree <= high:
            raise SceneError(f"{who}: degree={shown(self.degree)} lies outside {low} to {high} of interpolation "
                             f"{self.interpolation!r}")
        if self.interpolation == "lagrange" and self.directors != "greville":
            raise SceneError(f"{who}: directors={self.directors!r} exists only for interpolation 'bspline'; leave it out")
        checks.fill(self, degree=degree, elements=_element_ends(who, self.elements, self.length))

    # --- ways to make one ---------------------------------------------------------------------------------------------
    @classmethod
    @checked(name=Name(), start=Vector, end=Vector, d2=Vector, twist=Number(), **COMMON)
    def straight(cls, name: str, start: ArrayLike, end: ArrayLike, *, d2: ArrayLike | None = None, twist: float = 0.0,
                 **common: Unpack[BeamOptions]) -> Beam:
        """Make a straight beam from `start` to `end` (3,), m.

        d1 points along the beam. Without a hint d3 is as close to e_z as possible, d2 = e_z x d1 (for a beam along e_z:
        d2 = e_y). `d2` (3,) is a hint: its part orthogonal to d1 is taken. `twist` (rad) turns d2, d3 about d1 linearly.

        Raises
        ------
        SceneError
            Start and end coincide, d2 is parallel to the beam, or an argument of Beam is out of range.

        Examples
        --------
        >>> from fastbeam.scene import Beam, Section
        >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
        >>> boom = Beam.straight('boom', (0, 0, 0), (0, 2, 0), section=bar, elements=4)
        >>> boom.length
        2.0
        >>> phi, d = boom.reference([1.0])
        >>> phi[0].tolist(), d[0, 0].tolist(), d[0, 2].tolist()
        ([0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
        """
        who = checks.label("beam", name)
        length = float(np.linalg.norm(end - start))
        if length <= 1e-14 * float(np.max(np.abs([start, end]))):
            raise SceneError(f"{who}: start and end coincide at {checks.shown(start)}; a beam needs a length > 0 m")
        triad = checks.default_triad(who, checks.direction(who, "end - start", end - start), d2)
        return cls(name, StraightLine(start, triad, length, twist), **common)

    @classmethod
    @checked(name=Name(), start=Vector, tangent=Vector, normal=Vector, radius=Number(above=0.0, unit="m"),
             angle=Number(above=0.0, unit="rad"), **COMMON)
    def arc(cls, name: str, start: ArrayLike, tangent: ArrayLike, normal: ArrayLike, *, radius: float, angle: float,
            **common: Unpack[BeamOptions]) -> Beam:
        """Make a circular arc from `start` along `tangent`, bent towards `normal`, the direction from start to the centre.

        d1 is the tangent, d2 points to the centre, d3 = d1 x d2 is constant. `radius` in m, `angle` in rad, both > 0.

        Raises
        ------
        SceneError
            Tangent and normal are not orthogonal (1e-6), or radius or angle is not positive.
        """
        who = checks.label("beam", name)
        t, n = checks.direction(who, "tangent", tangent), checks.direction(who, "normal", normal)
        if abs(float(t @ n)) > 1e-6:
            angle_between = math.degrees(math.acos(max(-1.0, min(1.0, float(t @ n)))))
            raise SceneError(f"{who}: normal={checks.shown(normal)} must be orthogonal to tangent={checks.shown(tangent)}, "
                             f"the angle between them is {angle_between:.6g} degrees")
        return cls(name, Arc(start, checks.triad_from(who, t, n), radius, angle), **common)

    @classmethod
    @checked(name=Name(), radius=Number(above=0.0, unit="m"), pitch=Number(), turns=Number(above=0.0), center=Vector, axis=Vector,
             start_direction=Vector, **COMMON)
    def helix(cls, name: str, *, radius: float, pitch: float, turns: float, center: ArrayLike = (0.0, 0.0, 0.0),
              axis: ArrayLike = (0.0, 0.0, 1.0), start_direction: ArrayLike = (1.0, 0.0, 0.0),
              **common: Unpack[BeamOptions]) -> Beam:
        """Make a helix about `axis` through `center` from center + radius * start_direction (its part across the axis).

        `pitch` (m) is the rise per turn; negative gives a left-handed helix. Frenet frame: d1 tangent, d2 towards the axis.

        Raises
        ------
        SceneError
            Radius or turns is not positive, or start_direction is parallel to the axis.
        """
        who = checks.label("beam", name)
        e3, hint = checks.direction(who, "axis", axis), checks.direction(who, "start_direction", start_direction)
        if float(np.linalg.norm(np.cross(e3, hint))) < 1e-6:
            raise SceneError(f"{who}: start_direction={checks.shown(start_direction)} is parallel to axis={checks.shown(axis)}")
        e3, e1, e2 = checks.triad_from(who, e3, hint)
        return cls(name, Helix(center, checks.constant(np.array([e1, e2, e3])), radius, pitch, turns), **common)

    @classmethod
    @checked(name=Name(), curve=Anything(), frame=Anything(), d2=Vector, **COMMON)
    def from_curve(cls, name: str, curve: Callable[[float], ArrayLike], *,
                   frame: Callable[[float], ArrayLike] | None = None,
                   d2: ArrayLike | None = None, **common: Unpack[BeamOptions]) -> Beam:
        """Make a beam along any curve t in [0, 1] -> position (3,), m; arc length is found numerically (1e-12 where smooth).

        `frame`: t -> d2 (3,), or rows d1, d2, d3 (3, 3) with d1 the tangent. Without it the frame has no rotation about
        the tangent (rotation minimising) and starts from the hint `d2` or the rule of `straight`.

        Raises
        ------
        SceneError
            The function gives no finite points, stands still or turns back; the frame is parallel to the tangent.
        """
        return cls(name, FittedCurve(checks.label("beam", name), curve, frame=frame, d2=d2), **common)

    @classmethod
    @checked(name=Name(), points=Numbers((None, 3), "finite numbers of shape [m, 3]"), d2=Vector, **COMMON)
    def through_points(cls, name: str, points: ArrayLike, *, d2: ArrayLike | None = None, **common: Unpack[BeamOptions]) -> Beam:
        """Make a beam along the C2 cubic spline through points [m, 3], m >= 2 (chord-length parameter, not-a-knot ends).

        The frame is rotation minimising and starts from the hint `d2` or the rule of `straight`.

        Raises
        ------
        SceneError
            Fewer than two points, a wrong shape, or neighbouring points that coincide.
        """
        return cls(name, spline_through(checks.label("beam", name), points, d2=d2), **common)

    # --- geometry -----------------------------------------------------------------------------------------------------
    @property
    def length(self) -> float:
        """Reference length, m."""
        return float(self.curve.length)

    @checked(s=as_arc_lengths)
    def reference(self, s: ArrayLike) -> tuple[Array, Array]:
        """Return reference positions [n, 3] (m) and triads [n, 3, 3] (rows d1, d2, d3; d1 the unit tangent) at arc lengths s[n].

        Raises
        ------
        SceneError
            An arc length lies outside the beam.
        """
        slack = 1e-9 * self.length
        inside = (s >= -slack) & (s <= self.length + slack)
        if not np.all(inside):
            raise SceneError(f"{self.label}: s={s[~inside][0]:.6g} lies outside it (0 to {self.length:.6g} m)")
        return self.curve.reference(np.clip(s, 0.0, self.length))

    @checked(point=Vector)
    def nearest(self, point: ArrayLike) -> tuple[float, float]:
        """Return the arc length of the place on the reference curve nearest to `point` (3,), and its distance, both m.

        Raises
        ------
        SceneError
            The point is not 3 finite numbers.

        Examples
        --------
        >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
        >>> bow = Beam.arc('bow', (1, 0, 0), (0, 1, 0), (-1, 0, 0), radius=1, angle=3, section=bar, elements=3)
        >>> s, distance = bow.nearest((1, 1, 0))
        >>> print(f'{s:.6f} {distance:.6f}', bow.reference(s)[0][0].round(6))
        0.785398 0.414214 [0.707107 0.707107 0.      ]
        """
        return nearest_on(self, point)

    # --- nodes --------------------------------------------------------------------------------------------------------
    @cached_property
    def basis(self) -> Basis:
        """Interpolation tables of the beam, built once when first asked for."""
        from fastbeam.scene.interpolation.basis import build_basis

        return build_basis(self.interpolation, self.degree, self.elements, self.length, self.directors)

    @property
    def start_strain(self) -> Array:
        """Six strains in the reference, without those of its own shape."""
        return strained(self.label, self.section, self.prestrain, self.prestress)

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return self.elements if isinstance(self.elements, int) else len(self.elements) - 1

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return self.n_elements * self.degree + 1 if self.interpolation == "lagrange" else self.n_elements + self.degree

    @property
    def node_s(self) -> Array:
        """Arc length of every node [n_nodes], m (Greville abscissae for 'bspline')."""
        return self.basis.node_s

    @property
    def start(self) -> NodeRef:
        """The node at s = 0."""
        return NodeRef(self, 0)

    @property
    def end(self) -> NodeRef:
        """The node at s = length."""
        return NodeRef(self, self.n_nodes - 1)

    @checked(index=Anything())
    def node(self, index: int) -> NodeRef:
        """Return a node by number; negative numbers count from the end.

        Raises
        ------
        SceneError
            There is no such node.
        """
        clean, n = whole(index), self.n_nodes
        if clean is None or not -n <= clean < n:
            raise SceneError(f"{self.label}: node {shown(index)} does not exist, nodes run from 0 to {n - 1} (or from the end, "
                             f"-1 to {-n})")
        return NodeRef(self, clean % n)

    @checked(s=Number(unit="m"))
    def at(self, s: float) -> NodeRef:
        """Return the node at arc length s (m), which must be one of `node_s` within 1e-9 of the length.

        Raises
        ------
        SceneError
            No node lies there; the message lists the two nearest.
        """
        gap = np.abs(self.node_s - s)
        index = int(np.argmin(gap))
        if gap[index] > 1e-9 * self.length:
            near = " and ".join(f"{x:.10g}" for x in sorted(self.node_s[np.argsort(gap, kind="stable")[:2]].tolist()))
            raise SceneError(f"{self.label}: no node at s={s:.10g}, the nearest nodes lie at s = {near} m (beam: 0 to "
                             f"{self.length:.6g} m); use one of them or put an element end at s with elements=[...]")
        return NodeRef(self, index)

    def __repr__(self) -> str:
        return (f"<{self.label}: {self.length:.6g} m, {self.n_elements} elements, {self.interpolation} {self.degree}, "
                f"{self.strain}>")


for _way in ("straight", "arc", "helix", "from_curve", "through_points"):
    spell_out(vars(Beam)[_way].__func__, Beam)


def strained(who: str, section: Section, prestrain: float, prestress: float) -> Array:
    """Return the six strains of a prestrain, or of the normal force prestress. Raises SceneError: both are given, or the beam
    would have no length without stress."""
    if prestrain != 0.0 and prestress != 0.0:
        raise SceneError(f"{who}: give prestrain or prestress, not both")
    out = np.zeros(6)
    out[0] = prestrain
    if prestress != 0.0:
        out = np.linalg.solve(section.C, np.array([prestress, 0, 0, 0, 0, 0]))
        if not out[0] <= 0.99:
            raise SceneError(f"{who}: prestress={prestress:.6g} N gives it a prestrain of {out[0]:.3g}, so its unstressed length "
                             f"would not be positive. The prestrain must be at most 0.99, here {0.99 * prestress / out[0]:.6g} N")
    return out


def _element_ends(who: str, elements: Any, length: float) -> int | Array:
    """Return the number of elements, or their checked ends [n + 1]; both outer ends are set exactly."""
    if isinstance(elements, int):
        return elements
    ends = np.array(elements)
    if ends.size < 2 or abs(ends[0]) > 1e-9 * length or abs(ends[-1] - length) > 1e-9 * length:
        raise SceneError(f"{who}: elements must run from 0 to the length {length:.10g} m, got {checks.shown(elements)}")
    ends[0], ends[-1] = 0.0, length
    if np.any(np.diff(ends) <= 0.0):
        i = int(np.argmax(np.diff(ends) <= 0.0))
        raise SceneError(f"{who}: elements must increase strictly, entry {i + 1} ({ends[i + 1]:.6g}) does not exceed entry {i} "
                         f"({ends[i]:.6g})")
    return checks.constant(ends)
