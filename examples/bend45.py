"""A curved cantilever is bent and twisted by a force at its tip: the 45-degree bend, a classic of large deflections in space.

An eighth of a circle of radius 100 with a square section of side 1 lies in the plane x-y, clamped at the origin. A force of
600 along z at its tip lifts it out of its plane by half its length, so that it bends about both axes and twists at once
(Bathe and Bolourchi 1979; Simo and Vu-Quoc 1986, 8 straight two-node elements: tip at (47.23, 15.79, 53.37)). Units are
consistent, as in the papers.

With shape functions of degree p and p integration points per element, the error at the nodes falls with order 2p in the
number of nodes. The table shows it against the solution of the differential equations, which was computed by shooting with
more than ten digits.
"""
from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fastbeam as fb

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# degree -> (number of nodes, error) of every mesh
Errors = dict[int, list[tuple[int, float]]]
RADIUS, LENGTH = 100.0, 100.0 * math.pi / 4.0
# tip of the exact boundary value problem (Simo-Reissner strains, no shear factor, GJ = EI)
EXACT = np.array([47.15043857362901, 15.684800534038764, 53.474858791825135])


def build(elements: int = 8, degree: int = 3, force: float = 600.0) -> fb.Scene:
    """The bend, its clamp, and the force at the tip."""
    section = fb.Section(EA=1e7, GA2=5e6, GA3=5e6, GJ=1e7 / 12, EI2=1e7 / 12, EI3=1e7 / 12, rhoA=1.0, rhoI2=1 / 12, rhoI3=1 / 12)
    bend = fb.Beam.arc("bend", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=RADIUS, angle=math.pi / 4, section=section,
                       elements=elements, degree=degree)
    return fb.Scene(bend, fb.Clamp(bend.start), fb.Load("tip force", bend.end, force=(0, 0, force)), name="45-degree bend")


def tip_error(elements: int, degree: int) -> tuple[int, float]:
    """(number of nodes, distance of the tip from the exact one divided by the length)."""
    scene = build(elements, degree)
    result = fb.solve_static(fb.compile_scene(scene), observe=(), points={"tip": scene.beams[0].end})
    return scene.beams[0].n_nodes, float(np.linalg.norm(result.point("tip")[-1] - EXACT)) / LENGTH


def convergence(degrees: tuple[int, ...] = (1, 2, 3, 4), meshes: tuple[int, ...] = (4, 8, 16, 32)) -> Errors:
    """Degree -> (nodes, error) of every mesh."""
    return {p: [tip_error(elements, p) for elements in meshes] for p in degrees}


def convergence_text(table: Errors) -> str:
    """Errors over the meshes, and the order between neighbouring meshes in brackets, where the error is above round-off."""
    lines: list[str] = []
    for p, row in table.items():
        cells: list[str] = []
        for k, (nodes, error) in enumerate(row):
            order = ""
            if k and error > 1e-12:
                order = f"({math.log(row[k - 1][1] / error) / math.log((nodes - 1) / (row[k - 1][0] - 1)):.1f})"
            cells.append(f"{nodes:5d} nodes {error:8.1e} {order:<6}")
        lines.append(f"degree {p}: " + " ".join(cells))
    return "\n".join(lines)


def plot_convergence(table: Errors) -> Figure:
    """Error over the number of nodes; dotted lines have the slope 2p."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(6.5, 4.8), layout="constrained")
    axes = figure.subplots()
    for p, row in table.items():
        nodes, errors = (np.array(x, dtype=float) for x in zip(*row))
        line, = axes.loglog(nodes - 1, errors, "o-", label=f"degree {p}")
        reached = errors[errors > 1e-12]
        anchor = len(reached) - 1
        slope = reached[anchor] * ((nodes[:anchor + 1] - 1) / (nodes[anchor] - 1)) ** (-2.0 * p)
        axes.loglog(nodes[:anchor + 1] - 1, slope, ":", color=line.get_color(), lw=1.0)
    axes.set(title="45-degree bend: error at the tip (dotted: order 2p)", xlabel="nodes - 1", ylabel="distance / length",
             ylim=(1e-15, 1.0))
    axes.grid(True, color="0.9")
    axes.legend()
    return figure


def main(out: str = "out", elements: int = 8, degree: int = 3) -> fb.Result:
    """Solve, print the tip and the convergence table, write `out`/bend45.png and bend45_convergence.png.

    Parameters
    ----------
    out : str
        Folder for the pictures.
    elements, degree : int
        Mesh of the picture.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    scene = build(elements, degree)
    model = fb.compile_scene(scene)
    print(model)
    result = fb.solve_static(model, points={"tip": scene.beams[0].end})
    tip = result.point("tip")[-1]
    print(f"\n{len(result.t) - 1} load steps to {result.t.tolist()[1:]}, {result.info['iterations']} Newton iterations")
    print(f"tip    {tip}\nexact  {EXACT}\nstrain energy {result.series['strain'][-1]:.6f}\n")
    table = convergence()
    print(f"distance of the tip from the exact one / length (observed order; expected 2p)\n{convergence_text(table)}")
    fb.plot_shapes(result, n=20).savefig(folder / "bend45.png")
    plot_convergence(table).savefig(folder / "bend45_convergence.png", dpi=150)
    print(f"\nwritten: {folder / 'bend45.png'}, {folder / 'bend45_convergence.png'}")
    return result


if __name__ == "__main__":
    main()
