"""Initial velocities: what connections, supports and sliders do not allow is refused with its size, or projected."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive import Twin  # noqa: E402
from small_scenes import SECTION, drifts, straight  # noqa: E402

Array = np.ndarray


def refused(scene: fb.Scene, message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.compile_scene(scene)


# --------------------------------------------------------------------------------------------------------------- refusals
def test_moving_clamp_and_pin_are_refused_with_the_size_of_the_mismatch() -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    refused(fb.Scene(beam, fb.Clamp(beam.start), fb.RigidMotion(velocity=(0, 3, 4))),
            r"support of beam 'beam' node 0: the initial velocities violate it by 5 m/s; .*project_velocities=True")
    refused(fb.Scene(beam, fb.Clamp(beam.start), fb.InitialVelocity(beam, spin=(0.5, 0, 0))),
            r"support of beam 'beam' node 0 \(rotation\): the initial velocities violate it by 0.5 rad/s")
    refused(fb.Scene(beam, fb.Pin(beam.end), fb.RigidMotion(spin=(0, 0, 2))),
            "support of beam 'beam' node 6: the initial velocities violate it by 6 m/s")


def test_rigid_connection_that_is_torn_apart_is_refused() -> None:
    a, b = straight("a", (0, 0, 0), (1, 0, 0)), straight("b", (1, 0.5, 0), (2, 0.5, 0))
    refused(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), fb.RigidMotion(b, velocity=(0.25, 0, 0))),
            "connection of beam 'b' node 0: the initial velocities violate it by 0.25 m/s")
    # the right velocities of both parts, the spin missing
    refused(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), fb.InitialVelocity(b, spin=(2, 0, 0))),
            r"connection of beam 'b' node 0 \(rotation\): the initial velocities violate it by 2 rad/s; give connected "
            "parts one RigidMotion")


def test_ball_joint_that_is_torn_apart_is_refused() -> None:
    beam = straight("beam", (0, 0, 0), (1, 0, 0))
    body = fb.RigidBody("bob", mass=1.0, inertia=(1, 1, 1), position=(1, 0, -1), velocity=(0.5, 0, 0))
    refused(fb.Scene(beam, body, fb.BallJoint(beam.end, body.point((0, 0, 1)))), "the initial velocities violate it by 0.5 m/s")
    turning = fb.RigidBody("bob", mass=1.0, inertia=(1, 1, 1), position=(1, 0, -1), velocity=(0.5, 0, 0), spin=(0, -0.5, 0))
    model = fb.compile_scene(fb.Scene(beam, turning, fb.BallJoint(beam.end, turning.point((0, 0, 1)))))
    assert np.max(np.abs(model.v0)) == 0.5


def test_slider_that_leaves_its_beam_sideways_is_refused() -> None:
    beam = straight("rail", (0, 0, 0), (3, 0, 0))
    fast = fb.PointMass("cart", mass=1.0, velocity=(7, 0.3, 0.4))
    refused(fb.Scene(beam, fast, fb.Slider("run", fast, beam, at=1.0)),
            "slider 'run': the initial velocities violate it by 0.5 m/s")
    along = fb.PointMass("cart", mass=1.0, velocity=(7, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, along, fb.Slider("run", along, beam, at=1.0)))
    np.testing.assert_array_equal(model.v0[-12:-9], [7, 0, 0])
    refused(fb.Scene(beam, along, fb.Slider("run", along, beam, at=1.0, rate=4.0)),
            r"slider 'run' \(rate 4 m/s against 7 m/s\): the initial velocities violate it by 3 m/s")


def test_mass_without_velocity_moves_with_its_slider() -> None:
    beam, mass = straight("rail", (0, 0, 0), (3, 0, 0)), fb.PointMass("cart", mass=1.0)
    slider = fb.Slider("run", mass, beam, at=1.0, rate=2.0)
    model = fb.compile_scene(fb.Scene(beam, mass, slider, fb.RigidMotion(beam, velocity=(0, 1, 0))))
    np.testing.assert_allclose(model.v0[-12:-9], [2, 1, 0], atol=1e-14)


# ------------------------------------------------------------------------------------------------------------------- gaps
@pytest.mark.parametrize("what", ["body", "eye", "mass", "beam"])
def test_a_point_given_by_nine_digits_slides_without_a_force(what: str) -> None:
    # free flight: no force at all, where a gap that the first step closes makes one of m gap / h^2 for ever
    at = (1.000000000, 0.333333333, 0.666666667)
    beam = fb.Beam.straight("b", (0, 0, 0), (3, 1, 2), section=fb.Section.circle(radius=0.02, E=1e8, rho=1000.0), elements=6,
                            degree=2)
    point: Any
    if what == "mass":
        part = point = fb.PointMass("p", mass=5.0, position=at)
    elif what == "beam":
        part = straight("p", at, (1.0, 0.333333333, 3.0))
        point = part.start
    else:
        arm = np.array([0.0, 0.5, 0.0]) * (what == "eye")
        part = fb.RigidBody("p", mass=5.0, inertia=(1, 1, 1), position=at - arm)
        point = part.point(arm)
    scene = fb.Scene(beam, part, fb.Slider("s", point, beam, at=beam.length / 3), fb.RigidMotion(velocity=(0.1, 0, 0)))
    model = fb.compile_scene(scene, planar=False)
    result = fb.simulate(model, t_end=0.01, step=1e-4, every=1)
    # round-off of positions over h^2, times 5 kg; it was 0.2 to 2.5 N
    assert np.max(np.abs(result.slider("s")["force"])) < 1e-6
    assert result.drift("total") < 1e-13 and np.max(result.series["gap"]) < 1e-14


def test_a_ball_joint_that_a_slider_opens_is_refused() -> None:
    # both say where the mass is, by the shape of the arch; but it slides on a chord
    arch = fb.Beam.arc("arch", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=1.5, section=SECTION, elements=3, degree=1)
    at = arch.reference(0.3)[0][0]
    post, hook = straight("post", tuple(at), tuple(at + (0, 0, 1))), fb.PointMass("hook", mass=1.0)
    refused(fb.Scene(arch, post, hook, fb.Slider("s", hook, arch, at=0.3), fb.BallJoint(post.start, hook, name="ball")),
            "ball: the slider of point mass 'hook' places it 0.0133 m away from the other side of the joint. It lies on the "
            "discrete curve")
    fb.compile_scene(fb.Scene(arch, post, hook, fb.Slider("s", hook, arch, at=0.3)))


def test_two_sliders_that_want_a_point_at_two_places_are_refused() -> None:
    one, two = straight("one", (0, 0, 0), (3, 0, 0)), straight("two", (1, -1, 1e-9), (1, 2, 1e-9))
    eye = fb.PointMass("eye", mass=1.0, position=(1, 0, 0))
    refused(fb.Scene(one, two, eye, fb.Slider("first", eye, one, at=1.0), fb.Slider("second", eye, two, at=1.0)),
            "slider 'first': another slider places point mass 'eye' 1e-09 m off beam 'one' at=1; give positions")


# ------------------------------------------------------------------------------------------------------------- projection
def tangle(seed: int, project: bool = True) -> fb.Scene:
    """Clamp, rigid connection with an offset, ball joint and two sliders; velocities at random, good for nothing."""
    rng = np.random.default_rng(seed)

    def random() -> Array:
        return rng.standard_normal(3)

    a, b = straight("a", (0, 0, 0), (3, 0, 0)), straight("b", (3, 0.5, 0.2), (4, 2, 0.5))
    body = fb.RigidBody("body", mass=2.0, inertia=(0.3, 0.4, 0.5), position=(4, 2, 1), velocity=random(), spin=random())
    bead = fb.PointMass("bead", mass=0.7, velocity=random())
    hook = fb.RigidBody("hook", mass=0.4, inertia=(0.1, 0.2, 0.15), position=(2, 0.3, 0), velocity=random(), spin=random())
    fields = [fb.InitialVelocity(beam, velocity=lambda s, c=random(), d=random(): c + np.outer(np.sin(s), d),
                                 spin=lambda s, c=random(), d=random(): c + np.outer(np.cos(s), d)) for beam in (a, b)]
    return fb.Scene(a, b, body, bead, hook, fb.Clamp(a.start), fb.RigidConnection(a.end, b.start),
                    fb.BallJoint(b.end, body.point((0, 0, -0.5))), fb.Slider("run", bead, a, at=0.8),
                    fb.Slider("hang", hook.point((0, -0.3, 0)), a, at=2.0), *fields, project_velocities=project)


def given_rates(scene: fb.Scene, model: fb.Model) -> Array:
    """Rates [N, 4, 3] of the coordinates that the scene asks for, before any projection."""
    twin = Twin(scene, model)
    v, spin = np.zeros((model.n_nodes, 3)), np.zeros((model.n_nodes, 3))
    for field in scene.velocities:
        at, s = twin.of_beam(field.beam), field.beam.node_s
        v[at], spin[at] = field.velocity_at(s), field.spin_at(s)
    for part in [*scene.bodies, *scene.masses]:
        v[twin.number(part)] = part.velocity
        spin[twin.number(part)] = getattr(part, "spin", np.zeros(3))
    d = model.q0.reshape(-1, 4, 3)[:, 1:]
    return np.concatenate((v[:, None], np.cross(spin[:, None], d)), axis=1)


def test_inconsistent_velocities_are_refused_unless_projection_is_asked_for() -> None:
    refused(tangle(1, project=False), r"violate it by .* or use Scene\(..., project_velocities=True\), which finds compatible "
                                      r"rigid motions")


def spin_of(rates: Array, d: Array) -> Array:
    return 0.5 * np.cross(d, rates[1:]).sum(axis=0)


def test_projected_velocities_satisfy_every_constraint() -> None:
    scene = tangle(2)
    model = fb.compile_scene(scene)
    twin = Twin(scene, model)
    rates, q = model.v0.reshape(-1, 4, 3), model.q0.reshape(-1, 4, 3)
    a, b = scene.beams
    round_off = 1e-12 * np.max(np.abs(rates))
    # rotations stay rotations
    for k in range(model.n_nodes):
        if not any(k == twin.number(mass) for mass in scene.masses):
            np.testing.assert_allclose(rates[k, 1:], np.cross(spin_of(rates[k], q[k, 1:]), q[k, 1:]), rtol=0.0, atol=round_off)
    # clamp
    assert np.max(np.abs(rates[twin.number(a.start)])) == 0.0
    # rigid connection, ball joint, arm of the hook: linear in the coordinates
    assert np.max(np.abs(twin.connected(rates) - rates)) <= round_off
    # sliders: nothing across the tangent
    for slider in scene.sliders:
        first, values, slopes = a.basis.curve(slider.curve).evaluate(slider.at)
        nodes = twin.number(a.start) + int(first[0]) + np.arange(values.shape[1])
        relative = rates[twin.number(slider.point), 0] - values[0] @ rates[nodes, 0]
        tangent = slopes[0] @ q[nodes, 0]
        assert abs(np.linalg.norm(np.cross(relative, tangent))) <= round_off
        assert abs(relative @ tangent) > 1e-2


def test_projection_takes_the_nearest_rigid_motions() -> None:
    """What is taken away is a rigid motion of every part, and does no work with any rigid motions that agree; seven others span
    enough of them."""
    scene = tangle(3)
    model = fb.compile_scene(scene)
    twin = Twin(scene, model)
    arm = twin.number(scene.sliders[1].point)

    def energy(x: Array, y: Array) -> float:
        return float(np.sum(x.reshape(-1, 3) * (twin.mass @ y.reshape(-1, 3))))

    taken = given_rates(scene, model) - model.v0.reshape(-1, 4, 3)
    taken[arm] = 0.0  # a point without mass
    assert energy(taken, taken) > 0.1
    d, most = model.q0.reshape(-1, 4, 3)[:, 1:], np.max(np.abs(taken))
    for beam in scene.beams:
        at, x = twin.of_beam(beam), beam.reference(beam.node_s)[0]
        spin = np.array([spin_of(rates, triad) for rates, triad in zip(taken[at], d[at])])
        np.testing.assert_allclose(spin, np.broadcast_to(spin[0], spin.shape), atol=1e-11 * most)
        np.testing.assert_allclose(taken[at, 0], taken[at, 0][:1] + np.cross(spin[0], x - x[0]), atol=1e-11 * most)
    seen = 0
    for seed in range(4, 14):
        parts = [part for part in tangle(seed).parts if not isinstance(part, fb.InitialVelocity)]
        motions = [fb.RigidMotion(part, velocity=x[:3], spin=x[3:]) for part, x in zip(
            parts, np.random.default_rng(seed).standard_normal((5, 6))) if isinstance(part, fb.Beam)]
        other = fb.compile_scene(fb.Scene(*parts, *motions, project_velocities=True))
        if "strain rate" in str(other.notes):
            continue  # supports would have stopped the parts
        seen, rigid = seen + 1, other.v0.reshape(-1, 4, 3)
        assert abs(energy(taken, rigid)) <= 1e-11 * np.sqrt(energy(taken, taken) * energy(rigid, rigid))
    assert seen >= 7


def crank_drive(*more: object, **options: object) -> tuple[fb.Scene, fb.Beam]:
    """Slider and crank with a flexible rod, driven at 50 rad/s from the start."""
    section = fb.Section.rectangle(height=0.01, width=0.01, E=210e9, rho=7850.0)
    crank = fb.RigidBody("crank", mass=0.3, inertia=(1e-4, 1e-3, 1e-3), position=(0.075, 0, 0))
    rod = fb.Beam.straight("rod", (0.15, 0, 0), (0.6, 0, 0), section=section, elements=6)
    piston = fb.RigidBody("piston", mass=0.5, inertia=(1e-3, 1e-3, 1e-3), position=(0.6, 0, 0))
    ends = crank.point((-0.075, 0, 0)), crank.point((0.075, 0, 0))
    return fb.Scene(crank, rod, piston, fb.RevoluteJoint(fb.GROUND, ends[0], "motor", axis=(0, 1, 0), speed=50.0),
                    fb.RevoluteJoint(ends[1], rod.start, "pin A", axis=(0, 1, 0)),
                    fb.RevoluteJoint(rod.end, piston, "pin B", axis=(0, 1, 0)),
                    fb.PrismaticJoint(fb.GROUND, piston, "guide", axis=(1, 0, 0)), *more, **options), rod


def test_a_projection_bends_no_rod_where_rigid_motions_agree() -> None:
    """The crank turns at 50 rad/s and the rod about the piston, at -50 * 0.15/0.45; the norm of the masses alone left it a blow
    of 717 MPa."""
    refused(crank_drive()[0], r"'motor' \(drive\): the initial velocities violate it by 50 rad/s; let its function begin with "
                              r"zero velocity, or give the parts that it moves their velocities \(RigidMotion\), or use Scene")
    scene, rod = crank_drive(project_velocities=True)
    model = fb.compile_scene(scene)
    at = model.numbers.span(rod)
    v, q = (x.reshape(-1, 4, 3)[at] for x in (model.v0, model.q0))
    spin = np.array([0.0, -50.0 * 0.15 / 0.45, 0.0])
    np.testing.assert_allclose(v[:, 0], np.cross(spin, q[:, 0] - (0.6, 0, 0)), rtol=0, atol=7.5e-11)
    np.testing.assert_allclose(v[:, 1:], np.cross(spin, q[:, 1:]), rtol=0, atol=16.7e-11)
    assert "strain rate" not in str(model.notes) and "the kinetic energy changes from 0 to" in str(model.notes)


def test_a_projection_says_which_beam_it_bends() -> None:
    # one end stands, the other is pulled at 1 m/s: nothing rigid agrees
    rod = straight("rod", (0, 0, 0), (1, 0, 0), elements=4)
    parts = rod, fb.Clamp(rod.start), fb.PrescribedMotion("pull", rod.end, displacement=lambda t: (t, 0, 0))
    model = fb.compile_scene(fb.Scene(*parts, project_velocities=True))
    x, v = (y.reshape(-1, 4, 3)[:, 0, 0] for y in (model.q0, model.v0))
    assert v[0] == 0.0 and abs(v[-1] - 1.0) < 1e-15
    # quadratic elements with two points of quadrature
    rates = [np.polyval(np.polyder(np.polyfit(x[k:k + 3], v[k:k + 3], 2)), x[k + 1] + s * 0.125 / np.sqrt(3.0))
             for k in range(0, len(x) - 2, 2) for s in (-1, 1)]
    assert f"'rod' node 6 begins with a strain rate of {np.max(np.abs(rates)):.3g} 1/s" in str(model.notes)
    # and what hangs on a support that moves goes along
    free = fb.compile_scene(fb.Scene(rod, parts[2], project_velocities=True))
    np.testing.assert_allclose(free.v0.reshape(-1, 4, 3)[:, 0], np.broadcast_to((1.0, 0, 0), (rod.n_nodes, 3)), atol=1e-12)


@pytest.mark.parametrize("turned", [0.0, 0.6, 2.2])
def test_what_supports_stop_does_not_depend_on_the_directions_of_space(turned: float) -> None:
    """A load on a rope whose other end is pinned: thrown along it, or nearly so, it goes on and the rope bends; thrown aside it
    keeps what is across the rope, sin(x) of it, but for the inertia of the rope, m/3."""
    along, across = np.array([np.sin(turned), 0, -np.cos(turned)]), np.array([np.cos(turned), 0, np.sin(turned)])
    for x, wanted in ((0.0, (1.0, 0.0)), (0.09, (np.cos(0.09), np.sin(0.09))), (0.11, (0.0, np.sin(0.11))),
                      (1.0, (0.0, np.sin(1.0)))):
        section = fb.Section.circle(radius=0.005, E=1e9, rho=1000.0)
        rope = fb.Beam.straight("rope", (0, 0, 0), along, section=section, elements=3)
        load = fb.PointMass("load", mass=100.0, position=along, velocity=np.cos(x) * along + np.sin(x) * across)
        model = fb.compile_scene(fb.Scene(rope, load, fb.Pin(rope.start), fb.BallJoint(rope.end, load), project_velocities=True))
        v = model.v0.reshape(-1, 4, 3)[model.numbers.number(load.center), 0]
        np.testing.assert_allclose((v @ along, v @ across), wanted, rtol=0, atol=4e-4)


def struck(mass: float = 0.0, far: float = 50.0) -> fb.Scene:
    """A bead that hits a wire sideways, both free; a body of `mass` that nothing touches."""
    wire = fb.Beam.straight("wire", (0, 0, 0), (1, 0, 0), section=fb.Section.circle(radius=0.002, E=2e11, rho=7850.0), elements=4,
                            degree=2)
    bead = fb.PointMass("bead", mass=0.02, velocity=(0, 0, 1.0))
    parts = [wire, bead, fb.Slider("s", bead, wire, at=0.5)]
    if mass:
        parts.append(fb.RigidBody("far away", mass=mass, inertia=(mass, mass, mass), position=(far, 0, 0)))
    return fb.Scene(*parts, project_velocities=True)


def test_projection_weighs_by_the_masses_alone() -> None:
    alone = fb.compile_scene(struck(), planar=False).v0.reshape(-1, 4, 3)
    scene = struck()
    model = fb.compile_scene(scene, planar=False)
    mass = Twin(scene, model).mass
    assert 0.0 < alone[-1, 0, 2] < 1.0
    for heavy in (1e2, 1e8, 1e-9):
        found = fb.compile_scene(struck(heavy), planar=False).v0.reshape(-1, 4, 3)
        np.testing.assert_allclose(np.delete(found, 9, axis=0), alone, rtol=0.0, atol=1e-13)
    momentum = float(np.sum((mass @ alone.reshape(-1, 3)).reshape(-1, 4, 3)[:, 0, 2]))
    assert abs(momentum - 0.02) < 1e-15


def test_projection_says_what_it_changed() -> None:
    model = fb.compile_scene(struck())
    fall = 1.0 - model.v0.reshape(-1, 4, 3)[-1, 0, 2]
    energy = 0.01 * (1.0 - fall)
    assert abs(1.0 - fall - 0.02 / (0.02 + 7850.0 * np.pi * 0.002**2)) < 1e-12
    says = (f"the initial velocities were projected: velocities change by up to {fall:.6g} m/s at point mass 'bead', and the "
            f"kinetic energy changes from 0.01 to {energy:.6g} J")
    assert says in str(model)
    result = fb.simulate(model, t_end=0.002, step=0.001)
    assert [(e["kind"], e["time"], e["text"]) for e in result.events] == [("projected", 0.0, says)]
    # it belongs to the initial state: a run that goes on from another has none
    assert not fb.simulate(model, start=result.checkpoint, t_end=0.004, step=0.001).events
    moving = fb.RigidMotion(velocity=(1, 0, 0))
    plain = fb.compile_scene(fb.Scene(straight("b", (0, 0, 0), (1, 0, 0)), moving, project_velocities=True))
    assert "projected" not in str(plain) and not fb.simulate(plain, t_end=0.002, step=0.001).events


def test_velocities_that_no_projection_makes_consistent_are_refused() -> None:
    beam = straight("rail", (0, 0, 0), (3, 0, 0))
    cart = fb.PointMass("cart", mass=1.0)
    refused(fb.Scene(beam, cart, fb.Slider("run", cart, beam, at=1.5, rate=2.0), fb.Pin(cart), fb.Clamp(beam.start),
                     fb.Clamp(beam.node(2)), fb.Clamp(beam.node(4)), fb.Clamp(beam.node(3)), project_velocities=True),
            "no initial velocities satisfy all connections, supports and sliders; .* remain after projection. Change the rate")


def test_projection_leaves_consistent_velocities_alone() -> None:
    a, b = straight("a", (0, 0, 0), (3, 0, 0)), straight("b", (3, 0.5, 0.2), (4, 2, 0.5))
    parts = (a, b, fb.RigidConnection(a.end, b.start), fb.RigidMotion(velocity=(1, 2, 3), spin=(0.3, -0.2, 0.5)))
    plain, projected = (fb.compile_scene(fb.Scene(*parts, project_velocities=flag)) for flag in (False, True))
    np.testing.assert_array_equal(projected.v0, plain.v0)


def test_projected_scene_runs_and_keeps_its_gap() -> None:
    model = fb.compile_scene(tangle(4))
    result = fb.simulate(model, t_end=0.02, step=0.001)
    assert drifts(result)["gap"] <= 1e-12
    assert drifts(result)["total"] <= 1e-12
    clamp = result.state.q[:12] - model.q0[:12]
    assert np.max(np.abs(clamp)) == 0.0


def test_velocities_whose_squares_are_lost_are_none() -> None:
    # 3e-256 m/s: every scale made of squares is zero beside it
    rail = fb.Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=fb.Section.circle(radius=0.01, E=1e9, rho=1e3), elements=2)
    bead = fb.PointMass("bead", mass=0.1)
    scene = fb.Scene(rail, bead, fb.Clamp(rail.start), fb.Slider("run", bead, rail, at=0.4, rate=3e-256), gravity=(0, -9.81, 0))
    model = fb.compile_scene(scene, planar=True)
    assert not model.v0.any()


@pytest.mark.parametrize("rate", [1.0, 0.3, 1e-4])
@pytest.mark.parametrize("slides", ["mass", "beam"])
def test_a_rate_alone_sets_a_scene_at_rest_in_motion(rate: float, slides: str) -> None:
    """Nothing but the rate of a slider is not zero: its size, not 0, is what round-off counts against."""
    rail = straight("rail", (0, 0, 0), (3, 0, 0))
    cart = fb.PointMass("cart", mass=1.0, velocity=(0, 0, 0))
    other = straight("other", (1.5, 0, 0), (1.5, 0, 1))
    parts = [cart] if slides == "mass" else [other]
    slider = fb.Slider("run", cart if slides == "mass" else other.start, rail, at=1.5, rate=rate)
    scene = fb.Scene(rail, *parts, slider, fb.Clamp(rail.start), fb.Pin(rail.end, axes="yz"), project_velocities=True)
    model = fb.compile_scene(scene)
    v = model.v0.reshape(-1, 4, 3)
    contact = v[model.numbers.number(slider.point), 0] - v[model.numbers.start(rail) + 3, 0]
    assert rail.node_s[3] == 1.5
    np.testing.assert_allclose(contact, (rate, 0, 0), rtol=0, atol=1e-13 * rate)
    assert np.array_equal(v[0], np.zeros((4, 3))) and "the kinetic energy changes from 0 to" in str(model.notes)
    # linear in the rate
    one = fb.compile_scene(fb.Scene(*(p for p in scene.parts if p is not slider), fb.Slider(
        "run", slider.point, rail, at=1.5, rate=2.0 * rate), project_velocities=True))
    np.testing.assert_allclose(one.v0, 2.0 * model.v0, rtol=0, atol=1e-12 * rate)
    result = fb.simulate(model, t_end=0.02, step=0.001, progress=False)
    # the energy goes with the square of the rate, its round-off does not
    assert drifts(result)["total"] <= 5e-12 / rate**2 and drifts(result)["gap"] <= 1e-12


def test_a_mass_on_the_reference_of_a_curved_beam_is_moved_onto_its_curve() -> None:
    """Interpolation is exact at nodes only; a mass beside the beam is refused."""
    arc = fb.Beam.arc("arc", (0, 0, 0), (1, 0, 0), (0, 0, 1), radius=2.0, angle=1.2, section=SECTION, elements=6)
    given = arc.reference(1.111)[0][0]

    def on_the_arc(position: np.ndarray) -> tuple[fb.Model, int]:
        mass = fb.PointMass("mass", mass=1.0, position=position)
        model = fb.compile_scene(fb.Scene(arc, mass, fb.Clamp(arc.start), fb.Slider("run", mass, arc, at=1.111)))
        return model, model.numbers.start(mass)

    model, node = on_the_arc(given)
    off = np.linalg.norm(model.q0.reshape(-1, 4, 3)[node, 0] - given)
    assert 1e-9 < off < 1e-6
    assert fb.simulate(model, t_end=0.02, step=1e-2, progress=False).series["gap"].max() < 1e-12
    with pytest.raises(fb.SceneError, match="1e-07 m away from beam 'arc'"):
        on_the_arc(given + (0, 0, 1e-7))
