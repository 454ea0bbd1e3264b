"""The compiled residual equals the slow twin of `tests/naive.py`, and the compiled tangent its numerical derivative.

Every trial step is far from equilibrium and starts from a deformed state with an open gap, so that no term vanishes by chance.
"""
from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fastbeam.compile.compile import compile_scene
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.call_tables import Calls, SystemRecord
from fastbeam.kernels.contact.slider import predict_sliders
from fastbeam.kernels.terms import Conserving, Equilibrium
from fastbeam.model.feature import OfRun
from fastbeam.model.forces.loads import load_factors
from fastbeam.model.model import Model
from fastbeam.model.workspace import contact_of, work_of
from fastbeam.scene import (
    AddedMass,
    BallJoint,
    Beam,
    Clamp,
    DistributedLoad,
    Drag,
    Load,
    Pin,
    PointMass,
    RigidBody,
    RigidConnection,
    Scene,
    Section,
    Slider,
)
from fastbeam.stepping.constraint_rows import constraints_of
from fastbeam.stepping.terms import system_of, terms_of

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive import Step, Twin, augmented_increment, cay, cayley_vector, compliances, dissipation, increments, turn  # noqa: E402

Array = np.ndarray
BORDER = 7  # unknowns of a slider: force, position, mean gap
H = 0.05  # 2/h^2 times the masses below is about the stiffness: neither hides the other
ROUND_OFF = 1e-12  # of the norm: a few hundred products of numbers of that size
NUMERICAL = 1e-7  # of a row's largest entry: central differences reach about 1e-9
DIAGONAL = Section(EA=200.0, GA2=150.0, GA3=130.0, GJ=50.0, EI2=60.0, EI3=70.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)


def _coupled() -> Section:
    a = np.random.default_rng(7).standard_normal((6, 6))
    return Section.from_matrix(20.0 * (a @ a.T + 4.0 * np.eye(6)), rhoA=1.0, rhoI2=0.3, rhoI3=0.5)


def _viscous() -> Section:
    a = np.random.default_rng(8).standard_normal((6, 6))
    return replace(_coupled(), damping=a @ a.T)


SECTIONS = {"diagonal": DIAGONAL, "coupled": _coupled(), "damped": replace(DIAGONAL, damping=0.03),
            "damped apart": replace(DIAGONAL, damping=(0.01, 0.0, 0.02, 0.05, 0.03, 0.08)), "viscous": _viscous()}
DAMPED = ("damped", "damped apart", "viscous")
FAMILIES = {"lagrange1": {"degree": 1}, "lagrange2": {"degree": 2}, "lagrange4": {"degree": 4},
            "bspline2_greville": {"interpolation": "bspline", "degree": 2},
            "bspline3_control": {"interpolation": "bspline", "degree": 3, "directors": "control"}}


# ---------------------------------------------------------------------------------------------------------------- scenes
def _curved(strain: str, section: str, family: str) -> Scene:
    return Scene(Beam.helix("b", radius=1.0, pitch=0.5, turns=0.4, section=SECTIONS[section], elements=3, strain=strain,
                            **FAMILIES[family]))


def _unequal_elements() -> Scene:
    return Scene(Beam.straight("b", (0, 0, 0), (2, 1, 2), twist=0.7, section=SECTIONS["coupled"], degree=3,
                               elements=[0.0, 0.3, 1.7, 3.0]))


def _rail(**family: object) -> Beam:
    return Beam.helix("rail", radius=1.0, pitch=0.5, turns=0.5, section=DIAGONAL, elements=6, **{"degree": 2, **family})


def _mass_on_rail(curve: str = "own", **family: object) -> Scene:
    rail, mass = _rail(**family), PointMass("m", mass=0.2)
    # interior control points of a spline take no load
    loaded = rail.node(3) if rail.interpolation == "lagrange" else rail.end
    return Scene(rail, mass, Slider("s", mass, rail, at=0.4 * rail.length, curve=curve), Clamp(rail.start), Pin(rail.end),
                 Load("pull", loaded, force=(1, 2, -1), moment=(0.5, -1, 2)), gravity=(1, 2, -9.81))


