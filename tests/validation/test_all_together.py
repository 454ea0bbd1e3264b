"""One scene with everything that takes energy away, puts some in or remembers steps: the books close, rows add up, runs go on."""
from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.reactions import Reactions
from fastbeam.kernels import empty_arrays
from fastbeam.stepping.stepper import Stepper

sys.path.insert(0, str(Path(__file__).parent))
import test_adjoint_sliders  # noqa: E402
import test_filters  # noqa: E402
import test_joint_drives  # noqa: E402
import test_twist_friction  # noqa: E402

ROPE = fb.Section.circle(radius=0.01, E=2e8, rho=1500.0, damping=2e-3)
G = (0.0, 0.0, -9.81)


def push(t, position, directors, velocity, spin, parameters, force, moment):
    for c in range(3):
        force[c] = parameters[0] * np.cos(7.0 * t) * directors[1, c] - parameters[1] * velocity[c]


def scene() -> fb.Scene:
    """A damped beam on a shaken hub, with an arm on a driven hinge at its end, a rubbing ring that is locked for a while, a
    second one on a drive with an elastic stop, air, a load of time and a law of one's own."""
    hub = fb.RigidBody("hub", mass=1.0, inertia=np.eye(3) * 0.01, position=(0, 0, 0))
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=ROPE, elements=5)
    arm = fb.RigidBody("arm", mass=0.4, inertia=(0.001, 0.004, 0.004), position=(1.15, 0, 0))
    ring, cart = fb.PointMass("ring", mass=0.05), fb.PointMass("cart", mass=0.08)
    return fb.Scene(
        hub, beam, arm, ring, cart,
        fb.PrescribedMotion("shaker", hub, displacement=lambda t: (0.0, 0.01 * (1.0 - np.cos(20.0 * t)), 0.0)),
        fb.RigidConnection(hub, beam.start, name="root"),
        fb.RevoluteJoint(beam.end, arm.point((-0.15, 0, 0)), name="hinge", axis=(0, 1, 0), stiffness=0.8, damping=0.01,
                         torque=lambda t: 0.2 * np.sin(11.0 * t)),
        fb.Slider("ring on beam", ring, beam, at=0.3, friction=0.2, lock=fb.Lock(0.05, until=0.1)),
        fb.Slider("cart on beam", cart, beam, at=0.6, rate=0.3, drive=fb.Drive(force=0.5),
                  stops=fb.Stops(start=0.2, end=0.65, stiffness=200.0)),
        fb.Drag("air", beam, normal=0.05, tangential=0.002, air=(3.0, 1.0, 0.0)),
        fb.Load("pull", arm, force=(0, 0.5, 0), time=lambda t: np.sin(5.0 * t)),
        fb.UserForce("law", arm, push, parameters=(0.3, 0.05)), gravity=G)


OBSERVE = ("energy", "momentum", "slider", "joint", "reaction")


def test_the_books_of_everything_close():
    model = fb.compile_scene(scene())
    run = fb.simulate(model, t_end=0.2, step=1e-3, every=1, observe=OBSERVE, progress=False)
    parts = run.balance()
    exchanged = max(np.max(np.abs(x - x[0])) for name, x in parts.items() if name != "sum")
    assert np.max(np.abs(parts["sum"] - parts["sum"][0])) < 1e-12 * exchanged
    assert run.drift("balance") < 1e-12
    text = " ".join(parts)
    for what in ("damping of beam", "friction of slider", "lock of slider", "drive of slider", "damper of joint",
                 "motor of joint", "motion of", "drag", "loads"):
        assert what in text, (what, list(parts))
    assert [event["kind"] for event in run.events if event["kind"] in ("failed", "drift")] == []


def test_a_run_of_everything_goes_on_bit_for_bit():
    model = fb.compile_scene(scene())
    whole = fb.simulate(model, t_end=0.12, step=1e-3, progress=False)
    half = fb.simulate(model, t_end=0.06, step=1e-3, progress=False)
    rest = fb.simulate(model, t_end=0.12, step=1e-3, start=half.checkpoint, progress=False)
    assert all(np.array_equal(x, y) for x, y in zip(rest.state, whole.state))


