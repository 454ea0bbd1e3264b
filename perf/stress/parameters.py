"""Corners of the parameters: stiffness ratios, inertias, masses, step sizes, turns per step, slenderness.

Every run is judged three times: by its invariants, by the same steps with SuperLU on all unknowns (no elimination at all), and,
where there is one, by an exact solution. A run that fails has to say so; a run that does not fail has to be right.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq
from small_scenes import bent

import fastbeam as fb
from perf.stress.matrices import matrices
from perf.stress.table import Row

Array = np.ndarray
LENGTH, H = 3.0, 5e-3
DRIFT = 1e-10
QUIET: dict[str, Any] = {"every": 1, "output": fb.Output(snapshots=0), "progress": False}


def section(EA: float = 1e4, GA: float = 1e4, GJ: float = 500.0, EI: float = 500.0, rhoA: float = 1.0,
            rhoI: float = 0.1) -> fb.Section:
    """Two different bending stiffnesses and inertias; else as in the small scenes."""
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=GJ, EI2=EI, EI3=1.2 * EI, rhoA=rhoA, rhoI2=rhoI, rhoI3=2.0 * rhoI)


def flight(of: fb.Section, mass: float = 0.5, rate: float = 0.5) -> fb.Scene:
    """A beam flies, bends, twists and turns, and a bead slides along it."""
    rail = fb.Beam.straight("rail", (0, 0, 0), (LENGTH, 0, 0), section=of, elements=4, degree=2)
    bead = fb.PointMass("bead", mass=mass)
    return fb.Scene(rail, bead, fb.Slider("run", bead, rail, at=1.1, rate=rate), bent(rail), project_velocities=True)


def swing(of: fb.Section) -> fb.Scene:
    """A cantilever falls under a load at its tip."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (LENGTH, 0, 0), section=of, elements=4, degree=2)
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(5, 20, 30)))


@dataclass(frozen=True)
class Verdict:
    """Of one run: steps done, largest drift, largest distance from the run without eliminations (of positions over the length
    and of directors), names of events, message of a failure."""

    steps: int
    drift: float
    distance: float
    events: tuple[str, ...]
    message: str

    @property
    def right(self) -> bool:
        """Ran to the end, kept its invariants, and agrees."""
        return not self.message and not self.events and self.drift <= DRIFT and self.distance <= 1e-9

    @property
    def honest(self) -> bool:
        """Right, or failed with a message after steps that were right."""
        return self.drift <= DRIFT and (bool(self.message) or bool(self.events) or self.distance <= 1e-9)


def run(scene: fb.Scene, h: float, n: int, solver: str = "auto", backend: str = "auto", **options: Any) -> tuple[fb.Result, str]:
    """The result, of a failed run too, and the message."""
    model = fb.compile_scene(scene, solver=solver, eliminate_inner=backend == "auto")
    try:
        return fb.simulate(model, t_end=n * h, step=h, solver=backend, **{**QUIET, **options}), ""
    except fb.ConvergenceError as failed:
        return failed.result, str(failed)


def judge(scene: fb.Scene, h: float, n: int = 40) -> Verdict:
    """Run a scene and the same without eliminations."""
    found, message = run(scene, h, n)
    done = found.info["steps"]
    other = run(scene, h, done, "sparse", "superlu")[0] if done else found
    # a run that failed earlier is no judge
    off = np.abs(found.state.q - other.state.q).reshape(-1, 4, 3) if other.info["steps"] == done else np.full((1, 4, 3), np.inf)
    drift = max(found.drift(key) for key in found.info["conserved"] if key in found.series)
    return Verdict(done, drift, max(float(off[:, 0].max()) / LENGTH, float(off[:, 1:].max())),
                   tuple(event["kind"] for event in found.events if event["kind"] not in ("failed", "slider_end")), message)


