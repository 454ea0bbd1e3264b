"""Small cases for perf/suite/same_bits.py: every feature of perf/feature_scenes.py in time and at rest, every analysis of some.

An analysis is a function that returns what it found; `found_in` turns that into hashes of its numbers. Only public names are
used, so that older revisions can be compared.
"""
from __future__ import annotations

import hashlib
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import fastbeam as fb
from perf.feature_scenes import FEATURES, Host, section_of

warnings.filterwarnings("ignore")
Hashes = dict[str, str]
STEP, STEPS = 1e-3, 20
SEEN = ("energy", "momentum", "slider", "joint", "spring", "velocity", "spin", "orientation", "acceleration", "section",
        "reaction")
# of a result: what a clock or the machine says
NOT_BITS = ("wall_time", "time", "seconds", "threads", "memory", "version", "versions", "checkpoint")
CASES: dict[str, Callable[[], Any]] = {}


# --- hashes of what was found ----------------------------------------------------------------------------------------------
def found_in(found: Any) -> Hashes:
    """Names of numbers to hashes of their bits; names of one level below a result stand together."""
    parts: dict[str, Any] = {}
    for path, data in _numbers(found, ()):
        name = "/".join(path[:2])
        parts.setdefault(name, hashlib.sha256()).update("/".join(path).encode() + data)
    return {name: digest.hexdigest()[:12] for name, digest in sorted(parts.items())}


def _numbers(thing: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], bytes]]:
    if isinstance(thing, (bool, int, float, complex, np.number, np.bool_)):
        yield path, repr(complex(thing)).encode()
    elif isinstance(thing, np.ndarray):
        if thing.dtype.kind in "biufc":
            yield path, f"{thing.dtype}{thing.shape}".encode() + thing.tobytes()
    elif isinstance(thing, fb.Result):
        held = ("t", "series", "t_snap", "phi", "directors", "velocities", "spins", "info", "state")
        yield from _numbers({name: getattr(thing, name, None) for name in held}, path)
        for k, event in enumerate(thing.events):
            yield (*path, "events", str(k)), str(event.get("kind")).encode()
            yield from _numbers(event, (*path, "events", str(k)))
    elif isinstance(thing, Mapping):
        for name, value in sorted((str(name), value) for name, value in thing.items()):
            if name not in NOT_BITS:
                yield from _numbers(value, (*path, name))
    elif hasattr(thing, "_fields"):
        yield from _numbers(thing._asdict(), path)
    elif isinstance(thing, (list, tuple)):
        for k, value in enumerate(thing):
            yield from _numbers(value, (*path, str(k)))
    elif hasattr(thing, "__dict__") and len(path) < 3:
        yield from _numbers({name: value for name, value in vars(thing).items() if name[0] != "_"
                             and isinstance(value, (np.ndarray, list, tuple, dict, float, int, complex))}, path)


# --- features --------------------------------------------------------------------------------------------------------------
ARCH = "planar beam"


def arch(feature: str = ARCH, side: float = 0.05, **options: Any) -> Host:
    """Make an arch with a feature, pushed out of its plane, too."""
    return Host(feature, extra=(0.0, side, 0.0), **options)


def run(made: Host, planar: bool = False, **options: Any) -> fb.Result:
    """Run an arch for a short time."""
    options = {"t_end": STEPS * STEP, "step": STEP, "observe": SEEN, "every": 2, "snapshots": 3, "progress": False,
               "points": made.points, **options}
    return fb.simulate(model_of(made, planar), **options)


def model_of(made: Host, planar: bool = False) -> Any:
    """Compile the scene of an arch."""
    return fb.compile_scene(made.scene, planar=planar)


def rest(made: Host, planar: bool = False, **options: Any) -> fb.Result:
    """Find the equilibrium of an arch."""
    at = {} if made.at_time is None else {"at_time": made.at_time}
    observe = ("energy", "section", "reaction")
    return fb.solve_static(model_of(made, planar), points=made.points, observe=observe, **at, **options)


def moved_and_at_rest(feature: str, side: float = 0.05, planar: bool = False) -> dict[str, Any]:
    """Run an arch with a feature, and find its equilibrium or why there is none."""
    made = arch(feature, side)
    return {"run": run(made, planar), "static": or_why_not(partial(rest, made, planar))}


def or_why_not(what: Callable[[], Any]) -> Any:
    """Return what a function returns, or the kind of its failure."""
    try:
        return what()
    except (fb.SceneError, fb.ConvergenceError) as trouble:
        return {type(trouble).__name__: 1}