def _body_on_rail() -> Scene:
    rail = Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=DIAGONAL, elements=5, degree=2)
    body = RigidBody("body", mass=2.0, inertia=[[1, 0.1, 0], [0.1, 1.2, 0], [0, 0, 0.9]], position=(1.5, 0.2, 0.5))
    mass = PointMass("m", mass=0.3)
    return Scene(rail, body, mass, Slider("hook", body.point((-0.1, -0.2, -0.5)), rail, at=1.4),
                 Slider("bead", mass, rail, at=2.0, curve="c1"),
                 Load("tip", body.point((0.3, 0, 0)), force=(1, 2, 3), moment=(3, 2, 1)), gravity=(0, 0, -9.81))


def _beam_on_rail() -> Scene:
    rail = Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=DIAGONAL, elements=4, degree=3)
    rod = Beam.straight("rod", (1, 0, 0), (1, 2, 0.5), section=SECTIONS["coupled"], elements=2, degree=2)
    return Scene(rail, rod, Slider("s", rod.start, rail, at=1.0, curve="c1"), Clamp(rail.start))


def _tied_point_on_tied_rail() -> Scene:
    # both ends of the rail hang on arms of bodies, the sliding point is a mass on a ball joint at the tip of a rod
    hub = RigidBody("hub", mass=2.0, inertia=(1, 1.2, 0.9), position=(-0.2, 0.1, 0.3))
    tail = RigidBody("tail", mass=1.0, inertia=(0.5, 0.4, 0.3), position=(3.2, 0.1, -0.3))
    rail = Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=DIAGONAL, elements=4, degree=2)
    rod = Beam.straight("rod", (1.1, 1.0, 0.5), (1.1, 0, 0), section=DIAGONAL, elements=1, degree=2)
    mass = PointMass("m", mass=0.3)
    return Scene(hub, tail, rail, rod, mass, RigidConnection(hub, rail.start), BallJoint(rail.end, tail.point((-0.2, -0.1, 0.3))),
                 BallJoint(mass, rod.end), Slider("s", mass, rail, at=1.1))


def _mass_on_ball_joint() -> Scene:
    beam = Beam.straight("b", (0, 0, 0), (2, 0, 0), section=DIAGONAL, elements=2, degree=2)
    mass = PointMass("m", mass=0.7)
    return Scene(beam, mass, BallJoint(beam.end, mass), gravity=(0, 3, -9.81))


def _beam_body_beam() -> Scene:
    body = RigidBody("body", mass=2.0, inertia=(1, 1.3, 0.8), position=(3.1, 0.2, 0.5))
    a = Beam.straight("a", (0, 0, 0), (3, 0, 0), section=DIAGONAL, elements=2, degree=2)
    b = Beam.straight("b", (3, 0.3, 0.8), (4, 2, 1), section=SECTIONS["coupled"], elements=2, degree=2)
    c = Beam.straight("c", (3.1, 0.2, 0.2), (4, 2, -1), section=DIAGONAL, elements=2, degree=1)
    return Scene(a, body, b, c, RigidConnection(a.end, body), RigidConnection(body, b.start),
                 BallJoint(body.point((0, 0, -0.3)), c.start), Load("tip", b.start, force=(1, 2, 3), moment=(-2, 1, 2)))


def _ball_chain() -> Scene:
    # three bodies in a row: the last one moves on three arms
    rod = Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=DIAGONAL, elements=1, degree=2)
    x = [RigidBody(f"x{k}", mass=1.0 + k, inertia=(1, 1.2, 0.9), position=(1.3 + k, 0.1, 0.2)) for k in range(3)]
    balls = [BallJoint(rod.end, x[0].point((-0.3, -0.1, -0.2))), BallJoint(x[0].point((0.5, 0, 0.1)), x[1].point((-0.5, 0, 0.1))),
             BallJoint(x[1].point((0.5, 0.2, 0.1)), x[2].point((-0.5, 0.2, 0.1)))]
    return Scene(rod, *x, *balls)


