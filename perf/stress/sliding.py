"""Corners of sliding contact, each with plain multipliers and with the augmented Lagrangian (theory.md 5.5).

A case is right where it agrees with an exact law, with the same run in small steps of order 4, or where it is refused with a cause
that names the slider. Invariants and gap have to be at round-off in every case that runs.
"""
from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import fastbeam as fb
from fastbeam.newton import AUGMENTATION
from small_scenes import straight
from table import Row

Array = np.ndarray
# soft enough that the steps below resolve all waves, so that errors shrink as they should
SOFT = fb.Section(EA=200.0, GA2=100.0, GA3=100.0, GJ=20.0, EI2=20.0, EI3=25.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
STIFF = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=1e9, EI2=1e9, EI3=1e9, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
H = 2e-3
DRIFT, GAP = 1e-10, 1e-13
Judge = Callable[["Case", "Ran"], tuple[bool, str]]


@dataclass(frozen=True)
class Ran:
    """What became of a run: its result as far as it came, and the message of the error that ended it."""

    result: fb.Result | None
    error: str


@dataclass(frozen=True)
class Case:
    """A scene, how it is run, and how the outcome is judged."""

    name: str
    expected: str
    scene: Callable[[], fb.Scene]
    judge: Judge
    t_end: float = 0.5
    step: float = H
    settings: dict[str, Any] = field(default_factory=dict)

    def run(self, augmentation: float, **changes: Any) -> Ran:
        """Compile and run."""
        try:
            options = {"t_end": self.t_end, "step": self.step, "every": 1, "snapshots": 0, "progress": False, **self.settings}
            return Ran(fb.simulate(fb.compile_scene(self.scene()), augmentation=augmentation, **{**options, **changes}), "")
        except fb.SceneError as error:
            return Ran(None, str(error))
        except fb.ConvergenceError as error:
            return Ran(error.result, str(error))


# ------------------------------------------------------------------------------------------------------------------- judges
def follows(law: Callable[[float], Any], bar: float) -> Judge:
    """Sliding coordinates follow an exact law, relative to the longest beam."""
    def judge(case: Case, ran: Ran) -> tuple[bool, str]:
        assert ran.result is not None
        exact = np.array([np.atleast_1d(law(float(t))) for t in ran.result.t])
        off = float(np.max(np.abs(ran.result.series["s_slide"] - exact)))
        return off <= bar, f"s off by {off:.1e} m"
    return judge


def distance(a: fb.Result, b: fb.Result) -> float:
    """Largest difference of positions and sliding coordinates at the end of two runs, m."""
    x, y = (run.state.q.reshape(-1, 4, 3)[:, 0] for run in (a, b))
    return max(float(np.max(np.abs(x - y))), float(np.max(np.abs(a.state.s - b.state.s))))


def refines(bar: float) -> Judge:
    """Converges to the run of order 4 with steps of a sixteenth: a quarter of the step, less than half of the error."""
    def judge(case: Case, ran: Ran) -> tuple[bool, str]:
        assert ran.result is not None
        quarter, fine = (case.run(AUGMENTATION, step=case.step / n, order=order, every=10**6) for n, order in ((4, 2), (16, 4)))
        if quarter.error or fine.error:
            return False, quarter.error or fine.error
        off, less = (distance(x, fine.result) for x in (ran.result, quarter.result))
        return off <= bar and (less <= 0.5 * off or off < 1e-10), f"off by {off:.1e}, with a quarter of the step {less:.1e} m"
    return judge


def ends(slider: str, end: str, time: float | None = None) -> Judge:
    """The run ends at the end of a beam, at a known time or at that of a run in small steps."""
    def judge(case: Case, ran: Ran) -> tuple[bool, str]:
        assert ran.result is not None
        exact, bar = time, 1e-8
        if exact is None:
            fine = case.run(AUGMENTATION, step=case.step / 16, order=4).result
            assert fine is not None
            exact, bar = float(fine.t[-1]), 1e-3 * case.t_end
        found = [e for e in ran.result.events if e["kind"] == "slider_end"]
        if not found:
            return False, "no event"
        e = found[0]
        return (e["slider"], e["end"]) == (slider, end) and abs(e["time"] - exact) <= bar, f"event: {e['end']} at {e['time']:.6g} s"
    return judge


def refused(pattern: str) -> Judge:
    """The run is refused or fails with a cause."""
    def judge(case: Case, ran: Ran) -> tuple[bool, str]:
        return re.search(pattern, ran.error) is not None, ran.error or "no error"
    return judge


# -------------------------------------------------------------------------------------------------------------------- parts
def on(rail: fb.Beam, at: float, rate: float | None = 0.0, *, name: str = "bead", mass: float = 0.5, curve: str = "c1") -> list[Any]:
    """A mass on a slider."""
    bead = fb.PointMass(name, mass=mass)
    return [bead, fb.Slider(f"run of {name}", bead, rail, at=at, rate=rate, curve=curve)]


def held(*parts: Any, rail: fb.Beam, **settings: Any) -> fb.Scene:
    """A rail that is clamped at its start."""
    return fb.Scene(rail, fb.Clamp(rail.start), *parts, **settings)


def rail(**changes: Any) -> fb.Beam:
    """3 m, 6 quadratic elements."""
    return straight("rail", (0, 0, 0), (3, 0, 0), **{"elements": 6, "section": SOFT, **changes})


def swinging(beam: fb.Beam) -> fb.InitialVelocity:
    """Lateral velocity of a clamped rail in one plane, so that its contact force passes zero as a vector."""
    return fb.InitialVelocity(beam, velocity=lambda s: np.stack((0 * s, 0 * s, 1.5 * (s / 3.0)**2), axis=1),
                              spin=lambda s: np.stack((0 * s, -s / 3.0, 0 * s), axis=1))


def simple(at: float, rate: float, *, curve: str = "c1", moving: bool = False, gravity: float = 0.0, **changes: Any) -> fb.Scene:
    """A mass on a clamped rail, straight at rest or swinging."""
    beam = rail(**changes)
    return held(*on(beam, at, rate, curve=curve), *([swinging(beam)] if moving else []), rail=beam, gravity=(0, 0, gravity))


def straight_line(at: float, rate: float) -> Judge:
    """Constant speed on a rail at rest."""
    return follows(lambda t: at + rate * t, 1e-13)


# -------------------------------------------------------------------------------------------------------------------- cases
def forces() -> Iterator[Case]:
    """Contact forces that vanish, sliders that nothing moves, extreme masses."""
    yield Case("contact force swings through zero", "small steps", lambda: simple(1.2, 0.3, moving=True), refines(2e-4))
    yield Case("at rest without load", "stays", lambda: simple(1.3, 0.0), straight_line(1.3, 0.0))
    yield Case("at rest without load, free beam", "stays", lambda: fb.Scene(beam := rail(), *on(beam, 1.3)), straight_line(1.3, 0.0))
    for mass in (1e-12, 1e-6, 1e9):
        yield Case(f"mass of {mass:g} kg", "small steps",
                   lambda m=mass: held(swinging(beam := rail()), *on(beam, 1.2, 0.3, mass=m), rail=beam), refines(2e-4))
    yield Case("mass of 1e-12 kg under gravity", "small steps", lambda: held(*on(beam := rail(), 1.2, 0.3, mass=1e-12), rail=beam,
                                                                           gravity=(0, 0, -9.81)), refines(2e-4))


def ends_of_elements() -> Iterator[Case]:
    """Element ends, the clamp and the free end; elements are 0.5 m long."""
    for curve in ("own", "c1"):
        for degree in (1, 2, 3):
            yield Case(f"starts on an element end, {curve}, degree {degree}", "constant speed",
                       lambda c=curve, d=degree: simple(1.0, 0.4, curve=c, degree=d), straight_line(1.0, 0.4))
        yield Case(f"meets element ends at the end of steps, {curve}", "constant speed",
                   lambda c=curve: simple(1.0 - 0.02, 0.4, curve=c), straight_line(0.98, 0.4))
        yield Case(f"rests on an element end of a swinging beam, {curve}", "small steps",
                   lambda c=curve: simple(1.0, 0.0, curve=c, moving=True), refines(2e-3))
        yield Case(f"crosses element ends of a swinging beam, {curve}", "small steps",
                   lambda c=curve: simple(1.0 - 0.02, 0.4, curve=c, moving=True), refines(2e-3))
    for at in (0.0, 0.1):
        yield Case(f"starts at s = {at:g} at the clamp and leaves", "constant speed", lambda a=at: simple(a, 0.4),
                   straight_line(at, 0.4))
        yield Case(f"rests at s = {at:g} at the clamp of a swinging beam", "small steps",
                   lambda a=at: simple(a, 0.0, moving=True), refines(1e-4))
        yield Case(f"moves to the clamp from s = {at:g}", "event", lambda a=at: simple(a, -0.4),
                   ends("run of bead", "start", at / 0.4))
    yield Case("arrives at the free end", "event", lambda: simple(2.9, 0.4), ends("run of bead", "end", 0.25))
    yield Case("arrives at the free end of a swinging beam", "event", lambda: simple(2.9, 0.4, moving=True),
               ends("run of bead", "end"))
    yield Case("rests at the free end", "stays", lambda: simple(3.0, 0.0), straight_line(3.0, 0.0))
    yield Case("starts at the free end and leaves it", "constant speed", lambda: simple(3.0, -0.4), straight_line(3.0, -0.4))
    yield Case("starts at the free end outwards", "event", lambda: simple(3.0, 0.4), ends("run of bead", "end", 0.0))


def stiff_incline(at: float, rate: float, slope: float = 0.5, elements: int = 8) -> fb.Scene:
    """A mass on a rigid wire held at both ends: exact parabola."""
    wire = fb.Beam.straight("wire", (0, 0, 0), (4.0 * np.sqrt(1 - slope**2), 0, 4.0 * slope), section=STIFF, elements=elements)
    return held(fb.Clamp(wire.end), *on(wire, at, rate), rail=wire, gravity=(0, 0, -10.0))


def reversals() -> Iterator[Case]:
    """A mass thrown up an incline of deceleration 5 m/s^2."""
    for what, at, rate in (("inside a step", 1.3, 1.2), ("at the end of a step", 1.3, 1.0),
                           ("on an element end", 2.0 - 0.1, 1.0), ("on an element end inside a step", 2.0 - 0.144, 1.2),
                           ("just before the end of the beam", 4.0 - 0.1 - 1e-6, 1.0)):
        yield Case(f"reverses {what}", "exact parabola", lambda a=at, r=rate: stiff_incline(a, r),
                   follows(lambda t, a=at, r=rate: a + r * t - 2.5 * t * t, 2e-7), step=0.02)


def several() -> Iterator[Case]:
    """More than one slider."""
    def meet(moving: bool) -> fb.Scene:
        beam = rail()
        return held(*on(beam, 1.2, 0.6), *on(beam, 1.5, -0.6, name="other"), *([swinging(beam)] if moving else []), rail=beam)

    yield Case("two meet and pass through each other", "constant speeds", lambda: meet(False),
               follows(lambda t: (1.2 + 0.6 * t, 1.5 - 0.6 * t), 1e-13))
    yield Case("the same on a swinging beam", "small steps", lambda: meet(True), refines(5e-4))

    def crossing(angle: float) -> fb.Scene:
        beam = rail()
        c, s = 1.5 * np.cos(angle), 1.5 * np.sin(angle)
        other = fb.Beam.straight("other", (1.5 - c, -s, 0), (1.5 + c, s, 0), section=SOFT, elements=6)
        bead = fb.PointMass("bead", mass=0.1)
        return held(other, fb.Clamp(other.start), bead, fb.Slider("run", bead, beam, at=1.5), fb.Slider("other run", bead, other, at=1.5),
                    swinging(beam), rail=beam, project_velocities=True)

    for degrees in (90.0, 5.0, 0.5, 0.05):
        yield Case(f"one mass on two flexible beams that cross at {degrees:g} degrees", "small steps",
                   lambda d=degrees: crossing(np.radians(d)), refines(5e-3), t_end=0.2)

    def towed(angle: float) -> fb.Scene:
        beam = rail()
        rod = fb.Beam.straight("rod", (1.5, 0, 0), (1.5 + np.cos(angle), np.sin(angle), 0), section=SOFT, elements=2)
        return held(rod, fb.Slider("run", rod.start, beam, at=1.5), swinging(beam), rail=beam, project_velocities=True)

    for degrees in (30.0, 0.5, 0.0):
        yield Case(f"end of a beam slides on another at {degrees:g} degrees", "small steps", lambda d=degrees: towed(np.radians(d)),
                   refines(5e-3))


def redundant() -> Iterator[Case]:
    """The same motion held more than once."""
    def twice(gap: float, moving: bool) -> fb.Scene:
        beam, bead = rail(), fb.PointMass("bead", mass=0.5)
        scene = held(bead, fb.Slider("one", bead, beam, at=1.2), rail=beam)
        return scene.add(fb.Slider("two", bead, beam, at=1.2), *([swinging(beam)] if moving else []))

    yield Case("one mass on the same beam twice, at rest", "stays", lambda: twice(0.0, False), follows(lambda t: (1.2, 1.2), 1e-12))
    yield Case("one mass on the same beam twice, swinging", "like one slider", lambda: twice(0.0, True), like_one)

    def pinned(at: float, gravity: float = -9.81) -> fb.Scene:
        beam, bead = rail(), fb.PointMass("bead", mass=0.5)
        return held(bead, fb.Pin(bead), fb.Slider("run", bead, beam, at=at), rail=beam, gravity=(0, 0, gravity))

    yield Case("mass pinned on a flexible beam", "small steps", lambda: pinned(1.2), refines(2e-3))
    yield Case("mass pinned on the clamped node", "names the slider", lambda: pinned(0.0), refused("slider 'run'"))

    def pinned_end() -> fb.Scene:
        beam = rail()
        rod = fb.Beam.straight("rod", (1.2, 0, 0), (1.2, 0, 1), section=SOFT, elements=2)
        return held(rod, fb.Pin(rod.start), fb.Slider("run", rod.start, beam, at=1.2), rail=beam, gravity=(0, 0, -9.81))

    yield Case("pinned end of a beam on a flexible beam", "small steps", pinned_end, refines(2e-3))

    def tied(at: float, lift: float, body: bool) -> fb.Scene:
        beam = rail()
        part = (fb.RigidBody("part", mass=0.5, inertia=(1, 1, 1), position=(at, 0, 0)) if body
                else fb.PointMass("part", mass=0.5, position=(at, 0, 0)))
        return held(part, fb.RigidConnection(beam.at(at + lift), part), fb.Slider("run", part, beam, at=at), swinging(beam),
                    rail=beam, project_velocities=True)

    for lift in (0.0, 0.5):
        yield Case(f"mass tied to a node of its own beam, arm {lift:g} m", "names the slider, or small steps",
                   lambda x=lift: tied(1.0, x, False), either(refined_or_named))

    def same_parts(apart: float) -> fb.Scene:
        beam = rail()
        body = fb.RigidBody("body", mass=0.5, inertia=(0.1, 0.1, 0.1), position=(1.2, 0, 0.2))
        points = [body.point((x, 0, -0.2)) for x in (0.0, apart)]
        return held(body, *(fb.Slider(f"run {k}", p, beam, at=1.2 + x) for k, (p, x) in enumerate(zip(points, (0.0, apart)))),
                    swinging(beam), rail=beam, project_velocities=True)

    for apart in (0.0, 1e-3, 0.1):
        yield Case(f"two points of one body on one beam, {apart:g} m apart", "small steps", lambda x=apart: same_parts(x), refines(5e-3))
    for apart in (1e-9, 1e-6):
        yield Case(f"two points of one body on one beam, {apart:g} m apart", "names the slider, or small steps",
                   lambda x=apart: same_parts(x), either(refined_or_named))

    def in_a_row(degree: int) -> fb.Scene:
        beam = rail(degree=degree)
        body = fb.RigidBody("body", mass=0.5, inertia=(0.1, 0.1, 0.1), position=(1.2, 0, 0.2))
        apart = [0.05 * k for k in range(degree + 2)]
        return held(body, *(fb.Slider(f"run {k}", body.point((x, 0, -0.2)), beam, at=1.2 + x, curve="own") for k, x in enumerate(apart)),
                    swinging(beam), rail=beam, project_velocities=True)

    for degree in (1, 2):
        yield Case(f"{degree + 2} points of one body on one element of degree {degree}", "small steps", lambda d=degree: in_a_row(d),
                   refines(5e-3), t_end=0.3)

    def cable(ratio: float) -> fb.Scene:
        thin = fb.Section.circle(radius=3.0 / ratio, E=1e6 * ratio, rho=1.0 / (np.pi * (3.0 / ratio)**2))
        beam, eye = rail(section=thin, elements=12), fb.PointMass("eye", mass=0.1)
        return held(eye, fb.Pin(eye), fb.Slider("run", eye, beam, at=1.1), rail=beam, gravity=(0, 0, -9.81))

    for ratio in (1e3, 1e4):
        yield Case(f"cable of slenderness {ratio:g} through an eye fixed in space", "small steps", lambda r=ratio: cable(r),
                   refines(5e-2), t_end=0.2)


def like_one(case: Case, ran: Ran) -> tuple[bool, str]:
    """Two sliders that say the same: the motion of one, and forces that add up to its force."""
    assert ran.result is not None
    one = fb.simulate(fb.compile_scene(simple(1.2, 0.0, moving=True)), t_end=case.t_end, step=case.step, every=1, snapshots=0,
                      progress=False)
    s = float(np.max(np.abs(ran.result.series["s_slide"] - one.series["s_slide"])))
    both, alone = ran.result.series["contact_force"], one.series["contact_force"]
    force = float(np.max(np.abs(both.sum(axis=1) - alone[:, 0]))) / float(np.max(np.abs(alone)))
    split = float(np.max(np.abs(both[:, 0] - both[:, 1]))) / float(np.max(np.abs(alone)))
    return s <= 1e-9 and force <= 1e-6, f"s off by {s:.1e} m, force by {force:.1e}, halves differ by {split:.1e}"


def refined_or_named(case: Case, ran: Ran) -> tuple[bool, str]:
    """Either of both."""
    return refused("slider '")(case, ran) if ran.error else refines(5e-3)(case, ran)


def either(judge: Judge) -> Judge:
    """Marks a judge that accepts an error."""
    setattr(judge, "accepts_errors", True)
    return judge


def paths() -> Iterator[Case]:
    """Closed, curved and kinked paths, fast sliders, large rotations."""
    def ring(at: float, rate: float, spin: float = 0.0) -> fb.Scene:
        loop = fb.Beam.from_curve("loop", lambda u: (np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 0.0), d2=(0, 0, 1),
                                  section=SOFT, elements=12, degree=3)
        return fb.Scene(loop, fb.RigidConnection(loop.start, loop.end), *on(loop, at, rate))

    yield Case("closed loop, far from the seam", "small steps", lambda: ring(2.0, 1.0), refines(1e-3))
    yield Case("closed loop, to the seam", "event", lambda: ring(2 * np.pi - 0.1, 1.0), ends("run of bead", "end"))
    yield Case("closed loop, starts on the seam", "small steps", lambda: ring(0.0, 1.0), refines(1e-3))

    def fast(moving: bool, curve: str = "c1") -> fb.Scene:
        beam = rail(elements=600)
        return held(*on(beam, 0.1, 40.0, curve=curve), *([swinging(beam)] if moving else []), rail=beam)

    yield Case("20 elements a step", "constant speed", lambda: fast(False), straight_line(0.1, 40.0), t_end=0.07, step=0.0025)
    for curve in ("c1", "own"):
        yield Case(f"20 elements a step on a swinging beam, {curve}", "small steps", lambda c=curve: fast(True, c), refines(2e-2),
                   t_end=0.07, step=0.0025)

    def wire(beam: fb.Beam, at: float, rate: float, curve: str) -> fb.Scene:
        return held(fb.Clamp(beam.end), *on(beam, at, rate, curve=curve), rail=beam)

    def helix(elements: int, curve: str = "c1", degree: int = 4) -> fb.Beam:
        return fb.Beam.helix("rail", radius=0.1, pitch=0.05, turns=3.0, section=STIFF, elements=elements, degree=degree)

    for elements in (36, 12):
        yield Case(f"tight helix, {elements // 3} elements a turn", "constant speed", lambda n=elements: wire(helix(n), 0.2, 1.0, "c1"),
                   follows(lambda t: 0.2 + t, 2e-3), t_end=1.0)
    yield Case("tight helix, half a radian a step", "small steps", lambda: wire(helix(36), 0.2, 1.0, "c1"), refines(2e-2), t_end=1.0, step=0.05)
    yield Case("tight helix, two radians a step", "invariants", lambda: wire(helix(36), 0.2, 1.0, "c1"), either(named_or_conserves),
               t_end=1.0, step=0.2)
    for degree, curve in ((1, "c1"), (2, "c1"), (2, "own")):
        if True:
            yield Case(f"kinked arc, 4 elements of degree {degree} in 180 degrees, {curve}", "small steps",
                       lambda d=degree, c=curve: wire(fb.Beam.arc("rail", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=0.5, angle=np.pi,
                                                                  section=STIFF, elements=4, degree=d), 0.1, 1.0, c),
                       refines(1e-2), t_end=1.0)

    def spinning(spin: float) -> fb.Scene:
        beam = rail()
        return fb.Scene(beam, *on(beam, 1.5 + 1e-3, None), fb.RigidMotion(spin=(0, 0, spin), about=(1.5, 0, 0)))

    for turn in (0.5, 2.0, 6.0):
        yield Case(f"frame turns by {2 * np.arctan(0.5 * turn):.2f} rad a step", "invariants, or fails", lambda w=turn: spinning(w / 0.05),
                   either(named_or_conserves), t_end=0.5, step=0.05)


def named_or_conserves(case: Case, ran: Ran) -> tuple[bool, str]:
    """Either of both."""
    return refused("slider '")(case, ran) if ran.error else (True, "")


PARTS = (forces, ends_of_elements, reversals, several, redundant, paths)


def drift_of(run: fb.Result, name: str) -> float:
    """Relative drift; of what is at rest and has no size of its own relative to 1 mJ or 1 mNs."""
    return min(run.drift(name), float(np.max(np.ptp(run.series[name], axis=0))) / 1e-3)


def verdict(case: Case, augmentation: float) -> Row:
    """Run a case and say what happened. Plain multipliers may fail where they say why."""
    ran = case.run(augmentation)
    title = f"{case.name}; {'augmented' if augmentation else 'plain'}"
    if ran.error:
        may_fail = not augmentation or getattr(case.judge, "accepts_errors", False)
        return Row(title, case.expected, ran.error.split("; increments")[0][:150], may_fail and "slider '" in ran.error)
    run = ran.result
    assert run is not None
    ok, said = case.judge(case, ran)
    drift = max(drift_of(run, name) for name in run.info["conserved"] if name != "gap")
    gap, steps = run.drift("gap"), run.info["steps"]
    return Row(title, case.expected, f"{steps} steps, {run.info['iterations'] / max(steps, 1):.1f} iterations, drift {drift:.0e}, "
               f"gap {gap:.0e}, {said}", ok and drift <= DRIFT and gap <= GAP)


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    for part in PARTS:
        for case in part():
            for augmentation in (0.0, AUGMENTATION):
                yield verdict(case, augmentation)