CASES.update({name: partial(moved_and_at_rest, name) for name in FEATURES})
CASES.update({f"in a plane: {name}": partial(moved_and_at_rest, name, 0.0, True)
              for name in (ARCH, "revolute friction", "slider Coulomb")})


# --- nets ------------------------------------------------------------------------------------------------------------------
def net(condense: bool, slider: bool = False) -> dict[str, Any]:
    """A net of 4 x 4 cells that sags, with a mass that slides on one of its beams."""
    k = np.arange(25).reshape(5, 5)
    x, y = np.divmod(k, 5)
    nodes = np.stack((x, y, 0.1 * np.sin(k)), axis=-1).reshape(-1, 3)
    edges = np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])
    knots = fb.Net("net", nodes, edges, section=section_of(3.0), elements=4, degree=2, pins=np.arange(5))
    scene = fb.Scene(knots, gravity=(0, 0, -9.81))
    if slider:
        mass = fb.PointMass("mass", mass=0.05)
        scene.add(mass, fb.Slider("s", mass, knots.beam(7), at=0.45 * float(knots.lengths[7]), rate=0.3))
    model = fb.compile_scene(scene, condense=condense)
    return {f"threads {threads}": fb.simulate(model, t_end=10 * STEP, step=STEP, threads=threads, progress=False, snapshots=3)
            for threads in (1, 2)}


CASES.update({"net": partial(net, False), "net, condensed": partial(net, True), "net with a slider": partial(net, False, True),
              "net with a slider, condensed": partial(net, True, True)})


# --- analyses --------------------------------------------------------------------------------------------------------------
def analysis(act: Callable[[], Any]) -> Callable[[], Any]:
    """Add the case of an analysis, named after its function."""
    CASES[act.__name__.replace("_", " ")] = act
    return act


SLIDER, RUBBED, HINGE = "slider frictionless", "slider Coulomb", "revolute spring+damper"
PROBE = {"force": (0.3, 0, 1.0)}


@cache
def quiet(feature: str) -> tuple[Host, Any, Any]:
    """An arch with a feature, its model, and its state at rest."""
    made = arch(feature)
    model = model_of(made)
    return made, model, fb.solve_static(model).state


def of_each(act: Callable[[Host, Any, Any], Any], *names: str) -> dict[str, Any]:
    """What an analysis finds of some arches at rest."""
    return {name: act(*quiet(name)) for name in names}


def family(feature: str) -> Callable[..., Any]:
    """Return an arch as a function of its stiffness and height."""
    def build(k: float = 1.0, h: float = 1.0) -> Any:
        made = arch(feature, k=k, h=h)
        return made.scene, made.points
    return build


@analysis
def methods_compared() -> dict[str, Any]:
    return {method: run(arch(SLIDER), method=method, observe=("energy", "slider"))
            for method in ("midpoint", "generalized_alpha")}


@analysis
def order_4() -> dict[str, Any]:
    return {"arch": run(arch(), order=4), "slider": run(arch(SLIDER), order=4),
            "dissipation": or_why_not(lambda: run(arch(), order=4, rho_inf=0.8))}


@analysis
def step_control() -> dict[str, Any]:
    return {"arch": run(arch(), tolerance=1e-5, step=2e-4), "rubbed": run(arch(RUBBED), tolerance=1e-5, step=2e-4)}


@analysis
def dissipation() -> Any:
    return run(arch(), rho_inf=0.8, observe=("energy", "momentum"))


@analysis
def backends() -> dict[str, Any]:
    of = {"arch": arch(), "slider": arch(SLIDER)}
    return {name: run(made, backend="superlu") for name, made in of.items()} | {
        f"{name} at rest": rest(made, backend="superlu") for name, made in of.items()}


@analysis
def restart() -> Any:
    made = arch("slider rigid stops")
    first = run(made, callback=lambda t, state: t > 0.0095)
    with tempfile.TemporaryDirectory() as folder:
        first.checkpoint.save(Path(folder) / "c")
        second = run(made, start=fb.load_checkpoint(Path(folder) / "c"))
        second.save(Path(folder) / "r.h5")
        return {"first": first, "second": second, "file": fb.load_result(Path(folder) / "r.h5")}


@analysis
def exact_contacts() -> Any:
    return rest(arch(SLIDER), contacts="exact")