def _beam_looped_on_a_body() -> Scene:
    # the blocks between both ends of the beam land on the body's diagonal
    body = RigidBody("body", mass=2.0, inertia=(1, 1.3, 0.8), position=(0.4, 0.6, 0.1))
    beam = Beam.straight("b", (0, 0, 0), (1, 0, 0), section=SECTIONS["coupled"], elements=1, degree=2)
    return Scene(body, beam, RigidConnection(body, beam.start), BallJoint(beam.end, body.point((0.6, -0.6, -0.1))))


def _beams_at_an_angle() -> Scene:
    def line(x: Array) -> Array:
        return np.outer(1.0 + x, (0.5, -1.0, 2.0))

    a = Beam.straight("a", (0, 0, 0), (1.5, 0, 0), section=DIAGONAL, elements=2, degree=2)
    b = Beam.straight("b", (1.5, 0, 0), (2, 1, 0.7), section=SECTIONS["coupled"], elements=2, degree=2, strain="green_lagrange")
    c = Beam.straight("c", (1.5, 0, 0), (2, -1, 0.3), section=DIAGONAL, elements=2, interpolation="bspline", degree=2)
    return Scene(a, b, c, RigidConnection(a.end, b.start), RigidConnection(b.start, c.start), Clamp(a.start), Pin(b.end),
                 DistributedLoad("wind", b, force=line, moment=(1, 2, 3)),
                 Load("pull", b.start, force=(1, 2, 3), moment=(-2, 1, 2)), gravity=(0, 0, -9.81))


def _damped_beams_at_an_angle() -> Scene:
    # a strain set with damping and one without, and a beam without in the first
    scene = _beams_at_an_angle()
    a = scene.beams[0]
    slow = Beam.straight("slow", (0, 0, 0), (0, 1.5, 0), section=SECTIONS["damped apart"], elements=3, degree=2)
    return Scene(*scene.parts, slow, RigidConnection(a.start, slow.start), gravity=scene.gravity)


def _in_the_wind() -> Scene:
    beam = Beam.helix("b", radius=1.0, pitch=0.5, turns=0.4, section=DIAGONAL, elements=3, degree=2)
    body = RigidBody("body", mass=2.0, inertia=(1, 1.3, 0.8), position=beam.reference(beam.length)[0][0] + (0.3, 0.1, -0.2))
    return Scene(beam, body, RigidConnection(body, beam.end),
                 Drag("air", beam, normal=3.0, tangential=1.0, linear=0.5, air=(2, -1, 3)),
                 Drag("gust", body, normal=2.0, linear=1.0))


def _in_water() -> Scene:
    beam = Beam.helix("b", radius=1.0, pitch=0.5, turns=0.4, section=DIAGONAL, elements=3, degree=2)
    body = RigidBody("body", mass=2.0, inertia=(1, 1.3, 0.8), position=beam.reference(beam.length)[0][0] + (0.3, 0.1, -0.2))
    return Scene(beam, body, RigidConnection(body, beam.end), AddedMass("round", beam, normal=30.0, tangential=1.0),
                 AddedMass("blunt", body, normal=2.0, tangential=5.0))


SCENES: dict[str, Callable[[], Scene]] = {
    f"{strain}-{section}-{family}": lambda a=(strain, section, family): _curved(*a)
    for strain in ("simo_reissner", "green_lagrange") for section in ("diagonal", "coupled") for family in FAMILIES}
SCENES |= {f"{strain}-{section}-lagrange2": lambda a=(strain, section, "lagrange2"): _curved(*a)
           for strain in ("simo_reissner", "green_lagrange") for section in DAMPED}
