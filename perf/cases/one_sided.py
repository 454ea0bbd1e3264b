"""What one-sided contact costs a step: balls that bounce along a flexible rail, and a slider that stays on it.

    python perf/cases/one_sided.py

Times of the process, not of the clock: other work on the machine counts little. A step of a ball in flight or on the rail, and
apart from these the hits, which solve for the least jump of all velocities.
"""
from __future__ import annotations

import time
from typing import Any

import fastbeam as fb

SECTION = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=100, EI2=100, EI3=100, rhoA=2.0, rhoI2=1e-3, rhoI3=1e-3)


def model(elements: int, height: float, **contact: Any) -> Any:
    rail = fb.Beam.straight("rail", (0, 0, 0), (10, 0, 0), section=SECTION, elements=elements)
    ball = fb.PointMass("ball", mass=0.5, position=(3.0, 0, height), velocity=(1.0, 0, 0))
    return fb.compile_scene(fb.Scene(rail, ball, fb.Slider("s", ball, rail, at=3.0, **contact), fb.Clamp(rail.start),
                                     fb.Clamp(rail.end), gravity=(0, 0, -9.81)))


def cost(of: Any, t_end: float) -> tuple[float, int]:
    """Least time of a step of three runs, ms, and the events of one."""
    best = float("inf")
    for _ in range(3):
        begin = time.process_time()
        result = fb.simulate(of, t_end=t_end, step=1e-3, progress=False, observe=())
        best = min(best, 1e3 * (time.process_time() - begin) / result.info["steps"])
    return best, len(result.events)


def main() -> None:
    print("elements   in flight, ms   on the rail, ms   a slider, ms")
    for elements in (10, 100, 400):
        flying = cost(model(elements, 5.0, one_sided=(0, 0, 1)), 0.4)
        lying = cost(model(elements, 0.0, one_sided=fb.OneSided((0, 0, 1), catch=True)), 0.4)
        plain = cost(model(elements, 0.0), 0.4)
        print(f"{elements:8}   {flying[0]:13.3f}   {lying[0]:15.3f}   {plain[0]:12.3f}")


if __name__ == "__main__":
    main()
