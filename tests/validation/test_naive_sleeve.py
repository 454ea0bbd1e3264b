"""The twin of the step with sleeves: what it conserves, that it goes there and back, and exact motions."""
from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_sleeve import Sleeve, SleeveTwin, State, start

Array = np.ndarray
SOFT = fb.Section(EA=2e3, GA2=1e3, GA3=1.2e3, GJ=80.0, EI2=100.0, EI3=120.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
H, STEPS = 0.04, 5
TUBE = fb.Section(EA=3e3, GA2=2e3, GA3=2e3, GJ=300.0, EI2=200.0, EI3=200.0, rhoA=1.5, rhoI2=0.1, rhoI3=0.1)


def twin_of(scene: fb.Scene, *sleeves: Sleeve) -> tuple[SleeveTwin, State]:
    """Twin and consistent start of a scene."""
    model = fb.compile_scene(scene)
    twin = SleeveTwin(scene, model, *sleeves)
    return twin, twin.consistent(start(twin, model))


# ------------------------------------------------------------------------------------------------------------- invariants
def rod_and_body(keyed: bool, curve: str = "c1") -> tuple[SleeveTwin, State]:
    """A flying rod bends, twists and runs through a sleeve on a tumbling body."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SOFT, elements=3, degree=2)
    body = fb.RigidBody("body", mass=0.8, inertia=[[0.2, 0.01, 0], [0.01, 0.3, 0.02], [0, 0.02, 0.25]], position=(0.8, 0, 0),
                        velocity=(2.5, 0.3, -0.2), spin=(1.5, 0.4, -0.6))
    bend = fb.InitialVelocity(rod, velocity=lambda s: np.stack((0.1 + 0 * s, np.sin(s), np.cos(2 * s)), axis=1),
                              spin=lambda s: np.stack((1.0 * s, 2 * np.sin(2 * s), np.cos(s)), axis=1))
    return twin_of(fb.Scene(rod, body, bend), Sleeve(body, rod, 0.8, keyed=keyed, curve=curve))


def telescope(keyed: bool) -> tuple[SleeveTwin, State]:
    """A rod in the end of a tube, both flexible and free; the triad of the tube is a quarter turn ahead."""
    tube = fb.Beam.straight("tube", (-2, 0, 0), (0.7, 0, 0), section=TUBE, elements=2, degree=2, d2=(0, 0, 1))
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SOFT, elements=3, degree=2, d2=(0, 1, 0))
    turn = rod.reference(np.array([0.7]))[1][0] @ tube.reference(np.array([2.7]))[1][0].T
    pull = fb.InitialVelocity(rod, velocity=lambda s: np.stack((-2.5 + 0 * s, 0 * s, 0 * s), axis=1))
    scene = fb.Scene(tube, rod, pull, fb.RigidMotion(spin=(0.5, 0.3, 0.9), velocity=(0.1, 0.2, 0.3)))
    return twin_of(scene, Sleeve(tube.end, rod, 0.7, keyed=keyed, turn=turn))


def held(keyed: bool) -> tuple[SleeveTwin, State]:
    """A rod falls and slides through a sleeve that is fixed in space."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SOFT, elements=3, degree=2)
    body = fb.RigidBody("sleeve", mass=1.0, inertia=(1, 1, 1), position=(1.7, 0, 0))
    push = fb.RigidMotion(rod, velocity=(-2.0, 0, 0), spin=(0.7, 0, 0))
    return twin_of(fb.Scene(rod, body, push, fb.Clamp(body), gravity=(0.0, 1.0, -2.0)), Sleeve(body, rod, 1.7, keyed=keyed))


SCENES = {"body": rod_and_body, "telescope": telescope, "held": held}


@pytest.mark.parametrize("keyed", [True, False], ids=["keyed", "twist free"])
@pytest.mark.parametrize("name", SCENES)
def test_energy_momenta_and_conditions_stay_and_the_way_back_is_the_same(name: str, keyed: bool) -> None:
    twin, first = SCENES[name](keyed)
    states = twin.run(first, H, STEPS)
    start_energy = twin.energy(first)
    assert np.floor(states[-1].s[0]) == np.floor(first.s[0]) + 1.0  # over the end of an element of 1 m
    assert np.abs(states[-1].m).min() > 1e-4
    assert max(abs(twin.energy(x) - start_energy) for x in states) <= 1e-12 * twin.kinetic(first)
    assert max(np.abs(twin.conditions(x.q, x.s)).max() for x in states) <= 1e-13
    if name != "held":
        drift = max(np.abs(twin.momenta(x) - twin.momenta(first)).max() for x in states)
        assert drift <= 1e-12 * np.abs(twin.momenta(first)).max()
    back = twin.run(states[-1].reversed(), H, STEPS)[-1]
    assert np.abs(back.q - first.q).max() <= 1e-12
    assert np.abs(back.s - first.s).max() <= 1e-12


# ---------------------------------------------------------------------------------------------------------- exact motions
def rigid_rod(begin: float, length: float, mass: float, inertia: float) -> tuple[fb.Beam, fb.RigidConnection]:
    """A straight rod along x of a given moment of inertia about its centre, made rigid by a connection of its two nodes."""
    rotary = (inertia - mass * length**2 / 12.0) / length
    section = fb.Section(EA=1.0, GA2=1.0, GA3=1.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=mass / length, rhoI2=rotary, rhoI3=1e-3)
    rod = fb.Beam.straight("rod", (begin, 0, 0), (begin + length, 0, 0), section=section, elements=1, degree=1, d2=(0, 1, 0))
    return rod, fb.RigidConnection(rod.start, rod.end)


def pivoted(keyed: bool) -> tuple[SleeveTwin, State]:
    """A prismatic rotor: a body of 1 kg slides outwards on a rod that turns about its pinned end."""
    rod, stays = rigid_rod(0.0, 1.5, 0.6, 0.5 - 0.6 * 0.75**2)
    body = fb.RigidBody("body", mass=1.0, inertia=(0.2, 0.3, 0.5), position=(0.1, 0, 0))
    scene = fb.Scene(rod, body, stays, fb.Pin(rod.start), fb.RigidMotion(spin=(0, 0, 2.0)))
    return twin_of(scene, Sleeve(body, rod, 0.1, keyed=keyed))


def turning(keyed: bool) -> tuple[SleeveTwin, State]:
    """A rod of 1 kg and J = 1/3 slides out of a sleeve with J = 1/2 that turns freely about its centre."""
    rod, stays = rigid_rod(-0.85, 1.9, 1.0, 1.0 / 3.0)
    body = fb.RigidBody("sleeve", mass=1.0, inertia=(0.5, 0.5, 0.5), position=(0, 0, 0))
    scene = fb.Scene(rod, body, stays, fb.Pin(body), fb.RigidMotion(spin=(0, 0, 2.0)))
    return twin_of(scene, Sleeve(body, rod, 0.85, keyed=keyed))


def moved(twin: SleeveTwin, first: State, t_end: float, steps: int) -> tuple[float, float]:
    """How far s has moved at t_end, without sign, and how fast it moves there."""
    last = twin.run(first, t_end / steps, steps)[-1]
    return abs(last.s[0] - first.s[0]), abs(twin.sliding_rates(last)[0])


@pytest.mark.parametrize(("scene", "keyed", "t_end", "rate"), [
    (pivoted, True, 1.17290580857242384, 0.880726972449464613), (turning, False, 1.17800927890489, 0.864478499977343)],
    ids=["pivoted rod", "turning sleeve"])
def test_rigid_rotors_meet_their_exact_motion(scene: Callable[..., Any], keyed: bool, t_end: float, rate: float) -> None:
    twin, first = scene(keyed)
    runs = np.array([moved(twin, first, t_end, n) for n in (10, 20, 40)]) - (0.4, rate)
    assert runs[0] / runs[1] == pytest.approx(4.0, rel=0.03)
    assert runs[1] / runs[2] == pytest.approx(4.0, rel=0.03)
    once = (4.0 * runs[1:] - runs[:-1]) / 3.0
    limit = (16.0 * once[1] - once[0]) / 15.0  # the errors of h^2 and h^4 are gone
    assert np.abs(limit).max() <= 1e-7
