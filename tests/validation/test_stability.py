"""Exact critical loads: twisted shaft, follower force, ring under dead and normal pressure, column between clamps."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

import fastbeam as fb

pytestmark = pytest.mark.slow
Array = np.ndarray


def section(stiff: float, GJ: float = 1.0, EI3: float = 1.0) -> fb.Section:
    return fb.Section(EA=stiff, GA2=stiff, GA3=stiff, GJ=GJ, EI2=1.0, EI3=EI3, rhoA=1.0, rhoI2=1e-8, rhoI3=1e-8)


def test_shaft_of_greenhill_between_clamps() -> None:
    """M L/EI = 2 x with tan x = x, 8.986818916, for a shaft whose end is turned and may move along it (A. G. Greenhill, 1883)."""
    exact = 2.0 * brentq(lambda x: np.tan(x) - x, 4.4, 4.6, xtol=1e-14)
    stiff = 100.0
    shaft = fb.Beam.straight("shaft", (0, 0, 0), (1, 0, 0), section=section(1e7, stiff), elements=16)
    turn = fb.PrescribedMotion("turn", shaft.end, rotation=lambda t: (t / stiff, 0, 0), axes="yz")
    model = fb.compile_scene(fb.Scene(shaft, fb.Clamp(shaft.start), turn))

    def lowest(moment: float) -> float:
        state = fb.solve_static(model, at_time=moment).state
        return float(fb.modes(model, state=state, at_time=moment, n=2).squared[0])

    found = brentq(lowest, 8.9, 9.1, xtol=1e-9)
    assert found == pytest.approx(exact, rel=1e-6)


def follows(t: float, position: Array, directors: Array, velocity: Array, spin: Array, parameters: Array, force: Array,
            moment: Array) -> None:
    force[:] = -parameters[0] * directors[0]


def test_cantilever_of_beck() -> None:
    """Flutter where two roots of 2 W + p^2 ... meet: p = 20.0509 EI/L^2 (M. Beck, Z. angew. Math. Phys. 3, 1952)."""
    def misfit(p: float, w: float) -> float:
        a, b = np.sqrt(np.sqrt(0.25 * p * p + w * w) + 0.5 * p), np.sqrt(np.sqrt(0.25 * p * p + w * w) - 0.5 * p)
        return float(p * p + 2.0 * w * w * (1.0 + np.cos(a) * np.cosh(b)) + p * w * np.sin(a) * np.sinh(b))

    def both(x: Array) -> list[float]:
        return [misfit(*x), 1e4 * (misfit(x[0], x[1] + 1e-4) - misfit(x[0], x[1] - 1e-4)) / 2.0]

    exact = float(fsolve(both, [20.0, 11.0], xtol=1e-13)[0])
    assert exact == pytest.approx(20.0509, abs=1e-3)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section(1e8, 100.0, 100.0), elements=16)
    law = fb.UserForce("thrust", beam.end, follows, parameters=(20.0,), dissipates=False, grows=True)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), law))

    def apart(factor: float) -> float:
        """Square of half the difference of the two w^2, negative where they are a pair of complex numbers."""
        found = fb.modes(model, state=pressed(factor), load_factor=factor, n=4)
        w = (found.angular + 1j * found.growth)[:2]**2
        if abs(w[0].imag) > 0.0:
            return -float(w[0].imag**2)
        return float(np.real(0.5 * (w[1] - w[0]))**2)

    def pressed(factor: float) -> Any:
        """Straight, and shorter."""
        start = model.state()
        x = start.q.reshape(-1, 4, 3)[:, 0]
        x[:, 0] *= 1.0 - 20.0 * factor / 1e8
        return start

    found = 20.0 * brentq(apart, 0.95, 1.05, xtol=1e-10)
    assert found == pytest.approx(exact, rel=1e-6)


def quarter(stiff: float) -> tuple[fb.Beam, list[Any]]:
    """Of a ring that deforms alike in all four: ends move along their radii without turning."""
    arc = fb.Beam.arc("arc", (1, 0, 0), (0, 0, 1), (-1, 0, 0), radius=1.0, angle=0.5 * np.pi, section=section(stiff), elements=16)
    return arc, [fb.Clamp(arc.start, axes="yz"), fb.Clamp(arc.end, axes="xy")]


def test_ring_under_dead_pressure() -> None:
    """q R^3/EI = 4 where the pressure keeps its direction; what is left is its compression, extrapolated."""
    rows = []
    for stiff in (1e4, 2e4, 4e4):
        arc, held = quarter(stiff)
        push = fb.DistributedLoad("push", arc, force=lambda s: -5.0 * np.stack((np.cos(s), 0 * s, np.sin(s)), axis=1))
        model = fb.compile_scene(fb.Scene(arc, *held, push), planar=True)
        at = fb.solve_path(model, stop_at="bifurcation")
        rows.append(5.0 * at.info["critical_points"][-1]["load_factor"])
    table = np.array(rows)
    for k in (1, 2):
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    assert table[0] == pytest.approx(4.0, rel=1e-6)


def presses(t: float, position: Array, directors: Array, velocity: Array, spin: Array, parameters: Array, force: Array,
            moment: Array) -> None:
    # the ring lies in the plane of x and z
    force[0], force[2] = -parameters[0] * directors[0, 2], parameters[0] * directors[0, 0]


def test_ring_under_normal_pressure() -> None:
    """q R^3/EI = 3 where the pressure stays normal to the ring."""
    rows = []
    for stiff in (1e4, 2e4, 4e4):
        def lowest(q: float, stiff: float = stiff) -> float:
            arc, held = quarter(stiff)
            press = fb.UserForce("press", arc, presses, parameters=(q,), dissipates=False)
            model = fb.compile_scene(fb.Scene(arc, *held, press))
            found = fb.modes(model, state=fb.solve_static(model).state, n=8)
            flat = np.abs(found.displacements[:, :, 1]).max(axis=1) < 1e-6
            return float(found.squared[flat][0])

        # w^2 falls with the pressure as good as linearly; at zero Newton's method has nothing to hold on to
        q = np.array([2.0, 2.4, 2.8])
        roots = np.roots(np.polyfit(q, [lowest(x) for x in q], 2))
        rows.append(float(roots[np.argmin(np.abs(roots - 3.0))]))
    table = np.array(rows)
    for k in (1, 2):
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    assert table[0] == pytest.approx(3.0, rel=1e-6)


def test_column_between_clamps() -> None:
    """4 pi^2 EI/L^2 (L. Euler), with the shortening and the shear of stiff columns extrapolated."""
    rows = []
    for stiff in (1e4, 2e4, 4e4):
        column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(stiff), elements=16)
        press = fb.Load("press", column.end, force=(0, 0, -50.0))
        model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Clamp(column.end, axes="xy"), press))
        at = fb.solve_path(model, stop_at="bifurcation")
        rows.append(50.0 * at.info["critical_points"][-1]["load_factor"])
    table = np.array(rows)
    for k in (1, 2):
        table = (2**k * table[1:] - table[:-1]) / (2**k - 1)
    assert table[0] == pytest.approx(4.0 * np.pi**2, rel=1e-6)
