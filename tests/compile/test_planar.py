"""Planar scenes: what is recognised, what is refused and why, the tangent against that of space, which runs stay planar."""
from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import ASSEMBLY, AT_REST, Calls, SystemRecord
from fastbeam.kernels.state import State
from fastbeam.kernels.terms import Conserving, Equilibrium
from fastbeam.model.feature import OfRun
from fastbeam.model.model import Model
from fastbeam.model.workspace import contact_of, work_of
from fastbeam.stepping.stepper import Stepper
from fastbeam.stepping.terms import system_of, terms_of

sys.path.insert(0, str(Path(__file__).parents[1]))
from planar_scenes import FLAT, SECTION, flight, mechanism, plane, wave  # noqa: E402

Array = np.ndarray
H = 0.01
PLANES = {"xy": FLAT, "yz": plane((1, 0, 0)), "zx": plane((0, 1, 0)), "general": plane()}


def vector(turn: Array, *x: float) -> Array:
    return turn @ np.array(x)


def beam(turn: Array = FLAT, **changes: Any) -> fb.Beam:
    """A straight beam in the plane, its d2 along the normal."""
    return fb.Beam.straight("beam", vector(turn, 0, 0, 0), vector(turn, 3, 0.5, 0),
                            **{"section": SECTION, "elements": 3, "degree": 2, "d2": turn[:, 2], **changes})


def body(turn: Array = FLAT, **changes: Any) -> fb.RigidBody:
    return fb.RigidBody("body", **{"mass": 1.0, "inertia": (1.0, 1.2, 1.5), "position": vector(turn, 3, 1, 0),
                                   "directors": turn.T, **changes})


# -------------------------------------------------------------------------------------------------------------- detection
@pytest.mark.parametrize("where", PLANES)
@pytest.mark.parametrize("make", [flight, mechanism, lambda turn: flight(turn, "bspline 3 greville", "spline", "oblique"),
                                  lambda turn: fb.Scene(beam(turn), gravity=turn[:, 1]),
                                  lambda turn: fb.Scene(body(turn, spin=2.0 * turn[:, 2])),
                                  lambda turn: fb.Scene(beam(turn), fb.RigidMotion(velocity=turn[:, 0], spin=turn[:, 2]))],
                         ids=["flight", "mechanism", "oblique splines", "gravity", "body", "straight"])
def test_scenes_in_any_plane_are_found(make: Callable[[Array], fb.Scene], where: str) -> None:
    turn = PLANES[where]
    model = fb.compile_scene(make(turn), planar=True)
    found = model.plane
    assert abs(abs(found.axes[2] @ turn[:, 2]) - 1.0) <= 1e-14
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(3), rtol=0.0, atol=2e-15)  # nine roundings
    assert model.not_planar == ""
    assert found.label in str(model) and "3 unknowns a node instead of 6" in str(model)
    assert where == "general" or found.label == "plane normal to " + {"yz": "x", "zx": "y", "xy": "z"}[where]
    assert found.model.q0.size == 4 * model.n_nodes
    # the way there and back
    back = found.expand(found.reduce(model.state()))
    for x, y in zip(back, model.state()):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=1e-14 * model.length)


@pytest.mark.parametrize("tilt", [1e-14, 3e-13, 1e-11, 1e-8])
def test_planes_next_to_a_coordinate_plane_are_found(tilt: float) -> None:
    turn = plane((tilt, 0, 1))
    found = fb.compile_scene(mechanism(turn), planar=True).plane
    assert np.linalg.norm(np.cross(found.axes[2], turn[:, 2])) < 1.1e-13
    assert (found.label == "plane normal to z") == (tilt < 1e-13)


def test_a_triad_that_is_nearly_normal_to_the_plane_is_no_measure_of_it() -> None:
    """The normal followed the d3 of the first node, off by 3e-12 here, although positions and gravity tell it to round-off."""
    round_rod = fb.Section.circle(radius=0.05, E=1e9, rho=1000.0)
    first = beam(section=round_rod, d2=(0, np.sin(3e-12), np.cos(3e-12)))
    found = fb.compile_scene(fb.Scene(first, fb.Pin(first.start), gravity=(0, -9.81, 0)), planar=True).plane
    np.testing.assert_array_equal(np.abs(found.axes[2]), (0, 0, 1))


