"""A tendon robot in time, whose eyes all stick and slip together: failed steps, balance, and forces of two step sizes.

    python perf/cases/tendon_robot.py
    python perf/cases/tendon_robot.py --discs 10 --t-end 0.3

A spine of nitinol carries discs, and tendons run through eyes in all of them, each with Coulomb friction: 20 discs and 4 tendons
are 80 contacts. One tendon is pulled and let go. Printed for each step size are failed steps, events of steps that missed the
law, iterations of a step, the balance of energy, and how far the forces of the eyes, means over 50 ms, are from those of the
smaller steps, as a share of the largest. The bar: no failed step, none that missed the law, balance 1e-12, forces within 2 %.
"""
from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import fastbeam as fb

LENGTH, OFFSET, TAIL = 0.3, 8e-3, 0.08
SPINE = fb.Section.circle(radius=0.5e-3, E=60e9, rho=6450.0, damping=1e-3)
STRING = fb.Section(EA=1.4e4, GA2=1.4e4, GA3=1.4e4, GJ=1e-6, EI2=1e-6, EI3=1e-6, rhoA=5e-4, rhoI2=1e-11, rhoI3=1e-11,
                    damping=1e-3)
STEPS, ROW, WINDOW = (1e-3, 5e-3), 5e-3, 10
BALANCE, FORCES = 1e-12, 0.02


def ease(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


def pull(t: float) -> float:
    """N, of the tendon that is pulled; the others have 1 N."""
    return 1.0 + 1.5 * (ease((t - 0.1) / 0.5) - ease((t - 0.8) / 0.5))


def robot(discs: int, tendons: int, friction: float | None) -> fb.Scene:
    """It lies along x; the first disc of the spine is its end at x = LENGTH/discs."""
    spine = fb.Beam.straight("spine", (0, 0, 0), (LENGTH, 0, 0), section=SPINE, elements=2 * discs)
    scene = fb.Scene(spine, fb.Clamp(spine.start), fb.Drag("air", spine, linear=20.0 * SPINE.rhoA))
    bodies = []
    for k in range(1, discs + 1):
        x = k * LENGTH / discs
        bodies.append(fb.RigidBody(f"disc {k}", mass=1e-3, inertia=(3e-8, 1.5e-8, 1.5e-8), position=(x, 0, 0)))
        scene.add(bodies[-1], fb.RigidConnection(spine.at(x), bodies[-1]))
    ends = np.concatenate(([0.0, TAIL / 2], TAIL + np.linspace(0.0, LENGTH, 3 * discs + 1)))
    for n in range(tendons):
        angle = 2.0 * np.pi * n / tendons
        arm = OFFSET * np.array([0.0, np.sin(angle), np.cos(angle)])
        tendon = fb.Beam.straight(f"tendon {n}", arm - (TAIL, 0, 0), arm + (LENGTH, 0, 0), section=STRING, elements=ends)
        base = fb.PointMass(f"base {n}", mass=1.0, position=arm)
        force: Callable[[float], float] = pull if n == 0 else lambda t: 1.0
        scene.add(tendon, base, fb.Pin(base), fb.Slider(f"eye {n}.0", base, tendon, at=TAIL, friction=friction),
                  fb.Load(f"pull {n}", tendon.start, force=(-1.0, 0, 0), time=force),
                  fb.RigidConnection(bodies[-1].point(arm), tendon.end))
        for k, disc in enumerate(bodies[:-1], 1):
            scene.add(fb.Slider(f"eye {n}.{k}", disc.point(arm), tendon, at=TAIL + k * LENGTH / discs, friction=friction))
    return scene


def start_of(model: Any, discs: int, tendons: int) -> Any:
    """At rest under the first pulls, without friction, where no eye is loaded."""
    return fb.solve_static(fb.compile_scene(robot(discs, tendons, None)), at_time=0.0).state_for(model)


def run(model: Any, start: Any, step: float, t_end: float) -> fb.Result:
    """As far as it comes."""
    try:
        return fb.simulate(model, start=start, t_end=t_end, step=step, every=round(ROW / step), progress=False)
    except fb.ConvergenceError as error:
        assert isinstance(error.result, fb.Result)
        return error.result


def means(result: fb.Result) -> np.ndarray:
    """Forces of the eyes on the discs [n, eyes, 3], means over WINDOW rows: tendons between discs vibrate."""
    total = np.cumsum(result.series["contact_force"][1:], axis=0)
    return (total[WINDOW:] - total[:-WINDOW]) / WINDOW


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--discs", type=int, default=20)
    parser.add_argument("--tendons", type=int, default=4)
    parser.add_argument("--friction", type=float, default=0.2)
    parser.add_argument("--t-end", type=float, default=0.6)
    given = parser.parse_args()
    model = fb.compile_scene(robot(given.discs, given.tendons, given.friction))
    start = start_of(model, given.discs, given.tendons)
    good, fine = True, None
    for step in STEPS:
        begin = time.process_time()
        result = run(model, start, step, given.t_end)
        kinds = [x["kind"] for x in result.events]
        failed, missed = kinds.count("failed"), kinds.count("unresolved")
        drift, forces = result.drift("balance"), means(result)
        text = ""
        if fine is None:
            fine = forces
        elif not failed:
            off = float(np.max(np.abs(forces - fine)) / np.max(np.abs(fine)))
            good, text = good and off < FORCES, f", forces off by {100 * off:.2f} % of the largest"
        good = good and not failed and not missed and drift < BALANCE
        print(f"steps of {1e3 * step:g} ms to t = {result.t[-1]:.3f} s: {failed} failed, {missed} missed the law, "
              f"{result.info['iterations'] / result.info['steps']:.1f} iterations a step, balance {drift:.1e}{text}; "
              f"{time.process_time() - begin:.1f} s of processor time", flush=True)
    print("all within the bar" if good else "the bar is missed")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
