"""Switches: several tracks for sliders, which at the end of one go on to another."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from fastbeam.interface.arguments import Name, Number, Refusal, Vector, Word, checked, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import known
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef, as_arc_lengths
from fastbeam.scene.checks import Array
from fastbeam.scene.paths import Path, as_beam, legs_of
from fastbeam.scene.slider_forces import needed_arguments

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fastbeam.kernels.state import State
    from fastbeam.scene.locks import Lock, Release
    from fastbeam.scene.slider_forces import Stops
    from fastbeam.scene.sliders import Slider

Track = Beam | Path
# a function that names the next track, and its alternatives
Choosing = Callable[[float, "State"], Track | str] | Callable[[float, "State", str], Track | str]
ChooseLike = (Choosing | Mapping[str, Track | str] | Mapping["Slider", Track | str] | Sequence[tuple[float, Track | str]])
Chosen = Choosing | dict[str, str] | list[tuple[float, str]]
START, END = "start", "end"
# ends of tracks that meet lie so close together, as a share of the length of all
MEET = 1e-9
# stops within this share of a track of its end stand there
AT_END = 1e-12


def as_tracks(value: Any) -> tuple[Track, ...]:
    """Check of beams and open paths, at least two or one that leads into itself."""
    if isinstance(value, (Beam, Path, str, bytes, type, np.ndarray)) or not isinstance(value, Iterable):
        raise Refusal(f"must be a list of beams and paths, got {shown(value)}")
    items = tuple(x if isinstance(x, Path) else as_beam(x) for x in value)
    if not items:
        raise Refusal("is empty; name the beams and paths that sliders may run on")
    for x in items:
        if isinstance(x, Switch):
            raise Refusal(f"holds {x.label}; give its tracks instead")
        if isinstance(x, Path) and x.closed:
            raise Refusal(f"contains {x.label}, which is closed and so has no end where a slider could leave it; open it at "
                          "the switch (closed=False): its end then leads into its start")
    names = [x.name for x in items]
    if len(set(names)) < len(names):
        raise Refusal("contains two tracks of the same name, which choose cannot distinguish")
    return items


def as_one_track(value: Any) -> Track | str:
    """Check of a Beam, a Path or the name of one."""
    if not isinstance(value, (Beam, Path, str)):
        raise Refusal(f"must be one of the tracks or its name, got {shown(value)}")
    return value


def as_choice(value: Any) -> Any:
    """Check of a function of (t, state) or (t, state, slider), a mapping slider -> track, or a list of (time, track)."""
    if isinstance(value, Mapping):
        return {_name_of(k): _name_of(x) for k, x in value.items()}
    if callable(value) and not isinstance(value, type):
        n = needed_arguments(value)
        if n not in (2, 3):
            raise Refusal(f"must take two arguments (t, state) or three (t, state, slider), this function takes {n}")
        return value
    if isinstance(value, (str, bytes, type, np.ndarray)) or not isinstance(value, Iterable):
        raise Refusal("must be a function of (t, state), a mapping {slider: track} or a list [(time, track), ...], got "
                      f"{shown(value)}")
    table, latest = [], -np.inf
    for item in value:
        pair = tuple(item) if isinstance(item, (tuple, list)) else ()
        time = real(pair[0]) if len(pair) == 2 else None
        if time is None or not time > latest:
            raise Refusal(f"as a list has pairs (time, track) with growing times, got {shown(item)}")
        table.append((time, _name_of(pair[1])))
        latest = time
    if not table:
        raise Refusal("is empty; give pairs (time, track)")
    return table


def _name_of(value: Any) -> str:
    name = value if isinstance(value, str) else getattr(value, "name", None)
    if not isinstance(name, str):
        raise Refusal(f"names sliders and tracks, got {shown(value)}")
    return name


class Switch(Path):
    """Tracks for sliders, which at the end of one go on to another that begins there: junctions, sidings, turnouts.

    A slider that reaches the end of its track goes on to one that begins at this place, and one that comes back to the start of
    its track to one that ends there. Where there are several, `choose` decides; where there is none the run ends as at the end of
    any beam. The step ends at this moment, to round-off; nothing jumps but the name of the place (theory.md 5.11). Ends that meet
    have to be joined, as beams of a path are. A switch is no part of a scene; its sliders name it,
    `Slider(name, point, on=switch, at=s)`.

    Arc lengths: s of a slider counts along its track from `offset(track)` on, which is 0 for the first; `where(s)` tells the
    track and the arc length on it. Stops, locks and drives by place count along the way instead, which begins with `at` of the
    slider and goes on from track to track, or name a track, (track, s).

    Parameters
    ----------
    name : str
    tracks : sequence of Beam and Path
        Open paths. A loop is a path whose last beam leads into the first: its end meets its start.
    choose : callable, mapping or list, optional
        Function of (t, state) or (t, state, slider) that returns the name of a track (slider: name of the slider); names of
        tracks by name of the slider, {slider: track}; or a timetable [(time, track), ...], each from its time on. A mapping or a
        timetable that names none of those that begin there leads the slider to the first of them.

    Raises
    ------
    SceneError
        An argument is of the wrong kind, or several tracks meet and there is no `choose`.

    Examples
    --------
    >>> from fastbeam.scene import Beam, Path, Section, Switch
    >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
    >>> a = Beam.straight('a', (0, 0, 0), (2, 0, 0), section=bar, elements=2)
    >>> b = Beam.straight('b', (2, 0, 0), (4, 0, 0), section=bar, elements=2)
    >>> c = Beam.straight('c', (2, 0, 0), (4, 1, 0), section=bar, elements=2)
    >>> switch = Switch('points', [a, b, c], choose=[(0.0, 'b'), (5.0, 'c')])
    >>> switch.options(a, 'end')
    ('b', 'c')
    >>> track, s = switch.where(switch.offset(b) + 0.5)
    >>> track.name, s
    ('b', 0.5)
    """

    kind: ClassVar[str] = "switch"
    closed: bool = False
    tracks: tuple[Track, ...]
    choose: Chosen | None

    @checked(name=Name(), tracks=as_tracks, choose=as_choice)
    def __init__(self, name: str, tracks: Iterable[Track], *, choose: ChooseLike | None = None) -> None:
        beams, signs = zip(*map(legs_of, tracks))
        checks.fill(self, name=name, tracks=tracks, choose=choose, beams=sum(beams, ()), directions=sum(signs, ()))
        for track in tracks:
            for end in (START, END):
                options = self.options(track, end)
                if len(options) > 1 and choose is None:
                    raise SceneError(f"{self.label}: several tracks follow the {end} of {track.label}, {', '.join(options)}; "
                                     "select one with choose=")
        names = sorted({x.name for x in tracks})
        named = choose.values() if isinstance(choose, dict) else [x for _, x in choose] if isinstance(choose, list) else ()
        for one in named:
            if one not in names:
                raise SceneError(f"{self.label}: choose names {one!r}, its tracks are {known(names, one)}")

    @cached_property
    def gap(self) -> float:
        """Unused arc length behind each track and before each, m, for steps that lead too far."""
        return max(track.length for track in self.tracks)

    @cached_property
    def spans(self) -> Array:
        """Arc lengths at which each track begins and ends, m, [n, 2]."""
        lengths = np.array([track.length for track in self.tracks])
        begin = np.concatenate(([0.0], np.cumsum(lengths[:-1] + 2.0 * self.gap)))
        return checks.constant(np.stack((begin, begin + lengths), axis=1))

    @property
    def length(self) -> float:
        """Length of the longest track, m."""
        return self.gap

    @checked(track=as_one_track)
    def offset(self, track: Track | str) -> float:
        """Return the arc length of the switch at which a track begins, m.

        Raises
        ------
        SceneError
            It is none of its tracks.
        """
        return float(self.spans[self._number(track), 0])

    @checked(s=Number(unit="m"))
    def where(self, s: float) -> tuple[Track, float]:
        """Return the track at arc length s of the switch, and the arc length on it, both m: the place of a slider."""
        k = span_of(self, s)
        begin, end = self.spans[k]
        return self.tracks[k], float(np.clip(s, begin, end) - begin)

    @checked(track=as_one_track, end=Word((START, END)))
    def options(self, track: Track | str, end: str) -> tuple[str, ...]:
        """Return the names of the tracks on which a slider may go on from the end ('end') or 'start' of a track.

        Raises
        ------
        SceneError
            It is none of its tracks.
        """
        k = self._number(track)
        here, others = self._ends[k, int(end == END)], self._ends[:, int(end != END)]
        close = np.linalg.norm(others - here, axis=1) <= MEET * float(np.sum(np.diff(self.spans)))
        return tuple(self.tracks[j].name for j in np.flatnonzero(close))

    def _number(self, track: Track | str) -> int:
        for k, x in enumerate(self.tracks):
            if x is track or x.name == track:
                return k
        raise SceneError(f"{self.label}: {shown(track)} is not one of its tracks, {', '.join((x.name for x in self.tracks))}")

    @checked()
    def joints(self) -> list[tuple[NodeRef, NodeRef]]:
        """Return the pairs of nodes where tracks meet: the end of one and the start of another."""
        return [(end_node(track, END), end_node(other, START)) for track in self.tracks for other in self.tracks
                if other.name in self.options(track, END)]

    @cached_property
    def _ends(self) -> Array:
        """Places of the start and end of every track at t = 0, [n, 2, 3]."""
        return np.array([track.reference([0.0, track.length])[0] for track in self.tracks])

    @checked(s=as_arc_lengths)
    def places(self, s: ArrayLike) -> tuple[Array, Array]:
        """Return number of the beam and arc length on it, as `Path.places`; between tracks those of the nearest end."""
        number, local = np.zeros(s.size, np.int64), np.zeros(s.size)
        before = np.cumsum([0, *(len(legs_of(x)[0]) for x in self.tracks)])
        for i, one in enumerate(s.tolist()):
            k = span_of(self, one)
            track, at = self.tracks[k], float(np.clip(one - self.spans[k, 0], 0.0, np.diff(self.spans[k])[0]))
            inside = track.places([at]) if isinstance(track, Path) else (np.zeros(1, np.int64), np.array([at]))
            number[i], local[i] = before[k] + inside[0][0], inside[1][0]
        return number, local

    @checked(point=Vector)
    def nearest(self, point: ArrayLike) -> tuple[float, float]:
        """Return arc length and distance of the nearest place, as `Path.nearest`, on the nearest of the tracks."""
        found = [track.nearest(point) for track in self.tracks]
        k = int(np.argmin([distance for _, distance in found]))
        return float(self.spans[k, 0]) + found[k][0], found[k][1]

    def __repr__(self) -> str:
        return f"<{self.label}: {', '.join(x.name for x in self.tracks)}>"


def span_of(switch: Switch, s: float) -> int:
    """Return the number of the track at arc length s, the nearest."""
    off = np.maximum(np.maximum(switch.spans[:, 0] - s, s - switch.spans[:, 1]), 0.0)
    return int(np.argmin(off))


class Arrival(NamedTuple):
    """Way by which a slider came to its place on a switch."""

    offset: float = 0.0     # arc length travelled less s, m
    came_by: float = 0.0    # -1 or 1 where it came onto its track by the end or the start, 0 where it began


def place_at(switch: Switch, at: float | tuple[str, float], track: int, offset: float) -> float | None:
    """Return the arc length of the switch of a place: one of the way, or on a track; None if that is not the one of this
    number."""
    if not isinstance(at, tuple):
        return at - offset
    return float(switch.spans[track, 0]) + at[1] if switch.tracks[track].name == at[0] else None


def stops_on(switch: Switch, stops: Stops, track: int, by: Arrival) -> tuple[float, float]:
    """Return the arc lengths of the switch between which stops leave a slider that came onto a track like this; infinite where
    there are none. A wall on a track also stops sliders that come from behind it."""
    low, high = (None if at is None else place_at(switch, at, track, by.offset) for at in (stops.start, stops.end))
    begin, end = switch.spans[track]
    slack = AT_END * float(end - begin)
    if by.came_by > 0.0 and isinstance(stops.start, tuple) and low is not None and low > begin + slack:
        low, high = None, low
    elif by.came_by < 0.0 and isinstance(stops.end, tuple) and high is not None and high < end - slack:
        low, high = high, None
    return -np.inf if low is None else low, np.inf if high is None else high


def check_places(who: str, switch: Switch, at: float, stops: Stops | None, locks: Sequence[Lock],
                 release: Release | None) -> None:
    """Check stops, locks and a release of a slider that starts at arc length `at` of a switch. Raises SceneError: a place lies on
    none of its tracks, stops exclude the start, or no track has an end to leave it."""
    places = [(f"stops: {x}", getattr(stops, x, None)) for x in (START, END)]
    for what, place in (*places, *(("lock: at", x.at) for x in locks)):
        if isinstance(place, tuple):
            track = next((x for x in switch.tracks if x.name == place[0]), None)
            if track is None:
                raise SceneError(f"{who}: {what}: {place[0]!r} is not one of the tracks of {switch.label}, "
                                 f"{', '.join((x.name for x in switch.tracks))}")
            if not 0.0 <= place[1] <= track.length:
                raise SceneError(f"{who}: {what}={place[1]:.6g} m lies beyond {track.label} (0 to {track.length:.6g} m)")
    if stops is not None:
        low, high = stops_on(switch, stops, span_of(switch, at), Arrival())
        if not low <= at <= high:
            raise SceneError(f"{who}: stops from {low:.6g} to {high:.6g} m of {switch.label} must enclose its place at={at:.6g} "
                             "m; start between them")
    if release is not None and isinstance(release.when, str) and all(
            switch.options(x, release.when) for x in switch.tracks):
        raise SceneError(f"{who}: release: another track follows the {release.when} of every track of {switch.label}, so it is "
                         "no end; give a time or a condition")


def chosen(switch: Switch, options: tuple[str, ...], t: float, state: State, slider: str) -> str:
    """Return the track, of some, on which a slider goes on. Raises SceneError: a function fails, or returns none of them."""
    choose = switch.choose
    if len(options) == 1:
        return options[0]
    if isinstance(choose, dict):
        found = choose.get(slider)
    elif isinstance(choose, list):
        found = next((name for time, name in reversed(choose) if time <= t), None)
    else:
        given = (t, state, slider)[:2 if needed_arguments(choose) == 2 else 3]
        found = checks.called(switch.label, "choose", choose, *given, where="at t = {:.6g} s")
        found = found if isinstance(found, str) else getattr(found, "name", found)
        if found not in options:
            raise SceneError(f"{switch.label}: choose must return one of {', '.join(map(repr, options))}, but returns "
                             f"{shown(found)} at t = {t:.6g} s for slider {slider!r}")
    return found if found in options else options[0]


def end_node(track: Track, end: str) -> NodeRef:
    """Return the node at the end or start of a track."""
    at_end = end == END
    beam, sign = (x[-1 if at_end else 0] for x in legs_of(track))
    return beam.end if at_end == (sign > 0) else beam.start
