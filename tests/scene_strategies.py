"""Random scenes as hypothesis strategies: data that is drawn, and `build`, which makes a scene of it, turned and reordered.

All scenes have the same kinds of parts, so that few variants of the kernels are compiled: beams of both strain sets with inner
nodes, a body on a rigid connection, a ball joint on one of its points, one or two sliders; supports and loads where `held`; two
bodies on joints with axes where `jointed`. Paths are drawn by `paths`; springs with laws, bushings, crossings, switches and
rollers by `yards`. `sliding_scenes` and `sliding_paths` draw what a slider has, too: sleeves, friction, drives and stops.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

import fastbeam as fb
from fastbeam.scene.moving_mesh import NEAREST

Array = np.ndarray
Draw = Any


@dataclass(frozen=True)
class Drawn:
    """What was drawn: beams (kind, geometry, section, common), the rest by name; planar scenes lie in the plane z = 0."""

    beams: list[tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]]
    rest: dict[str, Any]
    planar: bool
    held: bool
    # elements of beams with sliders move with them
    moves: bool = False


def number(low: float, high: float) -> Any:
    """One of a thousand numbers between the two, both included."""
    return st.integers(0, 1000).map(lambda k: low + (high - low) * k / 1000)


def power(low: float, high: float) -> Any:
    """Ten to a number."""
    return number(low, high).map(lambda x: float(10.0**x))


@st.composite
def vectors(draw: Draw, size: float, planar: bool) -> Array:
    """Three numbers up to `size`; the third is 0 in planar scenes."""
    x = np.array([draw(number(-size, size)) for _ in range(3)])
    return x * (1.0, 1.0, 0.0) if planar else x


@st.composite
def sections(draw: Draw, planar: bool) -> dict[str, Any]:
    """Stiffnesses over three decades, inertias over three, some coupled (never in a plane, where coupling leads out of it)."""
    out = {name: draw(power(1, 4)) for name in ("EA", "GA2", "GA3", "GJ", "EI2", "EI3")}
    out |= {"rhoA": draw(power(-1, 1)), "rhoI2": draw(power(-3, 0)), "rhoI3": draw(power(-3, 0))}
    if not planar and draw(st.integers(0, 3)) == 0:
        out["coupling"] = draw(st.integers(0, 999))
    return out


@st.composite
def beams(draw: Draw, strain: str, inner: bool, planar: bool) -> tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Straight and perhaps twisted, an arc, or through points; any family and degree. inner: it has inner nodes."""
    family = "lagrange" if inner else draw(st.sampled_from(["lagrange", "bspline"]))
    common: dict[str, Any] = {"elements": draw(st.integers(2, 6)), "interpolation": family, "strain": strain,
                              "degree": draw(st.integers(2, 4) if inner else st.integers(1, 4) if family == "lagrange"
                                             else st.integers(2, 3))}
    if family == "bspline":
        common["directors"] = draw(st.sampled_from(["greville", "control"]))
    start, kind = draw(vectors(2.0, planar)), draw(st.sampled_from(["straight", "arc", "points"]))
    turn = draw(number(-3, 3))
    along = np.array((np.cos(turn), np.sin(turn), 0.0 if planar else draw(number(-0.5, 0.5))))
    along /= np.linalg.norm(along)
    across = np.cross((0.0, 0.0, 1.0), along)
    across /= np.linalg.norm(across)
    if kind == "straight":
        shape: dict[str, Any] = {"start": start, "end": start + draw(number(1, 4)) * along, "d2": across}
        if not planar:
            shape["twist"] = draw(number(-2, 2))
    elif kind == "arc":
        shape = {"start": start, "tangent": along, "normal": across, "radius": draw(number(0.5, 2)),
                 "angle": draw(number(0.3, 3))}
    else:
        # always forward, never back: no cusps
        waves = np.array([[0.0, 0.0, 0.0]] + [[k, draw(number(-0.4, 0.4)), 0.0 if planar else draw(number(-0.4, 0.4))]
                                              for k in (1, 2, 3)])
        shape = {"points": start + waves @ np.array((along, across, np.cross(along, across))), "d2": across}
    return kind, shape, draw(sections(planar)), common


