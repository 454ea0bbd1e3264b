"""Derivatives of an equilibrium by the sections of all beams of a net: one adjoint against one solution for each of some.

    python perf/sensitivity.py [nodes on a side]
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


if __name__ == "__main__":
    main()
