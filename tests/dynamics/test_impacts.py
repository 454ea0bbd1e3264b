"""Impacts of sliders on rigid stops in a run: rows, checkpoints, step control, and slopes of friction beside them."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on

import fastbeam as fb
import fastbeam.dynamics.time_loop
from fastbeam.dynamics.impacts import Impacts
from fastbeam.dynamics.velocity_jumps import strike
from fastbeam.dynamics.velocity_jumps import jump
from fastbeam.kernels.contact.slider_forces import DRIVE_WORK, HISTORY, STOP_LOSS
from fastbeam.model.mapping import contact
from fastbeam.model.maps import mass_map

RAIL = fb.Section.circle(radius=0.05, E=200e9, rho=7800.0)
SOFT = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
CABLE = fb.Section.circle(radius=0.01, E=1e6, rho=1000.0)


def rail(angle: float, at: float, gravity: float = 9.81, mass: float = 0.01, **forces: Any) -> fb.Model:
    """A bead on a straight rail of 4 m, all nodes of which are clamped, at this angle (degrees) to the horizontal."""
    a = np.radians(angle)
    beam = fb.Beam.straight("rail", (0, 0, 0), (4 * np.cos(a), 0, 4 * np.sin(a)), section=RAIL, elements=4)
    bead = fb.PointMass("bead", mass=mass)
    return fb.compile_scene(fb.Scene(beam, bead, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                                     fb.Slider("s", bead, beam, at=at, **forces), gravity=(0, 0, -gravity)))


def flying(planar: Any) -> fb.Model:
    """A mass between stops on a free beam in motion."""
    out = 0.0 if planar == "auto" else 1.0
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=SOFT, elements=4)
    mass = fb.PointMass("point", mass=0.2)
    spin = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0.0 * s, out * np.cos(3 * s), np.sin(3 * s)), axis=1))
    slider = fb.Slider("s", mass, beam, at=0.4, rate=2.0, stops=fb.Stops(0.2, 0.5, restitution=0.6), friction=0.05)
    return fb.compile_scene(fb.Scene(beam, mass, spin, slider), planar=planar)


def cable(planar: Any, **forces: Any) -> fb.Model:
    """A bead on a soft cable that swings."""
    out = 0.0 if planar == "auto" else 0.3
    beam = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0.3), section=CABLE, elements=3)
    bead = fb.PointMass("bead", mass=0.05)
    swing = fb.InitialVelocity(beam, velocity=lambda s: np.sin(np.pi * s)[:, None] * (0.0, out, 0.5))
    return fb.compile_scene(fb.Scene(beam, bead, swing, fb.Clamp(beam.start), fb.Pin(beam.end),
                                     fb.Slider("s", bead, beam, at=0.4, **forces), gravity=(0, 0, -1.0), project_velocities=True),
                            planar=planar)


def along(model: fb.Model, state: Any, k: int) -> tuple[Any, float]:
    """Derivative by s of the curve under slider k [3], and ds/dt, m/s."""
    _, tangent, relative = contact(model, k, float(state.s[k]), *(x.reshape(-1, 4, 3) for x in (state.q, state.v)))
    return tangent, float(relative @ tangent / (tangent @ tangent))


def impacts_of(result: fb.Result) -> list[float]:
    return [x["time"] for x in result.events if x["kind"] == "impact"]


# steps back at a row in front of an impact ask for the force of the drive
DRIVEN: dict[str, Any] = dict(stops=fb.Stops(1.0, 3.0, restitution=0.6), drive=fb.Drive(force=lambda t: 0.02 * np.cos(9.0 * t)))
SCENES = {"bead": (lambda: rail(60.0, 1.05, stops=fb.Stops(1.0, 3.0, restitution=0.3)), 0.2),
          "driven bead": (lambda: rail(60.0, 1.05, **DRIVEN), 0.2),
          "plane": (lambda: flying("auto"), 0.15), "space": (lambda: flying(False), 0.15)}


@pytest.mark.parametrize("tolerance", [None, 1e-5])
@pytest.mark.parametrize("name", SCENES)
def test_a_run_goes_on_bit_for_bit_from_every_row_around_an_impact(name: str, tolerance: float | None, tmp_path: Any) -> None:
    make, t_end = SCENES[name]
    model = make()
    settings: dict[str, Any] = dict(t_end=t_end, step=1e-3, every=1, tolerance=tolerance, progress=False)
    whole = fb.simulate(model, **settings)
    times = impacts_of(whole)
    assert len(times) > 0 and np.ptp(whole.series["stop_loss"]) > 0.0
    near = {int(np.argmin(np.abs(whole.t - t))) + k for t in (times[0], times[-1]) for k in (-2, -1, 0, 1, 2)}
    for n in sorted(near & set(range(1, len(whole.t) - 1))):
        assert_goes_on(model, whole, n, tmp_path / "c", settings)


def test_the_row_the_callback_and_the_checkpoint_of_an_impact_are_behind_it(tmp_path: Any) -> None:
    seen = []

    def look(t: float, state: Any) -> bool:
        seen.append((t, state.v.copy()))
        return len(state.history) > 0 and state.history[4] > 0.0

    model = rail(60.0, 1.05, stops=fb.Stops(1.0, 3.0, restitution=0.5))
    result = fb.simulate(model, t_end=1.0, step=1e-2, every=1, progress=False, callback=look,
                         output=fb.Output(checkpoint=tmp_path / "c", checkpoint_every=0.0))
    (t,) = impacts_of(result)
    assert result.t[-1] == t == seen[-1][0] and result.slider("s")["slide_rate"][-1] > 0.0
    np.testing.assert_array_equal(seen[-1][1], result.state.v)
    kept = fb.load_checkpoint(tmp_path / "c")
    assert kept.t == t and kept.impacts is not None and kept.impacts[0, 0] == t and kept.impacts[0, 1] < -1e300
    np.testing.assert_array_equal(kept.state.v, result.state.v)


def test_checkpoints_of_other_sliders_hold_no_impacts() -> None:
    checkpoint = fb.simulate(rail(0.0, 1.0, friction=0.1), t_end=0.01, step=1e-3, progress=False).checkpoint
    assert checkpoint.impacts is None
    with pytest.raises(fb.SceneError, match="impact times of shape"):
        Impacts(rail(0.0, 1.0, stops=fb.Stops(0.5, 2.0)), np.zeros((2, 2)))


def test_step_control_judges_the_step_to_a_stop() -> None:
    # an oscillator from rest, whose first step is far too long and beyond the stop: cos(w t) = 1/3
    model = rail(0.0, 2.3, gravity=0.0, mass=0.5, drive=fb.Drive(position=2.0, stiffness=20.0),
                 stops=fb.Stops(2.1, 3.0, restitution=1.0))
    exact = np.arccos(1.0 / 3.0) / np.sqrt(40.0)

    def error(tolerance: float) -> float:
        result = fb.simulate(model, t_end=0.3, step=0.3, tolerance=fb.StepControl(tolerance, max_step=0.3), progress=False)
        return abs(impacts_of(result)[0] - exact)

    errors = [error(x) for x in (1e-4, 1e-6, 1e-8)]
    # of order 2/3 in the tolerance
    assert errors[0] < 1e-3 and errors[1] < 1e-4 and errors[2] < 5e-6


def test_an_impact_next_to_the_end_of_a_run_leaves_no_tiny_step() -> None:
    model = rail(60.0, 2.0, stops=fb.Stops(1.0, 3.0, restitution=0.5))
    first = impacts_of(fb.simulate(model, t_end=0.6, step=1e-3, progress=False))[0]
    for late, steps in ((1e-13, 1), (1e-10, 1), (1e-7, 2)):
        result = fb.simulate(model, t_end=first + late, step=1e-3, every=1, progress=False)
        assert result.t[-1] == first + late and np.sum(result.series["step_size"][-2:] < 0.9e-3) == steps
        assert len(impacts_of(result)) == (late > 1e-12) and result.drift("balance") < 1e-13


@pytest.mark.parametrize("tolerance", [None, 1e-5])
def test_progress_reaches_the_end_of_a_run_with_impacts(tolerance: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    done = []

    class Counted(fastbeam.dynamics.time_loop.Progress):
        def update(self, k: float = 1) -> None:
            done.append(k)

    monkeypatch.setattr(fastbeam.dynamics.time_loop, "Progress", Counted)
    model = rail(60.0, 2.0, stops=fb.Stops(1.0, 3.0, restitution=0.5))
    result = fb.simulate(model, t_end=1.0, step=1e-2, every=7, tolerance=tolerance, progress=False)
    assert len(impacts_of(result)) > 1
    assert abs(sum(done) - 1.0) < 1e-12


PUSHED = dict(friction=0.1, drive=fb.Drive(force=-0.3), stops=fb.Stops(0.35, 0.6))


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_drive_pushes_a_slider_with_friction_into_a_stop_of_a_swinging_cable(planar: Any) -> None:
    # it comes to rest and leaves again many times; on the way a step from rest meets the stop, where secants get nowhere
    result = fb.simulate(cable(planar, **PUSHED), t_end=1.5, step=1e-3, every=1, progress=False)
    assert len(impacts_of(result)) > 20 and result.drift("balance") < 1e-12
    assert np.min(result.slider("s")["s"]) > 0.35 - 1e-9
    assert np.max(result.series["iterations"]) < 12


def test_steps_that_take_another_branch_of_friction_near_a_stop_end_before_it() -> None:
    # the place at the end of a step jumps with the size of the step, across the stop
    rng = np.random.default_rng(3)
    for _ in range(3):
        push, shake, rate = -rng.uniform(0.2, 1.0), rng.uniform(0.2, 1.2), rng.choice([40.0, 200.0])
        drive = fb.Drive(force=lambda t, a=push, b=shake, w=rate: a * (1.0 + b * np.sin(w * t)))
        model = cable("auto", friction=0.6, drive=drive, stops=fb.Stops(0.38, 0.6, restitution=0.3))
        result = fb.simulate(model, t_end=1.2, step=6e-3, every=1, progress=False)
        assert result.t[-1] == 1.2 and result.drift("balance") < 1e-11
        assert np.min(result.slider("s")["s"]) > 0.38 - 1e-9


@pytest.mark.parametrize("friction", [None, 0.3])
@pytest.mark.parametrize("angle", [60.0, 0.0])
def test_a_slider_rests_against_a_stop_for_long(angle: float, friction: float | None) -> None:
    drive = None if angle else fb.Drive(force=-0.2)
    model = rail(angle, 1.2, friction=friction, drive=drive, stops=fb.Stops(1.0, 3.0, restitution=0.3))
    result = fb.simulate(model, t_end=60.0, step=1e-2, every=1, progress=False)
    bead = result.slider("s")
    late = result.t > 5.0
    assert len(impacts_of(result)) < 10 and np.ptp(bead["s"][late]) == 0.0
    pushed = 0.01 * 9.81 * np.sin(np.radians(60.0)) if angle else 0.2
    held = (friction or 0.0) * 0.01 * 9.81 * np.cos(np.radians(angle))
    np.testing.assert_allclose(bead["stop_force"][late], pushed - held, rtol=1e-8)
    np.testing.assert_array_equal(result.series["iterations"][late], result.series["iterations"][-1])


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("interpolation, degree", [("lagrange", 3), ("bspline", 2)])
def test_steps_that_miss_the_wave_of_an_impact_are_told_of(planar: Any, interpolation: str, degree: int) -> None:
    section = fb.Section(EA=1e8, GA2=3e7, GA3=3e7, GJ=1e-2, EI2=1e-2, EI3=1e-2, rhoA=0.1, rhoI2=1e-7, rhoI3=1e-7)
    beam = fb.Beam.straight("wire", (0, 0, 0), (10, 0, 0), section=section, elements=10, prestress=1e4, degree=degree,
                            interpolation=interpolation)
    bead = fb.PointMass("bead", mass=0.1)
    slider = fb.Slider("s", bead, beam, at=7.95, rate=6.0, stops=fb.Stops(end=8.0, restitution=0.5))
    model = fb.compile_scene(fb.Scene(beam, bead, fb.Pin(beam.start), fb.Pin(beam.end), slider, project_velocities=True),
                             planar=planar)
    # m/sqrt(EA rhoA) = 3.2e-5 s
    for step, told in ((1e-3, 1), (1e-4, 1), (2e-5, 0)):
        result = fb.simulate(model, t_end=0.0085 + step, step=step, progress=False)
        texts = [x["text"] for x in result.events if x["kind"] == "unresolved" and "wave" in x["text"]]
        assert len(impacts_of(result)) > 0 and len(texts) == told
        assert all("slider 's' hits a rigid stop" in text and "3.2e-05 s" in text for text in texts)


def test_a_holder_that_is_held_carries_no_momentum() -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SOFT, elements=4)
    holder = fb.RigidBody("holder", mass=1e-3, inertia=(1e-6, 1e-6, 1e-6), position=(0.5, 0, 0))
    sleeve = fb.Sleeve("s", holder, rod, at=0.5, rate=-6.0, stops=fb.Stops(0.48, 0.9, restitution=0.5))
    model = fb.compile_scene(fb.Scene(rod, holder, fb.Clamp(holder), sleeve, fb.RigidMotion((rod,), velocity=(6, 0, 0)),
                                      project_velocities=True))
    result = fb.simulate(model, t_end=0.01, step=1e-3, progress=False)
    assert impacts_of(result) and not [x for x in result.events if x["kind"] == "unresolved"]


def test_what_supports_hold_sends_no_wave() -> None:
    result = fb.simulate(rail(60.0, 1.05, stops=fb.Stops(1.0, 3.0, restitution=0.3)), t_end=0.2, step=0.01, progress=False)
    assert impacts_of(result) and not [x for x in result.events if x["kind"] == "unresolved"]


@pytest.mark.parametrize("behind, rate", [(0.5, 0.0), (1.0 - 1e-12, 0.0), (1.0, 0.0), (1.0 + 1e-12, 0.0), (1.001, -0.5)])
def test_a_second_impact_within_a_step_does_not_bounce(behind: float, rate: float) -> None:
    """Where friction holds a slider at its stop for a whole step, round-off is not to decide."""
    model = rail(0.0, 1.0, rate=1.0, stops=fb.Stops(0.5, 1.0, restitution=0.5))
    impacts, step = Impacts(model), 0.02
    state = model.state()
    impacts.behind(state, 0, True, 0.1, step, step)
    after = impacts.behind(state, 0, True, 0.1 + behind * step, step, behind * step)
    bead = after.v.reshape(-1, 4, 3)[model.labels.index("point mass 'bead'"), 0]
    np.testing.assert_allclose(bead, (rate, 0.0, 0.0), rtol=0.0, atol=1e-14)
    assert impacts.number == 2


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_the_impulse_of_a_drive_that_prescribes_a_motion_counts_as_its_work(restitution: float) -> None:
    """A bead hits a stop on a free beam that another is driven along: what the stop takes is its impulse times the mean of the
    velocities along the beam, what the drive puts in its impulse times its own. Both were a loss of the stop, even a negative
    one."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=SOFT, elements=4)
    hits, driven = fb.PointMass("hits", mass=0.2), fb.PointMass("driven", mass=0.3)
    model = fb.compile_scene(fb.Scene(
        beam, hits, driven, fb.Slider("a", hits, beam, at=0.4, rate=2.0, stops=fb.Stops(0.1, 0.4, restitution=restitution)),
        fb.Slider("b", driven, beam, at=0.7, drive=fb.Drive(speed=-1.5)), project_velocities=True))
    before = model.state()
    rates = [along(model, before, k)[1] for k in range(2)]
    after = strike(model, before, 0, True, restitution)
    assert along(model, after, 0)[1] == pytest.approx(-restitution * rates[0], abs=1e-12)
    assert along(model, after, 1)[1] == pytest.approx(rates[1], rel=1e-12) and rates[1] == pytest.approx(-1.5)
    blow = (after.v - before.v).reshape(-1, 4, 3)
    tangent = np.array([1.0, 0.0, 0.2]) / np.sqrt(1.04)
    push = [mass.mass * float(blow[model.numbers.start(mass), 0] @ tangent) for mass in (hits, driven)]
    own = model.own(after.history, "slider_forces").reshape(-1, HISTORY)
    loss, work = -push[0] * 0.5 * (1.0 - restitution) * rates[0], push[1] * rates[1]
    assert own[0, STOP_LOSS] == pytest.approx(loss, abs=1e-13) and own[1, DRIVE_WORK] == pytest.approx(work, rel=1e-9)
    assert abs(work) > 1e-3 and loss >= 0.0
    energy = [0.5 * float(x.v @ (mass_map(model) @ x.v)) for x in (before, after)]
    assert energy[1] - energy[0] == pytest.approx(work - loss, rel=1e-9)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_blow_on_what_hardly_moves_gives_no_energy(restitution: float) -> None:
    """Rates across the beam, which the end of a step leaves, are larger than that into the stop: impulses put work in on them."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=SOFT, elements=4)
    body = fb.RigidBody("body", mass=0.2, inertia=(1e-4, 2e-4, 3e-4), position=(0.55, 0.05, 0.2))
    stops = fb.Stops(0.2, 0.5, restitution=restitution)
    at = beam.reference(0.5)[0][0] - body.position
    model = fb.compile_scene(fb.Scene(beam, body, fb.Slider("s", body.point(at), beam, at=0.5, stops=stops)), planar=False)
    losses, rng, energy = [], np.random.default_rng(3), mass_map(model)
    nodes = np.arange(model.numbers.start(body), model.n_nodes)
    for _ in range(20):
        state = model.state()
        tangent, _ = along(model, state, 0)
        across = np.linalg.svd(tangent[None])[2][1:]
        state.v.reshape(-1, 4, 3)[nodes, 0] = 1e-4 * tangent + 1e-2 * rng.standard_normal(2) @ across
        after = strike(model, state, 0, True, restitution)
        losses.append(model.own(after.history, "slider_forces").reshape(-1, HISTORY)[0, STOP_LOSS])
        before = 0.5 * state.v @ (energy @ state.v)
        assert losses[-1] == pytest.approx(before - 0.5 * after.v @ (energy @ after.v), abs=3e-15 * before)  # a dozen roundings
        assert losses[-1] > -2e-15 * before
    # it does without what is asked for here
    plain = []
    for _ in range(20):
        state = model.state()
        state.v.reshape(-1, 4, 3)[nodes, 0] = 1e-4 * tangent + 1e-2 * rng.standard_normal(2) @ across
        plain.append(jump(model, state, 0, np.eye(3), -(1.0 + restitution) * 1e-4 * tangent)[1])
    assert min(plain) < -1e-9


@pytest.mark.parametrize("step", [5e-4, 2.5e-4])
def test_a_stop_gives_no_energy_to_a_body_that_tumbles_on_a_flying_beam(step: float) -> None:
    """Rates of directors at the end of a step are no motion of triads, and have energy of their own."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=SOFT, elements=4)
    place = beam.reference(0.5)[0][0]
    body = fb.RigidBody("body", mass=0.2, inertia=(1e-4, 2e-4, 3e-4), position=place + (0.02, 0.05, -0.04), spin=(3, 5, -4))
    stops = fb.Stops(0.45, 0.55, restitution=1.0)
    slider = fb.Slider("s", body.point(place - body.position), beam, at=0.5, rate=2.0, stops=stops)
    model = fb.compile_scene(fb.Scene(beam, body, slider, project_velocities=True), planar=False)
    result = fb.simulate(model, t_end=0.3, step=step, every=1, progress=False)
    losses, size = np.diff(result.slider("s")["stop_loss"]), np.max(result.series["kinetic"])
    # what impulses do on rates across the beam is lost, second order in the step
    assert impacts_of(result) and np.min(losses) > -1e-14 * size and np.max(losses) < 1e-2 * (step / 1e-3)**2 * size
    assert all(event["kind"] != "unresolved" for event in result.events)
    # it meets the stop again 0.6 ms later: within one step of 1 ms, where it stays
    coarse = fb.simulate(model, t_end=0.05, step=1e-3, every=1, progress=False)
    told, = (event["text"] for event in coarse.events if event["kind"] == "unresolved")
    lost = coarse.slider("s")["stop_loss"][-1] / np.max(coarse.series["kinetic"])
    assert lost > 0.3 and "second time within one step" in told
    assert float(told.split(" % of")[0].split()[-1]) == pytest.approx(100.0 * lost, rel=0.1)
