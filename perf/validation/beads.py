"""Beads on wires with exact solutions; the wires are beams so stiff that their own motion does not count."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Array, Row, reference

# under the weights used here the wires give way by about 1e-8 of their length
STIFF = 1e9
QUIET = {"output": fb.Output(snapshots=0), "progress": False}


def wire(**inertia: float) -> fb.Section:
    """A very stiff section."""
    values = {"rhoA": 1.0, "rhoI2": 0.1, "rhoI3": 0.1} | inertia
    return fb.Section(EA=STIFF, GA2=STIFF, GA3=STIFF, GJ=STIFF, EI2=STIFF, EI3=STIFF, **values)


def glide(beam: fb.Beam, at: float, gravity: Any, t_end: float, step: float, curve: str = "own") -> tuple[Array, Array]:
    """Times [n] and s [n] of a bead of 1 kg released on a wire that is clamped at both ends."""
    bead = fb.PointMass("bead", mass=1.0)
    scene = fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Slider("contact", bead, beam, at=at, curve=curve),
                     gravity=gravity)
    result = fb.simulate(fb.compile_scene(scene), t_end=t_end, step=step, **QUIET)
    return result.t, result.slider("contact")["s"]


def incline() -> float:
    """Straight wire at 30 degrees: s = s0 + g sin(a) t^2/2; largest error / L."""
    beam = fb.Beam.straight("wire", (0, 0, 0), (4.0 * math.cos(math.pi / 6), 0, -2.0), section=wire(), elements=8)
    t, s = glide(beam, 0.5, (0, 0, -9.81), 1.0, 0.01)
    return float(np.max(np.abs(s - 0.5 - 0.5 * 9.81 * 0.5 * t**2))) / beam.length


def tautochrone(step: float) -> float:
    """Cycloid: harmonic in the arc length for every amplitude; largest error over one period / L."""
    data = reference("sliding_exact")["tautochrone"]
    a, g, p = data["a"], data["g"], 2.6

    def cycloid(u: float) -> tuple[float, float, float]:
        x = p * (2.0 * u - 1.0)
        return a * (x + math.sin(x)), 0.0, -a * (1.0 + math.cos(x))

    beam = fb.Beam.from_curve("wire", cycloid, section=wire(), elements=24, degree=4)
    middle, start = 0.5 * beam.length, 0.7
    t, s = glide(beam, middle + start, (0, 0, -g), data["period"], step)
    return float(np.max(np.abs(s - middle - start * np.cos(math.sqrt(g / (4.0 * a)) * t)))) / beam.length


def helix(step: float) -> float:
    """Vertical helix: constant acceleration along the wire; largest error / L."""
    data = reference("sliding_exact")["helix"]
    beam = fb.Beam.helix("wire", radius=data["R"], pitch=2.0 * math.pi * data["c"], turns=1.0, section=wire(), elements=24,
                         degree=4)
    start = 0.95 * beam.length
    t, s = glide(beam, start, (0, 0, -data["g"]), 2.0, step)
    return float(np.max(np.abs(s - start + 0.5 * data["tangential_acceleration"] * t**2))) / beam.length


def pivoted_rod(rows: list[dict[str, float]], step: float) -> float:
    """Free rod of inertia 1 turning about its pinned end with a bead that it throws outwards; largest error in r, m."""
    length = 6.0
    beam = fb.Beam.straight("rod", (0, 0, 0), (length, 0, 0), section=wire(rhoA=3.0 / length**3, rhoI2=1e-9, rhoI3=1e-9),
                            elements=12, degree=2)
    bead = fb.PointMass("bead", mass=1.0)
    model = fb.compile_scene(fb.Scene(beam, bead, fb.Pin(beam.start), fb.RigidMotion(beam, spin=(0, 0, 2)),
                                      fb.Slider("contact", bead, beam, at=0.1, rate=0.0)))
    worst = 0.0
    for row in rows:
        # a whole number of steps to the tabulated time
        h = row["t"] / math.ceil(row["t"] / step)
        result = fb.simulate(model, t_end=row["t"], step=h, order=4, **QUIET)
        worst = max(worst, abs(float(result.state.s[0]) - row["r"]))
    return worst


def check_beads(quick: bool = False) -> list[Row]:
    """Straight, cycloidal and helical wires and a free rod."""
    rows = [Row("bead on a straight incline: s / L", incline(), at_most=1e-7),
            Row("bead on a cycloid (tautochrone), one period: s / L", tautochrone(0.004 if quick else 0.002), at_most=1e-5),
            Row("bead on a vertical helix: s / L", helix(0.004 if quick else 0.002), at_most=1e-5)]
    data = reference("sliding_exact")["pivoted_rod"]
    thrown = pivoted_rod(data[:3], 0.02) if quick else pivoted_rod(data, 0.005)
    return [*rows, Row("bead thrown outwards on a free rod: r (m)", thrown, at_most=1e-6)]
