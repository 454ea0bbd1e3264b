"""Mass of the fluid that parts carry along: Kirchhoff's equations, exact frequencies, invariants, what it does not go with."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb
from fastbeam.dynamics.time_loop import Result

Array = np.ndarray
MASS, INERTIA = 1.0, np.array([0.2, 0.5, 0.6])
SECTION = fb.Section(EA=2e4, GA2=8e3, GA3=8e3, GJ=20.0, EI2=30.0, EI3=30.0, rhoA=1.5, rhoI2=1e-3, rhoI3=1e-3)


def skew(x: Array) -> Array:
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def kirchhoff(normal: float, tangential: float, v: Array, w: Array, t: float) -> tuple[Array, Array, Array]:
    """Place, axes and velocity of the body at time t."""
    m = MASS + np.array([tangential, normal, normal])

    def rates(_: float, y: Array) -> Array:
        r, a, b = y[3:12].reshape(3, 3), y[12:15], y[15:]
        p, h = m * a, INERTIA * b
        return np.concatenate([r @ a, (r @ skew(b)).reshape(-1), np.cross(p, b) / m, (np.cross(h, b) + np.cross(p, a)) / INERTIA])

    y = solve_ivp(rates, (0.0, t), np.concatenate([np.zeros(3), np.eye(3).reshape(-1), v, w]), method="DOP853", rtol=1e-12,
                  atol=1e-13).y[:, -1]
    r = y[3:12].reshape(3, 3)
    return y[:3], r, r @ y[12:15]


def drift(result: Result, *more: str) -> float:
    """Largest of the invariants, relative to their sizes."""
    found = [np.ptp(result.series["total"]) / abs(result.series["total"][0])]
    for x in (result.series["lin_mom"], result.series["ang_mom"]):
        found.append(np.max(np.abs(x - x[0])) / np.max(np.linalg.norm(x, axis=1)))
    return float(max(found))


@pytest.mark.parametrize("order, normal, tangential, plane", [
    (2, 1.4, 0.3, False), (2, 1.4, 0.0, False), (4, 0.9, 0.9, False), (2, 0.2, 1.7, True)])
def test_body_in_fluid(order: int, normal: float, tangential: float, plane: bool) -> None:
    """The exact motion of an ellipsoid in an ideal fluid, whose mass depends on the direction, at order 2; where not, at 4."""
    v, w = np.array([1.0, 0.5, -0.3]), np.array([0.7, 1.0, -1.2])
    if plane:
        v[2] = w[0] = w[1] = 0.0
    place, axes, velocity = kirchhoff(normal, tangential, v, w, 2.0)
    body = fb.RigidBody("body", mass=MASS, inertia=INERTIA, position=(0, 0, 0), velocity=v, spin=w)
    model = fb.compile_scene(fb.Scene(body, fb.AddedMass("water", body, normal=normal, tangential=tangential)),
                             planar=plane or "auto")
    off = []
    for n in (50, 100, 200):
        result = fb.simulate(model, t_end=2.0, step=2.0 / n, order=order, progress=False)
        end = result.state
        q, rate = end.q.reshape(-1, 4, 3)[0], end.v.reshape(-1, 4, 3)[0]
        off.append(max(np.max(np.abs(q[0] - place)), np.max(np.abs(q[1:].T - axes)), np.max(np.abs(rate[0] - velocity))))
        assert drift(result) < 1e-12
        assert np.mean(result.series["iterations"][1:]) < 6 * (5 if order == 4 else 1)
    assert off[-2] / off[-1] == pytest.approx(2.0**order, rel=0.15)
    assert off[-1] < {2: 2e-4, 4: 1e-7}[order]


def test_pinned_beam() -> None:
    """Waves of a beam in water: exact frequencies (n pi/L)^2 sqrt(EI/(rhoA + m)), by modes and in a run."""
    length, normal = 2.0, 3.5
    slender = fb.Section(EA=4e6, EI2=30.0, EI3=30.0, GJ=30.0, GA2=1e9, GA3=1e9, rhoA=1.5, rhoI2=0.0,
                         rhoI3=0.0)
    exact = (np.arange(1, 4) * np.pi / length)**2 * np.sqrt(30.0 / (1.5 + normal))
    off = []
    for elements in (4, 8):
        beam = fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=slender, elements=elements, degree=3)
        model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end, axes="yz"),
                                          fb.AddedMass("water", beam, normal=normal)))
        found = fb.modes(model, n=3, planar=True)
        off.append(np.abs(found.angular / exact - 1.0))
    # nodes of elements of degree p integrate to the order 2 p of their frequencies; round-off of the first, 1e-7, hides that
    assert np.all(off[0][1:] / off[1][1:] > 40.0) and off[1][0] < 1e-6 and np.max(off[1]) < 1e-4
    # round-off of stiff shear is a part of the small energy; a softer beam has 3e-12 of it, without water too
    soft = fb.Section(EA=4e4, EI2=30.0, EI3=30.0, GJ=30.0, GA2=1e5, GA3=1e5, rhoA=1.5, rhoI2=0.0, rhoI3=0.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=soft, elements=8, degree=3)
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end, axes="yz"),
                                      fb.AddedMass("water", beam, normal=normal)))
    found = fb.modes(model, n=3, planar=True)
    state, period = found.state(0, 1e-3), 2.0 * np.pi / found.angular[0]
    run = fb.simulate(model, t_end=float(period), step=float(period / 400), start=state, progress=False)
    q = [x.q.reshape(-1, 4, 3)[:, 0] for x in (state, run.state)]
    rest = model.q0.reshape(-1, 4, 3)[:, 0]
    # the phase of a step of w h: w^2 h^2/12
    late = (2 * np.pi / 400)**2 / 12 * 2 * np.pi
    assert np.max(np.abs(q[1] - q[0])[:, 1]) < 2.0 * late * np.max(np.abs(q[0] - rest))
    assert run.drift("total") < 1e-11


def rope(planar: bool = False) -> fb.Scene:
    """A flexible beam that flies and turns in water, with a body at its end and a bead that slides on it."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0.3, 0), section=SECTION, elements=8)
    body = fb.RigidBody("body", mass=0.7, inertia=(0.02, 0.05, 0.06), position=beam.reference(beam.length)[0][0])
    bead = fb.PointMass("bead", mass=0.4)
    return fb.Scene(beam, body, bead, fb.RigidConnection(beam.end, body), fb.Slider("slides", bead, beam, at=0.7),
                    fb.RigidMotion(velocity=(0.4, 1.0, 0.0 if planar else 0.5), spin=(0, 0, 3.0) if planar else (0.5, -2.0, 3.0),
                                   about=(0.3, 0, 0)),
                    fb.AddedMass("water", beam, normal=2.5, tangential=0.2),
                    fb.AddedMass("ball", bead, normal=0.3, tangential=0.3),
                    fb.AddedMass("blunt", body, normal=0.2, tangential=0.9))


