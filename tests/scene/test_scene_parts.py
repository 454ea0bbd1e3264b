"""Masses, bodies, supports, joints, loads, velocities and sliders: what they keep and what they refuse."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.interface.errors import SceneError
from fastbeam.scene import (
    BallJoint,
    Beam,
    Clamp,
    DistributedLoad,
    InitialVelocity,
    Load,
    Pin,
    PointMass,
    RigidBody,
    RigidConnection,
    RigidMotion,
    Section,
    Slider,
)

BAR = Section.circle(radius=0.01, E=70e9, rho=2700.0)
BOOM = Beam.straight("boom", (0, 0, 0), (2, 0, 0), section=BAR, elements=4, degree=1)
CART = PointMass("cart", mass=1.0)
WHEEL = RigidBody("wheel", mass=2.0, inertia=(1, 1, 2), position=(0, 0, 1))


def body(**options):
    return RigidBody("b", **{**dict(mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0)), **options})


# --- masses and bodies ------------------------------------------------------------------------------------------------------
def test_point_mass_keeps_read_only_vectors():
    mass = PointMass("m", mass=2, position=[1, 2, 3], velocity=np.array([0, 0, 1]))
    assert mass.mass == 2.0 and mass.position.tolist() == [1, 2, 3] and mass.velocity.tolist() == [0, 0, 1]
    assert str(mass.center) == "point mass 'm'" and mass.center.is_center
    with pytest.raises(ValueError, match="read-only"):
        mass.position[0] = 5.0
    assert CART.position is None and CART.velocity is None


@pytest.mark.parametrize(("options", "text"), [
    (dict(mass=0), "mass must be a finite number > 0 kg, got 0"),
    (dict(mass=np.nan), "mass must be a finite number > 0 kg, got nan"),
    (dict(mass=1, position=(1, 2)), r"position must be 3 finite numbers, got \(1, 2\)"),
    (dict(mass=1, velocity="abc"), "velocity must be 3 finite numbers, got 'abc'"),
    (dict(mass=1, velocity=(1, 2, np.inf)), r"velocity must be 3 finite numbers, got \(1, 2, inf\)"),
])
def test_point_mass_arguments_are_checked(options, text):
    with pytest.raises(SceneError, match="point mass 'm': " + text):
        PointMass("m", **options)


def test_body_defaults_and_points():
    wheel = WHEEL
    assert np.array_equal(wheel.inertia, np.diag([1, 1, 2])) and np.array_equal(wheel.directors, np.eye(3))
    assert wheel.velocity.tolist() == wheel.spin.tolist() == [0, 0, 0]
    rim = wheel.point((0.1, 0, -0.5))
    assert rim.owner is wheel and rim.index == 0 and rim.offset.tolist() == [0.1, 0, -0.5] and not rim.is_center
    assert str(rim) == "body 'wheel' at offset (0.1, 0, -0.5) m" and str(wheel.center) == "body 'wheel'"
    assert rim == wheel.point((0.1, 0, -0.5)) != wheel.center


def test_rods_and_lamina_are_bodies():
    assert body(inertia=(0, 1, 1)).inertia[0, 0] == 0.0
    assert body(inertia=(1, 2, 3)).inertia[2, 2] == 3.0
    full = np.array([[2.0, 0.1, 0.2], [0.1, 2.5, 0.3], [0.2, 0.3, 3.0]])
    assert np.array_equal(body(inertia=full).inertia, full)


def test_slightly_rounded_directors_are_cleaned():
    root = 0.7071068
    rows = body(directors=[(root, root, 0), (-root, root, 0), (0, 0, 1)]).directors
    assert np.max(np.abs(rows @ rows.T - np.eye(3))) < 5e-16


@pytest.mark.parametrize(("options", "text"), [
    (dict(mass=-1), "mass must be a finite number > 0 kg"),
    (dict(position=None), "position must be 3 finite numbers, got None"),
    (dict(inertia=(1, 1)), "inertia must be 3 finite principal moments or a finite 3 x 3 tensor"),
    (dict(inertia=(1, 1, np.nan)), "inertia must be 3 finite numbers"),
    (dict(inertia=(-1, 1, 1)), "inertia must not be negative, its smallest principal moment is -1 kg m"),
    (dict(inertia=(1, 1, 3)), r"no body has the principal moments \(1, 1, 3\) kg m\^2"),
    (dict(inertia=[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), r"inertia must be symmetric, it deviates by 0\.5"),
    (dict(directors=2 * np.eye(3)), r"directors must be three orthonormal rows, they deviate by 3 \(allowed: 1e-6\)|1e-06"),
    (dict(directors=np.diag([1, 1, -1])), "directors are left-handed"),
    (dict(directors=np.eye(2)), "directors must be 3 x 3 finite numbers"),
    (dict(spin=1.0), "spin must be 3 finite numbers, got 1"),
    (dict(velocity=(0, 0)), "velocity must be 3 finite numbers"),
])
def test_body_arguments_are_checked(options, text):
    with pytest.raises(SceneError, match="body 'b': " + text):
        body(**options)
    with pytest.raises(SceneError, match="body 'wheel': offset must be 3 finite numbers"):
        WHEEL.point((1, 2))


# --- supports and joints -----------------------------------------------------------------------------------------------------
def test_supports_take_nodes_bodies_and_masses():
    assert Clamp(BOOM.start).at == BOOM.start and Clamp(WHEEL).at == WHEEL.center and Pin(CART).at == CART.center
    assert Clamp(BOOM.start).name == "clamp of beam 'boom' node 0"
    assert Pin(BOOM.node(-1)).name == "pin of beam 'boom' node 4"
    assert Pin(WHEEL).name == "pin of body 'wheel'" and Clamp(WHEEL, name="foot").name == "foot"


@pytest.mark.parametrize("kind", [Clamp, Pin])
def test_supports_refuse_what_is_no_node(kind):
    with pytest.raises(SceneError, match=r"at names the whole beam 'boom'; use its start, end, node\(i\) or at\(s\)"):
        kind(BOOM)
    with pytest.raises(SceneError, match="at must be a node of a beam, a RigidBody, a point of one, or a PointMass, got 3"):
        kind(3)
    with pytest.raises(SceneError, match="name must be a non-empty text, got 7"):
        kind(BOOM.start, name=7)


@pytest.mark.parametrize("kind", [Clamp, Pin])
def test_supports_say_what_they_take(kind):
    with pytest.raises(SceneError, match="at missing; it takes at, name"):
        kind()
    with pytest.raises(SceneError, match="got .*; each support holds one node, write one for every node"):
        kind(BOOM.start, BOOM.end)
    with pytest.raises(SceneError, match="takes at, name without a name, got 3 arguments"):
        kind(BOOM.start, "foot", 3)


def test_pin_refuses_points_away_from_the_centre():
    with pytest.raises(SceneError, match="a pin fixes the centre of a body; for another point clamp a PointMass"):
        Pin(WHEEL.point((1, 0, 0)))
    assert Clamp(WHEEL.point((1, 0, 0))).at.owner is WHEEL


@pytest.mark.parametrize(("kind", "word"), [(RigidConnection, "rigid connection"), (BallJoint, "ball joint")])
def test_joints_join_two_different_nodes(kind, word):
    joint = kind(BOOM.end, WHEEL)
    assert joint.a == BOOM.end and joint.b == WHEEL.center
    assert joint.name == f"{word} of beam 'boom' node 4 and body 'wheel'"
    assert kind(BOOM.start, BOOM.end, name="ring").name == "ring"
    with pytest.raises(SceneError, match=f"{word}: both sides are body 'wheel'; a joint needs two different nodes"):
        kind(WHEEL.point((1, 0, 0)), WHEEL)
    with pytest.raises(SceneError, match=f"{word} 'j': b must be a node"):
        kind(WHEEL, None, name="j")


# --- loads -------------------------------------------------------------------------------------------------------------------
def test_load_keeps_its_vectors_and_time():
    load = Load("tip", BOOM.end, force=(0, 0, -1), moment=(1, 0, 0), time=np.cos)
    assert load.at == BOOM.end and load.force.tolist() == [0, 0, -1] and load.moment.tolist() == [1, 0, 0]
    only = Load("x", WHEEL, moment=(0, 0, 1))
    assert load.time is np.cos and only.time is None and only.force.tolist() == [0, 0, 0]
    # none at all is a slip, one of zeros is meant (a case of a sweep)
    assert Load("x", WHEEL, force=(0, 0, 0)).moment.tolist() == [0, 0, 0]
    assert Load("x", WHEEL.point((1, 0, 0)), force=(1, 0, 0)).at.offset.tolist() == [1, 0, 0]


@pytest.mark.parametrize(("options", "text"), [
    (dict(at=BOOM), "at names the whole beam 'boom'"),
    (dict(), r"give force \(N\) or moment \(N m\), 3 numbers each"),
    (dict(force=None, moment=None), "give force"),
    (dict(force=1.0), "force must be 3 finite numbers, got 1"),
    (dict(moment=(0, 0, np.nan)), r"moment must be 3 finite numbers, got \(0, 0, nan\)"),
    (dict(time=3.0), r"time must be a function of t that returns a number, or None, got 3\.0"),
    (dict(time=lambda t: np.inf), "time must return a finite number at t = 0, got inf"),
    (dict(time=lambda t: (1, 2)), "time must return a finite number at t = 0"),
    (dict(time=lambda t: None), "time must return a finite number at t = 0, got None"),
    (dict(at=CART, moment=(0, 0, 1)), "point mass 'cart' has no rotation and takes no moment"),
])
def test_load_arguments_are_checked(options, text):
    with pytest.raises(SceneError, match="load 'tip': " + text):
        Load("tip", **{"at": BOOM.end, **({"force": (0, 0, 1)} if "at" in options or "time" in options else {}), **options})


def test_distributed_load_is_constant_or_a_field():
    wind = DistributedLoad("wind", BOOM, force=lambda s: np.outer(s, [0, 1, 0]), moment=(1, 2, 3))
    s = np.array([0.0, 0.5, 2.0])
    assert np.array_equal(wind.force_at(s), [[0, 0, 0], [0, 0.5, 0], [0, 2, 0]])
    assert np.array_equal(wind.moment_at(s), [[1, 2, 3]] * 3)
    assert np.array_equal(DistributedLoad("w", BOOM, force=(1, 0, 0)).moment_at(s), np.zeros((3, 3)))


@pytest.mark.parametrize(("options", "text"), [
    (dict(), "give force or moment per length"),
    (dict(force=(1, 2)), "force must be 3 finite numbers"),
    (dict(force=lambda s: s), r"force\(s\) must be finite numbers of shape \[n, 3\] \(here \[4, 3\]\)"),
    (dict(moment=lambda s: np.full((s.size, 3), np.nan)), r"moment\(s\) must be finite numbers of shape"),
    (dict(force=(1, 0, 0), time="fast"), "time must be a function of t"),
    (dict(force=(1, 0, 0), beam=CART), "beam must be a Beam, got <point mass"),
])
def test_distributed_load_arguments_are_checked(options, text):
    with pytest.raises(SceneError, match="distributed load 'wind': " + text):
        DistributedLoad("wind", **{"beam": BOOM, **options})


# --- velocities --------------------------------------------------------------------------------------------------------------
def test_initial_velocity_is_constant_or_a_field():
    start = InitialVelocity(BOOM, velocity=lambda s: np.outer(s, [0, 0, 3]), spin=(0, 1, 0))
    assert np.array_equal(start.velocity_at(np.array([1.0])), [[0, 0, 3]])
    assert np.array_equal(start.spin_at(np.array([1.0, 2.0])), [[0, 1, 0]] * 2)
    assert np.array_equal(InitialVelocity(BOOM).velocity_at(np.array([0.3])), [[0, 0, 0]])
    with pytest.raises(SceneError, match=r"initial velocity of beam 'boom': velocity\(s\) must be finite numbers of shape"):
        InitialVelocity(BOOM, velocity=lambda s: np.zeros(3))
    with pytest.raises(SceneError, match="initial velocity of beam 'boom': spin must be 3 finite numbers"):
        InitialVelocity(BOOM, spin=4)
    with pytest.raises(SceneError, match="initial velocity: beam must be a Beam"):
        InitialVelocity(WHEEL, velocity=(1, 0, 0))


def test_rigid_motion_takes_one_several_or_all():
    assert RigidMotion(velocity=(1, 0, 0)).objects is None
    assert RigidMotion(WHEEL).objects == (WHEEL,)
    motion = RigidMotion([BOOM, WHEEL, CART], spin=(0, 0, 1), about=(1, 0, 0))
    assert motion.objects == (BOOM, WHEEL, CART) and motion.spin.tolist() == [0, 0, 1] and motion.about.tolist() == [1, 0, 0]
    with pytest.raises(SceneError, match="rigid motion: objects must be beams, nets, bodies and point masses, got 'all'"):
        RigidMotion("all")
    # a list that a filter left empty is not "everything"
    for nothing in ([], (), (x for x in ())):
        with pytest.raises(SceneError, match="rigid motion: objects is empty; name the parts that move"):
            RigidMotion(nothing, velocity=(1, 0, 0))
    with pytest.raises(SceneError, match="rigid motion: about must be 3 finite numbers"):
        RigidMotion(about=None)


# --- sliders -----------------------------------------------------------------------------------------------------------------
def test_slider_keeps_its_point_as_a_node():
    slider = Slider("run", CART, BOOM, at=0.5, rate=2, curve="c1")
    assert slider.point == CART.center and (slider.at, slider.rate, slider.curve) == (0.5, 2.0, "c1")
    assert Slider("run", WHEEL.point((0, 0, 1)), BOOM, at=0).rate is None
    # round-off at the end of the beam is removed
    assert Slider("run", CART, BOOM, at=2.0 + 1e-12).at == 2.0


@pytest.mark.parametrize(("options", "text"), [
    (dict(point=BOOM), "point names the whole beam 'boom'"),
    (dict(beam=WHEEL), "beam must be a Beam"),
    (dict(at=np.nan), "at must be a finite number, got nan"),
    (dict(at="left"), "at must be a finite number, got 'left'"),
    (dict(rate=np.inf), "rate must be a finite number, got inf"),
    (dict(curve="c2"), "curve 'c2' does not exist: choose 'own' or 'c1'"),
])
def test_slider_arguments_are_checked(options, text):
    with pytest.raises(SceneError, match="slider 'run': " + text):
        Slider("run", **{**dict(point=CART, beam=BOOM, at=0.5), **options})


def test_parts_are_shown_in_one_line_with_what_is_not_as_by_default() -> None:
    rope = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    a, b = (fb.Beam.straight(name, start, end, section=rope, elements=2) for name, start, end in (
        ("a", (0, 0, 0), (2, 0, 0)), ("b", (0.7, -1, 0), (0.7, 1, 0))))
    block = fb.RigidBody("block", mass=2.0, inertia=(1, 2, 3), position=(2, 0, 0))
    stops, lock = fb.Stops(0.1, stiffness=1e4), fb.Lock("end", until=2.0)
    turns = fb.RevoluteJoint(fb.GROUND, block, "h", axis=(0, 1, 0), angle=lambda t: t)
    moves = fb.PrescribedMotion("p", a.start, displacement=lambda t: (t, 0, 0), until=1.0)
    shown = {
        fb.Crossing("x", a, b, at=(0.7, 1.0)): "<crossing 'x': beam_a=beam 'a', beam_b=beam 'b', at=(0.7, 1)>",
        fb.Slider("s", block, on=a, at=1.0, friction=0.2, stops=stops): "<slider 's': point=body 'block', beam=beam 'a', at=1.0, "
                                                                        "friction=Friction(coefficient=0.2), "
                                                                        "stops=Stops(start=0.1, stiffness=10000.0)>",
        fb.Sleeve("t", block, a, at=1.0, length=0.2): "<sleeve 't': point=body 'block', beam=beam 'a', at=1.0, length=0.2>",
        fb.Damper(a.end, block, damping=3.0): "<damper of beam 'a' node 6 and body 'block': damping=3.0>",
        fb.Bushing(a.end, block, "m", stiffness=[1, 2, 3, 4, 5, 6]): "<bushing 'm': a=beam 'a' node 6, b=body 'block', "
                                                                     "stiffness=diagonal (1, 2, 3, 4, 5, 6)>",
        turns: "<revolute joint 'h': a=ground at (2, 0, 0) m, b=body 'block', axis=(0, 1, 0), angle=a function>",
        moves: "<prescribed motion 'p': at=beam 'a' node 0, displacement=a function, until=1.0>",
        fb.Pin(a.end, axes="yz"): "<pin of beam 'a' node 6 along yz: axes='yz'>",
        block: "<body 'block': mass=2.0, inertia=diagonal (1, 2, 3), position=(2, 0, 0)>",
        fb.Signal([0, 1, 2, 3], [0, 1, 1, 0]): "<signal: 4 numbers, 0 to 3 s, at rest outside>",
        lock: "Lock(when='end', until=2.0)", fb.Drive(speed=1.0): "Drive(speed=1.0)"}
    assert [repr(part) for part in shown] == list(shown.values())
    assert eval(repr(lock), vars(fb) | {"Lock": fb.Lock}) == lock
    # in a notebook a scene shows the same
    assert "length=0.2" in fb.Scene(a, block, *(x for x in shown if isinstance(x, fb.Sleeve)))._repr_html_()
