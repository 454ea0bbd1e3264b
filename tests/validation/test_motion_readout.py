"""Accelerations, spins and triads of points, and stresses of damping in section forces, against exact values and reactions."""
from __future__ import annotations

import warnings

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.results.observe.resultants import Sections

G = np.array([0.0, 0.0, -9.81])
TAU = 0.02


def rates_of(errors):
    return np.log2(np.array(errors[:-1]) / errors[1:])


def ramp(t):
    x = min(t / 0.2, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def soft(**given):
    return fb.Section.circle(radius=0.01, E=1e8, rho=1000.0, damping=TAU, **given)


def cantilever(elements=8, time=ramp, planar="auto", section=None, force=(3.0, -1.0, 0.5), **given):
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section or soft(), elements=elements, **given)
    wall = fb.Clamp(beam.start, name="wall")
    return beam, fb.compile_scene(fb.Scene(beam, wall, fb.Load("tip", beam.end, force=force, time=time)), planar=planar)


def at_root(result, moment=False):
    """Force, or moment, of the root section in axes of space [n, 3]."""
    found = result.section("root")
    return np.einsum("tk,tkc->tc", np.stack([found[x] for x in (("T", "M2", "M3") if moment else ("N", "Q2", "Q3"))], axis=1),
                     result.orientation("root"))


def run(model, beam, step, t_end=0.3, **given):
    observe = ("section", "reaction", "orientation", "energy", "acceleration", *given.pop("more", ()))
    return fb.simulate(model, t_end=t_end, step=step, observe=observe, points={"root": beam.start, "tip": beam.end}, **given)


# --- stresses of damping ---------------------------------------------------------------------------------------------------
def test_the_root_of_a_damped_cantilever_pulls_as_its_clamp_does():
    beam, model = cantilever(elements=20)
    errors, moments = [], []
    for step in (1.6e-2, 8e-3, 4e-3):
        result = run(model, beam, step, every=1)
        wall = result.reaction("wall")
        errors.append(np.max(np.linalg.norm(at_root(result) + wall["force"], axis=1)[1:-1]))
        moments.append(np.max(np.linalg.norm(at_root(result, True) + wall["moment"], axis=1)[1:-1]))
    rates = rates_of(errors), rates_of(moments)
    print("root against clamp, N, N m:", errors, moments, rates)
    assert np.all(rates[0] > 1.8) and np.all(rates[1] > 1.8)
    assert errors[-1] < 2e-3 and moments[-1] < 2e-3
    # without them it is off by a tenth of the load
    shapes = fb.section_forces(model, result.state._replace(v=0.0 * result.state.v), beam, 0.0)
    assert np.linalg.norm(shapes.force[0, 0] + wall["force"][-1]) > 0.05


@pytest.mark.parametrize("kind", ["plane", "green", "coupled", "linear", "spline"])
def test_it_does_with_other_beams(kind):
    D = 1e-2 * soft().C
    D[0, 5] = D[5, 0] = 0.4 * np.sqrt(D[0, 0] * D[5, 5])
    given = {"plane": {"planar": "auto"}, "green": {"strain": "green_lagrange"}, "linear": {"degree": 1, "elements": 60},
             "coupled": {"section": fb.Section.circle(radius=0.01, E=1e8, rho=1000.0, damping=D)},
             "spline": {"interpolation": "bspline", "degree": 3, "elements": 24}}[kind]
    beam, model = cantilever(**{"elements": 16, "planar": False, **given})
    assert (model.plane is not None) == (kind == "plane")
    result = run(model, beam, 4e-3, every=3)
    wall = -result.reaction("wall")["force"]
    off = np.linalg.norm(at_root(result) - wall, axis=1)
    still = fb.section_forces(model, result.state._replace(v=0.0 * result.state.v), beam, 0.0).force[0, 0]
    print(kind, np.max(off), np.linalg.norm(still - wall[-1]))
    assert np.max(off) < 0.02 * np.linalg.norm(still - wall[-1]) + 4e-3
    assert np.linalg.norm(still - wall[-1]) > 0.05