@st.composite
def scenes(draw: Draw, planar: bool = False, held: bool = False, jointed: bool = False) -> Drawn:
    """Two or three beams, a body, joints, one or two sliding masses, a rigid motion; see `Drawn`."""
    parts = [draw(beams("simo_reissner", True, planar)), draw(beams("green_lagrange", True, planar))]
    if draw(st.booleans()):
        parts.append(draw(beams(draw(st.sampled_from(["simo_reissner", "green_lagrange"])), False, planar)))
    spin = np.array((0.0, 0.0, draw(number(-1, 1)))) if planar else draw(vectors(0.7, False))
    rest = {"mass": draw(power(-1, 1)), "offset": draw(vectors(0.3, planar)), "link": draw(st.booleans()),
            "velocity": draw(vectors(0.5, planar)), "spin": spin, "step": draw(power(-2.5, -1.3)),
            "order": draw(st.integers(0, 999)),
            "sliders": [(draw(st.integers(0, 1)), draw(number(0.25, 0.75)), draw(number(-1, 1)), draw(power(-2, 1)),
                         draw(st.sampled_from(["own", "c1"]))) for _ in range(draw(st.integers(1, 2)))]}
    if held:
        rest |= {"gravity": draw(vectors(9.81, planar)), "force": draw(vectors(5.0, planar)), "wind": draw(vectors(1.0, planar))}
    if jointed:
        # turns about the normal and shifts in the plane of a planar scene
        rest["joints"] = {"pinned": draw(st.sampled_from(["revolute", "universal"])), "offset": draw(vectors(0.4, planar)),
                          "sliding": draw(st.sampled_from(["cylindrical", "prismatic"])), "way": draw(vectors(0.4, planar)),
                          "turn": draw(number(-3, 3)), "masses": [draw(power(-1, 1)) for _ in range(2)],
                          "axis": np.array((0.0, 0.0, 1.0)) if planar else draw(vectors(1.0, False)) + (0.0, 0.0, 2.0),
                          "stiffness": draw(power(-1, 2)), "damping": draw(power(-2, 0))}
    return Drawn(parts, rest, planar, held)


def _joints(of: dict[str, Any], body: fb.RigidBody, beam: fb.Beam, rotation: Array) -> list[Any]:
    """A body on a hinge or cross with another, with a spring; one that slides on the end of a beam, with a damper."""
    place = body.position + of["offset"] @ rotation.T
    arm = fb.RigidBody("arm", mass=of["masses"][0], inertia=(0.2, 0.25, 0.3), position=place, directors=rotation.T)
    point, axis = body.point(0.5 * of["offset"]), of["axis"] / np.linalg.norm(of["axis"])
    across = np.array((np.cos(of["turn"]), np.sin(of["turn"]), 0.0))
    across -= (across @ axis) * axis
    if of["pinned"] == "revolute":
        pinned: Any = fb.RevoluteJoint(point, arm.point(-0.5 * of["offset"]), "pinned", axis=rotation @ axis,
                                       stiffness=of["stiffness"], rest=0.3)
    else:
        pinned = fb.UniversalJoint(point, arm.point(-0.5 * of["offset"]), "pinned", axis_a=rotation @ axis,
                                   axis_b=rotation @ across)
    tip = beam.reference(beam.length)[0][0]
    block = fb.RigidBody("block", mass=of["masses"][1], inertia=(0.2, 0.25, 0.3), position=tip + of["way"] @ rotation.T,
                         directors=rotation.T)
    if of["sliding"] == "prismatic":
        sliding: Any = fb.PrismaticJoint(beam.end, block, "sliding", axis=rotation @ across, damping=of["damping"])
    else:
        sliding = fb.CylindricalJoint(beam.end, block, "sliding", axis=rotation @ axis)
    return [arm, block, pinned, sliding]


