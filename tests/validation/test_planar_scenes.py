"""A planar scene with 3 unknowns a node is the same scene with 6, to round-off: positions, triads, velocities, contact forces,
energies and the number of Newton iterations."""
from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from planar_scenes import FAMILIES, FLAT, ROUND, SECTION, flight, mechanism, plane  # noqa: E402

Array = np.ndarray
H = 0.01
# e_x, e_y, e_z to e_z, e_x, e_y
ZX = np.eye(3)[[1, 2, 0]]
# relative to the size of the scene, the largest velocity, force, energy; measured 4e-15, 6e-12, 5e-11, 2e-13: velocities are
# increments over h, contact forces increments over h^2 and, with order 4, over parts of it
PLACE, RATE, FORCE, ENERGY = 1e-13, 5e-11, 2e-10, 2e-12


def both(scene: Callable[[], fb.Scene], compiled: dict[str, Any] | None = None, **run: Any) -> tuple[fb.Result, fb.Result]:
    """The scene in its plane, and in space."""
    out = []
    for planar in (True, False):
        model = fb.compile_scene(scene(), planar=planar, **(compiled or {}))
        out.append(fb.simulate(model, **{"t_end": 25 * H, "step": H, "every": 1, "output": fb.Output(snapshots=5), **run}))
    return out[0], out[1]


def assert_same(flat: fb.Result, space: fb.Result, slack: float = 1.0, oblique: bool = False) -> None:
    """Everything that both recorded. Newton's method ends by the largest component of an increment: in an oblique plane both runs
    have different components, and a step may take one iteration more or less."""
    length = float(np.max(np.ptp(space.phi.reshape(-1, 3), axis=0)))
    for a, b, size in ((flat.state.q, space.state.q, length), (flat.phi, space.phi, length),
                       (flat.directors, space.directors, 1.0)):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=slack * PLACE * size)
    np.testing.assert_allclose(flat.state.v, space.state.v, rtol=0.0, atol=slack * RATE * np.max(np.abs(space.state.v)))
    assert flat.t.tobytes() == space.t.tobytes() or slack > 1.0
    np.testing.assert_allclose(flat.series["iterations"], space.series["iterations"], rtol=0.0, atol=1.0 if oblique else 0.0)
    assert oblique or flat.info["iterations"] == space.info["iterations"]
    assert flat.info["fallbacks"] == space.info["fallbacks"] == 0
    assert flat.info["unknowns"] < space.info["unknowns"]
    largest = max(float(np.max(np.abs(space.series[name]))) for name in ("kinetic", "strain", "total"))
    for name, size, limit in (("kinetic", largest, ENERGY), ("strain", largest, ENERGY), ("total", largest, ENERGY),
                              ("s_slide", length, PLACE), ("gap", length, PLACE), ("contact_force", None, FORCE)):
        if name in space.series:
            a, b = flat.series[name], space.series[name]
            np.testing.assert_allclose(a, b, rtol=0.0, atol=slack * limit * (size or float(np.max(np.abs(b)))), err_msg=name)
    # something happened
    assert np.ptp(space.series["kinetic"]) > 0.01 * largest


# families with shapes and directions of d2 in turn, and with three more of them each
SHAPES = [("straight", "in"), ("spline", "oblique"), ("arc", "in"), ("straight", "out"), ("spline", "in"), ("spline", "out"),
          ("straight", "oblique")]
FEW, MORE = ([(family, *SHAPES[(k + j) % len(SHAPES)]) for k, family in enumerate(FAMILIES) for j in turns]
             for turns in ((0,), (1, 3, 5)))


@pytest.mark.parametrize(("family", "shape", "d2"), FEW)
def test_beams_of_every_family_in_flight(family: str, shape: str, d2: str) -> None:
    assert_same(*both(lambda: flight(FLAT, family, shape, d2)))


