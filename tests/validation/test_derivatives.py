"""Derivatives by parameters against closed forms, exact equations of other kinds, and differences of whole solutions."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb
from fastbeam.statics.linear_response import at_shape

Array = np.ndarray
# central differences of order 8
EIGHTH = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
AWAY = (-4, -3, -2, -1, 1, 2, 3, 4)


def section(EA: float = 1e4, EI: float = 0.5, GA: float = 1e4, rhoA: float = 0.3, **more: float) -> fb.Section:  # noqa: N803
    given = dict(GA2=GA, GA3=GA, GJ=EI, EI2=EI, EI3=EI, rhoI2=1e-4, rhoI3=1e-4) | more
    return fb.Section(EA=EA, rhoA=rhoA, **given)


def differences(build: Callable[..., Any], values: dict[str, float], name: str, read: Callable[[Any], Any],
                share: float = 2e-3) -> Array:
    """Of whole solutions around, each brought to round-off by itself."""
    step = share * abs(values[name])
    found = []
    for k in AWAY:
        own = {**values, name: values[name] + k * step}
        found.append(read(fb.sensitivity(lambda own=own: build(**own), {})))
    return np.tensordot(EIGHTH, np.array(found), 1) / step


def close(a: Any, b: Any, to: float) -> None:
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    assert np.linalg.norm(a - b) <= to * np.linalg.norm(b), (a, b)


# --- equilibria ------------------------------------------------------------------------------------------------------------
def test_tip_of_a_stretched_and_twisted_bar() -> None:
    """Exact in one element: extension F L/EA, twist T L/GJ."""
    def build(EA: float, GJ: float, L: float, F: float, T: float) -> Any:  # noqa: N803
        beam = fb.Beam.straight("bar", (0, 0, 0), (L, 0, 0), section=section(EA, GJ=GJ), elements=1, degree=1)
        arm = fb.RigidBody("arm", mass=1.0, inertia=(1, 1, 1), position=(L, 1, 0))
        return (fb.Scene(beam, arm, fb.Clamp(beam.start), fb.RigidConnection(beam.end, arm),
                         fb.Load("pull", beam.end, force=(F, 0, 0)), fb.Load("turn", beam.end, moment=(T, 0, 0))),
                {"tip": beam.end, "arm": arm})

    v = dict(EA=1e4, GJ=2.0, L=3.0, F=50.0, T=1e-4)
    found = fb.sensitivity(build, v, observe=("section",))
    tip, arm, inside = found.point("tip"), found.point("arm"), found.section("tip")
    x = v["F"] * v["L"] / v["EA"]
    for name, exact in (("EA", -x / v["EA"]), ("L", 1.0 + x / v["L"]), ("F", v["L"] / v["EA"])):
        assert tip[name][0] == pytest.approx(exact, rel=1e-11), name
        assert inside[name][0] == pytest.approx(float(name == "F"), abs=1e-8), name
    turn = v["T"] * v["L"] / v["GJ"]
    # the directors of one linear element are short by the turn's square: the exact answer is that of small turns
    close([arm[k][2] for k in ("GJ", "L", "T")], [-turn / v["GJ"], turn / v["L"], v["L"] / v["GJ"]], 1e-7)


def test_cantilever_beyond_small_deflections() -> None:
    """Pure bending by a moment about a fixed axis rolls a beam up: x = R sin(L/R), y = R (1 - cos(L/R)), R = EI/M. Four elements
    of degree 6 have it to 1e-12."""
    def build(EI: float, L: float, M: float) -> Any:  # noqa: N803
        beam = fb.Beam.straight("strip", (0, 0, 0), (L, 0, 0), section=section(1e3, EI, 1e3), elements=4, degree=6)
        return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("turn", beam.end, moment=(0, 0, M))), {"tip": beam.end}

    v = dict(EI=2.0, L=1.5, M=1.7)
    k = v["M"] / v["EI"]
    by_k = np.array([v["L"] * np.cos(k * v["L"]) / k - np.sin(k * v["L"]) / k**2,
                     v["L"] * np.sin(k * v["L"]) / k - (1 - np.cos(k * v["L"])) / k**2])
    exact = {"EI": -by_k * k / v["EI"], "M": by_k / v["EI"], "L": np.array([np.cos(k * v["L"]), np.sin(k * v["L"])])}
    found = fb.sensitivity(build, v)
    assert found.model.plane is not None
    for name, slope in exact.items():
        close(found.point("tip")[name][:2], slope, 1e-10)
    # the tangent is not symmetric in space, nor where a moment acts on a scene that is not planar
    for w in ((1, 0, 0), (0, 1, 0), (0.3, -2, 5)):
        close([found.gradient(points={"tip": w}).by[name] for name in v], [found.point("tip")[name] @ w for name in v], 1e-10)


def catenary(EA: float, w: float, L: float, span: float) -> float:  # noqa: N803
    """Sag of an elastic catenary between two points of a height, by Irvine's equations."""
    def across(tension: float) -> float:
        return tension * L / EA + 2 * tension / w * np.arcsinh(w * L / (2 * tension)) - span

    h = brentq(across, 1e-6 * w * L, 1e3 * w * L, xtol=1e-300, rtol=8.9e-16)
    v = 0.5 * w * L
    return float(v * L / (4 * EA) + h / w * (np.sqrt(1 + (v / h)**2) - 1))