def test_the_air_of_every_drag_of_a_beam_lies_in_the_plane() -> None:
    """Hanging along z any plane through z would do, but for the air of one of two drags."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (0, 0, -2), section=SECTION, elements=2)
    wind, settle = fb.Drag("wind", rope, normal=2.0, air=(2, 0, 0)), fb.Drag("settle", rope, linear=0.1)
    across = fb.Drag("gust", rope, normal=2.0, air=(0, 1, 0))
    for drags in ((wind, settle), (settle, wind)):
        model = fb.compile_scene(fb.Scene(rope, fb.Pin(rope.start), *drags, gravity=(0, 0, -9.81)))
        assert abs(model.plane.axes[2] @ (0, 1, 0)) == 1.0
    model = fb.compile_scene(fb.Scene(rope, fb.Pin(rope.start), wind, across, gravity=(0, 0, -9.81)))
    assert model.plane is None and "the air at beam 'rope' node" in model.not_planar


def test_points_of_a_plane_count_its_height_along_the_normal() -> None:
    turn = plane()
    shift = fb.Beam.straight("beam", vector(turn, 0, 0, 5), vector(turn, 3, 0.5, 5), section=SECTION, elements=3, d2=turn[:, 2])
    model = fb.compile_scene(fb.Scene(shift, fb.RigidMotion(velocity=turn[:, 0])), planar=True)
    assert abs(abs(model.plane.height) - 5.0) <= 1e-14
    assert np.max(np.abs(model.plane.expand(model.plane.model.state()).q - model.q0)) <= 1e-14


def test_round_off_of_projected_spins_does_not_hide_the_plane() -> None:
    turn = plane()
    rail, mass = beam(turn), fb.PointMass("mass", mass=1.0, velocity=vector(turn, 0.3, 0.1, 0))
    scene = fb.Scene(rail, mass, fb.Slider("slider", mass, rail, at=1.5),
                     fb.RigidMotion([rail], velocity=vector(turn, 1, 0.3, 0)), project_velocities=True)
    assert fb.compile_scene(scene).not_planar == ""


def test_round_off_of_curves_and_of_fine_meshes_does_not_hide_the_plane() -> None:
    # points off the origin: their round-off times the square of the degree of a panel, and over the length of an element
    rng = np.random.default_rng(3)
    for k in range(200):
        turn = plane(tuple(rng.normal(size=3)))
        points = [vector(turn, 5.0 + 1.8 * x, y, 0) for x, y in ((0, 0), (0.3, 0.2 * rng.uniform(-1, 1)), (0.7, 0.1), (1, 0))]
        spline = fb.Beam.through_points("spline", points, section=SECTION, elements=3, degree=1 + k % 3, d2=turn[:, 2])
        if k < 50:
            assert fb.compile_scene(fb.Scene(spline, gravity=turn[:, 1])).not_planar == ""
        # measured 7e-15, and 2e-13 with the coefficients that are round-off
        assert np.max(np.abs(spline.reference(0.0)[1][0, [0, 2]] @ turn[:, 2])) < 6e-14
    for shape in ("straight", "arc"):
        scene = flight(turn, "lagrange 3", shape, elements=4000)
        assert fb.compile_scene(fb.Scene(*scene.beams, gravity=turn[:, 1])).not_planar == ""


COUPLED = np.diag([1e4, 8e3, 6e3, 300.0, 400.0, 600.0])
# axial strain with torsion
COUPLED[0, 3] = COUPLED[3, 0] = 100.0
TILT = np.array([[1, 0, 0], [0, np.cos(0.4), np.sin(0.4)], [0, -np.sin(0.4), np.cos(0.4)]])


def around(rail: fb.Beam, *parts: Any, **scene: Any) -> fb.Scene:
    """A beam and a mass off its axis: they span the x-y plane."""
    return fb.Scene(rail, fb.PointMass("mark", mass=1.0, position=(1, 1, 0)), *parts, **scene)


def loaded(**load: Any) -> fb.Scene:
    rail = beam()
    return around(rail, fb.Load("load", rail.end, **load))


def windy(**load: Any) -> fb.Scene:
    rail = beam()
    return around(rail, fb.DistributedLoad("wind", rail, **load))


def nearly_round(**other: float) -> fb.Scene:
    """A tilted section, round but for one number."""
    round_section = {"EA": 1e4, "GA2": 5e3, "GA3": 5e3, "GJ": 300.0, "EI2": 400.0, "EI3": 400.0, "rhoA": 1.0, "rhoI2": 0.1,
                     "rhoI3": 0.1}
    return around(beam(d2=TILT[1], section=fb.Section(**(round_section | other))))


def turning_frame(t: float) -> Array:
    """d2 leaves the plane and comes back."""
    a = 0.3 * np.sin(np.pi * t)
    return np.array([[1, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]])


def wrung() -> fb.Scene:
    return around(fb.Beam.from_curve("wrung", lambda t: np.array([3.0 * t, 0, 0]), frame=turning_frame, section=SECTION,
                                     elements=2))


def hung(offset: Array) -> fb.Scene:
    rail, bob = beam(), body()
    return around(rail, bob, fb.RigidConnection(rail.start, bob.point(offset)))


def helix() -> fb.Scene:
    return fb.Scene(fb.Beam.helix("helix", radius=1.0, pitch=0.3, turns=0.5, section=SECTION, elements=4))


REFUSED: dict[str, tuple[Callable[[], fb.Scene], str]] = {
    "node": (lambda: around(beam(), body(position=(3, 1, 0.1))), "does not lie in the plane of the other nodes"),
    "node by little": (lambda: around(beam(), body(position=(3, 1, 1e-10))), "body 'body' does not lie in the plane of the other "
                                                                             "nodes"),
    "helix": (helix, "does not lie in the plane of the other nodes"),
    "velocity": (lambda: around(beam(), body(velocity=(1, 0, 1e-3))),
                 "the initial velocity of body 'body' points out of the plane"),
    "spin": (lambda: around(beam(), body(spin=(0, 1e-3, 1))), "does not lie in the plane of the other nodes"),
    "spin about an axis of the plane": (lambda: around(beam(), fb.RigidMotion(spin=(1, 0, 0))),
                                        "does not lie in the plane of the other nodes"),
    "spins about two axes": (lambda: around(beam(), body(spin=(0, 0, 1)), fb.RigidBody(
        "top", mass=1.0, inertia=(1, 1, 1), position=(2, 2, 0), spin=(0, 0.5, 0))),
        "the initial spin of body 'top' is not about the normal"),
    "gravity": (lambda: around(beam(), gravity=(0, -9.81, 1e-3)), "gravity points out of the plane"),
    "load": (lambda: loaded(force=(1, 1, 1e-6)), "the load on beam 'beam' node 6 points out of the plane"),
    "moment": (lambda: loaded(moment=(0, 1, 0)), "does not lie in the plane of the other nodes"),
    "moment beside a spin": (lambda: around(rail := beam(), fb.Load("load", rail.end, moment=(0, 1e-6, 1)), body(spin=(0, 0, 1))),
                             "the moment on beam 'beam' node 6 is not about the normal"),
    "distributed load": (lambda: windy(force=(0, 0, 1)), "the load on beam 'beam' node 1 points out of the plane"),
    "distributed moment": (lambda: windy(moment=(1, 0, 0)), "does not lie in the plane of the other nodes"),
    "coupled section": (lambda: around(beam(section=fb.Section.from_matrix(COUPLED, rhoA=1.0, rhoI2=0.1, rhoI3=0.1))),
                        "the section of beam 'beam' couples in-plane strains with out-of-plane strains"),
    "tilted section": (lambda: around(beam(d2=TILT[1])), "the section of beam 'beam' couples in-plane strains with out-of-plane "
                                                         "strains"),
    "tilted, EI2 != EI3": (lambda: nearly_round(EI3=400.001), "the section of beam 'beam' couples in-plane strains"),
    "tilted, GA2 != GA3": (lambda: nearly_round(GA2=5000.01), "the section of beam 'beam' couples in-plane strains"),
    "tilted, rhoI2 != rhoI3": (lambda: nearly_round(rhoI3=0.100001),
                               "the section inertia of beam 'beam' is oblique to the plane"),
    "twisted": (lambda: around(beam(twist=0.5)), "beam 'beam' is twisted"),
    "twisted there and back": (wrung, "beam 'wrung' is twisted"),
    "body with oblique inertia": (lambda: around(beam(), body(inertia=[[1.0, 0, 0.2], [0, 1.2, 0], [0.2, 0, 1.5]])),
                                  "the principal axes of body 'body' are oblique to the plane"),
    "tilted body": (lambda: around(beam(), body(directors=TILT)), "the principal axes of body 'body' are oblique to the plane"),
    "offset": (lambda: hung((0, -0.5, 0.1)), "does not lie in the plane of the other nodes"),
    "a point at rest": (lambda: fb.Scene(body()), "a single point without velocity or load defines no plane"),
    "oblique triad on a line": (lambda: fb.Scene(body(directors=plane((3, 1, 2)).T, velocity=(1, 0, 0))),
                                "the directors are oblique to it"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_scenes_that_leave_the_plane_run_in_space_and_say_why(name: str) -> None:
    make, reason = REFUSED[name]
    model = fb.compile_scene(make())
    assert model.not_planar
    assert reason in model.not_planar
    assert f"planar form ({model.not_planar})" in str(model)
    with pytest.raises(fb.SceneError, match="does not stay in a plane") as caught:
        fb.compile_scene(make(), planar=True)
    assert model.not_planar in str(caught.value) and "use planar='auto'" in str(caught.value)


@pytest.mark.parametrize("make", [lambda: nearly_round(), lambda: around(beam(d2=(0, 1, 0))), lambda: loaded(moment=(0, 0, 1)),
                                  lambda: around(beam(), body(directors=TILT, inertia=(1.2, 1, 1))), lambda: hung((0, -0.5, 0))],
                         ids=["round section", "upright section", "moment", "tilted round body", "offset"])
def test_what_differs_little_from_the_refused_is_planar(make: Callable[[], fb.Scene]) -> None:
    assert fb.compile_scene(make(), planar=True).not_planar == ""


def crank(**drive: Any) -> fb.Scene:
    """A crank, a rod and a piston that all begin on one line; the shaft turns about y."""
    rod = fb.Beam.straight("rod", (0.2, 0, 0), (1, 0, 0), section=SECTION, elements=2)
    crank, piston = (fb.RigidBody(name, mass=1.0, inertia=(0.1, 0.1, 0.1), position=(x, 0, 0)) for name, x in
                     (("crank", 0.0), ("piston", 1.0)))
    y = (0, 1, 0)
    return fb.Scene(crank, rod, piston, fb.RevoluteJoint(fb.GROUND, crank, "shaft", axis=y, **drive),
                    fb.RevoluteJoint(crank.point((0.2, 0, 0)), rod.start, axis=y), fb.RevoluteJoint(rod.end, piston, axis=y),
                    fb.PrismaticJoint(fb.GROUND, piston, "guide", axis=(1, 0, 0)))


@pytest.mark.parametrize("drive", [{"torque": 2.0}, {"torque": lambda t: 2.0}, {"stiffness": 2.0, "rest": 1.0},
                                   {"angle": lambda t: 2.0 * t**2}, {"speed": lambda t: 4.0 * t}])
def test_motors_and_wound_springs_of_joints_choose_the_plane(drive: dict[str, Any]) -> None:
    # all points lie on a line at the start: with another plane through it nothing would move
    model = fb.compile_scene(crank(**drive))
    assert model.plane is not None and abs(model.plane.axes[2][1]) == 1.0


def test_in_the_plane_of_a_motor_a_crank_turns_as_in_space() -> None:
    drive = {"torque": 2.0}
    model = fb.compile_scene(crank(**drive))
    run, whole = (fb.simulate(m, t_end=0.1, step=H, every=1) for m in (model, fb.compile_scene(crank(**drive), planar=False)))
    angle = run.joint("shaft")["angle"]
    np.testing.assert_allclose(angle, whole.joint("shaft")["angle"], atol=1e-12)
    assert angle[-1] > 0.01


@pytest.mark.parametrize(("stiffness", "rest", "normal"), [((2.0, 0.0), (1.0, 0.0), True), ((0.0, 2.0), (0.0, 1.0), False),
                                                           ((2.0, 2.0), (0.0, 0.0), None), ((0.0, 0.0), (1.0, 1.0), None)])
def test_springs_of_a_cylindrical_joint_choose_the_plane_where_they_are_wound(stiffness: Any, rest: Any, normal: Any) -> None:
    a, b = (fb.RigidBody(name, mass=1.0, inertia=(0.1, 0.1, 0.1), position=(x, 0, 0)) for name, x in (("a", 0.0), ("b", 1.0)))
    joint = fb.CylindricalJoint(fb.GROUND, a, "guide", axis=(0, 1, 0), stiffness=stiffness, rest=rest)
    plane = fb.compile_scene(fb.Scene(a, b, joint)).plane
    # about the axis the plane is at a right angle to it, along it the axis lies in the plane; at rest any plane will do
    assert plane is not None and (normal is None or (abs(plane.axes[2][1]) == 1.0) == normal)


def test_motors_of_joints_may_lead_out_of_the_plane_and_say_so() -> None:
    scene = crank(torque=2.0)
    scene.add(fb.Load("across", scene.beams[0].node(2), force=(0, 1.0, 0)))
    model = fb.compile_scene(scene)
    assert model.plane is None and "out of the plane" in model.not_planar
    slide = fb.RigidBody("slide", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(1, 0, 0))
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2)
    pushed = fb.Scene(beam, slide, fb.Clamp(beam.start), fb.PrismaticJoint(beam.end, slide, "ram", axis=(0, 0, 1), force=3.0),
                      fb.Load("side", beam.end, force=(0, 1.0, 0)))
    assert fb.compile_scene(pushed).plane is None


def test_planar_false_says_so() -> None:
    model = fb.compile_scene(flight(), planar=False)
    assert model.plane is None and model.not_planar == "planar=False"
    assert "planar form (planar=False)" in str(model)


@pytest.mark.parametrize("value", [None, 1, 0, "yes", 1.0])
def test_other_values_of_planar_are_refused(value: Any) -> None:
    with pytest.raises(fb.SceneError, match="planar: must be 'auto', True or False"):
        fb.compile_scene(flight(), planar=value)


# ---------------------------------------------------------------------------------------------------------------- tangent
class Assembled:
    """Residual and tangent of one set of tables, dense."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.state, self.work, self.contact = model.state(), work_of(model), contact_of(model, 64)
        kernels.external_forces(model.loads, np.ones(len(model.load_times)), self.work.f_ext)

    def step(self, h: float) -> None:
        m = self.model
        system = system_of(m, Conserving(), self.contact, m.pattern.plan, self.state, self.work)
        kernels.assemble_all(*Calls(terms_of(OfRun(m)), ASSEMBLY).on(SystemRecord(system, ASSEMBLY)), h)

    def static(self) -> None:
        m = self.model
        system = SystemRecord(system_of(m, Equilibrium(), None, None, self.state, self.work), AT_REST)
        terms, system = Calls(terms_of(OfRun(m, static=True)), AT_REST).on(system)
        kernels.begin(terms, system, 0.0)
        kernels.assemble_all(terms, system, 0.0)

    def residual(self) -> Array:
        """Nodes in order of their rows, then the borders."""
        m = self.model
        nodes = self.work.r[:8 * m.n_nodes].reshape(-1, 8)[:, :len(m.dofs)]
        borders = np.zeros(0) if self.contact is None else self.contact.residual[:, :m.border]
        return np.concatenate((nodes.reshape(-1), borders.reshape(-1)))

    def tangent(self) -> Array:
        m, n, b = self.model, len(self.model.dofs), self.model.border
        size = n * m.n_nodes
        k = np.zeros((size + b * m.n_sliders,) * 2)
        for block, row, column in zip(self.work.blocks.reshape(-1, n, 8), m.pattern.rows, m.pattern.columns):
            k[n * row:n * row + n, n * column:n * column + n] = block[:, :n]
        for i in range(m.n_sliders):
            at = slice(size + b * i, size + b * (i + 1))
            for e in range(self.contact.entries[i]):
                row = slice(n * self.contact.row[i, e], n * self.contact.row[i, e] + n)
                k[row, at] += self.contact.column[i].reshape(-1, n, 8)[e, :, :b]
                k[at, row] += self.contact.line[i].reshape(-1, n, 8)[e, :, :b].T
            k[at, at] = self.contact.corner[i].reshape(8, 8)[:b, :b]
        return k


