"""Small cases for perf/suite/same_bits.py: every feature hung on one arch, and every analysis of some scenes; public names alone.

A feature is a function that adds parts to an arch; it is run, and brought to rest where it can be. An analysis is a function that
returns what it found. `found_in` turns anything found into hashes of its numbers. Scenes are alike: they share machine code.
"""
from __future__ import annotations

import hashlib
import math
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import fastbeam as fb

warnings.filterwarnings("ignore")
Hashes = dict[str, str]
RISE = 0.15
STEP = 1e-3
STEPS = 20
SEEN = ("energy", "momentum", "slider", "joint", "spring", "velocity", "spin", "orientation", "acceleration", "section",
        "reaction")
# of a result: what a clock or the machine says
NOT_BITS = ("wall_time", "time", "seconds", "threads", "memory", "version", "versions", "checkpoint")
CASES: dict[str, Callable[[], Any]] = {}


# --- hashes of what was found ----------------------------------------------------------------------------------------------
def found_in(found: Any) -> Hashes:
    """Names of numbers to hashes of their bits; names of one level below a result stand together."""
    parts: dict[str, Any] = {}
    for path, data in _numbers(found, ()):
        name = "/".join(path[:2])
        parts.setdefault(name, hashlib.sha256()).update("/".join(path).encode() + data)
    return {name: digest.hexdigest()[:12] for name, digest in sorted(parts.items())}


def _numbers(thing: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], bytes]]:
    if isinstance(thing, (bool, int, float, complex, np.number, np.bool_)):
        yield path, repr(complex(thing)).encode()
    elif isinstance(thing, np.ndarray):
        if thing.dtype.kind in "biufc":
            yield path, f"{thing.dtype}{thing.shape}".encode() + thing.tobytes()
    elif isinstance(thing, fb.Result):
        held = ("t", "series", "t_snap", "phi", "directors", "velocities", "spins", "info", "state")
        yield from _numbers({name: getattr(thing, name, None) for name in held}, path)
        for k, event in enumerate(thing.events):
            yield (*path, "events", str(k)), str(event.get("kind")).encode()
            yield from _numbers(event, (*path, "events", str(k)))
    elif isinstance(thing, Mapping):
        for name, value in sorted((str(name), value) for name, value in thing.items()):
            if name not in NOT_BITS:
                yield from _numbers(value, (*path, name))
    elif hasattr(thing, "_fields"):
        yield from _numbers(thing._asdict(), path)
    elif isinstance(thing, (list, tuple)):
        for k, value in enumerate(thing):
            yield from _numbers(value, (*path, str(k)))
    elif hasattr(thing, "__dict__") and len(path) < 3:
        yield from _numbers({name: value for name, value in vars(thing).items() if name[0] != "_"
                             and isinstance(value, (np.ndarray, list, tuple, dict, float, int, complex))}, path)


# --- the arch that features hang on ----------------------------------------------------------------------------------------
def section(k: float = 1.0, damping: float = 0.0) -> fb.Section:
    """Soft in bending, of one metre and a kilogram or so."""
    return fb.Section(EA=1e4 * k, GA2=4e3 * k, GA3=4e3 * k, GJ=2 * k, EI2=k, EI3=4 * k, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5,
                      damping=damping)


