"""Nets from arrays: the same motion as beams and joints one by one, shared rows, errors, and no work in Python for each beam."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from counted import calls

import fastbeam as fb
from fastbeam.model.feature import OfRun
from fastbeam.model.workspace import work_of
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
ROUND = fb.Section.circle(radius=0.03, E=2e8, rho=800.0, name="round")
FLAT = fb.Section.rectangle(height=0.05, width=0.03, E=2e8, rho=800.0, name="flat")


def grid(m: int, seed: int = 0) -> tuple[Array, Array]:
    """Nodes [(m + 1)^2, 3] and edges of a square net, off the plane at random."""
    k = np.arange((m + 1)**2).reshape(m + 1, m + 1)
    x, y = np.divmod(k, m + 1)
    nodes = np.stack((x, y, 0.2 * np.random.default_rng(seed).standard_normal(x.shape)), axis=-1).reshape(-1, 3)
    return nodes, np.concatenate([np.stack((a, b), axis=-1).reshape(-1, 2) for a, b in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])


class Twin:
    """The beams, joints, supports, masses and loads of a net, one by one."""

    def __init__(self, net: fb.Net) -> None:
        self.beams = [fb.Beam.straight(f"{net.name}[{k}]", net.nodes[i], net.nodes[j], section=net.sections[net.section_of[k]],
                                       elements=int(net.elements[k]), degree=net.degree, strain=net.strain)
                      for k, (i, j) in enumerate(net.edges.tolist())]
        ends: dict[int, list[fb.NodeRef]] = {}
        for beam, (i, j) in zip(self.beams, net.edges.tolist()):
            ends.setdefault(i, []).append(beam.start)
            ends.setdefault(j, []).append(beam.end)
        self.node = {i: refs[0] for i, refs in ends.items()}
        self.parts: list[Any] = [*self.beams]
        for i, (first, *others) in sorted(ends.items()):
            self.parts += [(fb.BallJoint if net.ball[i] else fb.RigidConnection)(first, other) for other in others]
        self.parts += [fb.Pin(self.node[int(i)]) for i in net.pins]
        self.parts += [fb.Clamp(self.node[int(i)]) for i in net.clamps]
        for i, load in enumerate([] if net.loads is None else net.loads):
            self.parts.append(fb.Load(f"load {i}", self.node[i], force=load, time=net.time))
        for i, mass in enumerate([] if net.masses is None else net.masses):
            if mass > 0.0:
                lump = fb.PointMass(f"mass {i}", mass=mass, position=net.nodes[i])
                self.parts += [lump, fb.RigidConnection(self.node[i], lump)]

    def position(self, model: fb.Model, state: Any) -> Array:
        """Positions of the nodes of the net."""
        q = state.q.reshape(-1, 12)
        return np.array([q[model.numbers.number(self.node[i]), :3] for i in sorted(self.node)])


def position(net: fb.Net, model: fb.Model, state: Any) -> Array:
    q = state.q.reshape(-1, 12)
    return q[model.numbers.start(net) + net.junction, :3]


def mixed(n: int) -> Array:
    return np.where(np.arange(n) % 3 == 0, "ball", "rigid")


def make(joints: Any, **options: Any) -> fb.Net:
    nodes, edges = grid(2)
    words = mixed(len(nodes)) if joints == "mixed" else joints
    return fb.Net("net", nodes, edges, section=[ROUND, FLAT], section_of=np.arange(len(edges)) % 2, degree=2,
                  elements=1 + np.arange(len(edges)) % 2, joints=words, **options)


def attached(net: fb.Net, node: Callable[[int], fb.NodeRef], beam: Callable[[int], fb.Beam]) -> list[Any]:
    """A body on a rigid arm, one on a ball joint, a bead on a beam, a clamp of an end."""
    arm = fb.RigidBody("arm", mass=0.4, inertia=(0.01, 0.02, 0.02), position=net.nodes[4] + (0.2, 0.1, 0.3))
    bob = fb.RigidBody("bob", mass=0.5, inertia=(0.01, 0.01, 0.01), position=net.nodes[2] - (0.0, 0.0, 0.4))
    bead = fb.PointMass("bead", mass=0.2)
    return [arm, bob, bead, fb.RigidConnection(node(4), arm), fb.BallJoint(node(2), bob.point((0.0, 0.0, 0.4))),
            fb.Slider("bead on 3", bead, beam(3), at=0.4, rate=0.0), fb.Clamp(beam(9).end)]


# ------------------------------------------------------------------------------------------- the same as one beam at a time
@pytest.mark.parametrize("joints", ["rigid", "ball", "mixed"])
def test_a_net_moves_like_its_beams_and_joints(joints: str) -> None:
    nodes, _ = grid(2)
    loads = np.zeros_like(nodes)
    loads[5] = (1.0, -2.0, 3.0)
    net = make(joints, pins=[0], masses=0.1 * (np.arange(len(nodes)) % 2), loads=loads, time=lambda t: 1.0 + t)
    twin = Twin(net)
    spin = fb.RigidMotion(spin=(0.4, -0.2, 0.5), about=nodes[0])
    runs = []
    for parts in ((net, spin), (*twin.parts, spin)):
        model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -9.81)))
        runs.append((model, fb.simulate(model, t_end=0.1, step=0.01, progress=False)))
    (one, a), (many, b) = runs
    assert one.n_unknowns == many.n_unknowns
    moved = np.abs(twin.position(many, b.state) - nodes).max()
    assert moved > 0.01
    np.testing.assert_allclose(position(net, one, a.state), twin.position(many, b.state), rtol=0, atol=1e-11 * moved)
    np.testing.assert_allclose(a.series["total"], b.series["total"], rtol=1e-12)
    np.testing.assert_allclose(a.series["ang_mom"], b.series["ang_mom"], rtol=0, atol=1e-11 * np.abs(b.series["ang_mom"]).max())


@pytest.mark.parametrize("joints", ["rigid", "ball", "mixed"])
def test_bodies_and_sliders_on_a_net(joints: str) -> None:
    net = make(joints)
    twin = Twin(net)
    ends = []
    for parts in ((net, *attached(net, net.node, net.beam)),
                  (*twin.parts, *attached(net, twin.node.__getitem__, twin.beams.__getitem__))):
        model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -9.81)))
        ends.append((model, fb.simulate(model, t_end=0.05, step=0.005, progress=False)))
    (one, a), (many, b) = ends
    moved = np.abs(position(net, one, a.state) - net.nodes).max()
    assert moved > 1e-3
    np.testing.assert_allclose(position(net, one, a.state), twin.position(many, b.state), rtol=0, atol=1e-10 * moved)
    np.testing.assert_allclose(a.state.s, b.state.s, rtol=1e-12)
    assert a.drift("total") < 1e-12
    assert a.drift("gap") < 1e-14


def test_consistent_accelerations_of_shared_rows() -> None:
    net = make("mixed", pins=[0])
    twin = Twin(net)
    ends = []
    for parts in ((net,), twin.parts):
        model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -9.81)))
        ends.append((model, fb.simulate(model, t_end=0.02, step=0.005, method="generalized_alpha", progress=False)))
    (one, a), (many, b) = ends
    np.testing.assert_allclose(position(net, one, a.state), twin.position(many, b.state), rtol=0, atol=1e-13)


def test_velocities_of_a_net_are_projected_like_those_of_beams() -> None:
    net = make("mixed", clamps=[1])
    twin = Twin(net)
    push = fb.RigidMotion(velocity=(0.3, 0.1, -0.2), spin=(0.0, 0.4, 0.0))
    one, many = (fb.compile_scene(fb.Scene(*parts, push, project_velocities=True)) for parts in ((net,), twin.parts))
    v = [x.v0.reshape(-1, 12)[:net.n_nodes] for x in (one, many)]
    assert np.abs(v[0]).max() > 0.1
    np.testing.assert_allclose(v[0], v[1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("solver", ["chain", "sparse"])
def test_a_welded_net_bends_like_its_beams(solver: str) -> None:
    nodes, _ = grid(2)
    loads = np.zeros_like(nodes)
    loads[:, 2] = -3.0
    net = make("rigid", clamps=[0, 2], pins=[8], loads=loads)
    twin = Twin(net)
    one, many = (fb.compile_scene(fb.Scene(*parts), solver=solver) for parts in ((net,), twin.parts))
    a, b = fb.solve_static(one), fb.solve_static(many)
    moved = np.abs(position(net, one, a.state) - nodes).max()
    assert moved > 0.01
    np.testing.assert_allclose(position(net, one, a.state), twin.position(many, b.state), rtol=0, atol=1e-10 * moved)


# ----------------------------------------------------------------------------------------------------------- what it is made of
def test_welded_ends_share_a_row_and_ball_joints_a_position() -> None:
    nodes, edges = grid(2)
    for joints in ("rigid", "ball"):
        net = fb.Net("net", nodes, edges, section=ROUND, joints=joints, degree=1)
        model = fb.compile_scene(fb.Scene(net))
        rows = model.pattern.row_of[net.end_node].reshape(-1)
        junction = model.pattern.row_of[net.junction][edges].reshape(-1)
        if joints == "rigid":
            assert model.ties is None
            assert np.array_equal(rows, junction)
            assert model.n_unknowns == 6 * len(nodes)
        else:
            assert np.unique(rows).size == 2 * len(edges)
            assert model.n_unknowns == 3 * len(nodes) + 3 * 2 * len(edges)


def test_shapes_meet_the_nodes_exactly() -> None:
    net = make("rigid")
    x = net.positions
    assert np.array_equal(x[net.end_node], net.nodes[net.edges])
    for k in (0, 5, 11):
        beam = net.beam(k)
        assert beam is net.beam(k)
        phi, d = beam.reference(beam.node_s)
        part = slice(net.node_start[k], net.node_start[k + 1])
        np.testing.assert_allclose(x[part], phi, rtol=0, atol=1e-14)
        np.testing.assert_allclose(net.directors[part], d, rtol=0, atol=1e-14)


def test_hints_turn_the_sections() -> None:
    nodes, edges = grid(1)
    hint = np.array([(0.0, 0.0, 1.0), (0.1, 0.2, 1.0), (0.0, 1.0, 1.0), (1.0, 0.0, 1.0)])
    net = fb.Net("net", nodes, edges, section=FLAT, d2=hint)
    for k, (i, j) in enumerate(edges.tolist()):
        beam = fb.Beam.straight("beam", nodes[i], nodes[j], section=FLAT, elements=1, d2=hint[k])
        np.testing.assert_allclose(net.triads[k], beam.reference([0.0])[1][0], rtol=0, atol=1e-14)


def test_velocities_are_linear_and_swing_bars_between_ball_joints() -> None:
    nodes = np.array([(0.0, 0, 0), (2.0, 0, 0)])
    for joints, spin in (("ball", (0.0, 0.0, 1.5)), ("rigid", (0.0, 0.0, 0.0))):
        net = fb.Net("bar", nodes, [(0, 1)], section=ROUND, elements=2, degree=1, joints=joints,
                     velocity=[(0.0, 0, 0), (0.0, 3.0, 0)])
        v, omega = net.motion
        np.testing.assert_allclose(v, [(0, 0, 0), (0, 1.5, 0), (0, 3, 0)], atol=1e-15)
        np.testing.assert_allclose(omega, [spin] * 3, atol=1e-15)
    # which is exactly the motion of a rigid pendulum: supports allow it
    net = fb.Net("bar", nodes, [(0, 1)], section=ROUND, elements=2, joints="ball", pins=[0],
                 velocity=[(0.0, 0, 0), (0.0, 3.0, 0)])
    model = fb.compile_scene(fb.Scene(net))
    assert fb.simulate(model, t_end=0.05, step=0.01, progress=False).drift("total") < 1e-13


def test_a_clamp_of_a_ball_joint_holds_every_rotation() -> None:
    net = fb.Net("net", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1), (0, 2)], section=ROUND, joints="ball", clamps=[0])
    state = fb.simulate(fb.compile_scene(fb.Scene(net, gravity=(0, 0, -9.81))), t_end=0.05, step=0.01, progress=False).state
    d = state.q.reshape(-1, 4, 3)[:, 1:]
    assert np.array_equal(d[net.end_node[:, 0]], net.triads)
    assert np.abs(d[net.end_node[:, 1]] - net.triads).max() > 1e-4


# -------------------------------------------------------------------------------------------------------------------- statics
def test_statics_of_a_ball_net_holds_the_spin_that_nothing_holds() -> None:
    # a tripod of trusses: every bar could spin about its axis without any stress
    nodes = [(0, 0, 1.0), (1, 0, 0), (-0.5, 0.9, 0), (-0.5, -0.9, 0)]
    net = fb.Net("tripod", nodes, [(0, 1), (0, 2), (0, 3)], section=ROUND, elements=2, joints="ball", pins=[1, 2, 3],
                 loads=[(3.0, 1.0, -20.0), (0, 0, 0), (0, 0, 0), (0, 0, 0)])
    model = fb.compile_scene(fb.Scene(net))
    assert model.static_held.mask.size > model.held.mask.size or model.static_held.mask.sum() > model.held.mask.sum()
    result = fb.solve_static(model)
    # all equations hold at the equilibrium, also those that were left out
    from fastbeam.kernels import loop as kernels
    from fastbeam.kernels.call_tables import AT_REST, Calls, SystemRecord
    from fastbeam.kernels.terms import AtRest
    from fastbeam.stepping.terms import system_of, terms_of
    work = work_of(model, rates=True)
    kernels.external_forces(model.loads, np.ones(1), work.f_ext)
    work.u[:] = 0.0
    system = SystemRecord(system_of(model, AtRest(), None, None, result.state, work), AT_REST)
    kernels.assemble_all(*Calls(terms_of(OfRun(model)), AT_REST).on(system), 0.0)
    assert np.abs(work.r[:-8]).max() < 1e-9 * 20.0
    top = position(net, model, result.state)[0]
    assert np.linalg.norm(top - nodes[0]) > 1e-5


def test_a_soft_net_is_solved_although_its_residual_is_large_beside_the_load() -> None:
    nodes, edges = grid(70)
    rim = np.flatnonzero((nodes[:, :2].min(axis=1) == 0) | (nodes[:, :2].max(axis=1) == 70))
    bar = fb.Section.circle(radius=0.02, E=1e9, rho=1000.0)
    net = fb.Net("net", nodes, edges, section=bar, elements=2, degree=2, pins=rim, loads=np.tile((0, 0, -1e-4), (len(nodes), 1)))
    result = fb.solve_static(fb.compile_scene(fb.Scene(net), solver="sparse"), load_step=1.0)
    assert len(result.t) == 2
    assert "0 steps fell back" in result.info["solver"]


@pytest.mark.parametrize("case", ["flat section", "moment", "clamped end", "body"])
def test_no_other_spin_is_held(case: str) -> None:
    net = fb.Net("net", [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1), (1, 2)], section=FLAT if case == "flat section" else ROUND,
                 joints="ball", pins=[0, 2])
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(0.5, 0, 0))
    extra = {"flat section": [], "moment": [fb.Load("m", net.beam(0).node(1), moment=(1, 0, 0))],
             "clamped end": [fb.Clamp(net.beam(0).start)], "body": [body, fb.RigidConnection(net.beam(0).node(1), body)]}[case]
    model = fb.compile_scene(fb.Scene(net, *extra))
    more = model.static_held.mask.sum() - model.held.mask.sum()
    # d1 = e_x: component 3 of a beam that nothing else touches
    assert more == {"flat section": 0}.get(case, 8)


# ---------------------------------------------------------------------------------------------------------------- large scenes
@pytest.mark.parametrize("condense", [True, False])
@pytest.mark.parametrize("joints", ["rigid", "ball"])
def test_compiling_a_net_calls_no_function_for_each_beam(joints: str, condense: bool) -> None:
    def build(m: int) -> None:
        nodes, edges = grid(m)
        net = fb.Net("net", nodes, edges, section=ROUND, degree=2, elements=2, joints=joints, pins=np.arange(m),
                     masses=np.ones(len(nodes)))
        fb.compile_scene(fb.Scene(net, gravity=(0, 0, -9.81)), solver="sparse", condense=condense)

    build(3)  # imports
    few, many = calls(lambda: build(10)), calls(lambda: build(30))
    print(f"{few} calls for 220 beams, {many} for 1860")
    assert many < few + 100


def test_conservation_of_a_net_in_free_flight() -> None:
    nodes, edges = grid(10)
    soft = fb.Section.circle(radius=0.03, E=2e6, rho=800.0)
    x, y, _ = nodes.T
    velocity = np.stack((0.3 * np.sin(y), 0.2 * np.cos(x), np.sin(0.6 * x) * np.cos(0.5 * y)), axis=1)
    net = fb.Net("net", nodes, edges, section=soft, elements=1 + np.arange(len(edges)) % 2, degree=2, joints=mixed(len(nodes)),
                 masses=0.05 * (np.arange(len(nodes)) % 4), velocity=velocity)
    model = fb.compile_scene(fb.Scene(net, fb.RigidMotion(velocity=(0.1, 0.2, 0.05), spin=(0.03, 0.02, 0.05))), solver="sparse")
    result = fb.simulate(model, t_end=0.4, step=0.004, progress=False, output=fb.Output(snapshots=0))
    assert np.ptp(result.series["strain"]) > 0.01 * result.series["total"][0]
    for name in ("total", "lin_mom", "ang_mom"):
        assert result.drift(name) < 1e-13, name
    # ends at one node are not told apart by round-off
    x = result.state.q.reshape(-1, 12)[:, :3]
    assert np.array_equal(x[net.end_node.reshape(-1)], x[net.junction][edges].reshape(-1, 3))


def test_solver_and_elimination_change_nothing() -> None:
    net = make("mixed", pins=[0])
    states = []
    for options in ({"solver": "chain"}, {"solver": "sparse"}, {"solver": "chain", "eliminate_inner": False}):
        stepper = Stepper(fb.compile_scene(fb.Scene(net, gravity=(0, 0, -9.81)), **options), np.ones(1))
        assert stepper.advance(0.0, 0.01, 5).steps == 5
        states.append(stepper.copy_state().q)
    for other in states[1:]:
        np.testing.assert_allclose(states[0], other, rtol=0, atol=1e-12)


def test_two_nets_and_a_beam_of_other_strains_and_degrees() -> None:
    nodes, edges = grid(1)
    options = ({"degree": 1, "strain": "green_lagrange"}, {"degree": 3, "joints": "ball"})
    nets = [fb.Net(f"net {k}", nodes + (0, 0, k), edges, section=ROUND, elements=3, pins=[0], **o) for k, o in enumerate(options)]
    twins = [Twin(net) for net in nets]
    rod = fb.Beam.straight("rod", nodes[1], nodes[1] + (0, 0, 1), section=ROUND, elements=2, degree=2)
    ends = []
    for parts, corners in ((nets, [net.node(1) for net in nets]),
                           ([part for twin in twins for part in twin.parts], [twin.node[1] for twin in twins])):
        joints = fb.RigidConnection(rod.start, corners[0]), fb.BallJoint(rod.end, corners[1])
        model = fb.compile_scene(fb.Scene(rod, *parts, *joints, gravity=(0, 0, -9.81)))
        ends.append((model, fb.simulate(model, t_end=0.05, step=0.01, progress=False)))
    (one, a), (many, b) = ends
    for net, twin in zip(nets, twins):
        np.testing.assert_allclose(position(net, one, a.state), twin.position(many, b.state), rtol=0, atol=1e-13)
    assert a.drift("total") < 1e-13


# ------------------------------------------------------------------------------------------------------------ results and texts
def test_results_know_the_net(tmp_path: Path) -> None:
    net = make("rigid", pins=[0])
    beam = fb.Beam.straight("rod", (5, 0, 0), (6, 0, 0), section=ROUND, elements=2)
    model = fb.compile_scene(fb.Scene(net, beam, gravity=(0, 0, -9.81)))
    result = fb.simulate(model, t_end=0.03, step=0.01, output=fb.Output(snapshots=2), progress=False,
                         points={"corner": net.node(8), "middle": (net.beam(3), 0.3)})
    (entry,) = result.names["nets"]
    assert entry["first"] == beam.n_nodes
    assert [entry[key] for key in ("name", "count")] == ["net", net.n_nodes]
    at = entry["first"] + np.array(entry["junctions"])
    np.testing.assert_allclose(result.phi[0, at], net.nodes, atol=1e-15)
    np.testing.assert_allclose(result.phi[-1, at[8]], result.point("corner")[-1], atol=1e-15)
    result.save(tmp_path / "net.h5")
    assert fb.load_result(tmp_path / "net.h5").names == result.names
    lines = fb.plot_shapes(result, n=1).axes[0].lines
    drawn = max((line.get_data_3d()[0] if hasattr(line, "get_data_3d") else line.get_xdata() for line in lines), key=len)
    # one line for the rod, as the curve that it is, and all beams of the net, with gaps
    assert len(drawn) == 2 * 3 * 4 + 1 + net.n_nodes + len(net.edges)
    assert int(np.isnan(drawn).sum()) == len(net.edges)
    assert "net 'net': 12 beams, 18 elements x 2 points, 9 welded nodes" in str(model)
    assert model.node_label(entry["first"] + int(net.node_start[4])) == "beam 'net[4]' node 0"
    assert "1 net ('net')" in repr(fb.Scene(net))


GOOD: dict[str, Any] = {"nodes": [(0, 0, 0), (1, 0, 0), (1, 1, 0)], "edges": [(0, 1), (1, 2)], "section": ROUND}


@pytest.mark.parametrize(("changes", "text"), [
    ({"nodes": [(0, 0), (1, 0)]}, r"net 'x': nodes must be numbers of shape \[n, 3\] \(m\), got shape \[2, 2\]"),
    ({"nodes": [(0, 0, 0), (1, 0, np.nan), (1, 1, 0)]}, "nodes must be finite .* node 1 has"),
    ({"edges": [(0, 1), (1, 3)]}, "edges must be node numbers from 0 to 2, entry 1 has 3"),
    ({"edges": [(0.0, 1.0)]}, "edges must be node numbers .* array of float64"),
    ({"edges": np.zeros((0, 2), int)}, "at least one pair"),
    ({"edges": [(0, 1), (0, 1)]}, "node 2 belongs to no edge"),
    ({"edges": [(0, 1), (2, 2)]}, "edge 1 joins nodes 2 and 2, which coincide"),
    ({"section": "steel"}, "section must be a Section or a list"),
    ({"section": [ROUND, FLAT]}, r"has 2 sections; assign them to edges with section_of"),
    ({"section": [ROUND, FLAT], "section_of": [0, 2]}, "section numbers from 0 to 1, entry 1 has 2"),
    ({"elements": 0}, "elements must be whole numbers >= 1 .*, entry 0 has 0"),
    ({"elements": [1, 2, 3]}, r"shape \[2\], got .* shape \[3\]"),
    ({"degree": 9}, "degree=9 lies outside 1 to 8"),
    ({"strain": "engineering"}, "strain 'engineering' does not exist"),
    ({"joints": "hinge"}, "joints must be 'rigid', 'ball'"),
    ({"joints": ["ball", "rigid"]}, "for each of the 3 nodes"),
    ({"pins": [3]}, "pins must be node numbers from 0 to 2, entry 0 has 3"),
    ({"masses": [1.0, -1.0, 0.0]}, "masses must be >= 0 kg, node 1 has -1"),
    ({"loads": [(0, 0, 1)]}, r"loads must be numbers of shape \[3, 3\] \(N\)"),
    ({"time": 3.0}, "time must be a function of t"),
    ({"velocity": [1.0, 2.0]}, "velocity must be numbers"),
    ({"d2": (1.0, 0.0, 0.0)}, "of edge 0 is parallel to its axis"),
    ({"d2": [(0, 0, 1)]}, r"shape \[2, 3\], got shape \[1, 3\]"),
    ({"name": ""}, "name must be a non-empty text"),
])
def test_bad_arrays_are_refused_by_name(changes: dict[str, Any], text: str) -> None:
    arguments = {"name": "x", **GOOD, **changes}
    with pytest.raises(fb.SceneError, match=text):
        fb.Net(arguments.pop("name"), arguments.pop("nodes"), arguments.pop("edges"), **arguments)


def test_wrong_uses_are_refused() -> None:
    net = fb.Net("net", **{key: GOOD[key] for key in ("nodes", "edges", "section")})
    other = fb.Net("other", **{key: GOOD[key] for key in ("nodes", "edges", "section")})
    for bad in (lambda: net.beam(2), lambda: net.node(-1), lambda: net.node("a")):
        with pytest.raises(fb.SceneError, match="does not exist, they run from 0 to"):
            bad()
    with pytest.raises(fb.SceneError, match="beam 'net.0.' belongs to net 'net'; add the net"):
        fb.Scene(net.beam(0))
    with pytest.raises(fb.SceneError, match="names the whole net 'net'; use its node"):
        fb.Pin(net)
    with pytest.raises(fb.SceneError, match="use its beam"):
        fb.Slider("s", net.node(0), net, at=0.0)
    with pytest.raises(fb.SceneError, match="is not in scene"):
        fb.Scene(net, fb.Pin(other.node(0))).check()
    model = fb.compile_scene(fb.Scene(net))
    with pytest.raises(fb.SceneError, match="is not in scene"):
        fb.simulate(model, t_end=0.1, step=0.1, points={"p": other.node(0)})
    with pytest.raises(fb.SceneError, match="connection of beam 'net.1.' node 0"):
        fb.compile_scene(fb.Scene(net, fb.InitialVelocity(net.beam(0), velocity=(1, 0, 0))))
