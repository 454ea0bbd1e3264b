"""Joints with axes: what they are made of, their tables, the ground, what a start may be, and errors."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.joints.tables import Conditions, Coordinate

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_constraints import curvature, gap_of, largest_gap, misses  # noqa: E402

Array = np.ndarray


def body(name: str, position: Any = (0, 0, 0), **options: Any) -> fb.RigidBody:
    return fb.RigidBody(name, **{"mass": 1.0, "inertia": (0.02, 0.03, 0.04), "position": position, **options})


def pair(joint: type, **options: Any) -> fb.Scene:
    """Two bodies with triads of their own, and one joint between points of them."""
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    a, b = body("a"), body("b", (1, 0, 0), directors=turn)
    return fb.Scene(a, b, joint(a.point((0.5, 0.1, 0)), b.point(turn @ (-0.5, 0.1, 0)), "joint", **options))


AXES = {fb.RevoluteJoint: {"axis": (1, 2, 3)}, fb.CylindricalJoint: {"axis": (1, 2, 3)}, fb.PrismaticJoint: {"axis": (1, 2, 3)},
        fb.PlanarJoint: {"normal": (1, 2, 3)}, fb.UniversalJoint: {"axis_a": (1, 2, 3), "axis_b": (3, 0, -1)}}


def motion(x: Array, rate: Array) -> Array:
    """Coordinates [2, 4, 3] after a small motion with velocities and spins [2, 2, 3]."""
    out = x.copy()
    for k in (0, 1):
        w = rate[k, 1]
        angle = float(np.linalg.norm(w)) or 1.0
        turned = (x[k, 1:] * np.cos(angle) + np.cross(w / angle, x[k, 1:]) * np.sin(angle)
                  + np.outer(x[k, 1:] @ w / angle, w / angle) * (1 - np.cos(angle)))
        out[k, 0], out[k, 1:] = x[k, 0] + rate[k, 0], turned
    return out


@pytest.mark.parametrize("kind", list(AXES), ids=lambda x: x.__name__)
def test_conditions_are_met_at_the_start_and_their_derivatives_are_those_of_differences(kind: type) -> None:
    model = fb.compile_scene(pair(kind, **AXES[kind]))
    rng = np.random.default_rng(1)
    for link in model.kept:
        law = link.law
        x = model.q0.reshape(-1, 4, 3)[list(link.node)]
        np.testing.assert_allclose(gap_of(law, x, x), 0.0, atol=1e-15)
        y = x + 0.3 * rng.standard_normal(x.shape)
        u, w, e = (*rng.standard_normal((2, *x.shape)), 1e-6)
        slope = (gap_of(law, y + e * u, x) - gap_of(law, y - e * u, x)) / (2 * e)
        np.testing.assert_allclose(np.einsum("msic,sic->m", law.lead(y), u), slope, atol=1e-8)
        force = rng.standard_normal(len(slope))
        bent = np.einsum("m,msic->sic", force, law.lead(y + e * w) - law.lead(y - e * w)).reshape(-1) / (2 * e)
        np.testing.assert_allclose(curvature(law, y, force) @ w.reshape(-1), bent, atol=1e-8)
        by = link.by_velocities(y)
        rate = rng.standard_normal((2, 2, 3))
        slope = (gap_of(law, motion(y, e * rate), x) - gap_of(law, motion(y, -e * rate), x)) / (2 * e)
        np.testing.assert_allclose(sum(v @ rate[k, 0] + w @ rate[k, 1] for k, (_, v, w) in enumerate(by)), slope, atol=1e-8)


@pytest.mark.parametrize("kind", [fb.RevoluteJoint, fb.PrismaticJoint], ids=["angle", "distance"])
def test_a_given_coordinate_is_zero_at_the_start_and_its_derivatives_are_those_of_differences(kind: type) -> None:
    model = fb.compile_scene(pair(kind, axis=(1, 2, 3), speed=lambda t: np.sin(t)))
    link, rng = model.kept[-1], np.random.default_rng(1)
    law = link.law
    assert isinstance(law, Coordinate) and link.name.endswith("'joint' (drive)") and link.joint == "joint"
    x = model.q0.reshape(-1, 4, 3)[list(link.node)]
    assert abs(misses(law, x, 0.0)) < 1e-15 and abs(misses(law, x, -20 * np.pi)) < (1e-14 if law.is_angle else 63)
    y = x + 0.2 * rng.standard_normal(x.shape)
    u, w, e = (*rng.standard_normal((2, *x.shape)), 1e-5)
    slope = (misses(law, y + e * u, 0.3) - misses(law, y - e * u, 0.3)) / (2 * e)
    np.testing.assert_allclose(np.sum(law.lead(y)[0] * u), slope, atol=1e-7)
    bent = (law.lead(y + e * w) - law.lead(y - e * w)).reshape(-1) / (2 * e)
    np.testing.assert_allclose(curvature(law, y, np.ones(1)) @ w.reshape(-1), bent, atol=1e-6)
    # a turn about the axis, and a motion along it, change it one to one
    axis = np.array([1, 2, 3]) / np.sqrt(14.0)
    turning, y = np.zeros((2, 2, 3)), x.copy()
    turning[1, 1] = 0.4 * axis
    y[1, 0] += 0.4 * axis
    assert misses(law, motion(x, turning) if law.is_angle else y, 0.4) == pytest.approx(0.0, abs=1e-14)


def test_what_a_plane_keeps_from_moving_does_not_rub_there_and_what_is_given_leads_out_of_it() -> None:
    for axis in ((0, 0, 1), (1, 0, 0)):
        a, b = body("a"), body("b", (1, 0, 0), spin=(0, 0, 1))
        for kind in (fb.RevoluteJoint, fb.PrismaticJoint):
            joint = kind(a.point((0.5, 0, 0)), b.point((-0.5, 0, 0)), "joint", axis=axis, friction=0.1)
            model = fb.compile_scene(fb.Scene(a, b, joint, project_velocities=True), planar=True)
            found = model.plane.model
            moves = (kind is fb.RevoluteJoint) == (axis[2] == 1)
            # three freedoms in a plane, of which the joint leaves one or none
            assert found.n_forces == 3 and found.kept[-1].name.endswith("(friction)") == moves
            state = model.state()._replace(force=np.arange(1.0, model.n_forces + 1))
            again = model.plane.reduce(model.plane.expand(model.plane.reduce(state)))
            np.testing.assert_array_equal(again.force, model.plane.reduce(state).force)
    slide = fb.PrismaticJoint(fb.GROUND, a, "lift", axis=(0, 0, 1), distance=lambda t: t**2)
    model = fb.compile_scene(fb.Scene(a, slide))
    assert model.plane is None or abs(model.plane.axes[2] @ (0, 0, 1)) < 0.5
    with pytest.raises(fb.SceneError, match="prismatic joint 'lift' exerts a force on body 'a' out of the plane"):
        fb.compile_scene(fb.Scene(a, slide, fb.Load("push", a, force=(1, 1, 0), moment=(0, 0, 1))), planar=True)


@pytest.mark.parametrize("options", [{"angle": lambda t: 2.0 * t**2}, {"friction": 1.0},
                                     {"stops": fb.Stops(-0.5, 0.4, stiffness=50.0)}], ids=["drive", "friction", "stops"])
def test_the_sparse_solver_takes_the_same_steps(options: dict[str, Any]) -> None:
    arm, other = body("arm", (0.5, 0, 0)), body("other", (1.5, 0, 0))
    scene = fb.Scene(arm, other, fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), **options),
                     fb.RevoluteJoint(arm.point((0.5, 0, 0)), other.point((-0.5, 0, 0)), "knee", axis=(0, 1, 0), friction=0.2),
                     gravity=(0, 0, -9.81))
    ends = [fb.simulate(fb.compile_scene(scene, solver=solver), t_end=0.5, step=0.01, progress=False)
            for solver in ("chain", "sparse")]
    np.testing.assert_allclose(ends[0].state.q, ends[1].state.q, rtol=0.0, atol=1e-11)
    assert max(result.drift("balance") for result in ends) < 1e-13


@pytest.mark.parametrize(("kind", "forces"), [(fb.RevoluteJoint, 5), (fb.CylindricalJoint, 4), (fb.PrismaticJoint, 5),
                                              (fb.PlanarJoint, 3), (fb.UniversalJoint, 4)])
def test_a_joint_leaves_the_freedom_that_its_name_says(kind: type, forces: int) -> None:
    model = fb.compile_scene(pair(kind, **AXES[kind]))
    x = model.q0.reshape(-1, 4, 3)
    rows = np.concatenate([np.hstack([np.hstack(both) for _, *both in link.by_velocities(x[list(link.node)])])
                           for link in model.kept])
    assert np.linalg.matrix_rank(rows) == rows.shape[0] == forces == model.n_forces


@pytest.mark.parametrize(("axis", "left"), [((0, 0, 1), {"revolute": 2, "cylindrical": 2, "prismatic": 3, "planar": 0}),
                                            ((0, 1, 0), {"revolute": 3, "cylindrical": 2, "prismatic": 2, "planar": 2})])
def test_in_a_plane_conditions_that_hold_by_themselves_are_left_out(axis: Any, left: dict[str, int]) -> None:
    kinds = {"revolute": fb.RevoluteJoint, "cylindrical": fb.CylindricalJoint, "prismatic": fb.PrismaticJoint,
             "planar": fb.PlanarJoint}
    for name, count in left.items():
        a, b = body("a"), body("b", (1, 0, 0), spin=(0, 0, 1))
        argument = {"normal" if name == "planar" else "axis": axis}
        joint = kinds[name](a.point((0.5, 0, 0)), b.point((-0.5, 0, 0)), "joint", **argument)
        model = fb.compile_scene(fb.Scene(a, b, joint, project_velocities=True), planar=True)
        assert model.plane.model.n_forces == count, name
        # states go to the plane and back
        state = model.state()._replace(force=np.arange(1.0, model.n_forces + 1))
        again = model.plane.reduce(model.plane.expand(model.plane.reduce(state)))
        np.testing.assert_array_equal(again.force, model.plane.reduce(state).force)


def test_an_oblique_axis_leads_out_of_the_plane_and_is_named() -> None:
    a, b = body("a"), body("b", (1, 0, 0))
    joint = fb.CylindricalJoint(a, b, "oblique", axis=(0, 1, 1))
    model = fb.compile_scene(fb.Scene(a, b, joint, gravity=(0, -9.81, 0)))
    assert model.plane is None and "axis of cylindrical joint 'oblique'" in model.not_planar


def test_the_ground_takes_the_place_of_the_other_side_and_needs_no_part() -> None:
    arm = body("arm", (0.5, 0, 0))
    joint = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0.1)), axis=(0, 1, 0))
    np.testing.assert_allclose(joint.a.offset, (0, 0, 0.1))
    assert repr(joint.a) == "<ground at (0, 0, 0.1) m>"
    rope = fb.DistanceJoint(fb.GROUND.point((0, 0, 0)), arm, "rope")
    spring = fb.Spring(arm, fb.GROUND.point((0, 0, 0)), "spring", stiffness=3.0)
    model = fb.compile_scene(fb.Scene(arm, joint, rope, spring))
    # two points of the ground, one of them shared
    assert model.n_nodes == 4 and model.labels[-1] == "ground at (0, 0, 0) m"
    assert float(np.sum(model.gravity_weight)) == 1.0


BODY, OTHER = body("body"), body("other", (1, 0, 0))
MASS = fb.PointMass("mass", mass=1.0, position=(0, 0, 0))
WRONG = {
    "both sides are the ground": lambda: fb.RevoluteJoint(fb.GROUND, fb.GROUND, axis=(0, 0, 1)),
    "both sides are the ground; one has to belong": lambda: fb.Spring(fb.GROUND.point((0, 0, 0)), fb.GROUND.point((1, 0, 0)),
                                                                      stiffness=1.0),
    "revolute joint: both sides are the ground": lambda: fb.RevoluteJoint(fb.GROUND, fb.GROUND.point((0, 0, 1)), axis=(0, 0, 1)),
    "say which point of it: GROUND.point": lambda: fb.Spring(fb.GROUND, BODY, stiffness=1.0),
    "clamp a PointMass": lambda: fb.BallJoint(fb.GROUND, BODY),
    "point of the ground, which is fixed already": lambda: fb.Clamp(fb.GROUND.point((0, 0, 0))),
    "point mass 'mass' has no rotation": lambda: fb.RevoluteJoint(fb.GROUND, MASS, axis=(0, 0, 1)),
    "axis must not be zero": lambda: fb.PrismaticJoint(fb.GROUND, BODY, axis=(0, 0, 0)),
    "the arms of a cross are perpendicular": lambda: fb.UniversalJoint(BODY, OTHER, axis_a=(0, 0, 1), axis_b=(0, 1, 1)),
    "stiffness must be a finite number >= 0": lambda: fb.RevoluteJoint(fb.GROUND, BODY, axis=(0, 0, 1), stiffness=-1.0),
    "torque must return a finite number": lambda: fb.RevoluteJoint(fb.GROUND, BODY, axis=(0, 0, 1), torque=lambda t: np.nan),
    "lie 0.5 m apart at t = 0": lambda: fb.Scene(BODY, OTHER, fb.RevoluteJoint(BODY, OTHER.point((-0.5, 0, 0)),
                                                                              axis=(0, 0, 1))).check(),
}


@pytest.mark.parametrize("text", list(WRONG))
def test_errors_say_what_to_do(text: str) -> None:
    with pytest.raises(fb.SceneError) as error:
        WRONG[text]()
    assert text in str(error.value)


@pytest.mark.parametrize(("options", "joint", "text"), [
    ({"order": 4}, {"friction": 1.0}, "order=4 contains a step backward in time"),
    ({"method": "generalized_alpha"}, {"stiffness": 1.0},
     "does not support springs, dampers, motors, drives, friction and stops of joints")])
def test_what_forces_in_joints_do_not_go_together_with(options: dict[str, Any], joint: dict[str, Any], text: str) -> None:
    arm = body("arm", (0.5, 0, 0))
    pivot = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), **joint)
    model = fb.compile_scene(fb.Scene(arm, pivot))
    with pytest.raises(fb.SceneError, match=text):
        fb.simulate(model, t_end=0.1, step=0.01, **options)


def test_relax_takes_no_motors_and_a_start_off_the_joint_is_refused_or_mended() -> None:
    arm = body("arm", (0.5, 0, 0))
    pivot = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), torque=1.0)
    model = fb.compile_scene(fb.Scene(arm, pivot, gravity=(0, 0, -9.81)), planar=False)
    with pytest.raises(fb.SceneError, match="revolute joint 'pivot': relax does not support motors"):
        fb.relax(model)
    assert isinstance(model.kept[1].law, Conditions)
    state = model.state()
    x = state.q.reshape(-1, 4, 3)
    # turned about x: the axis leaves that of the ground
    turn = np.array([[1, 0, 0], [0, np.cos(1e-3), np.sin(1e-3)], [0, -np.sin(1e-3), np.cos(1e-3)]])
    x[0, 1:] = x[0, 1:] @ turn
    x[2, 1:] = x[0, 1:]
    with pytest.raises(fb.SceneError, match=r"revolute joint 'pivot' \(directions\): its directions are 0.001 rad off"):
        fb.simulate(model, start=state, t_end=0.1, step=0.01)
    mended = fb.simulate(model, start=fb.Start(state, mend=True), t_end=0.1, step=0.01, progress=False)
    assert [event["kind"] for event in mended.events] == ["mended"]
    assert largest_gap(model, mended.state.q) < 1e-14