@dataclass
class Arch:
    """A shallow arch of two beams between two clamps, with a force on its apex that pushes it a little to the side, too.

    Attributes
    ----------
    k, h : float
        Factors of stiffness and height, for derivatives.
    beams : dict
        Options of its beams.
    at_time : float or None
        When an equilibrium is sought.
    push, side : float
        Horizontal forces on the apex, N.
    """

    k: float = 1.0
    h: float = 1.0
    beams: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    at_time: float | None = None
    push: float = 0.3
    side: float = 0.05

    def __post_init__(self) -> None:
        self.rise = RISE * self.h
        more = {"elements": 2, "section": section(self.k), **self.beams}
        arc = more.pop("arc", False)
        self.top = np.array((0.0, 0.0, self.rise))
        if arc:
            angle, radius = math.asin(2 * self.rise / (1 + self.rise**2)), (1 + self.rise**2) / (2 * self.rise)
            c, s = math.cos(angle), math.sin(angle)
            self.left = fb.Beam.arc("left", (-1, 0, 0), (c, 0, s), (s, 0, -c), radius=radius, angle=angle, **more)
            self.right = fb.Beam.arc("right", self.top, (1, 0, 0), (0, 0, -1), radius=radius, angle=angle, **more)
        else:
            self.left = fb.Beam.straight("left", (-1, 0, 0), self.top, **more)
            self.right = fb.Beam.straight("right", self.top, (1, 0, 0), **more)
        self.apex = self.left.end
        self.parts: list[Any] = [self.left, self.right, fb.RigidConnection(self.left.end, self.right.start),
                                 fb.Clamp(self.left.start, "foot"), fb.Clamp(self.right.end, "abutment"),
                                 fb.Load("weight", self.apex, force=(self.push, self.side, -1.5))]

    def add(self, *parts: Any) -> None:
        """Add parts to its scene."""
        self.parts += parts

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
        """A place relative to the apex."""
        return self.top + (x, y, z)

    def ground(self, x: float = 0.3, z: float = 1.0) -> Any:
        """A point of the ground relative to the apex."""
        return fb.GROUND.point(self.at(x, 0, z))

    def arm(self, joint: Callable[..., Any], x: float = 0.0) -> None:
        """Add a soft beam to a wall that joint(apex, start) fixes to the apex."""
        soft = fb.Section(EA=300, GA2=100, GA3=100, GJ=0.05, EI2=0.05, EI3=0.05, rhoA=0.05, rhoI2=1e-5, rhoI3=1e-5)
        arm = fb.Beam.straight("arm", self.at(x), self.at(x + 0.8), section=soft, elements=2)
        self.add(arm, fb.Clamp(arm.end, "wall"), joint(self.apex, arm.start))

    def rail(self, *cuts: float, elements: Any = 4) -> list[fb.Beam]:
        """Add a stiff vertical beam through the apex, cut at heights relative to it; its pieces."""
        z = [-0.6, *(self.rise + cut for cut in cuts), 0.8]
        beams = [fb.Beam.straight(f"rail {k}", (0, 0, a), (0, 0, b), section=section(20), elements=elements)
                 for k, (a, b) in enumerate(zip(z[:-1], z[1:]))]
        self.add(*beams, fb.Clamp(beams[0].start, "bottom"), fb.Clamp(beams[-1].end, "head"))
        self.add(*(fb.RigidConnection(a.end, b.start) for a, b in zip(beams[:-1], beams[1:])))
        return beams

    def slide(self, kind: Any = None, **options: Any) -> None:
        """Let the apex slide on a rail; options that are functions get its place."""
        rail, = self.rail()
        at = 0.6 + self.rise
        self.add((kind or fb.Slider)("s", self.apex, rail, at=at, **{a: b(at) if callable(b) else b for a, b in options.items()}))

    def scene(self) -> fb.Scene:
        """The scene of all parts."""
        return fb.Scene(*self.parts, project_velocities=True, **self.options)

    def points(self) -> dict[str, Any]:
        """What is observed."""
        return {"apex": self.apex, "root": (self.left, 0.0)}

    def timed(self) -> dict[str, Any]:
        """Options of analyses without time."""
        return {} if self.at_time is None else {"at_time": self.at_time}


Feature = Callable[[Arch], Any]


def arch(feature: Feature | None = None, **options: Any) -> Arch:
    """An arch with a feature."""
    made = Arch(**options)
    if feature is not None:
        feature(made)
    return made


def run(made: Arch, planar: bool = False, **options: Any) -> fb.Result:
    """A short run of an arch."""
    options = {"t_end": STEPS * STEP, "step": STEP, "observe": SEEN, "every": 2, "snapshots": 3, "progress": False,
               "points": made.points(), **options}
    return fb.simulate(model_of(made, planar), **options)