def section(of: dict[str, Any]) -> fb.Section:
    """The section of drawn numbers."""
    of = dict(of)
    seed = of.pop("coupling", None)
    if seed is None:
        return fb.Section(**of)
    a = np.random.default_rng(seed).standard_normal((6, 6))
    return fb.Section.from_matrix((a @ a.T + 6.0 * np.eye(6)) * of["EI2"], rhoA=of["rhoA"], rhoI2=of["rhoI2"], rhoI3=of["rhoI3"])


# --- what sliders have ---------------------------------------------------------------------------------------------------
@st.composite
def sliding(draw: Draw, kinds: Any = ("sleeve", "point")) -> dict[str, Any]:
    """What a slider has: its kind, friction, a drive, stops near its place; lengths are shares of that of what it slides on."""
    kind = draw(st.sampled_from(kinds))
    friction = draw(st.sampled_from(["coulomb", "coulomb", "viscous", "none"]))
    drive = draw(st.sampled_from(["none", "none", "position", "speed", "force", "controller"]))
    # a prescribed motion does not end at a rigid stop
    stops = draw(st.sampled_from(["none", "elastic"] + ["rigid"] * (drive not in ("position", "speed"))))
    out = {"kind": kind, "friction": friction, "drive": drive, "stops": stops, "coefficient": draw(number(0.05, 0.8)),
           "viscous": draw(power(-1, 1)), "way": draw(number(-0.1, 0.1)), "rhythm": draw(number(2, 12)),
           "force": draw(number(-5, 5)), "gains": (draw(power(0, 3)), draw(power(-1, 1))),
           "before": draw(number(0.002, 0.15)), "behind": draw(number(0.002, 0.15)), "stiffness": draw(power(1, 4)),
           "restitution": draw(number(0, 1))}
    if kind == "sleeve":
        # friction of a bore needs its length
        out |= {"bore": draw(st.sampled_from([None, 0.0, 0.1, 0.25] if friction != "coulomb" else [0.05, 0.1, 0.25])),
                "keyed": draw(st.booleans()), "inertia": draw(power(-2, 0))}
    return out


def rubs(of: dict[str, Any]) -> bool:
    """Whether it has friction."""
    return of["friction"] != "none"


def _drive(of: dict[str, Any], at: float, length: float) -> fb.Drive | None:
    """The drive of a slider that begins at `at`."""
    way, rhythm, force = of["way"] * length, of["rhythm"], of["force"]
    if of["drive"] == "position":
        return fb.Drive(position=lambda t: at + way * np.sin(rhythm * t))
    if of["drive"] == "speed":
        return fb.Drive(speed=lambda t: way * rhythm * np.cos(rhythm * t))
    if of["drive"] == "force":
        return fb.Drive(force=lambda t: force * np.cos(rhythm * t))
    if of["drive"] == "controller":
        return fb.Drive(position=at + way, stiffness=of["gains"][0], damping=of["gains"][1], limit=2.0 * abs(force) + 0.1)
    return None


def forces_of(of: dict[str, Any], at: float, length: float, rate: float | None) -> dict[str, Any]:
    """Arguments of a slider for what was drawn, at an arc length of what has this length."""
    friction = {"coulomb": fb.Friction(of["coefficient"]), "viscous": fb.Friction(viscous=of["viscous"]), "none": None}
    out: dict[str, Any] = {"friction": friction[of["friction"]], "drive": _drive(of, at, length), "at": at}
    out["rate"] = None if of["drive"] in ("position", "speed") else rate
    if of["stops"] != "none":
        gives = {"stiffness": of["stiffness"]} if of["stops"] == "elastic" else {"restitution": of["restitution"]}
        out["stops"] = fb.Stops(at - of["before"] * length, at + of["behind"] * length, **gives)
    return out


