"""Beams whose elements move with contacts (theory.md 5.12): against the NumPy twin, an exact solution in time, and invariants."""
from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.model import Model

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "study"))
from naive_moving_mesh import Data, MovingMesh  # noqa: E402
from naive_moving_step import Ends, Step  # noqa: E402

START, RATE = 0.37, 0.35
SECTION = fb.Section(EA=400, GA2=150, GA3=150, GJ=1, EI2=1, EI3=1, rhoA=1, rhoI2=0.01, rhoI3=0.01)


def bead_scene(each: int, gravity: tuple[float, ...], **options: object) -> fb.Scene:
    """A bead on a clamped beam with as many elements on each side."""
    ends = np.concatenate((np.linspace(0.0, START, each + 1)[:-1], np.linspace(START, 1.0, each + 1)))
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=SECTION, elements=ends, degree=3)
    bead = fb.PointMass("bead", mass=0.5, velocity=(RATE, 0, 0))
    slider = fb.Slider("run", bead, beam, at=START)
    return fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), slider, fb.MovingMesh(beam, slider, **options),
                    gravity=gravity)


def ends(model: Model, state: object, table: object) -> Ends:
    q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
    nodes = slice(table.place[1], table.place[1] + table.place[2])
    return Ends(q[nodes], v[nodes], float(state.s[0]), float(model.moving.places_in(state.history)[0]))


def test_a_step_is_that_of_the_twin() -> None:
    gravity, h = np.array((0.0, -6.0, 3.0)), 0.01
    scene = bead_scene(2, tuple(gravity), spin=lambda s: np.stack((np.sin(np.pi * s)**2, 0 * s, 0 * s), axis=1))
    model = fb.compile_scene(scene)
    table = model.moving.tables[0]
    twin = Step(2, 3, 1.0, SECTION.C, np.array((1.0, 0, 0, 0, 0, 0)), np.array((1.0, 0.0, 0.01, 0.01)), gravity)
    shape = (len(table.node), table.mass_point.shape[1], 4, 3)
    bead = model.numbers.start(scene.masses[0])
    state, worst, scale = model.state(), 0.0, 0.0
    live = (0, 2, 3)
    for _ in range(5):
        after = fb.simulate(model, start=state, t_end=h, step=h, progress=False).state
        start, end = ends(model, state, table), ends(model, after, table)
        old, new = (x.history[:np.prod(shape)].reshape(shape) for x in (state, after))
        mean = twin.mean(start, end)
        if scale == 0.0:
            worst = float(np.max(np.abs(old - twin.momentum(start))[:, :, live]))
        scale = max(scale, float(np.max(np.abs(twin.forces(start, end, old)[0][:, 0]))))
        worst = max(worst, float(np.max(np.abs(0.5 * (old + new) - mean)[:, :, live])))
        force, moment, along = twin.unbalance(start, end, old, h)
        inner = np.ones(len(force), bool)
        inner[[0, -1, 6]] = False
        # that of the contact is what the bead takes
        accelerated = 0.5 * ((after.v - state.v).reshape(-1, 4, 3)[bead, 0] / h - gravity)
        worst = max(worst, float(np.max(np.abs(force[inner]))) / scale, float(np.max(np.abs(moment[1:-1]))) / scale,
                    float(np.max(np.abs(force[6] + accelerated))) / scale, abs(along) / scale)
        state = after
    print(f"largest difference {worst:.1e} of {scale:.3g} N")
    assert worst < 1e-10 and abs(state.s[0] - START) > 0.01


def test_against_the_exact_solution_in_time() -> None:
    exact = MovingMesh(2, 4, Data(grows=0.0)).run(START, RATE, 0.4, 1e-9)
    off = []
    for h in (0.01, 0.005, 0.0025):
        run = fb.simulate(fb.compile_scene(bead_scene(2, (0, -6, 0))), t_end=0.4, step=h, progress=False).slider("run")
        off.append((abs(run["s"][-1] - exact.s), np.linalg.norm(run["position"][-1, :2] - exact.position)))
    print(f"steps of 10, 5, 2.5 ms: s and position off by {off}")
    assert max(off[0]) < 1e-3 and max(off[2]) < 1e-4 and off[1][1] < 0.5 * off[0][1]


@pytest.mark.parametrize("order", [2, 4])
def test_invariants_in_flight(order: int) -> None:
    import scenes
    scene = fb.with_moving_meshes(scenes.body_on_beam(elements=6, degree=3).scene)
    result = fb.simulate(fb.compile_scene(scene), t_end=0.5, step=0.02, order=order, progress=False)
    run = result.slider(scene.sliders[0].name)
    drift = [result.drift(x) for x in ("total", "lin_mom", "ang_mom")]
    print(f"order {order}: drift of energy and momenta {drift}")
    assert max(drift) < 1e-12 and abs(run["s"][-1] - run["s"][0]) > 0.5