def model_of(made: Arch, planar: bool = False) -> Any:
    """The compiled scene of an arch."""
    return fb.compile_scene(made.scene(), planar=planar)


def rest(made: Arch, planar: bool = False, **options: Any) -> fb.Result:
    """The equilibrium of an arch."""
    observe = ("energy", "section", "reaction")
    return fb.solve_static(model_of(made, planar), points=made.points(), observe=observe, **made.timed(), **options)


def moved_and_at_rest(feature: Feature, options: Mapping[str, Any], planar: bool = False) -> dict[str, Any]:
    """A run of an arch with a feature and its equilibrium, or why there is none."""
    made = arch(feature, **options)
    return {"run": run(made, planar), "static": or_why_not(partial(rest, made, planar))}


def or_why_not(what: Callable[[], Any]) -> Any:
    """What a function returns, or the kind of its failure."""
    try:
        return what()
    except (fb.SceneError, fb.ConvergenceError) as trouble:
        return {type(trouble).__name__: 1}


def feature(name: str, act: Feature = lambda made: None, **options: Any) -> None:
    """Add the case of a feature."""
    CASES[name] = partial(moved_and_at_rest, act, options)


def in_plane(name: str, act: Feature = lambda made: None, **options: Any) -> None:
    """Add the case of a feature in the plane, with the matrices that there are."""
    CASES[f"in a plane: {name}"] = partial(moved_and_at_rest, act, {"side": 0.0, **options}, planar=True)


def adds(*makers: Callable[[Arch], Any]) -> Feature:
    """The feature that adds what the makers make of an arch."""
    return lambda made: made.add(*(make(made) for make in makers))


# --- beams, bodies and supports --------------------------------------------------------------------------------------------
def coupled() -> fb.Section:
    """A section whose stiffness couples all strains."""
    c = np.diag([1e4, 4e3, 4e3, 2.0, 1.0, 4.0])
    for i, j, share in ((0, 5, 0.2), (0, 3, 0.1), (3, 4, 0.2), (1, 3, 0.1)):
        c[i, j] = c[j, i] = share * math.sqrt(c[i, i] * c[j, j])
    return fb.Section.from_matrix(c, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5)


def body(made: Arch) -> None:
    """A body above the apex."""
    weight = fb.RigidBody("body", mass=0.2, inertia=(1e-3, 2e-3, 2e-3), position=made.at(z=0.1))
    made.add(weight, fb.RigidConnection(made.apex, weight))


def point_mass(made: Arch) -> None:
    """A mass at the apex."""
    mass = fb.PointMass("mass", mass=0.2, position=made.at())
    made.add(mass, fb.BallJoint(made.apex, mass))


def swing(t: float) -> tuple[float, float, float]:
    """A support that moves in."""
    return -5 * t * t, 0, 0


feature("straight beam")
feature("B-spline beam", beams={"interpolation": "bspline", "elements": 4})
feature("Green-Lagrange beam", beams={"strain": "green_lagrange"})
feature("curved beam", beams={"arc": True})
feature("coupled section", beams={"section": coupled()})
feature("damped section", beams={"section": section(1.0, 1e-3)})
feature("prestress", beams={"prestress": 20.0})
feature("rigid body", body)
feature("point mass", point_mass)
feature("supports of some axes", adds(lambda a: fb.Clamp(a.apex, "guide", axes="y"),
                                      lambda a: fb.Pin(a.right.node(3), "p", axes="x")))
feature("support that moves", adds(lambda a: fb.PrescribedMotion("m", a.right.node(3), displacement=swing)), at_time=0.02)
feature("support that lets go", adds(lambda a: fb.Clamp(a.right.node(3), "peg", until=0.0105)))
feature("support that catches", adds(lambda a: fb.Clamp(a.right.node(3), "peg", since=0.0105)))


# --- joints ----------------------------------------------------------------------------------------------------------------
def joined(make: Callable[..., Any], x: float = 0.0) -> Feature:
    """A joint between the apex and an arm."""
    return lambda made: made.arm(make, x)


