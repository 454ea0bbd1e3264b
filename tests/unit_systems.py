"""Random scenes of three features, in any units, turned and moved, and what three analyses find in them.

The host is an arch of two beams, clamped at its feet, with a force on its apex; each feature hangs something on it, or changes
it. What a scene is built of follows from its number alone, and so does its `Frame`: units of length, mass and time, a rotation
and a shift. Results of a frame are brought home to SI; they have to agree with those of the scene at home within round-off. How
much round-off a scene makes of its results is measured: by one whose numbers differ by a few units in the last place.

All numbers of a kind have the same features, so that few variants of the kernels are compiled.
"""
from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import fastbeam as fb

Array = np.ndarray
H, STEPS = 1e-3, 12
EPS = 2.0**-52
BALANCE = 1e-12
# metres, kilograms and seconds in these units: mm t s, mm kg ms, ft lb s, km kg s, m kg us, and powers of two
UNITS = ((1e3, 1e-3, 1.0), (1e3, 1.0, 1e3), (1 / 0.3048, 1 / 0.45359237, 1.0), (1e-3, 1.0, 1.0), (1.0, 1.0, 1e6),
         (2.0**10, 2.0**-10, 1.0), (2.0**-10, 2.0**3, 2.0**5), (1.0, 2.0**20, 2.0**-4))


class Frame(NamedTuple):
    """Units, as the numbers of one metre, kilogram and second, and where the scene is: turned, then moved by metres."""

    m: float = 1.0
    kg: float = 1.0
    s: float = 1.0
    turn: Array = np.eye(3)
    shift: Array = np.zeros(3)

    @property
    def N(self) -> float:
        """The number of a newton."""
        return self.kg * self.m / self.s**2

    @property
    def Nm(self) -> float:
        """That of a newton metre."""
        return self.N * self.m

    def at(self, point: Any) -> Array:
        """A point."""
        return np.asarray(self.m * (self.turn @ point + self.shift))

    def way(self, *x: float) -> Array:
        """A direction."""
        return np.asarray(self.turn @ x)

    def home(self, points: Array) -> Array:
        """Points [..., 3] in metres, at home."""
        return np.asarray((points / self.m - self.shift) @ self.turn)

    def back(self, vectors: Array, unit: float) -> Array:
        """Vectors [..., 3] at home."""
        return np.asarray(vectors / unit @ self.turn)


def nudged(seed: int, frame: Frame = Frame()) -> Frame:
    """A frame with numbers that differ in their last places."""
    m, kg, s = 1.0 + EPS * np.random.default_rng((seed, 1)).integers(2, 9, 3)
    return frame._replace(m=m * frame.m, kg=kg * frame.kg, s=s * frame.s)


