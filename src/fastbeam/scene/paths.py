"""Paths: several beams end to end, as one curve that sliders run on."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, field
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Flag, Name, Number, Refusal, Vector, checked, shown, whole
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef, as_arc_lengths, nearest_on
from fastbeam.scene.checks import Array, Named, Takes, noun
from fastbeam.scene.nets import Net

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

MOST_BEAMS = 10**5
# times around a closed path that a slider may begin with
MOST_ROUNDS = 1e6


def as_beam(value: Any) -> Beam:
    """Check of a Beam."""
    if not isinstance(value, Beam):
        raise Refusal(f"must be a Beam, got {shown(value)}{_hint(value)}")
    return value


def _hint(value: Any) -> str:
    """Return the advice how to name a beam in the place of a value that is none."""
    if isinstance(value, NodeRef) and isinstance(value.owner, Beam):
        return f"; give {value.owner.label} itself"
    return "; use its beam(k)" if isinstance(value, Net) else ""


def as_beams_in_order(value: Any) -> tuple[tuple[Beam, int], ...]:
    """Check of beams, or pairs (beam, 1) and (beam, -1): a list of (beam, direction)."""
    if isinstance(value, Beam) or not isinstance(value, Iterable) or isinstance(value, (str, bytes, type, np.ndarray)):
        hint = "; write [beam]" if isinstance(value, Beam) else ""
        raise Refusal(f"must be a list of beams in their order, got {shown(value)}{hint}")
    items = tuple(islice(value, MOST_BEAMS + 1))
    if not items:
        raise Refusal("is empty; name the beams in their order, as in [a, b, (c, -1)]")
    if len(items) > MOST_BEAMS:
        raise Refusal(f"may hold at most {MOST_BEAMS} beams")
    return tuple(_with_direction(item) for item in items)


def _with_direction(item: Any) -> tuple[Beam, int]:
    beam, direction = item if isinstance(item, (tuple, list)) and len(item) == 2 else (item, 1)
    if not isinstance(beam, Beam):
        raise Refusal(f"must be beams, or pairs (beam, -1) of those that run backwards, got {shown(item)}{_hint(beam)}")
    sign = whole(direction)
    if sign not in (1, -1):
        raise Refusal(f"has {beam.label} in direction {shown(direction)}; give 1, or -1 where the path runs from its end to "
                      "its start")
    return beam, int(sign)


@checked(name=Name(), beams=as_beams_in_order, closed=Flag())
@noun
class Path(Named):
    """Beams end to end as one curve: sliders run from beam to beam and, where it is closed, around (theory.md 5.7).

    The ends of neighbours have to meet, and something has to hold them together: a rigid connection, a ball joint, a common node
    of a net, or supports. A path is no part of a scene; its sliders name it, `Slider(name, point, on=path, at=s)`, and its beams
    are parts.

    Parameters
    ----------
    name : str
    beams : sequence of Beam, or of (Beam, 1) and (Beam, -1)
        In their order; -1: from the end of the beam to its start. Beams of nets, `net.beam(k)`, are beams.
    closed : bool
        Whether the last beam leads into the first. Arc lengths then are any numbers: s and s + length are the same place.

    Attributes
    ----------
    beams : tuple of Beam
    directions : tuple of int
        1 or -1 for every beam.

    Raises
    ------
    SceneError
        There is no beam, one appears twice, or an argument is of the wrong kind. Whether the ends meet is tested by
        `Scene.check`, whether they are joined by `compile_scene`.

    Examples
    --------
    >>> from fastbeam.scene import Beam, Path, Section
    >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
    >>> a = Beam.straight('a', (0, 0, 0), (2, 0, 0), section=bar, elements=2)
    >>> b = Beam.straight('b', (2, 1, 0), (2, 0, 0), section=bar, elements=2)
    >>> path = Path('corner', [a, (b, -1)])
    >>> path.length, path.locate(2.25)[0].label, path.locate(2.25)[1]
    (3.0, "beam 'b'", 0.75)
    """

    kind: ClassVar[str] = "path"

    name: str
    beams: Takes[Iterable[Beam | tuple[Beam, int]], tuple[Beam, ...]]
    _: KW_ONLY
    closed: bool = False
    directions: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        beams, directions = zip(*self.beams)
        known: set[Beam] = set()
        for beam in beams:
            if beam in known:
                raise SceneError(f"{checks.label(self.kind, self.name)}: {beam.label} appears twice; a path has every beam once"
                                 + ("" if self.closed else ", closed=True leads back to the first"))
            known.add(beam)
        checks.fill(self, beams=beams, directions=directions)

    @cached_property
    def starts(self) -> Array:
        """Arc lengths at which the beams begin, and the length of all, m, [n + 1]."""
        return checks.constant(np.concatenate(([0.0], np.cumsum([beam.length for beam in self.beams]))))

    @property
    def length(self) -> float:
        """Length of all beams, m; once around for a closed path."""
        return float(self.starts[-1])

    @checked(s=as_arc_lengths)
    def places(self, s: ArrayLike) -> tuple[Array, Array]:
        """Return the number of the beam, int [n], and the arc length on it [n], m, at arc lengths s[n] of the path.

        Raises
        ------
        SceneError
            One lies outside an open path.
        """
        slack = 1e-9 * self.length
        outside = (s < -slack) | (s > self.length + slack)
        if outside.any() and not self.closed:
            raise SceneError(f"{self.label}: s={s[outside][0]:.6g} lies outside it (0 to {self.length:.6g} m)")
        s = np.clip(s - self.length * np.floor(s / self.length) if self.closed else s, 0.0, self.length)
        k = np.clip(np.searchsorted(self.starts, s, side="right") - 1, 0, len(self.beams) - 1)
        lengths = np.diff(self.starts)[k]
        local = np.clip(s - self.starts[k], 0.0, lengths)
        return k, np.where(np.array(self.directions)[k] > 0, local, lengths - local)

    @checked(s=Number(unit="m"))
    def locate(self, s: float) -> tuple[Beam, float]:
        """Return the beam at arc length s of the path, and the arc length on the beam, both m: the place of a slider.

        Raises
        ------
        SceneError
            s is no number, or lies outside an open path.
        """
        k, local = self.places(s)
        return self.beams[int(k[0])], float(local[0])

    @checked(s=as_arc_lengths)
    def reference(self, s: ArrayLike) -> tuple[Array, Array]:
        """Return reference positions [n, 3] (m) and triads [n, 3, 3] (rows d1, d2, d3; d1 along the path) at arc lengths s[n].
        On a beam that runs backwards d1 and d2 point against its own.

        Raises
        ------
        SceneError
            An arc length lies outside an open path.
        """
        k, local = self.places(s)
        phi, triads = np.empty((k.size, 3)), np.empty((k.size, 3, 3))
        for i in np.unique(k).tolist():
            at = k == i
            phi[at], triads[at] = self.beams[i].reference(local[at])
            if self.directions[i] < 0:
                triads[at, :2] *= -1.0
        return phi, triads

    @checked(point=Vector)
    def nearest(self, point: ArrayLike) -> tuple[float, float]:
        """Return the arc length of the place on the path nearest to `point` (3,), and its distance, both m.

        Raises
        ------
        SceneError
            The point is not 3 finite numbers.
        """
        return nearest_on(self, point)

    @checked()
    def joints(self) -> list[tuple[NodeRef, NodeRef]]:
        """Return the pairs of nodes where two beams meet: last node of the one and first of the next, in the direction of the
        path."""
        ends = [(b.start, b.end) if d > 0 else (b.end, b.start) for b, d in zip(self.beams, self.directions)]
        return [(one[1], other[0]) for one, other in zip(ends, ends[1:] + (ends[:1] if self.closed else []))]

    def __repr__(self) -> str:
        what = "closed, " if self.closed else ""
        return f"<{self.label}: {what}{self.length:.6g} m, {len(self.beams)} beams>"


def check_path(path: Path, tolerance: float) -> None:
    """Check that the ends of neighbours meet; tolerance in m. Raises SceneError: two do not; names them and their distance."""
    joints = path.joints()
    for k, (one, other) in enumerate(joints):
        here, there = one.place, other.place
        gap = float(np.linalg.norm(here - there))
        if gap <= tolerance:
            continue
        cure = "move one of them, or name the beams in their order"
        beam = other.owner
        far = beam.start if other == beam.end else beam.end
        if np.linalg.norm(beam.reference([beam.node_s[far.index]])[0][0] - here) <= tolerance:
            cure = f"{beam.label} meets it with its other end: reverse its direction ((beam, -1) runs backwards)"
        elif path.closed and k == len(joints) - 1:
            cure = "leave closed=True out, or add the beams that return to the first one"
        raise SceneError(f"{path.label}: {one} and {other} do not meet, their distance is {gap:.6g} m; {cure}")


def legs_of(track: Beam | Path) -> tuple[tuple[Beam, ...], tuple[int, ...]]:
    """Return the beams of a track and their directions; of a beam itself, forward."""
    return (track.beams, track.directions) if isinstance(track, Path) else ((track,), (1,))


def as_track(value: Any) -> Beam | Path:
    """Check of a Beam or Path."""
    if isinstance(value, Path):
        return value
    try:
        return as_beam(value)
    except Refusal as refusal:
        raise Refusal(f"{refusal} (or a Path)") from None