def hinge(**options: Any) -> Feature:
    """A hinge between the apex and an arm."""
    return joined(lambda a, b: fb.RevoluteJoint(a, b, "j", axis=(0, 1, 0), **options))


feature("ball joint", joined(lambda a, b: fb.BallJoint(a, b)))
feature("distance joint", joined(lambda a, b: fb.DistanceJoint(a, b), 0.2))
feature("revolute joint", hinge())
feature("revolute joint, spring", hinge(stiffness=0.5, damping=0.01))
feature("revolute joint, torque", hinge(torque=lambda t: 0.05 + t), at_time=0.02)
feature("revolute joint, angle", hinge(angle=lambda t: 30 * t * t), at_time=0.02)
feature("revolute joint, friction", hinge(friction=3e-4))
feature("revolute joint, load friction", hinge(coefficient=0.1, radius=0.02))
feature("revolute joint, rigid stops", lambda a: hinge(stops=fb.Stops(-0.001, 0.001, restitution=0.5))(a))
feature("revolute joint, elastic stops", lambda a: hinge(stops=fb.Stops(-0.001, 0.001, stiffness=50.0))(a))
feature("revolute joint, drive", lambda a: hinge(drive=fb.Drive(position=0.02, stiffness=0.5, damping=0.01))(a))
feature("universal joint", joined(lambda a, b: fb.UniversalJoint(a, b, "j", axis_a=(0, 1, 0), axis_b=(1, 0, 0))))
feature("cylindrical joint", joined(lambda a, b: fb.CylindricalJoint(a, b, "j", axis=(1, 0, 0), friction=(1e-3, 0.05))))
feature("prismatic joint", joined(lambda a, b: fb.PrismaticJoint(a, b, "j", axis=(1, 0, 1), stiffness=3.0)))
feature("planar joint", joined(lambda a, b: fb.PlanarJoint(a, b, "j", normal=(0, 1, 0))))
feature("spherical joint", joined(lambda a, b: fb.SphericalJoint(a, b, "j", axis=(1, 0, 0), stiffness=(0.2, 0.2),
                                                                 damping=(0.01, 0.01))))


# --- contact ---------------------------------------------------------------------------------------------------------------
def sliding(kind: str = "Slider", **options: Any) -> Feature:
    """A contact of the apex with a rail."""
    return lambda made: made.slide(getattr(fb, kind), **options)


def on_path(made: Arch) -> None:
    """A path of two beams, cut below the apex."""
    made.add(fb.Slider("s", made.apex, on=fb.Path("p", made.rail(-0.001, elements=3)), at=0.6 + made.rise))


def on_closed_path(made: Arch) -> None:
    """A ring of six beams."""
    corners = [made.at(x, 0, z) for x, z in ((0, -0.001), (0, 0.4), (0.4, 0.55), (0.8, 0), (0.4, -0.55), (0, -0.4))]
    ring = [fb.Beam.straight(f"ring {k}", a, corners[(k + 1) % 6], section=section(20), elements=3)
            for k, a in enumerate(corners)]
    made.add(*ring, *(fb.RigidConnection(a.end, b.start) for a, b in zip(ring, ring[1:] + ring[:1])))
    made.add(fb.Clamp(ring[0].end), fb.Clamp(ring[4].end))
    made.add(fb.Slider("s", made.apex, on=fb.Path("p", ring, closed=True), at=0.001))


def on_switch(made: Arch) -> None:
    """A yard of three beams, whose blades are passed."""
    lower, upper = made.rail(-0.0036, elements=3)
    side = fb.Beam.straight("side", (0.1, 0, -0.6), made.at(z=-0.0036), section=section(20), elements=3)
    tracks = fb.Switch("yard", [lower, side, upper], choose={"s": lower.name})
    made.add(side, fb.Clamp(side.start), fb.RigidConnection(side.end, lower.end),
             fb.Slider("s", made.apex, on=tracks, at=tracks.offset(upper) + 0.0036))


