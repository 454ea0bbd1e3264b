"""One run of fastbeam: `python fastbeam_run.py '{"scene": "sliding", "elements": 8, "degree": 3, "step": 0.01, "order": 4}'`.

Settings
--------
scene : 'spaghetti3d' or 'sliding'
elements, degree : Lagrange elements and their degree
step, order : of the time integration
cable : sliding: True takes the limit of the model without shear strain and without rotary inertia of the section
energy : sliding: True records energies and says how much the total one changes, over the kinetic energy at the start
"""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from protocol import SAMPLES, answer, settings, steps, timed  # noqa: E402
from scenes import Sliding, Spaghetti  # noqa: E402

import fastbeam as fb  # noqa: E402

OPTIONS: dict[str, Any] = {"order": 2, "cable": False, "energy": False}


def spaghetti(options: dict[str, Any]) -> tuple[fb.Model, dict[str, Any]]:
    """The flying beam; observed are its two ends."""
    s = Spaghetti.SECTION
    section = fb.Section(EA=s.EA, GA2=s.GA, GA3=s.GA, GJ=s.GJ, EI2=s.EI, EI3=s.EI, rhoA=s.rhoA, rhoI2=s.rhoI, rhoI3=s.rhoI)
    beam = fb.Beam.straight("beam", Spaghetti.START, Spaghetti.END, section=section, elements=options["elements"],
                            degree=options["degree"])
    load = fb.Load("pulse", beam.start, force=Spaghetti.FORCE, moment=Spaghetti.MOMENT, time=Spaghetti.pulse)
    return fb.compile_scene(fb.Scene(beam, load)), {"start": beam.start, "end": beam.end}


def sliding(options: dict[str, Any]) -> tuple[fb.Model, dict[str, Any]]:
    """The sliding mass; observed is the mass."""
    s = Sliding.SECTION
    shear, inertia = (Sliding.CABLE_GA, Sliding.CABLE_RHOI) if options["cable"] else (s.GA, s.rhoI)
    section = fb.Section(EA=s.EA, GA2=shear, GA3=shear, GJ=s.GJ, EI2=s.EI, EI3=s.EI, rhoA=s.rhoA, rhoI2=inertia, rhoI3=inertia)
    beam = fb.Beam.straight("beam", (0, 0, 0), (Sliding.LENGTH, 0, 0), section=section, elements=options["elements"],
                            degree=options["degree"])
    mass = fb.PointMass("mass", mass=Sliding.MASS)
    contact = fb.Slider("contact", mass, beam, at=Sliding.START, rate=Sliding.SPEED)
    scene = fb.Scene(beam, mass, contact, fb.Pin(beam.start), fb.Pin(beam.end), gravity=(0, -Sliding.GRAVITY, 0))
    return fb.compile_scene(scene), {"mass": mass}


def main() -> None:
    """Run what the command line asks for."""
    options = {**OPTIONS, **settings()}
    flying = options["scene"] == "spaghetti3d"
    model, points = spaghetti(options) if flying else sliding(options)
    t_end = options.get("t_end", Spaghetti.T_END if flying else Sliding.T_END)
    n_steps, message = steps(t_end, options["step"]), ""
    results: list[fb.Result] = []

    def run(samples: int) -> fb.Result:
        return fb.simulate(model, t_end=samples * n_steps * options["step"], step=options["step"], order=options["order"],
                           observe=("energy",) if options["energy"] else (), output=fb.Output(snapshots=0), progress=False,
                           points=points,
                           every=n_steps)

    def solve(_: None) -> None:
        results[:] = [run(SAMPLES)]

    try:
        # kernels are loaded or compiled on their own: numba's work is not timed
        run(1)
        _, times = timed(lambda: None, solve)
        seen = [results[0].point(name)[1:] for name in points]
        ends = [path[k] for k in range(SAMPLES) for path in seen]
    except fb.ConvergenceError as error:
        message, times, ends = str(error).splitlines()[0], [(0.0, 0.0)], []
    extra = {}
    if options["energy"] and results:
        total = results[0].series["total"]
        extra["energy_change"] = float(abs(total - total[0]).max()) / (0.5 * Sliding.MASS * Sliding.SPEED**2)
    answer("fastbeam", fb.__version__, ends, times, message, extra)


if __name__ == "__main__":
    main()