def test_behind_a_sudden_load_rows_do_not_go_up_and_down():
    """Steps that do not resolve axial waves leave velocities that alternate; means over steps do not."""
    beam, model = cantilever(time=None, force=(3.0, -1.0, 0.5))
    result = run(model, beam, 4e-3, every=1, more=("velocity",), output=fb.Output(snapshots=100))
    wall = -result.reaction("wall")["force"]
    off = np.linalg.norm(at_root(result) - wall, axis=1)
    own = np.linalg.norm(fb.section_forces(model, result, beam, 0.0).force[:, 0] - wall, axis=1)
    print("largest errors of rows and of velocities, N:", np.max(off), np.max(own), "of", np.max(np.linalg.norm(wall, axis=1)))
    assert np.max(off) < 0.06 and np.max(own) > 1.0


def bar(elements=6, degree=4):
    section = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0, damping=1e-3)
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=section, elements=elements, degree=degree)
    wave = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0.1 * np.sin(0.5 * np.pi * s), 0.0 * s, 0.0 * s), axis=-1))
    return section, beam, fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), wave))


def test_a_kelvin_voigt_bar_has_its_exact_stress():
    section, beam, model = bar()
    k = 0.5 * np.pi
    w = k * np.sqrt(section.C[0, 0] / section.rhoA)
    decay = 0.5 * 1e-3 * w**2
    w_d = np.sqrt(w**2 - decay**2)
    points = {"root": (beam, 0.0), "middle": (beam, 0.53)}
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        result = fb.simulate(model, t_end=0.02, step=step, every=1, observe=("section",), points=points)
        t = result.t
        q = 0.1 / w_d * np.exp(-decay * t) * np.sin(w_d * t)
        rate = 0.1 * np.exp(-decay * t) * (np.cos(w_d * t) - decay / w_d * np.sin(w_d * t))
        stress = section.C[0, 0] * k * (q + 1e-3 * rate)
        scale = np.max(np.abs(stress))
        errors.append(max(np.max(np.abs(result.section(name)["N"] - np.cos(k * s) * stress)) / scale
                          for name, s in (("root", 0.0), ("middle", 0.53))))
    rates = rates_of(errors)
    print("normal force of the bar, share:", errors, rates)
    assert np.all(rates > 1.9) and np.all(rates < 2.2) and errors[-1] < 2e-3
    # a tenth of it is viscous
    assert np.max(np.abs(1e-3 * rate)) > 0.1 * np.max(np.abs(q))


@pytest.mark.parametrize("interpolation", ["lagrange", "bspline"])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_rigid_motions_have_no_viscous_stress(strain, interpolation):
    beam = fb.Beam.arc("bow", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=2.0, section=soft(), elements=5, strain=strain,
                       interpolation=interpolation)
    model = fb.compile_scene(fb.Scene(beam, fb.RigidMotion(velocity=(1, 2, 3), spin=(2.0, -1.0, 3.0))))
    state = model.state()
    s = np.linspace(0.0, beam.length, 9)
    moving, still = (fb.section_forces(model, x, beam, s) for x in (state, state._replace(v=0.0 * state.v)))
    for a, b, size in ((moving.force, still.force, soft().D[0, 0]), (moving.moment, still.moment, soft().D[0, 0])):
        assert np.max(np.abs(a - b)) < 1e-12 * size * np.sqrt(14.0)
    # over a step with a finite turn, as the step takes it: D d = theta x mean d
    turn = np.array([0.4, -0.3, 0.5])
    spin = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    cayley = np.linalg.solve(np.eye(3) - 0.5 * spin, np.eye(3) + 0.5 * spin)
    q = state.q.reshape(-1, 4, 3)
    end = q @ cayley.T
    rates = Sections(model, beam, s).strain_rates(0.5 * (q + end)[None], (end - q)[None] / 0.1)
    assert np.max(np.abs(rates)) < 1e-12 * 10.0


def test_a_damped_beam_that_spins_has_the_forces_of_one_that_is_not_damped():
    """In steady rotation nothing is viscous: rows with and without damping agree once vibrations have died out."""
    section = fb.Section.circle(radius=0.02, E=1e9, rho=1000.0, damping=0.01)
    beam = fb.Beam.straight("rotor", (-0.5, 0, 0), (0.5, 0, 0), section=section, elements=6)
    model = fb.compile_scene(fb.Scene(beam, fb.RigidMotion(spin=(0, 0, 20.0))))
    result = fb.simulate(model, t_end=2.0, step=2e-3, every=100, observe=("section", "spin"), points={"middle": beam.at(0.5)})
    turn = result.spin("middle")[-1, 2]
    # N = int rho A w^2 x dx to the first order in the strain
    pull = section.rhoA * turn**2 / 8.0
    assert result.section("middle")["N"][-1] == pytest.approx(pull, rel=1e-3)


