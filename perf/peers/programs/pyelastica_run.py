"""One run of PyElastica: `python pyelastica_run.py '{"scene": "spaghetti3d", "elements": 40, "step": 0.001}'`.

Explicit, with PositionVerlet. The force acts on the first node, the moment on the first element of the staggered rod.
"""
from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import elastica as ea  # noqa: E402
import numpy as np  # noqa: E402
from protocol import SAMPLES, answer, settings, steps, timed  # noqa: E402
from scenes import Spaghetti  # noqa: E402


class Simulator(ea.BaseSystemCollection, ea.Forcing):
    """A rod with forces."""


class Pulse(ea.NoForces):
    """The triangular pulse on the start of the rod."""

    def __init__(self) -> None:
        super().__init__()
        self.force, self.moment = np.array(Spaghetti.FORCE), np.array(Spaghetti.MOMENT)

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        """Force on node 0."""
        system.external_forces[:, 0] += Spaghetti.pulse(float(time)) * self.force

    def apply_torques(self, system: Any, time: float = 0.0) -> None:
        """Moment on element 0, in the frame of its directors."""
        system.external_torques[:, 0] += system.director_collection[:, :, 0] @ (Spaghetti.pulse(float(time)) * self.moment)


def build(n: int) -> tuple[Any, Any]:
    """Simulator and rod of n elements with the stiffness and inertia of the scene."""
    s, h = Spaghetti.SECTION, Spaghetti.LENGTH / n
    start, end = np.array(Spaghetti.START), np.array(Spaghetti.END)
    simulator = Simulator()
    rod = ea.CosseratRod.straight_rod(n, start, (end - start) / Spaghetti.LENGTH, np.array([0.0, 0.0, 1.0]), Spaghetti.LENGTH,
                                      0.1, s.rhoA / (np.pi * 0.01), youngs_modulus=1.0, shear_modulus=0.4)
    rod.shear_matrix[0, 0, :] = rod.shear_matrix[1, 1, :] = s.GA
    rod.shear_matrix[2, 2, :] = s.EA
    rod.bend_matrix[0, 0, :] = rod.bend_matrix[1, 1, :] = s.EI
    rod.bend_matrix[2, 2, :] = s.GJ
    for d, inertia in enumerate((s.rhoI, s.rhoI, s.rhoJ)):
        rod.mass_second_moment_of_inertia[d, d, :] = inertia * h
        rod.inv_mass_second_moment_of_inertia[d, d, :] = 1.0 / (inertia * h)
    simulator.append(rod)
    simulator.add_forcing_to(rod).using(Pulse)
    simulator.finalize()
    return simulator, rod


def main() -> None:
    """Run what the command line asks for."""
    options = settings()
    t_end = options.get("t_end", Spaghetti.T_END)
    n_steps, stepper = steps(t_end, options["step"]), ea.PositionVerlet()
    seen: list[np.ndarray] = []
    # compiled on its own: numba's work is not timed
    stepper.step(build(options["elements"])[0], 0.0, 1e-12)

    def solve(system: tuple[Any, Any]) -> None:
        seen.clear()
        time = 0.0
        for _ in range(SAMPLES):
            time = ea.integrate(stepper, system[0], t_end / SAMPLES, n_steps, restart_time=time, progress_bar=False)
            seen.extend((system[1].position_collection[:, 0].copy(), system[1].position_collection[:, -1].copy()))

    _, times = timed(lambda: build(options["elements"]), solve)
    answer("pyelastica", version("pyelastica"), seen, times)


if __name__ == "__main__":
    main()