SCENES |= {
    "unequal elements": _unequal_elements,
    "mass on own curve": _mass_on_rail,
    "mass on c1 curve": lambda: _mass_on_rail("c1"),
    "mass on bspline": lambda: _mass_on_rail(interpolation="bspline"),
    "mass on degree 1": lambda: _mass_on_rail(degree=1),
    "body and mass on rail": _body_on_rail,
    "beam on rail": _beam_on_rail,
    "tied point on tied rail": _tied_point_on_tied_rail,
    "mass on ball joint": _mass_on_ball_joint,
    "beam body beam": _beam_body_beam,
    "ball chain": _ball_chain,
    "beam looped on a body": _beam_looped_on_a_body,
    "beams at an angle": _beams_at_an_angle,
    "damped beams at an angle": _damped_beams_at_an_angle,
    "in the wind": _in_the_wind,
    "in water": _in_water,
}
# (scene, s_n and s_n+1 of every slider as parts of the length)
WHOLE = [(name, ()) for name in SCENES if not any(word in name for word in ("mass on", "rail")) or name == "mass on ball joint"]
SLIDING = [(name, ((a, b),)) for name in ("mass on own curve", "mass on c1 curve", "mass on bspline", "mass on degree 1")
           for a, b in ((0.40, 0.45), (0.13, 0.72), (0.88, 0.21))]
SLIDING += [("body and mass on rail", ((0.47, 0.55), (0.67, 0.62))), ("body and mass on rail", ((0.05, 0.93), (0.97, 0.03))),
            ("beam on rail", ((0.07, 0.95),)), ("beam on rail", ((0.8, 0.1),)), ("beam on rail", ((0.6, 0.65),)),
            ("tied point on tied rail", ((0.1, 0.9),)), ("tied point on tied rail", ((0.02, 0.3),)),
            ("tied point on tied rail", ((0.95, 0.05),))]
STEPS = [pytest.param(*case, id="-".join([case[0].replace(" ", "_"), *(f"{a:g}_to_{b:g}" for a, b in case[1])]))
         for case in WHOLE + SLIDING]


# ------------------------------------------------------------------------------------------------------------- both sides
@cache
def compiled(name: str) -> tuple[Scene, Model, Twin]:
    """Scene, its model and its twin, made once."""
    scene = SCENES[name]()
    # node by node against the twin
    model = compile_scene(scene, eliminate_inner=False, planar=False)
    return scene, model, Twin(scene, model)


ENTRIES = 64  # of a slider, enough to cross many elements


