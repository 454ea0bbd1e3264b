"""The scenes of the study: beams in large motion, with and without sliding contact, from one rod to a mast of 32 cables.

Every function builds one scene and returns a `Case`: what to run, for how long, with which step, what is observed and what the
exact solution conserves. All data are smooth and no load depends on time, so that the orders of the methods show and the energy
of every scene is an invariant. Sliders start inside an element and cross several. Units are SI.

    elements       of the beam that is slid on (or of every beam)
    degree         polynomial degree
    interpolation  'lagrange' or 'bspline'
    strain         'simo_reissner' or 'green_lagrange'
    directors      'greville' or 'control', of splines only
"""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import fastbeam as fb

Array = np.ndarray
ENERGY = ("total", "gap")
EVERYTHING = ("total", "lin_mom", "ang_mom", "gap")
RUBBER_MASS = 1200.0


@dataclass(frozen=True)
class Case:
    """One scene with everything that a comparison needs.

    Attributes
    ----------
    name, letter : str
        Name of the function that made it; the letter of the scene in the study.
    scene : Scene
    points : dict
        What to observe, as `simulate(points=)` takes it.
    t_end, step : float
        Span of a run and its usual step, s.
    conserved : tuple of str
        Series of the result that are invariants of the exact solution.
    length : float
        Size of the scene that errors are divided by, m.
    period : float
        Period of the slow motion, s: bending, swinging or sliding to and fro.
    text : str
        One sentence on what happens.
    elements : int
        Of the beam that is slid on.
    sliders : tuple of str
        Names of the sliders.
    long : float
        Span over which the largest steps are sought, s: five periods where nothing ends the motion.
    """

    name: str
    letter: str
    scene: fb.Scene
    points: dict[str, Any]
    t_end: float
    step: float
    conserved: tuple[str, ...]
    length: float
    period: float
    text: str
    elements: int
    sliders: tuple[str, ...] = field(default=())
    long: float = 0.0


def _family(elements: int, degree: int, interpolation: str, strain: str, directors: str) -> dict[str, Any]:
    """Arguments of a beam; only splines have a choice of directors."""
    out: dict[str, Any] = {"elements": elements, "degree": degree, "interpolation": interpolation, "strain": strain}
    return out | ({"directors": directors} if interpolation == "bspline" else {})


def _case(name: str, letter: str, scene: fb.Scene, points: dict[str, Any], **facts: Any) -> Case:
    sliders = tuple(slider.name for slider in scene.sliders)
    if not sliders:
        facts["conserved"] = tuple(x for x in facts["conserved"] if x != "gap")
    # free flights end when the slider arrives at the end of its beam
    facts.setdefault("long", facts["t_end"] if "lin_mom" in facts["conserved"] else 5.0 * facts["period"])
    return Case(name, letter, scene, points, sliders=sliders, **facts)


# ----------------------------------------------------------------------------------------------------------- free flight
LENGTH = 10.0


def _rod_section() -> fb.Section:
    """Section of the flying rods: the numbers of the flying spaghetti (Simo and Vu-Quoc 1986)."""
    return fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=500.0, rhoA=1.0, rhoI2=10.0, rhoI3=10.0)


def _bump(s: Array) -> Array:
    """Smooth bump along the rod, flat at both ends."""
    return np.sin(math.pi * s / LENGTH) ** 4


def _bump_slope(s: Array) -> Array:
    x = math.pi * s / LENGTH
    return 4.0 * math.pi / LENGTH * np.sin(x) ** 3 * np.cos(x)


def spaghetti2d(elements: int = 12, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                directors: str = "greville") -> Case:
    """(a) A rod in free plane flight: it drifts, tumbles and bends by a quarter of its length."""
    rod = fb.Beam.straight("rod", (0, 8, 0), (6, 0, 0), section=_rod_section(),
                           **_family(elements, degree, interpolation, strain, directors))
    across = np.array((0.8, 0.6, 0.0))
    bend = fb.InitialVelocity(rod, velocity=lambda s: 12.0 * _bump(s)[:, None] * across,
                              spin=lambda s: 12.0 * _bump_slope(s)[:, None] * np.array((0.0, 0.0, 1.0)))
    scene = fb.Scene(rod, bend, fb.RigidMotion(velocity=(2, 1, 0), spin=(0, 0, 1), about=(3, 4, 0)), name="flying rod, plane")
    return _case("spaghetti2d", "a", scene, {"A": rod.end, "B": rod.start, "middle": (rod, 0.5 * LENGTH)}, t_end=5.0, step=0.02,
                 conserved=EVERYTHING, length=LENGTH, period=1.25, elements=elements,
                 text="a rod of 10 m flies, tumbles and bends in a plane")