def test_shapes_have_viscous_forces_where_velocities_are_kept(tmp_path):
    beam, model = cantilever()
    result = run(model, beam, 4e-3, more=("velocity",), output=fb.Output(file=tmp_path / "run.h5", snapshots=8))
    along = fb.section_forces(model, result, beam)
    last = fb.section_forces(model, result.state, beam)
    assert np.allclose(along.force[-1], last.force[0], rtol=0, atol=1e-5 * np.max(np.abs(last.force)))
    assert along.strain_rates.shape == (len(result.t_snap), 9, 6)
    again = fb.load_result(tmp_path / "run.h5")
    assert np.array_equal(again.spins, result.spins)
    assert np.array_equal(fb.section_forces(model, again, beam).force, along.force)
    result.save(tmp_path / "copy.h5")
    assert np.array_equal(fb.load_result(tmp_path / "copy.h5").spins, result.spins)
    plain = run(model, beam, 4e-3, output=fb.Output(snapshots=8))
    with pytest.warns(UserWarning, match="beam 'beam' has damping"):
        still = fb.section_forces(model, plain, beam)
    assert still.strain_rates is None and np.max(np.abs(still.force - along.force)) > 0.05
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fb.section_forces(model, fb.solve_static(model, at_time=1.0), beam)


def test_rows_do_not_depend_on_how_many_there_are():
    beam, model = cantilever()
    every = {k: run(model, beam, 4e-3, every=k, t_end=0.3004) for k in (1, 25)}
    for read in (at_root, lambda x: x.acceleration("tip"), lambda x: x.reaction("wall")["force"]):
        a, b = (read(x) for x in every.values())
        shared = np.isin(every[1].t, every[25].t)
        assert shared.sum() == len(b) == 5
        assert np.allclose(a[shared], b, rtol=1e-6, atol=1e-6 * np.max(np.abs(a)))


def test_the_last_row_of_damped_scenes_is_as_good_as_the_others():
    """Steps back make what was dissipated grow: the last row of reactions was off by more than the load."""
    for extra in (0.0, 1.5e-3):
        beam, model = cantilever()
        result = run(model, beam, 4e-3, t_end=0.3 + extra, every=10)
        longer = run(model, beam, 4e-3, t_end=0.36, every=1)
        k = np.searchsorted(longer.t, result.t[-1])
        for read in (at_root, lambda x: x.acceleration("tip"), lambda x: x.reaction("wall")["force"]):
            value = read(longer)
            share = (result.t[-1] - longer.t[k - 1]) / (longer.t[k] - longer.t[k - 1])
            expected = (1.0 - share) * value[k - 1] + share * value[k]
            assert np.linalg.norm(read(result)[-1] - expected) < 3e-3 * np.max(np.linalg.norm(value, axis=1))


# --- motion of points ------------------------------------------------------------------------------------------------------
def test_a_body_that_spins_has_its_spin_and_centripetal_acceleration():
    spin, r = np.array([0.0, 3.0, 4.0]), np.array([0.3, 0.0, 0.0])
    body = fb.RigidBody("top", mass=2.0, inertia=np.eye(3) * 0.1, position=(1, 2, 3), velocity=(0.5, 0, 0), spin=spin)
    model = fb.compile_scene(fb.Scene(body))
    errors = []
    for step in (2e-2, 1e-2, 5e-3):
        result = fb.simulate(model, t_end=1.0, step=step, every=1, observe=("spin", "orientation", "acceleration"),
                             points={"center": body, "rim": body.point(r)})
        assert np.max(np.abs(result.spin("rim") - spin)) < 1e-12 * 5.0
        assert np.max(np.abs(result.acceleration("center"))) < 1e-10
        arm = result.point("rim") - result.point("center")
        triad = result.orientation("rim")
        assert np.allclose(np.einsum("tkc,k->tc", triad, r), arm, atol=1e-13)
        assert np.allclose(triad @ np.swapaxes(triad, 1, 2), np.eye(3), atol=1e-13)
        exact = np.cross(spin, np.cross(spin, arm))
        errors.append(np.max(np.linalg.norm(result.acceleration("rim") - exact, axis=1)) / (25.0 * 0.3))
    rates = rates_of(errors)
    print("centripetal acceleration, share:", errors, rates)
    assert np.all(rates > 1.9) and errors[-1] < 2e-4