def _slider(name: str, of: dict[str, Any], beam: fb.Beam, mass: float, rotation: Array, **forces: Any) -> list[Any]:
    """A mass in a point contact, or a body in a sleeve."""
    if of["kind"] == "point":
        bead = fb.PointMass(f"mass of {name}", mass=mass)
        return [bead, fb.Slider(name, bead, beam, **forces)]
    body = fb.RigidBody(f"holder of {name}", mass=mass, inertia=of["inertia"] * np.array((0.7, 0.8, 1.0)),
                        position=beam.reference(forces["at"])[0][0], directors=rotation.T)
    bore = of["bore"] if of["bore"] is None else of["bore"] * beam.length
    return [body, fb.Sleeve(name, body, beam, length=bore, keyed=of["keyed"], **forces)]


@st.composite
def sliding_scenes(draw: Draw, planar: bool = False, held: bool = False, kinds: Any = ("sleeve", "point")) -> Drawn:
    """Scenes with what their sliders have. The first one is of the first kind and has friction: as many terms in every scene."""
    drawn = draw(scenes(planar, held))
    ways = [draw(sliding(kinds[:1]).filter(rubs)), *(draw(sliding(kinds)) for _ in drawn.rest["sliders"][1:])]
    return Drawn(drawn.beams, drawn.rest | {"sliding": ways}, planar, held)


@st.composite
def moving_scenes(draw: Draw, held: bool = False) -> Drawn:
    """Scenes whose beams with sliders have elements that move, with what these know: straight beams and arcs, no bores but for
    friction, which a straight beam has."""
    drawn = draw(sliding_scenes(held=held))
    made, ways = list(drawn.beams), [dict(of) for of in drawn.rest["sliding"]]
    # an element fits between contacts
    places = sorted((on, share) for on, share, *_ in drawn.rest["sliders"])
    assume(all(a != b or y - x > NEAREST for (a, x), (b, y) in zip(places[:-1], places[1:])))
    for (on, *_), of in zip(drawn.rest["sliders"], ways):
        kind, shape, section, common = made[on]
        is_bore = of["kind"] == "sleeve" and of["friction"] == "coulomb"
        if kind == "points" or is_bore and kind == "arc":
            start, end = (shape["points"][0], shape["points"][-1]) if kind == "points" else (
                shape["start"], shape["start"] + shape["radius"] * shape["tangent"])
            kind, shape = "straight", {"start": start, "end": end, "d2": shape.get("d2", shape.get("normal"))}
            shape["d2"] = np.cross(np.cross(end - start, shape["d2"]), end - start)
        made[on] = kind, shape, section, common | {"strain": "simo_reissner"}
        if of["kind"] == "sleeve" and not is_bore:
            of["bore"] = 0.0
        if of["friction"] == "coulomb" and of["drive"] in ("position", "speed"):
            of["drive"] = "controller"
    return Drawn(made, drawn.rest | {"sliding": ways}, False, held, True)


