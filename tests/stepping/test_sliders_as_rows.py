"""Sliders as rows of the block matrix against the dense border around SuperLU: the same increments, in space and in a plane."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
STEP = 2e-3
LENGTH, ELEMENTS = 2.0, 8
SIZE = LENGTH / ELEMENTS  # of an element
STEPS = 9  # three points of a body lock the beam of degree 1 when they meet the end of its element
SECTION = dict(EA=2e5, GA2=6.4e4, GA3=6.4e4, GJ=0.7, EI2=6.7, EI3=1.67, rhoA=0.2, rhoI2=6.7e-6, rhoI3=1.7e-6)


def masses(at: tuple[float, ...] = (0.87,), mass: float = 0.1, rate: float | None = 0.5, degree: int = 2, curve: str = "c1",
           holds: str = "both", twice: bool = False, stiff: float = 1.0, soft: float = 1.0,
           interpolation: str = "lagrange") -> fb.Scene:
    """Masses on a straight beam."""
    numbers = {name: value * (stiff if "A" in name[:2] and name[0] != "r" else soft if name[0] in "GE" else 1.0)
               for name, value in SECTION.items()}
    beam = fb.Beam.straight("b", (0, 0, 0), (LENGTH, 0, 0), section=fb.Section(**numbers), elements=ELEMENTS, degree=degree,
                            interpolation=interpolation)
    parts: list[Any] = [beam]
    parts += {"both": [fb.Clamp(beam.start), fb.Clamp(beam.end)], "start": [fb.Clamp(beam.start)], "free": [],
              "pins": [fb.Pin(beam.start), fb.Pin(beam.end)]}[holds]
    for i, s in enumerate(at):
        bead = fb.PointMass(f"m{i}", mass=mass)
        parts += [bead, *(fb.Slider(f"s{i}{k}", bead, beam, at=s, rate=rate, curve=curve) for k in range(1 + twice))]
    return fb.Scene(*parts, gravity=(0, -9.81, 0), project_velocities=True)


def body(points: tuple[float, ...], degree: int = 2, curve: str = "own") -> fb.Scene:
    """A body with several sliding points."""
    beam = fb.Beam.straight("b", (0, 0, 0), (LENGTH, 0, 0), section=fb.Section(**SECTION), elements=ELEMENTS, degree=degree)
    block = fb.RigidBody("g", mass=0.4, inertia=np.eye(3) * 0.004, position=(0.7, -0.1, 0.0))
    sliders = [fb.Slider(f"s{i}", block.point((x, 0.1, 0)), beam, at=0.7 + x, curve=curve) for i, x in enumerate(points)]
    return fb.Scene(beam, fb.Clamp(beam.start), block, *sliders, gravity=(0, -9.81, 0), project_velocities=True)


def on_beam(at: float = 0.87, degree: int = 2, curve: str = "own", joint: str = "", middle: bool = False) -> fb.Scene:
    """A beam whose end, a body at its end or inner node slides on another one, which itself hangs on a body by its start."""
    section = fb.Section(**SECTION)
    rail = fb.Beam.straight("rail", (0, 0, 0), (LENGTH, 0, 0), section=section, elements=ELEMENTS, degree=degree)
    bar = fb.Beam.straight("bar", (at, 0, 0), (at + 0.5, -0.87, 0), section=section, elements=4, degree=degree)
    if middle:
        bar = fb.Beam.straight("bar", (at - 0.1, 0.1, 0), (at + 0.1, -0.1, 0), section=section, elements=1, degree=2)
    point = bar.node(1) if middle else bar.start
    parts: list[Any] = [rail, bar, fb.Pin(rail.end), fb.Slider("s", point, rail, at=at, curve=curve)]
    if joint:
        hook = fb.RigidBody("hook", mass=0.4, inertia=np.eye(3) * 0.004, position=(-0.2, 0.1, 0.0))
        tie = fb.RigidConnection if joint == "rigid" else fb.BallJoint
        parts += [hook, tie(hook.point((0.2, -0.1, 0)), rail.start)]
    else:
        parts.append(fb.Pin(rail.start))
    if joint == "arms":
        ring = fb.RigidBody("ring", mass=0.1, inertia=np.eye(3) * 0.001, position=(at, -0.05, 0.0))
        parts[3] = fb.Slider("s", ring.point((0, 0.05, 0)), rail, at=at, curve=curve)
        parts += [ring, fb.BallJoint(ring.point((0, 0.05, 0)), bar.start)]
    return fb.Scene(*parts, gravity=(0, -9.81, 0), project_velocities=True)


def angle(at: float) -> fb.Scene:
    """Beams that are connected where a mass slides: every node there is tied or has ties."""
    section = fb.Section(**SECTION)
    one = fb.Beam.straight("one", (0, 0, 0), (1, 0, 0), section=section, elements=2, degree=3)
    two = fb.Beam.straight("two", (1, 0, 0), (1, 1, 0), section=section, elements=1, degree=3)
    bead = fb.PointMass("m", mass=0.3)
    return fb.Scene(one, two, fb.Clamp(one.start), fb.RigidConnection(two.start, one.end), bead,
                    fb.Slider("s", bead, two, at=at, rate=0.1, curve="own"), gravity=(0, -9.81, 0), project_velocities=True)


def mast(cables: int = 6, turn: float = 0.3, **family: Any) -> fb.Scene:
    """Two bodies joined by cables on a circle, with a ring on each."""
    low = fb.RigidBody("low", mass=2.0, inertia=np.eye(3), position=(0, 0, 0))
    high = fb.RigidBody("high", mass=1.0, inertia=np.eye(3), position=(0, 0, LENGTH))
    parts: list[Any] = [low, high]
    for k in range(cables):
        x, y = np.cos(2.0 * np.pi * k / cables + turn), np.sin(2.0 * np.pi * k / cables + turn)
        cable = fb.Beam.straight(f"c{k}", (x, y, 0), (x, y, LENGTH), section=fb.Section(**SECTION), elements=4, **family)
        ring = fb.PointMass(f"r{k}", mass=0.1)
        parts += [cable, ring, fb.RigidConnection(low, cable.start), fb.RigidConnection(high, cable.end),
                  fb.Slider(f"s{k}", ring, cable, at=0.6 + 0.05 * k, rate=0.5)]
    return fb.Scene(*parts, gravity=(0, -9.81, 0), project_velocities=True)


MASTS = {"mast": dict(degree=3), "mast of splines": dict(degree=4, interpolation="bspline")}
CASES = {
    "cubic, own curve": lambda: masses(degree=3, curve="own"),
    "cubic, c1": lambda: masses(degree=3),
    "quadratic, own curve": lambda: masses(curve="own"),
    "linear": lambda: masses(degree=1, curve="own"),
    "splines": lambda: masses(degree=3, interpolation="bspline"),
    "at an element end": lambda: masses(at=(0.75,), rate=0.0),
    "at a clamp": lambda: masses(at=(0.0,), rate=0.0, curve="own"),
    "at a free end": lambda: masses(at=(LENGTH,), rate=0.0, holds="start"),
    "one element a step": lambda: masses(at=(0.4,), rate=0.9 * SIZE / STEP),
    "five elements a step": lambda: masses(at=(0.1,), rate=5.0 * SIZE / STEP),
    "light": lambda: masses(mass=4e-10),
    "heavy": lambda: masses(mass=4e8),
    "heavy, linear": lambda: masses(mass=4e8, degree=1, curve="own"),
    "free flight": lambda: masses(holds="free"),
    "many in one element": lambda: masses(at=tuple(0.76 + 0.03 * k for k in range(7)), degree=3, curve="own"),
    "many in one element, c1": lambda: masses(at=tuple(0.76 + 0.03 * k for k in range(5)), degree=2),
    "two cross": lambda: masses(at=(0.8, 0.8)),
    "two points of a body": lambda: body((0.0, 0.3)),
    "end of a beam": on_beam,
    "end of a beam on an element end": lambda: on_beam(0.75, 1),
    "end of a beam, c1": lambda: on_beam(curve="c1"),
    "inner node of a beam": lambda: on_beam(middle=True),
    "rail on a body": lambda: on_beam(0.1, 3, joint="rigid"),
    "rail on a body by a ball": lambda: on_beam(0.1, 2, joint="ball"),
    "ring on arms": lambda: on_beam(0.4, joint="arms"),
    "at a corner": lambda: angle(0.2),
}
DEPENDENT = {
    "one mass twice": lambda: masses(twice=True),
    "heavy mass twice": lambda: masses(twice=True, mass=1e4),
    "three points of a body": lambda: body((0.0, 0.02, 0.05), 1),
}
LOOSE = {"light": 1e-7, "heavy": 1e-7, "heavy, linear": 1e-7}


def prepared(scene: fb.Scene, planar: bool, augmentation: float) -> tuple[Stepper, Stepper]:
    """With rows, and with the dense border around SuperLU."""
    model = fb.compile_scene(scene, planar=planar)
    assert model.uneliminated is not None
    rows = Stepper(model, np.ones(1), augmentation=augmentation)
    assert rows.rows is not None
    return rows, Stepper(model.uneliminated(planar=planar), np.ones(1), backend="superlu", augmentation=augmentation)


def iterate(stepper: Stepper, scale: float) -> tuple[Array, ...]:
    """Unknowns after the second Newton iteration of a step with random forces."""
    rng = np.random.default_rng(4)
    stepper._augment(STEP)
    stepper.parts.start(STEP)
    state, work = stepper.core_state, stepper.work
    state.force[:] = scale * rng.standard_normal(state.force.size)
    for _ in range(2):
        stepper.parts.assemble(STEP)
        if stepper.rows is None:
            assert stepper.parts.solve()
        else:
            solve_with_rows(stepper)
        assert stepper.parts.update() >= 0.0
    return work.dphi.copy(), work.theta.copy(), work.s_end - state.s, state.force.copy()


def solve_with_rows(stepper: Stepper) -> None:
    """Of an assembled iteration; with more room where there is too little."""
    kernels.fill_right(*stepper.records)
    solved = kernels.solve_right(*stepper.records)
    while stepper.rows.factors.failed[0]:
        first = stepper.contact.augmented[2]
        stepper._enlarge()
        stepper.contact.augmented[2] = first
        stepper.parts.assemble(STEP)
        kernels.fill_right(*stepper.records)
        solved = kernels.solve_right(*stepper.records)
    assert solved and stepper.rows.factors.failed[1] == -1, stepper.rows.factors.failed


@pytest.mark.parametrize("planar", [False, True], ids=["space", "plane"])
@pytest.mark.parametrize("name", CASES)
def test_increments_are_those_of_the_dense_border(name: str, planar: bool) -> None:
    compare(CASES[name](), planar, LOOSE.get(name, 1e-9))


@pytest.mark.parametrize("name", MASTS)
def test_increments_between_bodies_are_those_of_the_dense_border(name: str) -> None:
    compare(mast(**MASTS[name]), False, 1e-9)


def compare(scene: fb.Scene, planar: bool, tolerance: float) -> None:
    """Increments with rows and with the dense border."""
    rows, border = prepared(scene, planar, 0.0)
    found, expected = iterate(rows, 0.3), iterate(border, 0.3)
    for kind, a, b in zip(("position", "turn", "slide", "force"), found, expected):
        size = max(np.max(np.abs(b)), 1e-6 if kind != "force" else 0.1)
        assert np.max(np.abs(a - b)) < tolerance * size, (kind, np.max(np.abs(a - b)), size)


@pytest.mark.parametrize("planar", [False, True], ids=["space", "plane"])
@pytest.mark.parametrize("name", DEPENDENT)
def test_dependent_sliders_move_as_with_the_dense_border(name: str, planar: bool) -> None:
    rows, border = prepared(DEPENDENT[name](), planar, 1e7)
    for stepper in (rows, border):
        outcome = stepper.advance(0.0, STEP, STEPS)
        assert (outcome.status, outcome.steps, stepper.linear.fallbacks) == (kernels.OK, STEPS, 0)
    a, b = rows.core_state, border.core_state
    assert np.max(np.abs(a.q - b.q)) < 1e-9
    assert np.max(np.abs(a.s - b.s)) < 1e-9


@pytest.mark.parametrize("name", MASTS)
def test_products_between_parts_that_many_beams_join_are_few(name: str) -> None:
    """In the reverse of a breadth-first search there are 2 times as many, 90 times with splines."""
    stepper = Stepper(fb.compile_scene(mast(24, **MASTS[name]), planar=False), np.ones(1))
    assert stepper.advance(0.0, STEP, 1).status == 0
    starts = stepper.rows.order.start, stepper.model.pattern.plan.start
    with_rings, without = (int(np.sum(np.diff(start)**2)) for start in starts)
    # the rows of all rings meet at the body that is eliminated first
    assert with_rings < 2 * without + 2 * 24**3


def test_a_long_thin_beam() -> None:
    rows, border = prepared(masses(degree=3, stiff=0.05, soft=1e-3 * 1e-4), False, 0.0)
    found, expected = iterate(rows, 0.3), iterate(border, 0.3)
    assert np.max(np.abs(found[0] - expected[0])) < 1e-5 * np.max(np.abs(expected[0]))


def test_dependent_sliders_are_named_without_the_augmented_lagrangian() -> None:
    with pytest.raises(fb.ConvergenceError, match="s0[01]"):
        fb.simulate(fb.compile_scene(masses(twice=True)), t_end=STEP, step=STEP, solver=fb.Solver(augmentation=0.0),
                    progress=False)


def test_the_next_run_of_a_model_begins_with_the_capacity_that_the_last_one_came_to_need() -> None:
    model = fb.compile_scene(CASES["many in one element"](), planar=False)
    capacities, states = [], []
    for _ in range(2):
        stepper = Stepper(model, np.ones(1))
        capacities.append(stepper.capacity)
        assert stepper.advance(0.0, STEP, STEPS).status == 0
        capacities.append(stepper.capacity)
        states.append(stepper.core_state.q.copy())
    assert capacities[0] != capacities[1] == capacities[2] == capacities[3]
    np.testing.assert_array_equal(*states)