def test_reactions_of_everything_add_up():
    model = fb.compile_scene(scene())
    run = fb.simulate(model, t_end=0.04, step=1e-3, every=1, observe=OBSERVE, progress=False)
    outside = run.reaction("shaker")["force"] + float(model.gravity_weight.sum()) * np.array(G)
    outside[:, 1] += 0.5 * np.sin(5.0 * run.t)
    rate = np.gradient(run.series["lin_mom"], run.t, axis=0)[2:-2]
    # what is left is the air and the law of one's own, a few newtons
    assert np.max(np.abs(rate - outside[2:-2])) < 3.0
    assert np.isfinite(run.reaction("root")["force"]).all() and np.isfinite(run.reaction("hinge")["force"]).all()


def gradient() -> Any:
    run = test_adjoint_sliders.go(**test_adjoint_sliders.CASES["comes to rest"])
    by = run.gradient(points=test_adjoint_sliders.weights(True))
    return run.point("tip"), *test_adjoint_sliders.usual(run, by).values(), by.sliders["ring"].friction, by.sliders["ring"].forces


def everything(run: fb.Result) -> Any:
    return *run.state, *run.series.values(), run.phi, run.directors


ANALYSES: dict[str, Callable[[], Any]] = {
    "everything": lambda: everything(fb.simulate(fb.compile_scene(scene()), t_end=0.12, step=1e-3, every=1, observe=OBSERVE,
                                                 progress=False)),
    "filters": lambda: everything(fb.simulate(test_filters.flight(), t_end=0.5, step=0.05, method=fb.Method(rho_inf=0.5),
                                              every=1, progress=False)),
    "joints that rub": lambda: everything(test_joint_drives.run(test_joint_drives.arm(friction=2.0), 0.1, 1e-2, every=1,
                                                                observe=("energy", "joint"))),
    "given joints": lambda: everything(test_joint_drives.run(test_joint_drives.arm(angle=lambda t: 3.0 * t * t), 0.1, 1e-2,
                                                             every=1, observe=("energy", "joint"))),
    "twist": lambda: everything(test_twist_friction.go(0.1, 4e-3, 20.0)),
    "gradient": gradient}


@pytest.mark.parametrize("what", ANALYSES)
def test_results_are_the_same_bits_where_arrays_begin_as_nan(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As with FASTBEAM_FILL=nan in the environment: nothing is read that was not written."""
    whole = ANALYSES[what]()
    monkeypatch.setattr(empty_arrays, "FILL", np.nan)
    for k, (x, y) in enumerate(zip(whole, ANALYSES[what](), strict=True)):
        assert np.array_equal(x, y, equal_nan=True), k


def test_what_order_four_cannot_do_is_named():
    with pytest.raises(fb.SceneError, match="order=4"):
        fb.simulate(fb.compile_scene(scene()), t_end=0.01, step=1e-3, order=4)


def test_reactions_are_formed_in_rows_and_blocks_of_their_own():
    """Those of the run, which eliminates inner nodes, lie beyond the blocks without: memory of others was written to."""
    stepper = Stepper(fb.compile_scene(scene()), np.ones(1))
    reactions = Reactions(stepper)
    assert reactions.own is not stepper
    own = {type(x): x for x in reactions.own.terms}
    for term in reactions.terms.terms:
        for name in ("row", "block", "spin_row"):
            if hasattr(term, name) and hasattr(own[type(term)], name):
                size = (reactions.own.work.blocks.size // 48) if name == "block" else (reactions.own.work.r.size // 8)
                assert np.max(getattr(term, name), initial=0) < size, (type(term).__name__, name)
    shared = {type(x): x for x in stepper.terms}
    forces, drag = (next(x for x in reactions.terms.terms if type(x).__name__ == name) for name in ("UserForces", "Drag"))
    assert np.shares_memory(forces.share, shared[type(forces)].share) and np.shares_memory(forces.work, shared[type(forces)].work)
    assert np.shares_memory(drag.air, shared[type(drag)].air)