def sweep(what: str, values: Array, scene: Callable[[float], fb.Scene], h: float | Callable[[float], float] = H,
          whole: bool = True) -> Iterator[Row]:
    """One row for the range in which runs are right, one for every value outside of it."""
    verdicts = [judge(scene(x), h(x) if callable(h) else h) for x in values]
    good = [(x, v) for x, v in zip(values, verdicts) if v.right]
    yield Row(f"{what}, {values[0]:.0e} to {values[-1]:.0e}", "right everywhere" if whole else "right, or a message",
              f"right from {min(x for x, _ in good):.0e} to {max(x for x, _ in good):.0e}: drift <= "
              f"{max(v.drift for _, v in good):.0e}, off <= {max(v.distance for _, v in good):.0e}",
              len(good) == len(values) if whole else bool(good))
    for x, v in zip(values, verdicts):
        if not v.right:
            yield Row(f"{what} {x:.0e}", "a message",
                      f"{v.steps} steps, drift {v.drift:.0e}, off {v.distance:.0e}: {', '.join(v.events)} {v.message[:120]}",
                      v.honest)


# ------------------------------------------------------------------------------------------------- exact solutions, dynamics
def frequency(kind: str, of: fb.Section) -> tuple[float, float]:
    """(angular frequency, slope of the triads over the slope of the centreline) of the lowest mode of a bar of length 1."""
    if kind == "axial":
        return 0.5 * np.pi * np.sqrt(of.EA / of.rhoA), 0.0
    if kind == "torsion":
        return 0.5 * np.pi * np.sqrt(of.GJ / (of.rhoI2 + of.rhoI3)), 0.0
    # Timoshenko: lower root of rhoA rhoI w^4 - (rhoA EI k^2 + rhoI GA k^2 + rhoA GA) w^2 + EI GA k^4 = 0, divided by GA
    k = np.pi
    a, b, c = of.rhoA * of.rhoI2 / of.GA2, (of.rhoA * of.EI3 / of.GA2 + of.rhoI2) * k * k + of.rhoA, of.EI3 * k**4
    w = np.sqrt(2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c)))
    return float(w), float(1.0 - of.rhoA * w * w / (of.GA2 * k * k))


