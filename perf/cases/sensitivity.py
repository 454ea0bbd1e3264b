"""Derivatives by everything at once: of an equilibrium by the sections of all beams of a net, one adjoint against one solution
for each of some; of 1000 steps of a chain by thousands of parameters, against `simulate`.

    python perf/cases/sensitivity.py [nodes on a side] [elements of the chain] [steps]
"""
from __future__ import annotations

import sys
import time

import numpy as np

import fastbeam as fb

STEEL = dict(E=2.1e11, rho=7850.0)


def roof(n: int, areas: np.ndarray | float) -> fb.Net:
    """A shallow dome of bars over a square, its rim clamped, snow on it."""
    grid = np.arange(n * n).reshape(n, n)
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    height = 0.15 * (n - 1) * np.sin(np.pi * x / (n - 1)) * np.sin(np.pi * y / (n - 1))
    pairs = ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:]), (grid[:-1, :-1], grid[1:, 1:]))
    edges = np.concatenate([np.stack((a.ravel(), b.ravel()), 1) for a, b in pairs])
    area = np.broadcast_to(areas, len(edges))
    sections = [fb.Section.circle(radius=float(np.sqrt(a / np.pi)), **STEEL) for a in area]
    loads = np.zeros((n * n, 3))
    loads[:, 2] = -500.0
    rim = np.unique(np.concatenate((grid[0], grid[-1], grid[:, 0], grid[:, -1])))
    return fb.Net("roof", np.stack((x, y, height), axis=-1).reshape(-1, 3).astype(float), edges, section=sections,
                  section_of=np.arange(len(edges)), elements=2, degree=2, clamps=rim, loads=loads)


def chain(elements: int, EI: float = 25.0) -> tuple[fb.Model, dict[str, fb.NodeRef]]:  # noqa: N803
    """`links`, compiled."""
    scene, points = links(elements, EI)
    return fb.compile_scene(scene), points