def crossing(made: Arch) -> None:
    """A cable that slides across one of the beams."""
    cable = fb.Beam.straight("cable", (0.5, -0.5, made.rise / 2), (0.5, 0.5, made.rise / 2), section=section(1), elements=2)
    cross = fb.Crossing("x", made.right, cable, at=(0.5 * math.hypot(1, made.rise), 0.5), friction=0.1)
    made.add(cable, fb.Clamp(cable.start), fb.Clamp(cable.end), cross)


def moving_mesh(made: Arch) -> None:
    """Elements that move with the contact."""
    rail, = made.rail(elements=[0, 0.3, 0.6 + made.rise, 1.1, 1.4])
    slider = fb.Slider("s", made.apex, rail, at=0.6 + made.rise)
    made.add(slider, fb.MovingMesh(rail, slider))


def pull(t: float, s: float, rate: float) -> float:
    """A controlled force along the rail."""
    return -40 * (s - 0.7) - 0.5 * rate


def turned_in_sleeve(made: Arch) -> None:
    """A beam that turns in a sleeve with friction."""
    made.slide(fb.Sleeve, keyed=False, length=0.1, friction=0.2, radius=0.02)
    made.add(fb.Load("twist", made.apex, moment=(0, 0, 0.02)))


feature("slider", sliding())
feature("slider, viscous friction", sliding(friction=lambda at: fb.Friction(0.0, viscous=2.0)))
feature("slider, Coulomb friction", sliding(friction=0.3))
feature("slider, smoothed friction", sliding(friction=lambda at: fb.Friction(0.3, smoothing=0.01)))
feature("slider, speed", sliding(drive=lambda at: fb.Drive(speed=lambda t: -20 * t)), at_time=0.02)
feature("slider, force", sliding(drive=lambda at: fb.Drive(force=pull)))
feature("slider, drive with limit", sliding(drive=lambda at: fb.Drive(position=at + 0.01, stiffness=300.0, damping=2.0,
                                                                      limit=0.8)))
feature("slider, elastic stop", sliding(stops=lambda at: fb.Stops(start=at - 0.001, stiffness=1e3)))
feature("slider, rigid stop", sliding(stops=lambda at: fb.Stops(start=at - 0.001, restitution=0.5)))
feature("slider, lock", sliding(lock=lambda at: fb.Lock(at=at - 0.001)))
feature("slider, release", sliding(release=lambda at: fb.Release(0.0105)))
feature("slider, one-sided", sliding(one_sided=(1, 0, 0)))
feature("slider, own curve", sliding(curve="own"))
feature("sleeve", sliding("Sleeve"))
feature("sleeve with a bore, friction", sliding("Sleeve", length=0.1, friction=0.2))
feature("sleeve, twist with friction", turned_in_sleeve)
feature("slider on a path", on_path)
feature("slider on a closed path", on_closed_path)
feature("slider on a switch", on_switch)
feature("crossing with friction", crossing)
feature("moving mesh", moving_mesh)


# --- forces ----------------------------------------------------------------------------------------------------------------
def line_law(t: float, length: float, rate: float, parameters: Any) -> float:
    """A spring with a damper."""
    return parameters[0] * (length - parameters[1]) + parameters[2] * rate


def element_law(t: float, position: Any, rotation: Any, velocity: Any, spin: Any, parameters: Any, force: Any,
                moment: Any) -> None:
    """The same in three directions."""
    force[:] = -parameters[0] * position - parameters[1] * velocity