def in_plane(axes: Array, n_nodes: int, n_sliders: int) -> Array:
    """Unknowns in space from those in the plane: (x, y, turn) of every node, (F, s, mean gap) of every slider."""
    node = np.zeros((6, 3))
    node[:3, :2], node[3:, 2] = axes[:2].T, axes[2]
    border = np.zeros((7, 5))
    border[:3, :2], border[3, 2], border[4:, 3:] = axes[:2].T, 1.0, axes[:2].T
    n = 6 * n_nodes
    out = np.zeros((n + 7 * n_sliders, 3 * n_nodes + 5 * n_sliders))
    out[:n, :3 * n_nodes] = np.kron(np.eye(n_nodes), node)
    out[n:, 3 * n_nodes:] = np.kron(np.eye(n_sliders), border)
    return out


def tie_planar(ties: Any, x: Array) -> None:
    """Coordinates, or their increments or rates, of tied nodes from those of their targets, in place."""
    z = x.reshape(-1, 2, 2)
    for i in ties.slave:
        position = np.zeros(2)
        for e in range(ties.start[i], ties.start[i + 1]):
            (a, b), (ux, uy) = ties.factor[2 * e:2 * e + 2], z[ties.target[e], 1]
            arm = np.array([a * ux - b * uy, a * uy + b * ux])
            if ties.kind[e] == 2:
                z[i, 1] = arm if ties.target[e] != i else z[i, 1]
            else:
                position += z[ties.target[e], 0] if ties.kind[e] == 0 else arm
        z[i, 0] = position