def links(elements: int, EI: float = 25.0, size: float = 0.2) -> tuple[fb.Scene, dict[str, fb.NodeRef]]:  # noqa: N803
    """A clamped chain of beams of two cubic elements each, a mass at its end, in space; size: length of a beam, m."""
    section = fb.Section(EA=1e5, GA2=4e4, GA3=4e4, GJ=20.0, EI2=EI, EI3=25.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    ends = np.zeros((elements // 2 + 1, 3))
    ends[:, 0] = size * np.arange(len(ends))
    beams = [fb.Beam.straight(f"b{k}", a, b, section=section, elements=2, degree=3)
             for k, (a, b) in enumerate(zip(ends, ends[1:]))]
    mass = fb.PointMass("mass", mass=0.5, position=ends[-1])
    joints = [fb.RigidConnection(a.end, b.start) for a, b in zip(beams, beams[1:])]
    scene = fb.Scene(*beams, mass, *joints, fb.RigidConnection(beams[-1].end, mass), fb.Clamp(beams[0].start),
                     fb.Load("pull", beams[-1].end, force=(0, 2.0, 1.0)), gravity=(0, 0, -9.81))
    return scene, {"tip": beams[-1].end}


def rail(elements: int) -> tuple[fb.Model, dict[str, fb.NodeRef]]:
    """A cable between two pins under its weight, and on it a body in a sleeve with friction, in a plane."""
    section = fb.Section(EA=1e5, GA2=4e4, GA3=4e4, GJ=20.0, EI2=25.0, EI3=25.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    cable = fb.Beam.straight("cable", (0, 0, 0), (0.1 * elements, 0, 0), section=section, elements=elements, degree=3)
    at = 0.3 * cable.length
    body = fb.RigidBody("body", mass=2.0, inertia=(0.02, 0.02, 0.02), position=(at, 0, 0), velocity=(1.0, 0, 0))
    ring = fb.Sleeve("ring", body, cable, at=at, rate=1.0, length=0.1, friction=fb.Friction(0.1))
    scene = fb.Scene(cable, body, ring, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -9.81))
    return fb.compile_scene(scene), {"tip": body.point((0, 0, 0))}


def run(elements: int, steps: int, h: float = 2e-3, slides: bool = False) -> None:
    """Processor time of the run that remembers its steps and of its gradient, next to that of `simulate`; the best of three."""
    model, points = rail(elements) if slides else chain(elements)
    best = np.full(6, np.inf)
    for k in range(4):
        begin = [time.process_time()]
        result = fb.simulate(model, t_end=steps * h, step=h, points=points, progress=False)
        begin.append(time.process_time())
        kept = fb.adjoint_run(model, t_end=steps * h, step=h, points=points)
        begin.append(time.process_time())
        by = kept.gradient(points={"tip": (0, 0, 1)})
        begin.append(time.process_time())
        if not slides:
            one = kept.gradient(points={"tip": (0, 0, 1)}, values={"size": 0.2}, build=lambda size: links(elements, size=size))
        begin.append(time.process_time())
        again = fb.adjoint_run(model, t_end=steps * h, step=h, points=points, keep_every=round(steps**0.5))
        begin.append(time.process_time())
        again.gradient(points={"tip": (0, 0, 1)})
        begin.append(time.process_time())
        if k:
            best = np.minimum(best, np.diff(begin))
    sections = sum(9 * len(x.rhoA) for x in by.sections.values())
    plain, forward, backward, with_length, few, recomputed = best.tolist()
    label = "cable with a sleeve" if slides else "chain"
    print(f"{label} of {elements} cubic elements, {model.n_unknowns} unknowns, {steps} steps, "
          f"{np.mean(result.series['iterations'][1:]):.2f} iterations a step")
    print(f"  simulate                                      {plain:8.2f} s")
    print(f"  adjoint_run: the same, steps kept             {forward:8.2f} s   {forward / plain:.2f} of simulate")
    print(f"  gradient: {sections} stiffnesses and inertias, masses, {by.forces.size + by.moments.size} loads, "
          f"{by.velocities.size + by.spins.size} initial velocities")
    print(f"                                                {backward:8.2f} s   {backward / plain:.2f} of simulate, together "
          f"{(forward + backward) / plain:.2f}")
    print(f"  the same with every {round(steps**0.5)}th state kept           {recomputed:8.2f} s   {recomputed / plain:.2f} of "
          f"simulate, together {(few + recomputed) / plain:.2f}")
    if not slides:
        more = with_length - backward
        print(f"  by the length of all beams too, of a function   {more:6.2f} s   {more / plain:.2f} of simulate "
              f"({one.by['size']:.12e})")


def exact(elements: int, steps: int, h: float = 2e-3) -> None:
    """A derivative against a difference of order 6 of runs."""
    def go(EI: float = 25.0, size: float = 0.2) -> fb.AdjointRun:  # noqa: N803
        scene, points = links(elements, EI, size)
        model = fb.compile_scene(scene)
        return fb.adjoint_run(model, t_end=steps * h, step=h, points=points)

    by = go().gradient(points={"tip": (0, 0, 1)}, values={"size": 0.2}, build=lambda size: links(elements, size=size))
    of_EI = sum(x.stiffness[:, 4, 4].sum() for x in by.sections.values())  # noqa: N806
    for name, at, e, found in (("EI", 25.0, 0.05, of_EI), ("size", 0.2, 4e-5, by.by["size"])):
        rows = np.array([go(**{name: at + k * e}).point("tip")[-1, 2] for k in np.arange(-3, 4)])
        slope = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 @ rows / e
        print(f"  of {steps} steps of {elements} elements, by {name} of all: {found:.12e}, difference of runs {slope:.12e}, "
              f"off by {abs(found / slope - 1):.1e}")


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 20

    def build(area: float = 2e-3) -> tuple[fb.Scene, dict[str, fb.NodeRef]]:
        net = roof(n, area)
        return fb.Scene(net, gravity=(0, 0, -9.81)), {"top": net.node(n * (n // 2) + n // 2)}

    model = fb.compile_scene(build()[0])
    fb.solve_static(model)
    begin = time.perf_counter()
    state = fb.solve_static(model).state
    solved = time.perf_counter() - begin
    begin = time.perf_counter()
    found = fb.sensitivity(build, {}, state=state)
    ready = time.perf_counter() - begin
    begin = time.perf_counter()
    by = found.gradient(points={"top": (0, 0, 1)})
    adjoint = time.perf_counter() - begin
    begin = time.perf_counter()
    one = fb.sensitivity(build, {"area": 2e-3}, state=state)
    tangent = time.perf_counter() - begin
    area = 2e-3
    radius = np.sqrt(area / np.pi)
    C = fb.Section.circle(radius=float(radius), **STEEL).C
    power = np.array([1, 1, 1, 2, 2, 2])
    total = float(np.sum(by.sections["roof"].by((C * power / area, STEEL["rho"]))))
    print(f"net of {len(by.sections['roof'].EA)} beams, {found.model.n_unknowns} unknowns")
    print(f"  equilibrium                                   {solved:8.2f} s")
    print(f"  scene without elimination, tangent            {ready:8.2f} s")
    print(f"  adjoint: sections of all beams, loads         {adjoint:8.2f} s   ({found.factorisations} factorisation)")
    print(f"  the same sum by the tangent of one parameter  {tangent:8.2f} s")
    print(f"  the sum over all areas: adjoint {total:.12e}, tangent {one.point('top')['area'][2]:.12e}")
    run(int(sys.argv[2]) if len(sys.argv) > 2 else 200, int(sys.argv[3]) if len(sys.argv) > 3 else 1000)
    exact(20, 1000)
    run(100, 1000, slides=True)


if __name__ == "__main__":
    main()
