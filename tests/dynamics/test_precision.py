"""Round-off of what users read: far from the origin, in fast flight, over many steps."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bead, bent, free_beam, straight  # noqa: E402

ALL = ("energy", "momentum", "slider", "inner")


def flying(offset: float, speed: float) -> fb.Scene:
    """The bead on its beam, away from the origin and on the move."""
    rail = straight("rail", (0.8 * offset, -0.6 * offset, 0.0), (0.8 * offset + 3.0, -0.6 * offset, 0.0))
    mass = fb.PointMass("bead", mass=0.5)
    return fb.Scene(rail, mass, fb.Slider("run", mass, rail, at=1.0, rate=0.5), bent(rail),
                    fb.RigidMotion(velocity=(0.6 * speed, 0.0, 0.8 * speed)), project_velocities=True)


def test_momentum_does_not_march() -> None:
    # 2/h is rounded for this h; v <- 2 dq/h - v drifted by 1.4e-13 here
    run = fb.simulate(fb.compile_scene(free_beam()), t_end=8.0, step=2e-3, output=fb.Output(snapshots=0))
    assert run.info["steps"] == 4000
    assert max(run.drift("lin_mom"), run.drift("ang_mom")) <= 2e-14


@pytest.mark.parametrize(("offset", "speed"), [(1e6, 0.0), (0.0, 1e4), (1e6, 1e4)])
def test_no_more_digits_are_lost_than_coordinates_have(offset: float, speed: float) -> None:
    def run(offset: float, speed: float) -> fb.Result:
        return fb.simulate(fb.compile_scene(flying(offset, speed)), t_end=0.2, step=2e-3, every=1, observe=ALL)

    # round-off of one run is a matter of luck: the usual error is the largest of three
    exact, near, far = run(0.0, 0.0), [run(5.0, 1.0), run(3.0, 2.0), run(6.0, 0.5)], run(offset, speed)
    reach = offset + 0.2 * speed
    for name in ("s_slide", "contact_force", "strain", "inner_energy", "inner_spin"):
        error, *errors = (float(np.max(np.abs(x.series[name] - exact.series[name]))) for x in (far, *near))
        usual = max(errors)
        assert 0.0 < usual and error <= 10.0 * reach / 3.0 * usual, name
    assert np.max(far.series["gap"]) <= 10.0 * 2.3e-16 * reach
    if speed:
        assert far.drift("total") <= 1e-12
    assert far.drift("lin_mom") <= 1e-14


def test_inner_energy_and_spin_are_those_of_the_motion_about_the_mass_centre() -> None:
    rest = fb.simulate(fb.compile_scene(free_beam()), t_end=0.2, step=0.01, every=1, observe=ALL)
    scene = free_beam()
    moved = fb.simulate(fb.compile_scene(scene.add(fb.RigidMotion(velocity=(3.0, -2.0, 1.0)))), t_end=0.2, step=0.01, every=1,
                        observe=ALL)
    for run in (rest, moved):
        p, l, x = run.series["lin_mom"], run.series["ang_mom"], run.series["center"]
        mass = 3.0  # 3 m of 1 kg/m
        common = 0.5 * np.sum(p * p, axis=1) / mass
        np.testing.assert_allclose(run.series["inner_energy"], run.series["total"] - common, atol=1e-12)
        np.testing.assert_allclose(run.series["inner_spin"], l - np.cross(x, p), atol=1e-12)
        np.testing.assert_allclose(np.diff(x, axis=0), 0.01 * p[1:] / mass, atol=1e-13)
    np.testing.assert_allclose(moved.series["inner_energy"], rest.series["inner_energy"], rtol=1e-12)
    np.testing.assert_allclose(moved.series["inner_spin"], rest.series["inner_spin"], atol=1e-12)


def test_inner_energy_is_conserved_in_free_fall() -> None:
    scene = bead()
    falling = fb.Scene(*scene.beams, *scene.masses, *scene.sliders, bent(scene.beams[0]), gravity=(0, 0, -9.81))
    run = fb.simulate(fb.compile_scene(falling), t_end=0.5, step=0.01, observe=ALL)
    assert run.series["center"][-1, 2] < -1.0
    assert max(run.drift("inner_energy"), run.drift("inner_spin"), run.drift("total")) <= 1e-11
