"""A motor turns a crank, a flexible rod moves a piston: joints with axes, a motor, a damper, and the books of the energy.

The crank of 0.15 m turns about its shaft with a motor of constant torque; a damper in the guide of the piston takes energy
away. Where the piston is follows for a rigid rod from the angle alone: x = r cos a + sqrt(l^2 - r^2 sin^2 a). The rod here
bends and stretches, by very little, so the difference from that is the flexibility of the rod, and nothing else.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

import fastbeam as fb

CRANK, ROD = 0.15, 0.6


def build(torque: float = 3.0, elements: int = 4) -> fb.Scene:
    """Crank, rod and piston in the plane x-z; the shaft turns about y."""
    steel = fb.Section.rectangle(height=0.02, width=0.01, E=210e9, rho=7850.0, name="steel")
    crank = fb.RigidBody("crank", mass=1.0, inertia=(0.01, 0.02, 0.02), position=(0, 0, 0))
    rod = fb.Beam.straight("rod", (CRANK, 0, 0), (CRANK + ROD, 0, 0), section=steel, elements=elements)
    piston = fb.RigidBody("piston", mass=0.8, inertia=(1e-3, 1e-3, 1e-3), position=(CRANK + ROD, 0, 0))
    return fb.Scene(crank, rod, piston,
                    fb.RevoluteJoint(fb.GROUND, crank, "shaft", axis=(0, -1, 0), torque=torque),
                    fb.RevoluteJoint(crank.point((CRANK, 0, 0)), rod.start, "crank pin", axis=(0, -1, 0)),
                    fb.RevoluteJoint(rod.end, piston, "piston pin", axis=(0, -1, 0)),
                    fb.PrismaticJoint(fb.GROUND, piston, "guide", axis=(1, 0, 0), damping=8.0), name="slider crank")


def rigid_piston(angle: np.ndarray) -> np.ndarray:
    """Place of the piston for a rigid rod, m, less that at the start."""
    return np.asarray(CRANK * np.cos(angle) + np.sqrt(ROD**2 - CRANK**2 * np.sin(angle) ** 2) - CRANK - ROD)


def main(out: str = "out", step: float = 1e-3, t_end: float = 1.5) -> fb.Result:
    """Run, print the balance, write `out`/slider_crank.png.

    Parameters
    ----------
    out : str
        Folder for the picture.
    step, t_end : float
        Step size and end of the run, s.
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    run = fb.simulate(fb.compile_scene(build()), t_end=t_end, step=step, every=5)
    angle, work, place = *(run.joint("shaft")[key] for key in ("angle", "work")), run.joint("guide")["distance"]
    print(f"{angle[-1] / (2 * np.pi):.2f} turns; the piston is at most {np.abs(place - rigid_piston(angle)).max():.1e} m "
          "from where a rigid rod has it")
    for name, energy in run.balance().items():
        print(f"{name:28} {energy[0]:12.6f} J at the start {energy[-1]:12.6f} J at the end")
    print(f"work of the motor / torque times angle: {work[-1] / (3.0 * angle[-1]):.12f}")
    print(f"balance: {run.drift('balance'):.0e}")
    fb.plot_balance(run).savefig(folder / "slider_crank.png")
    print(f"written: {folder / 'slider_crank.png'}")
    return run


if __name__ == "__main__":
    main()
