"""Compiled forces on coordinates of joints: their work is that of energies, their tangent that of differences; and in NumPy."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import ASSEMBLY, Calls, SystemRecord
from fastbeam.kernels.joints.coordinates import VALUE
from fastbeam.kernels.terms import Conserving, Equilibrium
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.joints.tables import frames_of
from fastbeam.model.workspace import contact_of, work_of
from fastbeam.scene.joint_freedoms import ABOUT_A, ABOUT_B, COSINES, SWING, TWIST, distance_along
from fastbeam.stepping.terms import system_of

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_constraints import curvature, misses  # noqa: E402

Array = np.ndarray
AXIS, ACROSS = np.array((1, 2, 3)) / np.sqrt(14.0), np.array((3, 0, -1)) / np.sqrt(10.0)
STOPS = fb.Stops(-0.1, 0.08, stiffness=50.0)
JOINTS: dict[str, Any] = {
    "angle": lambda *ab: fb.RevoluteJoint(*ab, "joint", axis=AXIS, stiffness=3.0, damping=0.4, rest=0.3, torque=0.7, stops=STOPS),
    "distance": lambda *ab: fb.PrismaticJoint(*ab, "joint", axis=AXIS, stiffness=3.0, damping=0.4, rest=0.3, force=0.7,
                                            stops=STOPS),
    "cross": lambda *ab: fb.UniversalJoint(*ab, "joint", axis_a=AXIS, axis_b=ACROSS, stiffness=(3.0, 2.0), damping=(0.4, 0.2),
                                           rest=(0.3, 0.1), torque=(0.7, -0.3), stops=(STOPS, STOPS)),
    "plate": lambda *ab: fb.PlanarJoint(*ab, "joint", normal=AXIS, along=ACROSS, stiffness=(3.0, 2.0, 1.0),
                                        damping=(0.4, 0.2, 0.1), force=(0.3, 0.2), stops=(STOPS, None, STOPS)),
    "ball": lambda *ab: fb.SphericalJoint(*ab, "joint", axis=AXIS, stiffness=(3.0, 2.0), damping=(0.4, 0.2), torque=0.4,
                                          stops=STOPS, cone=fb.Stops(end=0.05, stiffness=50.0))}


def turned(triads: Array, w: Array) -> Array:
    """By a Cayley vector, in space."""
    d = np.cross(w, triads)
    return triads + (d + 0.5 * np.cross(w, d)) / (1.0 + 0.25 * w @ w)


class Forces:
    """The terms of joints of two bodies, between one shape and another."""

    def __init__(self, name: str, scale: float, static: bool = False) -> None:
        rng = np.random.default_rng(5)
        a, b = (fb.RigidBody(x, mass=1.0, inertia=(1, 1, 1), position=(0.3, 0.1, 0)) for x in "ab")
        self.model = fb.compile_scene(fb.Scene(a, b, JOINTS[name](a, b)), planar=False)
        self.work, self.state, self.static = work_of(self.model), self.model.state(), static
        self.tables = self.model.motions.work(self.model, None, False)
        self.n = self.model.n_nodes
        q = self.model.q0.reshape(-1, 4, 3).copy()
        for k in range(self.n):
            q[k, 0] += scale * rng.standard_normal(3)
            q[k, 1:] = turned(q[k, 1:], scale * rng.standard_normal(3))
        self.q0 = q
        self.value = self.model.motions.values(q, np.zeros(len(self.model.motions.names)))
        self.model.motions.own(self.state.history, self.model.place("motions"))[:, VALUE] = self.value
        self.move = scale * rng.standard_normal((self.n, 2, 3))
        self.h = 0.1

    def end(self, move: Array, more: Array) -> Array:
        """After the step, and a small motion besides, [N, 4, 3]."""
        out = self.q0.copy()
        for k in range(self.n):
            out[k, 0] += move[k, 0] + more[k, 0]
            out[k, 1:] = turned(turned(out[k, 1:], move[k, 1]), more[k, 1])
        return out

    def assembled(self, end: Array) -> tuple[Array, Array]:
        """Residual [N, 6] and tangent [6 N, 6 N]."""
        model, work, state, start = self.model, self.work, self.state, self.q0
        work.r[:], work.blocks[:] = 0.0, 0.0
        state.q[:] = start.reshape(-1)
        middle = end if self.static else 0.5 * (start + end)
        work.q_mid[:work.q_mid.size], work.q_end[:] = middle.reshape(-1), end.reshape(-1)
        method = Equilibrium() if self.static else Conserving()
        contact = None if self.static else contact_of(model, 64)
        system = SystemRecord(system_of(model, method, contact, model.pattern.plan, state, work), ASSEMBLY)
        kernels.assemble_some(*Calls(self.tables.static_terms, ASSEMBLY).on(system), 0.0 if self.static else self.h)
        rows = model.pattern.row_of
        full = np.zeros((6 * model.pattern.n,) * 2)
        blocks = work.blocks[:48 * model.pattern.keys.size].reshape(-1, 6, 8)
        for block, row, column in zip(blocks, model.pattern.rows, model.pattern.columns):
            full[6 * row:6 * row + 6, 6 * column:6 * column + 6] += block[:, :6]
        at = (6 * rows[:, None] + np.arange(6)).reshape(-1)
        return work.r.reshape(-1, 8)[rows, :6].copy(), full[np.ix_(at, at)]


CASES = [(name, scale) for name in JOINTS for scale in (0.3, 0.01)]


@pytest.mark.parametrize(("name", "scale"), CASES)
def test_work_of_the_forces_is_what_springs_store_dampers_take_and_motors_give(name: str, scale: float) -> None:
    forces = Forces(name, scale)
    motions, end = forces.model.motions, forces.end(forces.move, np.zeros_like(forces.move))
    residual, _ = forces.assembled(end)
    after = motions.values(end, forces.value)
    own = np.zeros((len(after), 3))
    stored = []
    for values in (forces.value, after):
        own[:, VALUE] = values
        stored.append(float(np.sum(motions.energy(own))))
    way = after - forces.value
    taken = float(motions.every.damping @ way**2 / forces.h - motions.every.given @ way)
    # residuals are minus the forces
    work = float(np.sum(residual * forces.move.reshape(-1, 6)))
    assert abs(work - (stored[1] - stored[0] + taken)) < 1e-14 * max(abs(stored[0]), abs(taken), scale)
    # neither forces nor moments in sum
    np.testing.assert_allclose(residual[:, :3].sum(axis=0), 0.0, rtol=0.0, atol=1e-13)
    middle = 0.5 * (forces.q0 + end)[:, 0]
    moments = residual[:, 3:] + np.cross(middle, residual[:, :3])
    np.testing.assert_allclose(moments.sum(axis=0), 0.0, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize(("name", "scale"), CASES)
def test_the_tangent_is_that_of_differences(name: str, scale: float, static: bool) -> None:
    forces = Forces(name, scale, static)
    zero = np.zeros_like(forces.move)
    _, tangent = forces.assembled(forces.end(forces.move, zero))
    e = 1e-6 * scale
    for k in range(forces.n):
        for c in range(6):
            ends = []
            for sign in (1.0, -1.0):
                more = zero.copy()
                more[k, c // 3, c % 3] = sign * e
                ends.append(forces.assembled(forces.end(forces.move, more))[0].reshape(-1))
            slope = (ends[0] - ends[1]) / (2 * e)
            # in equilibria half of it
            np.testing.assert_allclose(tangent[:, 6 * k + c] * (2.0 if static else 1.0), slope, rtol=0.0,
                                       atol=(3e-8 if scale == 0.3 else 3e-6) * np.max(np.abs(tangent)))


@pytest.mark.parametrize("shape", [distance_along(1), ABOUT_A, ABOUT_B, SWING, TWIST, *COSINES], ids=lambda x: x.what)
def test_a_coordinate_has_the_derivatives_and_the_rate_of_differences(shape: Any) -> None:
    rng = np.random.default_rng(2)
    triads = [np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(2)]
    triads = np.array([x * np.linalg.det(x) for x in triads])

    class Part:
        axes, across = (AXIS, AXIS), None

    frame, = frames_of([Part()], np.array([[0, 1]]), rng.standard_normal((2, 3)), triads)
    law = Coordinate(shape, frame)
    assert abs(misses(law, frame.reference, 0.0)) < 1e-15
    y = frame.reference + 0.2 * rng.standard_normal((2, 4, 3))
    y[:, 1:] = [turned(x, 0.3 * rng.standard_normal(3)) for x in frame.reference[:, 1:]]
    u, e = rng.standard_normal((2, 4, 3)), 1e-5
    # along motions of triads: the sine of a swing is that of unit vectors
    u[:, 1:] = [np.cross(rng.standard_normal(3), x) for x in y[:, 1:]]
    slope = (misses(law, y + e * u, 0.3) - misses(law, y - e * u, 0.3)) / (2 * e)
    np.testing.assert_allclose(np.sum(law.lead(y)[0] * u), slope, atol=1e-8)
    bent = (law.lead(y + e * u) - law.lead(y - e * u)).reshape(-1) / (2 * e)
    if shape.what != "swing":
        np.testing.assert_allclose(curvature(law, y, np.ones(1)) @ u.reshape(-1), bent, atol=1e-6)