def test_sag_of_a_rope_between_two_pins() -> None:
    """The derivatives of an elastic catenary, in the limit of no bending stiffness, of which pins feel the root."""
    def build(EA: float, rhoA: float, L: float, span: float) -> Any:  # noqa: N803
        rope = fb.Section(EA=EA, GA2=EA, GA3=EA, GJ=1e-5, EI2=1e-5, EI3=1e-5, rhoA=rhoA, rhoI2=1e-9, rhoI3=1e-9)
        half = 0.5 * span
        depth = np.sqrt((0.5 * L)**2 - half**2)
        left = fb.Beam.straight("left", (-half, 0, 0), (0, 0, -depth), section=rope, elements=12, degree=4)
        right = fb.Beam.straight("right", (0, 0, -depth), (half, 0, 0), section=rope, elements=12, degree=4)
        return fb.Scene(left, right, fb.Pin(left.start), fb.Pin(right.end), fb.BallJoint(left.end, right.start),
                        gravity=(0, 0, -10.0)), {"low": left.end}

    v = dict(EA=500.0, rhoA=0.4, L=2.2, span=2.0)
    found = fb.sensitivity(build, v, observe=("energy",))
    low = {name: -x[2] for name, x in found.point("low").items()}
    exact = {}
    for name in v:
        e = 1e-3 * v[name]
        others = [{**v, name: v[name] + k * e} for k in AWAY]
        at = [catenary(x["EA"], 10.0 * x["rhoA"], x["L"], x["span"]) for x in others]
        exact[name] = float(EIGHTH @ np.array(at)) / e
    for name in v:
        assert low[name] == pytest.approx(exact[name], rel=3e-3), name


def ring(EA: float, L: float, m: float, x: float, g: float) -> Any:  # noqa: N803
    """A ring on a cable, pulled aside by a spring."""
    cable = fb.Beam.straight("cable", (0, 0, 0), (L, 0, 0), section=section(EA), elements=6, degree=3)
    bead = fb.PointMass("bead", mass=m)
    return (fb.Scene(cable, fb.Clamp(cable.start), fb.Clamp(cable.end), bead, fb.Slider("ring", bead, cable, at=0.4 * L),
                     fb.Spring(bead, fb.GROUND.point((x, 0.0, -2.0)), stiffness=20.0, length=0.5), gravity=(0, 0.3, -g)),
            {"bead": bead, "middle": (cable, 0.5 * L)})


RING = dict(EA=1e4, L=2.0, m=2.0, x=0.7, g=9.81)