def trial(model: Model, flat: Assembled, space: Assembled, at_rest: bool) -> None:
    """The same trial step for both: deformed, moving, with open gaps and contact forces, nothing small."""
    rng = np.random.default_rng(4)
    core, found = flat.model, model.plane
    held = model.fixed_mask
    tied = np.zeros(model.n_nodes, dtype=bool)
    tied[model.ties.slave] = True

    def moved(q: Array, size: float) -> tuple[Array, Array]:
        """Increments of the coordinates, and Cayley numbers, that supports and joints allow."""
        z = q.reshape(-1, 4)
        theta = rng.uniform(-size, size, model.n_nodes)
        theta[model.spinless != 0] = 0.0
        theta = theta[model.spin_root]
        dq = np.zeros_like(z)
        dq[:, :2] = rng.uniform(-size, size, (model.n_nodes, 2))
        dq[(held & 7 != 0) & ~tied, :2] = 0.0
        u, ju = z[:, 2:], np.stack((-z[:, 3], z[:, 2]), axis=1)
        dq[:, 2:] = (theta / (1.0 + 0.25 * theta**2))[:, None] * (ju - 0.5 * theta[:, None] * u)
        tie_planar(core.ties, dq := dq.reshape(-1))
        return dq, theta

    flat.state.q[:] += moved(flat.state.q, 0.1)[0]
    flat.state.v[:] = rng.standard_normal(flat.state.v.size)
    flat.state.v.reshape(-1, 2, 2)[:, 1] *= 0.0
    tie_planar(core.ties, flat.state.v)
    flat.state.force[:] = 5.0 * rng.standard_normal(flat.state.force.size)
    dq, theta = moved(flat.state.q, 0.2)
    start = found.expand(flat.state)
    end = found.expand(flat.state._replace(q=flat.state.q + dq))
    for mine, other in zip(space.state, start):
        mine[:] = other
    if at_rest:
        return
    flat.work.dphi[:], flat.work.theta[:] = dq.reshape(-1, 4)[:, :2].reshape(-1), theta
    space.work.dphi[:] = (end.q - start.q).reshape(-1, 12)[:, :3].reshape(-1)
    space.work.theta[:] = np.outer(theta, found.axes[2]).reshape(-1)
    for side in (flat, space):
        # over an element end, within one, and backwards
        side.work.s_end[:] = side.state.s + np.array([0.9, 0.1, -0.3]) * np.array([1.0, 1.0, 0.5])


