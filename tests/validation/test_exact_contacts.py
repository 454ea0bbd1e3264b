"""Equilibria with exact contacts: driving forces and places of rest do not depend on where in an element a contact is, and meet
solutions of elastica, rods that shear and stretch, and a cable through a ring."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from perf.validation.rows import reference

Array = np.ndarray
EXACT = reference("sliding_exact")


def rod_section(EA: float, GA: float | None = None) -> fb.Section:
    return fb.Section(EA=EA, GA2=GA or EA, GA3=GA or EA, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


SLENDER = rod_section(1e4)


def in_sleeves(starts: Array, length: float, places: tuple[float, ...], section: fb.Section, elements: Any, *more: Any,
               tilt: float = 0.0, angles: tuple[float, ...] = (), tips: tuple[float, float] = (0.0, 0.0), tail: float = 0.0,
               planar: bool = True) -> tuple[fb.Beam, fb.Model]:
    """A rod through sleeves 0, 1, ... at `places` along it, its start at `starts`; weights at its tips, a pull at its start."""
    along = np.array((np.cos(tilt), np.sin(tilt), 0.0))
    rod = fb.Beam.straight("rod", starts, starts + length * along, section=section, elements=elements)
    scene = fb.Scene(rod, fb.Load("left", rod.start, force=(-tail, -tips[0], 0)),
                     fb.Load("right", rod.end, force=(0, -tips[1], 0)))
    for k, place in enumerate(places):
        body = fb.RigidBody(f"holder {k}", mass=1.0, inertia=(1, 1, 1), position=starts + place * along)
        held = fb.Clamp(body)
        if angles:
            held = fb.PrescribedMotion(f"turn {k}", body, rotation=lambda t, a=angles[k]: (0, 0, a * t * t))
        scene.add(body, held, fb.Sleeve(f"sleeve {k}", body, rod, at=place))
    return rod, fb.compile_scene(scene.add(*more), planar=planar)


# --- driving forces -----------------------------------------------------------------------------------------------------
def test_the_driving_force_of_a_sleeve_is_the_same_anywhere_in_an_element() -> None:
    """10 cubic elements, 20 places inside one: M^2/(2 EI) + Q^2/(2 GA), M the load times its arm."""
    load, worst = 0.1, 0.0
    for place in 1.0 + 0.2 * (np.arange(20) + 0.5) / 20:
        rod, model = in_sleeves(np.array((-place, 0.0, 0.0)), 2.0, (place,), SLENDER, 10, tips=(0.0, load))
        found = fb.solve_static(model, held=True, contacts="exact", load_step=1.0, points={"tip": rod.end})
        moment = load * found.point("tip")[-1, 0]
        exact = 0.5 * moment**2 + 0.5 * load**2 / 1e4
        worst = max(worst, abs(found.info["force_along"]["sleeve 0"] / exact - 1.0))
    print(f"driving force at 20 places: within {worst:.1e}")
    assert worst < 1e-6


def quick(table: str, *rows: int) -> list[Any]:
    """All rows of a table of exact numbers; those that are not named run with the slow tests."""
    return [row if k in rows else pytest.param(row, marks=pytest.mark.slow) for k, row in enumerate(EXACT[table])]


# rods that do not stretch: the limit of EA = GA = 1e6, 2e6
def limit(values: list[Array]) -> Array:
    return 2.0 * values[1] - values[0]


def pulled(pull: float, length: float, EA: float, GA: float) -> Array:
    """Force along at this free length, moment in the sleeve, place of the tip from the exit."""
    rod, model = in_sleeves(np.array((length - 2.5, 0.0, 0.0)), 2.5, (2.5 - length,), rod_section(EA, GA), 40, tips=(0.0, 1.0),
                            tail=pull)
    found = fb.solve_static(model, held=True, contacts="exact", points={"tip": rod.end})
    return np.array((found.info["force_along"]["sleeve 0"], abs(found.slider("sleeve 0")["moment"][-1, 2]),
                     *found.point("tip")[-1, :2]))


@pytest.mark.parametrize("row", quick("tail_pull", 4), ids=lambda row: f"{row['pull']:g}")
def test_a_pull_on_the_tail_holds_an_elastica_in_a_sleeve(row: dict[str, Any]) -> None:
    """Unit weight at the tip: it rests, unstably, where this length is outside."""
    off = limit([pulled(row["pull"], row["length"], EA, EA) for EA in (1e6, 2e6)]) - (0.0, row["moment"], *row["tip"])
    print(f"pull {row['pull']:g}: force along {off[0]:.1e} N, moment {off[1]:.1e} N m, tip {np.abs(off[2:]).max():.1e} m")
    assert np.all(np.abs(off) < 1e-9)


@pytest.mark.parametrize("row", quick("rod_tail_pull", 1, 3), ids=lambda row: f"EA {row['EA']}")
def test_a_pull_on_the_tail_holds_a_bent_rod_in_a_sleeve(row: dict[str, Any]) -> None:
    """The same of rods that stretch and shear; the pull grows by 0.684 per length there."""
    cases = [(row["EA"], row["GA"])] if row["EA"] else [(1e6, 1e6), (2e6, 2e6)]
    found = [pulled(row["pull"], row["length"], *case) for case in cases]
    off = (limit(found) if len(found) > 1 else found[0]) - (0.0, row["moment"], *row["tip"])
    print(f"EA = {row['EA']}: length off by {abs(off[0]) / 0.684 / row['length']:.1e}, moment {off[1] / row['moment']:.1e}, tip "
          f"{np.abs(off[2:]).max():.1e} m")
    assert abs(off[0]) / 0.684 / row["length"] < 1e-9 and abs(off[1]) < 1e-9 * row["moment"] and np.all(np.abs(off[2:]) < 1e-9)


@pytest.mark.parametrize("row", quick("arm_scale", 0), ids=lambda row: f"{row['tilt']} {row['weights'][0]:g}")
def test_an_arm_scale_is_in_balance_where_the_elastica_says(row: dict[str, Any]) -> None:
    found, tilt, left = [], np.radians(row["tilt"]), row["left"]
    for EA in (1e6, 2e6):
        start = -left * np.array((np.cos(tilt), np.sin(tilt), 0.0))
        rod, model = in_sleeves(start, left + row["right"] + 0.5, (left, left + 0.5), rod_section(EA), 40, tilt=tilt,
                                tips=row["weights"])
        result = fb.solve_static(model, held="sleeve 0", contacts="exact", points={"left": rod.start, "right": rod.end})
        exit_right = 0.5 * np.array((np.cos(tilt), np.sin(tilt)))
        found.append(np.array((result.info["force_along"]["sleeve 0"], result.slider("sleeve 0")["moment"][-1, 2],
                               result.slider("sleeve 1")["moment"][-1, 2], *result.point("left")[-1, :2],
                               *(result.point("right")[-1, :2] - exit_right))))
    off = limit(found) - (0.0, *row["moments"], *np.ravel(row["tips"]))
    print(f"tilt {row['tilt']}: out of balance by {off[0]:.1e} N, moments off by {off[1]:.1e}, {off[2]:.1e} N m, tips by "
          f"{np.abs(off[3:]).max():.1e} m")
    assert abs(off[0]) < 1e-8 and np.all(np.abs(off[1:]) < 1e-9)


@pytest.mark.parametrize("row", quick("two_sleeves", 0), ids=lambda row: f"{row['angle']}")
def test_two_sleeves_hold_a_piece_of_the_elastica(row: dict[str, Any]) -> None:
    """Axes at +a and -a to the chord of length 1, one sleeve free to slide; 40 elements, of which two meet in the middle."""
    found, a, middle = [], np.radians(row["angle"]), 0.33 + 0.5 * row["length"]
    mesh = [*np.linspace(0.0, middle, 21)[:-1], *np.linspace(middle, 1.8, 21)]
    for EA in (1e6, 2e6):
        rod, model = in_sleeves(np.array((-0.33, 0.0, 0.0)), 1.8, (0.33, 1.33), rod_section(EA), mesh, angles=(a, -a))
        result = fb.solve_static(model, held="sleeve 0", at_time=1.0, contacts="exact", points={"middle": rod.node(60)},
                                 load_step=1.0 if row["angle"] < 45 else 0.5)
        assert result.info["unstable_directions"] == 0 and result.info["free_directions"] == 0
        s, one = result.state.s, result.slider("sleeve 0")
        found.append(np.array((s[1] - s[0], abs(one["force"][-1, 0]), abs(one["moment"][-1, 2]), result.point("middle")[-1, 1])))
    off = limit(found) / (row["length"], row["force"], row["moment"], row["height"]) - 1.0
    print(f"{row['angle']} degrees: length {off[0]:.1e}, force {off[1]:.1e}, moment {off[2]:.1e}, height {off[3]:.1e}")
    assert np.all(np.abs(off) < 1e-9)


@pytest.mark.parametrize("distance", [0.4, 0.2, 0.1])
def test_two_rings_drive_a_rod_as_the_weights_at_its_ends_say(distance: float) -> None:
    """Rings as a sleeve on elements of 0.25 m, a weight at the tip and a pull on the tail: in sum they drive the rod by what
    N + N^2/(2 EA) + Q^2/(2 GA) is at the tip less what it is at the other end, where no moment acts."""
    EA, GA, forces = 1e3, 5e2, {"tip": np.array((0.0, -1.0, 0.0)), "tail": np.array((-0.3, 0.0, 0.0))}
    rod = fb.Beam.straight("rod", (-1.37, 0, 0), (1.13, 0, 0), section=rod_section(EA, GA), elements=10)
    rings = [fb.PointMass(f"ring {k}", mass=1.0, position=(-distance * k, 0, 0)) for k in range(2)]
    scene = fb.Scene(rod, *rings, *map(fb.Pin, rings), fb.Load("tip", rod.end, force=forces["tip"]),
                     fb.Load("tail", rod.start, force=forces["tail"]),
                     *(fb.Slider(f"on {k}", ring, rod, at=1.37 - distance * k) for k, ring in enumerate(rings)))
    model = fb.compile_scene(scene, planar=True)
    found = fb.solve_static(model, held=True, contacts="exact")
    along = {}
    for name, node, sign in (("tip", rod.end, 1.0), ("tail", rod.start, -1.0)):
        # of the section, which shears against the curve
        axes = found.directors[-1, model.numbers.number(node)]
        normal, shear = sign * forces[name] @ axes[0], sign * forces[name] @ axes[1]
        along[name] = normal + normal**2 / (2.0 * EA) + shear**2 / (2.0 * GA)
    off = sum(found.info["force_along"].values()) / (along["tip"] - along["tail"]) - 1.0
    print(f"rings {distance} m from each other: off by {off:.1e}")
    assert abs(off) < 2e-6


# --- places of rest -----------------------------------------------------------------------------------------------------
def arc_model(first: float, at: float = 2.3, other: float = 0.0, **slider: Any) -> fb.Model:
    """A heavy bead on a soft arc of 6.4 m whose first element is longer or shorter than the others; its lowest point is at
    3.2 m."""
    length = 6.4
    sin, cos = np.sin(0.8), np.cos(0.8)
    wire = fb.Beam.arc("wire", (-4 * sin, 0, -4 * cos), (cos, 0, -sin), (sin, 0, cos), radius=4.0, angle=1.6, degree=3,
                       elements=[0.0, *np.linspace(first * length / 16, length, 16)],
                       section=fb.Section(EA=1e4, GA2=5e3, GA3=5e3, GJ=20, EI2=20, EI3=20, rhoA=1, rhoI2=1e-3, rhoI3=1e-3))
    bead = fb.PointMass("bead", mass=2.0)
    scene = fb.Scene(wire, bead, fb.Clamp(wire.start), fb.Clamp(wire.end), fb.Slider("run", bead, wire, at=at, **slider),
                     gravity=(0, 0, -9.81))
    if other:
        second = fb.PointMass("second", mass=2.0)
        scene.add(second, fb.Slider("two", second, wire, at=other))
    return fb.compile_scene(scene)


def bead_on_arc(first: float, contacts: str, **slider: Any) -> fb.Result:
    return fb.solve_static(arc_model(first, **slider), contacts=contacts, load_step=0.5)


def test_a_bead_rests_at_the_lowest_point_of_a_soft_arc_on_any_mesh() -> None:
    off = {contacts: [abs(bead_on_arc(first, contacts).state.s[0] - 3.2) for first in (0.37, 0.6, 0.85)]
           for contacts in ("mesh", "exact")}
    print("off the lowest point by", {kind: [f"{x:.1e}" for x in of] for kind, of in off.items()})
    assert min(off["mesh"]) > 1e-3 and max(off["exact"]) < 2e-6


def pushed_bead(joint: float | None) -> fb.Result:
    """A heavy bead with a push to the side on an arc of 2.4 m, in one piece or as a path of two that meet at s = joint."""
    section = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=2, EI2=20, EI3=20, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5)
    ends = np.array([0.0, 2.4] if joint is None else [0.0, joint, 2.4])
    angle = ends / 3.0 - 0.4
    pieces = [fb.Beam.arc(f"piece {k}", (3 * np.sin(a), 0, -3 * np.cos(a)), (np.cos(a), 0, np.sin(a)), (-np.sin(a), 0, np.cos(a)),
                          radius=3.0, angle=b - a, section=section, elements=6 // (ends.size - 1))
              for k, (a, b) in enumerate(zip(angle, angle[1:]))]
    bead = fb.PointMass("bead", mass=2.0)
    scene = fb.Scene(*pieces, bead, fb.Clamp(pieces[0].start), fb.Clamp(pieces[-1].end),
                     *(fb.RigidConnection(a.end, b.start) for a, b in zip(pieces, pieces[1:])),
                     fb.Slider("run", bead, on=fb.Path("way", pieces) if joint else pieces[0], at=0.9),
                     fb.Load("push", bead, force=(1.5, 0, 0)), gravity=(0, 0, -9.81))
    return fb.solve_static(fb.compile_scene(scene), contacts="exact", load_step=1.0)


def test_a_bead_rests_beside_a_joint_of_its_path_as_on_a_beam_in_one_piece() -> None:
    """At the end of one beam, or at the start of the next, nearer than steps of differences in the elements there."""
    whole = pushed_bead(None)
    off = []
    for gap in (1e-3, 3e-4, -3e-4):
        found = pushed_bead(float(whole.state.s[0]) + gap)
        off.append((abs(found.state.s[0] - whole.state.s[0]), abs(found.series["potential"][-1] - whole.series["potential"][-1])))
    print("off by", off)
    assert np.max(off) < 2e-6


def test_a_cable_slides_through_a_ring_to_its_exact_place() -> None:
    """10.4 m of cable between pins 10 m apart under 1 N/m, through a ring 4 m from the first: place, force and energy by
    shooting, 14 digits; sixth order in the mesh."""
    exact = 4.01464735216394, np.array((-1.8223662565596, -7.3986151581613)), 2.97164044176569
    section = fb.Section(EA=1e4, GA2=5e3, GA3=5e3, GJ=20.0, EI2=20.0, EI3=20.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    errors = []
    for elements in (16, 32):
        beam = fb.Beam.straight("beam", (0, 0, 0), (10.4, 0, 0), section=section, elements=elements)
        ring = fb.PointMass("ring", mass=1.0)
        end = fb.PrescribedMotion("in", beam.end, displacement=lambda t: (-0.4 * t * t, 0, 0))
        model = fb.compile_scene(fb.Scene(beam, ring, fb.Pin(beam.start), end, fb.Pin(ring.center),
                                          fb.Slider("run", ring, beam, at=4.0), gravity=(0, -1, 0)), planar=True)
        still = fb.solve_static(model, at_time=1.0, held=True, load_step=0.1, largest_load_step=0.1)
        found = fb.solve_static(model, start=still.state, at_time=1.0, contacts="exact", raise_loads=False, load_step=1.0)
        run = found.slider("run")
        errors.append((abs(run["s"][-1] - exact[0]), np.linalg.norm(run["force"][-1, :2] - exact[1]),
                       abs(found.series["strain"][-1] - exact[2])))
        assert found.info["unstable_directions"] == 0
        print(f"{elements} elements: s {errors[-1][0]:.1e} m, force {errors[-1][1]:.1e} N, energy {errors[-1][2]:.1e} J")
    assert np.all(np.array(errors[1]) < (1e-9, 1e-7, 1e-7))
    assert np.all(np.array(errors[0])[1:] > 20.0 * np.array(errors[1])[1:])


def test_beads_that_meet_are_refused_and_one_that_is_held_is_passed_by_none() -> None:
    """Two that are free would rest at the same place; beside one that is held the other rests on its side."""
    with pytest.raises(fb.ConvergenceError, match="slider '.*' is at the same place as slider '.*', at s = 3.2 m, where"):
        fb.solve_static(arc_model(1.0, other=4.4), contacts="exact", load_step=0.5)
    found = [fb.solve_static(arc_model(first, other=4.4), contacts="exact", load_step=0.5, held="two") for first in (0.6, 1.0)]
    assert found[0].state.s[0] == pytest.approx(found[1].state.s[0], abs=1e-5) and found[0].state.s[0] > 3.2


@pytest.mark.slow
def test_a_sleeve_slides_to_the_same_place_of_a_curved_beam_in_space_on_any_mesh() -> None:
    """A heavy holder with a load to the side, whose sleeve lets it slide, on an arc that bends and twists."""
    section = fb.Section(EA=2e3, GA2=1e3, GA3=1.2e3, GJ=80.0, EI2=100.0, EI3=120.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)

    def place(elements: int, contacts: str) -> float:
        arc = fb.Beam.arc("arc", (-2, 0, 0), (0.6, 0, -0.8), (0.8, 0, 0.6), radius=2.5, angle=1.6, section=section,
                          elements=elements)
        body = fb.RigidBody("holder", mass=5, inertia=(1, 1, 1), position=arc.reference(1.55)[0][0])
        scene = fb.Scene(arc, body, fb.Clamp(arc.start), fb.Clamp(arc.end), fb.Sleeve("run", body, arc, at=1.55),
                         fb.Load("side", body, force=(0, 8, 0)), gravity=(0, 0, -9.81))
        found = fb.solve_static(fb.compile_scene(scene), contacts=contacts)
        assert found.info["unstable_directions"] == 0
        return float(found.state.s[0])

    exact = place(16, "exact")
    off = {contacts: [abs(place(n, contacts) - exact) for n in (4, 8)] for contacts in ("mesh", "exact")}
    print(f"off by {off}")
    assert min(off["mesh"]) > 1e-3 and off["exact"][0] < 5e-6 and off["exact"][1] < 3e-7


# --- what else has to fit -----------------------------------------------------------------------------------------------
def test_the_force_along_is_the_derivative_of_the_energy() -> None:
    """Also with weight and loads along the beam and two contacts in one element, of which one is free."""
    def held(at: float) -> fb.Result:
        rod = fb.Beam.straight("rod", (-at, 0, 0), (2.0 - at, 0, 0), section=SLENDER, elements=4)
        bodies = [fb.RigidBody(f"b{k}", mass=1, inertia=(1, 1, 1), position=(x, 0, 0)) for k, x in enumerate((0.0, 0.2))]
        scene = fb.Scene(rod, *bodies, *(fb.Clamp(body) for body in bodies), fb.Sleeve("a", bodies[0], rod, at=at),
                         fb.Sleeve("b", bodies[1], rod, at=at + 0.2),
                         fb.DistributedLoad("wind", rod, force=lambda s: np.stack((0.3 * s, -1.0 - s, 0 * s), axis=1)),
                         fb.Load("end", rod.node(5), force=(0.2, 0.1, 0)), gravity=(0.3, -0.5, 0))
        return fb.solve_static(fb.compile_scene(scene, planar=True), contacts="exact", held="a", load_step=1.0)

    here, step = held(0.53), 1e-4
    slope = (held(0.53 + step).series["potential"][-1] - held(0.53 - step).series["potential"][-1]) / (2.0 * step)
    assert here.info["force_along"]["a"] == pytest.approx(slope, rel=1e-6)
    assert abs(here.info["force_along"]["b"]) < 1e-9


def test_rows_are_exact_and_the_state_starts_a_run() -> None:
    """Rows have the exact equilibrium; the state is that of the given mesh with the slider held at the same place: its gap is
    closed, and a run with a locked slider stays where it is."""
    found = bead_on_arc(0.6, "exact")
    run = found.slider("run")
    assert found.info["unstable_directions"] == 0 and run["s"][-1] == found.state.s[0]
    assert np.allclose(run["force"][-1], (0, 0, 2.0 * 9.81), atol=1e-9) and run["gap"][-1] < 1e-12
    again = fb.solve_static(arc_model(0.6), start=found.state, held=True, load_step=1.0)
    assert again.info["iterations"] <= 2 and np.abs(again.state.q - found.state.q).max() < 1e-12


@pytest.mark.slow
def test_a_run_starts_from_an_exact_equilibrium() -> None:
    """A locked slider rests there, a free one follows the mesh, whose place of rest is elsewhere; energy stays."""
    found = bead_on_arc(0.6, "exact")
    at = float(found.state.s[0])
    for lock in (fb.Lock(until=9.0), None):
        result = fb.simulate(arc_model(0.6, at=at, lock=lock), t_end=0.2, step=0.01, every=1, progress=False,
                             start=bead_on_arc(0.6, "exact", at=at, lock=lock).state)
        assert np.ptp(result.series["total"]) < 1e-11
        assert result.series["kinetic"].max() < (1e-16 if lock else 1e-4)
        assert np.max(np.abs(result.slider("run")["s"] - at)) < 3e-3


@pytest.mark.slow
def test_in_space_on_paths_and_on_curved_beams_the_force_along_is_the_derivative_of_the_energy() -> None:
    section = fb.Section(EA=2e3, GA2=1e3, GA3=1.2e3, GJ=80.0, EI2=100.0, EI3=120.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)

    def held(shift: float) -> fb.Result:
        left = fb.Beam.helix("left", radius=1.0, pitch=0.8, turns=0.5, section=section, elements=4)
        end = left.reference(left.length)[0][0]
        right = fb.Beam.straight("right", end + (2.0, -1.0, 0.5), end, section=section, elements=3)
        way = fb.Path("way", [left, (right, -1)])
        at = left.length + 0.9
        ring = fb.PointMass("ring", mass=3.0)
        eye = fb.RigidBody("eye", mass=1, inertia=(1, 1, 1), position=left.reference(1.1)[0][0])
        scene = fb.Scene(left, right, ring, eye, fb.Clamp(left.start), fb.RigidConnection(left.end, right.end),
                         fb.Pin(right.start), fb.Load("push", left.node(3), force=(1, 2, -5)),
                         fb.Slider("run", ring, on=way, at=at, drive=fb.Drive(position=lambda t: at + shift * t * t)),
                         fb.Sleeve("hold", eye, left, at=1.1, drive=fb.Drive(position=lambda t: 1.1 + 0.5 * shift * t * t)),
                         fb.Spring(eye, fb.GROUND.point((0, 0, -2)), stiffness=30.0),
                         gravity=(0.0, 1.0, -9.81))
        return fb.solve_static(fb.compile_scene(scene), contacts="exact", at_time=1.0)

    step = 1e-4
    here, ahead, back = held(0.05), held(0.05 + step), held(0.05 - step)
    slope = (ahead.series["potential"][-1] - back.series["potential"][-1]) / (2.0 * step)
    along = here.info["force_along"]
    assert along["run"] + 0.5 * along["hold"] == pytest.approx(slope, rel=1e-6)