def test_ring_on_a_cable_against_differences_and_its_adjoint() -> None:
    found = fb.sensitivity(ring, RING, observe=("energy", "reaction"))
    s, force, bead, middle = found.slider("ring"), found.contact_force("ring"), found.point("bead"), found.point("middle")
    dim = found.model.dim
    assert dim == 3 and found.model.plane is None
    assert max(found.accuracy.values()) < 1e-9
    for name in ("L", "x"):
        exact = differences(ring, RING, name, lambda x: np.concatenate(
            (x.state.s, x.state.force, [x.result.series["strain"][-1]])))
        close(s[name], exact[0], 1e-8)
        close(force[name], exact[1:4], 1e-8)
        close(found.energy("strain")[name], exact[4], 1e-7)
    one = found.gradient(sliders={"ring": 1.0}).by
    sum_of_all = found.gradient(sliders={"ring": 2.0}, contact_forces={"ring": (1, 2, 3)}, strain_energy=0.3,
                                points={"middle": (1, 2, -1), "bead": (0.5, 0, 0)}).by
    for name in RING:
        assert one[name] == pytest.approx(s[name], rel=1e-11)
        together = (2 * s[name] + force[name] @ (1, 2, 3) + 0.3 * found.energy()[name] + middle[name] @ (1, 2, -1)
                    + 0.5 * bead[name][0])
        assert sum_of_all[name] == pytest.approx(together, rel=1e-9)
    # the spring at rest takes what supports do not: all of gravity's change but for its own
    ends = [found.reaction(name) for name in found.model.reaction_names]
    way = found.point("bead")
    r = found.state.q.reshape(-1, 4, 3)[found.model.names["masses"][0]["node"], 0] - (RING["x"], 0.0, -2.0)
    size = np.linalg.norm(r)
    stiff = 20.0 * (1 - 0.5 / size) * np.eye(3) + 20.0 * 0.5 / size**3 * np.outer(r, r)
    weight = (RING["m"] + 0.3 * RING["L"]) * np.array([0, 0, 1.0])
    close(ends[0]["g"][0] + ends[1]["g"][0], weight + stiff @ way["g"], 1e-7)


def test_a_slider_that_is_held_stays_at_its_place_on_the_beam() -> None:
    found = fb.sensitivity(ring, RING, held="ring")
    assert found.slider("ring")["L"] == pytest.approx(0.4, rel=1e-12) and abs(found.slider("ring")["m"]) < 1e-12
    by = found.gradient(points={"bead": (0, 0, 1)}).by
    for name in RING:
        assert by[name] == pytest.approx(found.point("bead")[name][2], rel=1e-10), name


def frame(h: float, offset: float, EI: float, F: float) -> Any:  # noqa: N803
    """Two columns and a body on ball and rigid joints, a closed loop with a distance joint, in space."""
    one = section(2e3, EI, 1e3)
    a = fb.Beam.straight("a", (0, 0, 0), (0, 0.1, h), section=one, elements=2, degree=3)
    b = fb.Beam.straight("b", (1, 0, 0), (1, 0, 1.2 * h), section=one, elements=2, degree=3)
    body = fb.RigidBody("top", mass=2.0, inertia=(1, 1, 1), position=(offset, 0.1, h + 0.2))
    return (fb.Scene(a, b, body, fb.Clamp(a.start), fb.Clamp(b.start), fb.RigidConnection(a.end, body),
                     fb.DistanceJoint(body.point((0.5, 0.0, 0.1)), b.end), fb.Load("push", body, force=(F, 0.4 * F, 0)),
                     gravity=(0, 0, -9.81)), {"top": body, "head": b.end})


def test_frame_with_joints() -> None:
    v = dict(h=1.0, offset=0.2, EI=40.0, F=6.0)
    found = fb.sensitivity(frame, v, observe=("reaction",))
    for name in ("offset",):
        exact = differences(frame, v, name, lambda x: x.state.q.reshape(-1, 4, 3)[x.model.names["bodies"][0]["node"], 0])
        close(found.point("top")[name], exact, 1e-8)
    for name in v:
        by = found.gradient(points={"top": (1, -1, 2), "head": (0, 1, 0)}).by[name]
        assert by == pytest.approx(found.point("top")[name] @ (1, -1, 2) + found.point("head")[name][1], rel=1e-9)
    ends = [found.reaction(k)["F"][0] for k in found.model.reaction_names[:2]]
    close(ends[0] + ends[1], (-1.0, -0.4, 0.0), 1e-6)


