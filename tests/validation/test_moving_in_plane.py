"""Moving meshes of scenes that stay in a plane, with 3 unknowns a node: as in space, in any plane (theory.md 5.12, 10)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import fastbeam as fb

Array = np.ndarray
# another inertia and stiffness about each axis of the section
SECTION = fb.Section(EA=4e4, GA2=2e4, GA3=1e4, GJ=3.0, EI2=5.0, EI3=8.0, rhoA=1.0, rhoI2=2e-3, rhoI3=3e-3)
TURNS = {"xy": np.eye(3), "xz": np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]),
         "oblique": Rotation.from_rotvec((0.4, -0.9, 1.3)).as_matrix()}
QUANTITIES = ("s", "position", "force")


def riders(turn: Array, count: int = 1, support: type = fb.Pin, rise: float = 0.4, **options: Any) -> fb.Scene:
    """Masses that slide along a cable between two supports, pushed along it."""
    def at(*x: float) -> tuple[float, ...]:
        return tuple(turn @ x)

    cable = fb.Beam.straight("cable", at(0, 0, 0), at(3, rise, 0), d2=at(0, 0, 1), section=SECTION, elements=10)
    parts: list[Any] = [cable, support(cable.start), support(cable.end)]
    along = np.array((3, rise, 0)) / cable.length
    for k in range(count):
        s = 0.35 * cable.length * (k + 1)
        mass = fb.PointMass(f"mass {k}", mass=0.5 + k, position=at(*(s * along)), velocity=at(*((0.8 - k) * along)))
        parts += [mass, fb.Slider(f"run {k}", mass, cable, at=s, **options)]
    return fb.with_moving_meshes(fb.Scene(*parts, gravity=at(0, -9.81, 0), project_velocities=True))


def telescope(turn: Array) -> fb.Scene:
    """A rod that slides out of a body it turns with, and bends."""
    def at(*x: float) -> tuple[float, ...]:
        return tuple(turn @ x)

    rod = fb.Beam.straight("rod", at(0, 0, 0), at(2, 0, 0), d2=at(0, 0, 1), section=SECTION, elements=8)
    body = fb.RigidBody("body", mass=3.0, inertia=np.diag((0.3, 0.3, 0.4)), position=at(0.7, 0, 0), directors=turn.T,
                        spin=at(0, 0, 1.5))
    return fb.with_moving_meshes(fb.Scene(rod, body, fb.Sleeve("sleeve", body, rod, at=0.7, length=0.0),
                                          fb.RigidMotion(spin=at(0, 0, 1.5)), project_velocities=True))


def in_both(scene: fb.Scene) -> tuple[fb.Model, fb.Model]:
    flat, space = fb.compile_scene(scene, planar=True), fb.compile_scene(scene, planar=False)
    assert flat.plane is not None and space.plane is None
    return flat, space


def compare(one: fb.Result, other: fb.Result, tolerance: float) -> None:
    np.testing.assert_allclose(one.phi, other.phi, rtol=0, atol=tolerance)
    for name in one.names["sliders"]:
        for key in QUANTITIES:
            size = max(1.0, float(np.max(np.abs(other.slider(name)[key]))))
            np.testing.assert_allclose(one.slider(name)[key], other.slider(name)[key], rtol=0, atol=1e3 * tolerance * size)


@pytest.mark.parametrize("plane", TURNS)
@pytest.mark.parametrize("order", [2, 4])
def test_a_run_is_that_in_space(plane: str, order: int) -> None:
    runs = [fb.simulate(model, t_end=0.3, step=5e-3, order=order, progress=False) for model in in_both(riders(TURNS[plane], 2))]
    compare(*runs, 1e-10)
    assert np.ptp(runs[0].slider("run 0")["s"]) > 0.05
    assert max(run.drift("total") for run in runs) < 1e-12
    # tables of both say the same about energies and momenta
    for key in ("kinetic", "strain", "gravity", "lin_mom", "ang_mom"):
        np.testing.assert_allclose(runs[0].series[key], runs[1].series[key], rtol=0, atol=1e-9)


@pytest.mark.parametrize("options", [{"friction": 0.2}, {"friction": fb.Friction(viscous=0.3)},
                                     {"stops": fb.Stops(1.0, 1.2)}], ids=["coulomb", "viscous", "stop"])
def test_forces_along_the_beam(options: dict[str, Any]) -> None:
    runs = [fb.simulate(model, t_end=0.4, step=5e-3, progress=False) for model in in_both(riders(TURNS["oblique"], 1, **options))]
    compare(*runs, 1e-9)
    assert max(run.drift("balance") for run in runs) < 1e-12


@pytest.mark.parametrize("plane", TURNS)
def test_sleeves(plane: str) -> None:
    runs = [fb.simulate(model, t_end=0.4, step=5e-3, progress=False) for model in in_both(telescope(TURNS[plane]))]
    compare(*runs, 1e-10)
    assert np.ptp(runs[0].slider("sleeve")["s"]) > 0.05
    assert max(run.drift(x) for run in runs for x in ("total", "lin_mom", "ang_mom")) < 1e-12


def test_a_run_goes_on_bit_for_bit() -> None:
    model, _ = in_both(riders(TURNS["oblique"]))
    whole = fb.simulate(model, t_end=0.2, step=5e-3, progress=False)
    half = fb.simulate(model, t_end=0.1, step=5e-3, progress=False)
    rest = fb.simulate(model, start=half.checkpoint, t_end=0.2, step=5e-3, progress=False)
    assert rest.state.q.tobytes() == whole.state.q.tobytes() and rest.state.history.tobytes() == whole.state.history.tobytes()


@pytest.mark.parametrize("plane", TURNS)
def test_equilibria_and_vibrations(plane: str) -> None:
    found = []
    for model in in_both(riders(TURNS[plane], 1, fb.Clamp, 0.0)):
        rest = fb.solve_static(model)
        modes = fb.modes(model, state=rest.state, n=8, planar=True) if model.plane else fb.modes(model, state=rest.state, n=8)
        found.append((rest, modes.frequencies))
    (flat, few), (space, many) = found
    assert flat.slider("run 0")["s"][-1] == pytest.approx(space.slider("run 0")["s"][-1], abs=1e-9)
    # those out of the plane are missing
    for w in few[:4]:
        assert np.min(np.abs(many / w - 1.0)) < 1e-6


def test_friction_at_rest() -> None:
    for model in in_both(riders(TURNS["oblique"], 1, fb.Clamp, friction=0.5)):
        assert fb.solve_static(model).info["friction"]["run 0"]["sticks"]