def tone(kind: str, of: fb.Section, amplitude: float, samples: int = 40) -> float:
    """Error of a small vibration against the exact one, relative to its amplitude, over half a period.

    The bar is clamped at one end ('axial', 'torsion') or pinned at both ('bending', in the plane of d2). The conserving step
    turns an oscillator of frequency w by 2 atan(w h/2) a step, exactly.
    """
    w, share = frequency(kind, of)
    bending = kind == "bending"
    k = np.pi if bending else 0.5 * np.pi
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=of, elements=4, degree=6)

    def wave(direction: tuple[float, float, float]) -> Callable[[Array], Array]:
        return lambda s: amplitude * w * np.sin(k * s)[:, None] * np.array(direction)

    def slope(s: Array) -> Array:
        return amplitude * w * k * share * np.cos(k * s)[:, None] * np.array((0.0, 0.0, 1.0))

    moves = {"axial": {"velocity": wave((1, 0, 0))}, "torsion": {"spin": wave((1, 0, 0))},
             "bending": {"velocity": wave((0, 1, 0)), "spin": slope}}[kind]
    holds = [fb.Pin(beam.start), fb.Pin(beam.end)] if bending else [fb.Clamp(beam.start)]
    model = fb.compile_scene(fb.Scene(beam, fb.InitialVelocity(beam, **moves), *holds))
    h = np.pi / w / samples
    node = 12 * model.numbers.number(beam.node(beam.n_nodes // 2) if bending else beam.end)
    # x of the end, z of d2 there, y of the middle
    at = node + {"axial": 0, "torsion": 8, "bending": 1}[kind]
    seen: list[float] = []
    fb.simulate(model, t_end=samples * h, step=h, callback=lambda t, state: seen.append(state.q[at] - model.q0[at]), **QUIET)
    exact = amplitude * np.sin(2.0 * np.arctan(0.5 * w * h) * np.arange(1, samples + 1))
    return float(np.abs(np.array(seen) - exact).max()) / amplitude


def tones(decades: Array) -> Iterator[Row]:
    """Frequencies over the decades of one stiffness, the others 1."""
    for kind, name in (("axial", "EA"), ("torsion", "GJ"), ("bending", "GA")):
        ones = {"EA": 1.0, "GA": 1.0, "GJ": 1.0, "EI": 1.0, "rhoI": 1e-4}
        worst = max(tone(kind, section(**{**ones, name: r}), 1e-5) for r in decades)
        yield Row(f"{kind} vibration, {name} {decades[0]:.0e} to {decades[-1]:.0e} of EI", "exact solution within 1e-8",
                  f"off by {worst:.1e} of the amplitude", worst <= 1e-8)
    # supports that do not give way stretch the bar: (amplitude)^2 EA / EI has to be small, and so does round-off / amplitude
    off = [tone("bending", section(EA=r, GA=r, GJ=1.0, EI=1.0, rhoI=1.0 / r), 1e-3 / np.sqrt(r))
           for r in 10.0**np.arange(2, 13, 2)]
    yield Row("bending vibration, slenderness 1e1 to 1e6", "exact solution within 1e-5",
              "off by " + ", ".join(f"{x:.1e}" for x in off) + " of the amplitude", max(off) <= 1e-5)


def heavy_and_light() -> Iterator[Row]:
    """A bead without mass leaves the beam alone; an infinite one flies straight on."""
    light, alone = fb.compile_scene(flight(section(), mass=1e-9 * LENGTH)), flight(section())
    free = fb.compile_scene(fb.Scene(alone.beams[0], *alone.velocities, project_velocities=True))
    q = [fb.simulate(model, t_end=40 * H, step=H, **QUIET).state.q[:12 * free.n_nodes] for model in (light, free)]
    off = float(np.abs(q[0] - q[1]).max())
    yield Row("bead of 1e-9 of the beam's mass against none", "off by about 1e-9", f"{off:.1e}", 1e-12 < off <= 1e-8)
    heavy = fb.compile_scene(flight(section(), mass=1e9 * LENGTH))
    end = fb.simulate(heavy, t_end=40 * H, step=H, **QUIET).state
    x, v = heavy.q0[-12:-9], heavy.v0[-12:-9]
    off = float(np.abs(end.q[-12:-9] - x - 40 * H * v).max())
    yield Row("bead of 1e9 of the beam's mass against a straight line", "off by about 1e-9", f"{off:.1e}", 1e-14 < off <= 1e-8)


# -------------------------------------------------------------------------------------------------------------- step size, turns
def shortest_period(scene: fb.Scene) -> float:
    """Of small vibrations about the initial shape, of the mesh."""
    stiffness, mass, _ = matrices(fb.compile_scene(scene, solver="sparse", eliminate_inner=False, planar=False))
    return float(2.0 * np.pi / np.sqrt(eigh(stiffness, mass, eigvals_only=True)[-1]))


def steps(decades: Array) -> Iterator[Row]:
    """Step sizes around the shortest period of the mesh."""
    scene = flight(section(), rate=0.0)
    shortest = shortest_period(scene)
    yield from sweep(f"step / shortest period ({shortest:.1e} s)", decades, lambda x: scene, lambda x: x * shortest, whole=False)


def turns() -> Iterator[Row]:
    """Rotation per step: a triad of spin w turns by 2 atan(w h/2), never by more than half a turn."""
    for wh in (0.1, 1.0, 1.9, 2.1, 3.1, 6.0, 1e2, 1e4):
        body = fb.RigidBody("wheel", mass=1.0, inertia=(1.0, 2.0, 3.0), position=(0, 0, 0), spin=(0, 0, wh / H))
        found, message = run(fb.Scene(body), H, 40)
        d1 = found.state.q[3:6]
        off = float(np.abs(d1 - [np.cos(40 * 2 * np.arctan(0.5 * wh)), np.sin(40 * 2 * np.arctan(0.5 * wh)), 0.0]).max())
        told = any(event["kind"] == "unresolved" for event in found.events)
        yield Row(f"body that spins by {wh:g} rad a step", "discrete solution, an event beyond 2; or a message",
                  f"off {off:.0e}, event: {told}; {message[:100]}",
                  "turns with" in message if message else told == (wh > 2.0) and off <= 1e-12 * (1.0 + wh))
    for stiff in (1e2, 1e6):
        limit, text = 0.0, ""
        for wh in (0.1, 0.3, 0.5, 0.8, 1.0, 1.2, 1.5, 3.0, 6.0, 1e2, 1e3, 1e4):
            beam = fb.Beam.straight("rod", (-1.5, 0, 0), (1.5, 0, 0), section=section(*(stiff * np.array((1e4, 1e4, 5e2, 5e2)))),
                                    elements=4, degree=2)
            found, message = run(fb.Scene(beam, fb.RigidMotion(spin=(0, 0, wh / 0.5))), 0.5, 40)
            drift = max(found.drift(key) for key in ("total", "lin_mom", "ang_mom"))
            if not message and drift <= DRIFT:
                limit = max(limit, wh)
                continue
            told = "turns with" in message or any(event["kind"] in ("unresolved", "drift") for event in found.events)
            text = text or message[:200]
            yield Row(f"rod (stiffness x {stiff:g}) that turns by {wh:g} rad a step", "a message that names the turn",
                      f"{found.info['steps']} steps, drift {drift:.0e}: {'turn named' if told else 'NOT NAMED'}",
                      told and drift <= DRIFT)
        yield Row(f"rod (stiffness x {stiff:g}): largest turn a step", ">= 0.5 rad", f"{limit:g} rad; beyond: {text}",
                  limit >= 0.5)


# --------------------------------------------------------------------------------------------------------------------- statics
def elastica(load: float, EA: float, GA: float) -> tuple[float, float]:
    """Tip (x, y) of a cantilever of length 1 and EI = 1 along x under the dead load `load` along y: theory.md (2.2), exactly."""
    def rates(s: float, u: Array) -> list[float]:
        c, d = np.cos(u[2]), np.sin(u[2])
        stretch, shear = 1.0 + load * d / EA, load * c / GA
        return [stretch * c - shear * d, stretch * d + shear * c, u[3], -load * (stretch * c - shear * d)]

    def bend(curvature: float) -> Array:
        return solve_ivp(rates, (0.0, 1.0), [0.0, 0.0, 0.0, curvature], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]

    root = brentq(lambda curvature: bend(curvature)[3], 0.0, 2.0 * load, xtol=1e-14)
    return tuple(bend(root)[:2])


def slender(slenderness: Array, solver: str = "auto", load: float = 10.0) -> Iterator[Row]:
    """Cantilevers of slenderness length / radius of inertia under a tip load, and under a tip moment that makes a half circle."""
    for ratio in slenderness:
        stiff = ratio * ratio
        of = section(EA=stiff, GA=0.4 * stiff, GJ=1.0, EI=1.0 / 1.2, rhoI=0.0)
        off, said = [], []
        for force, moment, tip in (((0, load, 0), (0, 0, 0), elastica(load, of.EA, of.GA2)),
                                   ((0, 0, 0), (0, 0, np.pi), (0.0, 2.0 / np.pi))):
            beam = fb.Beam.straight("cantilever", (0, 0, 0), (1, 0, 0), section=of, elements=8, degree=4)
            scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=force, moment=moment))
            try:
                found = fb.solve_static(fb.compile_scene(scene, solver=solver))
                off.append(float(np.abs(found.state.q[-12:-10] - tip).max()))
                said.append(f"{off[-1]:.0e} in {found.info['steps']} load steps")
            except fb.ConvergenceError as failed:
                said.append(str(failed)[:80])
        yield Row(f"statics, {solver}, slenderness {ratio:.0e}: tip load; tip moment", "exact, past 1e6 or a message",
                  "; ".join(said), max(off, default=0.0) <= 1e-7 and (ratio > 1e6 or len(off) == 2))


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    step = 6 if quick else 1
    decades = 10.0**np.arange(-6, 7, step)
    base = {"EA": 1e4, "GA": 1e4, "GJ": 500.0, "EI": 500.0}
    for name, value in base.items():
        yield from sweep(f"{name} x", decades, lambda x, name=name, value=value: flight(section(**{name: value * x})))
    inertia = np.concatenate((10.0**np.arange(0, -13, -3 if quick else -1), [0.0]))
    yield from sweep("rhoI x", inertia, lambda x: flight(section(rhoI=0.1 * x)), whole=False)
    yield from sweep("rhoI x, step 1/100,", inertia, lambda x: flight(section(rhoI=0.1 * x)), 0.01 * H, whole=False)
    yield from sweep("rhoI x, clamped,", inertia, lambda x: swing(section(rhoI=0.1 * x)))
    yield from sweep("mass of the bead / of the beam", 10.0**np.arange(-9, 10, step),
                     lambda x: flight(section(), mass=x * LENGTH))
    yield from tones(10.0**np.arange(-6, 7, step))
    yield from heavy_and_light()
    yield from steps(10.0**np.arange(-3, 3.1, 1.0 if quick else 0.5))
    yield from turns()
    yield from slender(10.0**np.arange(1, 8.1, 2 if quick else 1))
    yield from slender(10.0**np.arange(2, 7, 2), "sparse")