# --- many parameters ---------------------------------------------------------------------------------------------------------
def net(n: int, factor: Array, load: float = -4.0) -> tuple[fb.Scene, fb.Net]:
    """A square roof of bars with its rim clamped, areas by factors."""
    grid = np.arange(n * n).reshape(n, n)
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    height = 0.3 * np.sin(np.pi * x / (n - 1)) * np.sin(np.pi * y / (n - 1))
    nodes = np.stack((x, y, height), axis=-1).reshape(-1, 3).astype(float)
    edges = np.concatenate([np.stack((a.ravel(), b.ravel()), 1) for a, b in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:]))])
    sections = [section(1e5 * f, 50.0 * f, 4e4 * f, 0.8 * f) for f in factor]
    rim = np.unique(np.concatenate((grid[0], grid[-1], grid[:, 0], grid[:, -1])))
    loads = np.zeros((n * n, 3))
    loads[:, 2] = load
    part = fb.Net("roof", nodes, edges, section=sections, section_of=np.arange(len(edges)), elements=1, degree=3, clamps=rim,
                  loads=loads)
    return fb.Scene(part, gravity=(0, 0, -9.81)), part


def test_areas_of_all_beams_of_a_net_by_one_adjoint() -> None:
    n = 6
    count = 2 * n * (n - 1)
    factor = 1.0 + 0.3 * np.sin(np.arange(count))
    weight = np.array([0.0, 0.3, 1.0])

    def build(some: float = 0.0, which: int = 0) -> Any:
        changed = factor.copy()
        changed[which] += some
        scene, part = net(n, changed)
        return scene, {"middle": part.node(2 * n + 3)}

    found = fb.sensitivity(build, {})
    before = found.factorisations
    gradient = found.gradient(points={"middle": weight})
    assert found.factorisations == before + 1
    C = np.array([section(1e5, 50.0, 4e4, 0.8).C])[0]  # noqa: N806
    by = gradient.sections["roof"].by((C, 0.8))
    assert by.shape == (count,)
    for which in (0, 7, 33, count - 1):
        one = fb.sensitivity(lambda some, which=which: build(some, which), {"some": 0.0}, scale={"some": 1.0})
        assert by[which] == pytest.approx(one.point("middle")["some"] @ weight, rel=1e-9)
        assert one.gradient(points={"middle": weight}).by["some"] == pytest.approx(by[which], rel=1e-9)
    # all at once
    total = fb.sensitivity(lambda all_of: (lambda s, p: (s, {"middle": p.node(2 * n + 3)}))(*net(n, factor + all_of)),
                           {"all_of": 0.0}, scale={"all_of": 1.0})
    assert float(np.sum(by)) == pytest.approx(total.point("middle")["all_of"] @ weight, rel=1e-9)


def test_loads_and_the_strain_energy_by_the_adjoint() -> None:
    """Derivative of the compliance by a load: the displacement there, twice that of the strain energy of a linear scene."""
    def build(F: float) -> Any:  # noqa: N803
        beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=section(1e4, 10.0), elements=3)
        return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, F))), {"tip": beam.end}

    found = fb.sensitivity(build, {"F": 3.0})
    by = found.gradient(points={"tip": (0, 0, 1)})
    assert by.forces[-1] @ (0, 0, 1) == pytest.approx(found.point("tip")["F"][2], rel=1e-11)
    assert np.all(by.forces[0] == 0.0) and np.all(by.moments[0] == 0.0)
    energy = found.gradient(strain_energy=1.0)
    assert energy.by["F"] == pytest.approx(3.0 * found.point("tip")["F"][2], rel=1e-9)
    assert energy.by["F"] == pytest.approx(found.energy()["F"], rel=1e-9)


# --- frequencies ---------------------------------------------------------------------------------------------------------------
def test_frequencies_of_a_beam_by_stiffness_mass_and_length() -> None:
    """w = f(EI/rhoA)/L^2 as long as the shear stiffness and rotary inertia go along: exact of the discrete beam."""
    def build(EI: float, rho: float, L: float) -> Any:  # noqa: N803
        scaled = fb.Section(EA=1e3 * EI / L**2, GA2=400 * EI / L**2, GA3=400 * EI / L**2, GJ=EI, EI2=EI, EI3=2 * EI, rhoA=rho,
                            rhoI2=2e-3 * rho * L**2, rhoI3=1e-3 * rho * L**2)
        beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=scaled, elements=4)
        return fb.Scene(beam, fb.Clamp(beam.start))

    v = dict(EI=3.0, rho=0.5, L=2.0)
    found = fb.sensitivity(build, v).frequencies(8)
    assert np.all(found.multiplicity == 1)
    f = found.frequencies
    close(found.by["EI"], 0.5 * f / v["EI"], 1e-10)
    close(found.by["rho"], -0.5 * f / v["rho"], 1e-10)
    close(found.by["L"], -2.0 * f / v["L"], 1e-9)