@pytest.mark.parametrize("where", ["xy", "general"])
@pytest.mark.parametrize("at_rest", [False, True], ids=["step", "statics"])
def test_planar_tangent_is_that_of_space_on_the_unknowns_of_the_plane(where: str, at_rest: bool) -> None:
    model = fb.compile_scene(mechanism(PLANES[where], sliding=not at_rest), eliminate_inner=False, planar=True)
    flat, space = Assembled(model.plane.model), Assembled(model)
    trial(model, flat, space, at_rest)
    for side in (flat, space):
        side.static() if at_rest else side.step(0.05)
    p = in_plane(model.plane.axes, model.n_nodes, model.n_sliders)
    k, r = space.tangent(), space.residual()
    expected = p.T @ k @ p
    scale = np.max(np.abs(expected), axis=1)
    assert scale.min() > 0.0
    assert np.max(np.abs(flat.tangent() - expected) / scale[:, None]) < 1e-13
    assert np.max(np.abs(flat.residual() - p.T @ r)) < 1e-13 * np.max(np.abs(r))
    # and nothing in the plane pushes out of it
    out = np.eye(len(k)) - p @ p.T
    assert np.max(np.abs(out @ r)) < 1e-13 * np.max(np.abs(r))
    assert np.max(np.abs(out @ k @ p) / np.max(np.abs(k), axis=1)[:, None]) < 1e-13


