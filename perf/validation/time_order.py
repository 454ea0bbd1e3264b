"""Observed order in time on a fixed mesh, against a fine run of order 4, method.md 4 and 6."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Row, orders

T_END = 1.2
# the slider stays within one element of six: its path on a C0 curve is smooth there
START, RATE = 4.0, 0.6
# m/s; passes an element end
CROSSING = 2.0


def soft_scene(slider: bool, strain: str = "simo_reissner", interpolation: str = "lagrange", curve: str = "own",
               rate: float = RATE) -> fb.Scene:
    """Free soft beam with smooth initial velocities, with or without a sliding mass: all waves are slow against the steps."""
    section = fb.Section(EA=20.0, GA2=20.0, GA3=20.0, GJ=10.0, EI2=10.0, EI3=10.0, rhoA=1.0, rhoI2=1.0, rhoI3=1.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (10, 0, 0), section=section, elements=6, degree=3, interpolation=interpolation,
                            strain=strain)
    start = fb.InitialVelocity(
        beam, velocity=lambda s: np.stack((0.1 * np.cos(0.3 * s), np.sin(0.5 * s), 0.5 * np.cos(0.4 * s)), axis=1),
        spin=lambda s: np.stack((0.2 + 0.0 * s, 0.2 * np.sin(0.4 * s), 0.5 * np.cos(0.5 * s)), axis=1))
    scene = fb.Scene(beam, start, name="soft beam")
    if slider:
        mass = fb.PointMass("mass", mass=1.5)
        scene.add(mass, fb.Slider("contact", mass, beam, at=START, rate=rate, curve=curve))
    return scene


def errors(scene: fb.Scene, order: int, steps: Sequence[int], fine: int) -> list[float]:
    """Error of all node positions and s at the end over the beam length for runs of so many steps; `fine`: the reference run."""
    model = fb.compile_scene(scene)

    def end(n: int, order: int) -> np.ndarray:
        settings: dict[str, Any] = {"observe": (), "output": fb.Output(snapshots=0), "progress": False}
        state = fb.simulate(model, t_end=T_END, step=T_END / n, order=order, **settings).state
        return np.concatenate((state.q.reshape(-1, 12)[:, :3].ravel(), state.s))

    exact = end(fine, 4)
    return [float(np.max(np.abs(end(n, order) - exact))) / 10.0 for n in steps]


def check_time_order(quick: bool = False) -> list[Row]:
    """Orders 2 and 4 in positions, with and without slider, for both strain sets and for splines."""
    cases = [(False, "simo_reissner", "lagrange"), (True, "simo_reissner", "lagrange"), (True, "green_lagrange", "lagrange"),
             (True, "simo_reissner", "bspline")]
    rows = []
    for slider, strain, interpolation in cases[:2] if quick else cases:
        scene = soft_scene(slider, strain, interpolation)
        for order, steps in ((2, (160, 320)), (4, (80, 160))) if quick else ((2, (80, 160, 320)), (4, (40, 80, 160))):
            e = errors(scene, order, steps, 480 if quick else 960)
            what = f"{'slider' if slider else 'no slider'}, {interpolation} 3, {strain}, order {order}"
            rows.append(Row(f"order in time, {what}: {steps[-2]} to {steps[-1]} steps", float(orders(e)[-1]),
                            at_least=order - 0.1, at_most=order + 0.1))
            if not quick:
                rows.append(Row(f"order in time, {what}: {steps[-3]} to {steps[-2]} steps", float(orders(e)[-2])))
                rows.append(Row(f"order in time, {what}: error / L with {steps[-1]} steps", e[-1]))
    return rows


def study_corner_orders(quick: bool = False) -> list[Row]:
    """Across element ends the path is as smooth as the curve: what is left of the orders."""
    rows: list[Row] = []
    if quick:
        return rows
    for name, interpolation, curve in (("lagrange 3, own curve", "lagrange", "own"), ("lagrange 3, C1 curve", "lagrange", "c1"),
                                       ("bspline 3", "bspline", "own")):
        scene = soft_scene(True, interpolation=interpolation, curve=curve, rate=CROSSING)
        for order in (2, 4):
            e = errors(scene, order, (80, 160, 320), 1920)
            for k, n in enumerate((80, 160)):
                rows.append(Row(f"order in time, slider across element ends, {name}, order {order}: {n} to {2 * n} steps",
                                float(orders(e)[k])))
            rows.append(Row(f"order in time, slider across element ends, {name}, order {order}: error / L with 320 steps", e[-1]))
    return rows
