"""Arguments in all the forms that pages show, as type checkers see them (test_typing.py); nothing runs this file."""
from __future__ import annotations

import numpy as np

import fastbeam as fb

rope = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0, damping=[1e-3] * 6)
a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=rope, elements=4)
b = fb.Beam.straight("b", (2, 0, 0), (4, 0, 0), section=rope, elements=4)
c = fb.Beam.straight("c", (2, 0, 0), (2, 2, 0), section=rope, elements=np.linspace(0.0, 2.0, 4))
bead = fb.PointMass("bead", mass=1.0, position=np.zeros(3), velocity=[0, 0, 1])
where: np.ndarray = fb.RigidBody("x", mass=1.0, inertia=[1, 1, 1], position=(0, 0, 0)).inertia
block = fb.RigidBody("block", mass=40.0, inertia=np.eye(3), position=(2, 0, 0))
over = fb.Beam.straight("over", (0.7, -1, 0), (0.7, 1, 0), section=rope, elements=4)
cross = fb.Crossing("x", fb.Path("p", [a, (b, 1)]), over, at=(0.7, 1.0), friction=(0.1, None))
cross2 = fb.Crossing("y", a, over, at=np.array([0.7, 1.0]), friction=fb.Friction(0.2))
x: float = cross.slider_a.at
tracks: tuple[int, ...] = fb.Path("q", [a, b]).directions
s1 = fb.Switch("s", [a, b, c], choose=[(0.0, "b"), (5.0, "c")])
s2 = fb.Switch("s", (a, b, c), choose={"ride": "b"})
s3 = fb.Switch("s", (a, b, c), choose=lambda t, state: "b" if t < 1.0 else "c")
s4 = fb.Switch("s", (a, b, c), choose=lambda t, state, slider: b)
lock1 = fb.Slider("l", bead, a, at=0.1, lock=fb.Lock("end"), stops=fb.Stops(end=1.0))
lock2 = fb.Slider("l", bead, a, at=0.1, lock=[fb.Lock(until=1.0), fb.Lock(lambda t, s, rate: rate - 3.0,
                                                                            until=lambda t, s, rate: s > 1.0)])
off = fb.Slider("o", block, a, at=0.1, one_sided=(0, 0, 1), friction=0.3)
leaves = fb.Slider("o", block, a, at=0.1, release=fb.Release("end"))
off2 = fb.Slider("o", block.point((0, 0, 1)), on=a, at=0.1, one_sided=fb.OneSided([0, 0, 1], restitution=0.5))
fr: float | None = off.friction.viscous if off.friction is not None else None
drive = fb.Drive(position=lambda t: 0.5 * t, speed=lambda t: 0.5, stiffness=1e4, damping=10.0)
law = fb.Drive(force=lambda t, s, rate: -3.0 * rate)
signal = fb.Signal([0, 1, 2, 3], [0, 1, 1, 0])
follow = fb.Drive(position=signal)
ground: fb.Signal = fb.Signal.from_acceleration([0, 1, 2, 3], [0, 1, 1, 0], direction=(0, 0, 1), velocity=0.1, baseline=2)
shake = fb.PrescribedMotion("m", a.start, displacement=fb.Signal(np.linspace(0, 1, 11), np.zeros((11, 3))), until=2.0)
shake2 = fb.PrescribedMotion("m", bead, position=lambda t: (t, 0, 0), until=lambda t, state: t > 1.0)
shake3 = fb.PrescribedMotion("m", block, displacement=lambda t: 0.1 * np.sin(t), axes="y")
hold = fb.Clamp(a.start, until=3.0), fb.Pin(bead, axes="yz"), fb.Pin(b.end, until=lambda t, state: state.q[0] - 1.0)
hinge = fb.RevoluteJoint(fb.GROUND, block, axis=[0, 1, 0], angle=lambda t: 2.0 * t)
hinge2 = fb.RevoluteJoint(a.end, block, axis=(0, 1, 0), stops=fb.Stops(-1.0, 1.0, stiffness=1e4), friction=2.0)
guide = fb.PrismaticJoint(fb.GROUND.point((0, 0, 0)), block, axis=(1, 0, 0), force=3.0)
other = fb.CylindricalJoint(fb.GROUND, block, axis=(1, 0, 0), stiffness=(1, 2)), fb.PlanarJoint(a.end, block, normal=(0, 0, 1))
screw = fb.ScrewJoint(fb.GROUND, block, axis=(1, 0, 0), pitch=0.01, friction=(1, 0))
gears = fb.GearCoupling(hinge, guide, ratio=0.1), fb.GearCoupling((screw, "angle"), hinge2, "gear", ratio=-2)
cardan = fb.UniversalJoint(a.end, block, axis_a=(0, 0, 1), axis_b=(0, 1, 0), torque=(1.0, None))
ball = fb.SphericalJoint(a.end, block, axis=(0, 0, 1), stiffness=(1, 2), cone=fb.Stops(end=0.5))
spring = fb.Spring(a.end, fb.GROUND.point((0, 0, 1)), table=([-1, 0, 1], [-2, 0, 3]), interpolation="spline")
mount = fb.Bushing(fb.GROUND.point((0, 0, 0)), block, stiffness=[1e5] * 6, damping=np.eye(6))
damper = fb.Damper(bead, block, damping=3.0)
wind = fb.DistributedLoad("w", a, force=(0, 1, 0)), fb.DistributedLoad("w", a, force=lambda s: np.zeros((len(s), 3)))
start = fb.InitialVelocity(a, velocity=(0, 0, 1), spin=lambda s: np.zeros((s.size, 3)))
motion = fb.RigidMotion([a, block], velocity=(1, 0, 0)), fb.RigidMotion(a, spin=(0, 0, 1)), fb.RigidMotion(velocity=(0, 0, 1))
drag = fb.Drag("air", a, normal=0.1, air=[1, 0, 0])


