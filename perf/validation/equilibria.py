"""Statics against closed forms and high-precision shooting, method.md 3 and 8."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Array, Row, orders, reference

DIGITS = 5e-11  # ten digits
# section of rods for pure moments: EI = 2 in both directions, GJ different so that twist shows
EI, GJ = 2.0, 1.3


def plain(EA: float, GA: float, GJ: float, EI: float) -> fb.Section:
    """Section of equal stiffness in both directions; its mass plays no part in statics."""
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=GJ, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=1.0, rhoI3=1.0)


def rest(beam: fb.Beam, *loads: fb.Load) -> fb.Result:
    """Equilibrium of a beam clamped at its start; the observed point 'tip' is its end."""
    return fb.solve_static(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), *loads)), points={"tip": beam.end})


def triad(result: fb.Result, node: int = -1) -> Array:
    """Triad (3, 3) of a node, rows d1, d2, d3."""
    return result.directors[-1][node]


def cantilever(case: dict[str, Any], elements: int = 6, degree: int = 6) -> dict[str, float]:
    """Relative errors of one case of tests/reference/cantilever.json: tip (of L), angle (rad), energy."""
    length = case["L"]
    beam = fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=plain(case["EA"], case["GA"], case["EI"], case["EI"]),
                            elements=elements, degree=degree)
    result = rest(beam, fb.Load("tip", beam.end, force=(*case["force"], 0.0), moment=(0.0, 0.0, case["moment"])))
    d2 = triad(result)[1]
    tip = result.point("tip")[-1][:2]
    return {"tip": float(np.linalg.norm(tip - case["tip"])) / length,
            "angle": abs(math.atan2(-d2[0], d2[1]) - case["angle"]),
            "energy": abs(float(result.series["strain"][-1]) / case["energy"] - 1.0), "nodes": beam.n_nodes}


def check_cantilever(quick: bool = False) -> list[Row]:
    """Planar cantilevers of finite stiffness with dead end loads; 6 elements of degree 6."""
    cases = [c for c in reference("cantilever")["cases"] if not quick or "slenderness 10000" not in c["case"]]
    errors = [cantilever(case) for case in cases]
    text = {"tip": "position / L", "angle": "angle (rad)", "energy": "strain energy, relative"}
    rows = [Row(f"cantilever, {len(cases)} cases against exact Reissner values: {text[key]}", max(e[key] for e in errors),
                at_most=DIGITS)
            for key in text]
    return [*rows, Row("cantilever: nodes used", max(e["nodes"] for e in errors), at_most=40)]


def bend(section: fb.Section, force: float, elements: int, degree: int, **family: Any) -> Array:
    """Tip (3,) of the 45-degree bend of radius 100 under a force along z."""
    beam = fb.Beam.arc("bend", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=100.0, angle=math.pi / 4, section=section,
                       elements=elements, degree=degree, **family)
    return rest(beam, fb.Load("tip", beam.end, force=(0.0, 0.0, force))).point("tip")[-1]


def check_bend45(quick: bool = False) -> list[Row]:
    """45-degree bend under F = 600 (Bathe and Bolourchi 1979): size and order of the error at the tip."""
    data = reference("bend45")
    section = plain(data["EA"], data["GA"], data["GJ"], data["EI"])
    length = 25.0 * math.pi

    def error(elements: int, degree: int) -> float:
        return float(np.linalg.norm(bend(section, data["force"], elements, degree) - data["tip"])) / length

    rows = [Row("45-degree bend, lagrange 3, 8 elements (25 nodes): tip error / L", error(8, 3), at_most=2e-7)]
    # coarse enough to stay above round-off, fine enough to be asymptotic
    for degree, meshes in {1: (16, 32, 64), 2: (8, 16, 32), 3: (8, 16), 4: (8, 16)}.items():
        if quick:
            meshes = meshes[:2]
        observed = float(orders([error(n, degree) for n in meshes])[-1])
        rows.append(Row(f"45-degree bend, lagrange {degree}, {meshes[-2]} to {meshes[-1]} elements: order (exact: {2 * degree})",
                        observed, at_least=2 * degree - 0.1, at_most=2 * degree + 0.3))
    return rows


def roll(strain: str, elements: int, degree: int) -> dict[str, float]:
    """Roll a straight cantilever up to a full circle; errors against the closed form (lengths over L, rad, energy relative).

    `simo_reissner`: M = EI 2 pi/L gives the circle of circumference L. `green_lagrange`: with phi' = c d1 and the angle per
    length k the stored energy is EI (c k)^2/2 + EA (c^2 - 1)^2/8 per length, stationary for c^2 = 1 - 2 k^2 EI/EA, and
    M = EI c^2 k: the circle has circumference c L.
    """
    length, EA = 10.0, 1e3
    k = 2.0 * math.pi / length
    stretch = math.sqrt(1.0 - 2.0 * k**2 * EI / EA) if strain == "green_lagrange" else 1.0
    beam = fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=plain(EA, 5e2, GJ, EI), elements=elements, degree=degree,
                            strain=strain)
    result = rest(beam, fb.Load("tip", beam.end, moment=(0.0, 0.0, EI * stretch**2 * k)))
    angle = beam.node_s * k
    circle = stretch / k * np.stack((np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle), axis=1)
    # the angle turned through is the sum of the angles between neighbouring nodes, each less than pi
    d2 = result.directors[-1][:, 1]
    turned = float(np.sum(np.arctan2(d2[:-1, 0] * d2[1:, 1] - d2[:-1, 1] * d2[1:, 0], np.sum(d2[:-1] * d2[1:], axis=1))))
    energy = length * (0.5 * EI * (stretch * k) ** 2 + 0.125 * EA * (stretch**2 - 1.0) ** 2)
    return {"tip": float(np.linalg.norm(result.point("tip")[-1])) / length,
            "nodes": float(np.max(np.linalg.norm(result.phi[-1] - circle, axis=1))) / length,
            "angle": abs(turned - 2.0 * math.pi), "energy": abs(float(result.series["strain"][-1]) / energy - 1.0)}


def check_rollup(quick: bool = False) -> list[Row]:
    """Straight cantilever rolled up to a full circle by an end moment; with simo_reissner 2 pi EI / L and no axial strain."""
    bar = 1e-8 if quick else DIGITS
    text = {"tip": "tip from the clamp / L", "nodes": "nodes from the circle / L", "angle": "turned angle - 2 pi (rad)",
            "energy": "strain energy, relative"}
    return [Row(f"roll-up to a full circle, {strain}: {text[key]}", value, at_most=bar)
            for strain in ("simo_reissner", "green_lagrange")
            for key, value in roll(strain, 8 if quick else 10, 5 if quick else 6).items()]


def turn(axis: Array, angle: float) -> Array:
    """Rotation (3, 3) by an angle (rad) about a unit axis."""
    x, y, z = axis
    skew = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    return np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew


def helix(s: float, moment: Array) -> tuple[Array, Array]:
    """Closed form of the rod of `check_helix` at arc length s: position (3,) and triad (3, 3), rows d1, d2, d3.

    No force acts, so the moment in space is the applied vector M everywhere and phi' = d1. With EI2 = EI3 = EI the triad
    turns with w = (M.d1)/GJ d1 + (M.d2)/EI d2 + (M.d3)/EI d3 = M/EI + (1/GJ - 1/EI) (M.d1) d1 per length. The second part
    does not move d1, so d1' = (M/EI) x d1: d1 precesses about M with the rate |M|/EI, M.d1 keeps its value at the clamp, and
    the centreline is a helix about M. The triad is exp(s M/EI) exp(s (1/GJ - 1/EI) (M.e_x) e_x), the position the integral of
    exp(s M/EI) e_x.
    """
    size = float(np.linalg.norm(moment))
    axis, e_x = moment / size, np.array((1.0, 0.0, 0.0))
    rate = size / EI
    along = float(axis @ e_x)
    across, binormal = e_x - along * axis, np.cross(axis, e_x)
    position = along * s * axis + math.sin(rate * s) / rate * across + (1.0 - math.cos(rate * s)) / rate * binormal
    rotation = turn(axis, rate * s) @ turn(e_x, s * (1.0 / GJ - 1.0 / EI) * size * along)
    return position, rotation.T


def check_helix(quick: bool = False) -> list[Row]:
    """Straight isotropic rod under an oblique end moment, fixed in space: a helix about the moment, see `helix`."""
    length, moment = 10.0, np.array((0.9, 0.5, 1.1))
    beam = fb.Beam.straight("beam", (0, 0, 0), (length, 0, 0), section=plain(1e3, 5e2, GJ, EI), elements=10 if quick else 14,
                            degree=6 if quick else 8)
    result = rest(beam, fb.Load("tip", beam.end, moment=moment))
    exact = [helix(float(s), moment) for s in beam.node_s]
    bar = 1e-8 if quick else DIGITS
    positions, triads = (np.array([x[k] for x in exact]) for k in range(2))
    off = np.linalg.norm(result.phi[-1] - positions, axis=1) / length
    return [Row("helix by an end moment: tip / L", float(off[-1]), at_most=bar),
            Row("helix by an end moment: all nodes / L", float(np.max(off)), at_most=bar),
            Row("helix by an end moment: triads of all nodes", float(np.max(np.abs(result.directors[-1] - triads))), at_most=bar)]


def check_slenderness(quick: bool = False) -> list[Row]:
    """Error at a fixed mesh against slenderness: without locking it does not grow.

    Square sections under P L^2 = 10 EI, and the 45-degree bend.
    """
    cases = {int(c["case"].split()[3]): c for c in reference("cantilever")["cases"]
             if c["case"].startswith("square") and c["case"].endswith("alpha=10")}
    slender = [10, 1000] if quick else [10, 100, 1000, 10000, 100000]
    rows = []
    for degree, elements in {2: 16, 3: 10, 4: 8}.items():
        errors = [cantilever(cases[k], elements, degree)["tip"] for k in slender]
        rows += [Row(f"cantilever, lagrange {degree}, {elements} elements, slenderness {k}: tip error / L", e)
                 for k, e in zip(slender, errors)]
        rows.append(Row(f"cantilever, lagrange {degree}, slenderness 1e1 to {slender[-1]:.0e}: largest / smallest error",
                        max(errors) / min(errors), at_most=3.0))
    if quick:
        return rows
    for degree in (2, 3):
        errors = []
        for case in reference("bend45")["slenderness"]:
            w = 100.0 / case["slenderness"]
            section = plain(1e7 * w**2, 5e6 * w**2, 5e6 * w**4 / 6.0, 1e7 * w**4 / 12.0)
            errors.append(float(np.linalg.norm(bend(section, case["force"], 8, degree) - case["tip"])) / (25.0 * math.pi))
        rows.append(Row(f"45-degree bend, lagrange {degree}, 8 elements, slenderness 1e1 to 1e4: largest / smallest error",
                        max(errors) / min(errors), at_most=3.0))
    return rows
