"""Two bars that lean against each other snap through: the path of equilibria past its limit points, against the exact one.

The von Mises truss: two bars from the supports at (-1, 0) and (1, 0) to a joint at (0, h), where a load presses down. The
load that the joint carries grows to a limit point, falls through zero where both bars lie in line, and grows again when they
hang. Newton's method at a given load jumps over all that; `solve_path` goes along it. With bars that stay straight, N = EA
(l/L - 1) tells the path: P = 2 EA (l/L - 1) y/l with l^2 = 1 + y^2.
"""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import fastbeam as fb

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EA, HEIGHT = 1e4, 0.3


def build() -> fb.Scene:
    """Two bars of one straight element each, welded to nothing: hinges at both ends and where they meet."""
    # stiff in bending: they shall not buckle between their ends
    section = fb.Section(EA=EA, GA2=1e4, GA3=1e4, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    left = fb.Beam.straight("left", (-1, 0, 0), (0, HEIGHT, 0), section=section, elements=1, degree=1)
    right = fb.Beam.straight("right", (0, HEIGHT, 0), (1, 0, 0), section=section, elements=1, degree=1)
    return fb.Scene(left, right, fb.Pin(left.start), fb.Pin(right.end), fb.BallJoint(left.end, right.start),
                    fb.Load("press", left.end, force=(0, -200.0, 0)), name="snap-through")


def load_at(y: np.ndarray) -> np.ndarray:
    """Exact load, N, that presses the joint to the height y, m."""
    length, at_rest = np.hypot(1.0, y), np.hypot(1.0, HEIGHT)
    return np.asarray(-2.0 * EA * (length / at_rest - 1.0) * y / length)


def limit_load() -> float:
    """The largest load before the snap, N: l^3 = L where dP/dy = 0."""
    length = np.hypot(1.0, HEIGHT) ** (1.0 / 3.0)
    return float(load_at(np.sqrt(length**2 - 1.0)))


def picture(path: fb.Result) -> Figure:
    """Load over the height of the joint, with the limit points."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(6.5, 4.2), layout="constrained")
    axes = figure.subplots()
    y, load = path.point("joint")[:, 1], 200.0 * path.series["load_factor"]
    fine = np.linspace(float(y.min()), float(y.max()), 400)
    axes.plot(fine, load_at(fine), color="0.7", lw=4.0, label="exact")
    stable = path.series["unstable_directions"] == 0
    axes.plot(y[stable], load[stable], "o", color="#0072B2", ms=4, label="stable")
    axes.plot(y[~stable], load[~stable], "o", color="#D55E00", ms=4, label="unstable")
    axes.axhline(limit_load(), color="0.4", lw=0.9, ls=":")
    axes.set(title="Snap-through of two bars", xlabel="height of the joint [m]", ylabel="load [N]")
    axes.legend(frameon=False)
    axes.grid(True, color="0.9")
    return figure


def main(out: str = "out") -> fb.Result:
    """Follow the path, compare it, write `out`/snap_through.png.

    Parameters
    ----------
    out : str
        Folder for the picture.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    scene = build()
    model = fb.compile_scene(scene, planar=True)
    path = fb.solve_path(model, points={"joint": scene.beams[0].end}, to=1.0, largest_step=0.05)
    y, load = path.point("joint")[:, 1], 200.0 * path.series["load_factor"]
    print(f"{len(path.t)} equilibria; largest distance from the exact path {np.abs(load - load_at(y)).max():.1e} N")
    for point in path.info["critical_points"]:
        exact = np.copysign(limit_load(), point["load_factor"])
        print(f"{point['kind']}: load {200.0 * point['load_factor']:.9f} N, exact {exact:.9f} N")
    picture(path).savefig(folder / "snap_through.png", dpi=110)
    print(f"written: {folder / 'snap_through.png'}")
    return path


if __name__ == "__main__":
    main()
