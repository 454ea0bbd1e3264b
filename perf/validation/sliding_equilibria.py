"""Equilibria with sliders against exact solutions: beams and ropes through rings, tendons through discs, a lever in two eyes."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

import fastbeam as fb

from .rows import Array, Row, orders, reference

BAR = 1e-6
GRAVITY = (0.0, -1.0, 0.0)
QUIET = {"output": fb.Output(snapshots=0), "progress": False}


def rod(EA: float, GA: float, EI: float, rhoA: float = 1.0) -> fb.Section:
    """Section of equal stiffness in both directions; its weight under unit gravity is `rhoA` per length."""
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=EI, EI2=EI, EI3=EI, rhoA=rhoA, rhoI2=1e-3, rhoI3=1e-3)


def point(xy: Any) -> Array:
    """Point (3,) of the plane z = 0 from x and y."""
    return np.array((*xy, 0.0), dtype=float)


# ---------------------------------------------------------------------------------------------- a beam or rope through a ring
def hung(case: dict[str, Any], section: fb.Section, elements: Any, at: float) -> fb.Model:
    """A straight beam of the length of a case, pinned at A, through a ring at `at`; with the time 0 to 1 its end goes to B, and a
    ring that is fixed to its place. Without a place it is free, with its weight."""
    length = case["reference_length" if "reference_length" in case else "unstretched_length"]
    start = point(case["A"])
    beam = fb.Beam.straight("beam", start, start + (length, 0, 0), section=section, elements=elements)
    ring = fb.PointMass("ring", mass=case.get("ring_weight", 1.0), position=start + (at, 0, 0))
    way = point(case["B"]) - start - (length, 0, 0)
    scene = fb.Scene(beam, ring, fb.Pin(beam.start), fb.Slider("run", ring, beam, at=at),
                     fb.PrescribedMotion("in", beam.end, displacement=lambda t: way * t * t), gravity=GRAVITY)
    if "ring" in case:
        to = point(case["ring"]) - start - (at, 0, 0)
        scene.add(fb.PrescribedMotion("to its place", ring, displacement=lambda t: to * t * t))
    return fb.compile_scene(scene, planar=True)


def at_rest(model: fb.Model, contacts: str) -> fb.Result:
    """The equilibrium: supports go to their places with the ring held on its beam, which then slides.

    Raises
    ------
    RuntimeError
        It is unstable, or not held: another one than that of the reference.
    """
    still = fb.solve_static(model, at_time=1.0, held=True, load_step=0.05, largest_load_step=0.1)
    found = fb.solve_static(model, start=still.state, at_time=1.0, contacts=contacts, raise_loads=False, load_step=1.0)
    if found.info["unstable_directions"] or found.info["free_directions"]:
        raise RuntimeError(f"{found.info['unstable_directions']} unstable, {found.info['free_directions']} free directions")
    return found


def through_ring(case: dict[str, Any], elements: int, contacts: str) -> Array:
    """Errors (3,) of a beam through a fixed ring: place of its length, force of its weight, strain energy relative."""
    found = at_rest(hung(case, rod(case["EA"], case["GA"], case["EI"], case["q"]), elements, 4.0), contacts)
    run, length = found.slider("run"), case["reference_length"]
    force = np.linalg.norm(run["force"][-1, :2] + case["ring_force_on_beam"])
    return np.array((abs(run["s"][-1] - case["l1"]) / length, force / (case["q"] * length),
                     abs(found.series["strain"][-1] / case["strain_energy"] - 1.0)))


def check_beam_through_ring(quick: bool = False) -> list[Row]:
    """Beams under their own weight through a ring that stands still, cubic elements. What a mesh makes of its contacts is shown
    beside; single orders depend on where in an element the ring is."""
    rows = []
    for case in reference("sliding_equilibria")["beam_through_ring"][2 if quick else 0:]:
        meshes = (16, 32) if quick else (16, 32, 64, 96)
        exact = np.array([through_ring(case, n, "exact") for n in meshes])
        # the finest meshes meet round-off
        order = orders(exact[[0, min(2, len(meshes) - 1)]], 2.0 ** min(2, len(meshes) - 1))[0]
        mesh = [] if quick else [through_ring(case, n, "mesh") for n in (meshes[0], meshes[-1])]
        for k, text in enumerate(("s / length", "force / weight", "strain energy, relative")):
            title = f"beam through a ring, {case['case']}, {meshes[-1]} elements: {text}"
            rows += [Row(title, float(exact[-1, k]), at_most=BAR),
                     Row(f"beam through a ring, {case['case']}, from 16 elements on: order of {text}", float(order[k]),
                         at_least=4.0)]
            if mesh:
                rows.append(Row(f"{title}, mesh contacts", float(mesh[1][k])))
                rows.append(Row(f"{title}, mesh contacts: order",
                                float(orders((mesh[0][k], mesh[1][k]), meshes[-1] / meshes[0])[0])))
    return rows


# ------------------------------------------------------------------------------------------------- ropes that do not bend
def graded(length: float, middle: float, first: float, growth: float, largest: float) -> Array:
    """Ends of elements [n + 1] that grow from `first` at both ends and at `middle`."""
    def piece(a: float, b: float) -> Array:
        ends, size = [0.0], first
        while ends[-1] < 0.5 * (b - a):
            ends.append(ends[-1] + size)
            size = min(growth * size, largest)
        half = np.array(ends) * 0.5 * (b - a) / ends[-1]
        return np.concatenate((a + half, (b - half[::-1])[1:]))

    return np.concatenate((piece(0.0, middle), piece(middle, length)[1:]))


def rope(case: dict[str, Any], EI: float, at: float, fine: bool) -> Array:
    """Errors (3,) of a rope of small bending stiffness that begins at `at`: s, m, and two coordinates of a ring that hangs, m, or
    of the force on one that is fixed, N. Elements resolve the length in which it bends, sqrt(EI / tension), and no more."""
    length, bends = case["unstretched_length"], math.sqrt(EI / case["tension_at_ring"])
    first, growth, largest = (0.25, 1.15, length / 40) if fine else (0.5, 1.3, length / 20)
    elements = graded(length, at + 0.1 * bends, first * bends, growth, largest)
    model = hung(case, rod(case["EA"], 1e6, EI, case["weight_per_unstretched_length"]), elements, at)
    run = at_rest(model, "exact").slider("run")
    off = (run["position"][-1, :2] - case["ring_position"] if "ring_position" in case
           else run["force"][-1, :2] - case["force_on_ring"])
    return np.array((run["s"][-1] - case["unstretched_length_A_to_ring"], *off))


def extrapolated(values: Array, ratio: float, step: float) -> Array:
    """Richardson's limit (3,) of values [n, 3]: of the errors the first falls by `ratio` from one to the next, the others by
    `ratio` times powers of `step`."""
    while len(values) > 1:
        values = (ratio * values[1:] - values[:-1]) / (ratio - 1.0)
        ratio *= step
    return values[0]


def check_ropes(quick: bool = False) -> list[Row]:
    """Ropes without bending stiffness through a ring: the limit of EI = 1e-2 4^-k, whose errors are powers of sqrt(EI)."""
    rows = []
    for name, case in reference("sliding_equilibria")["ropes"].items():
        if quick and "lower" not in name:
            continue
        at, errors = round(case["unstretched_length_A_to_ring"], 1), []
        for k in range(4 if quick else 5):
            errors.append(rope(case, 1e-2 * 4.0**-k, at, not quick))
            # next the ring begins where it came to rest: within the length in which the rope bends
            at = case["unstretched_length_A_to_ring"] + errors[-1][0]
        length, weight = case["unstretched_length"], case["weight_per_unstretched_length"] * case["unstretched_length"]
        hangs = "ring_position" in case
        size = np.array((length, length if hangs else weight))
        limit = np.abs(extrapolated(np.array(errors), 2.0, 2.0))
        off = np.array([(abs(x[0]), np.linalg.norm(x[1:])) for x in (*errors, limit)]) / size
        for k, text in enumerate(("s / length", "place of the ring / length" if hangs else "force / weight")):
            rows += [Row(f"rope, {name}, limit of EI to 0: {text}", float(off[-1, k]), at_most=BAR),
                     Row(f"rope, {name}, EI = {1e-2 * 4.0 ** (1 - len(errors)):.1e}: {text}", float(off[-2, k])),
                     Row(f"rope, {name}: order of it in sqrt(EI)", float(orders(off[-3:-1, k])[0]), at_least=0.95, at_most=1.05)]
    return rows


# ----------------------------------------------------------------------------------------------- a tendon beside a spine
PULL, OFFSET = 0.05, 0.4


def bent_by_tendon(discs: int) -> float:
    """Angle at the end, rad, of a spine of EI = 1 and length 1 with discs, through whose eyes a tendon runs."""
    spine = fb.Beam.straight("spine", (0, 0, 0), (1, 0, 0), section=rod(1e5, 1e5, 1.0), elements=2 * discs)
    ends = np.concatenate(((0.0, 0.25), np.linspace(0.5, 1.5, 2 * discs + 1)))
    tendon = fb.Beam.straight("tendon", (-0.5, OFFSET, 0), (1, OFFSET, 0), section=rod(1e5, 1e5, 1e-8, 0.01), elements=ends)
    eye = fb.PointMass("eye", mass=1.0, position=(0, OFFSET, 0))
    scene = fb.Scene(spine, tendon, eye, fb.Clamp(spine.start), fb.Pin(eye.center), fb.Slider("s0", eye, tendon, at=0.5),
                     fb.Load("pull", tendon.start, force=(-PULL, 0, 0)))
    for k in range(1, discs + 1):
        x = k / discs
        disc = fb.RigidBody(f"disc {k}", mass=1e-3, inertia=(1e-6, 1e-6, 1e-6), position=(x, 0, 0))
        scene.add(disc, fb.RigidConnection(spine.node(int(np.argmin(np.abs(spine.node_s - x)))), disc))
        at = disc.point((0, OFFSET, 0))
        scene.add(fb.Slider(f"s{k}", at, tendon, at=0.5 + x) if k < discs else fb.BallJoint(at, tendon.end))
    found = fb.solve_static(fb.compile_scene(scene, planar=True), contacts="exact", load_step=1.0)
    d1 = found.directors[-1][spine.n_nodes - 1][0]
    return math.atan2(d1[1], d1[0])


def check_tendons(quick: bool = False) -> list[Row]:
    """A tendon parallel to a spine bends it into a circle of curvature T d/EI: the limit of many discs, between which it is
    straight. Errors go with the square of their distance."""
    counts = (4, 8) if quick else (4, 8, 16, 32)
    errors = np.array([bent_by_tendon(n) / (PULL * OFFSET) - 1.0 for n in counts])
    limit = abs(float(extrapolated(errors, 4.0, 4.0)))
    return [Row(f"tendon, limit of {counts[0]} to {counts[-1]} discs: curvature, relative", limit,
                at_most=1e-5 if quick else BAR),
            Row(f"tendon, {counts[-1]} discs: curvature, relative", float(errors[-1])),
            Row("tendon: order of it in the distance of discs", float(orders(errors)[-1]), at_least=1.9, at_most=2.1)]


# ------------------------------------------------------------------------------------------------------- a lever in two eyes
def lever(at: float, elements: int, spring: float = 0.0) -> dict[str, float]:
    """A rod through two fixed eyes 0.4 m apart, weights of 1 and 1.5 N at its tips: what holds it at the first eye, N, and by how
    much it differs from the difference of H at its tips. With a spring from between the eyes it is free.

    H = n . r' + m . k - W is P sin(slope) + P^2/2EA at a tip (EA = GA), and jumps by a force along the rod alone.
    """
    EA, middle = 1e6, at + 0.2
    ends = np.concatenate((np.linspace(0.0, middle, elements // 2 + 1), np.linspace(middle, 2.9, elements // 2 + 1)[1:]))
    beam = fb.Beam.straight("rod", (-at, 0, 0), (2.9 - at, 0, 0), section=rod(EA, EA, 1.0, 1e-6), elements=ends)
    eyes = [fb.PointMass(f"eye {k}", mass=1.0, position=(0.4 * k, 0, 0)) for k in range(2)]
    weights = np.array(((0.0, -1.0, 0.0), (0.0, -1.5, 0.0)))
    scene = fb.Scene(beam, *eyes, *(fb.Pin(eye.center) for eye in eyes),
                     *(fb.Slider(f"s{k}", eye, beam, at=at + 0.4 * k) for k, eye in enumerate(eyes)),
                     fb.Load("left", beam.start, force=weights[0]), fb.Load("right", beam.end, force=weights[1]))
    node, anchor = beam.node(int(np.argmin(np.abs(beam.node_s - middle)))), np.array((-10.0, 0.0, 0.0))
    if spring:
        scene.add(fb.Spring(node, fb.GROUND.point(anchor), "back", stiffness=spring, length=10.2))
    found = fb.solve_static(fb.compile_scene(scene, planar=True), held=() if spring else "s0", contacts="exact",
                            points={"middle": node})

    def energy(n: Array) -> float:
        return float(n @ n) / (2.0 * EA)

    d1 = found.directors[-1][:, 0]
    left, right = -weights[0] @ d1[0] + energy(weights[0]), weights[1] @ d1[beam.n_nodes - 1] + energy(weights[1])
    along = found.info["force_along"]
    if not spring:
        return {"held by": abs(along["s0"]), "off": abs(abs(right - left) - abs(along["s0"]))}
    way = anchor - found.point("middle")[-1]
    force = spring * (1.0 - 10.2 / np.linalg.norm(way)) * way
    before = found.slider("s0")["force"][-1] - weights[0]
    jump = -force @ d1[node.index] + energy(before - force) - energy(before)
    return {"held by": abs(jump), "off": abs(right - left - jump)}


def check_lever(quick: bool = False) -> list[Row]:
    """The lever of an arm scale in two eyes instead of a sleeve: what holds it is the difference of P sin(slope) of both tips."""
    elements, rows = 24, []
    for at in (1.4,) if quick else (1.0, 1.4, 1.7):
        found = lever(at, elements)
        title = f"lever held with {at} m on the left"
        rows += [Row(f"{title}, {elements} elements: P sin(slope) right - left - force that holds (N)", found["off"],
                     at_most=BAR),
                 Row(f"{title}: force that holds (N)", found["held by"])]
    found = lever(1.4, elements, spring=5.0)
    title = "lever free on a spring"
    return [*rows, Row(f"{title}, {elements} elements: P sin(slope) right - left - force of the spring (N)", found["off"],
                       at_most=BAR),
            Row(f"{title}: force of the spring along it (N)", found["held by"], at_least=0.1)]


# -------------------------------------------------------------------------------------------- the same places by motion
def hanging(at: float) -> fb.Model:
    """A ring of 20 kg on a soft rope of 0.05 kg/m between supports of different height."""
    section = fb.Section(EA=2e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=0.05, rhoI2=1e-4, rhoI3=1e-4)
    line = fb.Beam.through_points("rope", [(0, 0, 0), (2, -1.8, 0), (4.5, -2.6, 0), (7.5, -1.6, 0), (10, 1, 0)], section=section,
                                  elements=24)
    ring = fb.PointMass("ring", mass=20.0)
    return fb.compile_scene(fb.Scene(line, ring, fb.Pin(line.start), fb.Pin(line.end), fb.Slider("run", ring, line, at=at),
                                     gravity=(0, -9.81, 0)), planar=True)


def check_ring_at_rest(quick: bool = False) -> list[Row]:
    """Where a heavy ring rests by statics it comes to rest by damped motion from 5 cm beside, and stays, and swings about, by
    conserved motion. Of a swing by a the mean is off by a^2 (potentials that are not symmetric): a = 0.5 mm."""
    model = hanging(4.0)
    rest = fb.solve_static(model)
    at, length = float(rest.state.s[0]), model.slider_lengths[0]
    beside = hanging(at - 0.05)
    still = fb.solve_static(beside, held=True).state
    text = "ring on a rope, "
    slow = fb.relax(beside, start=still, finish=False)
    rows = [Row(text + "damped motion from 5 cm beside until swings are 1e-7 of the scene: s / length",
                abs(float(slow.state.s[0]) - at) / length, at_most=BAR),
            Row(text + "the same, finished by Newton's method: s / length",
                abs(float(fb.relax(beside, start=still).state.s[0]) - at) / length, at_most=1e-12)]
    run = fb.simulate(model, t_end=2.0 if quick else 10.0, step=0.02, start=rest.state, **QUIET)
    rows.append(Row(text + "conserving run from rest: range of s / length", float(np.ptp(run.slider("run")["s"])) / length,
                    at_most=1e-12))
    if quick:
        return rows
    near = hanging(at - 5e-4)
    run = fb.simulate(near, t_end=30.0, step=0.02, start=fb.solve_static(near, held=True).state, **QUIET)
    # a window of all the run that takes the first and the last swing out
    weight = np.sin(math.pi * run.t / run.t[-1]) ** 4
    off = float(np.average(run.slider("run")["s"], weights=weight)) - at
    return [*rows, Row(text + "mean of 30 s of a conserving run: s / length", abs(off) / length, at_most=BAR),
            Row(text + "the same, amplitude / length", float(np.ptp(run.slider("run")["s"])) / 2 / length)]
