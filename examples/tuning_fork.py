"""A tuning fork: natural modes of a frame of curved and straight beams, and the tone of a prong that was struck.

Two prongs of 9.5 cm on a bow, a stem below, clamped at its end. In the mode that one hears the prongs swing against each
other, so that the stem hardly moves. A prong that were clamped where the bow begins would sound at 1.8751^2/(2 pi L^2)
sqrt(EI/rhoA); the bow gives way and makes it lower. The tone is then looked for in a run after a blow on both prongs.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

import fastbeam as fb

PRONG, GAP = 0.095, 0.016


def build(elements: int = 6, blow: float = 0.0) -> fb.Scene:
    """Fork in the plane x-z; blow: speed of the tips of the prongs, m/s, away from each other."""
    steel = fb.Section.rectangle(height=0.006, width=0.004, E=206e9, rho=7850.0, name="steel")
    half = 0.5 * GAP
    left, right = (fb.Beam.straight(name, (x, 0, 0), (x, 0, PRONG), d2=(0, 1, 0), section=steel, elements=elements)
                   for name, x in (("left", -half), ("right", half)))
    bow = fb.Beam.arc("bow", (-half, 0, 0), (0, 0, -1), (1, 0, 0), radius=half, angle=np.pi, section=steel, elements=4)
    stem = fb.Beam.straight("stem", (0, 0, -half), (0, 0, -half - 0.04), d2=(0, 1, 0), section=steel, elements=3)
    middle = bow.at(0.5 * bow.length)
    scene = fb.Scene(left, right, bow, stem, fb.Clamp(stem.end), fb.RigidConnection(left.start, bow.start),
                     fb.RigidConnection(right.start, bow.end), fb.RigidConnection(middle, stem.start), name="tuning fork")
    if blow:
        for beam, sign in ((left, -1.0), (right, 1.0)):
            def push(s: np.ndarray, sign: float = sign) -> np.ndarray:
                return np.stack((sign * blow * (s / PRONG) ** 2, 0 * s, 0 * s), axis=1)

            def turn(s: np.ndarray, sign: float = sign) -> np.ndarray:
                return np.stack((0 * s, sign * blow * 2.0 * s / PRONG**2, 0 * s), axis=1)
            scene.add(fb.InitialVelocity(beam, velocity=push, spin=turn))
    return scene


def clamped_prong() -> float:
    """Frequency of a prong that is clamped where the bow begins, Hz."""
    section = build().beams[0].section
    # it swings along x, bending about y, which is its d2
    return float(1.875104068711961**2 / (2 * np.pi * PRONG**2) * np.sqrt(section.EI2 / section.rhoA))


def main(out: str = "out", elements: int = 6) -> tuple[float, float]:
    """Modes and tone in Hz; writes `out`/tuning_fork.png.

    Parameters
    ----------
    out : str
        Folder for the picture.
    elements : int
        Cubic elements of a prong.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    scene = build(elements)
    model = fb.compile_scene(scene)
    modes = fb.modes(model, n=6)
    print(modes)
    tips = [model.numbers.number(beam.end) for beam in scene.beams[:2]]
    # prongs against each other, in the plane of the fork
    x = modes.displacements[:, tips, 0]
    fork = next(k for k in range(6) if x[k, 0] * x[k, 1] < -0.5)
    struck = build(elements, blow=0.5)
    run = fb.simulate(fb.compile_scene(struck), t_end=0.04, step=2e-5, every=1, output=fb.Output(snapshots=0),
                      points={"tip": struck.beams[0].end}, observe=("energy",))
    path = run.point("tip")[:, 0] - run.point("tip")[0, 0]
    up = np.flatnonzero((path[:-1] < 0.0) & (path[1:] >= 0.0))
    crossings = run.t[up] - path[up] * np.diff(run.t)[up] / np.diff(path)[up]
    tone = float((len(crossings) - 1) / (crossings[-1] - crossings[0]))
    found = float(modes.frequencies[fork])
    print(f"\nmode {fork}: {found:.2f} Hz; tone of the struck fork {tone:.2f} Hz; a clamped prong would sound at "
          f"{clamped_prong():.2f} Hz")
    print(f"drift of the energy {run.drift('total'):.0e}")
    fb.plot_modes(modes, n=6).savefig(folder / "tuning_fork.png")
    print(f"written: {folder / 'tuning_fork.png'}")
    return found, tone


if __name__ == "__main__":
    main()