@pytest.mark.parametrize("elements", [1, 2])
@pytest.mark.parametrize("family", FAMILIES)
def test_beams_of_few_elements_in_flight(family: str, elements: int) -> None:
    # elements of B-splines have fewer nodes than in a longer beam, with as many points: 4 and 2 at degree 2
    assert_same(*both(lambda: flight(FLAT, family, elements=elements)))


@pytest.mark.slow
@pytest.mark.parametrize(("family", "shape", "d2"), MORE)
def test_beams_of_every_family_in_a_general_plane(family: str, shape: str, d2: str) -> None:
    turn = plane()
    assert_same(*both(lambda: flight(turn, family, shape, d2), t_end=50 * H), oblique=True)


@pytest.mark.parametrize("where", ["xy", "zx", "general"])
@pytest.mark.parametrize("order", [2, 4])
def test_mechanism(where: str, order: int) -> None:
    turn = {"xy": FLAT, "zx": ZX, "general": plane()}[where]
    assert_same(*both(lambda: mechanism(turn), order=order), oblique=where == "general")


def test_step_control() -> None:
    # sizes of steps follow from local errors: differences of round-off size scale them. The last step of this tolerance is no
    # short rest, whose forces would have the round-off of places divided by its square
    flat, space = both(mechanism, tolerance=5e-6, observe=("energy", "momentum", "slider"))
    assert flat.info["accepted"] == space.info["accepted"] > 5
    assert flat.info["rejected"] == space.info["rejected"]
    np.testing.assert_allclose(flat.t, space.t, rtol=1e-9)
    assert_same(flat, space, slack=100.0)


def test_inner_nodes_need_not_be_eliminated() -> None:
    assert_same(*both(flight, {"eliminate_inner": False}))
    eliminated, kept = (fb.simulate(fb.compile_scene(flight(), planar=True, eliminate_inner=eliminate), t_end=25 * H, step=H)
                        for eliminate in (True, False))
    np.testing.assert_allclose(eliminated.state.q, kept.state.q, rtol=0.0, atol=3 * PLACE)


@pytest.mark.parametrize("backend", ["auto", "superlu"])
def test_sparse_solvers(backend: str) -> None:
    flat, space = both(mechanism, {"solver": "sparse"}, backend=backend)
    assert_same(flat, space)
    assert flat.info["solver"].split(",")[0] == space.info["solver"].split(",")[0]
    chain = fb.simulate(fb.compile_scene(mechanism(), planar=True), t_end=25 * H, step=H)
    np.testing.assert_allclose(flat.state.q, chain.state.q, rtol=0.0, atol=3 * PLACE)


@pytest.mark.parametrize("make", [mechanism, lambda turn: flight(turn, "lagrange 3", "spline", "out")],
                         ids=["mechanism", "flight"])
def test_scene_in_a_general_plane_is_the_one_in_the_coordinate_plane_turned(make: Callable[[Array], fb.Scene]) -> None:
    turn = plane()
    flat, turned = (fb.simulate(fb.compile_scene(make(x), planar=True), t_end=25 * H, step=H, every=1) for x in (FLAT, turn))
    back = turned.state.q.reshape(-1, 4, 3) @ turn
    # triads of bodies and beams turn with the scene, those of point masses stay
    rotating = np.flatnonzero(fb.compile_scene(make(turn)).numbers.rank != 9)
    np.testing.assert_allclose(back[:, 0], flat.state.q.reshape(-1, 4, 3)[:, 0], rtol=0.0, atol=5 * PLACE)
    np.testing.assert_allclose(back[rotating], flat.state.q.reshape(-1, 4, 3)[rotating], rtol=0.0, atol=5 * PLACE)
    np.testing.assert_allclose(turned.series["contact_force"] @ turn, flat.series["contact_force"], rtol=0.0,
                               atol=FORCE * np.max(np.abs(flat.series["contact_force"])))
    np.testing.assert_allclose(turned.series["ang_mom"] @ turn, flat.series["ang_mom"], rtol=0.0,
                               atol=ENERGY * np.max(np.abs(flat.series["ang_mom"])))
    # the largest component of an increment ends an iteration, and components differ
    assert np.max(np.abs(turned.series["iterations"] - flat.series["iterations"])) <= 1


