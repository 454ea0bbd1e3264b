"""The scene: its lists, positions at t = 0, and every check between parts."""
from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from counted import calls

from fastbeam.interface.errors import SceneError
from fastbeam.scene import (
    BallJoint,
    Beam,
    Clamp,
    DistributedLoad,
    InitialVelocity,
    Load,
    Path,
    Pin,
    PointMass,
    RigidBody,
    RigidConnection,
    RigidMotion,
    Scene,
    Section,
    Slider,
)

BAR = Section.circle(radius=0.01, E=70e9, rho=2700.0)


def make_rail(name="rail", **options):
    return Beam.straight(name, (0, 0, 0), (1.2, 0, 0), section=BAR, **{**dict(elements=4, degree=1), **options})


RAIL = make_rail()
POST = Beam.straight("post", (1.2, 0, 0), (1.2, 0, 1), section=BAR, elements=2, degree=1)
CART = PointMass("cart", mass=1.0)
WHEEL = RigidBody("wheel", mass=2.0, inertia=(1, 1, 2), position=(0.3, 0, 0.5), directors=[(0, 1, 0), (0, 0, 1), (1, 0, 0)])


def refused(text, *parts):
    with pytest.raises(SceneError, match=text):
        Scene(*parts).check()


def test_lists_by_kind_in_the_order_added():
    load, wind = Load("tip", RAIL.end, force=(0, 0, 1)), DistributedLoad("wind", RAIL, force=(1, 0, 0))
    clamp, pin, rigid, ball = Clamp(RAIL.start), Pin(POST.end), RigidConnection(POST.end, WHEEL), BallJoint(RAIL.end, POST.start)
    start, motion, slider = InitialVelocity(RAIL), RigidMotion(), Slider("run", CART, RAIL, at=0.3)
    scene = Scene(POST, load, clamp, RAIL, slider).add(wind, pin, CART).add(rigid, ball, WHEEL, start, motion)
    scene.check()
    assert scene.beams == [POST, RAIL] and scene.bodies == [WHEEL] and scene.masses == [CART]
    assert scene.clamps == [clamp] and scene.pins == [pin] and scene.rigid == [rigid] and scene.balls == [ball]
    assert scene.loads == [load] and scene.distributed == [wind] and scene.velocities == [start] and scene.motions == [motion]
    assert scene.sliders == [slider] and len(scene.parts) == 13


def test_scene_options():
    scene = Scene(RAIL, gravity=[0, 0, -9.81], gravity_time=np.cos, project_velocities=True, name="crane")
    assert scene.gravity.tolist() == [0, 0, -9.81] and scene.gravity_time is np.cos and scene.project_velocities
    assert Scene(RAIL).gravity.tolist() == [0, 0, 0] and not Scene(RAIL).project_velocities
    for options, text in [(dict(gravity=9.81), "scene 'scene': gravity must be 3 finite numbers, got 9.81"),
                          (dict(gravity_time=1.0), "gravity_time must be a function of t"),
                          (dict(project_velocities="yes"), "project_velocities must be True or False, got 'yes'"),
                          (dict(name=""), "scene: name must be a non-empty text")]:
        with pytest.raises(SceneError, match=text):
            Scene(RAIL, **options)


def test_listing_is_short():
    rails = [make_rail(f"r{i}") for i in range(6)]
    assert repr(Scene()) == "<scene 'scene': empty>"
    assert repr(Scene(*rails, WHEEL, Clamp(rails[0].start), Clamp(rails[1].start), name="net", gravity=(0, 0, -9.81))) == (
        "<scene 'net': 6 beams ('r0', 'r1', 'r2', 'r3', ...), 1 body ('wheel'), 2 clamps, gravity (0, 0, -9.81)>")


def test_only_parts_can_be_added():
    with pytest.raises(SceneError, match=r"is not a part of a scene; unpack it: scene\.add\(\*parts\)"):
        Scene([RAIL, CART])
    with pytest.raises(SceneError, match=r"scene 'scene': 3 is not a part of a scene \(Beam, RigidBody"):
        Scene().add(3)


# --- names and members -----------------------------------------------------------------------------------------------------
def test_empty_scene_is_refused():
    refused("scene 'scene' is empty: add at least one Beam, Net, RigidBody or PointMass")