def test_gravity_that_grows() -> None:
    """Against the exact solution in time; with a constant factor the same as without; the books, also of a load in time beside
    constant gravity."""
    data = Data()
    exact = MovingMesh(2, 4, data).run(START, RATE, 0.4, 1e-9)
    scene = bead_scene(2, (0, -6, 0))

    def run(gravity_time: object, *loads: fb.Load, h: float = 0.01) -> fb.Result:
        one = fb.Scene(*scene.parts, *loads, gravity=scene.gravity, gravity_time=gravity_time)
        return fb.simulate(fb.compile_scene(one), t_end=0.4, step=h, progress=False)

    off = []
    for h in (0.01, 0.005, 0.0025):
        result = run(lambda t: data.weight(t) / data.gravity, h=h)
        x = result.slider("run")
        off.append((abs(x["s"][-1] - exact.s), np.linalg.norm(x["position"][-1, :2] - exact.position)))
        assert result.drift("balance") < 1e-13 and result.series["external_work"][-1] > 0.01
    print(f"steps of 10, 5, 2.5 ms: s and position off by {off}")
    assert np.all(np.array(off[1]) < 0.3 * np.array(off[0])) and max(off[2]) < 1e-5
    constant, one = run(None), run(lambda t: 1.0)
    assert fb.compile_scene(scene).plane is not None
    assert np.all(constant.state.q.reshape(-1, 4, 3)[:, :3, 2] == 0.0)
    np.testing.assert_allclose(one.state.q, constant.state.q, rtol=0, atol=1e-13)
    assert constant.drift("total") < 1e-13 and one.drift("balance") < 1e-13
    np.testing.assert_allclose(one.series["external_work"], one.series["gravity"][0] - one.series["gravity"], atol=1e-13)
    pushed = run(None, fb.Load("push", scene.masses[0], force=(0, -2, 0), time=lambda t: min(5.0 * t, 1.0)))
    assert pushed.drift("balance") < 1e-13 and pushed.series["external_work"][-1] > 0.01


def test_fine_meshes_stay_with_waves_that_pass() -> None:
    """A momentum beside a velocity of its own alternated from step to step and grew: this run ended at 0.2 s."""
    import scenes
    given = scenes.body_on_beam(elements=48, degree=3).scene
    rail, scale = given.beams[0], 3.4

    def velocity(s: np.ndarray) -> np.ndarray:
        x = np.clip((s - 6.4) / scale, -1.0, 1.0)
        return np.outer((1.0 - x**2)**7, (0.0, 4.0, -3.0))

    def spin(s: np.ndarray) -> np.ndarray:
        x = np.clip((s - 6.4) / scale, -1.0, 1.0)
        return np.outer(-14.0 * x * (1.0 - x**2)**6 / scale, (0.0, 3.0, 4.0))

    parts = [x for x in given.parts if not isinstance(x, fb.InitialVelocity)]
    parts.append(fb.InitialVelocity(rail, velocity=velocity, spin=spin))
    scene = fb.with_moving_meshes(fb.Scene(*parts, project_velocities=True))
    result = fb.simulate(fb.compile_scene(scene), t_end=0.5, step=2.5e-3, progress=False)
    rate = np.gradient(result.slider(scene.sliders[0].name)["s"], result.t)
    print(f"rates from {rate.min():.3g} to {rate.max():.3g} m/s, jumps of {np.abs(np.diff(rate)).max():.2g} m/s")
    assert max(result.drift(x) for x in ("total", "lin_mom", "ang_mom")) < 1e-13
    assert np.abs(np.diff(rate)).max() < 0.1