def build(drawn: Drawn, rotation: Array = np.eye(3), order: Any = None, shift: Array = np.zeros(3)) -> fb.Scene:
    """The scene, turned by a rotation matrix, then shifted; order: a function that permutes a list in place."""
    rest = drawn.rest
    made: list[fb.Beam] = []
    turned = {"start", "end", "d2", "tangent", "normal", "points"}
    makers = {"straight": fb.Beam.straight, "arc": fb.Beam.arc, "points": fb.Beam.through_points}
    for k, (kind, shape, of, common) in enumerate(drawn.beams):
        shape = {name: value @ rotation.T if name in turned else value for name, value in shape.items()}
        shape |= {name: shape[name] + shift for name in ("start", "end", "points") if name in shape}
        if kind != "points":
            positions = (shape.pop("start"), shape.pop("end") if kind == "straight" else shape.pop("tangent"))
            positions += () if kind == "straight" else (shape.pop("normal"),)
        else:
            positions = (shape.pop("points"),)
        made.append(makers[kind](f"beam {k}", *positions, section=section(of), **shape, **common))
    tip = made[0].reference(made[0].length)[0][0]
    body = fb.RigidBody("body", mass=rest["mass"], inertia=(1.0, 1.3, 1.6), position=tip + rest["offset"] @ rotation.T,
                        directors=rotation.T)
    hinge = body.point((made[1].reference(0.0)[0][0] - body.position) @ rotation)
    parts: list[Any] = [*made, body, fb.RigidConnection(made[0].end, body), fb.BallJoint(made[1].start, hinge)]
    if "joints" in rest:
        parts += _joints(rest["joints"], body, made[1], rotation)
    if len(made) > 2 and rest["link"]:
        parts.append(fb.RigidConnection(made[1].end, made[2].start))
    for k, (on, share, rate, mass, curve) in enumerate(rest["sliders"]):
        at, rate = made[on].length * share, 0.0 if drawn.held else rate
        if "sliding" in rest:
            of = rest["sliding"][k]
            parts += _slider(f"slider {k}", of, made[on], mass, rotation, curve=curve,
                             **forces_of(of, at, made[on].length, rate))
            continue
        bead = fb.PointMass(f"mass {k}", mass=mass)
        parts += [bead, fb.Slider(f"slider {k}", bead, made[on], at=at, rate=rate, curve=curve)]
    options: dict[str, Any] = {}
    if drawn.held:
        parts += [fb.Clamp(made[0].start), fb.Load("load", made[1].end, force=rest["force"] @ rotation.T),
                  fb.Load("beat", made[1].end, force=rest["force"] @ rotation.T, time=_beat)]
        parts += [] if drawn.moves else [fb.DistributedLoad("wind", made[0], force=rest["wind"] @ rotation.T)]
        options["gravity"] = rest["gravity"] @ rotation.T
    else:
        parts.append(fb.RigidMotion(velocity=rest["velocity"] @ rotation.T, spin=rest["spin"] @ rotation.T, about=shift))
    if order is not None:
        order(parts)
    scene = fb.Scene(*parts, project_velocities=True, **options)
    return fb.with_moving_meshes(scene) if drawn.moves else scene


def _beat(t: float) -> float:
    return float(np.sin(7.0 * t))


# --- paths ---------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class DrawnPath:
    """A free path: arcs of a circle where it is closed, else pieces with kinks; what every beam is made of, and the sliders."""

    closed: bool
    planar: bool
    pieces: list[dict[str, Any]]
    sliders: list[tuple[float, float, float, str]]
    motion: tuple[Array, Array]
    step: float
    # what the sliders have; empty: nothing
    ways: tuple[dict[str, Any], ...] = ()


@st.composite
def paths(draw: Draw, planar: bool = False) -> DrawnPath:
    """One to four beams of any family and degree, in any direction, joined rigidly or by ball joints."""
    closed = draw(st.booleans())
    pieces = []
    for _ in range(draw(st.integers(1 if closed else 2, 4))):
        family = draw(st.sampled_from(["lagrange", "lagrange", "bspline"]))
        mesh = {"elements": draw(st.integers(2, 4)), "degree": draw(st.integers(2, 4 if family == "lagrange" else 3))}
        pieces.append({"length": draw(number(0.5, 2)), "turn": draw(number(-0.6, 0.6)),
                       "lift": 0.0 if planar else draw(number(-0.4, 0.4)), "backward": draw(st.booleans()),
                       "joint": draw(st.sampled_from([fb.RigidConnection, fb.RigidConnection, fb.BallJoint])),
                       "straight on": draw(st.booleans()), "section": draw(sections(planar)),
                       "common": {**mesh, "interpolation": family}})
    sliders = [(draw(number(0.2, 0.8)), draw(number(-6, 6)), draw(power(-2, 0)), draw(st.sampled_from(["own", "c1"])))
               for _ in range(draw(st.integers(1, 2)))]
    spin = np.array((0.0, 0.0, draw(number(-1, 1)))) if planar else draw(vectors(0.7, False))
    return DrawnPath(closed, planar, pieces, sliders, (draw(vectors(0.5, planar)), spin), draw(power(-2.7, -1.7)))


