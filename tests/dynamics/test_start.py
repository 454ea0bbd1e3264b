"""What a run may start from: states that joints, supports and sliders do not allow are refused or mended, never run as they are;
states of one model as states of another."""
from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.mapping import contact, curve_at, follow

sys.path.insert(0, str(Path(__file__).parents[1]))
from planar_scenes import mechanism  # noqa: E402
from small_scenes import bead, straight  # noqa: E402

Array = np.ndarray
H = 1e-3


def crane() -> fb.Scene:
    """Clamped boom, a body on a rigid offset at its end, and a bob on a ball joint below it; flies as far as it can."""
    boom = straight("boom", (0, 0, 0), (3, 0, 0))
    head = fb.RigidBody("head", mass=2.0, inertia=(0.3, 0.4, 0.5), position=(3.2, 0.3, 0))
    bob = fb.RigidBody("bob", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(3.2, 0.3, -0.5))
    return fb.Scene(boom, head, bob, fb.Clamp(boom.start), fb.RigidConnection(boom.end, head, name="weld"),
                    fb.BallJoint(head, bob.point((0, 0, 0.5)), name="hook"), gravity=(0, 0, -9.81))


def flight() -> fb.Scene:
    """The crane without clamp and weight, turning."""
    parts = [part for part in crane().parts if not isinstance(part, fb.Clamp)]
    return fb.Scene(*parts, fb.RigidMotion(velocity=(0.5, 0, 0.2), spin=(0.3, 1.0, 2.0)))


def at(model: fb.Model, what: object) -> int:
    return model.numbers.number(what) if isinstance(what, fb.NodeRef) else model.numbers.start(what)