class Kernels:
    """The compiled equations of one model, in the order of the twin: nodes [N, 6], sliders [S, 4]."""

    def __init__(self, model: Model) -> None:
        self.model, self.state, self.work, self.contact = model, model.state(), work_of(model), contact_of(model, ENTRIES)
        self.solver = model.pattern.plan
        if model.by_rows:
            self.solver = constraints_of(model, None, ENTRIES, 4.0)
            self.work = self.work._replace(blocks=self.solver.factors.store[:self.solver.couplings.end[0]])

    def parts(self, method: Any = Conserving()) -> tuple[Any, Any]:
        """Terms and the record of what they share."""
        m, static = self.model, isinstance(method, Equilibrium)
        contact, solver = (None, m.pattern.plan) if static else (self.contact, self.solver)
        return Calls(terms_of(OfRun(m, static))).on(SystemRecord(system_of(m, method, contact, solver, self.state, self.work)))

    def load(self) -> None:
        """Loads at factor 1."""
        kernels.external_forces(self.model.loads, np.ones(len(self.model.load_times)), self.work.f_ext)

    def assemble(self, twin: Twin, trial: Step) -> None:
        """Residual and tangent at a trial step."""
        m, state, work = self.model, self.state, self.work
        state.q[:], state.v[:] = trial.q_n.reshape(-1), trial.v_n.reshape(-1)
        m.start_momenta(state.history, state.q, state.v, state.s)
        state.s[:], state.force[:], work.s_end[:] = trial.s_n, trial.force.reshape(-1), trial.s_end
        self.load()
        if m.sliders is not None:
            predict_sliders(m.curves, m.sliders, self.contact, state, trial.h, np.nan, work.past, work.s_end, state.force, SPACE)
            work.s_end[:] = trial.s_end
        work.dphi[:] = twin.connected(increments(trial.q_n, trial.dphi, trial.theta))[:, 0].reshape(-1)
        work.theta[:] = trial.theta.reshape(-1)
        if m.added is not None:
            # those of tied nodes too
            q_end = trial.q_n + twin.connected(increments(trial.q_n, trial.dphi, trial.theta))
            work.theta[:] = np.concatenate([turn(a, b) for a, b in zip(trial.q_n[:, 1:], q_end[:, 1:])])
        kernels.assemble_all(*self.parts(), trial.h)

    def assemble_static(self, q: Array) -> None:
        """Residual and tangent at rest: no inertia, both ends equal."""
        self.load()
        self.state.q[:] = q.reshape(-1)
        parts = self.parts(Equilibrium())
        kernels.begin(*parts, 0.0)
        kernels.assemble_all(*parts, 0.0)

    def residual(self) -> tuple[Array, Array]:
        """Nodes [N, 6], sliders [S, 4]."""
        nodes = self.work.r.reshape(-1, 8)[self.model.pattern.row_of, :6]
        sliders = np.zeros((0, 4)) if self.contact is None else self.contact.residual[:, :4]
        return nodes.copy(), sliders.copy()

    def tangent(self) -> Array:
        """Dense matrix over (nodes, F and s of every slider); the unknowns g_mean of the border are eliminated."""
        m, contact = self.model, self.contact
        n, s = 6 * m.n_nodes, m.n_sliders
        pattern = m.pattern
        k = np.zeros((n + BORDER * s, n + BORDER * s))
        for block, row, column in zip(self.work.blocks.reshape(-1, 6, 8), pattern.rows, pattern.columns):
            k[6 * row:6 * row + 6, 6 * column:6 * column + 6] = block[:, :6]
        for i in range(s):
            border = slice(n + BORDER * i, n + BORDER * (i + 1))
            for e in range(contact.entries[i]):
                at = slice(6 * contact.row[i, e], 6 * contact.row[i, e] + 6)
                k[at, border] += contact.column[i].reshape(-1, 6, 8)[e, :, :BORDER]
                k[border, at] += contact.line[i].reshape(-1, 6, 8)[e, :, :BORDER].T
            k[border, border] = contact.corner[i].reshape(8, 8)[:BORDER, :BORDER]
        by_node = (6 * pattern.row_of[:, None] + np.arange(6)).reshape(-1)
        keep = np.concatenate((by_node, (n + BORDER * np.arange(s)[:, None] + np.arange(4)).reshape(-1)))
        gap = (n + BORDER * np.arange(s)[:, None] + np.arange(4, BORDER)).reshape(-1)
        return k[np.ix_(keep, keep)] - k[np.ix_(keep, gap)] @ np.linalg.solve(k[np.ix_(gap, gap)], k[np.ix_(gap, keep)])


def random_move(twin: Twin, rng: np.random.Generator, position: float, rotation: float) -> tuple[Array, Array]:
    """dphi, theta [N, 3] that leave held unknowns alone; tied nodes share the spin of their root."""
    x = rng.standard_normal((twin.n, 6)) * np.repeat((position, rotation), 3)
    x[~twin.free] = 0.0
    x[:, 3:] = x[twin.spin_root, 3:]
    return x[:, :3], x[:, 3:]


def sizes_of_moves(twin: Twin) -> tuple[float, float]:
    """Of positions (m) and rotations (rad), so that no point of a beam is compressed to nothing."""
    spacing = min((float(np.diff(beam.node_s).min()) for beam in twin.scene.beams), default=1.0)
    return 0.12 * spacing, min(0.3, 0.8 * spacing)


def deformed(twin: Twin, rng: np.random.Generator) -> Array:
    """A configuration away from the reference that all joints allow."""
    return twin.q0 + twin.connected(increments(twin.q0, *random_move(twin, rng, *sizes_of_moves(twin))))


def trial_step(scene: Scene, twin: Twin, ends: tuple[tuple[float, float], ...]) -> Step:
    """A step with nothing small in it."""
    rng = np.random.default_rng(3)
    q_n = deformed(twin, rng)
    lengths = np.array([slider.beam.length for slider in scene.sliders])
    s = np.array(ends).reshape(-1, 2).T * lengths
    v_n = twin.connected(rng.standard_normal((twin.n, 4, 3)))
    force = 5.0 * rng.standard_normal((lengths.size, 3))
    return Step(q_n, v_n, *random_move(twin, rng, *sizes_of_moves(twin)), s[0], s[1], force, H)