@st.composite
def sliding_paths(draw: Draw, planar: bool = False) -> DrawnPath:
    """Paths with what their sliders have; the first one has friction."""
    drawn = draw(paths(planar))
    ways = [draw(sliding(("point",)).filter(rubs)), *(draw(sliding(("point",))) for _ in drawn.sliders[1:])]
    return replace(drawn, ways=tuple(ways))


def build_path(drawn: DrawnPath) -> fb.Scene:
    """The scene of a drawn path."""
    total = sum(piece["length"] for piece in drawn.pieces)
    at, along, angle = np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.0
    beams = []
    for k, piece in enumerate(drawn.pieces):
        common = {"section": section(piece["section"]), **piece["common"]}
        if drawn.closed:
            turn = 2.0 * np.pi * piece["length"] / total
            low, high = (angle + turn, angle) if piece["backward"] else (angle, angle + turn)
            out, sign = np.array([np.cos(low), np.sin(low), 0.0]), -1.0 if piece["backward"] else 1.0
            tangent = (-sign * out[1], sign * out[0], 0.0)
            beams.append(fb.Beam.arc(f"beam {k}", out, tangent, -out, radius=1.0, angle=turn, **common))
            angle += turn
            continue
        if k and not piece["straight on"]:
            a, b = piece["turn"], piece["lift"]
            along = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]]) @ along
            along = (along + np.array([0.0, 0.0, b])) / np.linalg.norm(along + np.array([0.0, 0.0, b]))
        end = at + piece["length"] * along
        d2 = np.cross((0.0, 0.0, 1.0), along)
        beams.append(fb.Beam.straight(f"beam {k}", *((end, at) if piece["backward"] else (at, end)), d2=d2, **common))
        at = end
    path = fb.Path("path", [(b, -1 if piece["backward"] else 1) for b, piece in zip(beams, drawn.pieces)], closed=drawn.closed)
    parts: list[Any] = [*beams]
    for k, (a, b) in enumerate(path.joints()):
        # a ball joint that closes a loop of one beam would join it to itself alone
        kind = fb.RigidConnection if len(beams) < 3 and drawn.closed else drawn.pieces[k]["joint"]
        parts.append(kind(a, b))
    for k, (share, rate, mass, curve) in enumerate(drawn.sliders):
        bead, at = fb.PointMass(f"mass {k}", mass=mass), path.length * share
        forces = forces_of(drawn.ways[k], at, path.length, rate) if drawn.ways else {"at": at, "rate": rate}
        parts += [bead, fb.Slider(f"slider {k}", bead, on=path, curve=curve, **forces)]
    return fb.Scene(*parts, fb.RigidMotion(velocity=drawn.motion[0], spin=drawn.motion[1]), project_velocities=True)


# --- links, crossings, switches, rollers ---------------------------------------------------------------------------------
@dataclass(frozen=True)
class DrawnYard:
    """A track that forks, a beam across it, a body on springs and a bushing behind it, a roller at its start, and sliders."""

    sections: list[dict[str, Any]]
    mesh: list[dict[str, Any]]
    rest: dict[str, Any]
    step: float


