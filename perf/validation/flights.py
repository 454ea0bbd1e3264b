"""Dynamics without sliders: smooth flights against a spectral code, frequencies of small vibrations."""
from __future__ import annotations

import math

import numpy as np

import fastbeam as fb

from .invariants import section
from .rows import Array, Row, distance, orders, reference

QUIET = {"output": fb.Output(snapshots=0), "progress": False}


# ----------------------------------------------------------------------------------------------------------- free flight
def free_flight(step: float, order: int, t_end: float, elements: int = 24, degree: int = 5) -> float:
    """Largest error of both ends over the length, at the times of the reference until t_end."""
    rows = reference("free_flight")["rows"]
    length, twist = 10.0, 1.5
    drift, across = np.array((1.0, 0.5, -0.25)), np.array((0.0, -2.5, 4.0))

    def bump(s: Array) -> Array:
        return np.sin(math.pi * s / length) ** 8

    def slope(s: Array) -> Array:
        return 8.0 * math.pi / length * np.sin(math.pi * s / length) ** 7 * np.cos(math.pi * s / length)

    beam = fb.Beam.straight("rod", (0, 0, 0), (length, 0, 0), section=section(), elements=elements, degree=degree)
    start = fb.InitialVelocity(beam, velocity=lambda s: drift + bump(s)[:, None] * across,
                               spin=lambda s: np.stack((twist * bump(s), -across[2] * slope(s), across[1] * slope(s)), axis=1))
    result = fb.simulate(fb.compile_scene(fb.Scene(beam, start)), t_end=t_end, step=step, order=order,
                         every=round(rows[1, 0] / step), points={"start": beam.start, "end": beam.end}, **QUIET)
    n = len(result.t)
    return max(distance(result.point("start"), rows[:n, 1:4]), distance(result.point("end"), rows[:n, 4:])) / length


def check_free_flight(quick: bool = False) -> list[Row]:
    """Free flight of a rod with bending, shear, torsion and axial waves; the axial ones ask for small steps.

    The rates are taken over the first 2 s, where the reference (its own error there: 1e-8 L) is better than both runs.
    """
    if quick:
        return [Row("free flight until 2 s, order 4, step 2.5e-3 s: both ends / L", free_flight(2.5e-3, 4, 2.0, 20, 4),
                    at_most=1e-7)]
    fine = free_flight(1.25e-3, 4, 10.0)
    second = [free_flight(h, 2, 2.0) for h in (6.25e-4, 3.125e-4)]
    fourth = [free_flight(h, 4, 2.0) for h in (5e-3, 2.5e-3)]
    return [Row("free flight until 10 s, order 4, step 1.25e-3 s: both ends / L", fine, at_most=1e-7),
            Row("free flight: rate of order 2, steps 6.25e-4 and 3.125e-4 s", float(orders(second)[0]), at_least=1.8,
                at_most=2.2),
            Row("free flight: rate of order 4, steps 5e-3 and 2.5e-3 s", float(orders(fourth)[0]), at_least=3.5)]


# ------------------------------------------------------------------------------------------------------- flying spaghetti
def spaghetti(step: float, order: int, t_end: float | None = None, elements: int = 16, degree: int = 5) -> float:
    """Largest error of both ends over the length, at the times of the reference until t_end."""
    rows = reference("spaghetti")["rows"]
    beam = fb.Beam.straight("rod", (0, 8, 0), (6, 0, 0), section=section(), elements=elements, degree=degree)
    load = fb.Load("throw", beam.end, force=(16, 0, 0), moment=(0, 0, -160),
                   time=lambda t: math.sin(math.pi * t / 2.5) ** 4 if t < 2.5 else 0.0)
    result = fb.simulate(fb.compile_scene(fb.Scene(beam, load)), t_end=t_end or rows[-1, 0], step=step, order=order,
                         every=round(rows[1, 0] / step), points={"A": beam.end, "B": beam.start}, **QUIET)
    n = len(result.t)
    return max(distance(result.point("A")[:, :2], rows[:n, 1:3]), distance(result.point("B")[:, :2], rows[:n, 3:])) / 10.0


