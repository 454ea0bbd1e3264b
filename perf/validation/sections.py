"""Section forces, reactions, loads and inertia of every beam in balance (theory.md (4.35))."""
from __future__ import annotations

from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Row

Array = np.ndarray
G = np.array([0.0, 0.0, -9.81])
STEP, T_END = 1e-3, 0.1


def arms(mesh: dict[str, Any]) -> tuple[fb.Scene, list[fb.Beam], dict[str, Any]]:
    """Two arms on a ball joint, the first clamped, a ring that rubs on the second, and a load on its end."""
    steel = fb.Section.circle(radius=0.01, E=1e8, rho=2000.0, damping=1e-4)
    first = fb.Beam.straight("first", (0, 0, 0), (1, 0, 0.2), section=steel, **mesh)
    second = fb.Beam.straight("second", (1, 0, 0.2), (2, 0.5, 0.2), section=steel, **mesh)
    along = np.array([1.0, 0.5, 0.0]) / np.sqrt(1.25)
    ring = fb.PointMass("ring", mass=0.3, position=(1, 0, 0.2) + 0.43 * along)
    scene = fb.Scene(
        first, second, ring, fb.Clamp(first.start, name="clamp"), fb.BallJoint(first.end, second.start, name="joint"),
        fb.Slider("slider", ring, second, at=0.43, friction=0.1),
        fb.Load("end", second.end, force=(1.0, 2.0, -0.5), time=lambda t: np.cos(40.0 * t)), gravity=G)
    return scene, [first, second], {"slider": second}


def frame(mesh: dict[str, Any]) -> tuple[fb.Scene, list[fb.Beam], dict[str, Any]]:
    """A welded frame of nine beams that falls and is held at one corner."""
    places = np.array([(float(x), float(y), 0.1 * x * y) for x in range(3) for y in range(2)])
    edges = [(0, 1), (2, 3), (4, 5), (0, 2), (2, 4), (1, 3), (3, 5), (0, 3), (2, 5)]
    steel = fb.Section.circle(radius=0.01, E=1e8, rho=2000.0)
    net = fb.Net("frame", places, edges, section=steel, elements=mesh["elements"], degree=mesh["degree"], joints="rigid",
                 clamps=[0])
    return fb.Scene(net, gravity=G), [net.beam(k) for k in range(len(edges))], {}


def check_sections(quick: bool = False) -> list[Row]:
    """In steps: forces at both ends of every beam, its sliders, weight and change of momentum; the reaction of the clamp.

    Round-off of strains is worth 1e-14 EA; largest forces are 1e-3 EA here, as in steel at a third of its strength."""
    cubic, linear = {"elements": 4, "degree": 3}, {"elements": 10, "degree": 1}
    splines = cubic | {"interpolation": "bspline"}
    cases = [("arms, cubic", arms(cubic)), ("frame, quadratic", frame({"elements": 3, "degree": 2}))]
    if not quick:
        cases += [("arms, linear", arms(linear)), ("arms, cubic splines", arms(splines)), ("frame, cubic", frame(cubic))]
    out = []
    for name, (scene, beams, sliders) in cases:
        model = fb.compile_scene(scene)
        points = {f"{beam.name} {end}": (beam, s) for beam in beams for end, s in (("start", 0.0), ("end", beam.length))}
        observe = "energy", "slider", "reaction", "section", "velocity"
        run = fb.simulate(model, t_end=0.02 if quick else T_END, step=STEP, every=1, observe=observe, points=points,
                          output=fb.Output(snapshots=10**6), progress=False)
        assert len(run.t_snap) == len(run.t)
        largest = max(float(np.abs(run.section(point)["force"][1:-1]).max()) for point in points)
        worst = 0.0
        for beam in beams:
            first = model.numbers.start(beam)
            weight = np.zeros(beam.n_nodes)
            np.add.at(weight, beam.basis.element_nodes, beam.section.rhoA * beam.basis.mass_phi.sum(axis=1))
            momentum = np.einsum("a,tac->tc", weight, run.velocities[:, first:first + beam.n_nodes])
            force = run.section(f"{beam.name} end")["force"] - run.section(f"{beam.name} start")["force"] + weight.sum() * G
            for slider, on in sliders.items():
                if on is beam:
                    # the contact force acts on the point, its opposite on the beam
                    force -= run.slider(slider)["force"]
            change = (momentum[2:] - momentum[:-2]) / (2.0 * STEP)
            worst = max(worst, float(np.abs(force[1:-1] - change).max()))
        out.append(Row(f"{name}: section forces, sliders, weight, inertia of every beam in balance, of the largest force",
                       worst / largest, at_most=1e-10))
        if not sliders:
            continue
        start, clamp = run.section("first start"), run.reaction("clamp")
        off = max(float(np.abs(start[kind] + clamp[kind])[1:-1].max() / np.abs(clamp[kind]).max())
                  for kind in ("force", "moment"))
        out.append(Row(f"{name}: force and moment of the section at the clamp and its reaction, of the largest", off,
                       at_most=1e-12))
        ends = np.abs(run.section("first end")["force"] - run.section("second start")["force"])[1:-1].max()
        out.append(Row(f"{name}: forces on both sides of the joint, of the largest", float(ends) / largest, at_most=1e-10))
    return out