def test_double_frequencies_part() -> None:
    """A square section bends alike in both planes; a change of EI3 alone parts the pair."""
    def build(EI3: float) -> Any:  # noqa: N803
        one = fb.Section(EA=1e4, GA2=1e6, GA3=1e6, GJ=5.0, EI2=2.0, EI3=EI3, rhoA=1.0, rhoI2=0.0, rhoI3=0.0)
        beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=one, elements=6)
        return fb.Scene(beam, fb.Clamp(beam.start))

    found = fb.sensitivity(build, {"EI3": 2.0}).frequencies(4)
    assert np.all(found.multiplicity == 2)
    close(found.by["EI3"][:2], [0.0, 0.5 * found.frequencies[0] / 2.0], 1e-4)


def test_taut_string_by_its_tension() -> None:
    """The stress changes with the load: w^2 = k^2 T/(rhoA) + ... exact for the stretched beam of the model."""
    length, stiff, shear, bend, mass, rotary = 10.0, 2e5, 1e5, 1e3, 1.0, 0.05

    def build(T: float, rho: float) -> Any:  # noqa: N803
        one = fb.Section(EA=stiff, GA2=shear, GA3=shear, GJ=1e3, EI2=bend, EI3=bend, rhoA=rho, rhoI2=rotary, rhoI3=rotary)
        beam = fb.Beam.straight("string", (0, 0, 0), (length, 0, 0), section=one, elements=8, degree=5)
        rail = fb.Beam.straight("rail", (0.9 * length, 0, 0), (1.1 * length, 0, 0), section=section(1e9, 1e9, 1e9), elements=1,
                                degree=1)
        return fb.Scene(beam, rail, fb.Pin(beam.start), fb.Clamp(rail.start), fb.Clamp(rail.end),
                        fb.Slider("end", beam.end, rail, at=0.1 * length), fb.Load("pull", beam.end, force=(T, 0, 0)))

    def exact(T: float, rho: float) -> float:  # noqa: N803
        strain = T / stiff
        k = np.pi / length
        c = (1 + strain) * shear - T
        a = np.array([[shear * k * k, -c * k], [-c * k, bend * k * k + c * (1 + strain)]])
        return float(np.min(np.real(np.linalg.eigvals(np.linalg.solve(np.diag([rho, rotary]), a)))))

    v = dict(T=400.0, rho=mass)
    found = fb.sensitivity(build, v).frequencies(4, planar=True)
    assert found.squared[0] == pytest.approx(exact(**v), rel=1e-7)
    for name in v:
        e = 1e-3 * v[name]
        slope = float(EIGHTH @ np.array([exact(**{**v, name: v[name] + k * e}) for k in AWAY])) / e
        assert found.squared_by[name][0] == pytest.approx(slope, rel=1e-6), name


@pytest.mark.slow
def test_frequencies_of_a_ring_on_its_cable_against_differences() -> None:
    found = fb.sensitivity(ring, RING).frequencies(5)
    for name in RING:
        exact = differences(ring, RING, name, lambda x: x.frequencies(5).squared)
        close(found.squared_by[name], exact, 1e-7)