def user_law(t: float, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    """A bed."""
    force[2] = -parameters[0] * position[2] - parameters[1] * velocity[2]


def wind_law(t: float, position: Any, parameters: Any, velocity: Any) -> None:
    """Wind that grows with height."""
    velocity[0] = parameters[0] * (1.0 + position[2])


def height_control(now: Any, memory: Any) -> float:
    """A load that follows the height of the apex."""
    return 1 - 10 * (now.point("apex")[2] - 0.15)


SPRINGS = (lambda a: fb.Spring(a.ground(), a.apex, "e", stiffness=50.0),
           lambda a: fb.Spring(a.ground(-0.3), a.apex, "rope", stiffness=50.0, tension_only=True),
           lambda a: fb.Spring(a.ground(0.5), a.apex, "curve", table=([-0.1, 0, 0.005, 0.1], [-4, 0, 0.3, 8])),
           lambda a: fb.Damper(a.ground(-0.5), a.apex, "damper", damping=1.0),
           lambda a: fb.Bushing(fb.GROUND.point(a.at()), a.apex, "bushing", stiffness=(20, 20, 20, 0.1, 0.1, 0.1),
                                damping=(0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3)))
LAWS = (lambda a: fb.LineForce(a.ground(), a.apex, "line", law=line_law, parameters=(50.0, 1.04, 0.5)),
        lambda a: fb.ForceElement(fb.GROUND.point(a.at()), a.apex, "element", law=element_law, parameters=(20.0, 0.2)),
        lambda a: fb.UserForce("u", a.apex, user_law, parameters=(5.0, 0.2)))
LOADS = (lambda a: fb.Load("follower", a.apex, force=(0, 0, -0.8), follower=True),
         lambda a: fb.DistributedLoad("d", a.left, force=(0, 0, -1)),
         lambda a: fb.Load("beat", a.apex, force=(0, 0, -0.8), time=lambda t: 1 + 20 * t),
         lambda a: fb.Load("controlled", a.apex, force=(0, 0, -0.8), time=fb.Controller(
             "c", height_control, period=0.002, start=1.0, points={"apex": a.apex})))
FLUID = (lambda a: fb.Drag("air", a.left, normal=2.0, tangential=0.1, linear=0.2),
         lambda a: fb.Drag("wind", a.right, normal=2.0, wind=wind_law, parameters=(3.0,)),
         lambda a: fb.AddedMass("water", a.left, normal=0.1))
WINCHES = (lambda a: fb.Winch("w", a.ground(0.0, 0.5), a.apex, stiffness=50.0, mass_per_length=0.02, segments=2,
                              length_at=lambda t: 0.49 - 20 * t * t),
           lambda a: fb.Winch("pull", a.ground(0.1, 0.5), a.apex, stiffness=50.0, mass_per_length=0.02, segments=2, length=0.49,
                              tension=lambda t: 1.0 + t, total=0.6, inertia=0.01))
feature("springs and bushing", adds(*SPRINGS))
feature("laws of a user", adds(*LAWS))
feature("loads", adds(*LOADS), at_time=0.02)
feature("gravity in time", options={"gravity": (0, 0, -9.81), "gravity_time": lambda t: 1 + 20 * t}, at_time=0.02)
feature("fluid", adds(*FLUID))
feature("winches", adds(*WINCHES), at_time=0.02)

in_plane("straight beam")
in_plane("hinge with friction", hinge(friction=3e-4))
in_plane("slider, Coulomb friction", sliding(friction=0.3))


# --- nets ------------------------------------------------------------------------------------------------------------------
def net(condense: bool, slider: bool = False) -> dict[str, Any]:
    """A net of 4 x 4 cells that sags, with a mass that slides on one of its beams."""
    k = np.arange(25).reshape(5, 5)
    x, y = np.divmod(k, 5)
    nodes = np.stack((x, y, 0.1 * np.sin(k)), axis=-1).reshape(-1, 3)
    edges = np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])
    knots = fb.Net("net", nodes, edges, section=section(3.0), elements=4, degree=2, pins=np.arange(5))
    scene = fb.Scene(knots, gravity=(0, 0, -9.81))
    if slider:
        mass = fb.PointMass("mass", mass=0.05)
        scene.add(mass, fb.Slider("s", mass, knots.beam(7), at=0.45 * float(knots.lengths[7]), rate=0.3))
    model = fb.compile_scene(scene, condense=condense)
    return {f"threads {threads}": fb.simulate(model, t_end=10 * STEP, step=STEP, threads=threads, progress=False, snapshots=3)
            for threads in (1, 2)}


CASES.update({"net": partial(net, False), "net, condensed": partial(net, True), "net with a slider": partial(net, False, True),
              "net with a slider, condensed": partial(net, True, True)})