def check_spaghetti(quick: bool = False) -> list[Row]:
    """Flying rod (Simo and Vu-Quoc 1986) with a smooth load pulse."""
    if quick:
        second = [spaghetti(h, 2, 5.0, 10) for h in (0.02, 0.01)]
        return [Row("flying spaghetti until 5 s, order 4, step 0.01 s: both ends / L", spaghetti(0.01, 4, 5.0, 12), at_most=1e-7),
                Row("flying spaghetti until 5 s: rate of order 2", float(orders(second)[0]), at_least=1.9, at_most=2.1)]
    fourth = [spaghetti(h, 4) for h in (0.02, 0.01, 0.005)]
    second = [spaghetti(h, 2) for h in (0.01, 0.005)]
    return [Row("flying spaghetti until 15 s, order 4, step 0.01 s: both ends / L", fourth[1], at_most=1e-7),
            Row("flying spaghetti until 15 s, order 4, step 0.005 s: both ends / L", fourth[2], at_most=1e-7),
            Row("flying spaghetti: rate of order 2, steps 0.01 and 0.005 s", float(orders(second)[0]), at_least=1.9, at_most=2.1),
            Row("flying spaghetti: rate of order 4, steps 0.02 and 0.01 s", float(orders(fourth)[0])),
            Row("flying spaghetti: rate of order 4, steps 0.01 and 0.005 s", float(orders(fourth)[1]), at_least=3.8, at_most=4.2)]


# -------------------------------------------------------------------------------------------------------------- frequency
def frequency(mode: int, periods: int) -> float:
    """Angular frequency (rad/s) of a bending mode of the pinned beam, from the last zero of a small vibration in that mode alone.

    The mode of a pinned Timoshenko beam is w = W sin(k x), angle = (k - rhoA omega^2/(GA k)) W cos(k x), k = mode pi/L.
    """
    data = reference("frequencies")
    length, omega = data["L"], data["pinned"][mode - 1]
    # soft along its axis: the stretch of the held ends, of second order in the amplitude, then stays below 1e-9
    soft = fb.Section(EA=data["EI"], GA2=data["GA"], GA3=data["GA"], GJ=data["EI"], EI2=data["EI"], EI3=data["EI"],
                      rhoA=data["rhoA"], rhoI2=data["rhoI"], rhoI3=data["rhoI"])
    beam = fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=soft, elements=8 * mode, degree=4)
    k, amplitude = mode * math.pi / length, 1e-4
    angle = k - data["rhoA"] * omega**2 / (data["GA"] * k)
    start = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0.0 * s, amplitude * omega * np.sin(k * s), 0.0 * s), axis=1),
                               spin=lambda s: np.stack((0.0 * s, 0.0 * s, amplitude * omega * angle * np.cos(k * s)), axis=1))
    model = fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end), start))
    period = 2.0 * math.pi / omega
    result = fb.simulate(model, t_end=(periods + 0.25) * period, step=period / 80, order=4, every=1,
                         points={"top": (beam, length / (2 * mode))}, **QUIET)
    y = result.point("top")[:, 1]
    before = int(np.flatnonzero(y[:-1] * y[1:] < 0.0)[-1])
    # cubic through the four values around the last zero, as a function of time
    near = slice(before - 1, before + 3)
    t = result.t[near] - result.t[before]
    zeros = np.roots(np.polyfit(t / period, y[near] / amplitude, 3))
    zero = float(min((z.real for z in zeros if abs(z.imag) < 1e-6), key=lambda z: abs(z - 0.5 / 80))) * period
    passed = round(omega * (result.t[before] + zero) / math.pi)
    return passed * math.pi / (float(result.t[before]) + zero)


def check_frequencies(quick: bool = False) -> list[Row]:
    """Small free vibrations of a pinned Timoshenko beam."""
    exact = reference("frequencies")["pinned"]
    return [Row(f"pinned beam, bending mode {mode}: frequency, relative",
                abs(frequency(mode, 2 if quick else 5) / exact[mode - 1] - 1.0), at_most=1e-6)
            for mode in ((1,) if quick else (1, 2, 3))]