# --------------------------------------------------------------------------------------------------------- runs and states
def is_same(a: State, b: State) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a, b))


@pytest.mark.parametrize("where", ["xy", "general"])
@pytest.mark.parametrize("order", [2, 4])
def test_planar_run_goes_on_from_a_checkpoint_bit_for_bit(where: str, order: int, tmp_path: Path) -> None:
    model = fb.compile_scene(mechanism(PLANES[where]), planar=True)
    whole = fb.simulate(model, t_end=20 * H, step=H, order=order, every=1)
    half = fb.simulate(model, t_end=11 * H, step=H, order=order, every=3, output=fb.Output(checkpoint=tmp_path / "half"))
    again = fb.compile_scene(mechanism(PLANES[where]), planar=True)
    for start in (half.checkpoint, fb.load_checkpoint(tmp_path / "half")):
        rest = fb.simulate(again, t_end=20 * H, step=H, order=order, every=1, start=start)
        assert is_same(rest.state, whole.state)
        assert np.array_equal(rest.series["contact_force"], whole.series["contact_force"][11:])


def test_step_control_goes_on_from_a_checkpoint_bit_for_bit() -> None:
    model = fb.compile_scene(mechanism(plane()), planar=True)
    run = {"step": H, "tolerance": 1e-6}
    cut: list[float] = []
    whole = fb.simulate(model, t_end=0.2, callback=lambda t, state: cut.append(t), **run)
    half = fb.simulate(model, t_end=0.2, callback=lambda t, state: t >= 0.1, **run)
    assert 0.1 <= half.checkpoint.t < 0.2 and half.checkpoint.t in cut
    assert is_same(fb.simulate(model, t_end=0.2, start=half.checkpoint, **run).state, whole.state)