def test_equal_names_are_refused():
    refused("the name 'rail' is used twice, by a beam and a beam", RAIL, make_rail())
    refused("the name 'rail' is used twice, by a beam and a load", RAIL, Load("rail", RAIL.end, force=(0, 0, 1)))
    refused("the name 'run' is used twice, by a load and a slider", RAIL, CART, Load("run", CART, force=(0, 0, 1)),
            Slider("run", CART, RAIL, at=0))
    refused("beam 'rail' was added twice", RAIL, RAIL)
    motion = RigidMotion()
    refused("rigid motion was added twice", RAIL, motion, motion)
    refused("the name \"rigid connection of beam 'rail' node 4 and body 'wheel'\" is used twice", RAIL, WHEEL,
            RigidConnection(RAIL.end, WHEEL), RigidConnection(RAIL.end, WHEEL))


def test_the_same_support_twice_is_allowed():
    clamp = Clamp(RAIL.start)
    scene = Scene(RAIL, clamp, clamp, Clamp(RAIL.start), Pin(RAIL.start), Pin(RAIL.start), Pin(RAIL.end))
    scene.check()
    assert len(scene.clamps) == 3 and len(scene.pins) == 3


@pytest.mark.parametrize(("part", "text"), [
    (Clamp(POST.start), "clamp of beam 'post' node 0: beam 'post' is not in scene 'scene'; add it"),
    (Pin(CART, name="peg"), "pin 'peg': point mass 'cart' is not in scene"),
    (RigidConnection(RAIL.end, WHEEL), "body 'wheel' is not in scene"),
    (BallJoint(POST.start, RAIL.end), "beam 'post' is not in scene"),
    (Load("tip", POST.end, force=(0, 0, 1)), "load 'tip': beam 'post' is not in scene"),
    (DistributedLoad("wind", POST, force=(1, 0, 0)), "distributed load 'wind': beam 'post' is not in scene"),
    (InitialVelocity(POST), "initial velocity of beam 'post': beam 'post' is not in scene"),
    (RigidMotion([RAIL, CART]), "rigid motion: point mass 'cart' is not in scene"),
    (Slider("run", CART, RAIL, at=0), "slider 'run': point mass 'cart' is not in scene"),
    (Slider("run", RAIL.end, POST, at=0), "slider 'run': beam 'post' is not in scene"),
])
def test_parts_must_refer_to_members(part, text):
    refused(text, RAIL, part)


def test_an_equal_beam_is_not_the_member():
    refused("load 'tip': beam 'rail' is not in scene", RAIL, Load("tip", make_rail().end, force=(0, 0, 1)))


def test_interior_control_points_cannot_be_held_or_loaded():
    spline = make_rail(interpolation="bspline", degree=2)
    text = r"beam 'rail' node 2 \(s = 0\.45 m\) is a control point, which does not lie on the beam"
    inner = spline.node(2)
    for part in (Clamp(inner), Pin(inner), BallJoint(WHEEL, inner), Slider("run", inner, POST, at=0),
                 Load("mid", inner, force=(0, 0, 1))):
        refused(text, spline, WHEEL, POST, part)
    Scene(spline, Clamp(spline.start), Pin(spline.end), Load("tip", spline.end, force=(0, 0, 1))).check()


# --- positions -------------------------------------------------------------------------------------------------------------
def test_positions_of_nodes_bodies_and_points():
    scene = Scene(RAIL, WHEEL, PointMass("bob", mass=1, position=(1, 2, 3)))
    assert np.allclose(scene.position_of(RAIL.node(1)), [0.3, 0, 0])
    assert scene.position_of(WHEEL).tolist() == [0.3, 0, 0.5]
    # rows of the triad are d1 = e_y, d2 = e_z, d3 = e_x
    assert np.allclose(scene.position_of(WHEEL.point((1, 2, 3))), [3.3, 1, 2.5])
    assert scene.position_of(scene.masses[0]).tolist() == [1, 2, 3]
    assert scene.position_of(scene.masses[0].center).tolist() == [1, 2, 3]


def test_slider_and_joints_place_a_mass():
    bob = PointMass("bob", mass=1)
    assert np.allclose(Scene(RAIL, bob, Slider("run", bob, RAIL, at=0.7)).position_of(bob), [0.7, 0, 0])
    assert np.allclose(Scene(RAIL, bob, BallJoint(bob, RAIL.end)).position_of(bob), [1.2, 0, 0])
    assert np.allclose(Scene(WHEEL, bob, RigidConnection(WHEEL.point((0, -0.5, 0)), bob)).position_of(bob), [0.3, 0, 0])
    # through another mass
    scene = Scene(RAIL, bob, CART, BallJoint(bob, CART)).add(Slider("run", CART, RAIL, at=0.7))
    scene.check()
    assert np.allclose(scene.position_of(bob), [0.7, 0, 0])
    # a rigid connection beside a slider keeps the distance
    scene = Scene(RAIL, POST, bob, RigidConnection(bob, POST.end), Slider("run", bob, RAIL, at=0.7))
    scene.check()
    assert np.allclose(scene.position_of(bob), [0.7, 0, 0])