def test_invariants_of_a_free_planar_scene_stay_at_round_off() -> None:
    turn = plane()
    result = fb.simulate(fb.compile_scene(flight(turn, "bspline 3 greville", "spline", "out"), planar=True), t_end=2.0, step=H)
    assert np.ptp(result.series["strain"]) > 0.1 * np.max(result.series["total"])
    for name in ("total", "lin_mom", "ang_mom"):
        assert result.drift(name) < 1e-12, name
    assert result.drift("gap") < 1e-14


@pytest.mark.parametrize("turn", [FLAT, plane()], ids=["xy", "general"])
def test_statics_in_several_load_steps(turn: Array) -> None:
    results = [fb.solve_static(fb.compile_scene(mechanism(turn, sliding=False), planar=planar), at_time=0.1, load_step=0.2)
               for planar in (True, False)]
    flat, space = results
    assert flat.t.size > 3
    np.testing.assert_allclose(flat.series["iterations"], space.series["iterations"], rtol=0.0, atol=0.0 if turn is FLAT else 1.0)
    np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(flat.series["strain"], space.series["strain"], rtol=0.0,
                               atol=1e-11 * np.max(space.series["strain"]))
    assert np.max(np.abs(flat.state.q - fb.compile_scene(mechanism(turn, sliding=False)).q0)) > 0.3


# ----------------------------------------------------------------------------------------------------------- random scenes
NUMBER = st.floats(-1.0, 1.0, allow_subnormal=False)


def positive(draw: Callable[[Any], Any], decades: tuple[float, float]) -> float:
    return float(10.0 ** draw(st.floats(*decades)))


@st.composite
def scenes(draw: Callable[[Any], Any]) -> tuple[fb.Scene, float]:
    """Beams of both strain sets in a chain with a body on arms, a pinned pendulum, sliders, loads in time, in any plane; and a
    step size. Parts of the same kinds, so that few kernels are compiled; numbers, shapes, families and joints vary."""
    normal = np.array([draw(NUMBER) for _ in range(3)])
    turn = plane(tuple(normal)) if np.linalg.norm(normal) > 0.1 else FLAT
    n = turn[:, 2]

    def at(*x: float) -> Array:
        return turn @ np.array((*x, 0.0)[:3])

    def chain_beam(k: int, start: Array, strain: str) -> fb.Beam:
        # the first two have inner nodes
        family = f"lagrange {draw(st.integers(2, 5))}" if k < 2 else draw(st.sampled_from(list(FAMILIES)))
        angle = draw(st.sampled_from([0.0, 0.5 * np.pi, None]))
        section = SECTION
        if angle is None:
            angle, section = 3.0 * draw(NUMBER), ROUND
        common = dict(section=section, elements=draw(st.integers(2, 4)), strain=strain, **FAMILIES[family])
        heading = 0.6 * draw(NUMBER)
        along, side = at(np.cos(heading), np.sin(heading)), at(-np.sin(heading), np.cos(heading))
        length = 1.5 + draw(st.floats(0.0, 1.0))
        d2 = np.cos(angle) * side + np.sin(angle) * n
        shape = draw(st.sampled_from(["straight", "arc", "spline"]))
        if shape == "arc":
            sign = draw(st.sampled_from([-1.0, 1.0]))
            return fb.Beam.arc(f"beam {k}", start, along, sign * side, radius=2.0 * length, angle=0.5, **common)
        if shape == "spline":
            points = [start + x * length * along + y * side for x, y in ((0, 0), (0.3, 0.2 * draw(NUMBER)), (0.7, 0.1), (1, 0.0))]
            return fb.Beam.through_points(f"beam {k}", points, d2=d2, **common)
        return fb.Beam.straight(f"beam {k}", start, start + length * along, d2=d2, **common)

    def tip(beam: fb.Beam) -> Array:
        return beam.reference(beam.length)[0][0]

    first = chain_beam(0, at(0.0, 0.0), "simo_reissner")
    body = fb.RigidBody("body", mass=positive(draw, (-1, 1)), inertia=np.diag([1.0, 1.2, 1.5]) * positive(draw, (-1, 1)),
                        position=tip(first) + at(0.3, 0.2 * draw(NUMBER)), directors=turn.T)
    offset = turn.T @ (tip(first) + at(0.6, 0.1) - body.position)
    hook = body.point(offset * np.array([1.0, 1.0, 0.0]))
    second = chain_beam(1, body.position + turn @ hook.offset, "green_lagrange")
    third = chain_beam(2, tip(second), draw(st.sampled_from(["simo_reissner", "green_lagrange"])))
    bob = fb.PointMass("bob", mass=positive(draw, (-1, 1)), position=tip(third))
    joint = draw(st.sampled_from([fb.RigidConnection, fb.BallJoint]))
    parts: list[Any] = [first, second, third, body, bob, fb.RigidConnection(first.end, body), joint(hook, second.start),
                        joint(second.end, third.start), fb.BallJoint(third.end, bob),
                        draw(st.sampled_from([fb.Pin, fb.Clamp]))(first.start)]
    for k in range(2):
        rail = (first, second, third)[draw(st.integers(0, 2))]
        mass = fb.PointMass(f"mass {k}", mass=positive(draw, (-2, 0.5)))
        parts += [mass, fb.Slider(f"slider {k}", mass, rail, at=rail.length * draw(st.floats(0.3, 0.7)), rate=draw(NUMBER),
                                  curve=draw(st.sampled_from(["own", "c1"])))]
    factor = draw(st.floats(1.0, 10.0))
    parts.append(fb.Load("push", body, force=at(3.0 * draw(NUMBER), 3.0), moment=draw(NUMBER) * n,
                         time=lambda t: np.cos(factor * t)))
    return fb.Scene(*parts, gravity=at(draw(NUMBER), -9.81)), positive(draw, (-2.5, -1.8))


