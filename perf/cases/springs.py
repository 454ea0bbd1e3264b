"""Chains of masses on springs and of bodies on bushings: time of a Newton iteration for each link.

    python perf/cases/springs.py                    chains of 1000, 10 000 and 100 000 links of every kind
    python perf/cases/springs.py --links 5000       one size

Chains of up to 1000 links hang from the ground side by side and swing under their weight. Kinds: linear springs; ropes, slack
in part, with damping; damped springs; the same by a law (LineForce); tables of 20 points; bushings, with damping too. Prints the
time to compile the scene, Newton iterations a step, the time of an iteration for each link, nodes included, and how well the
energies add up.
"""
from __future__ import annotations

import os

os.environ.setdefault("FASTBEAM_THREADS", "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

STEP, STEPS, LONGEST = 1e-3, 10, 1000
KINDS = ("linear", "ropes", "dampers", "laws", "tables", "bushings", "damped bushings")


def strut(t: float, length: float, rate: float, parameters: Any) -> float:
    """A damped spring as a law of one's own."""
    return parameters[0] * (length - parameters[1]) + parameters[2] * rate


def chains(links: int, kind: str) -> Any:
    """Chains of up to 1000 links along x, 0.1 m each."""
    import fastbeam as fb
    parts: list[Any] = []
    e = np.linspace(-0.05, 0.05, 20)
    six = (1e3, 1e3, 1e3, 1.0, 1.0, 1.0)
    for first in range(0, links, LONGEST):
        y = 0.1 * first / LONGEST
        last: Any = fb.GROUND.point((0, y, 0))
        for k in range(min(LONGEST, links - first)):
            name, place = f"{first + k}", (0.1 * (k + 1), y, 0.01 * (k % 2))
            if "bushings" in kind:
                part: Any = fb.RigidBody(f"m{name}", mass=0.1, inertia=(1e-4, 2e-4, 2e-4), position=place)
                damping = tuple(1e-3 * x for x in six) if kind.startswith("damped") else None
                link: Any = fb.Bushing(last, part, f"s{name}", stiffness=six, damping=damping)
            else:
                part = fb.PointMass(f"m{name}", mass=0.1, position=place)
                more = {"linear": {"stiffness": 1e3}, "dampers": {"stiffness": 1e3, "damping": 0.1}, "laws": {},
                        "ropes": {"stiffness": 1e3, "tension_only": True, "damping": 0.1},
                        "tables": {"table": (e, 1e3 * e + 1e5 * e**3)}}[kind]
                law = fb.LineForce(last, part, f"s{name}", law=strut, parameters=(1e3, 0.1, 0.1)) if kind == "laws" else None
                link = law or fb.Spring(last, part, f"s{name}", length=0.1, **more)
            parts += [part, link]
            last = part
    return fb.Scene(*parts, gravity=(0, 0, -9.81))


def measure(links: int, kind: str) -> tuple[float, float, float, float]:
    """Compile time, iterations a step, seconds an iteration and link, error of the balance."""
    import fastbeam as fb
    from perf.places import private
    Stepper = private("newton", "Stepper")
    Observer = private("observe", "Observer")
    begin = time.perf_counter()
    model = fb.compile_scene(chains(links, kind), planar=False)
    compiled = time.perf_counter() - begin
    stepper, observer = Stepper(model, np.ones(1)), Observer(model, ("energy",), None)
    stepper.advance(0.0, STEP, 2)
    rows = [observer.row(0.0, stepper.state)]
    begin = time.perf_counter()
    done = stepper.advance(0.0, STEP, STEPS, 2)
    seconds = time.perf_counter() - begin
    assert done.status == 0, done
    rows.append(observer.row(0.0, stepper.state))
    name = "balance" if "balance" in rows[0] else "total"
    error = abs(rows[1][name] - rows[0][name]) / max(abs(row[x]) for row in rows for x in ("kinetic", "potential"))
    return compiled, done.iterations / STEPS, seconds / done.iterations / links, error


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of an iteration for each spring or bushing of a chain.")
    parser.add_argument("--links", type=int, nargs="*", default=[1000, 10_000, 100_000])
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=KINDS)
    given = parser.parse_args()
    print(f"{'kind':<18}{'links':>8}{'compile':>10}{'iterations':>12}{'a link':>12}{'balance':>10}")
    for kind in given.kinds:
        for links in given.links:
            compiled, iterations, seconds, error = measure(links, kind)
            print(f"{kind:<18}{links:>8}{compiled:>8.2f} s{iterations:>12.1f}{1e6 * seconds:>9.2f} us{error:>10.1e}", flush=True)


if __name__ == "__main__":
    main()