def pendulum():
    angle, length = 1.2, 0.7
    top = fb.PointMass("top", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.5, position=(length * np.sin(angle), 0, -length * np.cos(angle)))
    return fb.compile_scene(fb.Scene(top, bob, fb.Clamp(top), fb.DistanceJoint(top, bob, name="rod"), gravity=G)), length, bob


@pytest.mark.parametrize("every", [1, 20])
def test_the_acceleration_of_a_pendulum_is_of_second_order(every):
    model, length, bob = pendulum()
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        result = fb.simulate(model, t_end=1.203, step=step, every=every, observe=("acceleration", "velocity"),
                             points={"bob": bob})
        x, v = result.point("bob"), result.velocity("bob")
        along = x / length
        exact = G - (np.sum(v**2, axis=1) / length + along @ G)[:, None] * along
        errors.append(np.max(np.linalg.norm(result.acceleration("bob") - exact, axis=1)) / 9.81)
    rates = rates_of(errors)
    print("pendulum, rows at", every, ":", errors, rates)
    assert np.all(rates > 1.8) and errors[-1] < 1e-4


@pytest.mark.parametrize("given", [{}, {"order": 4}, {"tolerance": 1e-6}, {"method": "midpoint"}], ids=str)
def test_what_falls_has_the_acceleration_of_gravity(given):
    body = fb.RigidBody("brick", mass=2.0, inertia=np.diag([0.1, 0.2, 0.3]), position=(0, 0, 0), velocity=(1, 0, 2),
                        spin=(1, 2, 3))
    model = fb.compile_scene(fb.Scene(body, gravity=G))
    result = fb.simulate(model, t_end=0.5, step=1e-2, observe=("acceleration",), points={"brick": body}, **given)
    assert np.max(np.abs(result.acceleration("brick") - G)) < 1e-9


def test_points_of_beams_have_spins_and_triads():
    """A stiff free beam with a rigid motion, at nodes and between them; splines too."""
    bar = fb.Section.circle(radius=0.05, E=1e11, rho=1000.0)
    for interpolation in ("lagrange", "bspline"):
        beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=bar, elements=3, interpolation=interpolation)
        model = fb.compile_scene(fb.Scene(beam, fb.RigidMotion(spin=(0.0, 1.0, 2.0), velocity=(1, 0, 0))))
        result = fb.simulate(model, t_end=0.02, step=1e-4, observe=("spin", "orientation"), every=50,
                             points={"end": beam.end, "between": (beam, 0.37)})
        for name in ("end", "between"):
            assert np.allclose(result.spin(name), (0.0, 1.0, 2.0), atol=1e-5)
            way = result.point("end") - result.point("between")
            d1 = result.orientation(name)[:, 0]
            assert np.allclose(d1, way / np.linalg.norm(way, axis=1)[:, None], atol=1e-6)


def test_accelerations_go_with_impacts_ends_of_beams_checkpoints_and_files(tmp_path):
    wire = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0)

    def scene(stops):
        rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=wire, elements=4)
        bead = fb.PointMass("bead", mass=0.1, position=(1, 0, 0), velocity=(3.0, 0, 0))
        run = fb.Slider("run", bead, rail, at=1.0, rate=3.0, stops=stops)
        return fb.Scene(rail, bead, fb.Clamp(rail.start), fb.Clamp(rail.end), run), bead

    options = {"step": 1e-3, "observe": ("acceleration", "velocity", "energy", "slider")}
    for stops in (None, fb.Stops(0.2, 1.5, restitution=1.0)):
        built, bead = scene(stops)
        model = fb.compile_scene(built)
        result = fb.simulate(model, t_end=0.6, every=17, points={"bead": bead}, **options)
        assert any(event["kind"] == ("slider_end" if stops is None else "impact") for event in result.events)
        assert np.isfinite(result.acceleration("bead")).all()
        plain = fb.simulate(model, t_end=0.6, every=17, step=1e-3)
        assert np.array_equal(plain.state.q, result.state.q)
        assert plain.info["steps"] == result.info["steps"]
    # both before the first impact
    half = fb.simulate(model, t_end=0.08, every=10, points={"bead": bead}, output=fb.Output(checkpoint=tmp_path / "c"), **options)
    rest = fb.simulate(model, t_end=0.16, every=10, points={"bead": bead}, output=tmp_path / "r.h5",
                       start=fb.load_checkpoint(tmp_path / "c"), **options)
    whole = fb.simulate(model, t_end=0.16, every=10, points={"bead": bead}, **options)
    assert np.array_equal(rest.state.q, whole.state.q)
    own = whole.acceleration("bead")[np.isin(whole.t, rest.t)]
    other = rest.acceleration("bead")[np.isin(rest.t, whole.t)]
    assert len(own) > 8 and np.allclose(own[1:], other[1:], rtol=1e-9, atol=1e-9 * np.max(np.abs(own)))
    assert np.array_equal(fb.load_result(tmp_path / "r.h5").acceleration("bead"), rest.acceleration("bead"))
    assert half.checkpoint.mean_force.size == model.n_forces


