"""Sleeves on elements that move with them (theory.md 5.12): invariants, a rigid rod in a body that turns and the force that a
bent rod drives a sleeve with (both exact), telescopes, and meshes that stand still, which come to the same."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb
from perf.cases.moving_mesh import ROD as SECTION
from perf.cases.moving_mesh import driven

Array = np.ndarray


def drifts(result: fb.Result) -> float:
    return max(result.drift(x) for x in ("total", "lin_mom", "ang_mom"))


def flight(elements: int, keyed: bool = True, **sleeve: object) -> fb.Scene:
    """A body that slides along a rod of 4 m which it bends, both fly freely."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (4, 0, 0), section=SECTION, elements=elements)
    body = fb.RigidBody("body", mass=0.7, inertia=(0.05, 0.08, 0.1), position=(1.3, 0, 0), velocity=(0.9, 0, 0), spin=(0.8, 0, 0))

    def velocity(s: Array) -> Array:
        return np.stack((0 * s, 1.2 * np.sin(0.5 * np.pi * s), -0.6 * np.cos(0.5 * np.pi * s)), axis=1)

    return fb.Scene(rod, body, fb.InitialVelocity(rod, velocity=velocity),
                    fb.Sleeve("sleeve", body, rod, at=1.3, rate=0.9, keyed=keyed, **sleeve), project_velocities=True)


@pytest.mark.parametrize("keyed", [True, False])
@pytest.mark.parametrize("order", [2, 4])
def test_invariants_in_flight(order: int, keyed: bool) -> None:
    model = fb.compile_scene(fb.with_moving_meshes(flight(8, keyed)))
    result = fb.simulate(model, t_end=1.0, step=0.01, order=order, progress=False)
    s = result.slider("sleeve")["s"]
    print(f"order {order}, keyed {keyed}: drift {drifts(result):.1e}, s from {s.min():.3g} to {s.max():.3g} m")
    assert drifts(result) < 1e-12 and np.ptp(s) > 0.3


def test_there_and_back() -> None:
    model = fb.compile_scene(fb.with_moving_meshes(flight(6)))
    there = fb.simulate(model, t_end=0.5, step=0.01, progress=False)
    back = there.state._replace(v=-there.state.v, history=-there.state.history)
    again = fb.simulate(model, start=back, t_end=0.5, step=0.01, progress=False).state
    print("there and back:", np.max(np.abs(again.q - model.q0)))
    assert np.max(np.abs(again.q - model.q0)) < 1e-11


@pytest.mark.parametrize("keyed", [True, False])
def test_finer_meshes_agree_and_those_that_stand_still_come_to_them(keyed: bool) -> None:
    def place(elements: int, moves: bool) -> float:
        scene = flight(elements, keyed) if moves else flight(elements, keyed, length=0.0)
        model = fb.compile_scene(fb.with_moving_meshes(scene) if moves else scene, planar=False)
        return float(fb.simulate(model, t_end=0.6, step=2e-3, progress=False).slider("sleeve")["s"][-1])

    wanted = place(24, True)
    off = abs(place(12, True) - wanted), abs(place(12, False) - wanted), abs(place(24, False) - wanted)
    print(f"keyed {keyed}: s off by {off[0]:.1e} m with 12 elements that move, {off[1]:.1e}, {off[2]:.1e} with 12, 24 that stand")
    assert off[0] < 7e-4 and max(off[1:]) < 3e-3


