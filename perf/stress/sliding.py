"""Corners of sliding contact, each with plain multipliers and with the augmented Lagrangian (theory.md 5.5).

A case is right where it follows an exact law or converges to a run in small steps of order 4, with invariants and gap at
round-off. Where that cannot be, the error has to name the slider.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from small_scenes import SECTION, straight

import fastbeam as fb
from fastbeam.stepping.stepper import AUGMENTATION
from perf.stress.table import Row

Array = np.ndarray
# soft enough that the steps below resolve all waves, so that errors shrink as they should
SOFT = fb.Section(EA=200.0, GA2=100.0, GA3=100.0, GJ=20.0, EI2=20.0, EI3=25.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
STIFF = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=1e9, EI2=1e9, EI3=1e9, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
WEIGHT = (0.0, 0.0, -9.81)
DRIFT, GAP = 1e-10, 1e-14
Judge = Callable[["Case", fb.Result, float], tuple[bool, str]]


@dataclass(frozen=True)
class Case:
    """A scene, how it is run, and how the result is judged. Where it may fail, the error has to name the slider."""

    name: str
    scene: Callable[[], fb.Scene]
    judge: Judge
    t_end: float = 0.5
    step: float = 2e-3
    may_fail: bool = False

    def run(self, augmentation: float, parts: int = 1, order: int = 2) -> fb.Result:
        """Compile and run, with each step cut into so many parts."""
        return fb.simulate(fb.compile_scene(self.scene()), t_end=self.t_end, step=self.step / parts, order=order, every=parts,
                           output=fb.Output(snapshots=0), progress=False, solver=fb.Solver(augmentation=augmentation))

    def verdict(self, augmentation: float) -> Row:
        """Run and say what happened. Plain multipliers may fail where the error names the slider."""
        title = f"{self.name}; {'augmented' if augmentation else 'plain'}"
        expected = f"{self.judge.__doc__}{', or names the slider' if self.may_fail else ''}"
        try:
            run = self.run(augmentation)
        except (fb.SceneError, fb.ConvergenceError) as error:
            ok = (self.may_fail or not augmentation) and "slider '" in str(error)
            return Row(title, expected, str(error).split("; increments")[0][:110], ok)
        ok, said = self.judge(self, run, augmentation)
        drift = max(drift_of(run, name) for name in run.info["conserved"] if name != "gap")
        gap, steps = run.drift("gap"), run.info["steps"]
        return Row(title, expected, f"{steps} steps, {run.info['iterations'] / max(steps, 1):.1f} iterations, drift {drift:.0e}, "
                   f"gap {gap:.0e}, {said}", ok and drift <= DRIFT and gap <= GAP)


def drift_of(run: fb.Result, name: str) -> float:
    """Relative drift; of what is at rest and has no size of its own relative to 1 mJ or 1 mNs."""
    return min(run.drift(name), float(np.max(np.ptp(run.series[name], axis=0))) / 1e-3)


# ------------------------------------------------------------------------------------------------------------------- judges
def follows(law: Callable[[float], Any], bar: float = 1e-13) -> Judge:
    """Sliding coordinates follow an exact law."""
    def judge(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
        """exact law"""
        exact = np.array([np.atleast_1d(law(float(t))) for t in run.t])
        off = float(np.max(np.abs(run.series["s_slide"] - exact)))
        return off <= bar and bool(run.t[-1] == case.t_end), f"s off by {off:.1e} m"
    return judge


def speed(at: float, rate: float) -> Judge:
    """Constant speed on a straight beam at rest."""
    return follows(lambda t: at + rate * t)


def distance(a: fb.Result, b: fb.Result) -> float:
    """Largest difference of positions and sliding coordinates at the end of two runs, m."""
    x, y = (run.state.q.reshape(-1, 4, 3)[:, 0] for run in (a, b))
    return max(float(np.max(np.abs(x - y))), float(np.max(np.abs(a.state.s - b.state.s))))


def refines(bar: float) -> Judge:
    """Meets order 4 with steps of a sixteenth; with a quarter of the step at most half of the difference is left."""
    def judge(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
        """small steps"""
        fine = case.run(augmentation, 16, order=4)
        off, less = distance(run, fine), distance(case.run(augmentation, 4), fine)
        return off <= bar and (less <= 0.5 * off or off < 1e-10), f"off by {off:.1e}, with a quarter of the step {less:.1e} m"
    return judge


def near(bar: float) -> Judge:
    """Stays as near to order 4 with steps of a sixteenth, whatever the step: small kinks are small impacts, whose time within a
    step no step resolves."""
    def judge(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
        """small steps, but for kinks"""
        fine = case.run(augmentation, 16, order=4)
        off = max(distance(run, fine), distance(case.run(augmentation, 4), fine))
        return off <= bar, f"off by {off:.1e} m, with a quarter of the step as well"
    return judge


def ends(end: str, time: float | None = None, slider: str = "run of bead") -> Judge:
    """The run ends where a slider meets an end of its beam, at a known time or at that of small steps."""
    def judge(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
        """event"""
        exact = float(case.run(augmentation, 16, order=4).t[-1]) if time is None else time
        found = [e for e in run.events if e["kind"] == "slider_end"]
        if not found:
            return False, "no event"
        e = found[0]
        bar = 1e-3 * case.t_end if time is None else 1e-8
        return (e["slider"], e["end"]) == (slider, end) and abs(e["time"] - exact) <= bar, f"{e['end']} at {e['time']:.6g} s"
    return judge


def runs(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
    """invariants"""
    return bool(run.t[-1] == case.t_end), "too coarse to compare"


def fails(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
    """fails"""
    return False, "runs"


def like_one(case: Case, run: fb.Result, augmentation: float) -> tuple[bool, str]:
    """like one slider"""
    one = Case("", lambda: on_rail(1.2, 0.0, moving=True), runs).run(augmentation)
    s = float(np.max(np.abs(run.series["s_slide"] - one.series["s_slide"])))
    both, alone = run.series["contact_force"], one.series["contact_force"]
    size = float(np.max(np.abs(alone)))
    total = float(np.max(np.abs(both.sum(axis=1) - alone[:, 0]))) / size
    split = float(np.max(np.abs(both[:, 0] - both[:, 1]))) / size
    return s <= 1e-12 and total <= 1e-7, f"s off by {s:.1e} m, force by {total:.1e}, halves differ by {split:.1e}"


# -------------------------------------------------------------------------------------------------------------------- parts
def rail(**changes: Any) -> fb.Beam:
    """3 m, 6 quadratic elements."""
    return straight("rail", (0, 0, 0), (3, 0, 0), **{"elements": 6, "section": SOFT, **changes})


def on(beam: fb.Beam, at: float, rate: float | None = 0.0, *, name: str = "bead", mass: float = 0.5,
       curve: str = "c1") -> list[Any]:
    """A mass on a slider."""
    bead = fb.PointMass(name, mass=mass)
    return [bead, fb.Slider(f"run of {name}", bead, beam, at=at, rate=rate, curve=curve)]


def swinging(beam: fb.Beam) -> fb.InitialVelocity:
    """Lateral velocity of a clamped rail in one plane."""
    return fb.InitialVelocity(beam, velocity=lambda s: np.stack((0 * s, 0 * s, 1.5 * (s / 3.0)**2), axis=1),
                              spin=lambda s: np.stack((0 * s, -s / 3.0, 0 * s), axis=1))


def clamped(beam: fb.Beam, *parts: Any, moving: bool = True, gravity: Any = (0, 0, 0), project: bool = False) -> fb.Scene:
    """A beam that is clamped at its start, swinging or at rest."""
    return fb.Scene(beam, *parts, fb.Clamp(beam.start), *([swinging(beam)] if moving else []), gravity=gravity,
                    project_velocities=project)


def on_rail(at: float, rate: float, *, curve: str = "c1", moving: bool = False, mass: float = 0.5, gravity: Any = (0, 0, 0),
            **changes: Any) -> fb.Scene:
    """A mass on a clamped rail."""
    beam = rail(**changes)
    return clamped(beam, *on(beam, at, rate, curve=curve, mass=mass), moving=moving, gravity=gravity)


def wire(beam: fb.Beam, at: float, rate: float, curve: str = "c1", gravity: Any = (0, 0, 0)) -> fb.Scene:
    """A mass on a beam that is clamped at both ends."""
    return clamped(beam, fb.Clamp(beam.end), *on(beam, at, rate, curve=curve), moving=False, gravity=gravity)


# -------------------------------------------------------------------------------------------------------------------- cases
def forces() -> Iterator[Case]:
    """Contact forces that vanish, sliders that nothing moves, extreme masses."""
    yield Case("contact force swings through zero", lambda: on_rail(1.2, 0.3, moving=True), refines(2e-5))
    yield Case("at rest without load", lambda: on_rail(1.3, 0.0), speed(1.3, 0.0))
    yield Case("at rest without load, free beam", lambda: fb.Scene(beam := rail(), *on(beam, 1.3)), speed(1.3, 0.0))
    for mass in (1e-12, 1e-6, 1e9):
        yield Case(f"mass of {mass:g} kg", lambda m=mass: on_rail(1.2, 0.3, mass=m, moving=True), refines(2e-5))
    yield Case("mass of 1e-12 kg under gravity", lambda: on_rail(1.2, 0.3, mass=1e-12, gravity=WEIGHT), refines(5e-5))


def ends_of_elements() -> Iterator[Case]:
    """Element ends, the clamp and the free end; elements are 0.5 m long."""
    for curve in ("own", "c1"):
        for degree in (1, 2, 3):
            yield Case(f"starts on an element end, {curve}, degree {degree}",
                       lambda c=curve, d=degree: on_rail(1.0, 0.4, curve=c, degree=d), speed(1.0, 0.4))
        yield Case(f"meets element ends at the end of steps, {curve}",
                   lambda c=curve: on_rail(0.98, 0.4, curve=c), speed(0.98, 0.4))
        yield Case(f"rests on an element end of a swinging beam, {curve}",
                   lambda c=curve: on_rail(1.0, 0.0, curve=c, moving=True), refines(2e-5))
        yield Case(f"crosses element ends of a swinging beam, {curve}",
                   lambda c=curve: on_rail(0.98, 0.4, curve=c, moving=True), refines(2e-5))
    for at in (0.0, 0.1):
        yield Case(f"starts at s = {at:g} at the clamp and leaves", lambda a=at: on_rail(a, 0.4), speed(at, 0.4))
        yield Case(f"rests at s = {at:g} at the clamp of a swinging beam",
                   lambda a=at: on_rail(a, 0.0, moving=True), refines(2e-5))
        yield Case(f"moves to the clamp from s = {at:g}", lambda a=at: on_rail(a, -0.4), ends("start", at / 0.4))
    yield Case("arrives at the free end", lambda: on_rail(2.9, 0.4), ends("end", 0.25))
    yield Case("arrives at the free end of a swinging beam", lambda: on_rail(2.9, 0.4, moving=True), ends("end"))
    yield Case("rests at the free end", lambda: on_rail(3.0, 0.0), speed(3.0, 0.0))
    yield Case("starts at the free end and leaves it", lambda: on_rail(3.0, -0.4), speed(3.0, -0.4))
    yield Case("starts at the free end outwards", lambda: on_rail(3.0, 0.4), ends("end", 0.0))
    def incline(at: float, rate: float) -> fb.Scene:
        beam = fb.Beam.straight("rail", (0, 0, 0), (12.0**0.5, 0, 2), section=STIFF, elements=8)
        return wire(beam, at, rate, gravity=(0, 0, -10))

    # deceleration 5 m/s^2 on a wire that gives way by 3e-8 m; elements are 0.5 m long
    for what, at, rate in (("inside a step", 1.3, 1.2), ("at the end of a step", 1.3, 1.0), ("on an element end", 1.9, 1.0),
                           ("on an element end inside a step", 2.0 - 0.144, 1.2), ("1e-6 m before the end", 3.9 - 1e-6, 1.0)):
        yield Case(f"reverses {what}", lambda a=at, r=rate: incline(a, r),
                   follows(lambda t, a=at, r=rate: a + r * t - 2.5 * t * t, 1e-7), step=0.02)


def several() -> Iterator[Case]:
    """More than one slider."""
    def meet(moving: bool) -> fb.Scene:
        beam = rail()
        return clamped(beam, *on(beam, 1.2, 0.6), *on(beam, 1.5, -0.6, name="other"), moving=moving)

    yield Case("two meet and pass through each other", lambda: meet(False), follows(lambda t: (1.2 + 0.6 * t, 1.5 - 0.6 * t)))
    yield Case("two meet on a swinging beam", lambda: meet(True), refines(2e-5))

    def leave() -> fb.Scene:
        beam = rail()
        return clamped(beam, *on(beam, 2.9, 0.4), *on(beam, 3.0, 0.0, name="other"), moving=False)

    yield Case("one arrives where another rests", leave, ends("end", 0.25))

    def crossing(angle: float) -> fb.Scene:
        beam, bead = rail(), fb.PointMass("bead", mass=0.1)
        c, s = 1.5 * np.cos(angle), 1.5 * np.sin(angle)
        other = fb.Beam.straight("other", (1.5 - c, -s, 0), (1.5 + c, s, 0), section=SOFT, elements=6)
        return clamped(beam, other, fb.Clamp(other.start), bead, fb.Slider("run", bead, beam, at=1.5),
                       fb.Slider("other run", bead, other, at=1.5), project=True)

    for degrees in (90.0, 5.0, 0.5, 0.05):
        yield Case(f"one mass on two beams that cross at {degrees:g} degrees", lambda d=degrees: crossing(np.radians(d)),
                   refines(2e-4), t_end=0.2)

    def towed(angle: float) -> fb.Scene:
        beam = rail()
        rod = fb.Beam.straight("rod", (1.5, 0, 0), (1.5 + np.cos(angle), np.sin(angle), 0), section=SOFT, elements=2)
        return clamped(beam, rod, fb.Slider("run", rod.start, beam, at=1.5), project=True)

    for degrees in (30.0, 0.5, 0.0):
        yield Case(f"end of a beam slides on another at {degrees:g} degrees",
                   lambda d=degrees: towed(np.radians(d)), refines(1e-3))


def redundant() -> Iterator[Case]:
    """The same motion held more than once."""
    def twice(moving: bool) -> fb.Scene:
        beam, bead = rail(), fb.PointMass("bead", mass=0.5)
        return clamped(beam, bead, fb.Slider("one", bead, beam, at=1.2), fb.Slider("two", bead, beam, at=1.2), moving=moving)

    yield Case("one mass on the same beam twice, at rest", lambda: twice(False), follows(lambda t: (1.2, 1.2)))
    yield Case("one mass on the same beam twice, swinging", lambda: twice(True), like_one)

    def row(apart: float, points: int = 2, **changes: Any) -> fb.Scene:
        beam = rail(**changes)
        body = fb.RigidBody("body", mass=0.5, inertia=(0.1, 0.1, 0.1), position=(1.2, 0, 0.2))
        sliders = [fb.Slider(f"run {k}", body.point((k * apart, 0, -0.2)), beam, at=1.2 + k * apart, curve="own")
                   for k in range(points)]
        return clamped(beam, body, *sliders, project=True)

    for apart in (0.0, 1e-3, 0.1):
        yield Case(f"two points of one body on one beam, {apart:g} m apart", lambda a=apart: row(a), refines(1e-3))
    for apart in (1e-9, 1e-6):
        yield Case(f"two points of one body on one beam, {apart:g} m apart", lambda a=apart: row(a), refines(1e-3), may_fail=True)
    for degree in (1, 2):
        yield Case(f"{degree + 2} points of one body on one element of degree {degree}",
                   lambda d=degree: row(0.05, d + 2, degree=d), refines(5e-4), t_end=0.3)

    def pinned(at: float) -> fb.Scene:
        beam, bead = rail(), fb.PointMass("bead", mass=0.5)
        return clamped(beam, bead, fb.Pin(bead), fb.Slider("run", bead, beam, at=at), moving=False, gravity=WEIGHT)

    yield Case("mass pinned on a flexible beam", lambda: pinned(1.2), refines(2e-4))
    yield Case("mass pinned on the clamped node", lambda: pinned(0.0), fails, may_fail=True)

    def pinned_end() -> fb.Scene:
        beam = rail()
        rod = fb.Beam.straight("rod", (1.2, 0, 0), (1.2, 0, 1), section=SOFT, elements=2)
        return clamped(beam, rod, fb.Pin(rod.start), fb.Slider("run", rod.start, beam, at=1.2), moving=False, gravity=WEIGHT)

    yield Case("pinned end of a beam on a flexible beam", pinned_end, refines(2e-4))

    def tied(at: float, lift: float) -> fb.Scene:
        beam, part = rail(), fb.PointMass("part", mass=0.5, position=(at, 0, 0))
        return clamped(beam, part, fb.RigidConnection(beam.at(at + lift), part), fb.Slider("run", part, beam, at=at),
                       project=True)

    yield Case("mass tied to the node of its own beam where it slides", lambda: tied(1.0, 0.0), fails, may_fail=True)
    yield Case("mass tied to a node of its own beam 0.5 m away", lambda: tied(1.0, 0.5), refines(1e-4))

    def cable(ratio: float) -> fb.Scene:
        radius = 3.0 / ratio
        thin = fb.Section.circle(radius=radius, E=1e6 * ratio, rho=1.0 / (np.pi * radius**2))
        beam, eye = rail(section=thin, elements=12), fb.PointMass("eye", mass=0.1)
        return clamped(beam, eye, fb.Pin(eye), fb.Slider("run", eye, beam, at=1.1), moving=False, gravity=WEIGHT)

    for ratio in (1e3, 1e4):
        yield Case(f"cable of slenderness {ratio:g} through a fixed eye", lambda r=ratio: cable(r), refines(5e-4), t_end=0.2)


def paths() -> Iterator[Case]:
    """Closed, curved and kinked paths, fast sliders, large rotations."""
    def ring(at: float) -> fb.Scene:
        loop = fb.Beam.from_curve("loop", lambda u: (np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 0.0), d2=(0, 0, 1),
                                  section=SOFT, elements=12, degree=3)
        return fb.Scene(loop, fb.RigidConnection(loop.start, loop.end), *on(loop, at, 1.0))

    yield Case("closed loop, far from the seam", lambda: ring(2.0), refines(1e-5))
    yield Case("closed loop, up to the seam", lambda: ring(2 * np.pi - 0.1), ends("end"))
    yield Case("closed loop, starts on the seam", lambda: ring(0.0), refines(2e-5))

    # 0.1 m a step, elements of 5 mm
    for moving, curve in ((False, "c1"), (True, "c1"), (True, "own")):
        yield Case(f"20 elements a step, beam {'swinging' if moving else 'at rest'}, {curve}",
                   lambda m=moving, c=curve: on_rail(0.1, 40.0, moving=m, curve=c, elements=600, section=SECTION),
                   refines(1e-3) if moving else speed(0.1, 40.0), t_end=0.07, step=2.5e-3)

    def helix(elements: int) -> fb.Scene:
        beam = fb.Beam.helix("rail", radius=0.1, pitch=0.05, turns=3.0, section=STIFF, elements=elements, degree=4)
        return wire(beam, 0.2, 1.0)

    for elements, bar in ((36, 5e-5), (12, 1e-3)):
        yield Case(f"tight helix, {elements // 3} elements a turn", lambda n=elements: helix(n), follows(lambda t: 0.2 + t, bar),
                   t_end=1.0)
    yield Case("tight helix, half a radian a step", lambda: helix(36), refines(5e-2), t_end=1.0, step=0.05)
    yield Case("tight helix, two radians a step", lambda: helix(36), runs, t_end=1.0, step=0.2, may_fail=True)

    def arc(degree: int, curve: str) -> fb.Scene:
        return wire(fb.Beam.arc("rail", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=0.5, angle=np.pi, section=STIFF, elements=4,
                                degree=degree), 0.1, 1.0, curve)

    for degree, curve, judge in ((1, "c1", refines(2e-4)), (2, "c1", refines(2e-4)), (2, "own", near(4e-4))):
        yield Case(f"half circle of 4 elements of degree {degree}, {curve}",
                   lambda d=degree, c=curve: arc(d, c), judge, t_end=1.0)
    # a kink of 45 degrees is an impact, which no step resolves
    yield Case("half circle of 4 elements of degree 1, own", lambda: arc(1, "own"), runs, t_end=1.0, may_fail=True)

    def spinning(spin: float) -> fb.Scene:
        beam = rail()
        return fb.Scene(beam, *on(beam, 1.5 + 1e-3, None), fb.RigidMotion(spin=(0, 0, spin), about=(1.5, 0, 0)))

    for turn in (0.5, 2.0, 6.0):
        yield Case(f"frame turns by {2 * np.arctan(0.5 * turn):.2f} rad a step",
                   lambda w=turn: spinning(w / 0.05), runs, step=0.05, may_fail=True)


PARTS = (forces, ends_of_elements, several, redundant, paths)


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part; quickly with the augmented Lagrangian only."""
    for part in PARTS:
        for case in part():
            for augmentation in (AUGMENTATION,) if quick else (0.0, AUGMENTATION):
                yield case.verdict(augmentation)
