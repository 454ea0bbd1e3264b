"""Sections with laws from outside: a linear law is a stiffer section in every analysis; bending and vibration against closed
forms; conservation with kinks; misuse is told."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.extend import SectionLaw, kernel, section_energy, section_modulus, section_stress

BAR = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
STIFFNESS = ("EA", "GA2", "GA3", "GJ", "EI2", "EI3")
FULL = np.array([getattr(BAR, name) for name in STIFFNESS])


class Powers(NamedTuple):
    """W = p0 e^2/2 + p1 e^4/4 + p2 max(e, 0)^2/2."""


@section_energy.register(Powers)
@kernel
def energy(law, e, p):
    pull = max(e, 0.0)
    return e * e * (0.5 * p[0] + 0.25 * p[1] * e * e) + 0.5 * p[2] * pull * pull


@section_stress.register(Powers)
@kernel
def stress(law, e, p):
    return e * (p[0] + p[1] * e * e) + p[2] * max(e, 0.0)


@section_modulus.register(Powers)
@kernel
def modulus(law, e, p):
    return p[0] + 3.0 * p[1] * e * e + (p[2] if e > 0.0 else 0.0)


@dataclass(frozen=True, eq=False)
class Law(SectionLaw):
    kind: ClassVar[str] = "law"
    term: ClassVar[Any] = Powers()

    _: KW_ONLY
    linear: Any = 0.0
    cubic: Any = 0.0
    pull: Any = 0.0

    @property
    def parameters(self) -> np.ndarray:
        out = np.zeros((6, 4))
        out[:, 0], out[:, 1], out[:, 2] = self.linear, self.cubic, self.pull
        return out


def softer(share: float, **more: Any) -> fb.Section:
    return replace(BAR, **dict(zip(STIFFNESS, share * FULL)), **more)


def cantilever(section: fb.Section, **more: Any) -> tuple[fb.Beam, fb.Model]:
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=section, elements=5, **more)
    return beam, fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("f", beam.end, force=(0.02, 0.1, 0.3)),
                                           gravity=(0, 0, -9.81)))


def answers(section: fb.Section, **more: Any) -> dict[str, Any]:
    beam, model = cantilever(section, **more)
    rest = fb.solve_static(model)
    run = fb.simulate(model, t_end=0.1, step=0.005, progress=False, observe=("energy", "momentum", "section"))
    forces = fb.section_forces(model, rest.state, beam, [0.0, 0.3])
    return {"rest": rest.state.q, "run": run.state.q, "energies": [run.series[name] for name in ("kinetic", "strain", "total")],
            "path": fb.solve_path(model).state.q, "modes": fb.modes(model, n=4, state=rest.state).frequencies,
            "response": np.abs(fb.frequency_response(model, [3.0, 9.0], loads="f", state=rest.state,
                                                     points={"end": beam.end}).point("end")),
            "forces": [forces.N, forces.M2, forces.M3]}


@pytest.mark.parametrize("more", [{}, pytest.param({"strain": "green_lagrange"}, marks=pytest.mark.slow),
                                  pytest.param({"interpolation": "bspline"}, marks=pytest.mark.slow)])
def test_linear_law_is_a_stiffer_section(more: dict[str, Any]) -> None:
    whole = answers(BAR, **more)
    for name, found in answers(softer(0.5).with_law(Law(linear=0.5 * FULL)), **more).items():
        # the residual of an equilibrium divided by its stiffness
        np.testing.assert_allclose(found, whole[name], rtol=1e-9, atol=1e-9 * np.max(np.abs(whole[name])), err_msg=name)


@pytest.mark.slow
def test_linear_law_beside_damping_and_in_a_condensed_net() -> None:
    D = replace(BAR, damping=0.002).D
    sections = replace(BAR, damping=D), replace(softer(0.5).with_law(Law(linear=0.5 * FULL)), damping=D)
    runs = [fb.simulate(cantilever(x)[1], t_end=0.1, step=0.005, progress=False, order=2) for x in sections]
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, atol=1e-12)
    np.testing.assert_allclose(runs[1].series["balance"], runs[0].series["balance"], atol=1e-12)
    nodes = [(0.5 * i, 0.5 * j, 0.0) for i in range(3) for j in range(3)]
    edges = [(3 * i + j, 3 * i + j + 1) for i in range(3) for j in range(2)] + [(i, i + 3) for i in range(6)]
    shapes = []
    for section in (BAR, softer(0.5).with_law(Law(linear=0.5 * FULL))):
        net = fb.Net("net", nodes, edges, section=section, elements=3)
        model = fb.compile_scene(fb.Scene(net, fb.Clamp(net.node(0)), fb.Clamp(net.node(8)), gravity=(0, 0, -9.81)))
        shapes.append(fb.simulate(model, t_end=0.05, step=0.005, progress=False).state.q)
    np.testing.assert_allclose(shapes[1], shapes[0], atol=1e-12)


def test_bending_moment_of_a_cubic_law() -> None:
    cubic = np.array([0, 0, 0, 0, 0.5, 0.5])
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=BAR.with_law(Law(cubic=cubic)), elements=12, degree=3)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("end", beam.end, moment=(0, 0, 3.0))))
    found = fb.solve_static(model)
    K = max(np.roots([0.5, 0.0, BAR.EI3, -3.0]).real)
    # a circle of curvature K
    end = found.state.q.reshape(-1, 4, 3)[-1, 0]
    np.testing.assert_allclose(end, (np.sin(K) / K, (1.0 - np.cos(K)) / K, 0.0), atol=1e-6)
    forces = fb.section_forces(model, found.state, beam)
    np.testing.assert_allclose(np.abs(forces.M3), 3.0, rtol=1e-6)


def test_frequency_along_a_bar_takes_the_modulus_of_its_strain() -> None:
    e, cubic = 0.05, np.array([40.0 * BAR.EA, 0, 0, 0, 0, 0])

    def along(section: fb.Section, prestrain: float) -> float:
        beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=section, elements=6, prestrain=prestrain)
        model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Clamp(beam.end)))
        found = fb.modes(model, n=30)
        shapes = [found.shape(k)[0] for k in range(30)]
        return float(next(f for f, x in zip(found.frequencies, shapes) if np.max(np.abs(x[:, 0])) > 0.9 * np.max(np.abs(x))))

    ratio = along(BAR.with_law(Law(cubic=cubic)), e) / along(BAR, 0.0)
    assert ratio == pytest.approx(np.sqrt(1.0 + 3.0 * 40.0 * e**2), rel=1e-9)


@pytest.mark.parametrize("law", [Law(cubic=[0, 0, 0, 0.5, 2.0, 5.0]), Law(pull=[0.5 * BAR.EA, 0, 0, 0, BAR.EI2, 0])])
def test_flight_keeps_energy_and_momenta(law: Law) -> None:
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=softer(0.5).with_law(law), elements=6)
    rates = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0.3 * np.sin(7.0 * s), 4.0 * (s - 0.5)**2,
                                                                  3.0 * s * np.cos(5.0 * s)), axis=-1))
    run = fb.simulate(fb.compile_scene(fb.Scene(beam, rates)), t_end=0.6, step=0.003, progress=False)
    # the strain energy comes and goes
    assert np.ptp(run.series["strain"]) > 0.1 * np.max(run.series["total"])
    assert run.drift("total") < 1e-12
    assert run.drift("lin_mom") < 1e-12 and run.drift("ang_mom") < 1e-12


def test_sensitivity_of_a_nonlinear_section() -> None:
    def build(force: float) -> fb.Scene:
        beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), elements=4,
                                section=BAR.with_law(Law(cubic=[0, 0, 0, 0.2, 0.5, 0.5])))
        return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("f", beam.end, force=(0.0, 0.1, force)))

    slopes = fb.sensitivity(lambda force: build(force), {"force": 0.4})
    ends = [fb.solve_static(fb.compile_scene(build(0.4 + x))).series["strain"][-1] for x in (-1e-4, 1e-4)]
    assert slopes.energy("strain")["force"] == pytest.approx((ends[1] - ends[0]) / 2e-4, rel=1e-6)


# ---------------------------------------------------------------------------------------------------------------- misuse
def test_what_takes_the_matrix_alone_is_refused() -> None:
    _, model = cantilever(BAR.with_law(Law(linear=FULL)))
    for run, text in ((lambda: fb.simulate(model, t_end=0.1, step=0.01, method="midpoint"), "'midpoint' does not support"),
                      (lambda: fb.simulate(model, t_end=0.1, step=0.01, method=fb.Method(rho_inf=0.8)), "are not filtered"),
                      (lambda: fb.critical_loads(model), "follow the equilibria with solve_path"),
                      (lambda: fb.frequency_response(model, [1.0], loads="f", loss_factor=0.1), "use damping= of sections")):
        with pytest.raises(fb.SceneError, match=text):
            run()
    with pytest.raises(fb.SceneError, match="prestress= takes the stiffness matrix"):
        cantilever(BAR.with_law(Law(linear=FULL)), prestress=1.0)
    assert model.plane is None


class Wrong(NamedTuple):
    """Law whose stress has another factor than its energy."""


section_energy.register(Wrong)(energy)
section_modulus.register(Wrong)(modulus)


@section_stress.register(Wrong)
@kernel
def wrong_stress(law, e, p):
    return 2.0 * e * p[0]


class Lacking(NamedTuple):
    """Law without kernels."""


def test_laws_that_are_none_are_refused() -> None:
    def law(**attributes: Any) -> Any:
        return type("Law", (SectionLaw,), {"kind": "law", "term": Powers(), "parameters": np.ones((6, 4)), **attributes})()

    for section, text in ((BAR.with_law(law(term=Wrong())), "the energy of Gamma1 changes by .* must be its derivative"),
                          (BAR.with_law(law(term=Lacking())), "there is no @section_energy.register.Lacking."),
                          (BAR.with_law(law(term=3)), "term must be an instance of a named tuple of your own, got 3"),
                          (BAR.with_law(law(parameters=np.ones(6))), r"parameters must be finite numbers \(6, 4\)")):
        with pytest.raises(fb.SceneError, match=text):
            cantilever(section)
    with pytest.raises(fb.SceneError, match="law must be an object of a class derived from fastbeam.extend.SectionLaw, got 3"):
        BAR.with_law(3)  # type: ignore[arg-type]
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=BAR.with_law(Law(linear=FULL)), elements=1)
    other = BAR.with_law(law(term=Wrong(), parameters=np.zeros((6, 4))))
    b = fb.Beam.straight("b", (0, 1, 0), (1, 1, 0), section=other, elements=1)
    with pytest.raises(fb.SceneError, match="take laws of one kind"):
        fb.compile_scene(fb.Scene(a, b))
