"""Features, each hung on the apex of a shallow clamped arch with a force on it, so that it moves and carries something.

The arch lies in the x-z plane; it has an equilibrium, a limit load and vibrations, and may snap.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

import fastbeam as fb

RISE = 0.15  # m, of an arch of 2 m


class MakesNoSense(Exception):
    """A feature and an analysis that have nothing to do with each other."""


def section_of(k: float = 1.0, damping: float = 0.0) -> fb.Section:
    """The section of the arch, whose stiffness is k times that of the arch at home."""
    return fb.Section(EA=1e4 * k, GA2=4e3 * k, GA3=4e3 * k, GJ=2 * k, EI2=k, EI3=4 * k, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5,
                      damping=damping)


class Host:
    """The arch with a feature.

    k, h: factors of stiffness and height, for derivatives. net: the arch is a net. lateral: factor of loads across, 0 for spins.
    extra: force on the apex, N. prestrain: of the left beam.
    """

    def __init__(self, feature: str, k: float = 1.0, h: float = 1.0, net: bool = False, lateral: float = 1.0,
                 extra: tuple[float, float, float] = (0.0, 0.0, 0.0), prestrain: float | None = None) -> None:
        self.k, self.rise, self.is_net, self.prestrain, self.lateral, self.made = k, RISE * h, net, prestrain, lateral, False
        self.parts: list[Any] = []
        self.scene_options: dict[str, Any] = {}
        self.planar, self.contact, self.friction, self.at_time = True, None, None, None
        self.moved = False      # by a given motion, which stands still in paths and in relax
        self.expect = None      # the kind of event that a run has
        FEATURES[feature](self)
        self.arch()
        self.add(fb.Load("weight", self.apex, force=(0.3 * lateral, 0, -1.5)))
        if any(extra):
            self.add(fb.Load("extra", self.apex, force=extra))
        self.points = {"apex": self.apex, "root": (self.left, 0.0)}
        self.scene = fb.Scene(*self.parts, project_velocities=True, **self.scene_options)

    def add(self, *parts: Any) -> None:
        """Add parts to the scene."""
        self.parts += parts

    def facts(self, **facts: Any) -> None:
        """Say what analyses have to know of the feature."""
        self.__dict__.update(facts)

    def arch(self, curved: bool = False, section: fb.Section | None = None, **options: Any) -> None:
        """Make the arch, once: left, right, apex, an inner node, and all (what drag acts on)."""
        if self.made:
            return
        self.made = True
        more = {"elements": 2, "section": section or section_of(self.k), **options}
        ends = self._net(more) if self.is_net else self._beams(curved, more)
        self.add(fb.Clamp(ends[0], "foot"), fb.Clamp(ends[1], "abutment"))

    def _net(self, more: dict[str, Any]) -> tuple[Any, Any]:
        nodes = [(x, 0, self.rise * (1 - abs(x))) for x in np.linspace(-1, 1, 9)]
        if self.prestrain is not None:
            more["prestrain"] = self.prestrain
        self.all = net = fb.Net("arch", nodes, [(i, i + 1) for i in range(8)], **more)
        self.left, self.right, self.apex, self.inner = net.beam(0), net.beam(4), net.node(4), net.node(6)
        self.add(net)
        return net.node(0), net.node(8)

    def _beams(self, curved: bool, more: dict[str, Any]) -> tuple[Any, Any]:
        top = (0, 0, self.rise)
        first = dict(more, prestrain=self.prestrain, prestress=0.0) if self.prestrain is not None else more
        if curved:
            angle = math.asin(2 * self.rise / (1 + self.rise ** 2))
            c, s, radius = math.cos(angle), math.sin(angle), (1 + self.rise ** 2) / (2 * self.rise)
            self.left = fb.Beam.arc("left", (-1, 0, 0), (c, 0, s), (s, 0, -c), radius=radius, angle=angle, **first)
            self.right = fb.Beam.arc("right", top, (1, 0, 0), (0, 0, -1), radius=radius, angle=angle, **more)
        else:
            self.left = fb.Beam.straight("left", (-1, 0, 0), top, **first)
            self.right = fb.Beam.straight("right", top, (1, 0, 0), **more)
        self.apex, self.all = self.left.end, self.left
        if more.get("interpolation") != "bspline":
            self.inner = self.right.node(3)
        self.add(self.left, self.right, fb.RigidConnection(self.left.end, self.right.start))
        return self.left.start, self.right.end

    def place(self, x: float = 0.0, z: float = 0.0) -> tuple[float, float, float]:
        """A point, from the apex."""
        self.arch()
        return (x, 0, self.rise + z)

    def arm(self, joint: Callable[[Any, Any], Any], x: float = 0.0) -> None:
        """Add a soft beam, clamped at its far end, that joint(apex, start) fixes to the apex."""
        self.arch()
        soft = fb.Section(EA=300, GA2=100, GA3=100, GJ=0.05, EI2=0.05, EI3=0.05, rhoA=0.05, rhoI2=1e-5, rhoI3=1e-5)
        arm = fb.Beam.straight("arm", self.place(x), self.place(x + 0.8), section=soft, elements=2)
        self.add(arm, fb.Clamp(arm.end, "wall"), joint(self.apex, arm.start))

    def rail(self, cuts: tuple[float, ...] = (), elements: Any = 4) -> list[fb.Beam]:
        """Add a stiff vertical beam through the apex, cut at heights above the apex, and return its pieces."""
        self.arch()
        z = [-0.6, *(self.rise + cut for cut in cuts), 0.8]
        if self.is_net:
            n = len(z)
            # eight equal rails, as many as are condensed together; one is used
            net = fb.Net("rails", [(x, 0, a) for x in (0, *range(2, 9)) for a in z],
                         [(n * j + i, n * j + i + 1) for j in range(8) for i in range(n - 1)],
                         section=section_of(20), elements=elements, clamps=[n * j + i for j in range(8) for i in (0, n - 1)])
            self.add(net)
            return [net.beam(i) for i in range(n - 1)]
        beams = [fb.Beam.straight(f"rail {i}", (0, 0, z[i]), (0, 0, z[i + 1]), section=section_of(20), elements=elements)
                 for i in range(len(z) - 1)]
        self.add(*beams, fb.Clamp(beams[0].start), fb.Clamp(beams[-1].end))
        self.add(*(fb.RigidConnection(a.end, b.start) for a, b in zip(beams, beams[1:])))
        return beams

    def slide(self, kind: Any = fb.Slider, **options: Any) -> None:
        """Let the apex slide on a rail; options that are functions take its place on it."""
        self.contact = "s"
        rail, = self.rail()
        at = 0.6 + self.rise
        self.add(kind("s", self.apex, rail, at=at, **{a: b(at) if callable(b) else b for a, b in options.items()}))


# ---- features ----------------------------------------------------------------------------------------------------------------

def line_law(t, length, rate, parameters):  # type: ignore[no-untyped-def]
    return parameters[0] * (length - parameters[1]) + parameters[2] * rate


def element_law(t, position, rotation, velocity, spin, parameters, force, moment):  # type: ignore[no-untyped-def]
    force[:] = -parameters[0] * position - parameters[1] * velocity


def user_law(t, position, directors, velocity, spin, parameters, force, moment):  # type: ignore[no-untyped-def]
    force[2] = -parameters[0] * position[2] - parameters[1] * velocity[2]


def wind_law(t, position, parameters, velocity):  # type: ignore[no-untyped-def]
    velocity[0] = parameters[0] * (1.0 + position[2])


def coupled(k: float) -> fb.Section:
    c = np.diag([1e4, 4e3, 4e3, 2.0, 1.0, 4.0]) * k
    for i, j, share in ((0, 5, 0.2), (0, 3, 0.1), (3, 4, 0.2), (1, 3, 0.1)):
        c[i, j] = c[j, i] = share * math.sqrt(c[i, i] * c[j, j])
    return fb.Section.from_matrix(c, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5)


def revolute(h: Host, **options: Any) -> None:
    h.arm(lambda a, b: fb.RevoluteJoint(a, b, "j", axis=(0, 1, 0), **options))


def gear(h: Host) -> None:
    joints: list[Any] = []
    h.arm(lambda a, b: joints.append(fb.RevoluteJoint(a, b, "j", axis=(0, 1, 0))) or joints[0])
    wheel = fb.RigidBody("wheel", mass=0.2, inertia=(1e-3, 2e-3, 1e-3), position=h.place(0.3, 0.5))
    spring = fb.RevoluteJoint(ground(h, 0.3, 0.5), wheel, "spring", axis=(0, 1, 0), stiffness=0.2)
    h.add(wheel, spring, fb.GearCoupling(joints[0], spring, "gear", ratio=-1.5))


def twisted(h: Host) -> None:
    h.slide(fb.Sleeve, keyed=False, length=0.1, friction=0.2, radius=0.02)
    h.add(fb.Load("twist", h.apex, moment=(0, 0, 0.02)))
    h.facts(friction="s", planar=False)


def closed_path(h: Host) -> None:
    corners = [h.place(x, z) for x, z in ((0, -0.001), (0, 0.4), (0.4, 0.55), (0.8, 0), (0.4, -0.55), (0, -0.4))]
    ring = [fb.Beam.straight(f"ring {i}", a, b, section=section_of(20), elements=3)
            for i, (a, b) in enumerate(zip(corners, corners[1:] + corners[:1]))]
    h.add(*ring, *(fb.RigidConnection(a.end, b.start) for a, b in zip(ring, ring[1:] + ring[:1])))
    h.add(fb.Clamp(ring[0].end), fb.Clamp(ring[4].end))
    h.facts(contact="s")
    h.add(fb.Slider("s", h.apex, on=fb.Path("p", ring, closed=True), at=0.001))


def switch(h: Host) -> None:
    lower, upper = h.rail(cuts=(-0.0036,), elements=3)       # below the equilibrium, within reach of runs
    side = fb.Beam.straight("side", (0.1, 0, -0.6), h.place(0, -0.0036), section=section_of(20), elements=3)
    ways = fb.Switch("yard", [lower, side, upper], choose={"s": lower.name})
    h.facts(contact="s", expect="switched")
    h.add(side, fb.Clamp(side.start), fb.RigidConnection(side.end, lower.end),
          fb.Slider("s", h.apex, on=ways, at=ways.offset(upper) + 0.0036))


def crossing(h: Host, **options: Any) -> None:
    h.arch()
    y = fb.Beam.straight("cable", (0.5, -0.5, h.rise / 2), (0.5, 0.5, h.rise / 2), section=section_of(1), elements=2)
    cross = fb.Crossing("x", h.right, y, at=(0.5 * math.hypot(1, h.rise) if not h.is_net else 0, 0.5), **options)
    if h.is_net:
        raise MakesNoSense("here: the net has a node where the beams cross")
    h.facts(planar=False, contact=cross.name_a)
    h.add(y, fb.Clamp(y.start), fb.Clamp(y.end), cross)


def moving_mesh(h: Host) -> None:
    rail, = h.rail(elements=[0, 0.3, 0.6 + h.rise, 1.1, 1.4] if not h.is_net else 28)
    slider = fb.Slider("s", h.apex, rail, at=0.6 + h.rise)
    h.facts(contact="s")
    h.add(slider, fb.MovingMesh(rail, slider))


def body(h: Host) -> None:
    weight = fb.RigidBody("body", mass=0.2, inertia=(1e-3, 2e-3, 2e-3), position=h.place(0, 0.1))
    h.add(weight, fb.RigidConnection(h.apex, weight))


def point_mass(h: Host) -> None:
    mass = fb.PointMass("mass", mass=0.2, position=h.place())
    h.add(mass, fb.BallJoint(h.apex, mass))


def bspline(h: Host) -> None:
    if h.is_net:
        raise MakesNoSense("nets have Lagrange elements")
    h.arch(interpolation="bspline", elements=4)


def curved(h: Host) -> None:
    if h.is_net:
        raise MakesNoSense("nets have straight beams")
    h.arch(curved=True)


def in_space(h: Host) -> None:
    h.arch()
    h.facts(planar=False)
    h.add(fb.Load("side", h.apex, force=(0, 0.2 * h.lateral, 0)))


Act = Callable[[Host], None]


def with_arch(**options: Any) -> Act:
    return lambda h: h.arch(**options)


def added(make: Callable[[Host], Any], **facts: Any) -> Act:
    """A feature that adds make(h) to the arch."""
    def row(h: Host) -> None:
        h.arch()
        h.facts(**facts)
        found = make(h)
        h.add(*(found if isinstance(found, tuple) else (found,)))
    return row


def joined(make: Callable[[Any, Any], Any], **facts: Any) -> Act:
    def row(h: Host) -> None:
        h.facts(**facts)
        h.arm(make, x=facts.get("x", 0.0))
    return row


def sliding(kind: Any = fb.Slider, facts: Mapping[str, Any] = MappingProxyType({}), **options: Any) -> Act:
    def row(h: Host) -> None:
        h.slide(kind, **options)
        h.facts(**facts)
    return row


def turning(facts: Mapping[str, Any] = MappingProxyType({}), **options: Any) -> Act:
    def row(h: Host) -> None:
        h.facts(**facts)
        revolute(h, **options)
    return row


def falling(**options: Any) -> Act:
    return lambda h: h.facts(scene_options={"gravity": (0, 0, -9.81), **options}, at_time=0.02 if options else None)


def ground(h: Host, x: float = 0.3, z: float = 1.0) -> Any:
    return fb.GROUND.point(h.place(x, z))


TIMED = {"at_time": 0.02}
FEATURES: dict[str, Act] = {
    "plain beam in space": in_space, "planar beam": with_arch(), "B-spline beam": bspline,
    "Green-Lagrange beam": with_arch(strain="green_lagrange"), "curved beam": curved,
    "coupled 6x6 section": lambda h: (h.facts(planar=False), h.arch(section=coupled(h.k))),
    "net": lambda h: (h.facts(is_net=True), h.arch()), "rigid body": body, "point mass": point_mass,
    "clamp/pin with axes": added(lambda h: (fb.Clamp(h.apex, "guide", axes="y"), fb.Pin(h.inner, "roller", axes="x"))),
    "rigid connection": joined(lambda a, b: fb.RigidConnection(a, b)), "ball joint": joined(lambda a, b: fb.BallJoint(a, b)),
    "distance joint": joined(lambda a, b: fb.DistanceJoint(a, b), x=0.2), "revolute": turning(),
    "revolute spring+damper": turning(stiffness=0.5, damping=0.01),
    "revolute torque": turning(TIMED, torque=lambda t: 0.05 + t),
    "revolute angle": turning({"moved": True, **TIMED}, angle=lambda t: 30 * t * t),
    "revolute friction": turning({"friction": "j"}, friction=3e-4),
    "revolute rigid stops": turning({"expect": "impact"}, stops=fb.Stops(-0.001, 0.001, restitution=0.5)),
    "revolute load friction": turning({"friction": "j"}, coefficient=0.1, radius=0.02),
    "revolute elastic stops": turning(stops=fb.Stops(-0.001, 0.001, stiffness=50.0)),
    "revolute drive": turning(drive=fb.Drive(position=0.02, stiffness=0.5, damping=0.01)),
    "universal": joined(lambda a, b: fb.UniversalJoint(a, b, "j", axis_a=(0, 1, 0), axis_b=(1, 0, 0))),
    "cylindrical": joined(lambda a, b: fb.CylindricalJoint(a, b, "j", axis=(1, 0, 0))),
    "cylindrical friction": joined(lambda a, b: fb.CylindricalJoint(a, b, "j", axis=(1, 0, 0), friction=(1e-3, 0.05)),
                                   friction="j"),
    "screw": joined(lambda a, b: fb.ScrewJoint(a, b, "j", axis=(1, 0, 0), pitch=0.1)), "gear": gear,
    "prismatic": joined(lambda a, b: fb.PrismaticJoint(a, b, "j", axis=(1, 0, 1))),
    "planar joint": joined(lambda a, b: fb.PlanarJoint(a, b, "j", normal=(0, 1, 0))),
    "spherical": joined(lambda a, b: fb.SphericalJoint(a, b, "j", axis=(1, 0, 0), stiffness=(0.2, 0.2), damping=(0.01, 0.01))),
    "slider frictionless": sliding(), "slider viscous": sliding(friction=fb.Friction(0.0, viscous=2.0)),
    "slider Coulomb": sliding(facts={"friction": "s"}, friction=0.3),
    "slider smoothed friction": sliding(friction=fb.Friction(0.3, smoothing=0.01)), "slider own curve": sliding(curve="own"),
    "slider drive with limit": sliding(drive=lambda at: fb.Drive(position=at + 0.01, stiffness=300.0, damping=2.0, limit=0.8)),
    "slider speed drive": sliding(facts=TIMED, drive=fb.Drive(speed=lambda t: -20 * t)),
    "slider force drive": sliding(drive=lambda at: fb.Drive(force=lambda t, s, rate: -40 * (s - 0.7) - 0.5 * rate)),
    "slider elastic stops": sliding(stops=lambda at: fb.Stops(start=at - 0.001, stiffness=1e3)),
    "slider rigid stops": sliding(stops=lambda at: fb.Stops(start=at - 0.001, restitution=0.5), facts={"expect": "impact"}),
    "slider lock": sliding(lock=lambda at: fb.Lock(at=at - 0.001), facts={"expect": "locked"}),
    "slider release": sliding(release=fb.Release(0.0105), facts={"expect": "released"}),
    "slider one-sided": sliding(one_sided=(1, 0, 0)), "sleeve keyed": sliding(fb.Sleeve),
    "sleeve unkeyed twist friction": twisted,
    "sleeve bore length": sliding(fb.Sleeve, length=0.1),
    "sleeve friction": sliding(fb.Sleeve, facts={"friction": "s"}, length=0.1, friction=0.2),
    "slider on Path": lambda h: (h.facts(contact="s"), h.add(fb.Slider("s", h.place() and h.apex, on=fb.Path(
        "p", h.rail(cuts=(-0.001,), elements=3)), at=0.6 + h.rise))),
    "slider closed Path": closed_path, "slider on Switch": switch, "Crossing": crossing,
    "Crossing friction": lambda h: crossing(h, friction=0.1), "MovingMesh slider": moving_mesh,
    "spring": added(lambda h: fb.Spring(ground(h), h.apex, "e", stiffness=50.0)),
    "spring tension-only": added(lambda h: fb.Spring(ground(h), h.apex, "e", stiffness=50.0, tension_only=True)),
    "spring table": added(lambda h: fb.Spring(ground(h), h.apex, "e", table=([-0.1, 0, 0.005, 0.1], [-4, 0, 0.3, 8]))),
    "damper": added(lambda h: fb.Damper(ground(h), h.apex, "e", damping=1.0)),
    "bushing": added(lambda h: fb.Bushing(fb.GROUND.point(h.place()), h.apex, "e", stiffness=(20, 20, 20, 0.1, 0.1, 0.1),
                                          damping=(0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3))),
    "line force law": added(lambda h: fb.LineForce(ground(h), h.apex, "e", law=line_law, parameters=(50.0, 1.04, 0.5))),
    "force element law": added(lambda h: fb.ForceElement(fb.GROUND.point(h.place()), h.apex, "e", law=element_law,
                                                         parameters=(20.0, 0.2))),
    "user force": added(lambda h: fb.UserForce("u", h.apex, user_law, parameters=(5.0, 0.2))),
    "follower load": added(lambda h: fb.Load("f", h.apex, force=(0, 0, -0.8), follower=True)),
    "distributed load": added(lambda h: fb.DistributedLoad("d", h.left, force=(0, 0, -1))),
    "load with time": added(lambda h: fb.Load("f", h.apex, force=(0, 0, -0.8), time=lambda t: 1 + 20 * t), **TIMED),
    "gravity": falling(), "gravity_time": falling(gravity_time=lambda t: 1 + 20 * t),
    "prescribed motion": added(lambda h: fb.PrescribedMotion("m", h.right.end if not h.is_net else h.all.node(8),
                                                             displacement=lambda t: (-5 * t * t, 0, 0)), moved=True, **TIMED),
    "clamp until=": added(lambda h: fb.Clamp(h.inner, "peg", until=0.0105), expect="let go"),
    "clamp since=": added(lambda h: fb.Clamp(h.inner, "peg", since=0.0105), expect="caught"),
    "prestress": with_arch(prestress=20.0), "section damping": lambda h: h.arch(section=section_of(h.k, 1e-3)),
    "drag linear": added(lambda h: fb.Drag("air", h.all, linear=0.5)),
    "drag quadratic": added(lambda h: fb.Drag("air", h.all, normal=2.0, tangential=0.1)),
    "drag with wind": added(lambda h: fb.Drag("air", h.all, normal=2.0, wind=wind_law, parameters=(3.0,))),
    "added mass": added(lambda h: fb.AddedMass("water", h.all, normal=0.1)),
    "winch": added(lambda h: fb.Winch("w", ground(h, 0.0, 0.5), h.apex, stiffness=50.0, mass_per_length=0.02, segments=2,
                                      length_at=lambda t: 0.49 - 20 * t * t), **TIMED),
    "winch with inertia": added(lambda h: fb.Winch("w", ground(h, 0.1, 0.5), h.apex, stiffness=50.0, mass_per_length=0.02,
                                                   segments=2, length=0.49, tension=lambda t: 1.0 + t, total=0.6,
                                                   inertia=0.01), **TIMED),
    "controller": added(lambda h: fb.Load("f", h.apex, force=(0, 0, -0.8), time=fb.Controller(
        "c", lambda now, memory: 1 - 10 * (now.point("apex")[2] - 0.15), period=0.002, start=1.0, points={"apex": h.apex})),
        **TIMED),
}