def test_a_stiff_rod_in_a_body_that_turns() -> None:
    """With the distance r of the two centres (J + I + mu r^2) w is kept, and r'' = w^2 r."""
    stiff = fb.Section(EA=1e7, GA2=4e6, GA3=4e6, GJ=1e5, EI2=1e5, EI3=1e5, rhoA=0.5, rhoI2=1e-4, rhoI3=1e-4)
    w, r, mass, own = 2.0, 0.3, 1.5, 0.2
    rod = fb.Beam.straight("rod", (-1.0, 0, 0), (1.0, 0, 0), section=stiff, elements=4)
    body = fb.RigidBody("body", mass=mass, inertia=(0.1, 0.15, own), position=(r, 0, 0))
    scene = fb.Scene(rod, body, fb.Sleeve("sleeve", body, rod, at=1.0 + r), fb.RigidMotion((rod, body), spin=(0, 0, w)))
    result = fb.simulate(fb.compile_scene(fb.with_moving_meshes(scene)), t_end=0.6, step=5e-4, progress=False)
    m, inertia = 0.5 * 2.0, own + 0.5 * 2.0**3 / 12 + 2.0 * 1e-4
    mu = m * mass / (m + mass)
    kept = (inertia + mu * r * r) * w
    exact = solve_ivp(lambda t, y: (y[1], (kept / (inertia + mu * y[0]**2))**2 * y[0]), (0, 0.6), (r, 0.0), rtol=1e-11,
                      atol=1e-12)
    s = result.slider("sleeve")["s"][-1]
    print(f"s = {s:.7f} m, exact {1.0 + exact.y[0, -1]:.7f} m; drift {drifts(result):.1e}")
    assert abs(s - 1.0 - exact.y[0, -1]) < 3e-6 and s > 1.5 and drifts(result) < 1e-11


@pytest.mark.parametrize(("at", "force"), [(1.0, 0.0), (1.04, 2.0), (1.13, 0.0)])
def test_a_bent_rod_drives_a_sleeve_with_the_same_force_everywhere(at: float, force: float) -> None:
    """`python perf/cases/moving_mesh.py driven`: at 20 places, and elements that stand, which are off by percents."""
    found, exact = driven(at, True, force)
    print(f"at {at} m: {found:.9f} N, exact {exact:.9f} N")
    assert abs(found / exact - 1.0) < 2e-7


def telescope(elements: int) -> fb.Scene:
    """A rod in a tube, both flexible: the end of the tube holds the rod, the start of the rod runs within the tube."""
    tube = fb.Beam.straight("tube", (0, 0, 0), (2, 0, 0), section=SECTION, elements=elements)
    rod = fb.Beam.straight("rod", (1.2, 0, 0), (3.2, 0, 0), section=SECTION, elements=elements)

    def velocity(s: Array) -> Array:
        return np.stack((0 * s, 0.4 * s**2, 0 * s), axis=1)

    return fb.Scene(tube, rod, fb.Sleeve("mouth", tube.end, rod, at=0.8), fb.Sleeve("foot", rod.start, tube, at=1.2, keyed=False),
                    fb.InitialVelocity(rod, velocity=lambda s: np.stack((0.5 + 0 * s, 0 * s, 0.3 * s**2), axis=1)),
                    fb.InitialVelocity(tube, velocity=velocity), project_velocities=True)


def test_a_telescope_of_two_sleeves() -> None:
    """Each beam has a mesh that moves with the end of the other."""
    result = fb.simulate(fb.compile_scene(fb.with_moving_meshes(telescope(6))), t_end=0.5, step=5e-3, progress=False)
    finer = fb.simulate(fb.compile_scene(fb.with_moving_meshes(telescope(12))), t_end=0.5, step=5e-3, progress=False)
    mouth, foot = (result.slider(name)["s"] for name in ("mouth", "foot"))
    off = max(abs(result.slider(name)["s"][-1] - finer.slider(name)["s"][-1]) for name in ("mouth", "foot"))
    print(f"drift {drifts(result):.1e}; s {mouth[-1]:.4f}, {foot[-1]:.4f} m; with twice as many elements off by {off:.1e} m")
    # the foot goes out as the mouth runs along the rod
    assert drifts(result) < 1e-12 and mouth[-1] < 0.75 and foot[-1] > 1.25 and off < 1e-3
    assert abs((0.8 - mouth[-1]) - (foot[-1] - 1.2)) < 0.02


