"""Drift of the invariants over a million steps, and the law by which it grows: a walk (exponent 1/2) or a trend (1).

    python perf/stress/drift.py [steps] [picture.png]     all scenes, with a picture of the growth

Two exponents: of the largest drift up to step n, and of the root mean square of the change over n steps, taken over all
windows of the run, which is the sharper one.
"""
from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    ROOT = Path(__file__).resolve().parents[2]
    sys.path[:0] = [str(ROOT), str(ROOT / "src"), str(ROOT / "tests")]

from small_scenes import SECTION

import fastbeam as fb
from perf.stress.table import Row

Array = np.ndarray
BAR, EVERY = 1e-10, 20
H = {"flight": 5e-3, "ring": 2e-3}


def flight() -> fb.Scene:
    """Isolated: a bowed beam spins about its chord, bends and twists, and a bead swings along it about the crown, which the spin
    makes the lowest place. The mass centre rests."""
    x = np.linspace(-1.5, 1.5, 9)
    bow = fb.Beam.through_points("bow", np.stack((x, 0.7 - 0.3 * x * x, 0.0 * x), axis=1), section=SECTION, elements=4, degree=2)
    bead = fb.PointMass("bead", mass=0.5)
    k = np.pi / bow.length

    def bend(s: Array) -> Array:
        return 0.2 * np.stack((0.0 * s, np.sin(2 * k * s), np.cos(2 * k * s)), axis=1)

    parts = (bow, bead, fb.Slider("run", bead, bow, at=0.4 * bow.length), fb.RigidMotion(spin=(2.0, 0, 0), about=(0, 0.2, 0)),
             fb.InitialVelocity(bow, velocity=bend))
    model = fb.compile_scene(fb.Scene(*parts, project_velocities=True))
    p = fb.simulate(model, t_end=1e-9, step=1e-9, progress=False).series["lin_mom"][0]
    rest = fb.RigidMotion(velocity=-p / (SECTION.rhoA * bow.length + bead.mass))
    return fb.Scene(*parts, rest, name="flight", project_velocities=True)


def ring() -> fb.Scene:
    """A ring swings to and fro on a hanging cable that is held at both ends; it starts far below them."""
    x = np.linspace(-1.0, 1.0, 9)
    section = fb.Section.rectangle(height=0.01, width=0.02, E=1e9, rho=1000.0, nu=0.3)
    cable = fb.Beam.through_points("cable", np.stack((x, 0.6 * (x * x - 1.0), 0.0 * x), axis=1), section=section, elements=6,
                                   degree=2)
    mass = fb.PointMass("ring", mass=0.2)
    return fb.Scene(cable, mass, fb.Clamp(cable.start), fb.Clamp(cable.end),
                    fb.Slider("contact", mass, cable, at=0.3 * cable.length), name="ring", gravity=(0.0, -9.81, 0.0))


SCENES = {"flight": flight, "ring": ring}


@dataclass(frozen=True)
class Growth:
    """Of one invariant: steps n [k], the largest drift up to them [k], the root mean square change over as many [k]."""

    n: Array
    largest: Array
    change: Array

    @property
    def exponents(self) -> tuple[float, float]:
        """Slopes of both in the logarithms from 100 steps on; of the change up to a tenth of the run, where windows abound."""
        def slope(y: Array, most: float) -> float:
            use = (self.n >= 100) & (self.n <= most) & (y > 0.0)
            return float(np.polyfit(np.log(self.n[use]), np.log(y[use]), 1)[0]) if use.sum() > 2 else np.nan

        return slope(self.largest, self.n[-1]), slope(self.change, 0.1 * self.n[-1])


def march(name: str, steps: int, checkpoint: Path | None = None) -> tuple[fb.Result, dict[str, Growth]]:
    """Run one scene; growth of everything it conserves, relative as in `Result.drift`."""
    h = H[name]
    model = fb.compile_scene(SCENES[name]())
    run = fb.simulate(model, t_end=steps * h, step=h, every=EVERY, output=fb.Output(snapshots=0, checkpoint=checkpoint),
                      progress=False)
    out = {}
    for key in run.info["conserved"]:
        x = run.series[key].reshape(len(run.t), -1) / run.info["scale"][key]
        off = np.linalg.norm(x - x[0], axis=1) if key != "gap" else np.abs(x).max(axis=1)
        largest = np.maximum.accumulate(off)
        lags = np.unique(np.logspace(0, np.log10(len(x) - 1), 40).astype(int))
        change = [np.sqrt(np.mean(np.sum((x[k:] - x[:-k])**2, axis=1))) for k in lags]
        out[key] = Growth(lags * EVERY, largest[lags], np.array(change))
    return run, out


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    steps = 20_000 if quick else 1_000_000
    for name in SCENES:
        run, growth = march(name, steps)
        s = run.series["s_slide"]
        yield Row(f"{name}: {steps} steps of {H[name]:g} s", "all done, the contact stays on the beam",
                  f"{run.info['steps']} steps, s from {s.min():.3f} to {s.max():.3f} m", run.info["steps"] == steps)
        for key, of in growth.items():
            a, b = of.exponents
            yield Row(f"{name}: drift of {key}", f"<= {BAR:g}",
                      f"{of.largest[-1]:.1e}, exponent {a:.2f}, of changes {b:.2f}", of.largest[-1] <= BAR)


def picture(growths: dict[str, dict[str, Growth]], path: str) -> None:
    """Largest drift against the number of steps, one panel a scene."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    names = {"total": "energy", "lin_mom": "linear momentum", "ang_mom": "angular momentum", "gap": "gap"}
    figure, panels = plt.subplots(1, len(growths), figsize=(9, 3.6), sharey=True, constrained_layout=True)
    for axes, (name, growth) in zip(panels, growths.items()):
        for k, (key, of) in enumerate(growth.items()):
            shown = of.largest > 0.0
            axes.loglog(of.n[shown], of.largest[shown], color=f"C{k}", label=f"{names[key]}, n^{of.exponents[0]:.2f}")
        n = growth["gap"].n
        axes.loglog(n, 3e-17 * np.sqrt(n), "k:", lw=1, label="n^0.5")
        axes.axhline(BAR, color="0.6", lw=1)
        axes.set(title={"flight": "beam with a bead, in flight", "ring": "ring on a hanging cable"}[name], xlabel="steps n")
        axes.legend(fontsize=8)
    panels[0].set_ylabel("largest relative drift up to step n")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    count = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    found = {}
    for scene in SCENES:
        result, found[scene] = march(scene, count)
        print(scene, f"s {result.series['s_slide'].min():.3f} to {result.series['s_slide'].max():.3f}", result.events)
        for what, value in found[scene].items():
            print(f"  {what:8} {value.largest[-1]:.2e}  exponents {value.exponents[0]:.2f} {value.exponents[1]:.2f}", flush=True)
    if len(sys.argv) > 2:
        picture(found, sys.argv[2])