# --- analyses --------------------------------------------------------------------------------------------------------------
def analysis(act: Callable[[], Any]) -> Callable[[], Any]:
    """Add the case of an analysis, named after its function."""
    CASES[act.__name__.replace("_", " ")] = act
    return act


RUBBED, HINGED = sliding(friction=0.3), hinge(friction=3e-4)
PROBE = {"force": (0.3, 0, 1.0)}


@cache
def quiet(name: str) -> tuple[Arch, Any, Any]:
    """An arch, its model, and its state at rest: one without more, with a slider, with a hinge."""
    made = arch({"arch": None, "slider": sliding(), "rubbed": RUBBED, "hinge": hinge(stiffness=0.5)}[name])
    model = model_of(made)
    return made, model, fb.solve_static(model).state


def of_each(act: Callable[[Arch, Any, Any], Any], *names: str) -> dict[str, Any]:
    """What an analysis finds of some arches at rest."""
    return {name: act(*quiet(name)) for name in names}


def family(act: Feature | None, side: float = 0.05) -> Callable[..., Any]:
    """An arch as a function of its stiffness and height."""
    def build(k: float = 1.0, h: float = 1.0) -> Any:
        made = arch(act, k=k, h=h, side=side)
        return made.scene(), made.points()
    return build


@analysis
def methods_compared() -> dict[str, Any]:
    return {method: run(arch(sliding()), method=method, observe=("energy", "slider"))
            for method in ("midpoint", "generalized_alpha")}


@analysis
def order_4() -> dict[str, Any]:
    return {"arch": run(arch(), order=4), "slider": run(arch(sliding()), order=4),
            "dissipation": or_why_not(lambda: run(arch(), order=4, rho_inf=0.8))}


@analysis
def step_control() -> dict[str, Any]:
    return {"arch": run(arch(), tolerance=1e-5, step=2e-4), "rubbed": run(arch(RUBBED), tolerance=1e-5, step=2e-4)}


@analysis
def dissipation() -> Any:
    return run(arch(), rho_inf=0.8, observe=("energy", "momentum"))


@analysis
def backends() -> dict[str, Any]:
    of = {"arch": arch(), "slider": arch(sliding())}
    return {name: run(made, backend="superlu") for name, made in of.items()} | {
        f"{name} at rest": rest(made, backend="superlu") for name, made in of.items()}


@analysis
def restart() -> Any:
    made = arch(sliding(stops=lambda at: fb.Stops(start=at - 0.001, restitution=0.5)))
    first = run(made, callback=lambda t, state: t > 0.0095)
    with tempfile.TemporaryDirectory() as folder:
        first.checkpoint.save(Path(folder) / "c")
        second = run(made, start=fb.load_checkpoint(Path(folder) / "c"))
        second.save(Path(folder) / "r.h5")
        return {"first": first, "second": second, "file": fb.load_result(Path(folder) / "r.h5")}


@analysis
def exact_contacts() -> Any:
    return rest(arch(sliding()), contacts="exact")


@analysis
def paths_of_equilibria() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.solve_path(model, points=made.points(), observe=("energy",)),
                   "arch", "slider", "hinge")


@analysis
def limit_load() -> dict[str, Any]:
    options: dict[str, Any] = {"to": 20.0, "stop_at": "limit", "most_points": 300, "step": 0.01, "largest_step": 0.02}
    made = arch()
    path = fb.solve_path(model_of(made), points=made.points(), **options)
    return {"path": path, "slopes": fb.critical_sensitivity(family(None), {"k": 1.0, "h": 1.0}, state=path.state,
                                                            load_factor=float(path.series["load_factor"][-1]))}


@analysis
def bifurcation() -> Any:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(), elements=4)
    scene = fb.Scene(column, fb.Clamp(column.start), fb.Load("top", column.end, force=(0, 0, -1)))
    return fb.solve_path(fb.compile_scene(scene, planar=False), to=6.0, stop_at="bifurcation", points={"top": column.end})