@pytest.mark.parametrize("keyed", [True, False])
@pytest.mark.parametrize("joint", [{}, {"stiffness": 3.0, "damping": 0.2}, {"friction": 0.3}, {"torque": 2.0}], ids=str)
def test_in_a_mechanism(keyed: bool, joint: dict[str, float]) -> None:
    """A rod in a hub on a hinge, with a body on a cardan joint and a mass on a string at its end."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SECTION, elements=6)
    hub = fb.RigidBody("hub", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(1, 0, 0))
    tip = fb.RigidBody("tip", mass=0.5, inertia=(0.02, 0.03, 0.03), position=(3.2, 0, 0))
    bob = fb.PointMass("bob", mass=0.4, position=(3.2, 0, -0.5))

    def run(elements: int, moves: bool) -> fb.Result:
        beam = rod if elements == 6 else fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SECTION, elements=elements)
        scene = fb.Scene(beam, hub, tip, bob, fb.RevoluteJoint(fb.GROUND, hub, "hinge", axis=(0, 1, 0), **joint),
                         fb.UniversalJoint(beam.end, tip.point((-0.2, 0, 0)), "cardan", axis_a=(0, 1, 0), axis_b=(0, 0, 1)),
                         fb.DistanceJoint(tip, bob, "string"), fb.Sleeve("sleeve", hub, beam, at=1.0, keyed=keyed, length=0.0),
                         gravity=(0, 0.5, -9.81))
        model = fb.compile_scene(fb.with_moving_meshes(scene) if moves else scene)
        return fb.simulate(model, t_end=0.3, step=2e-3, observe=("energy", "slider", "joint"), progress=False)

    moving, standing = run(6, True), run(24, False)
    name = "balance" if joint else "total"
    off = abs(moving.slider("sleeve")["s"][-1] - standing.slider("sleeve")["s"][-1])
    turned = abs(moving.joint("hinge")["angle"][-1] - standing.joint("hinge")["angle"][-1])
    print(f"{joint}: {name} {moving.drift(name):.1e}; s off by {off:.1e} m, angle by {turned:.1e} rad")
    assert moving.drift(name) < 1e-12 and off < 5e-4 and turned < 1e-3


def test_reactions_are_those_of_meshes_that_stand() -> None:
    """Force and moment on a holder whose point lies beside its centre."""
    def run(elements: int, moves: bool) -> dict[str, Array]:
        rod = fb.Beam.straight("rod", (0, 0, 0), (4, 0, 0), section=SECTION, elements=elements)
        body = fb.RigidBody("body", mass=0.7, inertia=(0.05, 0.08, 0.1), position=(1.3, 0.4, 0))
        scene = fb.Scene(rod, body, fb.Clamp(rod.start), fb.Sleeve("sleeve", body.point((0, -0.4, 0)), rod, at=1.3, length=0.0),
                         fb.Load("push", body, moment=(3, 1, 2), time=lambda t: t * t))
        model = fb.compile_scene(fb.with_moving_meshes(scene) if moves else scene, planar=False)
        return fb.simulate(model, t_end=0.5, step=5e-3, observe=("slider", "reaction"), progress=False).slider("sleeve")

    moving, standing = run(8, True), run(32, False)
    for key in ("force", "moment"):
        size = float(np.max(np.abs(standing[key][-20:-2])))
        off = float(np.max(np.abs(moving[key][-20:-2] - standing[key][-20:-2])))
        print(f"{key}: {size:.3g}, off by {off:.1e}")
        assert off < 0.1 * size


def test_what_sleeves_on_moving_meshes_refuse() -> None:
    scene = flight(4)
    arc = fb.Beam.arc("arc", (1, 0, 0), (0, 1, 0), (-1, 0, 0), radius=1.0, angle=1.6, section=SECTION, elements=8)
    holder = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=arc.reference(0.5 * arc.length)[0][0])
    rubbing = fb.Sleeve("rubs", holder, arc, at=0.5 * arc.length, friction=0.1, length=0.3)
    with pytest.raises(fb.SceneError, match="on a curved beam lies"):
        fb.MovingMesh(arc, rubbing)
    with pytest.raises(fb.SceneError, match="has a bore of length=0.3 m"):
        fb.with_moving_meshes(flight(4, length=0.3))
    rod, body = scene.beams[0], scene.bodies[0]
    with pytest.raises(fb.SceneError, match="has a bore of length=1 m .* give length=0"):
        fb.MovingMesh(rod, fb.Sleeve("sleeve", body, rod, at=1.3))
