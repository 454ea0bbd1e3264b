"""Joints in trees of rigid parts have plain multipliers, those in loops the augmented Lagrangian; long chains converge by it."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.stepping.stepper import Stepper

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_constraints import largest_gap  # noqa: E402


def links(n: int, *, both_ends: bool = False, alternating: bool = True, name: str = "") -> list[Any]:
    """n bodies of 0.1 m between hinges from the ground on, in a half circle; both_ends: and at their end to the ground again.
    Axes are turned by a right angle from joint to joint, or all across the half circle."""
    angle = np.linspace(0.0, np.pi, n + 1)
    ends = 0.05 / np.sin(0.5 * np.pi / n) * np.column_stack((-np.cos(angle), np.zeros(n + 1), -np.sin(angle)))
    half = 0.5 * np.diff(ends, axis=0)
    bodies = [fb.RigidBody(f"{name}link {k}", mass=0.1, inertia=(1e-4, 1e-4, 1e-4), position=ends[k] + half[k]) for k in range(n)]
    before = [fb.GROUND, *(body.point(x) for body, x in zip(bodies, half))]
    joints = [fb.RevoluteJoint(before[k], bodies[k].point(-half[k]), f"{name}joint {k}",
                               axis=-ends[k] if alternating and k % 2 else (0, 1, 0)) for k in range(n)]
    if both_ends:
        joints.append(fb.RevoluteJoint(fb.GROUND, bodies[-1].point(half[-1]), f"{name}joint {n}", axis=(0, 1, 0)))
    return [*bodies, *joints]


def softness(*parts: Any) -> np.ndarray:
    return fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -9.81)), planar=False).kept_softness


def test_trees_are_plain_and_loops_are_not() -> None:
    assert np.all(softness(*links(5)) == 0.0)
    assert np.all(softness(*links(5, both_ends=True)) == 1.0)
    # a free chain that hangs on nothing, and a loop beside it that reaches the ground
    free = links(3, name="free ")
    free = [part for part in free if getattr(part, "name", "") != "free joint 0"]
    both = softness(*free, *links(4, both_ends=True))
    assert sorted(set(both)) == [0.0, 1.0]
    # two hinges on one axis between the same bodies
    a, b = (fb.RigidBody(x, mass=1.0, inertia=(1, 1, 1), position=(0, 0, z)) for x, z in (("a", 0.0), ("b", 1.0)))
    twice = [fb.RevoluteJoint(a.point((x, 0, 0)), b.point((x, 0, -1)), f"hinge {x}", axis=(1, 0, 0)) for x in (0, 1)]
    assert np.all(softness(a, b, *twice) == 1.0)
    assert np.all(softness(a, b, twice[0]) == 0.0)


def test_eliminated_joints_and_beams_count_as_well() -> None:
    a, b = (fb.RigidBody(x, mass=1.0, inertia=(1, 1, 1), position=(0, 0, z)) for x, z in (("a", 0.0), ("b", 1.0)))
    hinge = fb.RevoluteJoint(a.point((0, 0, 0.5)), b.point((0, 0, -0.5)), "hinge", axis=(1, 0, 0))
    anchor = fb.PointMass("anchor", mass=1.0, position=(0, 0, -0.5))
    hung = [anchor, fb.Pin(anchor), fb.BallJoint(a.point((0, 0, -0.5)), anchor)]
    assert np.all(softness(a, b, hinge, *hung) == 0.0)
    # the beam bends: what it joins is no loop of rigid parts; clamped at both ends its ends are the ground
    beam = fb.Beam.straight("beam", (0, 0, 1.5), (0, 0, 3), section=fb.Section.circle(radius=0.01, E=1e9, rho=1e3), elements=2)
    top = fb.RevoluteJoint(b.point((0, 0, 0.5)), beam.start, "top", axis=(0, 1, 0))
    assert np.all(softness(a, b, hinge, beam, top, *hung) == 0.0)
    assert np.all(softness(a, b, hinge, beam, top, *hung, fb.Clamp(beam.end)) == 0.0)
    assert np.all(softness(a, b, hinge, beam, top, fb.Clamp(beam.start), *hung) == 1.0)


def test_long_loops_are_held_more_strongly() -> None:
    n = 300
    found = softness(*links(n, both_ends=True))
    # the body in the middle is 150 links from the ground
    assert np.all(found == found[0]) and found[0] == pytest.approx((30.0 / 150.0)**2, rel=1e-12)


@pytest.mark.parametrize(("both_ends", "alternating"), [(False, True), (True, True), (True, False)])
def test_chains_of_many_links_converge(both_ends: bool, alternating: bool) -> None:
    """The gap that an iteration leaves grew with n^2: 10 iterations with 4000 links, none converged with 10 000. With parallel
    axes the loop is redundant."""
    model = fb.compile_scene(fb.Scene(*links(2000, both_ends=both_ends, alternating=alternating), gravity=(0, 0, -9.81)),
                             planar=False)
    stepper = Stepper(model, np.ones(1))
    done = stepper.advance(0.0, 1e-3, 20)
    assert done.status == 0 and done.iterations <= 20 * 3.5
    # coordinates of 100 m have a last digit of 1.4e-14
    assert largest_gap(model, stepper.state.q) < 1e-13
    if not alternating:
        # forces that are not determined do not grow
        assert np.abs(stepper.state.force).max() < 1e3 * 200.0 * 9.81
