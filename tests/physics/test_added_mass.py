"""Mass of the fluid that parts carry along: Kirchhoff's equations, exact frequencies, invariants, what it does not go with."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb
from fastbeam.run import Result

Array = np.ndarray
MASS, INERTIA = 1.0, np.array([0.2, 0.5, 0.6])
SECTION = fb.Section(EA=2e4, GA=8e3, GJ=20.0, EI=30.0, rhoA=1.5, rhoI=2e-3)


def skew(x: Array) -> Array:
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def kirchhoff(normal: float, tangential: float, v: Array, w: Array, t: float, plane: bool) -> tuple[Array, Array, Array]:
    """Place, axes and velocity of the body at time t."""
    m = MASS + np.array([tangential, normal, normal])

    def rates(_: float, y: Array) -> Array:
        r, a, b = y[3:12].reshape(3, 3), y[12:15], y[15:]
        p, h = m * a, INERTIA * b
        return np.concatenate([r @ a, (r @ skew(b)).reshape(-1), np.cross(p, b) / m, (np.cross(h, b) + np.cross(p, a)) / INERTIA])

    y = solve_ivp(rates, (0.0, t), np.concatenate([np.zeros(3), np.eye(3).reshape(-1), v, w]), method="DOP853", rtol=1e-12,
                  atol=1e-13).y[:, -1]
    r = y[3:12].reshape(3, 3)
    return y[:3], r, r @ y[12:15]


def drift(result: Result, *more: str) -> float:
    """Largest of the invariants, relative to their sizes."""
    found = [np.ptp(result.series["total"]) / abs(result.series["total"][0])]
    for x in (result.series["lin_mom"], result.series["ang_mom"]):
        found.append(np.max(np.abs(x - x[0])) / np.max(np.linalg.norm(x, axis=1)))
    return float(max(found))


@pytest.mark.parametrize("order, normal, tangential, plane", [
    (2, 1.4, 0.3, False), (2, 1.4, 0.0, False), (4, 1.4, 0.3, False), (2, 0.2, 1.7, True)])
def test_body_in_fluid(order: int, normal: float, tangential: float, plane: bool) -> None:
    v, w = np.array([1.0, 0.5, -0.3]), np.array([0.7, 1.0, -1.2])
    if plane:
        v[2] = w[0] = w[1] = 0.0
    place, axes, velocity = kirchhoff(normal, tangential, v, w, 2.0, plane)
    body = fb.RigidBody("body", mass=MASS, inertia=INERTIA, position=(0, 0, 0), velocity=v, spin=w)
    model = fb.compile_scene(fb.Scene(body, fb.AddedMass("water", body, normal=normal, tangential=tangential)),
                             planar=plane or "auto")
    off = []
    for n in (50, 100, 200):
        result = fb.simulate(model, t_end=2.0, step=2.0 / n, order=order, progress=False)
        end = result.state
        q, rate = end.q.reshape(-1, 4, 3)[0], end.v.reshape(-1, 4, 3)[0]
        off.append(max(np.max(np.abs(q[0] - place)), np.max(np.abs(q[1:].T - axes)), np.max(np.abs(rate[0] - velocity))))
        assert drift(result) < 1e-12
        assert np.mean(result.series["iterations"][1:]) < 6 * (5 if order == 4 else 1)
    print(order, off)
    assert off[-2] / off[-1] == pytest.approx(2.0**order, rel=0.15)
    assert off[-1] < {2: 2e-3, 4: 2e-6}[order]