# --- critical loads -------------------------------------------------------------------------------------------------------------
def test_buckling_load_of_a_column() -> None:
    """Clamped and free: with shortening and shear, P (1 - P/EA + P/GA) = EI (pi/2 L)^2."""
    def build(EI: float, L: float, F: float, EA: float, side: float) -> Any:  # noqa: N803
        beam = fb.Beam.straight("column", (0, 0, 0), (L, 0, 0), section=section(EA, EI, 1e4), elements=8, degree=4)
        return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("press", beam.end, force=(-F, side, 0)))

    def exact(EI: float, L: float, F: float, EA: float, **_: float) -> float:  # noqa: N803
        k = (0.5 * np.pi / L)**2 * EI
        return brentq(lambda p: p * (1 - p / EA + p / 1e4) - k, 0.0, 2 * k, xtol=1e-14) / F

    v = dict(EI=100.0, L=2.0, F=100.0, EA=3e4, side=0.0)
    model = fb.compile_scene(build(**v), planar=True)
    path = fb.solve_path(model, stop_at="bifurcation", to=2.0, step=0.2, largest_step=0.5)
    factor = float(path.series["load_factor"][-1])
    assert factor == pytest.approx(exact(**v), rel=1e-7)
    found = fb.critical_sensitivity(build, v, state=path.state, load_factor=factor, scale={"side": 1.0})
    assert found.kind == "bifurcation" and np.isnan(found.by["side"])
    for name in ("EI", "L", "F", "EA"):
        e = 1e-3 * v[name]
        slope = float(EIGHTH @ np.array([exact(**{**v, name: v[name] + k * e}) for k in AWAY])) / e
        assert found.by[name] == pytest.approx(slope, rel=1e-5 if name == "EA" else 1e-7), name
    assert np.max(np.abs(found.displacements[:, 1])) == pytest.approx(1.0) and np.max(np.abs(found.displacements[:, 0])) < 1e-6
    with pytest.raises(fb.SceneError, match="the state is not a critical point"):
        fb.critical_sensitivity(build, v, state=model.state(), load_factor=0.0, scale={"side": 1.0})
    with pytest.raises(fb.ConvergenceError, match="the tangent of the equilibrium"):
        fb.sensitivity(lambda EI: build(**{**v, "EI": EI}), {"EI": 100.0}, state=path.state, load_factor=factor)


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (1.0, 2.0, -0.7)])
def test_a_strut_on_pins_that_may_spin_about_its_line(way: tuple[float, ...]) -> None:
    """Euler: pi^2 EI/(L^2 F) of the weak axis, EA and GA alike; in any direction, also across the plane of a scene."""
    along = np.array(way) / np.linalg.norm(way)
    one = np.array([0, 0, 1.0]) if along[0] == 1.0 else np.cross(along, (0, 0, 1)) / np.linalg.norm(along[:2])
    two = np.cross(along, one)

    def build(EI: float, L: float) -> Any:  # noqa: N803
        strip = section(1e6, EI, 1e6, GJ=1.0, EI3=1e4)
        strut = fb.Beam.straight("strut", (0, 0, 0), L * along, d2=one, section=strip, elements=6)
        rails = ([fb.Pin(strut.end, axes="yz")] if along[0] == 1.0 else
                 [fb.Spring(fb.GROUND.point(L * along + 1e3 * x), strut.end, stiffness=1e9) for x in (one, two)])
        return fb.Scene(strut, fb.Pin(strut.start), *rails, fb.Load("press", strut.end, force=-12.0 * along))

    v = dict(EI=1.0, L=1.0)
    model = fb.compile_scene(build(**v))
    path = fb.solve_path(model, stop_at="bifurcation")
    factor = float(path.series["load_factor"][-1])
    assert factor == pytest.approx(np.pi**2 / 12.0, rel=2e-6) and (model.plane is None) == (along[0] < 1.0)
    found = fb.critical_sensitivity(build, v, state=path.state, load_factor=factor)
    assert found.kind == "bifurcation"
    assert found.by["EI"] == pytest.approx(factor, rel=1e-6) and found.by["L"] == pytest.approx(-2.0 * factor, rel=2e-6)
    # nothing of the spin
    assert np.max(np.abs(found.spins @ along)) < 1e-6 * np.max(np.abs(found.spins))


@pytest.mark.slow
def test_a_strip_that_buckles_out_of_its_plane() -> None:
    """P = 4.0126 sqrt(EI3 GJ)/L^2 where it is much stiffer in its plane: the exponents are 1/2, 1/2 and -2."""
    def build(EI3: float, GJ: float, L: float) -> Any:  # noqa: N803
        flat = section(1e7, 1e5, 1e7, GJ=GJ, EI3=EI3, EI2=1e5)
        strip = fb.Beam.straight("strip", (0, 0, 0), (L, 0, 0), section=flat, elements=8)
        return fb.Scene(strip, fb.Clamp(strip.start), fb.Load("tip", strip.end, force=(0, 0, -1.0)))

    v = dict(EI3=1.0, GJ=0.5, L=1.2)
    path = fb.solve_path(fb.compile_scene(build(**v), planar=False), stop_at="bifurcation", to=10.0, step=0.5, largest_step=1.0)
    factor = float(path.series["load_factor"][-1])
    found = fb.critical_sensitivity(build, v, state=path.state, load_factor=factor)
    for name, power in (("EI3", 0.5), ("GJ", 0.5), ("L", -2.0)):
        assert found.by[name] == pytest.approx(power * factor / v[name], rel=1e-4), name