def spaghetti3d(elements: int = 12, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                directors: str = "greville") -> Case:
    """(a) The same rod in space: bending about two axes, torsion and tumbling at once."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (LENGTH, 0, 0), section=_rod_section(),
                           **_family(elements, degree, interpolation, strain, directors))

    def velocity(s: Array) -> Array:
        return np.stack((0.0 * s, 10.0 * _bump(s), 6.0 * _bump(s) * np.cos(math.pi * s / LENGTH)), axis=1)

    def spin(s: Array) -> Array:
        """Keeps the sections normal to the rod and twists it."""
        x = math.pi * s / LENGTH
        slope = 6.0 * (_bump_slope(s) * np.cos(x) - math.pi / LENGTH * _bump(s) * np.sin(x))
        return np.stack((2.0 * _bump(s), -slope, 10.0 * _bump_slope(s)), axis=1)

    scene = fb.Scene(rod, fb.InitialVelocity(rod, velocity=velocity, spin=spin),
                     fb.RigidMotion(velocity=(1, 0.5, -0.5), spin=(0.3, 0.5, 0.8), about=(5, 0, 0)), name="flying rod, space")
    return _case("spaghetti3d", "a", scene, {"A": rod.end, "B": rod.start, "middle": (rod, 0.5 * LENGTH)}, t_end=5.0, step=0.02,
                 conserved=EVERYTHING, length=LENGTH, period=1.25, elements=elements,
                 text="a rod of 10 m flies, tumbles, bends and twists in space")


# -------------------------------------------------------------------------------------------------------- swinging, sliding
def pendulum(elements: int = 12, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
             directors: str = "greville") -> Case:
    """(b) A rubber cable is released from the horizontal and swings about its pinned end."""
    rubber = fb.Section.circle(radius=0.015, E=5e6, rho=RUBBER_MASS, name="rubber")
    cable = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0), section=rubber,
                             **_family(elements, degree, interpolation, strain, directors))
    scene = fb.Scene(cable, fb.Pin(cable.start), gravity=(0, -9.81, 0), name="swinging cable")
    return _case("pendulum", "b", scene, {"tip": cable.end, "middle": (cable, 0.5)}, t_end=2.5, step=5e-3, conserved=ENERGY,
                 length=1.0, period=1.6, elements=elements,
                 text="a rubber cable of 1 m swings from the horizontal about its pinned end")


CABLE_ANGLE, CABLE_CHORD = 2.0, 2.0
# where sliders start, as shares of the length: in the middle of an element of the usual meshes
CABLE_START, SKI_START, RAIL_START = 6.5 / 24, 5.5 / 20, 4.5 / 20


def _ring_scene(name: str, axial: float, elements: int, degree: int, interpolation: str, strain: str,
                directors: str) -> tuple[fb.Scene, fb.Beam, fb.PointMass]:
    """Cable between two pins that swings about the line between them, and a ring that runs to and fro on it."""
    r, E, rho = 0.015, 5e6, RUBBER_MASS
    area, second = math.pi * r**2, math.pi * r**4 / 4.0
    GA = axial * 0.9 * E / 2.6 * area
    section = fb.Section(EA=axial * E * area, GA2=GA, GA3=GA, GJ=E / 2.6 * 2.0 * second, EI2=E * second, EI3=E * second,
                         rhoA=rho * area, rhoI2=rho * second, rhoI3=rho * second, name=f"rubber, EA and GA x {axial:g}")
    radius = 0.5 * CABLE_CHORD / math.sin(0.5 * CABLE_ANGLE)
    tangent = np.array((math.cos(0.5 * CABLE_ANGLE), 0.0, -math.sin(0.5 * CABLE_ANGLE)))
    normal = np.array((math.sin(0.5 * CABLE_ANGLE), 0.0, math.cos(0.5 * CABLE_ANGLE)))
    cable = fb.Beam.arc("cable", (0, 0, 0), tangent, normal, radius=radius, angle=CABLE_ANGLE, section=section,
                        **_family(elements, degree, interpolation, strain, directors))
    ring = fb.PointMass("ring", mass=0.3)
    at = CABLE_START * cable.length
    scene = fb.Scene(cable, ring, fb.Pin(cable.start), fb.Pin(cable.end),
                     fb.Slider("ring on cable", ring, cable, at=at, rate=0.0), fb.RigidMotion(cable, spin=(3.0, 0, 0)),
                     gravity=(0, 0, -9.81), name=name, project_velocities=True)
    return scene, cable, ring


def mass_on_cable(elements: int = 24, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                  directors: str = "greville") -> Case:
    """(c) A ring runs to and fro on a sagging cable that swings sideways."""
    scene, cable, ring = _ring_scene("ring on a swinging cable", 1.0, elements, degree, interpolation, strain, directors)
    return _case("mass_on_cable", "c", scene, {"ring": ring, "middle": (cable, 0.5 * cable.length)}, t_end=4.0, step=5e-3,
                 conserved=ENERGY, length=cable.length, period=2.2, elements=elements,
                 text="a ring runs to and fro on a cable that sags between two pins and swings sideways")


def stiff(elements: int = 24, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
          directors: str = "greville") -> Case:
    """(g) The ring on the swinging cable with the ratio EA/EI raised by 1e4: the cable is as good as inextensible."""
    scene, cable, ring = _ring_scene("ring on a stiff cable", 1e4, elements, degree, interpolation, strain, directors)
    return _case("stiff", "g", scene, {"ring": ring, "middle": (cable, 0.5 * cable.length)}, t_end=4.0, step=1e-3,
                 conserved=ENERGY, length=cable.length, period=2.2, long=4.0, elements=elements,
                 text="scene (c, cable) on a cable that is as good as inextensible")


def _ski_scene(name: str, factor: float, elements: int, degree: int, interpolation: str, strain: str,
               directors: str) -> tuple[fb.Scene, fb.Beam, fb.PointMass]:
    """Cantilever curved upwards like a ski, and a mass that runs to and fro on it."""
    section = fb.Section(EA=factor * 2e4, GA2=factor * 1e4, GA3=factor * 1e4, GJ=factor * 1e3, EI2=factor * 1e3, EI3=factor * 1e3,
                         rhoA=1.0, rhoI2=0.5, rhoI3=0.5, name=f"ski, stiffness x {factor:g}")
    down, angle = 0.5, 1.3
    ski = fb.Beam.arc("ski", (0, 0, 0), (math.cos(down), 0, -math.sin(down)), (math.sin(down), 0, math.cos(down)),
                      radius=LENGTH / angle, angle=angle, section=section,
                      **_family(elements, degree, interpolation, strain, directors))
    mass = fb.PointMass("mass", mass=2.0)
    at = SKI_START * LENGTH
    scene = fb.Scene(ski, mass, fb.Clamp(ski.start), fb.Slider("mass on ski", mass, ski, at=at, rate=0.0), gravity=(0, 0, -1.0),
                     name=name)
    return scene, ski, mass


def mass_on_cantilever(elements: int = 20, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                       directors: str = "greville") -> Case:
    """(c) A mass runs to and fro on a cantilever that is curved upwards like a ski and sags and springs under it."""
    scene, ski, mass = _ski_scene("mass on a cantilever", 1.0, elements, degree, interpolation, strain, directors)
    return _case("mass_on_cantilever", "c", scene, {"mass": mass, "tip": ski.end}, t_end=20.0, step=0.04, conserved=ENERGY,
                 length=LENGTH, period=5.7, elements=elements,
                 text="a mass runs to and fro on a cantilever, curved like a ski, that springs under gravity")


def stiff_cantilever(elements: int = 20, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                     directors: str = "greville") -> Case:
    """(g) The mass on the cantilever with all stiffnesses raised by 1e4."""
    scene, ski, mass = _ski_scene("mass on a stiff cantilever", 1e4, elements, degree, interpolation, strain, directors)
    return _case("stiff_cantilever", "g", scene, {"mass": mass, "tip": ski.end}, t_end=20.0, step=0.04, conserved=ENERGY,
                 length=LENGTH, period=17.0, elements=elements, text="scene (c, cantilever) on a beam that is as good as rigid")


# ------------------------------------------------------------------------------------------------- free flight with contact
def _flying_rail(start: float, family: dict[str, Any]) -> tuple[fb.Beam, fb.InitialVelocity]:
    """Free rod with a velocity field in space that is zero, with zero slope, where the slider starts."""
    rail = fb.Beam.straight("rail", (0, 0, 0), (LENGTH, 0, 0), section=_rod_section(), **family)

    def velocity(s: Array) -> Array:
        x = (s - start) / LENGTH
        return np.stack((0.0 * s, 6.0 * x**2, -5.0 * x**2 * (1.0 - x)), axis=1)

    def spin(s: Array) -> Array:
        x = (s - start) / LENGTH
        return np.stack((0.0 * s, 5.0 * (2.0 * x - 3.0 * x**2) / LENGTH, 12.0 * x / LENGTH), axis=1)

    return rail, fb.InitialVelocity(rail, velocity=velocity, spin=spin)


def body_on_beam(elements: int = 20, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                 directors: str = "greville") -> Case:
    """(d) A rigid body slides, with a point off its centre, along a rod in free flight."""
    start = RAIL_START * LENGTH
    rail, wave = _flying_rail(start, _family(elements, degree, interpolation, strain, directors))
    arm = np.array((0.0, -0.4, 0.0))
    body = fb.RigidBody("body", mass=3.0, inertia=(0.6, 0.4, 0.5), position=np.array((start, 0.0, 0.0)) - arm,
                        velocity=(1.5, 0, 0))
    scene = fb.Scene(rail, wave, body, fb.Slider("body on rail", body.point(arm), rail, at=start, rate=1.5),
                     name="body on a flying rod", project_velocities=True)
    return _case("body_on_beam", "d", scene, {"A": rail.end, "B": rail.start, "body": body}, t_end=4.0, step=0.02,
                 conserved=EVERYTHING, length=LENGTH, period=1.25, elements=elements,
                 text="a rigid body slides along a free rod; both tumble, the rod bends")


def beam_on_beam(elements: int = 20, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
                 directors: str = "greville") -> Case:
    """(e) The end node of one flexible beam slides along another; both fly freely."""
    start = RAIL_START * LENGTH
    rail, wave = _flying_rail(start, _family(elements, degree, interpolation, strain, directors))
    reach = 4.0
    pole = fb.Beam.straight("pole", (start, 0, 0), (start, 0, reach), section=_rod_section(),
                            **_family(max(4, round(0.4 * elements)), degree, interpolation, strain, directors))

    def velocity(s: Array) -> Array:
        x = s / reach
        return np.stack((1.2 + 0.0 * s, 3.0 * x**2, 0.0 * s), axis=1)

    def spin(s: Array) -> Array:
        return np.stack((-6.0 * s / reach**2, 0.0 * s, 0.0 * s), axis=1)

    scene = fb.Scene(rail, wave, pole, fb.InitialVelocity(pole, velocity=velocity, spin=spin),
                     fb.Slider("pole on rail", pole.start, rail, at=start, rate=1.2), name="beam on a flying beam",
                     project_velocities=True)
    return _case("beam_on_beam", "e", scene, {"A": rail.end, "B": rail.start, "pole": pole.end}, t_end=4.0, step=0.02,
                 conserved=EVERYTHING, length=LENGTH, period=1.25, elements=elements,
                 text="a node of one flexible beam slides along another; both fly freely")


# ------------------------------------------------------------------------------------------------------------------- large
def large(elements: int = 16, degree: int = 3, interpolation: str = "lagrange", strain: str = "simo_reissner",
          directors: str = "greville", cables: int = 32) -> Case:
    """(f) A mast in free flight: two platforms joined by 32 cables, and a ring on every cable.

    The platforms turn against each other and the whole mast spins about an axis of its own. The rings start near the lower
    platform and run along the cables to the upper one, each with its own speed.
    """
    length, radius = 10.0, 2.0
    section = fb.Section(EA=4e3, GA2=2e3, GA3=2e3, GJ=10.0, EI2=10.0, EI3=10.0, rhoA=0.5, rhoI2=0.01, rhoI3=0.01, name="cable")
    family = _family(elements, degree, interpolation, strain, directors)
    low = fb.RigidBody("lower platform", mass=200.0, inertia=(500.0, 500.0, 900.0), position=(0, 0, 0))
    high = fb.RigidBody("upper platform", mass=120.0, inertia=(300.0, 300.0, 500.0), position=(0, 0, length))
    scene = fb.Scene(low, high, name=f"mast of {cables} cables", project_velocities=True)
    wires = []
    for k in range(cables):
        angle = 2.0 * math.pi * k / cables
        x, y = radius * math.cos(angle), radius * math.sin(angle)
        wire = fb.Beam.straight(f"cable {k}", (x, y, 0), (x, y, length), section=section, **family)
        ring = fb.PointMass(f"ring {k}", mass=0.5 + 0.3 * (k % 3))
        # inside the second of 16 elements, somewhere else on every cable
        at = (1.2 + 0.6 * (k % 5) / 4.0) * length / 16
        scene.add(wire, ring, fb.RigidConnection(low, wire.start), fb.RigidConnection(high, wire.end),
                  fb.Slider(f"ring {k} on its cable", ring, wire, at=at, rate=2.0 + 0.05 * (k % 4)))
        wires.append(wire)

    def turn(s: Array) -> Array:
        """Angular velocity along the mast: the platforms turn against each other, smoothly from one to the other."""
        x = s / length
        return 0.3 * (1.0 - 2.0 * x**2 * (3.0 - 2.0 * x))

    for k, wire in enumerate(wires):
        angle = 2.0 * math.pi * k / cables
        sideways = radius * np.array((-math.sin(angle), math.cos(angle), 0.0))
        scene.add(_twist(wire, turn, sideways))
    scene.add(fb.RigidMotion(low, spin=(0, 0, 0.3)), fb.RigidMotion(high, spin=(0, 0, -0.3)),
              fb.RigidMotion((low, high, *wires), velocity=(0.2, 0.1, 0.0), spin=(0.04, 0.02, 0.2), about=(0, 0, 0.5 * length)))
    return _case("large", "f", scene, {"upper": high, "lower": low, "middle": (wires[0], 0.5 * length)}, t_end=3.6, step=0.03,
                 conserved=EVERYTHING, length=length, period=1.0, elements=elements,
                 text=f"a free mast of two platforms and {cables} cables with a ring on each; the platforms twist the cables")


def _twist(wire: fb.Beam, turn: Callable[[Array], Array], sideways: Array) -> fb.InitialVelocity:
    """Velocity of a cable whose sections turn about the axis of the mast; `sideways`: velocity there at 1 rad/s."""
    length = wire.length

    def slope(s: Array) -> Array:
        """d turn / ds"""
        x = s / length
        return -0.3 * 12.0 * x * (1.0 - x) / length

    def spin(s: Array) -> Array:
        # d1 = e_z follows the slope of the velocity: spin x e_z = slope sideways
        across = np.array((-sideways[1], sideways[0], 0.0))
        return slope(s)[:, None] * across + turn(s)[:, None] * np.array((0.0, 0.0, 1.0))

    return fb.InitialVelocity(wire, velocity=lambda s: turn(s)[:, None] * sideways, spin=spin)


CASES: dict[str, Callable[..., Case]] = {
    f.__name__: f for f in (spaghetti2d, spaghetti3d, pendulum, mass_on_cable, mass_on_cantilever, body_on_beam, beam_on_beam,
                            large, stiff, stiff_cantilever)}
