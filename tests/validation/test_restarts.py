"""States that go on in another scene of the same parts: what its joints do not allow is measured, refused or mended, and momenta
and energy are accounted for."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from random_restarts import BAR, restart  # noqa: E402

H = 0.01


def bodies(joined: bool, at: float = 1.0, planar: bool | str = "auto") -> fb.Model:
    """Two bodies that fly, free or welded."""
    a = fb.RigidBody("a", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0), velocity=(0, 0, 0) if joined else (0.01, 0.3, 0))
    b = fb.RigidBody("b", mass=2.0, inertia=(0.2, 0.2, 0.2), position=(at, 0, 0))
    return fb.compile_scene(fb.Scene(a, b, *([fb.RigidConnection(a, b, name="dock")] if joined else [])), planar=planar)


@pytest.mark.parametrize("planar", ["auto", False])
def test_two_bodies_dock_in_an_inelastic_impact(planar: bool | str) -> None:
    """Perfectly inelastic, in closed form: both momenta stay, and the loss is the energy less that of the common motion."""
    flight = fb.simulate(bodies(False, planar=planar), t_end=0.1, step=H, progress=False)
    # the scene to dock in has its parts where the flight has left them: a at (0.001, 0.03)
    a = fb.RigidBody("a", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.001, 0.03, 0))
    b = fb.RigidBody("b", mass=2.0, inertia=(0.2, 0.2, 0.2), position=(1, 0, 0))
    model = fb.compile_scene(fb.Scene(a, b, fb.RigidConnection(a, b, name="dock")), planar=planar)
    start = flight.state_for(model)
    with pytest.raises(fb.SceneError, match=r"'[ab]' \(dock\) is 0.3\d* m/s off .*mend=True\): the parts then meet in an "
                                            "inelastic impact"):
        fb.simulate(model, start=start, t_end=0.1, step=H)
    run = fb.simulate(model, start=fb.Start(start, mend=True), t_end=0.1, step=H, progress=False)
    # about the common centre: reduced mass 2/3, spin of the whole from the moment of the relative velocity
    r, v = np.array([1.0 - 0.001, -0.03]), np.array([-0.01, -0.3])
    inertia = 0.3 + 2.0 / 3.0 * r @ r
    spin = 2.0 / 3.0 * (r[0] * v[1] - r[1] * v[0]) / inertia
    after = 0.5 * 3.0 * ((0.01 / 3.0)**2 + 0.1**2) + 0.5 * inertia * spin**2
    before = 0.5 * (0.01**2 + 0.3**2)
    np.testing.assert_allclose(run.series["lin_mom"] - (0.01, 0.3, 0.0), 0.0, atol=1e-15)
    np.testing.assert_allclose(run.series["ang_mom"] - flight.series["ang_mom"][-1], 0.0, atol=1e-15)
    np.testing.assert_allclose(run.series["kinetic"], after, rtol=1e-13)
    books = run.balance()
    np.testing.assert_allclose(books["impact at the start"], before - after, rtol=1e-12)
    np.testing.assert_allclose(books["sum"], before, rtol=1e-13)
    (event,) = [e for e in run.events if e["kind"] == "mended"]
    assert f"the kinetic energy changes from {before:.6g} to {after:.6g} J" in event["text"]


def test_books_of_the_start_are_kept_in_files(tmp_path: Path) -> None:
    flight = fb.simulate(bodies(False), t_end=H, step=H, progress=False)
    model = bodies(True)
    start = flight.state_for(model)
    start.q[:] = model.q0
    run = fb.simulate(model, start=fb.Start(start, mend=True), t_end=H, step=H, progress=False, output=tmp_path / "run.h5")
    again = fb.load_result(tmp_path / "run.h5").balance()
    assert run.balance()["impact at the start"][0] > 0.005
    for name, x in run.balance().items():
        np.testing.assert_array_equal(again[name], x)
    assert "impact at the start [J]" in run.table()


def test_a_large_gap_is_refused_with_the_joint_and_its_size() -> None:
    flight = fb.simulate(bodies(False), t_end=0.1, step=H, progress=False)
    for mend in (False, True):
        with pytest.raises(fb.SceneError, match=r"'[ab]' \(dock\) stands 0.03\d* m off .*(too large to be mended|"
                                                r"corrects errors up to)"):
            fb.simulate(bodies(True), start=fb.Start(flight.state_for(bodies(True)), mend=mend), t_end=H, step=H)
    # statics and modes measure it as well
    with pytest.raises(fb.SceneError, match=r"body '[ab]' \(dock\) stands 0.03\d* m off"):
        fb.modes(bodies(True), state=flight.state_for(bodies(True)), n=2)


@pytest.mark.parametrize("joint", [fb.RigidConnection, fb.BallJoint])
def test_a_small_gap_closes_without_bending_anything(joint: type) -> None:
    """Rods 5 mm apart: bent until they fitted, they began with 68 J."""
    def rods(gap: float, *joints: type) -> fb.Model:
        section = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0)
        a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=section, elements=2)
        b = fb.Beam.straight("b", (1 + gap, 0, 0), (2 + gap, 0, 0), section=section, elements=2)
        motion = [] if joints else [fb.RigidMotion(b, velocity=(0, 0.01, 0.02), spin=(0, 0.02, 0))]
        return fb.compile_scene(fb.Scene(a, b, *(kind(a.end, b.start, name="joint") for kind in joints), *motion), planar=False)

    free, model = fb.simulate(rods(0.005), t_end=H, step=H, progress=False), rods(0.0, joint)
    start = free.state_for(model)
    # nothing is moved before it is measured
    np.testing.assert_array_equal(start.q, free.state.q)
    with pytest.raises(fb.SceneError, match=r"start: beam '[ab]' node \d \(joint\) stands 0.005\d* m off .*mend=True"):
        fb.simulate(model, start=start, t_end=H, step=H)
    run = fb.simulate(model, start=fb.Start(start, mend=True), t_end=H, step=H, progress=False)
    # the rod that spins is stretched as it was, by 8e-16 J
    np.testing.assert_allclose(run.series["strain"][0], free.series["strain"][-1], rtol=0, atol=1e-18)
    for name in ("lin_mom", "ang_mom"):
        np.testing.assert_allclose(run.series[name][0], free.series[name][-1], rtol=0, atol=1e-12 * free.info["scale"][name])
    # without supports the centre of mass stays
    middle = [np.mean(x.reshape(2, -1, 3)[:, [0, -1]], axis=(0, 1)) for x in (free.phi[-1], run.phi[0])]
    np.testing.assert_allclose(middle[1], middle[0], atol=1e-12)


@pytest.mark.parametrize("seed", [12, 25, 3])
def test_random_restarts_account_for_momenta_and_energy(seed: int) -> None:
    assert restart(seed)[1] < BAR


@pytest.mark.slow
def test_many_random_restarts() -> None:
    """A thousand of them: perf/stress/restarts.py."""
    found = [restart(seed) for seed in range(200)]
    assert max(error for _, error in found) < BAR
    kinds = [kind for kind, _ in found]
    print({kind: kinds.count(kind) for kind in set(kinds)})
    assert min(kinds.count(kind) for kind in ("taken", "mended", "refused")) > 20


def test_turns_of_a_joint_go_along() -> None:
    """A wheel on a spring at 7.5 rad: taken for 1.2 rad it had 53 J for 80."""
    def wheel() -> fb.Model:
        body = fb.RigidBody("wheel", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0), spin=(0, 0, 40.0))
        return fb.compile_scene(fb.Scene(body, fb.RevoluteJoint(fb.GROUND, body, "axle", axis=(0, 0, 1), stiffness=1.0)),
                                planar=False)

    turned = fb.simulate(wheel(), t_end=0.2, step=1e-3, progress=False)
    on = fb.simulate(wheel(), start=turned.state_for(wheel()), t_end=0.01, step=1e-3, progress=False)
    assert turned.joint("axle")["angle"][-1] > 2.0 * np.pi
    assert on.joint("axle")["angle"][0] == turned.joint("axle")["angle"][-1]
    np.testing.assert_allclose(on.series["total"], 80.0, rtol=1e-12)