def test_the_force_of_a_drive_that_snaps_a_bead_through() -> None:
    """On a rail beside the anchor of a spring: F L = -k (1 - l/r) (x - s), r^2 = (x - s)^2 + h^2, is largest where
    r^3 = l h^2."""
    values = dict(F=10.0, k=20.0, l=1.0, h=0.6)

    def build(F: float, k: float, l: float, h: float) -> fb.Scene:  # noqa: E741, N803
        stiff = fb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
        rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=stiff, elements=4)
        bead = fb.PointMass("bead", mass=1.0)
        return fb.Scene(rail, bead, fb.Spring(bead, fb.GROUND.point((2.0, 0.0, h)), stiffness=k, length=l),
                        *(fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)),
                        fb.Slider("s", bead, rail, at=1.2, drive=fb.Drive(force=F)))

    at = fb.solve_path(fb.compile_scene(build(**values)), stop_at="limit")
    factor = at.series["load_factor"][-1]
    found = fb.critical_sensitivity(build, values, state=at.state, load_factor=factor)
    assert found.kind == "limit"
    r = (values["l"] * values["h"]**2)**(1.0 / 3.0)
    d = np.sqrt(r * r - values["h"]**2)
    load = -values["k"] * (1.0 - values["l"] / r) * d / values["F"]
    exact = {"F": -load / values["F"], "k": load / values["k"], "l": values["k"] * d / r / values["F"],
             "h": -values["k"] * values["l"] * d * values["h"] / r**3 / values["F"]}
    assert factor == pytest.approx(load, rel=1e-9)
    for name, value in exact.items():
        assert found.by[name] == pytest.approx(value, rel=1e-7), name


def test_a_column_that_a_drive_presses_on() -> None:
    """A bead at its end slides on a stiff rail: F L = pi^2 EI/l^2, but for its compression."""
    values = dict(F=10.0, EI=1.0, length=1.0)

    def build(F: float, EI: float, length: float) -> fb.Scene:  # noqa: N803
        column = fb.Beam.straight("column", (0, 0, 0), (length, 0, 0), elements=8, section=fb.Section(
            EA=1e7, GA2=1e7, GA3=1e7, GJ=1.0, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=0.1, rhoI3=0.1))
        stiff = fb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
        rail = fb.Beam.straight("rail", (length - 0.5, 0, 0), (length + 0.5, 0, 0), section=stiff, elements=1)
        return fb.Scene(column, rail, fb.Pin(column.start), *(fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)),
                        fb.Slider("s", column.end, rail, at=0.5, drive=fb.Drive(force=-F)))

    at = fb.solve_path(fb.compile_scene(build(**values), planar=True), to=2.0, stop_at="bifurcation")
    factor = at.series["load_factor"][-1]
    found = fb.critical_sensitivity(build, values, state=at.state, load_factor=factor)
    assert found.kind == "bifurcation"
    assert factor == pytest.approx(np.pi**2 / 10.0, rel=1e-5)
    for name, power in (("F", -1), ("EI", 1), ("length", -2)):
        assert found.by[name] == pytest.approx(power * factor / values[name], rel=1e-5), name