@analysis
def dynamic_relaxation() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.relax(model, points=made.points()), "arch", "slider")


@analysis
def vibrations() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.modes(model, state=state, n=6), "arch", "slider", "hinge")


@analysis
def damped_vibrations() -> dict[str, Any]:
    act = adds(lambda a: fb.Damper(a.ground(), a.apex, "e", damping=0.2))
    made = arch(act)
    model = model_of(made)
    return {"damper": fb.modes(model, state=fb.solve_static(model).state, n=4, damped=True),
            **of_each(lambda made, model, state: fb.modes(model, state=state, n=4, damped=True), "arch", "slider")}


@analysis
def steady_motion() -> dict[str, Any]:
    made = arch(push=0.0, side=0.0)
    model, spin = model_of(made), fb.Spin(3.0, axis=(0, 0, 1))
    still = fb.solve_static(model, points=made.points(), steady=spin)
    return {"static": still, "modes": fb.modes(model, state=still.state, steady=spin, n=6)}


@analysis
def response_to_frequencies() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.frequency_response(
        model, [0.0, 3.0, 11.0], loads=fb.Load("probe", made.apex, **PROBE), points={"apex": made.apex}, state=state,
        damping_ratio=0.01, shapes=True), "arch", "slider", "hinge")


@analysis
def derivatives_of_equilibria() -> dict[str, Any]:
    out = {}
    for name, act in {"arch": None, "slider": sliding()}.items():
        found = fb.sensitivity(family(act), {"k": 1.0, "h": 1.0}, observe=("energy", "section"))
        out[name] = {"point": found.point("apex"), "energy": found.energy(), "section": found.section("root"),
                     "frequencies": found.frequencies(n=3), "gradient": found.gradient(points={"apex": (0.5, 0, 1.0)})}
    return out


@analysis
def derivatives_of_runs() -> dict[str, Any]:
    out = {}
    for name, act in {"arch": None, "rubbed": RUBBED, "hinge": hinge(stiffness=0.5, damping=0.01)}.items():
        made = arch(act)
        found = fb.adjoint_run(model_of(made), points=made.points(), t_end=0.01, step=STEP)
        out[name] = {"point": found.point("apex"), "gradient": found.gradient(points={"apex": (0.5, 0, 1.0)}, build=family(act),
                                                                              values={"k": 1.0, "h": 1.0})}
    return out


@analysis
def unknown_lengths() -> Any:
    made, model, state = quiet("arch")
    apex = fb.solve_static(model, points=made.points()).point("apex")[-1]
    return fb.find_lengths(model, [made.left], {("apex", "z"): float(apex[2]) + 2e-4}, points=made.points())


@analysis
def interval_of_sticking() -> Any:
    return fb.stick_interval(quiet("rubbed")[1], "s", within=(0.0, 3.0))


@analysis
def rest_intervals() -> Any:
    return rest(arch(RUBBED), rest_intervals=True)


@analysis
def force_densities() -> Any:
    nodes = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0), (1, -1, 0)], dtype=float)
    return fb.force_density(nodes, [(0, 1), (1, 2), (1, 3), (1, 4)], [1.0, 2.0, 1.0, 3.0], [0, 2, 3, 4], loads=[(0, 0, -1.0)] * 5)


@analysis
def forces_in_sections() -> Any:
    made = arch(sliding())
    model = model_of(made)
    return fb.section_forces(model, fb.simulate(model, t_end=10 * STEP, step=STEP, progress=False), made.left)


@analysis
def impacts() -> dict[str, Any]:
    """Longer than others: stops and one-sided contact are met again and again."""
    stops, sided = sliding(stops=lambda at: fb.Stops(at - 0.001, at + 0.0005, restitution=0.7)), sliding(one_sided=(0, 1, 0))
    return {"stops": run(arch(stops), t_end=0.1), "one-sided": run(arch(sided), t_end=0.1),
            "hinge": run(arch(hinge(stops=fb.Stops(-0.001, 0.001, restitution=0.7))), t_end=0.1)}