def test_a_mass_needs_exactly_one_place():
    bob = PointMass("bob", mass=1)
    refused(r"point mass 'bob' has no position: give position=\(x, y, z\), or place it by a Slider", RAIL, bob)
    refused("point mass 'bob' has no position", bob, CART, BallJoint(bob, CART))
    refused(r"point mass 'bob': slider 'run' and slider 'jump' place it at points 1\.2 m apart", RAIL, bob,
            Slider("run", bob, RAIL, at=0), Slider("jump", bob, RAIL, at=1.2))
    refused(r"point mass 'bob': slider 'run' and ball joint .* place it at points 0\.5 m apart", RAIL, bob,
            Slider("run", bob, RAIL, at=0.7), BallJoint(bob, RAIL.end))
    refused("place it at points 1 m apart; make them agree, or give its position", POST, bob, RigidConnection(bob, POST.start),
            RigidConnection(bob, POST.end))
    Scene(RAIL, POST, bob, Slider("run", bob, RAIL, at=1.2), Slider("lift", bob, POST, at=0)).check()


# --- sliders and joints ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("at", [1.4, -0.1])
def test_slider_outside_its_beam(at):
    refused(rf"slider 'cart run': at={at} lies outside beam 'rail' \(0 to 1\.2 m\)", RAIL, CART,
            Slider("cart run", CART, RAIL, at=at))


def test_slider_on_its_own_beam():
    refused("slider 'loop': beam 'rail' node 4 .* belongs to the beam that it slides on", RAIL,
            Slider("loop", RAIL.end, RAIL, at=0))


def test_slider_off_the_curve_names_the_gap_and_the_cure():
    bob = PointMass("bob", mass=1, position=(0.45, 0, 0))
    refused(r"slider 'run': point mass 'bob' lies 0\.15 m away from beam 'rail' at=0\.3; leave its position out, or "
            r"use at=0\.45, where it lies on the beam", RAIL, bob, Slider("run", bob, RAIL, at=0.3))
    bob = PointMass("bob", mass=1, position=(0.0004, 0, 0.2))
    refused(r"leave its position out, or the beam is closest at s=0\.0004 m, still 0\.2 m away: move the point", RAIL, bob,
            Slider("run", bob, RAIL, at=0.3))
    refused(r"slider 'run': body 'wheel' lies 0\.5 m away from beam 'rail' at=0\.3; the beam is closest", RAIL, WHEEL,
            Slider("run", WHEEL, RAIL, at=0.3))
    Scene(RAIL, WHEEL, Slider("run", WHEEL.point((0, -0.5, 0)), RAIL, at=0.3)).check()
    Scene(RAIL, POST, Slider("run", POST.start, RAIL, at=1.2)).check()


def test_closest_place_on_a_curved_beam():
    arc = Beam.arc("bow", (1, 0, 0), (0, 1, 0), (-1, 0, 0), radius=1, angle=3, section=BAR, elements=3)
    point = arc.reference(np.sqrt(2))[0][0]
    bob = PointMass("bob", mass=1, position=point)
    refused(r"use at=1\.414213562, where it lies", arc, bob, Slider("run", bob, arc, at=0.3))
    # by hand, a little beside it
    near = 1.0003 * point
    s, distance = arc.nearest(near)
    assert s == pytest.approx(np.sqrt(2), rel=1e-13) and distance == pytest.approx(3e-4, rel=1e-9)
    bob = PointMass("bob", mass=1, position=near)
    refused(r"closest at s=1\.414 m, still 0\.0003 m away: move the point to beam\.reference\(s\)\[0\]\[0\], \(0\.155", arc, bob,
            Slider("run", bob, arc, at=s))
    Scene(arc, bob := PointMass("bob", mass=1, position=arc.reference(s)[0][0]), Slider("run", bob, arc, at=s)).check()
    # nearest to an end, and to the middle of an arc from its centre anywhere on it
    assert arc.nearest((2, -1, 0)) == pytest.approx((0.0, np.sqrt(2)))
    assert arc.nearest((0, 0, 1))[1] == pytest.approx(np.sqrt(2), rel=1e-14)
    rail, post = make_rail(), Beam.straight("post", (1.2, 0, 0), (1.2, 0, 1), section=BAR, elements=2, degree=1)
    for wire, place in ((Path("p", [rail, post]), 1.7), (Path("back", [(post, -1), (rail, -1)]), 0.5)):
        assert wire.nearest((1.5, 0, 0.5)) == pytest.approx((place, 0.3), rel=1e-13)