def away(seed: int) -> Frame:
    """Other units, turned and moved."""
    draw = np.random.default_rng((seed, 2))
    q, r = np.linalg.qr(draw.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return Frame(*UNITS[draw.integers(len(UNITS))], q * np.linalg.det(q), 2.0 * draw.standard_normal(3))


# ---- laws: what a law is given is brought home by its parameters, and it fails beyond a limit ---------------------------------

def ball_law(t, position, directors, velocity, spin, parameters, force, moment):  # type: ignore[no-untyped-def]
    """Drawn to a place, and damped: stiffness, damping, place, limit of the distance."""
    square = 0.0
    for c in range(3):
        x = position[c] - parameters[2 + c]
        square += x * x
        force[c] = -parameters[0] * x - parameters[1] * velocity[c]
    if square > parameters[5]**2:
        raise ValueError("beyond its limit")


def line_law(t, length, rate, parameters):  # type: ignore[no-untyped-def]
    """A rope: stiffness, length, damping, limit."""
    if length > parameters[3]:
        raise ValueError("beyond its limit")
    return parameters[0] * (length - parameters[1]) * (1.0 + (length / parameters[1] - 1.0)**2) + parameters[2] * rate


def pad_law(t, position, rotation, velocity, spin, parameters, force, moment):  # type: ignore[no-untyped-def]
    """A pad: stiffness, damping, stiffness against turns, limit of the distance."""
    square = 0.0
    for c in range(3):
        square += position[c]**2
        force[c] = -parameters[0] * position[c] - parameters[1] * velocity[c]
        moment[c] = -parameters[2] * (rotation[(c + 2) % 3, (c + 1) % 3] - rotation[(c + 1) % 3, (c + 2) % 3])
    if square > parameters[3]**2:
        raise ValueError("beyond its limit")


def wind_law(t, position, parameters, velocity):  # type: ignore[no-untyped-def]
    """Shear flow: velocity over height, the height of 0, up, along."""
    height = -parameters[1]
    for c in range(3):
        height += parameters[2 + c] * position[c]
    for c in range(3):
        velocity[c] = parameters[0] * height * parameters[5 + c]


# ---- the host --------------------------------------------------------------------------------------------------------------

class Host:
    """A scene with features in a frame, beside one with those of its family.

    k, h: factors of stiffness and height, for derivatives; limit: distance beyond which laws of the user fail, m.
    """

    def __init__(self, family: str, features: tuple[str, ...], seed: int, frame: Frame = Frame(), k: float = 1.0, h: float = 1.0,
                 limit: float = 1e3) -> None:
        self.made = family, features, seed, frame
        self.u, self.rng, self.k, self.height = frame, np.random.default_rng(seed), k, h
        self.parts: list[Any] = []
        self.scene_options: dict[str, Any] = {}
        if FAMILIES[family].yard:
            self._build("yard ", 3.0, FAMILIES[family].yard, 1e3)
        self._build("", 0.0, features, limit)
        push = self.draw(0.5, 2.0) * self.ei * np.array((0.2, 0.1, -1.0))
        self.weight = self.force(*push)
        self.add(fb.Load("weight", self.apex, force=self.weight))
        self.points = {"apex": self.apex, "quarter": (self.left, 0.4 * self.left.length)}
        self.scene = fb.Scene(*self.parts, project_velocities=True, **self.scene_options)

    def _build(self, tag: str, y: float, features: tuple[str, ...], limit: float) -> None:
        """An arch with features."""
        self.tag, self.y, self.limit, self.options = tag, y, limit, {}
        self.joints: list[str] = []
        self.laws: list[str] = []
        self.slider: str | None = None
        self.damping, self.coupled = 0.0, False
        self.ei, self.stiff, self.rise = self.draw(0.5, 4.0), self.draw(3e3, 1e6), self.height * self.draw(0.1, 0.5)
        for name in features:
            SHAPES.get(name, lambda host: None)(self)
        self._arch()
        for name in features:
            PARTS.get(name, lambda host: None)(self)

    def at(self, x: float, y: float, z: float) -> Array:
        """A point; y: from the plane of the arch."""
        return self.u.at((x, y + self.y, z))

    def draw(self, low: float, high: float) -> float:
        """A number between the two, whose logarithm is uniform."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def add(self, *parts: Any) -> None:
        self.parts += parts

    def force(self, *x: float) -> Array:
        return self.u.N * self.u.way(*x)

    def section(self, times: float = 1.0) -> fb.Section:
        """That of the arch, or one that is stiffer."""
        u, ea = self.u, self.stiff * self.k * times
        stiffness = {"EA": ea * u.N, "GA2": 0.4 * ea * u.N, "GA3": 0.4 * ea * u.N}
        stiffness |= {name: share * self.ei * self.k * times * u.Nm * u.m
                      for name, share in (("GJ", 1.3), ("EI2", 1.0), ("EI3", 2.0))}
        mass = {"rhoA": 0.1 * times * u.kg / u.m, "rhoI2": 1e-4 * times * u.kg * u.m, "rhoI3": 2e-4 * times * u.kg * u.m}
        if not self.coupled:
            return fb.Section(**stiffness, **mass, damping=self.damping * u.s)
        c = np.diag(list(stiffness.values()))
        for i, j, share in ((0, 5, 0.2), (0, 3, 0.1), (3, 4, 0.2), (1, 3, 0.1)):
            c[i, j] = c[j, i] = share * np.sqrt(c[i, i] * c[j, j])
        return fb.Section.from_matrix(c, **mass, damping=self.damping * u.s)

    def beam(self, name: str, a: tuple[float, ...], b: tuple[float, ...], times: float = 1.0, **options: Any) -> fb.Beam:
        """A straight beam; its section has an axis across the plane of the arch."""
        return fb.Beam.straight(name, self.at(*a), self.at(*b), **{"section": self.section(times), "elements": 2,
                                                                   "d2": self.u.way(0, 1, 0), **options})

    def _arch(self) -> None:
        top = (0.0, 0.0, self.rise)
        self.left, self.right = (self.beam(self.tag + name, a, b, **self.options)
                                 for name, a, b in (("left", (-1, 0, 0), top), ("right", top, (1, 0, 0))))
        self.apex, self.inner, self.all = self.left.end, self.right.node(3), self.left
        feet = self.left.start, self.right.end
        self.add(self.left, self.right, fb.RigidConnection(self.left.end, self.right.start))
        self.add(fb.Clamp(feet[0], self.tag + "foot"), fb.Clamp(feet[1], self.tag + "abutment"))
        self.far = feet[1]

    def arm(self, joint: Callable[[Any, Any, str], Any]) -> None:
        """A soft beam, clamped at its far end, that a joint fixes to the apex."""
        n = len(self.joints)
        self.joints.append(name := f"{self.tag}joint {n}")
        arm = self.beam(f"{self.tag}arm {n}", (0, 0, self.rise), (self.draw(0.5, 1.0), 0, self.rise), 0.05)
        self.add(arm, fb.Clamp(arm.end, f"{self.tag}wall {n}"), joint(self.apex, arm.start, name))

    def slide(self, kind: Any = fb.Slider, **options: Any) -> None:
        """The apex slides on a rail."""
        lower, upper = self.draw(0.3, 0.8), self.draw(0.3, 0.8)
        rail = self.beam(self.tag + "rail", (0, 0, self.rise - lower), (0, 0, self.rise + upper), 20.0, elements=4)
        self.slider, place = self.tag + "ride", lower * self.u.m
        self.add(rail, fb.Clamp(rail.start), fb.Clamp(rail.end), kind(self.slider, self.apex, rail, at=place, **options))

    def ground(self) -> Any:
        """A point beside the apex."""
        self.drum = np.array((self.draw(0.2, 0.5), 0.0, self.rise + self.draw(0.5, 1.0)))
        return fb.GROUND.point(self.at(*self.drum))

    @property
    def distance(self) -> float:
        """Of that point from the apex, in the unit of length."""
        return self.u.m * float(np.linalg.norm(self.drum - (0, 0, self.rise)))

    def law(self, name: str) -> str:
        self.laws.append(self.tag + name)
        return self.tag + name

    def reach(self, apex: Array) -> float:
        """How far places of the apex [..., 3], at home, go on the way to the limit of the law, m; below 0: the other way."""
        if self.laws[0] == "rope":
            return float(np.max(np.linalg.norm(apex - self.drum, axis=-1))) - self.distance / self.u.m
        return float(np.max(np.linalg.norm(apex - (0, 0, self.rise), axis=-1)))

    def motion(self, *way: float) -> Callable[[float], Array]:
        """A displacement that begins at rest, m: at 12 ms about 1e-3."""
        u = self.u
        return lambda t: u.m * u.way(*way) * 5.0 * (t / u.s)**2


# ---- features --------------------------------------------------------------------------------------------------------------

def _pull(h: Host) -> Callable[..., float]:
    """A drive's force towards a place."""
    place, k = 0.2 * h.u.m, h.draw(10, 40) * h.u.N / h.u.m
    c = 0.01 * h.u.s * k
    return lambda t, s, rate: -k * (s - place) - c * rate


def _set(**facts: Any) -> Callable[[Host], None]:
    return lambda h: h.__dict__.update(facts)


def _gravity(h: Host) -> None:
    h.scene_options["gravity"] = 9.81 * h.u.m / h.u.s**2 * h.u.way(0, 0, -1)


def _gravity_in_time(h: Host) -> None:
    _gravity(h)
    h.scene_options["gravity_time"] = lambda t: 1 + 20 * t / h.u.s


SHAPES: dict[str, Callable[[Host], None]] = {
    "section damping": _set(damping=1e-3), "coupled section": _set(coupled=True),
    "prestress": lambda h: h.options.update(prestress=h.draw(0.1, 1) * h.u.N),
    "gravity": _gravity, "gravity in time": _gravity_in_time}


def _joint(kind: Any, *axes: tuple[str, tuple[float, float, float]], **options: Callable[[Host], Any]) -> Callable[[Host], None]:
    """One between apex and arm; options are functions of the host."""
    def feature(h: Host) -> None:
        given = {name: h.u.way(*axis) for name, axis in axes} | {name: of(h) for name, of in options.items()}
        h.arm(lambda a, b, name: kind(a, b, name, **given))
    return feature


def _rack(h: Host) -> None:
    """A hinge between apex and arm that moves a rack on a spring."""
    hinges: list[fb.RevoluteJoint] = []

    def hinge(a: Any, b: Any, name: str) -> fb.RevoluteJoint:
        hinges.append(fb.RevoluteJoint(a, b, name, axis=h.u.way(0, 1, 0)))
        return hinges[-1]

    h.arm(hinge)
    rack = fb.RigidBody(h.tag + "rack", mass=h.draw(0.02, 0.2) * h.u.kg, inertia=(1e-3 * h.u.kg * h.u.m**2,) * 3,
                        position=h.at(0.4, 0.0, h.rise + 0.7))
    guide = fb.PrismaticJoint(fb.GROUND, rack, h.tag + "guide", axis=h.u.way(1, 0, 0),
                              stiffness=h.draw(10, 100) * h.u.N / h.u.m)
    h.add(rack, guide, fb.GearCoupling(hinges[0], guide, h.tag + "gear", ratio=h.draw(0.05, 0.2) * h.u.m))


def _slide(kind: Any = fb.Slider, **options: Callable[[Host], Any]) -> Callable[[Host], None]:
    return lambda h: h.slide(kind, **{name: of(h) for name, of in options.items()})


def _elastic_stops(h: Host) -> None:
    lower = h.draw(0.3, 0.8)
    rail = h.beam(h.tag + "rail", (0, 0, h.rise - lower), (0, 0, h.rise + 0.5), 20.0, elements=4)
    h.slider = h.tag + "ride"
    stops = fb.Stops(start=(lower - h.draw(1e-4, 1e-3)) * h.u.m, stiffness=h.draw(1e2, 1e3) * h.u.N / h.u.m)
    h.add(rail, fb.Clamp(rail.start), fb.Clamp(rail.end), fb.Slider(h.tag + "ride", h.apex, rail, at=lower * h.u.m, stops=stops))


def _bead(h: Host) -> None:
    """A bead on the arch, on a spring to the ground."""
    at = h.draw(0.3, 0.6)
    bead = fb.PointMass(h.tag + "bead", mass=h.draw(0.02, 0.2) * h.u.kg)
    h.slider = h.tag + "ride"
    x = h.left.length / h.u.m * at
    place = np.array((-1.0, 0.0, 0.0)) + x * np.array((1.0, 0.0, h.rise)) / np.hypot(1.0, h.rise)
    h.add(bead, fb.Slider(h.tag + "ride", bead, h.left, at=at * h.left.length),
          fb.Spring(fb.GROUND.point(h.at(*(place + (0.1, 0.0, 1.0)))), bead, h.tag + "leash",
                    stiffness=h.draw(20, 60) * h.u.N / h.u.m))


def _body(h: Host) -> None:
    u = h.u
    inertia = np.array((1e-3, 2e-3, 1.5e-3)) * h.draw(0.3, 2.0) * u.kg * u.m**2
    body = fb.RigidBody(h.tag + "body", mass=h.draw(0.05, 0.3) * u.kg, inertia=inertia, position=h.at(0, 0, h.rise + 0.1),
                        directors=u.turn.T)
    h.add(body, fb.RigidConnection(h.apex, body))


def _point_mass(h: Host) -> None:
    mass = fb.PointMass(h.tag + "mass", mass=h.draw(0.05, 0.3) * h.u.kg, position=h.at(0, 0, h.rise))
    h.add(mass, fb.BallJoint(h.apex, mass))


def _hanging(h: Host) -> None:
    """A mass on a rod below the apex, and a spring that keeps it from swinging."""
    inertia = np.full(3, 1e-3) * h.u.kg * h.u.m**2
    bob = fb.RigidBody(h.tag + "bob", mass=h.draw(0.05, 0.3) * h.u.kg, inertia=inertia, position=h.at(0, 0, h.rise - 0.4))
    k = h.draw(5, 50)
    h.add(bob, fb.DistanceJoint(h.apex, bob, h.tag + "rod"), fb.Bushing(
        fb.GROUND.point(h.at(0, 0, h.rise - 0.4)), bob, h.tag + "hold", directors=h.u.turn.T,
        stiffness=(*np.full(3, k * h.u.N / h.u.m), *np.full(3, 0.1 * k * h.u.Nm))))


def _bushing(h: Host) -> None:
    u, k = h.u, h.draw(5, 50)
    along, turns = np.full(3, k * u.N / u.m), np.full(3, 0.02 * k * u.Nm)
    h.add(fb.Bushing(fb.GROUND.point(h.at(0, 0, h.rise)), h.apex, h.tag + "bush", stiffness=(*along, *turns),
                     damping=(*(0.01 * u.s * along), *(0.01 * u.s * turns)), directors=u.turn.T))


def _spring(**options: Callable[[Host], Any]) -> Callable[[Host], None]:
    def feature(h: Host) -> None:
        h.add(fb.Spring(h.ground(), h.apex, f"spring {len(h.parts)}", **{name: of(h) for name, of in options.items()}))
    return feature


def _table(h: Host) -> Array:
    return np.array(((-0.5, 0.0, 0.02, 0.5), (-4.0, 0.0, 0.3, 8.0))) * h.draw(0.5, 2.0) * np.array(((h.u.m,), (h.u.N,)))


def _line_force(h: Host) -> None:
    u = h.u
    drum = h.ground()
    length = h.distance
    h.add(fb.LineForce(drum, h.apex, h.law("rope"), law=line_law, parameters=(
        h.draw(10, 60) * u.N / u.m, 0.98 * length, h.draw(0.1, 1) * u.N * u.s / u.m, length + h.limit * u.m)))


def _force_element(h: Host) -> None:
    u, k = h.u, h.draw(5, 30)
    h.add(fb.ForceElement(fb.GROUND.point(h.at(0, 0, h.rise)), h.apex, h.law("pad"), law=pad_law, directors=u.turn.T,
                          parameters=(k * u.N / u.m, 0.01 * k * u.N * u.s / u.m, 0.02 * k * u.Nm, h.limit * u.m)))


def _user_force(h: Host) -> None:
    u, k = h.u, h.draw(3, 20)
    h.add(fb.UserForce(h.law("soil"), h.apex, ball_law, parameters=(
        k * u.N / u.m, 0.01 * k * u.N * u.s / u.m, *h.at(0, 0, h.rise), h.limit * u.m)))


def _wind(h: Host) -> None:
    u = h.u
    up = u.way(0, 0, 1)
    h.add(fb.Drag(h.tag + "air", h.all, normal=h.draw(0.5, 3) * u.kg / u.m**2, wind=wind_law, parameters=(
        h.draw(1, 5) / u.s, u.m * float(up @ u.shift), *up, *u.way(1, 0, 0))))


def _motion(h: Host) -> None:
    h.add(fb.PrescribedMotion(h.tag + "jack", h.far, displacement=h.motion(-1, 0, 0.3)))


def _line_load(h: Host) -> None:
    u, f = h.u, h.draw(0.2, 1.0)
    force = f * u.N / u.m * u.way(0.1, 0, -1)
    h.add(fb.DistributedLoad(h.tag + "snow", h.left, force=lambda s: np.outer(1.0 + np.asarray(s) / u.m, force)))


def _controller(h: Host) -> None:
    u, height = h.u, h.rise
    steer = fb.Controller(h.tag + "steer", lambda now, memory: 1 - 10 * (u.home(now.point("apex"))[2] - height),
                          period=0.002 * u.s, start=1.0, points={"apex": h.apex})
    h.add(fb.Load(h.tag + "helm", h.apex, force=h.force(0, 0, -h.draw(0.2, 0.8)), time=steer))


def _drag(**sizes: float) -> Callable[[Host], None]:
    def feature(h: Host) -> None:
        u, by = h.u, h.draw(0.3, 3.0)
        unit = {"normal": u.kg / u.m**2, "tangential": u.kg / u.m**2, "linear": u.kg / u.m / u.s}
        h.add(fb.Drag(h.tag + "water", h.all, **{name: size * by * unit[name] for name, size in sizes.items()}))
    return feature


def _load(name: str, **options: Any) -> Callable[[Host], None]:
    def feature(h: Host) -> None:
        given = {key: of(h) if callable(of) else of for key, of in options.items()}
        force = np.array((0.1, 0, -h.draw(0.2, 0.8)))
        # what follows is given along the directors
        h.add(fb.Load(h.tag + name, h.apex, force=h.u.N * force if "follower" in given else h.force(*force), **given))
    return feature


Y, X = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
CONTACTS: dict[str, Callable[[Host], None]] = {
    "slider": _slide(),
    "slider with viscous friction": _slide(friction=lambda h: fb.Friction(0, viscous=2 * h.u.N * h.u.s / h.u.m)),
    "slider with friction": _slide(friction=lambda h: h.draw(0.1, 0.4)), "slider with elastic stop": _elastic_stops,
    "sleeve with friction": _slide(fb.Sleeve, friction=lambda h: h.draw(0.1, 0.4), length=lambda h: h.draw(0.05, 0.15) * h.u.m),
    "one-sided slider": _slide(one_sided=lambda h: h.u.way(1, 0, 0)), "sleeve": _slide(fb.Sleeve),
    "sleeve with a bore": _slide(fb.Sleeve, length=lambda h: h.draw(0.05, 0.15) * h.u.m),
    "slider on a drive": _slide(drive=lambda h: fb.Drive(force=_pull(h))),
    "bead": _bead}
JOINTS: dict[str, Callable[[Host], None]] = {
    "ball joint": _joint(fb.BallJoint), "hinge": _joint(fb.RevoluteJoint, ("axis", Y)),
    "hinge with spring": _joint(fb.RevoluteJoint, ("axis", Y), stiffness=lambda h: h.draw(0.1, 1) * h.u.Nm,
                                damping=lambda h: h.draw(0.003, 0.03) * h.u.Nm * h.u.s),
    "hinge with torque": _joint(fb.RevoluteJoint, ("axis", Y), torque=lambda h: lambda t: (0.05 + t / h.u.s) * h.u.Nm),
    "hinge with friction": _joint(fb.RevoluteJoint, ("axis", Y), friction=lambda h: h.draw(1e-4, 1e-2) * h.u.Nm),
    "universal joint": _joint(fb.UniversalJoint, ("axis_a", Y), ("axis_b", X)),
    "cylindrical joint": _joint(fb.CylindricalJoint, ("axis", X)),
    "screw joint": _joint(fb.ScrewJoint, ("axis", X), pitch=lambda h: h.draw(0.05, 0.2) * h.u.m),
    "rack and pinion": _rack,
    "prismatic joint": _joint(fb.PrismaticJoint, ("axis", (1, 0, 1))),
    "planar joint": _joint(fb.PlanarJoint, ("normal", Y)),
    "spherical joint": _joint(fb.SphericalJoint, ("axis", X), stiffness=lambda h: (0.2 * h.u.Nm,) * 2,
                              damping=lambda h: (0.01 * h.u.Nm * h.u.s,) * 2)}
FORCES: dict[str, Callable[[Host], None]] = {
    "body": _body, "point mass": _point_mass, "hanging mass": _hanging, "bushing": _bushing,
    "spring": _spring(stiffness=lambda h: h.draw(10, 100) * h.u.N / h.u.m),
    "rope": _spring(stiffness=lambda h: h.draw(10, 100) * h.u.N / h.u.m, tension_only=lambda h: True),
    "spring by a table": _spring(table=_table),
    "damper": lambda h: h.add(fb.Damper(h.ground(), h.apex, h.tag + "damper", damping=h.draw(0.3, 3) * h.u.N * h.u.s / h.u.m)),
    "line force": _line_force, "force element": _force_element, "user force": _user_force, "wind": _wind,
    "follower load": _load("follower", follower=True), "load in time": _load("late", time=lambda h: lambda t: 1 + 20 * t / h.u.s),
    "moving support": _motion, "line load": _line_load, "controller": _controller,
    "drag": _drag(normal=2.0, tangential=0.1), "linear drag": _drag(linear=0.5),
    "peg that lets go": lambda h: h.add(fb.Pin(h.inner, h.tag + "peg", until=6.5e-3 * h.u.s)),
    "peg that takes hold": lambda h: h.add(fb.Pin(h.inner, h.tag + "peg", since=6.5e-3 * h.u.s))}
PARTS = CONTACTS | JOINTS | FORCES


# ---- what is found -----------------------------------------------------------------------------------------------------------

class Found(NamedTuple):
    """What an analysis found: numbers at home with what they are small against, words without numbers, and how far the books
    are from closing, next to what went through them."""

    numbers: dict[str, tuple[Array, float]]
    words: tuple[str, ...]
    balance: float = 0.0


def _size(x: Any) -> float:
    return float(np.max(np.abs(x), initial=0.0))


def _simulate(h: Host, **options: Any) -> Found:
    u = h.u
    # steps with filters have no reactions
    observe = ("energy", "momentum", "slider", "joint", *(() if "method" in options else ("reaction",)))
    run = fb.simulate(fb.compile_scene(h.scene, planar=False), t_end=STEPS * H * u.s, step=H * u.s, every=1,
                      output=fb.Output(snapshots=0),
                      progress=False, points=h.points, observe=observe, **options)
    # the potential of loads and of gravity depends on where the scene is
    apex, inner = u.home(run.point("apex")), (run.series["kinetic"] + run.series["strain"]) / u.Nm
    numbers = {"apex": (apex, _size(apex - apex[0])), "energy": (inner, _size(inner))}
    if "reaction" in observe:
        force = u.back(run.reaction("foot")["force"], u.N)
        numbers["force"] = force, _size(force)
    if h.slider:
        s = run.slider(h.slider)["s"] / u.m
        push = u.back(run.slider(h.slider)["force"], u.N)
        numbers |= {"s": (s, _size(apex - apex[0])), "contact": (push, _size(push))}
    events = sorted(event["kind"] for event in run.events)
    books = "balance" if "balance" in run.series else "total"
    # the potential of the weight is a sum of products with places, which may cancel: then it is no measure of their round-off
    scale = run.info["scale"][books]
    cancel = max(1.0, float(np.abs(h.weight) @ np.abs(run.point("apex")[0])) / scale)
    return Found(numbers, (f"{len(run.t)} rows", *events), run.drift(books) / cancel)


def _rests(h: Host, result: fb.Result, **words: Any) -> Found:
    u = h.u
    apex, start = u.home(result.point("apex")[-1]), u.home(h.scene.position_of(h.apex))
    numbers = {"apex": (apex, _size(apex - start))}
    if "method" not in words:
        force = u.back(result.reaction("foot")["force"][-1], u.N)
        numbers["force"] = force, _size(force)
    return Found(numbers, tuple(f"{name}: {word}" for name, word in words.items()))


def _at(h: Host) -> dict[str, Any]:
    return {"at_time": 0.01 * h.u.s}


def _static(h: Host, **options: Any) -> fb.Result:
    return fb.solve_static(fb.compile_scene(h.scene, planar=False), points=h.points, observe=("energy", "reaction"), **_at(h),
                           **options)


def _solve_static(h: Host) -> Found:
    found = _static(h)
    return _rests(h, found, unstable=found.info["unstable_directions"], free=found.info["free_directions"],
                  events=sorted(event["kind"] for event in found.events))


def _solve_path(h: Host) -> Found:
    found = fb.solve_path(fb.compile_scene(h.scene, planar=False), points=h.points, observe=("energy", "reaction"), **_at(h))
    return _rests(h, found, critical=[point["kind"] for point in found.info["critical_points"]],
                  events=sorted(event["kind"] for event in found.events))


def _relax(h: Host) -> Found:
    found = fb.relax(fb.compile_scene(h.scene, planar=False), points=h.points, **_at(h))
    return _rests(h, found, method="relax", events=sorted(event["kind"] for event in found.events))


def _modes(h: Host, **options: Any) -> Found:
    model = fb.compile_scene(h.scene, planar=False)
    found = fb.modes(model, state=_static(h).state, n=6, **_at(h), **options)
    values = found.rates * h.u.s if options else found.squared * h.u.s**2
    return Found({"values": (values, _size(values))}, (f"{values.size}",))


def _frequency_response(h: Host) -> Found:
    u = h.u
    found = fb.frequency_response(fb.compile_scene(h.scene, planar=False), np.array((0.0, 3.0, 11.0)) / u.s, points=h.points,
                                  state=_static(h).state, loads=fb.Load("probe", h.apex, force=h.force(0.3, 0.1, 1.0)), **_at(h))
    apex = u.back(found.point("apex"), u.m)
    return Found({"apex": (apex, _size(apex))}, ())


def _family(h: Host) -> Callable[..., Any]:
    def build(k: float = 1.0, h: float = 1.0) -> Any:
        other = Host(*made, k=k, h=h)
        return other.scene, other.points
    made = h.made
    return build


def _sensitivity(h: Host) -> Found:
    found = fb.sensitivity(_family(h), {"k": 1.0, "h": 1.0}, **_at(h)).point("apex")
    numbers = {name: h.u.back(found[name], h.u.m) for name in ("k", "h")}
    return Found({f"by {name}": (x, _size(x)) for name, x in numbers.items()}, ())


def _critical(h: Host) -> Found:
    """The first critical load, and its derivatives where it is a limit."""
    model = fb.compile_scene(h.scene, planar=False)
    found = fb.solve_path(model, to=20.0, stop_at="limit", most_points=300, **_at(h))
    kinds = [point["kind"] for point in found.info["critical_points"]]
    load = found.series["load_factor"][-1]
    numbers: dict[str, tuple[Array, float]] = {"load": (np.array(load), load)}
    if kinds[-1:] == ["limit"]:
        by = fb.critical_sensitivity(_family(h), {"k": 1.0, "h": 1.0}, state=found.state, load_factor=load, **_at(h)).by
        numbers |= {f"by {name}": (np.asarray(by[name]), abs(load)) for name in ("k", "h")}
    return Found(numbers, tuple(kinds))


def _buckling(h: Host) -> Found:
    model = fb.compile_scene(h.scene, planar=False)
    found = fb.critical_loads(model, state=_static(h).state, load_factor=1.0, n=2, **_at(h))
    # those far beyond what a scene can bear are of stiff strains
    change = np.minimum(found.change, 1e3)
    return Found({"change": (change, _size(change))}, (f"{len(found)}", *sorted(event["kind"] for event in found.events)))


def _adjoint_run(h: Host) -> Found:
    u = h.u
    run = fb.adjoint_run(fb.compile_scene(h.scene, planar=False), points=h.points, t_end=8 * H * u.s, step=H * u.s)
    by = run.gradient(points={"apex": u.way(0.5, 0, 1)}, build=_family(h), values={"k": 1.0, "h": 1.0}).by
    numbers = {name: np.asarray(by[name]) / u.m for name in ("k", "h")}
    return Found({f"by {name}": (x, _size(list(numbers.values()))) for name, x in numbers.items()}, ())


ANALYSES: dict[str, Callable[[Host], Found]] = {
    "simulate": _simulate, "simulate with rho_inf": lambda h: _simulate(h, method=fb.Method(rho_inf=0.8)),
    "simulate with order 4": lambda h: _simulate(h, order=4), "solve_static": _solve_static, "solve_path": _solve_path,
    "relax": _relax, "modes": _modes, "damped modes": lambda h: _modes(h, damped=True),
    "frequency_response": _frequency_response, "sensitivity": _sensitivity, "critical load": _critical,
    "adjoint_run": _adjoint_run, "linear buckling": _buckling}
# those that go on where a law fails, if they do so without a word
ASK_LAWS = ("simulate", "simulate with rho_inf", "solve_static", "solve_path", "relax")
LAWS = ("user force", "line force", "force element")


def _words(text: str) -> str:
    return re.sub(r"[-+]?\d[\d.e+-]*", "..", text)[:120]


def found_in(name: str, host: Host) -> Found:
    """What an analysis finds; a refusal is a finding, whose words have to be the same."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fb.ResultWarning)
            return ANALYSES[name](host)
    except (fb.SceneError, fb.ConvergenceError) as refusal:
        return Found({}, (type(refusal).__name__, _words(str(refusal))))


# ---- numbers of scenes -------------------------------------------------------------------------------------------------------

class Family(NamedTuple):
    """Features of which a scene has three; those of the arch beside it, which hold all the kinds of tables that these need; and
    analyses."""

    features: tuple[str, ...]
    yard: tuple[str, ...]
    analyses: tuple[str, ...]


BARE = ("coupled section", "prestress", "gravity", "ball joint", "line load", "peg that lets go", "peg that takes hold")
FAMILIES = {
    "bare": Family(BARE, (), tuple(ANALYSES)),
    "joints": Family((*BARE, "slider", "one-sided slider", "slider with elastic stop", "slider on a drive", "bead", "hinge",
                      "hinge with spring", "hinge with torque", "universal joint", "cylindrical joint", "prismatic joint",
                      "planar joint", "spherical joint", "body", "point mass", "hanging mass", "spring", "bushing",
                      "slider with viscous friction", "slider with friction"),
                     ("slider with viscous friction", "hinge with spring", "spring", "hanging mass"), tuple(ANALYSES)),
    "gears": Family((*BARE, "screw joint", "rack and pinion", "hinge with spring", "hinge with friction", "slider", "body",
                     "spring"), ("rack and pinion", "hinge with friction", "slider", "spring"), tuple(ANALYSES)),
    "laws": Family((*BARE, "section damping", "user force", "line force", "force element", "load in time", "gravity in time",
                    "controller", "rope", "spring by a table", "damper", "drag", "linear drag", "follower load",
                    "moving support", "body", "point mass"),
                   ("section damping", "user force", "line force", "force element", "load in time", "moving support", "rope",
                    "drag", "body"),
                   tuple(ANALYSES)),
    "friction": Family((*BARE, "sleeve", "sleeve with a bore", "sleeve with friction", "slider with friction", "hinge",
                        "hinge with friction", "universal joint", "wind", "moving support"),
                       ("sleeve with friction", "hinge with friction", "moving support", "wind"), tuple(ANALYSES))}


def scene_of(family: str, number: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Three features and three analyses of a scene: at most one contact, and two joints."""
    draw, of = np.random.default_rng((number, 3)), FAMILIES[family]
    while True:
        features = tuple(str(x) for x in draw.choice(of.features, 3, replace=False))
        contacts, joints = (sum(x in group for x in features) for group in (CONTACTS, JOINTS))
        if contacts <= 1 and joints <= 2:
            break
    return features, tuple(str(x) for x in draw.choice(of.analyses, 3, replace=False))


class Compared(NamedTuple):
    """One analysis of one scene: what went wrong, or nothing; the largest difference from home next to what is compared, and
    next to the round-off that the scene makes; whether it was refused, or an event said that steps are not resolved."""

    wrong: str
    difference: float = 0.0
    ratio: float = 0.0
    balance: float = 0.0
    refused: bool = False
    told: bool = False


# round-off, next to what numbers change by that differ in their last places, and next to the size of a result; derivatives by
# parameters are differences over scenes that differ by 1/256, and places are of the order of a metre: one bit of these, divided
TIMES, FLOOR, DIFFERENCES, ONE_BIT = 100.0, 1e-12, 1e-11, 256 * EPS
# scenes that differ in their last places, where one of them does not tell how much round-off there is
NUDGES = 4


def compared(name: str, family: str, features: tuple[str, ...], seed: int) -> Compared:
    """An analysis of a scene at home and away."""
    def at(frame: Frame) -> Found:
        return found_in(name, Host(family, features, seed, frame))

    home, near, far = at(Frame()), [at(nudged(seed))], at(away(seed))
    if not home.words == near[0].words == far.words:
        return Compared(f"{home.words} at home, {near[0].words} nudged, {far.words} away")
    balance, told = max(home.balance, far.balance), "unresolved" in home.words
    wrong = f"books off by {balance:.1e}" if balance > BALANCE else ""
    if told:
        # which of several solutions such a step takes is left to round-off
        return Compared(wrong, balance=balance, told=True)
    moved, beside = 1.0 + float(np.linalg.norm(away(seed).shift)), list[Found]()
    differences, ratios = [0.0], [0.0]
    for what, (x, size) in home.numbers.items():
        off = _size(far.numbers[what][0] - x)
        floor = DIFFERENCES * size + ONE_BIT if what.startswith("by ") else FLOOR * size

        def times() -> float:
            own, others = ([_size(one.numbers[what][0] - to) for one in those if one.words == home.words]
                           for those, to in ((near, x), (beside, far.numbers[what][0])))
            # the median, so that one that takes another branch does not count
            most = max(moved * (TIMES * max(own) + floor), TIMES * float(np.median(others or [0.0])))
            return off / (most or 1.0)

        if times() > 1.0 and len(near) == 1:
            near += [at(nudged(seed + k * 1000)) for k in range(1, NUDGES)]
        if times() > 1.0 and not beside:
            beside += [at(nudged(seed + k * 1000, away(seed))) for k in range(1, NUDGES)]
        differences.append(off / (size or 1.0))
        ratios.append(times())
        if ratios[-1] > 1.0:
            wrong += f"{what} off by {off:.1e} of {size:.1e}, {ratios[-1]:.1e} times the round-off; "
    return Compared(wrong, max(differences), max(ratios), balance, not home.numbers)


def silent(name: str, family: str, features: tuple[str, ...], seed: int) -> str:
    """Whether an analysis goes on where a law fails, beyond four tenths of the way that it goes: what it says, or nothing."""
    for frame in (Frame(), away(seed)):
        host = Host(family, features, seed, frame)
        found = found_in(name, host)
        if not found.numbers or (reach := host.reach(found.numbers["apex"][0])) <= 1e-6:
            return ""
        failing = found_in(name, Host(family, features, seed, frame, limit=0.4 * reach))
        if failing.numbers or not any(f"'{law}'" in failing.words[1] for law in host.laws):
            return f"{failing.words} where a law of {host.laws} failed"
    return ""