def refused(model: fb.Model, start: object, message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.simulate(model, start=start, t_end=0.01, step=H)


# ------------------------------------------------------------------------------------------------------------ refusals
def test_an_open_ball_joint_is_refused_with_its_name_and_size() -> None:
    scene = crane()
    model, bob = fb.compile_scene(scene), scene.bodies[1]
    state = model.state()
    state.q.reshape(-1, 4, 3)[at(model, bob), 0] += (0.0, 0.0, 0.3)
    refused(model, state, r"start: body 'bob' \(hook\) stands 0.3 m off \(allowed: .*\); this is too large to be mended, or "
                          r"start from a state of a run")


def test_a_wrong_rigid_offset_is_refused_with_its_name_and_size() -> None:
    # it lost 64 % of the angular momentum
    scene = flight()
    model, head, bob = fb.compile_scene(scene), *scene.bodies
    state = model.state()
    x = state.q.reshape(-1, 4, 3)
    for k in {at(model, head), at(model, bob), *range(at(model, head), model.n_nodes)}:
        x[k, 0] += (0.0, 0.5, 0.0)
    refused(model, state, r"start: .*\(weld.*\) stands 0.5 m off")
    state = model.state()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    state.q.reshape(-1, 4, 3)[at(model, scene.beams[0].end), 1:] @= turn
    refused(model, state, r"start: .*weld.* is turned by 1.57 rad off")


def around(axis: tuple[float, float, float], angle: float) -> Array:
    n = np.array(axis) / np.linalg.norm(axis)
    x = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return np.eye(3) + np.sin(angle) * x + (1.0 - np.cos(angle)) * x @ x


@pytest.mark.parametrize("angle", [1e-3, 0.3, 1.5])
@pytest.mark.parametrize(("kind", "axis", "says"), [
    (fb.RigidConnection, (1, 2, 3), r"body 'wheel' \(arm\) is turned by"),
    (fb.RevoluteJoint, (1, 0, 1), r"revolute joint 'arm' \(directions\): its directions are"),
    (fb.UniversalJoint, (1, 0, 0), r"universal joint 'arm' \(directions\): its directions are")])
def test_sizes_of_turns_are_angles(kind: type, axis: tuple[float, float, float], says: str, angle: float) -> None:
    frame = fb.RigidBody("frame", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    wheel = fb.RigidBody("wheel", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    more = {fb.RigidConnection: {}, fb.RevoluteJoint: {"axis": (0, 1, 0)},
            fb.UniversalJoint: {"axis_a": (0, 1, 0), "axis_b": (0, 0, 1)}}[kind]
    a, b = (frame, wheel) if kind is fb.RigidConnection else (frame.point((1.0, 0, 0)), wheel)
    model = fb.compile_scene(fb.Scene(frame, wheel, kind(a, b, "arm", **more)), planar=False)
    state = model.state()
    node = at(model, wheel)
    q = state.q.reshape(-1, 4, 3)
    for k in range(model.n_nodes):
        if k == node or "'wheel'" in model.labels[k]:
            q[k, 1:] = q[k, 1:] @ around(axis, angle).T
    refused(model, state, f"start: {says} {angle:.3g} rad off")


def test_velocities_that_a_joint_or_a_support_does_not_allow_are_refused() -> None:
    scene = crane()
    model = fb.compile_scene(scene)
    boom, (_, bob) = scene.beams[0], scene.bodies
    state = model.state()
    state.v.reshape(-1, 4, 3)[at(model, bob), 0] = (1.0, 0.0, 0.0)
    refused(model, state, r"start: the velocity of .*\(hook.*\) is 1 m/s off")
    state = model.state()
    state.v.reshape(-1, 4, 3)[at(model, boom.start), 0] = (0.0, 2.0, 0.0)
    refused(model, state, r"start: the support of beam 'boom' node 0: its velocity is 2 m/s off")
    state = model.state()
    state.v.reshape(-1, 4, 3)[at(model, boom.start), 2] = (2.0, 0.0, 0.0)
    refused(model, state, r"start: the support of beam 'boom' node 0: its spin, times the size of the scene, is 6.\d* m/s off")


def test_a_slider_off_its_beam_is_refused_with_its_size() -> None:
    model = fb.compile_scene(bead())
    state = model.state()
    state.s[0] += 0.01
    refused(model, state,
            r"start: slider 'run': its point lies 0.01 m off .*; correct it with start=Start\(state, mend=True\)")
    state = model.state()
    state.q.reshape(-1, 4, 3)[-1, 0] += (0.0, 1.0, 0.0)
    refused(model, state, r"start: slider 'run': its point lies 1 m off .*; this is too large to be mended")
    refused(model, fb.Start(state, mend=True),
            r"start: slider 'run': its point lies 1 m off .*; Start\(mend=True\) corrects errors up to 0.03 m")
    state = model.state()
    state.v.reshape(-1, 4, 3)[-1, 0] += (0.0, 50.0, 0.0)
    refused(model, state, r"start: slider 'run': the velocity of its point across the beam is 50 m/s off")


def test_a_torn_weld_of_a_net_is_refused() -> None:
    nodes, edges = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1), (1, 2), (2, 3), (3, 0)]
    net = fb.Net("net", nodes, edges, section=straight("b", (0, 0, 0), (1, 0, 0)).section, elements=2, degree=2, clamps=[0])
    model = fb.compile_scene(fb.Scene(net, gravity=(0, 0, -1)))
    fb.simulate(model, start=model.state(), t_end=0.01, step=H)
    state = model.state()
    shared = np.flatnonzero(model.pattern.row_of == model.pattern.row_of[int(net.junction[2])])
    assert shared.size == 2
    state.q.reshape(-1, 4, 3)[shared[1], 0] += (0, 0, 0.05)
    refused(model, state, r"start: beam 'net\[2\]' node 0 stands 0.05 m off")
    with pytest.raises(fb.SceneError, match=r"start: beam 'net\[2\]' node 0 stands 0.05 m off"):
        fb.solve_static(model, start=state)


def test_a_support_holds_its_node_where_the_start_has_it_and_says_so() -> None:
    # a string is stretched by moving its end
    rope = straight("rope", (0, 0, 0), (3, 0, 0))
    model = fb.compile_scene(fb.Scene(rope, fb.Clamp(rope.start), fb.Clamp(rope.end)))
    state = model.state()
    x = state.q.reshape(-1, 4, 3)[:, 0]
    x *= 1.01
    says = "the support of beam 'rope' node 6 is 0.03 m away from its place in the model, and fixes the node at this distance"
    still = fb.solve_static(model, start=state)
    assert [e["text"] for e in still.events] == [says]
    np.testing.assert_allclose(still.state.q.reshape(-1, 4, 3)[-1, 0], (3.03, 0, 0), rtol=1e-15)
    run = fb.simulate(model, start=still.state, t_end=0.01, step=H)
    assert [(e["kind"], e["text"]) for e in run.events] == [("support", says)]
    # at rest under 1 % of strain
    assert abs(run.series["strain"][-1] - 0.5 * 1e4 * 0.01**2 * 3) < 1e-9


def test_paths_and_adjoint_runs_say_it_too() -> None:
    rope = straight("rope", (0, 0, 0), (3, 0, 0))
    model = fb.compile_scene(fb.Scene(rope, fb.Clamp(rope.start), gravity=(0, 0, -1e-4)))
    state = model.state()
    state.q.reshape(-1, 4, 3)[:, 0] += (0, 0, 0.5)
    says = "the support of beam 'rope' node 0 is 0.5 m away from its place in the model, and fixes the node at this distance"
    path = fb.solve_path(model, start=state, load_factor=0.0, most_points=3)
    assert [(e["kind"], e["time"], e["text"]) for e in path.events][0] == ("support", 0.0, says)
    assert [(e["kind"], e["text"]) for e in fb.adjoint_run(model, start=state, t_end=2 * H, step=H).events] == [("support", says)]
    path = fb.solve_path(model, start=model.state(), load_factor=0.0, most_points=3)
    assert [e["kind"] for e in path.events] == ["stopped"]
    assert fb.adjoint_run(model, start=model.state(), t_end=2 * H, step=H).events == fb.adjoint_run(
        model, t_end=2 * H, step=H).events == []


# --------------------------------------------------------------------------------------------------- states of runs
@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("h", [0.05, H])
def test_states_of_runs_pass_bit_for_bit(planar: str | bool, h: float) -> None:
    for scene in (bead(), mechanism(), flight(), crane()):
        model = fb.compile_scene(scene, planar=planar)
        there = fb.simulate(model, t_end=20 * h, step=h, output=fb.Output(snapshots=0)).state
        # a coarse run leaves sliders sideways speeds that mending would take away
        for mend in (False, True)[:1 + (h == H)]:
            begin = fb.simulate(model, start=fb.Start(there, mend=mend), t_end=h, step=h, output=fb.Output(snapshots=2))
            assert not [event for event in begin.events if event["kind"] == "mended"]
            if planar is False:
                q = there.q.reshape(-1, 4, 3)
                np.testing.assert_array_equal(begin.phi[0], q[:, 0])
                np.testing.assert_array_equal(begin.directors[0], q[:, 1:])


def test_a_slider_that_goes_sideways_is_told_unless_the_run_goes_on() -> None:
    model = fb.compile_scene(bead())
    coarse = fb.simulate(model, t_end=2.0, step=0.1)
    (event,) = [e for e in fb.simulate(model, start=coarse.state, t_end=0.1, step=H).events if e["kind"] == "start"]
    assert "slider 'run': the velocity of its point across the beam is" in event["text"]
    assert not [e for e in fb.simulate(model, start=coarse.checkpoint, t_end=2.2, step=0.1).events if e["kind"] == "start"]
    mended = fb.simulate(model, start=fb.Start(coarse.state, mend=True), t_end=0.1, step=H)
    assert mended.events[0]["kind"] == "mended"


@pytest.mark.slow
def test_round_off_of_many_steps_passes() -> None:
    """It grows as a walk (perf/stress/drift.py)."""
    model = fb.compile_scene(mechanism(sliding=False))
    there = fb.simulate(model, t_end=2e5 * H, step=H, every=200_000, output=fb.Output(snapshots=0), observe=(), progress=False)
    assert there.info["steps"] == 200_000
    fb.simulate(model, start=there.state, t_end=H, step=H)


# -------------------------------------------------------------------------------------------------------------- mending
def test_a_slider_slightly_off_its_beam_is_mended() -> None:
    model = fb.compile_scene(bead(), planar=False)
    state = fb.simulate(model, t_end=0.1, step=H).state
    state.q.reshape(-1, 4, 3)[-1, 0] += (0.003, 0.005, -0.004)
    result = fb.simulate(model, start=fb.Start(state, mend=True), t_end=0.1, step=H, every=1)
    # round-off of what is left is closed as in any step
    assert np.max(result.series["gap"]) < 1e-13
    # over the tolerance of an event
    assert [e["kind"] for e in result.events] == ["mended"]
    assert "slider 'run': its point lies 0.00" in result.events[0]["text"]
    assert result.drift("total") < 1e-12 and result.drift("ang_mom") < 1e-12
    # the bead moves and, by their masses, the beam, which is not bent: its nodes keep their distances
    before, after = (x[:-1, None] - x[None, :-1] for x in (state.q.reshape(-1, 4, 3)[:, 0], result.phi[0]))
    np.testing.assert_allclose(np.linalg.norm(after, axis=2), np.linalg.norm(before, axis=2), atol=1e-13)
    moved = np.linalg.norm(result.phi[0] - state.q.reshape(-1, 4, 3)[:, 0], axis=1)
    assert moved[-1] < 0.00708


def test_joints_and_velocities_are_mended() -> None:
    scene = flight()
    model = fb.compile_scene(scene)
    state = fb.simulate(model, t_end=0.1, step=H).state
    good = state._replace(q=state.q.copy(), v=state.v.copy())
    node = at(model, scene.beams[0].end)
    rng = np.random.default_rng(1)
    state.q.reshape(-1, 4, 3)[node, 0] += 1e-3 * rng.standard_normal(3)
    state.v.reshape(-1, 4, 3)[node, 0] += 1e-3 * rng.standard_normal(3)
    result = fb.simulate(model, start=fb.Start(state, mend=True), t_end=0.1, step=H)
    for name in ("total", "lin_mom", "ang_mom"):
        assert result.drift(name) < 1e-12, name
    np.testing.assert_allclose(result.phi[0], good.q.reshape(-1, 4, 3)[:, 0], atol=5e-3)


# ----------------------------------------------------------------------------------------------- from model to model
def test_curves_agree_with_those_of_the_kernels() -> None:
    for curve in ("c1", "own"):
        beam, mass = straight("b", (0, 0, 0), (3, 0, 0)), fb.PointMass("m", mass=1.0)
        model = fb.compile_scene(fb.Scene(beam, mass, fb.Slider("s", mass, beam, at=1.0, curve=curve)))
        for s in (0.0, 0.3, 1.0, 1.7, 3.0):
            first, values, slopes = beam.basis.curve(curve).evaluate(s)
            nodes, mine, rate = curve_at(model, 0, s)
            expected = np.zeros((2, model.n_nodes))
            for a in np.flatnonzero((values[0] != 0.0) | (slopes[0] != 0.0)):
                expected[:, int(first[0]) + a] = values[0, a], slopes[0, a]
            found = np.zeros((2, model.n_nodes))
            found[:, nodes] = mine, rate
            np.testing.assert_allclose(found, expected, atol=1e-13)


def hanging(*more: object) -> tuple[fb.Scene, fb.Beam]:
    rope = fb.Beam.straight("rope", (0, 0, 0), (3, 0, 0), section=fb.Section.circle(radius=0.02, E=1e7, rho=1000.0), elements=6,
                            degree=2)
    return fb.Scene(rope, fb.Clamp(rope.start), fb.Clamp(rope.end), *more, gravity=(0, 0, -9.81)), rope


def test_a_slider_is_put_on_a_beam_that_hangs_already() -> None:
    hung = fb.solve_static(fb.compile_scene(hanging()[0]))
    scene, rope = hanging()
    trolley = fb.RigidBody("trolley", mass=0.1, inertia=(0.01, 0.01, 0.01), position=(1.0, 0, -0.2))
    ring = fb.PointMass("ring", mass=0.05)
    scene.add(trolley, ring, fb.Slider("wheel", trolley.point((0, 0, 0.2)), rope, at=1.0), fb.Slider("eye", ring, rope, at=2.0,
                                                                                                     rate=0.3))
    model = fb.compile_scene(scene)
    state = hung.state_for(model)
    q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
    # the rope hangs as it did, what is new stands on it
    np.testing.assert_array_equal(q[:rope.n_nodes], hung.state.q.reshape(-1, 4, 3))
    assert q[rope.n_nodes // 2, 0, 2] < -0.05
    for k, speed in ((0, 0.0), (1, 0.3)):
        gap, tangent, relative = contact(model, k, state.s[k], q, v)
        assert np.linalg.norm(gap) < 1e-15
        np.testing.assert_allclose(relative, speed * tangent, atol=1e-15)
    np.testing.assert_array_equal(follow(model, q), q)
    run = fb.simulate(model, start=state, t_end=0.05, step=H)
    # long elements of a thin rope
    assert run.drift("total") < 1e-12 and {event["kind"] for event in run.events} <= {"contact"}


def test_new_bodies_go_where_their_joints_are() -> None:
    hung = fb.solve_static(fb.compile_scene(hanging()[0]))
    scene, rope = hanging()
    middle = rope.node(6)
    lamp = fb.RigidBody("lamp", mass=0.1, inertia=(0.01, 0.01, 0.01), position=(1.5, 0, -0.2))
    bob = fb.PointMass("bob", mass=0.1)
    scene.add(lamp, bob, fb.BallJoint(middle, lamp.point((0, 0, 0.2))), fb.BallJoint(rope.node(3), bob))
    model = fb.compile_scene(scene)
    state = hung.state_for(model)
    q = state.q.reshape(-1, 4, 3)
    np.testing.assert_allclose(q[at(model, lamp), 0], q[6, 0] - (0, 0, 0.2), atol=1e-15)
    np.testing.assert_allclose(q[at(model, bob), 0], q[3, 0], atol=1e-15)
    assert not fb.simulate(model, start=state, t_end=0.01, step=H).events


def test_states_go_back_and_forth_bit_for_bit() -> None:
    model = fb.compile_scene(bead())
    there = fb.simulate(model, t_end=0.1, step=H)
    again = there.state_for(fb.compile_scene(bead(at=2.0)))
    for x, y in zip(again, there.state):
        np.testing.assert_array_equal(x, y)


def test_what_does_not_fit_is_named(tmp_path: Path) -> None:
    run = fb.simulate(fb.compile_scene(bead()), t_end=0.01, step=H, output=tmp_path / "run.h5")
    other = fb.compile_scene(fb.Scene(straight("rail", (0, 0, 0), (3, 0, 0), elements=4)))
    with pytest.raises(fb.SceneError, match="state_for: beam 'rail' has 7 nodes in the result and 9 in the model"):
        run.state_for(other)
    with pytest.raises(fb.SceneError, match="state_for: the nodes of beam 'rail' have other arc lengths"):
        run.state_for(fb.compile_scene(fb.Scene(straight("rail", (0, 0, 0), (4, 0, 0)))))
    with pytest.raises(fb.SceneError, match="no beam, net, body or mass of scene .* has a name that occurs in this result"):
        run.state_for(fb.compile_scene(fb.Scene(straight("bar", (0, 0, 0), (3, 0, 0)))))
    with pytest.raises(fb.SceneError, match="state_for: this result has no state, because files do not contain it"):
        fb.load_result(tmp_path / "run.h5").state_for(other)
    with pytest.raises(fb.SceneError, match="state_for: needs a compiled model"):
        run.state_for(bead())


# ------------------------------------------------------------------------------------------------- supports that move
def lifted(**motion: object) -> tuple[fb.Model, int]:
    beam = straight("beam", (0, 0, 0), (2, 0, 0))
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.PrescribedMotion("lift", beam.end, **motion), gravity=(0, 0, -9.81))
    return fb.compile_scene(scene, planar=False), beam.n_nodes - 1


def said(model: fb.Model, kind: str, **options: object) -> list[str]:
    start = options.get("start")
    begin = (start.time or 0.0) if isinstance(start, fb.Start) else 0.0
    options = {"step": H, "t_end": 0.01 + begin, "progress": False} | options
    return [event["text"] for event in fb.simulate(model, **options).events if event["kind"] == kind]


@pytest.mark.parametrize("motion", [dict(position=lambda t: (2.0, 0.0, 0.1 * t * t)),
                                    dict(displacement=lambda t: (0, 0, 0.1 * t * t)),
                                    dict(displacement=lambda t: 0.1 * t * t, axes="z")])
def test_a_support_that_moves_begins_at_its_place_of_that_time_or_it_is_told(motion: dict[str, object]) -> None:
    model, end = lifted(**motion)
    later = fb.simulate(model, t_end=0.5, step=0.01, progress=False)
    assert said(model, "support") == said(model, "support", start=fb.Start(later.state, time=0.5)) == []
    assert said(model, "support", start=later.checkpoint, t_end=0.51, step=0.01) == []
    says = ("prescribed motion 'lift' begins at t = .* s, but beam 'beam' .* is 0.025 m away from the prescribed place at that "
            "time, and keeps")
    for options in (dict(start=later.state), dict(start=fb.Start(time=0.5))):
        text, = said(model, "support", **options)
        assert re.match(says, text)
    state = model.state()
    state.q.reshape(-1, 4, 3)[end, 0, 2] += 0.01
    text, = said(model, "support", start=state)
    assert "is 0.01 m away" in text


def test_a_support_that_turns_is_looked_at_as_well() -> None:
    model, _ = lifted(rotation=lambda t: (0.3 * t * t, 0, 0), displacement=lambda t: (0, 0, 0))
    later = fb.simulate(model, t_end=1.0, step=0.01, progress=False)
    assert said(model, "support", start=fb.Start(later.state, time=1.0)) == []
    text, = said(model, "support", start=later.state)
    assert "is 0.3 rad away" in text


def test_velocities_of_supports_that_move_are_told_and_mended() -> None:
    model, end = lifted(displacement=lambda t: (0, 0, 0.1 * np.sin(t)))
    state = model.state()
    assert state.v.reshape(-1, 4, 3)[end, 0, 2] == pytest.approx(0.1)
    assert said(model, "shock", start=state) == []
    state.v.reshape(-1, 4, 3)[end, 0, 2] = 5.0
    text, = said(model, "shock", start=state)
    assert text.startswith("the velocity of beam 'beam' node ") and (
        "relative to that of prescribed motion 'lift', is 4.9 m/s" in text)
    assert said(model, "shock", start=fb.Start(state, mend=True)) == []
    assert "was corrected" in said(model, "mended", start=fb.Start(state, mend=True))[0]
    run = fb.simulate(model, start=fb.Start(state, mend=True), t_end=0.5, step=H, progress=False)
    assert run.drift("balance") < 1e-12
    # as if it had begun with the velocity that the support gives
    np.testing.assert_allclose(run.state.q, fb.simulate(model, t_end=0.5, step=H, progress=False).state.q, atol=1e-12)


# ---------------------------------------------------------------------------------------------------------- checkpoints
def test_a_run_goes_on_from_its_checkpoint_however_coarse_its_steps() -> None:
    """A light bead with friction runs over corners: at the end of a step its velocity across the path is as large as its speed,
    which a state from elsewhere were refused for."""
    section = fb.Section(EA=20.0, GA2=50.0, GA3=40.0, GJ=20.0, EI2=140.0, EI3=18.0, rhoA=0.23, rhoI2=0.008, rhoI3=0.2)
    one = fb.Beam.straight("one", (0, 0, 0), (0.65, 0, 0), section=section, elements=4, degree=4)
    two = fb.Beam.straight("two", (0.65, 0, 0), (1.5, 0.7, 0), section=section, elements=2, degree=2)
    bead = fb.PointMass("bead", mass=0.014)
    scene = fb.Scene(one, two, fb.RigidConnection(one.end, two.start), bead, fb.Slider(
        "run", bead, fb.Path("way", (one, two)), at=0.4, rate=4.0, friction=0.3, curve="own"), project_velocities=True)
    model = fb.compile_scene(scene)
    options: dict[str, object] = dict(step=0.012, every=1, progress=False, output=fb.Output(snapshots=0))
    whole = fb.simulate(model, t_end=24 * 0.012, **options)
    across = []
    for k in range(1, len(whole.t) - 1):
        part = fb.simulate(model, t_end=k * 0.012, **options)
        q, v = (x.reshape(-1, 4, 3) for x in part.state[:2])
        _, tangent, relative = contact(model, 0, part.state.s[0], q, v)
        across.append(np.linalg.norm(np.cross(tangent, relative)) / np.linalg.norm(tangent) / np.max(np.abs(v[:, 0])))
        on = fb.simulate(model, start=part.checkpoint, t_end=24 * 0.012, **options)
        for x, y in zip(on.state, whole.state):
            np.testing.assert_array_equal(x, y)
    print(f"velocity across the path: up to {max(across):.2f} of the largest velocity")
    assert max(across) > 0.5


# ------------------------------------------------------------------------------------------- velocities of the scene
def swinging(*more: object) -> tuple[fb.Scene, fb.Beam]:
    """A rod on a hinge with a body at its end, a ring that slides on it, and a spring that holds it up."""
    rod = straight("rod", (0, 0, 0), (1, 0, 0), elements=2)
    body = fb.RigidBody("body", mass=0.5, inertia=(0.01, 0.01, 0.01), position=(1.1, 0, 0))
    ring = fb.PointMass("ring", mass=0.1)
    return fb.Scene(rod, body, ring, fb.RevoluteJoint(fb.GROUND, rod.start, "root", axis=(0, 1, 0)),
                    fb.RigidConnection(rod.end, body), fb.Slider("slide", ring, rod, at=0.5, rate=0.3),
                    fb.Spring(body, fb.GROUND.point((1.1, 0, 1)), "hanger", stiffness=100.0, length=0.97), *more,
                    gravity=(0, 0, -9.81)), rod


def test_a_start_from_an_equilibrium_says_that_it_is_at_rest_or_takes_velocities_of_the_scene() -> None:
    scene, rod = swinging(fb.RigidMotion(spin=(0, 2.0, 0)))
    model = fb.compile_scene(scene)
    rest = fb.solve_static(model, held=True)
    text, = said(model, "start", start=rest.state)
    assert text.startswith("the start has zero velocities, but the scene gives body 'body' 2.2 m/s. The run begins at rest")
    assert said(fb.compile_scene(swinging()[0]), "start", start=rest.state) == [
        "the start has zero velocities, but the scene gives point mass 'ring' 0.3 m/s. The run begins at rest; take the "
        "velocities of the scene with Start(state, velocities=\"scene\"), or leave them out of the scene"]
    run = fb.simulate(model, start=fb.Start(rest.state, velocities="scene"), t_end=0.01, step=H, every=1,
                      observe=("energy", "velocity"))
    assert not run.events and run.drift("total") < 1e-12
    # a rigid motion about the hinge in the shape of the equilibrium, and the ring along the rod
    q = rest.state.q.reshape(-1, 4, 3)[:, 0]
    np.testing.assert_allclose(run.velocities[0][:rod.n_nodes], np.cross((0, 2.0, 0), q[:rod.n_nodes]), rtol=0, atol=1e-12)
    assert np.linalg.norm(q[:rod.n_nodes] - model.q0.reshape(-1, 4, 3)[:rod.n_nodes, 0], axis=1).max() > 1e-3
    ring = at(model, scene.masses[0])
    nodes, values, slopes = curve_at(model, 0, rest.state.s[0])
    np.testing.assert_allclose(run.velocities[0][ring], np.cross((0, 2.0, 0), q[ring]) + 0.3 * slopes @ q[nodes], atol=1e-12)
    with pytest.raises(fb.SceneError, match="velocities: a checkpoint keeps its own velocities"):
        fb.simulate(model, start=fb.Start(run.checkpoint, velocities="scene"), t_end=0.02, step=H)


def test_an_equilibrium_takes_the_state_of_a_start_and_mends_it_and_refuses_what_it_has_no_use_for() -> None:
    scene = crane()
    model = fb.compile_scene(scene)
    state = model.state()
    state.q.reshape(-1, 4, 3)[at(model, scene.bodies[1]), 0] += (0.0, 0.0, 0.005)
    for analysis in (fb.solve_static, fb.relax):
        with pytest.raises(fb.SceneError, match=r"correct it with start=Start\(state, mend=True\)"):
            analysis(model, start=state)
        for start, says in ((fb.Start(state, time=1.0), "takes no time"), (fb.Start(time=1.0), "takes no time"),
                            (fb.Start(state, velocities="scene"), "no velocities"), (3, "must be a State")):
            with pytest.raises(fb.SceneError, match=f"{analysis.__name__}, start: .*{says}"):
                analysis(model, start=start)
    found = fb.solve_static(model, start=fb.Start(state, mend=True))
    assert "mended" in [event["kind"] for event in found.events]
    np.testing.assert_allclose(*(run.state.q.reshape(-1, 4, 3)[:, 0] for run in (found, fb.solve_static(model))), atol=1e-9)
