"""Sensitivities as users ask for them: what is refused and why, what is handed out."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import SECTION, cantilever, straight  # noqa: E402


def tip(F: float = 20.0, L: float = 3.0, **more: Any) -> Any:  # noqa: N803
    beam = straight("beam", (0, 0, 0), (L, 0, 0), **more)
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, F)), name="cantilever"), {"tip": beam.end}


def no_wind(t, position, directors, velocity, spin, parameters, force, moment) -> None:  # noqa: ANN001
    force[0] = parameters[0]


def bead(friction: Any = None, **forces: Any) -> fb.Scene:
    beam, mass = straight("rail", (0, 0, 0), (3, 0, 0)), fb.PointMass("bead", mass=0.5)
    return fb.Scene(beam, mass, fb.Clamp(beam.start), fb.Clamp(beam.end),
                    fb.Slider("run", mass, beam, at=1.0, friction=friction, **forces), gravity=(0, 0, -1), name="bead")


@pytest.mark.parametrize(("arguments", "message"), [
    (dict(build=3, values={}), "build: must be a function that takes the parameters"),
    (dict(build=lambda: 3, values={}), "build: must return a Scene, or a Scene and a mapping"),
    (dict(build=cantilever, values={"Q": 1.0}), "build: could not be called with 'Q'"),
    (dict(build=tip, values={"F": "much"}), "values: parameter 'F': must be a finite number"),
    (dict(build=tip, values={"F": 0.0}), "parameter 'F' is 0, so the size of a small change of it is unknown; give scale="),
    (dict(build=tip, values={"F": 1.0}, scale={"L": 1.0}), "scale: there is no parameter 'L'; values has 'F'"),
    (dict(build=tip, values={"F": 1.0}, backend="mumps"), "backend 'mumps' does not exist"),
    (dict(build=tip, values={"F": 1.0}, observe=("momentum",)), "observe"),
    (dict(build=tip, values={"F": 1.0}, load_factor=0.5), "load_factor needs the state that belongs to it"),
    (dict(build=tip, values={"F": 1.0}, held="ring"), "has no slider 'ring'"),
    (dict(build=lambda: bead(fb.Friction(0.3)), values={}), "slider 'run' has Coulomb friction"),
    (dict(build=lambda n: tip(elements=round(n)), values={"n": 100.0}), "parameter 'n' changes the parts, nodes, supports, "
                                                                        "joints or points of the scene"),
    (dict(build=lambda L: tip(L=round(L, 2)), values={"L": 3.0}), "does not depend smoothly on parameter 'L'")])
def test_what_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.sensitivity(**arguments)


def test_user_forces_and_states_that_are_none() -> None:
    def pushed() -> fb.Scene:
        beam = straight("beam", (0, 0, 0), (3, 0, 0))
        law = fb.UserForce("wind", beam.end, law=no_wind, parameters=(0.0,))
        return fb.Scene(beam, fb.Clamp(beam.start), law)

    with pytest.raises(fb.SceneError, match="user force 'wind'"):
        fb.sensitivity(pushed, {})
    scene, _ = tip()
    reference = fb.compile_scene(scene).state()
    with pytest.raises(fb.SceneError, match="the state is not an equilibrium: .* 'beam' .* unbalanced force of 20"):
        fb.sensitivity(tip, {"F": 20.0}, state=reference)


def test_an_equilibrium_at_its_limit_has_no_derivatives() -> None:
    """A point mass on a spring that pushes up has equilibria; at its limit point the tangent is singular."""
    def truss(F: float) -> Any:  # noqa: N803
        mass = fb.PointMass("top", mass=1.0, position=(0, 0, 0.0))
        # flat: the stiffness across vanishes
        return fb.Scene(mass, *(fb.Spring(mass, fb.GROUND.point(x), stiffness=10.0, length=1.0)
                                for x in ((1, 0, 0), (-1, 0, 0))), fb.Load("push", mass, force=(F, 0, 0)))

    model = fb.compile_scene(truss(0.1))
    with pytest.raises((fb.ConvergenceError, fb.SceneError)):
        fb.sensitivity(truss, {"F": 0.1}, state=model.state())


def test_what_is_handed_out_and_asked_for_wrongly() -> None:
    found = fb.sensitivity(tip, {"F": 20.0, "L": 3.0})
    assert set(found.point("tip")) == {"F", "L"} and found.point("tip")["F"].shape == (3,)
    assert "F = 20" in str(found) and max(found.accuracy.values()) < 1e-8
    # the equilibrium has the points that build names
    assert found.result.point("tip").shape[1] == 3 and np.isin(found.result.point("tip")[-1], found.result.state.q).all()
    with pytest.raises(fb.SceneError, match="there is no point 'top'; there are 'tip'"):
        found.point("top")
    with pytest.raises(fb.SceneError, match="there is no slider 'ring'"):
        found.slider("ring")
    with pytest.raises(fb.SceneError, match="was not observed"):
        found.reaction(found.model.reaction_names[0])
    with pytest.raises(fb.SceneError, match="needs weights of the quantity to differentiate"):
        found.gradient()
    with pytest.raises(fb.SceneError, match=r"gradient, point 'tip': needs weights \(3,\)"):
        found.gradient(points={"tip": 1.0})
    with pytest.raises(fb.SceneError, match="gradient: there is no slider 'ring'"):
        found.gradient(sliders={"ring": 1.0})
    again = fb.sensitivity(tip, {"F": 20.0}, state=found.state)
    assert again.result is None
    np.testing.assert_allclose(again.point("tip")["F"], found.point("tip")["F"], rtol=1e-9)
    gradient = found.gradient(points={"tip": (0, 0, 1.0)}).sections["beam"]
    assert gradient.EI2.shape == gradient.rhoA.shape == (1,) and gradient.stiffness.shape == (1, 6, 6)
    assert gradient.by((np.diag([0, 0, 0, 0, 1.0, 0]), 0.0))[0] == gradient.EI2[0]


def test_a_parameter_that_leads_out_of_the_plane() -> None:
    """The scene lies in a plane at the value, not around it."""
    def build(side: float) -> Any:
        beam = straight("beam", (0, 0, 0), (3, 0, 0))
        return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, side, 20.0))), {"tip": beam.end}

    found = fb.sensitivity(build, {"side": 0.0}, scale={"side": 1.0})
    assert found.model.plane is not None and found.point("tip")["side"][1] > 0.0
    assert found.point("tip")["side"][1] == pytest.approx(found.gradient(points={"tip": (0, 1, 0)}).by["side"], rel=1e-10)


def test_runs_that_have_no_adjoint_and_weights_that_are_none() -> None:
    for lets_go, what in ((dict(stops=fb.Stops(0.1, 1.0)), "rigid stops .* of slider 'run'"),
                          (dict(release=fb.Release("end")), "releases of slider 'run'")):
        with pytest.raises(fb.SceneError, match=f"adjoint_run: the adjoint does not support {what}; use differences of runs"):
            fb.adjoint_run(fb.compile_scene(bead(None, **lets_go)), t_end=0.1, step=0.01)
    scene, points = tip()
    model = fb.compile_scene(scene)
    with pytest.raises(fb.SceneError, match="must be a whole number of steps"):
        fb.adjoint_run(model, t_end=0.105, step=0.01)
    with pytest.raises(fb.SceneError, match="GB of memory, more than 4; keep the state of every 4000th step only, "
                                            "keep_every=4000"):
        fb.adjoint_run(model, t_end=1e3, step=1e-4)
    run = fb.adjoint_run(model, t_end=0.02, step=0.01, points=points)
    assert run.t.size == 3 and run.point("tip").shape == run.velocity("tip").shape == (3, 3)
    with pytest.raises(fb.SceneError, match="needs weights of the quantity to differentiate"):
        run.gradient()
    with pytest.raises(fb.SceneError, match=r"weights \(3,\) of the last row, or \(3, 3\) of all"):
        run.gradient(points={"tip": np.zeros((4, 3))})
    with pytest.raises(fb.SceneError, match="there is no point 'top'; there are 'tip'"):
        run.gradient(points={"top": (0, 0, 1)})
    with pytest.raises(fb.ConvergenceError):
        fb.adjoint_run(model, t_end=1e3, step=1e3, max_iterations=3)
    # as of a step in which the iterations went from one branch of friction to the other and back
    run._undecided = 1, "run"
    with pytest.raises(fb.SceneError, match="in the step from t = 0.01 s neither slipping nor sticking of slider 'run' solves"):
        run.gradient(points={"tip": (0, 0, 1)})


def test_sections_that_differ_in_every_stiffness() -> None:
    """Gradients by C against parameters, with a section that couples strains."""
    C = SECTION.C  # noqa: N806
    C[1, 3] = C[3, 1] = 200.0

    def build(which: float) -> Any:
        change = np.zeros((6, 6))
        change[1, 3] = change[3, 1] = which
        one = fb.Section.from_matrix(C + change, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
        return tip(section=one)

    found = fb.sensitivity(build, {"which": 0.0}, scale={"which": 50.0})
    by = found.gradient(points={"tip": (0.3, -1, 1)})
    own = by.sections["beam"].stiffness[0]
    assert own[1, 3] == own[3, 1] and 2.0 * own[1, 3] == pytest.approx(by.by["which"], rel=1e-9)
    assert found.point("tip")["which"] @ (0.3, -1, 1) == pytest.approx(by.by["which"], rel=1e-9)
    assert cantilever().name == "cantilever"


def test_supports_that_move_are_refused() -> None:
    def build() -> fb.Scene:
        beam = straight("beam", (0, 0, 0), (3, 0, 0))
        return fb.Scene(beam, fb.PrescribedMotion("shake", beam.start, displacement=lambda t: (0, 0, t)))

    with pytest.raises(fb.SceneError, match="derivatives by places of moving supports are not available"):
        fb.sensitivity(build, {})


def test_joints_that_are_given_are_refused() -> None:
    """Of equilibria and of critical loads."""
    def build(EI: float) -> fb.Scene:  # noqa: N803
        beam = straight("beam", (0, 0, 0), (3, 0, 0))
        body = fb.RigidBody("body", mass=1.0, inertia=(EI, 1, 1), position=(3, 0, 0))
        return fb.Scene(beam, body, fb.Clamp(beam.start), fb.RevoluteJoint(beam.end, body, axis=(0, 1, 0), angle=0.2,
                                                                                 name="turn"))

    state = fb.compile_scene(build(1.0)).state()
    for call in (lambda: fb.sensitivity(build, {"EI": 1.0}),
                 lambda: fb.critical_sensitivity(build, {"EI": 1.0}, state=state, load_factor=1.0)):
        with pytest.raises(fb.SceneError, match="joint 'turn'.* has a prescribed value, which may depend on the parameters"):
            call()


def test_sections_of_beams_with_a_prestress() -> None:
    """Gradients by sections hold the strain that a prestress is: by EA at a constant force P they differ by the change of P/EA.
    Of a prestrain there is nothing to take away."""
    def build(EA: float, P: float = 0.0, e: float = 0.0) -> Any:  # noqa: N803
        one = fb.Section(EA=EA, GA2=4e3, GA3=4e3, GJ=50, EI2=80, EI3=80, rhoA=1, rhoI2=0.1, rhoI3=0.1)
        given = {"prestress": P} if P else {"prestrain": e}
        beam = straight("beam", (0, 0, 0), (3, 0, 0), section=one, **given)
        return fb.Scene(beam, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Load("push", beam.node(4), force=(5, 0, 20))), {
            "middle": beam.node(4)}

    weights = {"middle": (0.5, 0.2, 1.0)}
    taut = fb.sensitivity(build, {"EA": 1e4, "P": 30.0}).gradient(points=weights)
    assert taut.by["EA"] == pytest.approx(taut.sections["beam"].EA[0] - taut.by["P"] * 30.0 / 1e4, rel=1e-8)
    assert taut.by["P"] == pytest.approx(taut.sections["beam"].prestrain[0, 0] / 1e4, rel=1e-8)
    assert abs(taut.by["P"] * 30.0 / 1e4) > 1e-2 * abs(taut.by["EA"])
    short = fb.sensitivity(build, {"EA": 1e4, "e": 3e-3}).gradient(points=weights)
    assert short.by["e"] == pytest.approx(short.sections["beam"].prestrain[0, 0], rel=1e-8)
    stored = fb.sensitivity(build, {"EA": 1e4, "e": 3e-3}).gradient(strain_energy=1.0)
    assert stored.by["e"] == pytest.approx(stored.sections["beam"].prestrain[0, 0], rel=1e-8)
    assert short.by["EA"] == pytest.approx(short.sections["beam"].EA[0], rel=1e-8)
    assert short.sections["beam"].EA[0] == pytest.approx(taut.sections["beam"].EA[0], rel=1e-9)