def air(t: float, position: np.ndarray, directors: np.ndarray, velocity: np.ndarray, spin: np.ndarray, parameters: np.ndarray,
        force: np.ndarray, moment: np.ndarray) -> None:
    force[:] = -parameters[0] * velocity


user = fb.UserForce("air", block, air, parameters=(0.1,)), fb.UserForce("air", a, air, parameters=[0.1])
net = fb.Net("n", [(0, 0, 1), (1, 0, 0)], [(0, 1)], section=rope, d2=(0, 0, 1), masses=[1, 2], joints=["rigid", "ball"],
             velocity=(0, 0, 1), prestress=10.0, elements=[3])
node: fb.NodeRef = net.node(0)
tube = fb.Sleeve("t", block, a, at=1.0, length=0.3, friction=0.1, axis=(1, 0, 0))
scene = fb.Scene(a, b, c, bead, block, *hold, cross, hinge, spring, mount, damper, *wind, start, *motion, drag, *user, net, tube)
model = fb.compile_scene(scene)
run = fb.simulate(model, t_end=1.0, step=1e-3, points={"tip": a.end, "m": (a, 1.0), "b": block, "bead": bead},
                  callback=lambda t, state: bool(state.s[0] > 1.0), observe=("section", "reaction"))
pts = {"tip": a.end}
again = fb.simulate(model, t_end=1.0, step=1e-3, points=pts, start=run.state_for(model))
force = run.reaction(hold[0])["force"], run.reaction(hinge)["moment"], run.reaction("clamp")
frame = run.to_dataframe()
frame.to_csv("x.csv")
table = fb.sweep(lambda: 1.0, [{"a": 1}], workers=1)
col: np.ndarray = table.column("value")
modes = fb.modes(model, n=3)
damped = fb.modes(model, n=3, damped=True)
buckled: fb.BucklingModes = fb.critical_loads(model, n=2, negative=True, at_time=(0.0, 1.0))
bent = buckled.state(0, 1e-3)
go = fb.simulate(model, t_end=1.0, step=1e-3, start=modes.state(0, 0.1))
response = fb.frequency_response(model, np.linspace(1, 10, 10), loads={"shaker": 1.0, "other": 1j}, points={"tip": a.end})
response2 = fb.frequency_response(model, [1.0], base=(0, 0, 1e-3))
response4 = fb.frequency_response(model, [1.0], base={hold[0]: (0, 0, 1j)})
response3 = fb.frequency_response(model, [1.0], loads=["a", fb.Load("x", a.end, force=(0, 0, 1))])
shape = fb.force_density([(0, 0, 0), (2, 0, 0), (9, 9, 9)], [(0, 2), (1, 2)], [3.0, 1.0], pins=[0, 1])


def family(EI: float) -> tuple[fb.Scene, dict[str, fb.NodeRef]]:
    return scene, {"tip": a.end}


slopes = fb.sensitivity(family, {"EI": 1.0}, observe=("energy", "section"))
grad = slopes.gradient(points={"tip": (0, 0, 1)})
path = fb.solve_path(model, points={"tip": a.end})
back = fb.adjoint_run(model, t_end=1.0, step=1e-2, points={"tip": a.end}).gradient(points={"tip": (0, 0, 1)})
rest = fb.relax(model, points={"tip": a.end})
try:
    fb.solve_static(model, held="ride")
except fb.ConvergenceError as error:
    if error.state is not None and error.result is not None:
        fb.simulate(model, start=error.state, t_end=1.0, step=1e-3)
        print(error.result.table())