def test_velocities_written_into_a_state() -> None:
    """The step goes on with momenta in State.history: others are taken with an event, and only told of where they are small."""
    scene = bead_scene(2, (0, 0, 0))
    model = fb.compile_scene(scene)
    middle = model.state()
    n = scene.beams[0].n_nodes

    def bump(s: np.ndarray) -> np.ndarray:
        return np.sin(np.pi * np.maximum(s - START, 0.0) / (1.0 - START))**2

    def pushed(rate: float) -> object:
        state = model.state()
        state.v.reshape(-1, 4, 3)[:n, 0, 2] += rate * bump(state.q.reshape(-1, 4, 3)[:n, 0, 0])
        return state

    run = {"t_end": 0.02, "step": 2e-3, "progress": False}
    told = fb.simulate(model, start=pushed(0.02), **run)
    assert [x for x in told.events if x["kind"] == "start" and "the momenta are used" in x["text"]]
    given = fb.Scene(*[x for x in scene.parts if not isinstance(x, fb.MovingMesh)],
                     fb.MovingMesh(scene.beams[0], scene.sliders[0], velocity=lambda s: np.outer(0.3 * bump(s), (0, 0, 1))))
    wanted = fb.simulate(fb.compile_scene(given), **run)
    for mend in (False, True):
        taken = fb.simulate(model, start=fb.Start(pushed(0.3), mend=mend), **run)
        assert [x for x in taken.events if "velocities of the material that were written" in x["text"]]
        assert np.max(np.abs(taken.state.q - wanted.state.q)) < 1e-6 < np.max(np.abs(taken.state.q - middle.q))
    # what a run leads to starts the next one, and states carried to another model bring momenta of their velocities
    again = fb.simulate(model, start=taken.state, **run)
    assert not [x for x in again.events if x["kind"] == "start"]
    brought = taken.state_for(fb.compile_scene(scene))
    assert model.momenta_misfit(brought) < 1e-12 < np.max(np.abs(brought.v - middle.v))


def test_contact_force_is_what_the_bead_takes() -> None:
    h = 0.0025
    result = fb.simulate(fb.compile_scene(bead_scene(2, (0, -6, 0))), t_end=0.2, step=h, progress=False,
                         observe=("slider", "reaction"))
    run = result.slider("run")
    x = run["position"]
    mean = 0.5 * ((x[2:] - 2.0 * x[1:-1] + x[:-2]) / h**2 + (0, 6, 0))
    late = slice(20, -5)
    gap = np.linalg.norm(run["force"][1:-1][late] - mean[late], axis=1)
    print(f"force {np.max(np.abs(mean[late])):.3g} N, off by {np.max(gap):.1e} N")
    assert np.max(gap) < 0.05 * np.max(np.abs(mean[late]))


def test_what_moving_meshes_refuse() -> None:
    scene = bead_scene(2, (0, -6, 0))
    model = fb.compile_scene(scene)
    with pytest.raises(fb.SceneError, match="not support moving elements"):
        fb.simulate(model, t_end=0.01, step=0.01, method="midpoint", progress=False)
    with pytest.raises(fb.SceneError, match="is not needed.*leave contacts= out"):
        fb.solve_static(model, contacts="exact")
    with pytest.raises(fb.SceneError, match="'inner' does not support moving elements"):
        fb.simulate(model, t_end=0.01, step=0.01, observe=("inner",), progress=False)
    beam = scene.beams[0]
    with pytest.raises(fb.SceneError, match="only the ends of this beam"):
        fb.compile_scene(fb.Scene(*scene.parts, fb.Load("push", beam.node(3), force=(0, 1, 0))))
    with pytest.raises(fb.SceneError, match="do not support drag"):
        fb.compile_scene(fb.Scene(*scene.parts, fb.Drag("air", beam, linear=1.0)))
    released = fb.Slider("held", scene.masses[0], beam, at=START, release=fb.Release(when=0.1))
    with pytest.raises(fb.SceneError, match="has a release"):
        fb.MovingMesh(beam, released)
    off = fb.Slider("off", scene.masses[0], beam, at=0.3)
    with pytest.raises(fb.SceneError, match="'off' begins at=0.3 m and needs an element end at 0.3 m"):
        fb.compile_scene(fb.Scene(beam, scene.masses[0], off, fb.MovingMesh(beam, off)))
    other = fb.Beam.straight("other", (0, 1, 0), (1, 1, 0), section=SECTION, elements=2)
    mass = fb.PointMass("m", mass=1.0)
    with pytest.raises(fb.SceneError, match="belongs to no MovingMesh"):
        fb.compile_scene(fb.Scene(*scene.parts, other, mass, fb.Slider("second", mass, other, at=0.5)))


def test_checkpoints_know_the_elements_that_move() -> None:
    def model(stiffness: float) -> fb.Model:
        beam = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=fb.Section.circle(radius=0.01, E=stiffness, rho=2e3),
                                elements=4)
        bead = fb.PointMass("bead", mass=0.5)
        return fb.compile_scene(fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end),
                                         fb.Slider("run", bead, beam, at=0.7)), moving=True)
    half = fb.simulate(model(2e9), t_end=0.01, step=0.01, progress=False).checkpoint
    assert fb.simulate(model(2e9), start=half, t_end=0.02, step=0.01, progress=False).t[-1] == pytest.approx(0.02)
    with pytest.raises(fb.SceneError, match="belongs to another model"):
        fb.simulate(model(3e9), start=half, t_end=0.02, step=0.01, progress=False)