def check_random(case: tuple[fb.Scene, float]) -> None:
    """In units of round-off: positions eps L, velocities eps L/h, forces eps L M/h^2, energies eps E. Measured over 60 scenes: at
    most 10, 120, 0.4 and 300."""
    scene, step = case
    flat, space = both(lambda: scene, step=step, t_end=20 * step, observe=("energy", "slider"))
    eps, length = np.finfo(float).eps, float(np.max(np.ptp(space.phi.reshape(-1, 3), axis=0)))
    mass = sum(part.mass for part in (*scene.bodies, *scene.masses)) + sum(b.section.inertia[0] * b.length for b in scene.beams)
    assert np.max(np.abs(flat.state.q - space.state.q)) < 100 * eps * length
    assert np.max(np.abs(flat.state.v - space.state.v)) < 1000 * eps * length / step
    assert np.max(np.abs(flat.series["s_slide"] - space.series["s_slide"])) < 100 * eps * length
    difference = np.abs(flat.series["contact_force"] - space.series["contact_force"])
    assert np.max(difference) < 10 * eps * length * mass / step**2
    energy = max(float(np.max(np.abs(space.series[name]))) for name in ("kinetic", "strain", "potential"))
    for name in ("kinetic", "strain", "total"):
        assert np.max(np.abs(flat.series[name] - space.series[name])) < 2000 * eps * energy, name
    assert np.max(np.abs(flat.series["iterations"] - space.series["iterations"])) <= 1
    assert flat.info["fallbacks"] == space.info["fallbacks"] == 0


@given(scenes())
@settings(max_examples=6, derandomize=True, deadline=None)
def test_random_mechanisms(case: tuple[fb.Scene, float]) -> None:
    check_random(case)


@pytest.mark.slow
@given(scenes())
@settings(max_examples=40, derandomize=True, deadline=None)
def test_many_random_mechanisms(case: tuple[fb.Scene, float]) -> None:
    check_random(case)
