"""One run of OpenSees: `python opensees_run.py '{"scene": "spaghetti3d", "elements": 40, "step": 0.01}'`.

Corotational elasticBeamColumn elements: no shear; the rotary inertia is lumped to the nodes by hand (line elements carry
none) and acts on the rates of rotation vectors, so gyroscopic terms are missing. Its solution is one of another model.

Settings: elements, step, integrator ('Newmark' or 'HHT'), system ('UmfPack', 'SparseGeneral', 'BandGeneral'), algorithm.
"""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import openseespy.opensees as ops  # noqa: E402
from protocol import SAMPLES, answer, settings, steps, timed  # noqa: E402
from scenes import Spaghetti  # noqa: E402

OPTIONS: dict[str, Any] = {"integrator": "Newmark", "system": "UmfPack", "algorithm": "Newton", "tolerance": 1e-9}
INTEGRATORS: dict[str, tuple[Any, ...]] = {"Newmark": ("Newmark", 0.5, 0.25), "HHT": ("HHT", 0.9)}


def build(options: dict[str, Any]) -> dict[str, Any]:
    """The model; returns a place for what the run says."""
    s, n = Spaghetti.SECTION, options["elements"]
    h = Spaghetti.LENGTH / n
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for i in range(n + 1):
        x = [a + (b - a) * i / n for a, b in zip(Spaghetti.START, Spaghetti.END)]
        ops.node(i + 1, *x)
        share = h * (0.5 if i in (0, n) else 1.0)
        ops.mass(i + 1, *[s.rhoA * share] * 3, *[s.rhoI * share] * 3)
    ops.geomTransf("Corotational", 1, 0, 0, 1)
    for e in range(1, n + 1):  # E = G = 1: areas are stiffnesses
        ops.element("elasticBeamColumn", e, e, e + 1, s.EA, 1.0, 1.0, s.GJ, s.EI, s.EI, 1)
    ops.timeSeries("Path", 1, "-time", 0.0, Spaghetti.PEAK, 2 * Spaghetti.PEAK, 1e9, "-values", 0.0, 1.0, 0.0, 0.0)
    ops.pattern("Plain", 1, 1)
    ops.load(1, *Spaghetti.FORCE, *Spaghetti.MOMENT)
    ops.system(options["system"])
    ops.numberer("RCM")
    ops.constraints("Plain")
    ops.test("NormDispIncr", options["tolerance"], 30)
    ops.algorithm(options["algorithm"])
    ops.integrator(*INTEGRATORS[options["integrator"]])
    ops.analysis("Transient")
    return {"message": "", "points": []}


def main() -> None:
    """Run what the command line asks for."""
    options = {**OPTIONS, **settings()}
    t_end = options.get("t_end", Spaghetti.T_END)
    n_steps = steps(t_end, options["step"])

    def solve(system: dict[str, Any]) -> None:
        for _ in range(SAMPLES):
            if ops.analyze(n_steps, options["step"]) != 0:
                system["message"] = f"no convergence at t = {ops.getTime():g} s"
                return
            for k in (1, options["elements"] + 1):
                system["points"].append([x + ops.nodeDisp(k, i + 1) for i, x in enumerate(ops.nodeCoord(k))])

    system, times = timed(lambda: build(options), solve)
    answer("opensees", str(ops.version()), system["points"], times, system["message"])


if __name__ == "__main__":
    main()
