"""Random scenes that buckle: struts, frames, arches and strips of any section, in any direction, on any supports."""
from __future__ import annotations

from typing import Any

import numpy as np

import fastbeam as fb

Array = np.ndarray
KINDS = ("strut", "portal", "strip", "arch", "corner")


def turn(draw: np.random.Generator) -> Array:
    """A rotation (3, 3): along the axes, or any."""
    q, r = np.linalg.qr(draw.standard_normal((3, 3)))
    q = np.eye(3)[draw.permutation(3)] if draw.random() < 0.4 else q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


def section_of(draw: np.random.Generator, length: float) -> fb.Section:
    """A rectangle, flat or upright, slender."""
    height, width = length * 10.0**draw.uniform(-2.5, -1.5, 2)
    return fb.Section.rectangle(height=height, width=width, E=2.1e11, rho=7850.0, nu=0.3)


def buckling_scene(kind: str, seed: int) -> tuple[fb.Scene, float]:
    """A scene whose loads are of the size of its critical ones, and a load factor beyond the lowest. All lie in a plane; half
    of them have a small load across it."""
    draw = np.random.default_rng(seed)
    axes, origin = turn(draw), draw.standard_normal(3)

    def at(x: float, z: float, y: float = 0.0) -> tuple[float, ...]:
        return tuple(origin + axes @ (x, y, z))

    def way(x: float, z: float, y: float = 0.0) -> tuple[float, ...]:
        return tuple(axes @ (x, y, z))

    length = 10.0**draw.uniform(-1.0, 1.0)
    section = section_of(draw, length)
    flat, off = min(section.EI2, section.EI3), 0.0 if draw.random() < 0.5 else 1e-5
    # along d2 or d3 of the section
    options: dict[str, Any] = {"section": section, "d2": way(0, 0, 1)}
    if draw.random() < 0.5 if kind != "strip" else section.EI2 < section.EI3:
        options["d2"] = way(0, 1) if kind == "strip" else way(0, 0, 1)
    P = np.pi**2 * flat / length**2
    if kind == "strut":
        options["d2"] = way(1, 0) if draw.random() < 0.5 else way(0, 0, 1)
        strut = fb.Beam.straight("strut", at(0, 0), at(0, length), elements=6, **options)
        ends = draw.choice(["free", "guided", "pinned"])
        parts: list[Any] = [strut, fb.Clamp(strut.start)]
        if ends == "guided":
            mass = fb.RigidBody("cap", mass=1.0, inertia=(1, 1, 1), position=at(0, length))
            parts += [mass, fb.RigidConnection(strut.end, mass.center), fb.PrismaticJoint(fb.GROUND, mass, axis=way(0, 1))]
        elif ends == "pinned":
            parts[1] = fb.UniversalJoint(fb.GROUND, strut.start, "foot", axis_a=way(1, 0), axis_b=way(0, 0, 1))
            mass = fb.PointMass("cap", mass=1.0, position=at(0, length))
            rail = fb.Beam.straight("rail", at(0, 0.9 * length), at(0, 1.1 * length), elements=1, degree=1,
                                    section=fb.Section.rectangle(height=0.1 * length, width=0.1 * length, E=2.1e11, rho=1.0))
            parts += [rail, fb.Clamp(rail.start), fb.Clamp(rail.end), mass, fb.RigidConnection(strut.end, mass.center),
                      fb.Slider("roller", mass, rail, at=0.1 * length)]
        force = way(0, -{"free": 0.25, "guided": 4.0, "pinned": 1.0}[ends] * P, off * P)
        return fb.Scene(*parts, fb.Load("press", strut.end, force=force)), 1.5
    if kind == "portal":
        left, right = (fb.Beam.straight(name, at(x, 0), at(x, length), elements=4, **options)
                       for name, x in (("left", 0.0), ("right", length)))
        beam = fb.Beam.straight("beam", at(0, length), at(length, length), elements=4, **options)
        press = [fb.Load(name, node, force=way(0.0, -P, off * P)) for name, node in (("a", left.end), ("b", right.end))]
        return fb.Scene(left, right, beam, fb.RigidConnection(left.end, beam.start), fb.RigidConnection(right.end, beam.end),
                        fb.Clamp(left.start), fb.Clamp(right.start), *press), 2.0
    if kind == "strip":
        strip = fb.Beam.straight("strip", at(0, 0), at(length, 0), elements=6, **options)
        P = 4.0126 * np.sqrt(flat * section.GJ) / length**2
        return fb.Scene(strip, fb.Clamp(strip.start), fb.Load("tip", strip.end, force=way(0, -P, off * P))), 2.0
    if kind == "arch":
        rise = length * draw.uniform(0.1, 0.3)
        left = fb.Beam.straight("left", at(-length, 0), at(0, rise), elements=4, **options)
        right = fb.Beam.straight("right", at(0, rise), at(length, 0), elements=4, **options)
        push = fb.Load("push", left.end, force=way(0.0, -4.0 * P, 4.0 * off * P))
        clamps = fb.Clamp(left.start), fb.Clamp(right.end)
        return fb.Scene(left, right, fb.RigidConnection(left.end, right.start), *clamps, push), 3.0
    post = fb.Beam.straight("post", at(0, 0), at(0, length), elements=4, **options)
    arm = fb.Beam.straight("arm", at(0, length), at(0.3 * length, length), elements=3, **options)
    return fb.Scene(post, arm, fb.RigidConnection(post.end, arm.start), fb.Clamp(post.start),
                    fb.Load("weight", arm.end, force=way(0, -0.25 * P, 0.25 * off * P))), 3.0