@st.composite
def yards(draw: Draw) -> DrawnYard:
    """Always the same kinds of parts: springs of a table and with a damper that only pull, a bushing, a crossing, a switch."""
    rest = {"fork": draw(number(0.3, 0.9)), "lift": draw(number(-0.3, 0.3)), "cross": draw(number(0.3, 0.7)),
            "tilt": draw(number(-0.5, 0.5)), "choice": draw(st.sampled_from(["left", "right"])),
            "friction": draw(st.sampled_from([0.0, 0.2])), "axes": draw(st.sampled_from(["x", "yz", "xz", "z"])),
            "slack": draw(number(0.8, 1.2)), "rate": draw(number(2.0, 6.0)), "left": draw(number(0.01, 0.1)),
            "mass": draw(power(-1, 0)), "body": draw(power(-1, 1)), "spline": draw(st.booleans()),
            "table": np.cumsum([0.0] + [draw(number(0.5, 3.0)) for _ in range(4)]),
            "elastic": [draw(power(0, 3)) for _ in range(6)], "damping": [draw(power(-2, 1)) for _ in range(6)],
            "coupled": draw(st.integers(0, 999)), "velocity": draw(vectors(0.5, False)), "spin": draw(vectors(0.5, False)),
            "order": draw(st.integers(0, 999)), "gravity": draw(vectors(9.81, False))}
    mesh = [{"elements": draw(st.integers(2, 4)), "degree": draw(st.integers(2, 3))} for _ in range(4)]
    return DrawnYard([draw(sections(False)) for _ in range(4)], mesh, rest, draw(power(-3, -2)))


def build_yard(drawn: DrawnYard, order: Any = None) -> fb.Scene:
    """The scene of what was drawn; order: a function that permutes a list in place."""
    rest = drawn.rest
    made = [dict(section=section(of), **mesh) for of, mesh in zip(drawn.sections, drawn.mesh)]
    stem = fb.Beam.straight("stem", (0, 0, 0), (2, 0, 0), **made[0])
    # without a corner, where a car would be hit
    up = np.array((0.0, np.cos(rest["lift"]), np.sin(rest["lift"])))
    left = fb.Beam.arc("left", (2, 0, 0), (1, 0, 0), up, radius=1.5, angle=rest["fork"], **made[1])
    right = fb.Beam.arc("right", (2, 0, 0), (1, 0, 0), (0, -1, 0), radius=1.5, angle=rest["fork"], **made[2])
    x = 2.0 * rest["cross"]
    over = fb.Beam.straight("over", (x - rest["tilt"], -1, -0.2), (x + rest["tilt"], 1, 0.2), **made[3])
    bead = fb.PointMass("bead", mass=rest["mass"])
    body = fb.RigidBody("body", mass=rest["body"], inertia=np.array((0.2, 0.3, 0.4)) * rest["body"], position=(4.0, 1.0, 0.5))
    fork = fb.Switch("fork", [stem, left, right], choose={"car": rest["choice"]})
    a = np.random.default_rng(rest["coupled"]).standard_normal((6, 6))
    stiffness = np.diag(rest["elastic"]) + 0.1 * min(rest["elastic"]) * a @ a.T
    ends = np.array([-0.4, -0.1, 0.0, 0.3, 0.8])
    parts: list[Any] = [
        stem, left, right, over, bead, body, fb.RigidConnection(stem.end, left.start), fb.RigidConnection(stem.end, right.start),
        fb.Crossing("cross", stem, over, at=(x, 0.5 * over.length)), fb.Pin(stem.start, axes=rest["axes"]),
        fb.Slider("car", bead, on=fork, at=2.0 - rest["left"], rate=rest["rate"], friction=rest["friction"]),
        fb.Spring(left.end, body, "law", table=(ends, rest["table"] - rest["table"][2]),
                  interpolation="spline" if rest["spline"] else "linear"),
        fb.Spring(right.end, body, "rope", stiffness=50.0, damping=1.0, tension_only=True,
                  length=rest["slack"] * float(np.linalg.norm((0.5, 1.0 + rest["fork"], 0.5)))),
        fb.Bushing(over.end, body, "mount", stiffness=stiffness, damping=rest["damping"]),
        fb.RigidMotion(velocity=rest["velocity"], spin=rest["spin"])]
    if order is not None:
        order(parts)
    return fb.Scene(*parts, project_velocities=True, gravity=rest["gravity"])