@pytest.mark.parametrize("where", ["xy", "general"])
def test_state_of_a_planar_run_starts_runs_in_the_plane_and_in_space(where: str) -> None:
    model, space = (fb.compile_scene(mechanism(PLANES[where]), planar=planar) for planar in (True, False))
    whole = fb.simulate(model, t_end=20 * H, step=H)
    half = fb.simulate(model, t_end=10 * H, step=H)
    assert Stepper(model, np.ones(1), half.state).plane is model.plane
    # a state of a run in space is in the plane to round-off: in an oblique plane too much of it for a planar run
    spatial = fb.simulate(space, t_end=10 * H, step=H)
    assert where == "general" or Stepper(model, np.ones(1), spatial.state).plane is model.plane
    for again, start in ((model, half.state), (space, half.state), (model, spatial.state)):
        rest = fb.simulate(again, start=fb.Start(start, time=10 * H), t_end=20 * H, step=H)
        np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0.0, atol=1e-13)


def leaving(model: Model) -> State:
    """The initial state, with everything flying off along the normal."""
    state = model.state()
    state.v.reshape(-1, 4, 3)[:, 0] += 0.05 * model.plane.axes[2]
    return state


def test_a_state_that_leaves_the_plane_runs_in_space() -> None:
    model, space = (fb.compile_scene(flight(plane()), planar=planar) for planar in (True, False))
    start = leaving(model)
    run = {"t_end": 10 * H, "step": H}
    found, expected = (fb.simulate(m, start=start, **run) for m in (model, space))
    assert is_same(found.state, expected.state)
    assert found.info["unknowns"] == expected.info["unknowns"] == space.n_unknowns > model.n_unknowns
    # it flies off by 0.05 m/s and moves in the plane as it would without
    flat = fb.simulate(model, **run)
    assert flat.info["unknowns"] == model.n_unknowns
    off = (found.state.q - flat.state.q).reshape(-1, 4, 3)
    np.testing.assert_allclose(off[:, 0], np.tile(0.05 * 10 * H * model.plane.axes[2], (model.n_nodes, 1)), rtol=0.0, atol=1e-12)