def test_free_beam_keeps_its_invariants() -> None:
    """In space and in the plane, which agree; a run in two parts is one run; statics and gravity do not know the water."""
    model = fb.compile_scene(rope())
    result = fb.simulate(model, t_end=0.4, step=2e-3, progress=False)
    assert drift(result) < 1e-12
    assert set(result.info["conserved"]) >= {"total", "lin_mom", "ang_mom"}
    half = fb.simulate(model, t_end=0.2, step=2e-3, progress=False)
    rest = fb.simulate(model, t_end=0.4, step=2e-3, start=half.checkpoint, progress=False)
    assert np.array_equal(rest.state.q, result.state.q) and np.array_equal(rest.state.history, result.state.history)
    flat, space = (fb.simulate(fb.compile_scene(rope(True), planar=x), t_end=0.2, step=2e-3, progress=False)
                   for x in (True, False))
    assert max(drift(flat), drift(space)) < 1e-12
    np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(flat.state.history, space.state.history, rtol=0, atol=1e-9)


def test_driven_in_water() -> None:
    """Drag and supports that move beside it: the books close. A mass without a direction falls as one that has both masses."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SECTION, elements=6)
    model = fb.compile_scene(fb.Scene(
        beam, fb.PrescribedMotion("shake", beam.start, displacement=lambda t: (0, 0.1 * np.sin(9 * t), 0)),
        fb.AddedMass("water", beam, normal=2.5, tangential=0.1), fb.Drag("current", beam, normal=5.0, air=(0, 0.5, 0.3)),
        gravity=(0, 0, -9.81)))
    result = fb.simulate(model, t_end=0.5, step=2e-3, progress=False)
    balance = result.series["balance"]
    assert np.ptp(balance) < 1e-12 * max(np.ptp(result.series["kinetic"]), np.ptp(result.series["works"]))
    ball = fb.PointMass("ball", mass=2.0, position=(0, 0, 0))
    fall = fb.simulate(fb.compile_scene(fb.Scene(ball, fb.AddedMass("half", ball, normal=0.5, tangential=0.5),
                                                 gravity=(0, 0, -9.81))), t_end=1.0, step=0.01, order=4, progress=False)
    assert fall.state.q[2] == pytest.approx(-0.5 * 9.81 * 2.0 / 2.5, rel=1e-12)


def test_condensed_net_in_water() -> None:
    """A net whose other beams are condensed, on threads, against the same without condensation."""
    def scene() -> fb.Scene:
        nodes = np.array([(x, y, 0.0) for x in range(4) for y in range(4)])
        lines = [(4 * i + j, 4 * i + j + 1) for i in range(4) for j in range(3)]
        lines += [(4 * i + j, 4 * i + j + 4) for i in range(3) for j in range(4)]
        net = fb.Net("net", nodes=nodes, edges=lines, section=SECTION, elements=6, degree=2)
        tail = fb.Beam.straight("tail", (3, 3, 0), (5, 3, 0), section=SECTION, elements=4)
        return fb.Scene(net, tail, fb.RigidConnection(net.node(15), tail.start), fb.AddedMass("water", tail, normal=3.0),
                        fb.Pin(net.node(0)), gravity=(0, 0, -9.81))

    runs = [fb.simulate(fb.compile_scene(scene(), condense=x), t_end=0.1, step=5e-3, progress=False) for x in (True, False)]
    np.testing.assert_allclose(runs[0].state.q, runs[1].state.q, rtol=0, atol=1e-9)
    assert max(run.drift("total") for run in runs) < 1e-12


def test_what_it_does_not_go_with() -> None:
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    ball = fb.PointMass("ball", mass=1.0, position=(0, 0, 0))
    for call, words in ((lambda: fb.AddedMass("w", ball, normal=1.0), "no direction"),
                        (lambda: fb.AddedMass("w", body), "give normal")):
        with pytest.raises(fb.SceneError, match=words):
            call()
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SECTION, elements=4)
    water, clamp = fb.AddedMass("water", beam, normal=1.0), fb.Clamp(beam.start)
    model = fb.compile_scene(fb.Scene(beam, water, clamp, gravity=(0, 0, -1)))
    dry = fb.compile_scene(fb.Scene(beam, clamp, gravity=(0, 0, -1)))
    shapes = [fb.solve_static(x).state.q for x in (model, dry)]
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=0, atol=1e-12)
    for run, words in (
            (lambda: fb.simulate(model, t_end=0.1, step=0.01, order=4, progress=False), "order=4: added mass 'water'"),
            (lambda: fb.simulate(model, t_end=0.1, step=0.01, method="midpoint", progress=False), "added mass"),
            (lambda: fb.adjoint_run(model, t_end=0.1, step=0.01), "added mass"),
            (lambda: fb.modes(model, steady=fb.Spin(axis=(1, 0, 0), rate=1.0)), "leave it out")):
        with pytest.raises(fb.SceneError, match=words):
            run()
    ball = fb.PointMass("ball", mass=1.0)
    stops = fb.Slider("s", ball, beam, at=1.0, stops=fb.Stops(start=0.5, end=1.5))
    with pytest.raises(fb.SceneError, match="impacts do not include"):
        fb.compile_scene(fb.Scene(beam, water, clamp, ball, stops))


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
def test_no_equilibrium_depends_on_it(planar: bool) -> None:
    """A body between two springs in a scene with velocities: where it rests by motion, whose energy balance closes, and by load
    steps; a run from there stays."""
    body = fb.RigidBody("body", mass=MASS, inertia=INERTIA, position=(0.6, 0, 0), velocity=(0.5, 0, 0.3))
    springs = [fb.Spring(fb.GROUND.point((x, 0, 0)), body, stiffness=k, length=length)
               for x, k, length in ((0.0, 100.0, 0.5), (2.0, 10.0, 1.4))]
    model = fb.compile_scene(fb.Scene(body, *springs, fb.AddedMass("water", body, normal=0.4, tangential=1.9),
                                      fb.Load("push", body, force=(11, 0, 0))), planar=planar)
    exact = np.array([(11.0 + 50.0 + 6.0) / 110.0, 0.0, 0.0])
    rested, stepped = (find(model, points={"body": body}) for find in (fb.relax, fb.solve_static))
    strain, way = rested.series["strain"], rested.point("body")[:, 0]
    lost = strain[0] - strain[-2] + 11.0 * (way[-2] - way[0])
    assert rested.info["energy_loss"] == pytest.approx(lost, rel=1e-10) and lost == pytest.approx(0.5 / 110.0, rel=1e-2)
    for found in (rested, stepped):
        np.testing.assert_allclose(found.point("body")[-1], exact, rtol=0, atol=1e-12)
        run = fb.simulate(model, start=found.state, t_end=0.1, step=0.01, progress=False)
        assert np.max(run.series["kinetic"]) < 1e-20 * lost


def test_response_and_step_control() -> None:
    """A body on a spring along its axis answers as one of its mass and that of the fluid along it; steps of any size conserve."""
    body = fb.RigidBody("body", mass=2.0, inertia=(1, 1, 1), position=(1, 0, 0))
    spring = fb.Spring(fb.GROUND.point((0, 0, 0)), body, stiffness=50.0, damping=1.0)
    model = fb.compile_scene(fb.Scene(body, spring, fb.AddedMass("water", body, normal=3.0, tangential=0.5),
                                      fb.Load("push", body, force=(2, 0, 0))))
    found = fb.frequency_response(model, [0.5], load_factor=0.0, loads={"push": 1.0}, points={"body": body})
    exact = 2.0 / abs(50.0 - 2.5 * np.pi**2 + 1j * np.pi)
    assert np.max(np.abs(found.point("body"))) == pytest.approx(exact, rel=1e-12)
    free = fb.RigidBody("free", mass=MASS, inertia=INERTIA, position=(0, 0, 0), velocity=(1, 0.5, -0.3), spin=(0.7, 1, -1.2))
    run = fb.simulate(fb.compile_scene(fb.Scene(free, fb.AddedMass("water", free, normal=1.4, tangential=0.3))),
                      t_end=2.0, step=0.02,
                      tolerance=1e-5, progress=False)
    assert drift(run) < 1e-12
