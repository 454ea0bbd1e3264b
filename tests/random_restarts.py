"""Random restarts across models: the state at the end of a run goes to another scene of the same parts, with joints added,
removed or moved. Momenta and energy are accounted for, by numbers of the run before, or the start is refused.

What both scenes have is always the same kinds of parts and joints, so that one set of compiled kernels does for all of them.
"""
from __future__ import annotations

from typing import Any

import numpy as np

import fastbeam as fb

Array = np.ndarray
BAR = 1e-12
STEP, STEPS = 0.004, 5
# what joins two of three rods, a body and a mass, or nothing
KINDS = ("none", "weld", "ball", "hinge", "universal", "rod")


def scene(rng: np.random.Generator, joints: dict[str, str], moved: float, speed: float, kicked: bool) -> fb.Scene:
    """Parts with these joints, all in motion; moved: how far points of joints on bodies lie from where they were, m.

    Rods lie within 1 m of the origin: energy is known no better than to axial force times the last place of a coordinate, which
    made 5.5e-13 of the kinetic energy at 1 mm/s and up to 3 m (waves run at 100 m/s).
    """
    section = fb.Section.circle(radius=0.01, E=1e7, rho=1000.0)
    line = [np.array([0.65 * k - 0.975, 0.08 * k * k - 0.36, 0.0]) for k in range(4)]
    rods = [fb.Beam.straight(f"rod {k}", line[k], line[k + 1], section=section, elements=2, degree=2) for k in range(3)]
    tip = line[3]
    body = fb.RigidBody("body", mass=0.3, inertia=(0.01, 0.02, 0.03), position=tip + (0.3, 0.0, 0.1))
    bob = fb.PointMass("bob", mass=0.1, position=line[0] + (0.2, -0.5, 0.1))
    off = moved * rng.standard_normal(3)
    at_body = body.point(tip - body.position + off)
    parts: list[Any] = [*rods, body, bob]
    ends = {"first": (rods[0].end, rods[1].start), "second": (rods[1].end, rods[2].start), "tip": (rods[2].end, at_body)}
    for name, (a, b) in ends.items():
        far = name == "tip" and moved > 0.0
        kind = joints[name]
        if kind == "weld":
            parts.append(fb.RigidConnection(a, body if name == "tip" else b, name=name))
        elif kind == "ball" and not far:
            parts.append(fb.BallJoint(a, b, name=name))
        elif kind == "hinge" and not far:
            parts.append(fb.RevoluteJoint(a, b, name, axis=(0, 0, 1)))
        elif kind == "universal" and not far:
            parts.append(fb.UniversalJoint(a, b, name, axis_a=(0, 1, 0), axis_b=(0, 0, 1)))
        elif kind == "rod" or far and kind != "none":
            parts.append(fb.DistanceJoint(a, body if name == "tip" else bob, name=name))
    # always there: a tie, a joint with multipliers and a slider
    rail = fb.Beam.straight("rail", (-0.4, 0.9, 0), (0.6, 0.9, 0), section=section, elements=2, degree=2)
    hook = fb.RigidBody("hook", mass=0.2, inertia=(0.01, 0.01, 0.02), position=(0.8, 0.9, 0))
    arm = fb.RigidBody("arm", mass=0.2, inertia=(0.01, 0.02, 0.01), position=(0.8, 1.2, 0))
    ring = fb.PointMass("ring", mass=0.05)
    parts += [rail, hook, arm, ring, fb.RigidConnection(rail.end, hook), fb.Slider("slide", ring, rail, at=0.4, rate=0.1),
              fb.RevoluteJoint(hook.point((0, 0.2, 0)), arm.point((0, -0.1, 0)), "elbow", axis=(1, 0, 0))]
    if kicked:
        parts += [fb.RigidMotion(part, velocity=speed * rng.standard_normal(3), spin=speed * rng.standard_normal(3))
                  for part in (*rods, body, bob, rail)]
    return fb.Scene(*parts, project_velocities=True)


def random_joints(rng: np.random.Generator) -> dict[str, str]:
    return {name: str(rng.choice(KINDS)) for name in ("first", "second", "tip")}


def restart(seed: int) -> tuple[str, float]:
    """What became of one restart, 'refused', 'taken' or 'mended', and the largest error of momenta and energy, relative to what
    there is of them."""
    rng = np.random.default_rng(seed)
    speed = float(10.0**rng.uniform(-3.0, 0.5))
    # half of them undock or dock one joint, the others begin with anything
    before = random_joints(rng)
    after = random_joints(rng) if rng.random() < 0.5 else before | {str(rng.choice(list(before))): str(rng.choice(KINDS))}
    moved = float(10.0**rng.uniform(-6.0, -2.0)) if rng.random() < 0.3 else 0.0
    one = fb.compile_scene(scene(rng, before, 0.0, speed, True), planar=False)
    two = fb.compile_scene(scene(rng, after, moved, speed, False), planar=False)
    options: dict[str, Any] = dict(step=STEP, t_end=STEPS * STEP, every=1, output=fb.Output(snapshots=0), progress=False)
    run = fb.simulate(one, **options)
    start, mend = run.state_for(two), bool(rng.random() < 0.7)
    try:
        on = fb.simulate(two, start=fb.Start(start, mend=mend), **options)
    except fb.SceneError as refusal:
        if "start: " not in str(refusal):
            raise
        return "refused", 0.0
    except fb.ConvergenceError:
        # light rods that were hit and spin: the message asks for smaller steps
        return "too fast for these steps", 0.0
    errors = []
    for name in ("lin_mom", "ang_mom"):
        scale = max(run.info["scale"][name], on.info["scale"][name])
        errors.append(float(np.max(np.abs(on.series[name] - run.series[name][-1]))) / scale)
    books = on.balance()["sum"]
    scale = max(run.info["scale"]["total"], on.info["scale"]["total"])
    errors.append(float(np.max(np.abs(books - run.series["total"][-1]))) / scale)
    mended = any(event["kind"] == "mended" for event in on.events)
    lost = on.balance().get("impact at the start", np.zeros(1))[0]
    assert lost >= -BAR * scale, f"seed {seed}: an impact gave {-lost:g} J"
    return "mended" if mended else "taken", max(errors)