def test_a_run_that_left_the_plane_goes_on_in_space() -> None:
    model = fb.compile_scene(flight(plane()), planar=True)
    off = model.state()
    off.q.reshape(-1, 4, 3)[:, 0] += 3e-12 * model.length * model.plane.axes[2]
    assert Stepper(model, np.ones(1), off).plane is None
    half = fb.simulate(model, t_end=5 * H, step=H, start=off)
    # back in the plane by chance
    near = half.checkpoint.state._replace(q=half.checkpoint.state.q - (off.q - model.q0))
    back = fb.Checkpoint(**{**vars(half.checkpoint), "state": near})
    assert Stepper(model, np.ones(1), near).plane is model.plane
    whole = fb.simulate(model, t_end=10 * H, step=H)
    rest = fb.simulate(model, t_end=10 * H, step=H, start=back)
    assert rest.info["unknowns"] > model.n_unknowns
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("what", ["height", "velocity", "triad", "force"])
def test_states_next_to_the_plane_are_told_apart(what: str) -> None:
    model = fb.compile_scene(mechanism(plane()), planar=True)
    n = model.plane.axes[2]
    for size, stays in ((1e-14, True), (1e-9, False)):
        state = model.state()
        state.v.reshape(-1, 3)[:] = model.plane.axes[0]
        state.force.reshape(-1, 3)[:] = model.plane.axes[1]
        if what == "height":
            state.q.reshape(-1, 4, 3)[3, 0] += size * n
        elif what == "triad":
            d = state.q.reshape(-1, 4, 3)[3]
            d[1:] += size * np.cross(model.plane.axes[0], d[1:])
        elif what == "velocity":
            state.v.reshape(-1, 4, 3)[3, 0] += size * n
        else:
            state.force.reshape(-1, 3)[0] += size * n
        assert model.plane.holds(state) is stays


@pytest.mark.parametrize("method", ["midpoint", "trapezoidal", "generalized_alpha"])
def test_compared_methods_run_in_space(method: str) -> None:
    # a beam alone: fewer kernels
    scene = fb.Scene(rail := beam(plane()), wave(rail, plane()))
    model = fb.compile_scene(scene, planar=True)
    run = {"t_end": 5 * H, "step": H,
           "method": method} | ({"method": fb.Method(method, rho_inf=0.8)} if method == "generalized_alpha" else {})
    found, expected = (fb.simulate(m, **run) for m in (model, fb.compile_scene(scene, planar=False)))
    assert is_same(found.state, expected.state)
    assert found.info["unknowns"] == 6 * model.n_nodes == 2 * model.n_unknowns


def test_a_small_moment_that_follows_in_a_small_scene_leaves_the_plane() -> None:
    section = fb.Section.circle(radius=1e-5, E=1e11, rho=1e3)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1e-3, 0, 0), section=section, elements=2, d2=(0, 1, 0))
    push = fb.Load("push", beam.end, force=(0, 1.0, 0), moment=(3e-14, 0, 0), follower=True)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), push))
    assert model.not_planar
