"""Derivatives of equilibria of beams whose elements move with contacts (theory.md 13), against equilibria at other values."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

VALUES = {"mass": 20.0, "E": 1.2e9, "length": 10.5, "rho": 7800.0, "strain": 1e-3, "side": 3.0}
SECTIONS = dict(points={"inside": (0.3, 0, 1)}, sliders={"run": 0.7}, contact_forces={"run": (0, 0, 0.01)}, strain_energy=0.1)
OBSERVED = "energy", "section", "reaction"


def scene(planar: bool, mass: float, E: float, length: float, rho: float, strain: float, side: float  # noqa: N803
          ) -> tuple[fb.Scene, dict[str, Any]]:
    """A bead that slides on a wire, drawn to a post by a spring, and a point of the wire between its nodes."""
    section = fb.Section.circle(radius=0.005, E=E, rho=rho)
    wire = fb.Beam.straight("wire", (0, 0, 0), (length, 0, 0), section=section, elements=8, prestrain=-strain)
    bead = fb.PointMass("bead", mass=mass, position=(0.7 * length, 0, 0))
    post = fb.PointMass("post", mass=1.0, position=(5, 0 if planar else 1, -4))
    found = fb.with_moving_meshes(fb.Scene(
        wire, bead, post, fb.Pin(wire.start) if planar else fb.Clamp(wire.start), fb.Pin(wire.end), fb.Pin(post),
        fb.Slider("run", bead, wire, at=0.7 * length), fb.Load("side", bead, force=(side, 0, 0)),
        fb.Spring(bead, post, "spring", stiffness=10.0, length=1.0), gravity=(0, 0, -9.81)))
    return found, {"inside": (found.beams[0], 0.37 * length), "bead": bead}


def row(planar: bool, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    found, points = scene(planar, **values)
    model = fb.compile_scene(found)
    result = fb.solve_static(model, points=points, observe=OBSERVED)
    last = {key: result.series[key][-1] for key in ("points", "s_slide", "contact_force", "strain", "section_force", "reaction")}
    return (np.concatenate([np.ravel(last[key]) for key in ("points", "s_slide", "contact_force", "strain")]
                           + [last["section_force"][0], last["reaction"][0].reshape(-1)[:3]]),
            fb.modes(model, n=3, state=result.state).frequencies)


@pytest.mark.parametrize(("planar", "names"), [(True, ("mass", "rho", "strain", "side")), (False, ("E", "length"))])
def test_against_equilibria_at_other_values(planar: bool, names: tuple[str, ...]) -> None:
    def build(**values: float) -> tuple[fb.Scene, dict[str, Any]]:
        return scene(planar, **VALUES | values)

    found = fb.sensitivity(build, {name: VALUES[name] for name in names}, observe=OBSERVED)
    slopes = found.frequencies(3)
    support = found.model.reaction_names[0]
    for name in names:
        value = VALUES[name]
        step = value / 64.0
        rows = [row(planar, VALUES | {name: value + k * step}) for k in (-2, -1, 1, 2)]
        of_rows, of_modes = (np.array((1, -8, 8, -1)) / 12.0 @ np.array(x) / step for x in zip(*rows))
        own = np.concatenate([found.point("inside")[name], found.point("bead")[name], [found.slider("run")[name]],
                              found.contact_force("run")[name], [found.energy()[name]], found.section("inside")[name][:3],
                              np.ravel(found.reaction(support)[name])[:3]])
        assert found.accuracy[name] < 1e-8
        # of the differences, of order 4
        np.testing.assert_allclose(own, of_rows, rtol=1e-4, atol=1e-5 * np.max(np.abs(of_rows)))
        live = np.isfinite(slopes.by[name])
        assert live.any()
        np.testing.assert_allclose(slopes.by[name][live], of_modes[live], rtol=1e-3, atol=1e-4 * np.max(np.abs(of_modes)))


@pytest.mark.parametrize("planar", [True, False])
def test_gradients_by_everything(planar: bool) -> None:
    def build(**values: float) -> tuple[fb.Scene, dict[str, Any]]:
        return scene(planar, **values)

    found = fb.sensitivity(build, VALUES)
    gradient = found.gradient(**SECTIONS)  # type: ignore[arg-type]
    for name in VALUES:
        by = (np.dot((0.3, 0, 1), found.point("inside")[name]) + 0.7 * found.slider("run")[name]
              + 0.01 * found.contact_force("run")[name][2] + 0.1 * found.energy()[name])
        assert gradient.by[name] == pytest.approx(by, rel=1e-8, abs=1e-12)
    # parameters of the section by the gradients of the section
    wire = found.model.names["beams"][0]["name"]
    of, section = gradient.sections[wire], scene(planar, **VALUES)[0].beams[0].section
    assert of.by((section.C / VALUES["E"], 0.0))[0] == pytest.approx(gradient.by["E"], rel=1e-8)
    assert of.by((0.0 * section.C, section.rhoA / VALUES["rho"]))[0] == pytest.approx(gradient.by["rho"], rel=1e-8)
    assert -of.prestrain[0, 0] == pytest.approx(gradient.by["strain"], rel=1e-8)
    # a dead force on the bead
    bead = next(x["node"] for x in found.model.names["masses"] if x["name"] == "bead")
    assert gradient.forces[bead, 0] == pytest.approx(gradient.by["side"], rel=1e-8)


def column(stiffness: float = 50.0, length: float = 1.0) -> fb.Scene:
    """A column in a sleeve of no length inside an element, pushed at its free end."""
    section = fb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=stiffness, EI2=stiffness, EI3=stiffness, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, length), section=section, elements=8)
    holder = fb.RigidBody("holder", position=(0, 0, 0.55 * length), mass=1.0, inertia=np.eye(3))
    return fb.with_moving_meshes(fb.Scene(
        beam, holder, fb.Clamp(beam.start), fb.Clamp(holder.center), fb.Load("push", beam.end, force=(0, 0, -100.0)),
        fb.Sleeve("sleeve", holder, beam, at=0.55 * length, length=0.0, keyed=False)))


def test_a_buckling_load() -> None:
    def limit(**values: float) -> fb.Result:
        return fb.solve_path(fb.compile_scene(column(**values), planar=True), to=10.0, step=0.5, stop_at="bifurcation")

    path, values = limit(), {"stiffness": 50.0, "length": 1.0}
    load = float(path.series["load_factor"][-1])
    # free end behind an eye that holds place and direction
    assert 100.0 * load == pytest.approx(np.pi**2 / 4.0 * 50.0 / 0.45**2, rel=1e-2)
    found = fb.critical_sensitivity(column, values, state=path.state, load_factor=load)
    for name, power in (("stiffness", 1.0), ("length", -2.0)):
        size = 0.004 * values[name]
        loads = [limit(**{name: values[name] + k * size}).series["load_factor"][-1] for k in (-1, 1)]
        assert found.by[name] == pytest.approx((loads[1] - loads[0]) / (2.0 * size), rel=1e-4)
        assert found.by[name] == pytest.approx(power * load / values[name], rel=2e-2)