def flat(residual: tuple[Array, Array], twin: Twin) -> Array:
    """Equations of the free unknowns and of the sliders as one vector."""
    return np.concatenate((residual[0][twin.free], residual[1].reshape(-1)))


def numerical_tangent(twin: Twin, trial: Step) -> Array:
    """Central differences of the twin: position, spin at the end of the step, then F and s of every slider."""
    eps = 2e-6

    def difference(change: Callable[[float], Step]) -> Array:
        plus, minus = (flat(twin.residual(change(x)), twin) for x in (eps, -eps))
        return (plus - minus) / (2.0 * eps)

    def moved(node: int, component: int) -> Callable[[float], Step]:
        def change(x: float) -> Step:
            dphi, theta = trial.dphi.copy(), trial.theta.copy()
            if component < 3:
                dphi[node, component] += x
            else:
                theta[node] = cayley_vector(cay(x * np.eye(3)[component - 3]) @ cay(theta[node]))
            return Step(trial.q_n, trial.v_n, dphi, theta, trial.s_n, trial.s_end, trial.force, trial.h)
        return change

    def pushed(slider: int, component: int) -> Callable[[float], Step]:
        def change(x: float) -> Step:
            force, s_end = trial.force.copy(), trial.s_end.copy()
            if component < 3:
                force[slider, component] += x
            else:
                s_end[slider] += x
            return Step(trial.q_n, trial.v_n, trial.dphi, trial.theta, trial.s_n, s_end, force, trial.h)
        return change

    columns = [difference(moved(*at)) for at in np.argwhere(twin.free)]
    columns += [difference(pushed(k, c)) for k in range(trial.s_n.size) for c in range(4)]
    return np.array(columns).T


def assert_same_rows(tangent: Array, expected: Array) -> None:
    """Row by row, so that soft equations count as much as stiff ones."""
    scale = np.max(np.abs(expected), axis=1)
    assert scale.min() > 0.0
    assert np.max(np.abs(tangent - expected) / scale[:, None]) < NUMERICAL


def free_block(twin: Twin, tangent: Array) -> Array:
    """Rows and columns of the free unknowns and the sliders."""
    keep = np.concatenate((twin.free.reshape(-1), np.ones(len(tangent) - twin.free.size, dtype=bool)))
    return tangent[np.ix_(keep, keep)]


# ----------------------------------------------------------------------------------------------------------------- tests
@pytest.mark.parametrize(("name", "ends"), STEPS)
def test_residual_equals_the_twin(name: str, ends: tuple) -> None:
    scene, model, twin = compiled(name)
    trial = trial_step(scene, twin, ends)
    kernel = Kernels(model)
    kernel.assemble(twin, trial)
    nodes, sliders = twin.residual(trial)
    found_nodes, found_sliders = kernel.residual()
    assert np.max(np.abs(found_nodes - nodes)) < ROUND_OFF * np.linalg.norm(nodes)
    if sliders.size:
        assert np.max(np.abs(found_sliders - sliders)) < ROUND_OFF * np.linalg.norm(sliders)
        assert np.array_equal(kernel.contact.residual[:, 4:7], np.zeros((len(sliders), 3)))


@pytest.mark.parametrize(("name", "ends"), STEPS)
def test_tangent_equals_differences_of_the_twin(name: str, ends: tuple) -> None:
    scene, model, twin = compiled(name)
    trial = trial_step(scene, twin, ends)
    kernel = Kernels(model)
    kernel.assemble(twin, trial)
    assert_same_rows(free_block(twin, kernel.tangent()), numerical_tangent(twin, trial))


@pytest.mark.parametrize("name", ["simo_reissner-viscous-lagrange2", "damped beams at an angle",
                                  pytest.param("green_lagrange-viscous-lagrange2", marks=pytest.mark.slow)])