def test_ball_joint_with_a_gap():
    refused(r"ball joint 'hinge': beam 'rail' node 0 \(s = 0 m\) and beam 'post' node 0 \(s = 0 m\) lie 1\.2 m apart at t = 0",
            RAIL, POST, BallJoint(RAIL.start, POST.start, name="hinge"))
    refused("ball joint of body 'wheel' and beam 'rail' node 0: .* use RigidConnection, which allows an offset", RAIL, WHEEL,
            BallJoint(WHEEL, RAIL.start))
    Scene(RAIL, WHEEL, BallJoint(WHEEL.point((0, -0.5, 0)), RAIL.node(1)), RigidConnection(WHEEL, RAIL.end)).check()


def test_gap_tolerance_follows_the_size_of_the_scene():
    def scene(scale, gap):
        a = Beam.straight("a", (0, 0, 0), (scale, 0, 0), section=BAR, elements=1)
        b = Beam.straight("b", (scale * (1 + gap), 0, 0), (2 * scale, 0, 0), section=BAR, elements=1)
        return Scene(a, b, BallJoint(a.end, b.start))

    for scale in (1e-6, 1.0, 1e5):
        scene(scale, 1e-10).check()
        with pytest.raises(SceneError, match="apart at t = 0"):
            scene(scale, 1e-7).check()


def test_a_large_net_is_checked_quickly():
    beams = [Beam.straight(f"b{i}", (i, 0, 0), (i + 1, 0, 0), section=BAR, elements=1, degree=1) for i in range(500)]
    masses = [PointMass(f"m{i}", mass=1) for i in range(500)]
    joints = [BallJoint(m, b.start) for m, b in zip(masses, beams)]
    scene = Scene(*beams, *masses, *joints)
    scene.check()
    assert scene.position_of(masses[499]).tolist() == [499, 0, 0]


def test_nouns_load_no_heavy_library():
    code = ("import sys, fastbeam.scene; "
            "print([m for m in ('numba', 'scipy', 'matplotlib', 'h5py', 'fastbeam.kernels') if m in sys.modules])")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("backwards", [False, True])
def test_long_chain_of_masses_is_placed_from_its_end(backwards):
    def chain(n):
        masses = [PointMass(f"m{k}", mass=1.0) for k in range(n)]
        links = [BallJoint(a, b) for a, b in zip([RAIL.end, *masses[:-1]], masses)]
        return Scene(RAIL, *(masses[::-1] if backwards else masses), *links), masses[-1]

    chain(10)[0].check()
    long, last = chain(3000)
    few, many = calls(chain(300)[0].check), calls(long.check)
    print(f"{few} calls for 300 masses, {many} for 3000")
    assert many < 11 * few
    assert long.position_of(last).tolist() == RAIL.reference(RAIL.length)[0][0].tolist()


def test_chain_of_masses_that_two_ends_place_apart_is_refused():
    masses = [PointMass(f"m{k}", mass=1.0) for k in range(5)]
    links = [BallJoint(a, b) for a, b in zip([RAIL.start, *masses], [*masses, RAIL.end])]
    with pytest.raises(SceneError, match="point mass 'm0': .* and .* place it .* m apart; make them agree"):
        Scene(RAIL, *masses, *links).check()


def test_masses_joined_to_each_other_alone_have_no_place():
    a, b, c = (PointMass(name, mass=1.0) for name in "abc")
    with pytest.raises(SceneError, match="point mass 'a' has no position"):
        Scene(RAIL, a, b, c, BallJoint(a, b), BallJoint(b, c), BallJoint(c, a)).check()


def test_lists_of_parts_follow_what_is_added_and_are_the_callers_own():
    scene = Scene(RAIL)
    assert scene.beams == [RAIL] and scene.masses == []
    scene.beams.append(POST)
    scene.add(CART)
    assert scene.beams == [RAIL] and scene.masses == [CART]
