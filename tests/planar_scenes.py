"""Scenes that stay in a plane, for any plane: vectors of a scene pass through `at`, which turns the x-y plane into another."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

import fastbeam as fb

Array = np.ndarray
FLAT = np.eye(3)
SECTION = fb.Section(EA=1e4, GA2=8e3, GA3=6e3, GJ=300.0, EI2=400.0, EI3=600.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
ROUND = fb.Section(EA=8e3, GA2=5e3, GA3=5e3, GJ=300.0, EI2=400.0, EI3=400.0, rhoA=0.8, rhoI2=0.1, rhoI3=0.1)
FAMILIES: dict[str, dict[str, object]] = {f"lagrange {p}": {"degree": p} for p in range(1, 6)}
FAMILIES |= {f"bspline {p} {d}": {"interpolation": "bspline", "degree": p, "directors": d}
             for p, d in ((2, "greville"), (3, "greville"), (4, "greville"), (2, "control"), (3, "control"))}


def plane(normal: tuple[float, float, float] = (1.0, 2.0, 3.0)) -> Array:
    """Rotation [3, 3] that turns e_z into the direction of `normal`."""
    n = np.array(normal) / np.linalg.norm(normal)
    first = np.cross((0.3, -0.2, 0.9), n)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(n, first), n), axis=1)


def wave(beam: fb.Beam, turn: Array = FLAT, size: float = 1.0, spin: float = 0.4) -> fb.InitialVelocity:
    """Velocities in the plane that bend, stretch, turn and move a beam."""
    k = np.pi / beam.length

    def velocity(s: Array) -> Array:
        return size * np.stack((0.3 * np.cos(k * s), np.sin(k * s) + 0.2, 0.0 * s), axis=1) @ turn.T

    def turning(s: Array) -> Array:
        return (spin + k * np.cos(k * s))[:, None] * turn[:, 2]

    return fb.InitialVelocity(beam, velocity=velocity, spin=turning)


def flight(turn: Array = FLAT, family: str = "lagrange 3", shape: str = "straight", d2: str = "in",
           elements: int = 4) -> fb.Scene:
    """Two beams that fly and bend, one for each strain set, each with a mass that slides along.

    shape: straight, arc or spline; d2: `in` the plane, `out` of it, or `oblique` (with a round section); elements: of each beam.
    """
    def at(*x: float) -> Array:
        return turn @ np.array((*x, 0.0)[:3])

    beams = []
    for k, strain in enumerate(("simo_reissner", "green_lagrange")):
        common = dict(elements=elements, strain=strain, section=ROUND if d2 == "oblique" else SECTION, **FAMILIES[family])
        y = 1.5 * k
        c, s = {"in": (1.0, 0.0), "out": (0.0, 1.0), "oblique": (np.cos(0.4), np.sin(0.4))}[d2]
        if shape == "straight":
            across = c * at(-0.3, 1.0) / np.hypot(0.3, 1.0) + s * turn[:, 2]
            beams.append(fb.Beam.straight(f"beam {k}", at(0, y), at(3, y + 0.9), d2=across, **common))
        elif shape == "arc":
            beams.append(fb.Beam.arc(f"beam {k}", at(0, y), at(0.6, 0.8), at(0.8, -0.6), radius=2.0, angle=1.3, **common))
        else:
            points = [at(0, y), at(1, y + 0.4), at(1.8, y - 0.1), at(3, y + 0.5)]
            beams.append(fb.Beam.through_points(f"beam {k}", points, d2=c * at(-0.4, 1.0) + s * turn[:, 2], **common))
    masses = [fb.PointMass(f"mass {k}", mass=0.4 + k) for k in range(2)]
    sliders = [fb.Slider(f"slider {k}", mass, beam, at=0.35 * beam.length, rate=2.0 - 3.0 * k, curve=curve)
               for k, (mass, beam, curve) in enumerate(zip(masses, beams, ("c1", "own")))]
    return fb.Scene(*beams, *masses, *sliders, *(wave(beam, turn) for beam in beams), name="flight")


def mechanism(turn: Array = FLAT, sliding: bool = True) -> fb.Scene:
    """Everything at once: a closed chain of beams and a body, joints and supports of every kind, loads in time, a node of a beam
    that slides, a tied mass that slides on a tied rail, a pendulum of a beam."""
    def at(*x: float) -> Array:
        return turn @ np.array((*x, 0.0)[:3])

    n = turn[:, 2]
    boom = fb.Beam.straight("boom", at(0, 0), at(3, 0), d2=n, section=SECTION, elements=4, degree=3)
    arm = fb.Beam.straight("arm", at(3, 0), at(3.3, 1.2), d2=n, section=SECTION, elements=3, degree=2, strain="green_lagrange")
    body = fb.RigidBody("body", mass=1.5, inertia=[[0.3, 0.05, 0], [0.05, 0.25, 0], [0, 0, 0.4]], position=at(3.1, 1.5),
                        directors=(turn @ np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])).T)
    # the directors of the body are the columns of the rotation: offsets are in its triad
    hook = body.point((-0.3 * 0.6, 0.3 * 0.8, 0))
    start = fb.Scene(body).position_of(hook)
    # an arc from the body down to the boom
    end = at(1.5, 0)
    chord = end - start
    along = chord / np.linalg.norm(chord)
    side = np.cross(n, along)
    half = 0.5
    radius = 0.5 * np.linalg.norm(chord) / np.sin(half)
    link = fb.Beam.arc("link", start, np.cos(half) * along - np.sin(half) * side, np.cos(half) * side + np.sin(half) * along,
                       radius=radius, angle=2.0 * half, section=SECTION, elements=3, degree=4)
    whip = fb.Beam.straight("whip", at(-1, 1), at(-1, -1), d2=np.cos(0.4) * at(1, 0) + np.sin(0.4) * n, section=ROUND, elements=3,
                            degree=2, strain="green_lagrange")
    weight = fb.PointMass("weight", mass=0.7, position=at(-1, -1))
    # what could turn out of the plane without resistance has no equilibrium in space
    held, joint = (fb.Pin, fb.BallJoint) if sliding else (fb.Clamp, fb.RigidConnection)
    parts: list[object] = [boom, arm, body, link, whip, weight, fb.Clamp(boom.start), fb.RigidConnection(boom.end, arm.start),
                           fb.RigidConnection(arm.end, body), fb.BallJoint(hook, link.start),
                           joint(link.end, boom.at(1.5)),
                           held(whip.start), fb.BallJoint(whip.end, weight)]

    def push(t: float) -> float:
        return np.sin(8.0 * t) + 0.3

    def field(s: Array) -> Array:
        return np.stack((3.0 * s, 2.0 - s, 0.0 * s), axis=1) @ turn.T

    parts += [fb.Load("tip", body.point((0.2, 0.1, 0)), force=at(5, 20), moment=6.0 * n, time=push),
              fb.Load("turn", whip.end, moment=-4.0 * n),
              fb.DistributedLoad("wind", boom, force=field, moment=2.0 * n, time=push)]
    if sliding:
        rod = fb.Beam.straight("rod", at(0.75, 0), link.reference(0.5 * link.length)[0][0], d2=n, section=SECTION, elements=2,
                               degree=2)
        ring, bead = fb.PointMass("ring", mass=0.3, position=rod.reference(rod.length)[0][0]), fb.PointMass("bead", mass=0.5)
        parts += [rod, ring, bead, fb.BallJoint(rod.end, ring), fb.Slider("foot", rod.start, boom, at=0.75),
                  fb.Slider("lasso", ring, link, at=0.5 * link.length, curve="own"),
                  fb.Slider("run", bead, arm, at=0.5, rate=0.8)]
    return fb.Scene(*parts, gravity=at(0.5, -9.81), gravity_time=None, name="mechanism")


SCENES: dict[str, Callable[..., fb.Scene]] = {"flight": flight, "mechanism": mechanism}