STEEL = fb.Section.circle(radius=0.006, E=2.1e11, rho=7850.0)


@pytest.mark.parametrize("beam", [
    fb.Beam.arc("beam", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=3.0, section=STEEL, elements=8),
    fb.Beam.helix("beam", radius=0.2, pitch=-0.1, turns=4, section=STEEL, elements=24)], ids=["arc", "helix"])
def test_an_unloaded_curved_beam_pushes_nothing(beam: fb.Beam) -> None:
    """Elements of 0.4 to 1.3 rad: their interpolation strains them by 1e-4 to 1e-2."""
    bead = fb.PointMass("bead", mass=0.05)
    scene = fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Slider("run", bead, beam, at=0.4 * beam.length))
    result = fb.simulate(fb.compile_scene(fb.with_moving_meshes(scene)), t_end=0.05, step=1e-3, progress=False)
    moved = np.ptp(result.slider("run")["s"])
    print(f"moved by {moved:.1e} m, strain energy {result.series['strain'].max():.1e} J")
    # strains of an element are known to 1e-12 or better
    assert moved < 1e-10 and result.series["strain"].max() < 1e-16


def test_a_bead_on_a_helix_slides_alike_on_meshes_of_half_and_of_a_quarter_of_a_radian() -> None:
    def end(each: int) -> float:
        length = 8.0 * np.pi * np.hypot(0.2, 0.1 / (2.0 * np.pi))
        ends = np.r_[np.linspace(0.0, 0.1, each + 1), np.linspace(0.1, length, 2 * each + 1)[1:]]
        wire = fb.Beam.helix("wire", radius=0.2, pitch=-0.1, turns=4, section=STEEL, elements=ends)
        bead = fb.PointMass("bead", mass=0.05)
        slider = fb.Slider("run", bead, wire, at=0.1)
        scene = fb.Scene(wire, bead, fb.Clamp(wire.start), fb.Clamp(wire.end), slider, fb.MovingMesh(wire, slider),
                         gravity=(0, 0, -9.81))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = fb.simulate(fb.compile_scene(scene), t_end=0.8, step=2.5e-3, progress=False)
        assert result.drift("total") < 1e-12
        return float(result.slider("run")["s"][-1])
    coarse, fine = end(12), end(24)
    # a bead on a rigid helix slides g sin(slope) t^2/2
    rigid = 0.1 + 0.5 * 9.81 * np.sin(np.arctan(0.1 / (0.4 * np.pi))) * 0.8**2
    print(f"{coarse:.5f} m, {fine:.5f} m, rigid {rigid:.5f} m")
    assert abs(coarse - fine) < 1e-3 * fine and abs(fine - rigid) < 0.1 * rigid


ROPE = fb.Section.circle(radius=0.005, E=1e9, rho=1500)


def test_several_contacts_are_where_fine_meshes_have_them() -> None:
    """Three beads on a hanging cable: 16 and 32 elements that move agree, and meshes that stand still come to them."""
    def run(elements: int, moves: bool) -> np.ndarray:
        cable = fb.Beam.straight("cable", (0, 0, 0), (10, 0, 0), section=ROPE, elements=elements)
        beads = [fb.PointMass(f"m{k}", mass=0.3 + 0.2 * k) for k in range(3)]
        scene = fb.Scene(cable, *beads, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -9.81),
                         *(fb.Slider(f"s{k}", bead, cable, at=2.0 + 2.5 * k) for k, bead in enumerate(beads)))
        result = fb.simulate(fb.compile_scene(fb.with_moving_meshes(scene) if moves else scene), t_end=0.4, step=1e-3,
                             progress=False)
        assert result.drift("total") < 2e-12
        return np.array([result.slider(f"s{k}")["s"][-1] for k in range(3)])

    wanted = run(32, True)
    assert np.max(np.abs(wanted - (2.0, 4.5, 7.0))) > 0.02
    np.testing.assert_allclose(run(16, True), wanted, atol=2e-5)
    # with the error of elements that cannot show a kink
    off = np.abs(run(64, False) - wanted)
    assert 1e-5 < np.max(off) < 5e-3