def test_energy_taken_by_damping_equals_the_twin(name: str) -> None:
    scene, model, twin = compiled(name)
    trial = trial_step(scene, twin, ())
    kernel = Kernels(model)
    kernel.assemble(twin, trial)
    kernels.account_all(*kernel.parts(), trial.h)
    q_n1 = trial.q_n + twin.connected(increments(trial.q_n, trial.dphi, trial.theta))
    damped = [beam for beam in scene.beams if np.any(beam.section.damping)]
    at = [twin.of_beam(beam) for beam in damped]
    expected = [dissipation(beam, trial.q_n[x], q_n1[x], trial.h) for beam, x in zip(damped, at)]
    assert model.losses == tuple(f"damping of {beam.label}" for beam in damped) and min(expected) > 0.0
    np.testing.assert_allclose(kernel.state.history[model.loss_place:], expected, rtol=1e-12)


@pytest.mark.parametrize(("name", "ends"), [("mass on c1 curve", ((0.40, 0.45),)), ("tied point on tied rail", ((0.1, 0.9),)),
                                            ("body and mass on rail", ((0.47, 0.55), (0.67, 0.62)))])
@pytest.mark.parametrize("factor", [3.0, 1e7])
@pytest.mark.parametrize("first", [0.0, 1.0])
def test_an_augmented_increment_equals_the_twin(name: str, ends: tuple, factor: float, first: float) -> None:
    scene, model, twin = compiled(name)
    trial = trial_step(scene, twin, ends)
    kernel = Kernels(model)
    kernel.assemble(twin, trial)
    # this tangent equals differences of the twin, see above; theirs would lose digits in the solution
    tangent = free_block(twin, kernel.tangent())
    kernel.contact.augmented[:] = 1.0 / factor, 0.0, first, 0.0
    work, m = kernel.work, model
    terms, system = kernel.parts()
    kernels.fill_right(terms, system)
    assert kernels.solve_right(terms, system)
    assert np.all(kernel.solver.factors.failed == (0, -1))
    # the kernel's compliance leaves out the moment of the frame, and what nodes behind the slider in the elimination give
    share = kernel.contact.compliance / compliances(tangent, len(ends))
    assert np.all((share > 0.2) & (share < 1.01)), share
    expected, left = augmented_increment(tangent, flat(twin.residual(trial), twin), first * trial.force,
                                         factor / kernel.contact.compliance)
    nodes = work.increment.x.reshape(-1, 8)[m.pattern.row_of, :6]
    found = np.concatenate((nodes[twin.free], work.y.reshape(-1, BORDER)[:, :4].reshape(-1)))
    assert np.max(np.abs(found - expected)) < 1e-9 * np.max(np.abs(expected))
    assert np.min(np.abs(left)) > 0.0
    np.testing.assert_allclose(kernel.contact.remaining, np.max(np.abs(left), axis=1), rtol=1e-9, atol=1e-13)
    closed = kernels.all_settled(terms, system)
    assert closed == (np.max(kernel.contact.remaining) < 1e-14)


@pytest.mark.parametrize("name", ["mass on own curve", "beams at an angle", "ball chain", "tied point on tied rail"])
def test_held_unknowns_have_rows_and_columns_of_the_identity(name: str) -> None:
    scene, model, twin = compiled(name)
    kernel = Kernels(model)
    kernel.assemble(twin, trial_step(scene, twin, ((0.4, 0.5),) * model.n_sliders))
    held = np.flatnonzero(~twin.free.reshape(-1))
    n = twin.free.size
    identity = np.eye(n)[held]
    tangent = kernel.tangent()[:n, :n]
    assert np.array_equal(tangent[held], identity)
    assert np.array_equal(tangent[:, held], identity.T)
    assert model.n_unknowns == n - held.size + 4 * model.n_sliders


@pytest.mark.parametrize("name", ["beams at an angle", "beam body beam"])
def test_static_residual_equals_the_twin(name: str) -> None:
    _, model, twin = compiled(name)
    q = deformed(twin, np.random.default_rng(11))
    kernel = Kernels(model)
    kernel.assemble_static(q)
    expected = twin.static_residual(q)
    assert np.max(np.abs(kernel.residual()[0] - expected)) < ROUND_OFF * np.linalg.norm(expected)


