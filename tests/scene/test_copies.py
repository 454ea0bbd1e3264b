"""Copies of scenes, by `copy` and by `pickle`, also of those that have been compiled, are scenes of their own."""
from __future__ import annotations

import copy
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

SECTION = fb.Section.circle(radius=0.005, E=1e9, rho=1000.0)
GRAVITY = (0.0, 0.0, -9.81)
COPIES: dict[str, Callable[[Any], Any]] = {"copy": copy.copy, "deepcopy": copy.deepcopy,
                                           "pickle": lambda scene: pickle.loads(pickle.dumps(scene))}


def beam(name: str = "b", x: float = 0.0) -> fb.Beam:
    return fb.Beam.straight(name, (x, 0, 0), (x + 1, 0, 0), section=SECTION, elements=4)


def ring() -> fb.Scene:
    """A mass that its slider places, one below it on a ball joint, and a hinge on the ground."""
    b, bead, bob = beam(), fb.PointMass("bead", mass=0.1), fb.PointMass("bob", mass=0.1)
    arm = fb.RigidBody("arm", mass=1.0, inertia=(1, 1, 1), position=(0.2, 1, 0))
    return fb.Scene(b, bead, bob, arm, fb.Clamp(b.start), fb.BallJoint(bead, bob), fb.Slider("s", bead, b, at=0.3),
                    fb.RevoluteJoint(fb.GROUND, arm.point((-0.2, 0, 0)), "h", axis=(0, 1, 0)), gravity=GRAVITY)


def path() -> fb.Scene:
    a, b, bead = beam("a"), beam("c", 1.0), fb.PointMass("bead", mass=0.1)
    return fb.Scene(a, b, bead, fb.Clamp(a.start), fb.Clamp(b.end), fb.RigidConnection(a.end, b.start),
                    fb.Slider("s", bead, on=fb.Path("p", [a, b]), at=0.8), gravity=GRAVITY)


def net() -> fb.Scene:
    wire = fb.Net("n", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1], [1, 2]], section=SECTION, elements=2, clamps=[0, 2])
    return fb.Scene(wire, fb.Load("F", wire.node(1), force=(0, 0, 1)), gravity=GRAVITY)


def winch() -> fb.Scene:
    crate = fb.PointMass("crate", mass=5.0, position=(0, 0, -5))
    return fb.Scene(crate, fb.Winch("hoist", fb.GROUND.point((0, 0, 0)), crate, stiffness=1e5, mass_per_length=0.1, length=4.9),
                    gravity=GRAVITY)


def mesh() -> fb.Scene:
    b, bead = beam(), fb.PointMass("bead", mass=0.1)
    return fb.with_moving_meshes(fb.Scene(b, bead, fb.Clamp(b.start), fb.Slider("s", bead, b, at=0.3), gravity=GRAVITY))


@pytest.mark.parametrize("make", [ring, path, net, winch, mesh])
@pytest.mark.parametrize("how", COPIES)
def test_a_copy_of_a_compiled_scene_compiles_to_the_same(make: Callable[[], fb.Scene], how: str) -> None:
    scene = make()
    first = fb.compile_scene(scene)
    # what was made in between must not take the place of what is gone
    others = [make() for _ in range(3)]
    again = fb.compile_scene(COPIES[how](scene))
    del others
    assert str(again) == str(first)
    for name in ("q0", "v0", "s0", "gravity_weight"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    for own, of_first in zip(again.loads, first.loads, strict=True):
        np.testing.assert_array_equal(own, of_first)


def test_a_copy_runs_to_the_same_bits_and_finds_its_own_parts() -> None:
    scene = ring()
    runs = []
    for own in (scene, *(make(scene) for make in COPIES.values())):
        model = fb.compile_scene(own)
        runs.append(fb.simulate(model, t_end=5e-3, step=1e-3, points={"bob": own.masses[1], "tip": own.beams[0].end}))
    for run in runs[1:]:
        np.testing.assert_array_equal(run.state.q, runs[0].state.q)
        np.testing.assert_array_equal(run.point("bob"), runs[0].point("bob"))
    # there is one ground
    twin = pickle.loads(pickle.dumps(fb.GROUND.point((1, 2, 3))))
    assert twin == fb.GROUND.point((1, 2, 3)) and hash(twin) == hash(fb.GROUND.point((1, 2, 3)))


def test_no_object_is_known_by_its_address() -> None:
    """Addresses are others in a copy, and those of what is gone are given away again."""
    source = Path(fb.__file__).parent
    found = [file.name for file in source.rglob("*.py") if re.search(r"(?<![\w.])id\(", file.read_text(encoding="utf-8"))]
    assert found == []
