"""Precision of what users read: a scene far from the origin and in fast flight against the same scene at rest at the origin.

Both are the same motion, so every difference is an error. X is the largest coordinate, L the size of the scene; a number that is
formed from coordinates can be no better than X/L times its error near the origin: log10(X/L) digits are lost. That, and one more
digit, is the bar. Energies and momenta are compared with their own size.
"""
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from small_scenes import bent, free_beam, straight

import fastbeam as fb
from perf.stress.table import Row

Array = np.ndarray
AWAY, ALONG = np.array((0.8, -0.5, 0.33)), np.array((0.6, 0.0, 0.8))
LENGTH, H, STEPS = 3.0, 2e-3, 250
DRIFT = 1e-11


def scene(offset: Array, velocity: Array, mass: float = 0.5) -> fb.Scene:
    """A mass slides on a beam that flies, bends and turns."""
    rail, bead = straight("rail", tuple(offset), tuple(offset + (LENGTH, 0, 0))), fb.PointMass("bead", mass=mass)
    return fb.Scene(rail, bead, fb.Slider("run", bead, rail, at=1.0, rate=0.5), bent(rail), fb.RigidMotion(velocity=velocity),
                    name="far away", project_velocities=True)


def fly(distance: float, speed: float, mass: float = 0.5, h: float = H) -> fb.Result:
    """The run at a distance from the origin and a speed."""
    model = fb.compile_scene(scene(distance * AWAY, speed * ALONG, mass))
    return fb.simulate(model, t_end=STEPS * H, step=h, every=1, output=fb.Output(snapshots=0), progress=False,
                       observe=("energy", "momentum", "slider", "inner"))


def errors(run: fb.Result, exact: fb.Result) -> dict[str, float]:
    """Largest differences relative to the largest values of the exact run; s and gap to the length."""
    def off(name: str) -> float:
        x = exact.series[name]
        scale = LENGTH if name == "s_slide" else float(np.abs(x).max())
        return float(np.abs(run.series[name] - x).max()) / scale

    return {"contact force": off("contact_force"), "sliding coordinate": off("s_slide"), "strain energy": off("strain"),
            "inner energy": off("inner_energy"), "spin about the mass centre": off("inner_spin"),
            "gap": float(np.abs(run.series["gap"]).max()) / LENGTH}


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    for mass in (0.5, 5e3):
        exact = fly(0.0, 0.0, mass)
        # round-off near the origin, measured: the same scene a few metres away
        near = errors(fly(5.0, 1.0, mass), exact)
        name = f"mass {mass:g} kg"
        for what, value in near.items():
            yield Row(f"{name}, 5 m away: {what}", "shown", f"error {value:.1e}", True)
        for distance, speed in ((1e6, 0.0), (0.0, 1e4), (1e6, 1e4)):
            run = fly(distance, speed, mass)
            reach = distance + speed * STEPS * H
            room = np.log10(reach / LENGTH) + 1.0
            where = f"{name}, {distance:g} m away, {speed:g} m/s"
            for what, value in errors(run, exact).items():
                lost = np.log10(value / max(near[what], 1e-16)) if value > 0.0 else 0.0
                yield Row(f"{where}: {what}", f"loses at most {room:.1f} digits", f"error {value:.1e}, {lost:.1f} digits lost",
                          lost <= room)
            energy = run.series["total"]
            inner = float(np.ptp(run.series["inner_energy"])) / float(exact.series["inner_energy"][0])
            absolute = float(np.ptp(energy)) / float(exact.series["total"][0])
            # at rest the total is as small as the scene's own energy, and the rounding of coordinates does work on it
            bar = DRIFT if speed else DRIFT * reach / LENGTH
            yield Row(f"{where}: drift of energy", f"<= {bar:.0e} of its size",
                      f"{run.drift('total'):.1e}; of the energy at rest: {absolute:.1e}, inner {inner:.1e}",
                      run.drift("total") <= bar)
            for key in ("lin_mom", "ang_mom"):
                drift = run.drift(key)
                yield Row(f"{where}: drift of {key}", f"<= {DRIFT:.0e} of its size", f"{drift:.1e}", drift <= DRIFT)
    yield from small_steps()
    yield from long_runs(10_000 if quick else 40_000)


def small_steps() -> Iterator[Row]:
    """Contact forces are second differences of rounded coordinates: their noise grows as X/h^2, and with the root of the number
    of steps, because nothing damps it."""
    for distance in (5.0, 1e6):
        found: list[float] = []
        for h in (4e-3, 2e-3, 1e-3):
            exact = fly(0.0, 0.0, h=h)
            # one distance alone shows more luck than noise
            each = [errors(fly(share * distance, 0.0, h=h), exact)["contact force"] for share in (0.6, 0.77, 0.9, 1.0, 1.03)]
            found.append(float(np.sqrt(np.mean(np.square(each)))))
        bar = 64.0 * max(found[0], 1e-15)
        yield Row(f"contact force {distance:g} m away, steps of 4, 2, 1 ms", "noise grows no faster than as h^-3",
                  "errors " + ", ".join(f"{x:.1e}" for x in found), found[-1] <= bar)


def long_runs(n: int) -> Iterator[Row]:
    """Round-off may walk, but not march: the rounding of 2/h must not reach the momentum."""
    model: Any = fb.compile_scene(free_beam())
    for h in (2e-3, 1.0 / 512):
        run = fb.simulate(model, t_end=n * h, step=h, output=fb.Output(snapshots=0), progress=False)
        for key in ("lin_mom", "ang_mom"):
            bar = 1e-15 * np.sqrt(n)
            yield Row(f"{n} steps of {h:.6g} s: drift of {key}", f"<= {bar:.0e}", f"{run.drift(key):.1e}", run.drift(key) <= bar)
        # the energy walks by more than its last digit a step; over windows of growing length a march would have exponent 1
        x = run.series["total"] / run.info["scale"]["total"]
        lags = np.unique(np.logspace(0, np.log10(len(x) / 10), 12).astype(int))
        change = [float(np.sqrt(np.mean((x[k:] - x[:-k])**2))) for k in lags]
        slope = float(np.polyfit(np.log(lags), np.log(change), 1)[0])
        yield Row(f"{n} steps of {h:.6g} s: energy", "walks: exponent of its changes <= 0.7",
                  f"drift {run.drift('total'):.1e}, exponent {slope:.2f}", slope <= 0.7)