@pytest.mark.parametrize("name", ["beams at an angle", "beam body beam"])
def test_static_tangent_is_twice_that_of_the_kernels(name: str) -> None:
    _, model, twin = compiled(name)
    q = deformed(twin, np.random.default_rng(11))
    kernel = Kernels(model)
    kernel.assemble_static(q)
    eps, columns = 2e-6, []
    for node, c in np.argwhere(twin.free):
        ends = []
        for x in (eps, -eps):
            move = np.zeros((twin.n, 6))
            move[node, c] = x
            ends.append(twin.static_residual(q + twin.connected(increments(q, move[:, :3], move[:, 3:])))[twin.free])
        columns.append((ends[0] - ends[1]) / (2.0 * eps))
    assert_same_rows(2.0 * free_block(twin, kernel.tangent()), np.array(columns).T)


def test_loads_follow_their_time_factors() -> None:
    wind, weight = (lambda t: 2.0 + t), (lambda t: 3.0)
    beam = Beam.straight("b", (0, 0, 0), (2, 0, 0), section=DIAGONAL, elements=2, degree=2)
    scene = Scene(beam, Load("wind", beam.end, force=(0, 1, 0), moment=(1, 0, 0), time=wind),
                  Load("dead", beam.end, force=(1, 0, 0)), DistributedLoad("gust", beam, force=(0, 0, 1), time=wind),
                  gravity=(0, 0, -9.81), gravity_time=weight)
    # node by node against the twin
    model = compile_scene(scene, eliminate_inner=False, planar=False)
    twin = Twin(scene, model)
    kernel = Kernels(model)
    kernels.external_forces(model.loads, load_factors(model, np.array([1.0]), np.array([0.5]))[0], kernel.work.f_ext)
    # the mean of 2 + t over [1, 1.5]
    force, torque = twin.dead_loads({None: 1.0, wind: 3.25, weight: 3.0}.__getitem__)
    found = kernel.work.f_ext.reshape(-1, 8)
    np.testing.assert_allclose(found[model.pattern.row_of, :6], np.concatenate((force, torque), axis=1), rtol=1e-14,
                               atol=1e-14)
    assert not np.any(found[-1])


def random_velocity(twin: Twin, rng: np.random.Generator) -> Array:
    """Rates [N, 4, 3] at t = 0 that joints and supports allow."""
    v, omega = rng.standard_normal((2, twin.n, 3))
    v[~twin.free[:, 0]] = 0.0
    omega[~twin.free[:, 3]] = 0.0
    omega = omega[twin.spin_root]
    return twin.connected(np.concatenate((v[:, None], np.cross(omega[:, None], twin.q0[:, 1:])), axis=1))


@pytest.mark.parametrize("name", ["body and mass on rail", "tied point on tied rail"])
def test_a_converged_step_is_a_root_of_the_twin(name: str) -> None:
    _, model, twin = compiled(name)
    kernel = Kernels(model)
    kernel.load()
    state, work = kernel.state, kernel.work
    # velocities that the contact does not allow: it has to push
    state.v[:] = random_velocity(twin, np.random.default_rng(5)).reshape(-1)
    counts = np.zeros(4, np.int64)
    kernels.run(*kernel.parts(), np.ones(1), H, 1, 30, counts, np.zeros(30), np.zeros((2, 3 * model.n_sliders)))
    status, _, iterations, _ = counts
    assert status == kernels.OK
    assert iterations < 12
    found = Step(work.keep_q.reshape(-1, 4, 3), work.keep_v.reshape(-1, 4, 3), work.dphi.reshape(-1, 3),
                 work.theta.reshape(-1, 3), work.keep_s, work.s_end, state.force.reshape(-1, 3), H)
    nodes, sliders = twin.residual(found)
    inertia = 2.0 / H**2 * np.linalg.norm(twin.mass @ (H * found.v_n).reshape(-1, 3))
    assert np.max(np.abs(found.force)) > 1.0
    assert np.max(np.abs(found.s_end - found.s_n)) > 1e-3
    assert np.max(np.abs(nodes)) < ROUND_OFF * inertia
    assert np.max(np.abs(sliders[:, :3])) < 1e-14 * model.length
    assert np.max(np.abs(sliders[:, 3])) < ROUND_OFF * np.max(np.abs(found.force))