def test_what_was_not_recorded_is_refused_with_its_name():
    model, _, bob = pendulum()
    result = fb.simulate(model, t_end=0.01, step=1e-3, points={"bob": bob})
    for name, kind in (("spin", "spin"), ("orientation", "orientation"), ("acceleration", "acceleration")):
        with pytest.raises(fb.SceneError, match=rf"observe=\('{kind}'"):
            getattr(result, name)("bob")
    with pytest.raises(fb.SceneError, match="leave 'acceleration' out, or leave method out"):
        fb.simulate(model, t_end=0.01, step=1e-3, points={"bob": bob}, observe=("acceleration",), method="generalized_alpha")
    shown = fb.simulate(model, t_end=0.01, step=1e-3, points={"bob": bob}, observe=("orientation", "acceleration")).to_dataframe()
    assert {"point_directors[bob].d1.x", "point_acceleration[bob].z"} <= set(shown.columns)


def test_equilibria_have_triads_of_points():
    beam, model = cantilever(time=None)
    result = fb.solve_static(model, observe=("orientation", "section"), points={"root": beam.start, "tip": beam.end})
    assert np.allclose(at_root(result)[-1], (3.0, -1.0, 0.5), atol=1e-6)
    assert result.orientation("tip")[-1, 0, 1] < -0.1


def test_power_is_torque_times_spin_and_force_times_velocity():
    """A constant motor against a damper, and a weight that falls, in closed form; order 2 in the distance of rows."""
    inertia, torque, damping = 0.2, 3.0, 0.5
    wheel = fb.RigidBody("wheel", mass=1.0, inertia=np.diag([0.1, inertia, 0.1]), position=(0, 0, 0))
    brick = fb.PointMass("brick", mass=2.0, position=(5, 0, 0))
    hinge = fb.RevoluteJoint(fb.GROUND, wheel, "hinge", axis=(0, 1, 0), torque=torque, damping=damping)
    model = fb.compile_scene(fb.Scene(wheel, brick, hinge, gravity=G))
    errors = []
    for step in (2e-2, 1e-2, 5e-3):
        result = fb.simulate(model, t_end=0.8, step=step, every=1)
        spin = torque / damping * (1.0 - np.exp(-damping * result.t / inertia))
        gravity = [name for name in ("gravity", "loads") if name in result.balance()][0]
        off = (result.power("motor of joint 'hinge'") + torque * spin,
               result.power("damper of joint 'hinge'") - damping * spin**2,
               result.power(gravity) - 2.0 * 9.81**2 * -result.t)
        assert np.max(np.abs(off[2])) < 1e-8
        assert np.max(np.abs(result.power("sum"))) < 1e-8
        errors.append(max(np.max(np.abs(x)) for x in off[:2]) / (torque**2 / damping))
    rates = rates_of(errors)
    print("power, share:", errors, rates)
    assert np.all(rates > 1.7) and errors[-1] < 1e-3
    with pytest.raises(fb.SceneError, match="the balance has no 'nothing'; it has 'kinetic'"):
        result.power("nothing")
    with pytest.raises(fb.SceneError, match="needs three rows"):
        fb.simulate(model, t_end=1e-2, step=1e-2).power("kinetic")
