"""Springs with laws and bushings: their kernels against plain sums and differences, what they read out, what they refuse."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive import cay, cayley_vector
from restarts import assert_goes_on
from scipy.integrate import quad

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.call_tables import ASSEMBLY, Calls, SystemRecord
from fastbeam.kernels.forces.spring_laws import SpringLaws, damping_force, mean_force
from fastbeam.kernels.terms import Conserving
from fastbeam.model.feature import OfRun
from fastbeam.model.forces.spring_laws import laws_of
from fastbeam.model.workspace import work_of
from fastbeam.stepping.terms import system_of, terms_of

Array = np.ndarray
ORIGIN = fb.GROUND.point((0, 0, 0))
BAR = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
BOB = fb.PointMass("bob", mass=2.0, position=(0, 0, -1.0), velocity=(0.3, 0.1, 0.0))
POINTS = np.array([-0.4, -0.1, 0.05, 0.3, 0.7])
FORCES = np.array([-30.0, -2.0, 1.0, 8.0, 60.0])


def law(**more: Any) -> SpringLaws:
    """The table of one spring."""
    none = np.zeros((0, 4), np.int64)
    return laws_of([fb.Spring(ORIGIN, BOB, "s", **more)], none, none, none, np.ones(1), np.zeros(1, np.int64))


def spline(e: float) -> float:
    """Not-a-knot through the points, straight on outside."""
    from scipy.interpolate import CubicSpline
    found = CubicSpline(POINTS, FORCES)
    inside = min(max(e, POINTS[0]), POINTS[-1])
    return float(found(inside) + (e - inside) * found(inside, 1))


def straight(e: float) -> float:
    if POINTS[0] <= e <= POINTS[-1]:
        return float(np.interp(e, POINTS, FORCES))
    k = 0 if e < POINTS[0] else -1
    slope = (FORCES[1] - FORCES[0]) / (POINTS[1] - POINTS[0]) if k == 0 else (FORCES[-1] - FORCES[-2]) / (POINTS[-1] - POINTS[-2])
    return float(FORCES[k] + slope * (e - POINTS[k]))


LAWS: dict[str, tuple[dict[str, Any], Any]] = {
    "rope": ({"stiffness": 7.0, "tension_only": True}, lambda e: 7.0 * max(e, 0.0)),
    "buffer": ({"stiffness": 7.0, "compression_only": True}, lambda e: 7.0 * min(e, 0.0)),
    "linear": ({"stiffness": 7.0, "damping": 1.0}, lambda e: 7.0 * e),
    "table": ({"table": (POINTS, FORCES)}, straight),
    "spline": ({"table": (POINTS, FORCES), "interpolation": "spline"}, spline),
}


# --------------------------------------------------------------------------------------------------------------- kernels
@pytest.mark.parametrize("name", LAWS)
def test_mean_forces_are_integrals(name: str) -> None:
    options, force = LAWS[name]
    table = law(**options)
    for e0, e1 in [(-0.3, 0.6), (0.6, -0.3), (-0.9, 1.2), (0.1, 0.2), (0.0, 0.05), (-0.2, 0.0), (0.25, 0.25), (-0.1, 0.3)]:
        breaks = [x for x in (*POINTS, 0.0) if min(e0, e1) < x < max(e0, e1)]
        mean = quad(force, e0, e1, points=breaks or None, epsabs=1e-12)[0] / (e1 - e0) if e1 != e0 else force(e0)
        found, slope = mean_force(table, 0, e0, e1)
        assert found == pytest.approx(mean, rel=1e-12, abs=1e-13)
        d = 1e-6
        numerical = (mean_force(table, 0, e0, e1 + d)[0] - mean_force(table, 0, e0, e1 - d)[0]) / (2.0 * d)
        # at a kink differences of one side count
        if e1 not in (*POINTS, 0.0):
            assert slope == pytest.approx(numerical, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_energies_are_integrals_and_zero_without_elongation(name: str) -> None:
    options, force = LAWS[name]
    model = fb.compile_scene(fb.Scene(BOB, fb.Spring(ORIGIN, BOB, "s", length=1.0, **options)))
    for e in (-0.9, -0.2, 0.0, 0.2, 1.5):
        q = model.q0.reshape(-1, 12).copy()
        q[0, :3] = 0.0, 0.0, -1.0 - e
        out = np.zeros(6)
        kernels.energy_of(model.links, q.reshape(-1), SPACE, out)
        breaks = [x for x in POINTS if min(e, 0.0) < x < max(e, 0.0)]
        assert out[0] == pytest.approx(quad(force, 0.0, e, points=breaks or None)[0], rel=1e-11, abs=1e-13)


@pytest.mark.parametrize(("side", "e0", "e1", "way"), [(0, -0.1, 0.2, 0.3), (1, -0.1, 0.2, 0.2), (1, 0.2, -0.1, -0.2),
                                                      (1, -0.2, -0.1, 0.0), (-1, -0.1, 0.2, 0.1), (-1, -0.2, -0.1, 0.1),
                                                      (1, 0.1, 0.4, 0.3)])
def test_slack_ropes_do_not_damp(side: int, e0: float, e1: float, way: float) -> None:
    table = law(stiffness=1.0, damping=3.0, tension_only=side > 0, compression_only=side < 0)
    h = 0.1
    found, slope = damping_force(table, 0, e0, e1, h)
    assert found * (e1 - e0) == pytest.approx(3.0 * way**2 / h, rel=1e-13, abs=1e-15)
    d = 1e-6
    numerical = (damping_force(table, 0, e0, e1 + d, h)[0] - damping_force(table, 0, e0, e1 - d, h)[0]) / (2.0 * d)
    assert slope == pytest.approx(numerical, rel=1e-6, abs=1e-6)


# ------------------------------------------------------------------------------- residual and tangent of a large trial step
def matrix(seed: int) -> Array:
    a = np.random.default_rng(seed).standard_normal((6, 6))
    return 5.0 * (a @ a.T + np.eye(6))


def pair(flat: bool = False) -> fb.Scene:
    """Two bodies that all kinds of springs join, and the ground."""
    z = 0.0 if flat else 0.2
    a = fb.RigidBody("a", mass=1.0, inertia=(0.1, 0.2, 0.3), position=(0, 0, 0), spin=(0, 0, 2.0) if flat else (1.0, 2.0, 2.0))
    b = fb.RigidBody("b", mass=2.0, inertia=(0.1, 0.3, 0.2), position=(1, 0.2, z), velocity=(0.2, 0.5, 0))
    stiff, lossy = matrix(1), np.kron(np.diag([1.0, 0.0]), matrix(2)[:3, :3]) + np.kron(np.diag([0.0, 1.0]), matrix(3)[:3, :3])
    lossy *= 0.02
    if flat:
        for m in (stiff, lossy):
            m[np.ix_([0, 1, 5], [2, 3, 4])] = m[np.ix_([2, 3, 4], [0, 1, 5])] = 0.0
    c, s = np.cos(0.4), np.sin(0.4)
    return fb.Scene(
        a, b, fb.Bushing(a.point((0.4, 0.1, z)), b.point((-0.3, 0, 0)), "mount", stiffness=stiff, damping=lossy,
                         directors=[[c, s, 0], [-s, c, 0], [0, 0, 1]]),
        fb.Bushing(fb.GROUND.point((0.1, 0.2, 0)), a, "foot", stiffness=(20, 30, 10, 4, 5, 6)),
        fb.Spring(a.point((0, 0.5, 0)), b.point((0, 0.5, z)), "rope", stiffness=40.0, tension_only=True, damping=0.2),
        fb.Spring(a.point((0, -0.5, 0)), b, "curve", table=(POINTS, FORCES), interpolation="spline", length=1.1),
        fb.Damper(a, b.point((0.1, 0.5, 0)), "dashpot", damping=0.3))


def trial(model: Any, dphi: Array, theta: Array, h: float) -> tuple[Array, Array]:
    """Residual and blocks of a step with given increments; of links alone."""
    work = work_of(model)
    work.dphi[:], work.theta[:] = dphi.reshape(-1), theta.reshape(-1)
    system = system_of(model, Conserving(), None, None, model.state(), work)
    terms = tuple(t for t in terms_of(OfRun(model)) if any(t is x for x in model.links))
    kernels.assemble_all(*Calls(terms, ASSEMBLY).on(SystemRecord(system, ASSEMBLY)), h)
    return work.r.copy(), work.blocks.copy()


def dense(model: Any, blocks: Array) -> Array:
    """The tangent of all rows from the blocks between the nodes of links."""
    n, out = model.n_nodes, np.zeros((model.n_nodes, 6, model.n_nodes, 6))
    at = blocks.reshape(-1, 6, 8)[:, :, :6]
    done = set()
    for table in model.links:
        for (a, b), four in zip(table.row.tolist(), table.block.tolist()):
            for (i, j), k in zip(((a, a), (a, b), (b, a), (b, b)), four):
                if (i, j) not in done:
                    out[i, :, j] = at[k]
                    done.add((i, j))
    return out.reshape(6 * n, 6 * n)


def test_residual_is_the_change_of_energy_and_the_tangent_its_derivative() -> None:
    # without ties, so that nothing moves rows: centres of bodies and beam nodes alone
    a = fb.RigidBody("a", mass=1.0, inertia=(0.1, 0.2, 0.3), position=(0, 0, 0))
    b = fb.RigidBody("b", mass=2.0, inertia=(0.1, 0.3, 0.2), position=(1, 0.2, 0.2))
    lossy = pair().links[0].damping
    scene = fb.Scene(a, b, fb.Bushing(a, b, "mount", stiffness=matrix(1), damping=lossy,
                                      directors=np.linalg.qr(matrix(4)[:3, :3])[0] * [[1], [1], [1]]),
                     fb.Spring(a, b, "rope", stiffness=40.0, tension_only=True, damping=0.2, length=1.2),
                     fb.Spring(a, b, "curve", table=(POINTS, FORCES), interpolation="spline", length=1.1),
                     fb.Damper(a, b, "dashpot", damping=0.3))
    model, h = fb.compile_scene(scene, planar=False), 0.05
    rng = np.random.default_rng(0)
    # rows are sorted by the solver
    order = model.pattern.row_of
    dphi, theta = (0.2 * rng.standard_normal((2, 3)) for _ in range(2))
    r, blocks = trial(model, dphi, theta, h)
    force = r[:16].reshape(2, 8)[order][:, :6]
    # the work of the forces is what is stored and lost
    q0 = model.q0.reshape(2, 4, 3)
    turn = [cay(t) for t in theta]
    q1 = np.stack([np.concatenate(((q0[k, 0] + dphi[k])[None], q0[k, 1:] @ turn[k].T)) for k in range(2)])
    energies = []
    for q in (q0, q1):
        out = np.zeros(6)
        kernels.energy_of(model.links, q.reshape(-1).copy(), SPACE, out)
        energies.append(out[0])
    work = float(np.sum(force[:, :3] * dphi) + np.sum(force[:, 3:] * theta))
    dl = np.linalg.norm(q1[1, 0] - q1[0, 0]) - np.linalg.norm(q0[1, 0] - q0[0, 0])
    axes = scene.links[0].directors
    frame = [[axes @ q0[k, 1:].T @ q[k, 1:] for k in range(2)] for q in (q0, q1)]
    u = [f[0] @ (q[1, 0] - q[0, 0]) for f, q in zip(frame, (q0, q1))]
    dc = frame[1][0] @ frame[1][1].T - np.eye(3)
    p = 0.5 * np.trace(lossy[3:, 3:]) * np.eye(3) - lossy[3:, 3:]
    rope = max(np.linalg.norm(q1[1, 0] - q1[0, 0]) - 1.2, 0.0)
    lost = (0.3 * dl**2 + 0.2 * rope**2 + (u[1] - u[0]) @ lossy[:3, :3] @ (u[1] - u[0]) + np.sum(dc * (p @ dc))) / h
    assert work == pytest.approx(energies[1] - energies[0] + lost, rel=1e-12)
    # momenta: no resultant force, no moment about the origin
    mean = 0.5 * (q0[:, 0] + q1[:, 0])
    assert np.abs(force[:, :3].sum(axis=0)).max() < 1e-12
    assert np.abs((np.cross(mean, force[:, :3]) + force[:, 3:]).sum(axis=0)).max() < 1e-12
    # columns are spins behind the end of the step
    found = dense(model, blocks)
    scale, d = np.max(np.abs(found)), 1e-6
    for k in range(2):
        for c in range(6):
            ends = []
            for s in (d, -d):
                x, t = dphi.copy(), theta.copy()
                if c < 3:
                    x[k, c] += s
                else:
                    t[k] = cayley_vector(cay(s * np.eye(3)[c - 3]) @ cay(theta[k]))
                ends.append(trial(model, x, t, h)[0])
            column = (ends[0] - ends[1])[:16].reshape(2, 8)[:, :6].reshape(-1) / (2.0 * d)
            np.testing.assert_allclose(found[:, 6 * order[k] + c], column, rtol=0.0, atol=1e-7 * scale)


# ------------------------------------------------------------------------------------------------------------------- runs
SETTINGS: dict[str, Any] = {"t_end": 0.6, "step": 0.01, "progress": False,
                            "observe": ("energy", "momentum", "spring", "reaction")}


@pytest.fixture(scope="module", params=[False, True], ids=["space", "plane"])
def run(request: Any) -> tuple[Any, fb.Result]:
    model = fb.compile_scene(pair(request.param))
    assert (model.plane is not None) == request.param
    return model, fb.simulate(model, **SETTINGS)


def test_books_close_and_read_out_adds_up(run: tuple[Any, fb.Result]) -> None:
    model, result = run
    size = result.series["kinetic"].max()
    assert np.ptp(result.series["balance"]) < 1e-12 * size
    elastic = [*(result.spring(x) for x in ("rope", "curve", "dashpot")), *(result.bushing(x) for x in ("mount", "foot"))]
    np.testing.assert_allclose(sum(x["energy"] for x in elastic), result.series["strain"], rtol=0.0, atol=1e-13 * size)
    balance = result.balance()
    for name in ("rope", "dashpot"):
        noun = "spring" if name == "rope" else "damper"
        assert np.array_equal(balance[f"damping of {noun} {name!r}"], result.spring(name)["loss"])
        assert np.all(np.diff(result.spring(name)["loss"]) >= 0.0) and result.spring(name)["loss"][-1] > 1e-4 * size
    assert np.array_equal(balance["damping of bushing 'mount'"], result.bushing("mount")["loss"])
    assert np.all(np.diff(result.bushing("mount")["loss"]) >= 0.0)
    assert not np.any(result.bushing("foot")["loss"]) and not np.any(result.spring("curve")["loss"])
    rope = result.spring("rope")
    slack = rope["length"] < rope["length"][0]
    assert np.any(slack) and not np.any(rope["force"][slack])


def test_forces_and_moments_of_the_read_out_are_derivatives_of_the_energy(run: tuple[Any, fb.Result]) -> None:
    """By moving the last state: along and about the axes of the bushing to the ground, at rest."""
    model, result = run
    rows = model.spring_rows[1]
    state = result.state._replace(v=np.zeros_like(result.state.v))
    at, node = rows.names.index("foot"), rows._table.node[rows.names.index("foot"), 1]
    found, d = rows.row(state), 1e-6
    for c in range(6):
        energy = []
        for s in (d, -d):
            q = state.q.reshape(-1, 4, 3).copy()
            if c < 3:
                q[node, 0] += s * np.eye(3)[c]
            else:
                q[node, 1:] = q[node, 1:] @ cay(s * np.eye(3)[c - 3]).T
            energy.append(rows.row(state._replace(q=q.reshape(-1)))["bushing_energy"][at])
        value = found["bushing_force" if c < 3 else "bushing_moment"][at, c % 3]
        assert value == pytest.approx((energy[0] - energy[1]) / (2.0 * d), abs=1e-8)


def test_runs_go_on_bit_for_bit(run: tuple[Any, fb.Result], tmp_path: Path) -> None:
    model, result = run
    assert_goes_on(model, result, 23, tmp_path / "cut.ckpt", {**SETTINGS})


def test_a_plane_is_space() -> None:
    runs = [fb.simulate(fb.compile_scene(pair(True), planar=planar), **SETTINGS) for planar in (True, False)]
    for name in ("balance", "spring_force", "bushing_moment", "bushing_energy", "losses", "lin_mom"):
        np.testing.assert_allclose(runs[0].series[name], runs[1].series[name], rtol=0.0, atol=1e-11)


def test_a_bushing_that_leads_out_of_the_plane_is_run_in_space() -> None:
    scene = pair(True)
    m = np.diag([20.0, 30, 10, 4, 5, 6])
    m[0, 2] = m[2, 0] = 1.0
    scene.add(fb.Bushing(scene.bodies[0], scene.bodies[1], "skew", stiffness=m))
    model = fb.compile_scene(scene)
    assert model.plane is None and model.not_planar == "bushing 'skew' couples in-plane motions with others"
    # oblique axes alone do not
    c, s = np.cos(0.3), np.sin(0.3)
    other = pair(True)
    other.add(fb.Bushing(*other.bodies, "tilted", stiffness=(9, 9, 9, 2, 2, 2), directors=[[1, 0, 0], [0, c, s], [0, -s, c]]))
    assert fb.compile_scene(other).plane is not None
    settings = {**SETTINGS, "t_end": 0.1}
    runs = [fb.simulate(fb.compile_scene(other, planar=planar), **settings) for planar in (True, False)]
    np.testing.assert_allclose(runs[0].state.q, runs[1].state.q, rtol=0.0, atol=1e-12)


def net(condense: bool, threads: int = 1) -> fb.Result:
    nodes = [(i, j, 0.0) for i in range(4) for j in range(4)]
    edges = [(4 * i + j, 4 * i + j + 1) for i in range(4) for j in range(3)]
    edges += [(4 * i + j, 4 * i + j + 4) for i in range(3) for j in range(4)]
    grid = fb.Net("net", nodes, edges, section=BAR, elements=8, clamps=[0, 15])
    arm = fb.RigidBody("arm", mass=0.2, inertia=(0.01, 0.01, 0.01), position=(1.5, 1, 0.0))
    hinged = fb.RigidBody("hinged", mass=0.2, inertia=(0.01, 0.01, 0.01), position=(2.5, 1, 0.0))
    turned = fb.RigidBody("turned", mass=0.2, inertia=(0.01, 0.01, 0.01), position=(2.5, 2, 0.0))

    def push(t: float, position: Array, directors: Array, velocity: Array, spin: Array, parameters: Array, force: Array,
             moment: Array) -> None:
        force[2] = parameters[0]

    scene = fb.Scene(grid, arm, hinged, turned, fb.Bushing(grid.node(5), arm.point((-0.5, 0, 0)), "mount",
                                                   stiffness=(90, 90, 90, 2, 2, 2), damping=(1, 1, 1, 0.1, 0.1, 0.1)),
                     fb.Spring(grid.node(10), arm, "rope", stiffness=20.0, tension_only=True, length=0.9, damping=0.1),
                     fb.RevoluteJoint(grid.node(9), hinged.point((-0.5, 0, 0)), "hinge", axis=(0, 1, 0), stiffness=2.0, rest=0.3,
                                      friction=0.05),
                     fb.RevoluteJoint(grid.node(10), turned.point((-0.5, 0, 0)), "drive", axis=(0, 1, 0),
                                      angle=lambda t: 5.0 * t * t),
                     fb.UserForce("wind", grid.node(6), push, parameters=(3.0,)), gravity=(0, 0, -9.81))
    return fb.simulate(fb.compile_scene(scene, condense=condense), t_end=0.015, step=0.005, solver=fb.Solver(threads=threads),
                       progress=False)


def test_forces_of_links_laws_and_joints_reach_condensed_nets() -> None:
    one, other, third = net(True), net(False), net(True, threads=2)
    np.testing.assert_allclose(one.state.q, other.state.q, rtol=0.0, atol=1e-11)
    assert np.array_equal(one.state.q, third.state.q)
    # what is left out shows in the balance
    for result in (one, other):
        assert np.ptp(result.series["balance"]) < 1e-12 * np.max(np.abs(result.series["gravity"]))


def beams() -> fb.Scene:
    """Two beams on bushings, with a bead on one that a rope holds."""
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=BAR, elements=4, degree=3)
    b = fb.Beam.straight("b", (0, 1, 0), (1, 1, 0.3), section=BAR, elements=4, degree=3)
    bead, tip = fb.PointMass("bead", mass=0.05), fb.PointMass("tip", mass=0.1, position=(1.1, 0, 0))
    return fb.Scene(a, b, bead, tip, fb.RigidConnection(a.end, tip), fb.Slider("run", bead, a, at=0.4, rate=0.3),
                    fb.Bushing(a.node(4), b.node(7), "m", stiffness=(5, 6, 7, 0.01, 0.02, 0.03),
                               damping=(0.05, 0.05, 0.05, 1e-4, 1e-4, 1e-4)),
                    fb.Bushing(ORIGIN, a.start, "f", stiffness=(50, 50, 50, 1, 1, 1)),
                    fb.Spring(bead, b.node(2), "r", stiffness=20.0, tension_only=True, length=1.02, damping=0.01),
                    fb.Spring(tip, b.end, "t", table=([-0.1, 0, 0.1], [-3, 0, 9])), gravity=(0, -1.0, 0))


def test_solvers_agree() -> None:
    runs = [fb.simulate(fb.compile_scene(beams(), **options), t_end=0.1, step=0.005, progress=False)
            for options in ({}, {"solver": "sparse"}, {"eliminate_inner": False})]
    for result in runs:
        np.testing.assert_allclose(result.state.q, runs[0].state.q, rtol=0.0, atol=1e-12)
        assert np.ptp(result.series["balance"]) < 1e-12 * np.max(np.abs(result.series["gravity"]))
        assert result.info["fallbacks"] == 0 and result.info["iterations"] <= 3 * 20


# -------------------------------------------------------------------------------------------------------------- what is refused
def test_what_springs_refuse() -> None:
    def spring(**more: Any) -> fb.Spring:
        return fb.Spring(ORIGIN, BOB, "s", **more)

    for arguments, text in [
            ({}, "needs stiffness= .N/m. or table=, got none"),
            ({"stiffness": 1.0, "table": ([0, 1], [0, 1])}, "got both"),
            ({"table": ([0, 1, 1], [0, 1, 2])}, "elongation 2 is 1 m after 1 m"),
            ({"table": ([0, 1], [0, 1, 2])}, "got 2 elongations and 3 forces"),
            ({"table": ([0], [0])}, "got 1 elongations and 1 forces"),
            ({"table": ([0, np.nan], [0, 1])}, "finite"),
            ({"table": [[0, 1]]}, "must be two rows"),
            ({"table": ([0, 1], [0, 1]), "tension_only": True}, "a table defines one-sided behaviour itself"),
            ({"stiffness": 1.0, "tension_only": True, "compression_only": True}, "leave no force"),
            ({"stiffness": 1.0, "interpolation": "spline"}, "is for a table only"),
            ({"table": ([0, 1], [0, 1]), "interpolation": "cubic"}, "choose 'linear' or 'spline'"),
            ({"stiffness": 1.0, "damping": -1.0}, "damping must be a finite number >= 0 N s/m")]:
        with pytest.raises(fb.SceneError, match=text):
            spring(**arguments)


def test_what_bushings_refuse() -> None:
    body = fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    skew, negative, coupled = np.eye(6), np.diag([1.0, 1, 1, 1, 1, -1]), np.eye(6)
    skew[0, 1], coupled[0, 4], coupled[4, 0] = 1.0, 0.5, 0.5
    for arguments, text in [
            ({"stiffness": skew}, "must be symmetric"), ({"stiffness": negative}, "negative eigenvalues"),
            ({"stiffness": (1, 1, 1)}, "six finite numbers"), ({"stiffness": (1, 1, 1, 1, 1, -1)}, "six numbers >= 0"),
            ({"stiffness": np.eye(6), "damping": coupled}, "couples forces with rotations"),
            ({"stiffness": np.eye(6), "directors": np.ones((3, 3))}, "directors")]:
        with pytest.raises(fb.SceneError, match=text):
            fb.Bushing(ORIGIN, body, "m", **arguments)
    with pytest.raises(fb.SceneError, match="point mass 'bob' has no rotation"):
        fb.Bushing(ORIGIN, BOB, "m", stiffness=np.eye(6))


def test_what_runs_refuse() -> None:
    lossy = fb.compile_scene(fb.Scene(BOB, fb.Damper(ORIGIN, BOB, "d", damping=1.0)))
    with pytest.raises(fb.SceneError, match="method 'midpoint' does not support damping of damper 'd'"):
        fb.simulate(lossy, t_end=0.1, step=0.01, method="midpoint", progress=False)
    body = fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    mount = fb.compile_scene(fb.Scene(body, fb.Bushing(ORIGIN, body, "m", stiffness=np.eye(6))))
    with pytest.raises(fb.SceneError, match="method 'generalized_alpha' does not support bushings"):
        fb.simulate(mount, t_end=0.1, step=0.01, method="generalized_alpha", progress=False)
    plain = fb.simulate(lossy, t_end=0.02, step=0.01, progress=False)
    with pytest.raises(fb.SceneError, match="observe=.'spring'"):
        plain.spring("d")
    seen = fb.simulate(lossy, t_end=0.02, step=0.01, observe=("energy", "spring"), progress=False)
    with pytest.raises(fb.SceneError, match="spring 'x' is not in this result: choose from 'd'"):
        seen.spring("x")


def test_drift_of_the_energy_is_measured_by_the_motion_where_springs_are_loaded_at_the_start() -> None:
    scene = fb.Scene(BOB, fb.Spring(ORIGIN, BOB, "s", stiffness=200.0, length=0.7), gravity=(0, 0, -9.81))
    result = fb.simulate(fb.compile_scene(scene), t_end=0.1, step=0.01, progress=False)
    assert result.info["scale"]["total"] == pytest.approx(np.max(np.abs(result.series["potential"])), rel=0.5)


def test_drift_of_the_energy_is_measured_by_the_motion_where_beams_are_prestressed() -> None:
    wire = fb.Section.circle(radius=0.002, E=2e11, rho=7850.0)
    string = fb.Beam.straight("string", (0, 0, 0), (10, 0, 0), section=wire, elements=4, prestress=2e4)
    scene = fb.Scene(string, fb.Pin(string.start), fb.Pin(string.end), gravity=(0, 0, -9.81))
    result = fb.simulate(fb.compile_scene(scene), t_end=0.02, step=0.01, progress=False)
    assert result.info["scale"]["total"] == pytest.approx(0.5 * 2e4**2 * 10 / wire.EA, rel=0.01)