def test_snap_load_of_a_truss_is_homogeneous() -> None:
    """Two bars and two across: the limit load is EA f(h/b)/F, so its derivatives are known but for one, which a difference of the
    exact limit tells."""
    def build(EA: float, h: float, b: float, F: float) -> Any:  # noqa: N803
        top, long = fb.PointMass("top", mass=1.0, position=(0, 0, h)), float(np.hypot(b, h))
        ground = [(b, 0.0, 0.0), (-b, 0.0, 0.0), (0.0, b, 0.0), (0.0, -b, 0.0)]
        return fb.Scene(top, *(fb.Spring(top, fb.GROUND.point(x), stiffness=EA / long, length=long) for x in ground),
                        fb.Load("push", top, force=(0, 0, -F)))

    def exact(EA: float, h: float, b: float, F: float) -> float:  # noqa: N803
        long = np.hypot(b, h)
        # 4 k (long - l) z/l is largest where long b^2 = l^3
        now = (long * b * b)**(1 / 3)
        return float(4 * EA / long * (long - now) * np.sqrt(now**2 - b * b) / now / F)

    v = dict(EA=100.0, h=0.3, b=1.0, F=1.0)
    path = fb.solve_path(fb.compile_scene(build(**v)), stop_at="limit", to=1e3)
    factor = float(path.series["load_factor"][-1])
    assert factor == pytest.approx(exact(**v), rel=1e-10)
    found = fb.critical_sensitivity(build, v, state=path.state, load_factor=factor)
    assert found.kind == "limit" and np.argmax(np.abs(found.displacements.reshape(-1))) == 2
    for name in v:
        e = 1e-3 * v[name]
        slope = float(EIGHTH @ np.array([exact(**{**v, name: v[name] + k * e}) for k in AWAY])) / e
        assert found.by[name] == pytest.approx(slope, rel=1e-10), name


# --- what all of it rests on --------------------------------------------------------------------------------------------------
def hinge(k: float, h: float, F: float) -> Any:  # noqa: N803
    """Two beams in space and a revolute joint with a spring."""
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, h), section=section(EI=3.0), elements=2)
    b = fb.Beam.straight("b", (1, 0, h), (2, 0.1, 0), section=section(EI=3.0), elements=2)
    return (fb.Scene(a, b, fb.Clamp(a.start), fb.RevoluteJoint(a.end, b.start, axis=(0, 1, 0), stiffness=k),
                     fb.Load("push", b.end, force=(0, 0.1 * F, F))), {"end": b.end})


def on_a_sleeve(EI: float, a: float) -> Any:  # noqa: N803
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=section(EI=EI), elements=4)
    block = fb.RigidBody("block", mass=0.5, inertia=(0.1, 0.1, 0.1), position=(0.7, 0, 0))
    return (fb.Scene(rail, block, fb.Clamp(rail.start), fb.Clamp(rail.end), fb.Sleeve("sleeve", block, rail, at=0.7),
                     fb.Spring(block, fb.GROUND.point((1.2 + a, 0.2, 0.5)), stiffness=30.0, length=0.3), gravity=(0, 0, -3)),
            {"end": block})


@pytest.mark.parametrize(("build", "values"), [(ring, RING), (hinge, dict(k=2.0, h=0.2, F=0.3)),
                                               (on_a_sleeve, dict(EI=5.0, a=0.1))])
def test_the_tangent_is_the_derivative_of_the_equations(build: Callable[..., Any], values: dict[str, float]) -> None:
    """Along a random way of all unknowns, spins and multipliers too."""
    base = fb.sensitivity(lambda: build(**values), {})._base
    way = np.random.default_rng(0).standard_normal(base.unknowns)
    way[:base.nodes] *= base.map.free
    e = 1e-3
    around = [at_shape(base, base.stepper.model, base.factors, way, k * e).unbalanced() for k in AWAY]
    change = base.linearised()[0].matrix @ way
    size = np.abs(base.linearised()[0].matrix) @ np.abs(way)
    off = np.abs(change + np.tensordot(EIGHTH, np.array(around), 1) / e)
    assert np.all(off <= 1e-9 * size) and np.any(size > 0.0)


def test_hinge_against_differences() -> None:
    v = dict(k=2.0, h=0.2, F=0.3)
    found = fb.sensitivity(hinge, v)
    assert max(found.accuracy.values()) < 1e-8
    for name in v:
        exact = differences(hinge, v, name, lambda x: x.state.q.reshape(-1, 4, 3)[-1, 0])
        close(found.point("end")[name], exact, 1e-8)
        assert found.gradient(points={"end": (1, 2, 3)}).by[name] == pytest.approx(found.point("end")[name] @ (1, 2, 3), rel=1e-9)
