"""What scenes cost beside others that are as hard: spins that nothing resists, a rope drawn with a corner, many functions of
time, rows of every step.

    python perf/cases/needless.py

Printed are ratios of processor time, measured in turn in one process, and their bars. Exits with 1 where a bar is missed.
"""
from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from perf.printing import Bar, judged  # noqa: E402

ROUNDS = 3
STEEL = fb.Section.tube(radius=0.03, thickness=0.003, E=210e9, rho=7850.0)


def in_turn(*calls: Callable[[], Any]) -> list[float]:
    """Least processor time of each, s; all were called once before."""
    times: list[list[float]] = [[] for _ in calls]
    for k in range(ROUNDS + 1):
        for call, own in zip(calls, times):
            begin = time.process_time()
            call()
            if k:
                own.append(time.process_time() - begin)
    return [min(own) for own in times]


def robot(joint: Any, discs: int = 5) -> Any:
    """A rod with discs that four tendons bend, whose ends hang on such joints."""
    rod = fb.Section.circle(radius=1e-3, E=200e9, rho=8000.0)
    thin = fb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1e-6, EI2=1e-6, EI3=1e-6, rhoA=1e-6, rhoI2=1e-12, rhoI3=1e-12)
    spine = fb.Beam.straight("spine", (0, 0, 0), (0.5, 0, 0), section=rod, elements=2 * discs)
    scene = fb.Scene(spine, fb.Clamp(spine.start), gravity=(0, -9.81, 0))
    bodies = [fb.RigidBody(f"disc {k}", mass=1e-8, inertia=(3e-8, 1.5e-8, 1.5e-8), position=(k * 0.5 / discs, 0, 0))
              for k in range(1, discs + 1)]
    for k, disc in enumerate(bodies, 1):
        scene.add(disc, fb.RigidConnection(spine.at(k * 0.5 / discs), disc))
    for n, pull in enumerate((5.0, 0.5, 0.5, 0.5)):
        arm = 15.06e-3 * np.array([0.0, np.sin(n * np.pi / 2), np.cos(n * np.pi / 2)])
        ends = np.concatenate([[0.0, 0.04], 0.08 + np.linspace(0, 0.5, 3 * discs + 1)])
        tendon = fb.Beam.straight(f"tendon {n}", arm - (0.08, 0, 0), arm + (0.5, 0, 0), section=thin, elements=ends)
        eye = fb.PointMass(f"eye {n}", mass=1.0, position=arm)
        scene.add(tendon, eye, fb.Pin(eye), fb.Slider(f"eye {n}.0", eye, tendon, at=0.08),
                  fb.Load(f"pull {n}", tendon.start, force=(-pull, 0, 0)), joint(bodies[-1].point(arm), tendon.end),
                  *(fb.Slider(f"eye {n}.{k}", disc.point(arm), tendon, at=0.08 + k * 0.5 / discs)
                    for k, disc in enumerate(bodies[:-1], 1)))
    return fb.compile_scene(scene)


def droppers(joint: Any, count: int = 90) -> Any:
    """A catenary of a railway whose droppers hang on ball joints, below on such joints."""
    wire = fb.Section(EA=1.7e7, GA2=6e6, GA3=6e6, GJ=150.0, EI2=195.0, EI3=195.0, rhoA=1.35, rhoI2=1.6e-5, rhoI3=1.6e-5)
    thin = fb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1e-3, EI2=1e-3, EI3=1e-3, rhoA=1e-3, rhoI2=1e-9, rhoI3=1e-9)
    top, low = (fb.Beam.straight(name, (0, 0, z), (6.0 * (count + 1), 0, z), section=wire, elements=count + 1, prestress=pull)
                for name, z, pull in (("top", 1, 2e4), ("low", 0, 1e4)))
    scene = fb.Scene(top, low, *[fb.Pin(x) for x in (top.start, top.end, low.start, low.end)], gravity=(0, 0, -9.81))
    for k in range(1, count + 1):
        dropper = fb.Beam.straight(f"dropper {k}", (6.0 * k, 0, 1), (6.0 * k, 0, 0), section=thin, elements=1)
        scene.add(dropper, fb.BallJoint(top.at(6.0 * k), dropper.start), joint(low.at(6.0 * k), dropper.end))
    return fb.compile_scene(scene)