def test_a_run_ends_where_elements_vanish() -> None:
    """A bead that runs freely meets another that comes towards it at the time of both speeds."""
    cord = fb.Beam.straight("cord", (0, 0, 0), (2, 0, 0), section=ROPE, elements=8)
    places = [(0.5, 2.0), (1.5, -2.0)]
    beads = [fb.PointMass(f"m{k}", mass=0.3) for k in range(len(places))]
    sliders = [fb.Slider(f"s{k}", bead, cord, at=at, rate=rate) for k, (bead, (at, rate)) in enumerate(zip(beads, places))]
    scene = fb.with_moving_meshes(fb.Scene(cord, *beads, *sliders, fb.Clamp(cord.start), fb.Clamp(cord.end)))
    model = fb.compile_scene(scene)
    result = fb.simulate(model, t_end=1.0, step=1e-3, progress=False)
    # up to the least length between contacts, 5e-4 of the beam
    assert result.t[-1] == pytest.approx(0.4995 / 2.0, rel=1e-5)
    event = result.events[-1]
    assert event["kind"] == "slider_end" and event["end"] == "s0" and "sliders 's0' and 's1' met" in event["text"]
    assert result.slider("s0")["s"][-1] == pytest.approx(0.9995, rel=1e-6)
    assert result.drift("total") < 1e-12
    told = "in this step sliders 's0' and 's1' met, so the length.*Use smaller steps"
    with pytest.raises(fb.ConvergenceError, match=told) as failed:
        fb.simulate(model, t_end=1.0, step=0.3, progress=False)
    assert failed.value.result is not None


def test_where_a_scene_lies_changes_neither_its_size_nor_its_mesh() -> None:
    """Places along a beam are nodes that lie nowhere in space; a share of elements that is a half is rounded the same way."""
    sizes, meshes = [], []
    for x in (0.0, 0.1, 1e3):
        beam = fb.Beam.straight("beam", (x, 0.3, 0), (x + 0.9, 0.3 + 1.2 * 0.7, 0.4), section=SECTION, elements=4, degree=3)
        bead = fb.PointMass("bead", mass=0.5)
        slider = fb.Slider("run", bead, beam, at=0.375 * beam.length, rate=0.2, friction=0.1)
        scene = fb.with_moving_meshes(fb.Scene(beam, bead, slider, fb.Clamp(beam.start)))
        sizes.append(fb.compile_scene(scene).length)
        meshes.append(scene.beams[0].n_elements)
    assert np.ptp(sizes) < 1e-12 * 1e3 and sizes[0] < 2.0 and meshes == [4, 4, 4]


def ruler(degree: int, friction: float | None = None) -> fb.Scene:
    """A body that slides along a clamped steel ruler, far stiffer along its axis than across."""
    ends = np.concatenate((np.linspace(0.0, 0.5, 5)[:-1], np.linspace(0.5, 2.0, 9)))
    steel = fb.Section.circle(radius=0.01, E=2e10, rho=2000.0)
    beam = fb.Beam.straight("ruler", (0, 0, 0), (2, 0, 0), section=steel, elements=ends, degree=degree)
    body = fb.RigidBody("body", mass=0.5, inertia=(1e-3, 1e-3, 1e-3), position=(0.5, 0, 0), velocity=(1.2, 0, 0))
    sleeve = fb.Sleeve("run", body, beam, at=0.5, length=0.05 if friction else 0.0, friction=friction, rate=1.2)
    return fb.Scene(beam, body, fb.Clamp(beam.start), fb.Clamp(beam.end), sleeve, fb.MovingMesh(beam, sleeve),
                    gravity=(0, 0, -9.81))


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("friction", [None, 0.2])
def test_elimination_of_inner_nodes_changes_nothing(friction: float | None, planar: str | bool) -> None:
    """Without friction their border is eliminated in the element loop, with it as that of any constraint."""
    runs = [fb.simulate(fb.compile_scene(ruler(3, friction), eliminate_inner=inner, planar=planar), t_end=0.2, step=2e-3,
                        progress=False) for inner in (True, False)]
    (one, other), key = runs, "run"
    assert one.series["iterations"].tolist() == other.series["iterations"].tolist()
    np.testing.assert_allclose(one.phi, other.phi, rtol=0, atol=1e-10)
    np.testing.assert_allclose(one.slider(key)["force"], other.slider(key)["force"], rtol=0, atol=1e-5)


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("degree", [2, 3])
def test_round_off_of_a_stiff_axis_does_no_work(degree: int, planar: str | bool) -> None:
    """Stresses of the element loop and of the forces along the beam would differ in the last bits: 1e-11 of the energy."""
    result = fb.simulate(fb.compile_scene(ruler(degree), planar=planar), t_end=0.4, step=2e-3, progress=False)
    print(f"degree {degree}, planar {planar}: drift {result.drift('total'):.1e}")
    assert result.drift("total") < 1e-12
