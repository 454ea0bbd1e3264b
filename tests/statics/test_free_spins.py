"""Beams that may spin about their own axes: statics holds the spins, counts them by one product, and stops at what resists."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.linalg import inertia
from fastbeam.linalg.mkl import load_mkl
from fastbeam.statics.free_motions import FreeMotions

ROUND = fb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1e-2, EI2=1e-2, EI3=1e-2, rhoA=1e-2, rhoI2=1e-6, rhoI3=1e-6)
WIRE = fb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=50.0, EI2=50.0, EI3=50.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
# of the tendon: where it ends, and the direction in which it runs away from there
END, AWAY = np.array([1.0, 0.2, 0.1]), np.array([-0.96, 0.16, -0.23])


def pulled(*springs: float, moment: float = 0.0, ball: bool = True) -> fb.Scene:
    """A plate on a clamped bar, pulled aside by a tendon that ends on a ball joint and runs through an eye; springs, N m, resist
    its twist, which a moment turns."""
    along = AWAY / np.linalg.norm(AWAY)
    eye_at, start = END + along, END + 1.2 * along
    bar = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=WIRE, elements=2)
    tendon = fb.Beam.straight("tendon", start, END, section=ROUND, elements=[0, 0.1, 0.2, 0.5, 0.8, 1.2])
    plate = fb.RigidBody("plate", mass=1e-3, inertia=(1e-5, 1e-5, 1e-5), position=(1, 0, 0))
    eye = fb.PointMass("eye", mass=1.0, position=eye_at)
    joint = fb.BallJoint if ball else fb.RigidConnection
    about = np.outer(along, along)
    return fb.Scene(bar, tendon, plate, eye, fb.Load("pull", tendon.start, force=5 * along, moment=-moment * along), fb.Pin(eye),
                    fb.Clamp(bar.start), fb.RigidConnection(bar.end, plate), fb.Slider("through", eye, tendon, at=0.2),
                    joint(plate.point(END - (1, 0, 0)), tendon.end),
                    *(fb.Bushing(fb.GROUND.point(start), tendon.start, stiffness=np.block(
                        [[np.zeros((3, 6))], [np.zeros((3, 3)), k * about]]), directors=np.eye(3)) for k in springs))


def left_to_superlu(found: fb.Result) -> int:
    """How many equations PARDISO did not solve."""
    return int(str(found.info["solver"]).split(", ")[-1].split()[0])


def test_a_tendon_on_a_ball_joint_takes_as_many_iterations_as_a_welded_one(monkeypatch: pytest.MonkeyPatch) -> None:
    if load_mkl() is None:
        pytest.skip("counts what PARDISO solves")
    model = fb.compile_scene(pulled())
    found, welded = fb.solve_static(model), fb.solve_static(fb.compile_scene(pulled(ball=False)))
    assert found.info["iterations"] <= 1.5 * welded.info["iterations"]
    assert left_to_superlu(found) == left_to_superlu(welded) == 0
    assert found.info["free_motions"] == ["beam 'tendon' about its axis"]
    assert (found.info["unstable_directions"], found.info["free_directions"]) == (0, 1)
    # not held, the spin makes the matrix singular, and the equilibrium is the same
    monkeypatch.setattr(FreeMotions, "spins", lambda *_: np.zeros(0, np.int64))
    other = fb.solve_static(model)
    assert left_to_superlu(other) > 0
    x, y = (one.state.q.reshape(-1, 4, 3)[:, :2] for one in (found, other))
    np.testing.assert_allclose(x, y, atol=1e-12)
    np.testing.assert_allclose(found.state.s, other.state.s, atol=1e-12)


@pytest.mark.parametrize("stiffness", [1e-3, 1e-6])
def test_a_soft_spring_about_the_axis_is_felt(stiffness: float) -> None:
    model = fb.compile_scene(pulled(stiffness, moment=0.1 * stiffness))
    found = fb.solve_static(model)
    assert found.info["free_directions"] == 0
    node = next(k for k, label in enumerate(model.labels) if "tendon" in label)
    before, after = (q.reshape(-1, 4, 3)[node] for q in (model.q0, found.state.q))
    # the axis does not turn, and stiffness times the sine is the moment of a bushing
    assert abs(after[2] @ before[3]) == pytest.approx(0.1, rel=1e-5)


def test_a_moment_that_nothing_resists_has_no_equilibrium() -> None:
    with pytest.raises(fb.ConvergenceError):
        fb.solve_static(fb.compile_scene(pulled(moment=1e-4)), smallest_step=0.05)


def test_spins_of_droppers_are_counted_without_eigenvectors(monkeypatch: pytest.MonkeyPatch) -> None:
    count = 12
    top, low = (fb.Beam.straight(name, (1000, 0, z), (1006 + 6 * count, 0, z), section=WIRE, elements=count + 1, prestress=pull)
                for name, z, pull in (("top", 1, 2e4), ("low", 0, 1e4)))
    scene = fb.Scene(top, low, *[fb.Pin(x) for x in (top.start, top.end, low.start, low.end)], gravity=(0, 0, -9.81))
    for k in range(1, count + 1):
        x = 1000 + 6.0 * k
        dropper = fb.Beam.straight(f"dropper {k}", (x, 0, 1), (x, 0, 0), section=ROUND, elements=1)
        scene.add(dropper, fb.BallJoint(top.at(6.0 * k), dropper.start), fb.BallJoint(low.at(6.0 * k), dropper.end))

    def computed(*_: object) -> None:
        raise AssertionError("eigenvectors were computed")

    monkeypatch.setattr(inertia, "_nearest_to_zero", computed)
    info = fb.solve_static(fb.compile_scene(scene)).info
    assert set(info["free_motions"]) == {f"beam {name!r} about its axis" for name in
                                         ("top", "low", *(f"dropper {k}" for k in range(1, count + 1)))}
    assert (info["unstable_directions"], info["free_directions"]) == (0, count + 2)