def bed(t: float, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    """An elastic seabed, 200 m below."""
    depth = -200.0 - position[2]
    if depth > 0.0:
        force[2] = 2.7e5 * depth


def steps_of_corner() -> int:
    """Load steps of a mooring line that is drawn with a corner, until it is solved or refused."""
    b = 557.0

    def curve(q: float) -> Any:
        s = 850.0 * q
        risen = max(0.0, s - b) / (850.0 - b)
        return np.array([min(s, b) + 215.0 * risen, 0, 200.0 * risen - 200.0])

    chain = fb.Section(EA=7.5e8, GA2=2e8, GA3=2e8, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=113.0, rhoI2=0.1, rhoI3=0.1)
    line = fb.Beam.from_curve("line", curve, section=chain, elements=40)
    scene = fb.Scene(line, fb.Clamp(line.start), fb.Pin(line.end), fb.UserForce("seabed", line, bed),
                     fb.DistributedLoad("wet weight", line, force=(0, 0, -1047.0)))
    try:
        return int(fb.solve_static(fb.compile_scene(scene)).info["steps"])
    except fb.ConvergenceError as failed:
        return len(failed.result.t)


def frame(timed: bool, size: int = 12) -> Any:
    """A frame of beams with a load on each, constant or with a function of time of its own."""
    scene = fb.Scene()
    posts: dict[tuple[int, int], fb.Beam] = {}
    for i in range(size + 1):
        for k in range(size):
            post = posts[i, k] = fb.Beam.straight(f"post {i} {k}", (i, 0, k), (i, 0, k + 1), section=STEEL, elements=1)
            scene.add(post, fb.RigidConnection(posts[i, k - 1].end, post.start) if k else fb.Clamp(post.start))
    for i in range(size):
        for k in range(size):
            beam = fb.Beam.straight(f"beam {i} {k}", (i, 0, k + 1), (i + 1, 0, k + 1), section=STEEL, elements=1)
            function = {"time": lambda t, p=1 + i + k: np.sin(p * t)} if timed else {}
            scene.add(beam, fb.RigidConnection(posts[i, k].end, beam.start), fb.RigidConnection(posts[i + 1, k].end, beam.end),
                      fb.DistributedLoad(f"load {i} {k}", beam, force=(0, 0, -100.0), **function))
    return fb.compile_scene(scene)


def bars() -> list[Bar]:
    """Everything that is measured."""
    out: list[Bar] = []

    def ratio(what: str, most: float, one: Callable[[], Any], other: Callable[[], Any]) -> None:
        a, b = in_turn(one, other)
        out.append((what, most, a / b, f"{1e3 * a:.0f} ms next to {1e3 * b:.0f} ms"))

    for what, made in (("tendons", robot), ("droppers", droppers)):
        loose, welded = made(fb.BallJoint), made(fb.RigidConnection)
        ratio(f"statics of {what} on ball joints, next to welded ones", 1.5, partial(fb.solve_static, loose),
              partial(fb.solve_static, welded))
    out.append(("load steps of a rope drawn with a corner", 200, steps_of_corner(), ""))
    timed, constant = (partial(fb.simulate, frame(x), t_end=0.02, step=1e-3) for x in (True, False))
    ratio("144 loads with functions of time, next to constant ones", 1.1, timed, constant)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=STEEL, elements=8)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81)))
    run = partial(fb.simulate, model, t_end=1.0, step=1e-3)
    ratio("rows of every step, next to two rows", 1.2, partial(run, every=1), partial(run, every=1000))
    return out


if __name__ == "__main__":
    sys.exit(bool(judged(bars())))