@analysis
def paths_of_equilibria() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.solve_path(model, points=made.points, observe=("energy",)),
                   ARCH, SLIDER, HINGE)


@analysis
def limit_load() -> dict[str, Any]:
    options: dict[str, Any] = {"to": 20.0, "stop_at": "limit", "most_points": 300, "step": 0.01, "largest_step": 0.02}
    made = arch()
    path = fb.solve_path(model_of(made), points=made.points, **options)
    return {"path": path, "slopes": fb.critical_sensitivity(family(ARCH), {"k": 1.0, "h": 1.0}, state=path.state,
                                                            load_factor=float(path.series["load_factor"][-1]))}


@analysis
def bifurcation() -> Any:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section_of(), elements=4)
    scene = fb.Scene(column, fb.Clamp(column.start), fb.Load("top", column.end, force=(0, 0, -1)))
    return fb.solve_path(fb.compile_scene(scene, planar=False), to=6.0, stop_at="bifurcation", points={"top": column.end})


@analysis
def dynamic_relaxation() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.relax(model, points=made.points), ARCH, SLIDER)


@analysis
def vibrations() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.modes(model, state=state, n=6), ARCH, SLIDER, HINGE)


@analysis
def damped_vibrations() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.modes(model, state=state, n=4, damped=True), ARCH, SLIDER, "damper")


@analysis
def steady_motion() -> dict[str, Any]:
    made = arch(side=0.0, lateral=0.0)
    model, spin = model_of(made), fb.Spin(3.0, axis=(0, 0, 1))
    still = fb.solve_static(model, points=made.points, steady=spin)
    return {"static": still, "modes": fb.modes(model, state=still.state, steady=spin, n=6)}


@analysis
def response_to_frequencies() -> dict[str, Any]:
    return of_each(lambda made, model, state: fb.frequency_response(
        model, [0.0, 3.0, 11.0], loads=fb.Load("probe", made.apex, **PROBE), points={"apex": made.apex}, state=state,
        damping_ratio=0.01, shapes=True), ARCH, SLIDER, HINGE)


@analysis
def derivatives_of_equilibria() -> dict[str, Any]:
    out = {}
    for name in (ARCH, SLIDER):
        found = fb.sensitivity(family(name), {"k": 1.0, "h": 1.0}, observe=("energy", "section"))
        out[name] = {"point": found.point("apex"), "energy": found.energy(), "section": found.section("root"),
                     "frequencies": found.frequencies(n=3), "gradient": found.gradient(points={"apex": (0.5, 0, 1.0)})}
    return out


@analysis
def derivatives_of_runs() -> dict[str, Any]:
    out = {}
    for name in (ARCH, RUBBED, HINGE):
        made = arch(name)
        found = fb.adjoint_run(model_of(made), points=made.points, t_end=0.01, step=STEP)
        out[name] = {"point": found.point("apex"), "gradient": found.gradient(points={"apex": (0.5, 0, 1.0)}, build=family(name),
                                                                              values={"k": 1.0, "h": 1.0})}
    return out


@analysis
def unknown_lengths() -> Any:
    made, model, state = quiet(ARCH)
    apex = fb.solve_static(model, points=made.points).point("apex")[-1]
    return fb.find_lengths(model, [made.left], {("apex", "z"): float(apex[2]) + 2e-4}, points=made.points)


@analysis
def interval_of_sticking() -> Any:
    return fb.stick_interval(quiet(RUBBED)[1], "s", within=(0.0, 3.0))


@analysis
def rest_intervals() -> Any:
    return rest(arch(RUBBED), rest_intervals=True)


@analysis
def force_densities() -> Any:
    nodes = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0), (1, -1, 0)], dtype=float)
    return fb.force_density(nodes, [(0, 1), (1, 2), (1, 3), (1, 4)], [1.0, 2.0, 1.0, 3.0], [0, 2, 3, 4], loads=[(0, 0, -1.0)] * 5)


@analysis
def forces_in_sections() -> Any:
    made = arch(SLIDER)
    model = model_of(made)
    return fb.section_forces(model, fb.simulate(model, t_end=10 * STEP, step=STEP, progress=False), made.left)


@analysis
def impacts() -> dict[str, Any]:
    """Longer than others: stops and one-sided contact are met again and again."""
    return {name: run(arch(name), t_end=0.1) for name in ("slider rigid stops", "slider one-sided", "revolute rigid stops")}
