"""Twenty-six analyses of a scene with a feature, each checked against another way to find the same numbers.

What several of them need (a model, a run, an equilibrium) is found once; `forget` begins anew.
"""
from __future__ import annotations

import concurrent.futures
import functools
import multiprocessing
import os
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np

import fastbeam as fb
from perf.feature_scenes import Host, MakesNoSense

RUN = {"t_end": 0.02, "step": 1e-3, "every": 1, "output": fb.Output(snapshots=3), "progress": False}
# stiffness without a symmetry: eigenvalues are not counted
UNSYMMETRIC = ("follower load", "drag with wind")
EVERYTHING = ("energy", "reaction", "section", "slider", "joint", "spring", "velocity", "spin", "acceleration")


class WrongError(Exception):
    """An analysis ended, and its numbers are not right."""


@functools.lru_cache(None)
def host(feature: str, **options: Any) -> Host:
    """Make the arch with a feature."""
    return Host(feature, **options)


@functools.lru_cache(None)
def model(feature: str, planar: Any = "auto", condense: Any = "auto", **options: Any) -> Any:
    """Compile it."""
    return fb.compile_scene(host(feature, **options).scene, planar=planar, condense=condense)


def simulate(feature: str, *, of: Any = None, points: Any = None, **options: Any) -> fb.Result:
    """Run it in time."""
    return fb.simulate(of or model(feature), points=points or host(feature).points, **{**RUN, **options})


@functools.lru_cache(None)
def base(feature: str) -> fb.Result:
    """Run it with order 2."""
    return simulate(feature)


@functools.lru_cache(None)
def rest(feature: str, **options: Any) -> fb.Result:
    """Find its equilibrium."""
    return static(feature, of=model(feature, **options), points=host(feature, **options).points)


def static(feature: str, of: Any = None, points: Any = None, **options: Any) -> fb.Result:
    """Find an equilibrium of a model of it."""
    return fb.solve_static(of or model(feature), points=points or host(feature).points, **timed(feature), **options)


def timed(feature: str) -> dict[str, float]:
    """Arguments for the time of an equilibrium."""
    return {} if host(feature).at_time is None else {"at_time": host(feature).at_time}


def quiet(feature: str, **options: Any) -> dict[str, Any]:
    """Arguments for analyses of the equilibrium."""
    return {"state": rest(feature, **options).state, **timed(feature)}


def check(good: Any, text: str) -> None:
    """Raise WrongError where something is not as it has to be."""
    if not good:
        raise WrongError(text)


def close(got: Any, wanted: Any, tolerance: float, what: str, size: float | None = None) -> None:
    """Check numbers, next to a size or to the largest wanted one."""
    got, wanted = np.asarray(got, float), np.asarray(wanted, float)
    size = np.abs(wanted).max() if size is None else size
    off = np.abs(got - wanted).max() / (size or 1.0)
    check(off <= tolerance, f"{what} off by {off:.2g} of {size:.3g} (got {np.ravel(got)[:4]}, wanted {np.ravel(wanted)[:4]})")


def sound(feature: str, result: fb.Result, books: bool = True, like: float | None = None) -> None:
    """Check that a run went to its end with closed books, and that it ends about where that of order 2 ends."""
    apex = result.point("apex")
    check(np.isfinite(apex).all(), "positions are not finite")
    check(abs(result.t[-1] - RUN["t_end"]) < 1e-9, f"the run ended at t = {result.t[-1]:.4g}: {result.events[-1:]}")
    if books:
        name = "balance" if "balance" in result.series else "total"
        check(result.drift(name) < 1e-9, f"{name} drifts by {result.drift(name):.2g}")
    way = np.abs(base(feature).point("apex") - base(feature).point("apex")[0]).max()
    check(way > 1e-6, "nothing moves")
    if like is not None:
        close(apex[-1], base(feature).point("apex")[-1], like, "end of the run against order 2", way)


def slopes(of: Callable[..., Any], step: float = 2e-4) -> dict[str, Any]:
    """Find derivatives by both parameters from central differences."""
    return {name: (np.asarray(of(**{name: 1 + step})) - np.asarray(of(**{name: 1 - step}))) / (2 * step) for name in ("k", "h")}


def parametric(feature: str) -> Callable[..., Any]:
    """Return a function of the parameters that makes scene and points."""
    def build(k: float = 1.0, h: float = 1.0) -> Any:
        made = Host(feature, k=k, h=h)
        return made.scene, made.points
    return build


def apex_at_rest(feature: str, **options: Any) -> Any:
    """Find the place of the apex in equilibrium."""
    made = Host(feature, **options)
    return static(feature, of=fb.compile_scene(made.scene), points=made.points).point("apex")[-1]


# ---- columns -------------------------------------------------------------------------------------------------------------

def order_2(feature: str) -> None:
    """Run with order 2; the kind of event that belongs to the feature has to come."""
    sound(feature, base(feature))
    kinds = [event["kind"] for event in base(feature).events]
    check(host(feature).expect in (None, *kinds), f"no event {host(feature).expect!r} among {kinds}")


def order_4(feature: str) -> None:
    """Run with order 4."""
    sound(feature, simulate(feature, order=4), like=0.05)


def tolerance(feature: str) -> None:
    """Run with step control."""
    sound(feature, simulate(feature, tolerance=1e-5, step=2e-4), like=0.05)


def rho_inf(feature: str) -> None:
    """Run with a filter."""
    sound(feature, simulate(feature, method=fb.Method(rho_inf=0.8)), like=0.05)


def generalized_alpha(feature: str) -> None:
    """Run with generalized-alpha."""
    sound(feature, simulate(feature, method="generalized_alpha"), books=False, like=0.05)


def observe(feature: str) -> None:
    """Observe everything; the section at the support has the force of its reaction."""
    result = simulate(feature, observe=EVERYTHING)
    sound(feature, result)
    force, pull = result.reaction("foot")["force"], result.section("root")["force"]
    check(np.isfinite(force).all() and np.isfinite(pull).all(), "forces are not finite")
    close(pull, -force, 1e-8, "section at the support against its reaction")


def restart(feature: str) -> None:
    """Go on from a checkpoint: the same bits."""
    # one that ends at its t_end cuts a step, if an impact shifted it
    first = simulate(feature, callback=lambda t, state: t > 0.0095)
    with tempfile.TemporaryDirectory() as folder:
        first.checkpoint.save(f"{folder}/c")
        second = simulate(feature, start=fb.load_checkpoint(f"{folder}/c"))
    check(np.array_equal(second.state.q, base(feature).state.q) and np.array_equal(second.state.v, base(feature).state.v),
          f"other bits, by {np.abs(second.state.q - base(feature).state.q).max():.2g}")


def files(feature: str) -> None:
    """Write files and read them."""
    with tempfile.TemporaryDirectory() as folder:
        base(feature).save(f"{folder}/r.h5")
        again = fb.load_result(f"{folder}/r.h5")
        check(np.array_equal(again.point("apex"), base(feature).point("apex")), "other positions after load_result")
        check(set(again.series) == set(base(feature).series), "other series after load_result")
        again.to_vtk(f"{folder}/r.vtkhdf", surface=True)
        check(os.path.getsize(f"{folder}/r.vtkhdf") > 1000, "nothing in the VTK file")


def solve_static(feature: str) -> None:
    """Find the equilibrium; a run from there stays."""
    found, apex = rest(feature), rest(feature).point("apex")[-1]
    check(np.isfinite(apex).all() and abs(found.t[-1] - 1) < 1e-12, "no load factor 1")
    check(not found.info["unstable_directions"], f"unstable: {found.info['unstable_directions']}")
    t = host(feature).at_time or 0.0
    moved = simulate(feature, start=fb.Start(found.state, time=t), t_end=t + 0.002, step=2e-4)
    if host(feature).at_time is None:
        close(moved.point("apex")[-1], apex, 1e-8, "a run from the equilibrium moves,", 1.0)


def contacts_exact(feature: str) -> None:
    """Find the equilibrium with contacts inside elements."""
    if host(feature).contact is None:
        raise MakesNoSense("no contacts")
    close(static(feature, contacts="exact").point("apex")[-1], rest(feature).point("apex")[-1], 2e-3, "exact against mesh", 1.0)


def solve_path(feature: str) -> None:
    """Follow the path to the equilibrium."""
    more = {"start": rest(feature).state, "load_factor": 0.999} if host(feature).moved else {}
    path = fb.solve_path(model(feature), points=host(feature).points, **timed(feature), **more)
    close(path.point("apex")[-1], rest(feature).point("apex")[-1], 1e-7, "end of the path against solve_static", 1.0)


def critical_loads(feature: str) -> None:
    """Find the load factors next to that of the equilibrium."""
    found = fb.critical_loads(model(feature), state=rest(feature).state, load_factor=0.999 if host(feature).moved else 1.0, n=2,
                              negative=True, **timed(feature))
    close(found.residuals, 0.0 * found.residuals, 1e-8, "residuals of buckling modes", 1.0)


def relax(feature: str) -> None:
    """Relax to the equilibrium."""
    more = {"start": rest(feature).state} if host(feature).moved else {}
    found = fb.relax(model(feature), points=host(feature).points, **timed(feature), **more)
    close(found.point("apex")[-1], rest(feature).point("apex")[-1], 1e-7, "equilibrium against solve_static", 1.0)


def modes(feature: str) -> None:
    """Find six modes."""
    found = fb.modes(model(feature), n=6, **quiet(feature))
    check(np.isfinite(found.frequencies).all() and not found.unstable, "not finite, or unstable")
    check(found.is_complete or feature in UNSYMMETRIC, "not complete")
    check(np.max(found.residuals) < 1e-6, f"residual {np.max(found.residuals):.2g}")


def modes_damped(feature: str) -> None:
    """Find damped modes; a run that begins in the first has its frequency and decay."""
    planar = None if model(feature).not_planar else True
    found = fb.modes(model(feature), n=6, damped=True, planar=planar, **quiet(feature))
    check(np.isfinite(found.rates).all(), "not finite")
    check(np.max(found.rates.real) < 1e-6 * np.max(np.abs(found.rates)), "growing")
    k = int(np.argmax(found.rates.imag > 1.0))
    rate, still = found.rates[k], rest(feature)
    at = still.point("apex")[-1]
    # where an equilibrium takes all of the friction, a run slips at any amplitude, which modes leave out (docs/limits.md)
    slips = any(not joint["sticks"] for joint in still.info.get("friction", {}).values())
    if host(feature).at_time is None and rate.imag > 1.0 and host(feature).expect not in ("let go", "caught") and not slips:
        half = np.pi / rate.imag
        path = simulate(feature, start=found.state(k, amplitude=1e-5), t_end=half, step=half / 60).point("apex") - at
        if np.abs(path).max() > 1e-7:
            wanted, size = -np.exp(rate.real * half) * path[0], float(np.abs(path).max())
            close(path[-1], wanted, 0.03, "half a period of a run in the first mode", size)


def modes_steady(feature: str) -> None:
    """Find modes at 3 rad/s; at 0.001 rad/s those at rest."""
    of, points = model(feature, lateral=0.0), host(feature, lateral=0.0).points
    rates = []
    for rate in (3.0, 1e-3):
        spin = fb.Spin(rate, axis=(0, 0, 1))
        still = fb.solve_static(of, points=points, steady=spin, **timed(feature))
        rates.append(fb.modes(of, state=still.state, steady=spin, n=8, **timed(feature)).rates)
        check(np.isfinite(rates[-1]).all() and np.isfinite(still.point("apex")).all(), "not finite")
    for rate in fb.modes(of, n=3, damped=True, **quiet(feature, lateral=0.0)).rates:
        off = np.abs(rates[1] - rate).min() / abs(rate)
        check(off < 1e-4, f"rate {rate:.6g} at rest has none near it at 0.001 rad/s, off by {off:.2g}")


def frequency_response(feature: str) -> None:
    """Find the response at three frequencies; at 0 it is that of two equilibria."""
    probe = fb.Load("probe", host(feature).apex, force=(0.3, 0, 1.0))
    found = fb.frequency_response(model(feature), [0.0, 3.0, 11.0], loads=probe, points={"apex": host(feature).apex},
                                  **quiet(feature)).point("apex")
    check(np.isfinite(found).all(), "not finite")
    # equilibria slip where a response sticks
    if "friction" not in rest(feature).info:
        a, b = (apex_at_rest(feature, extra=(0.3 * e, 0, e)) for e in (1e-2, -1e-2))
        close(found[0].real, (a - b) / 2e-2, 1e-3, "response at 0 Hz against two equilibria")


def sensitivity(feature: str) -> None:
    """Differentiate the equilibrium."""
    found, fd = fb.sensitivity(parametric(feature), {"k": 1.0, "h": 1.0}, **timed(feature)).point("apex"), slopes(
        lambda **v: apex_at_rest(feature, **v))
    for name, wanted in fd.items():
        close(found[name], wanted, 1e-4, f"derivative by {name}")


def critical(feature: str, **values: float) -> fb.Result:
    """Follow the path to the limit load; with default steps it is left here, with an event."""
    made = Host(feature, **values)
    return fb.solve_path(fb.compile_scene(made.scene), to=20.0, stop_at="limit", most_points=300,
                         step=0.01, largest_step=0.02, **timed(feature))


def critical_sensitivity(feature: str) -> None:
    """Differentiate the limit load."""
    at = critical(feature)
    if not any(point["kind"] == "limit" for point in at.info["critical_points"]):
        raise MakesNoSense("this scene has no limit load")
    found = fb.critical_sensitivity(parametric(feature), {"k": 1.0, "h": 1.0}, state=at.state,
                                    load_factor=at.series["load_factor"][-1], **timed(feature)).by
    for name, wanted in slopes(lambda **v: critical(feature, **v).series["load_factor"][-1], 1e-3).items():
        close(found[name], wanted, 1e-4, f"derivative of the limit load by {name}")


def adjoint_run(feature: str) -> None:
    """Differentiate a run."""
    options = {"t_end": 0.01, "step": 1e-3}
    run = fb.adjoint_run(model(feature), points=host(feature).points, **options)
    close(run.point("apex")[-1], simulate(feature, **options).point("apex")[-1], 1e-9, "end of the run against simulate", 1.0)
    by = run.gradient(points={"apex": (0.5, 0, 1.0)}, build=parametric(feature), values={"k": 1.0, "h": 1.0}).by

    def end(**values: float) -> Any:
        made = Host(feature, **values)
        return simulate(feature, of=fb.compile_scene(made.scene), points=made.points, **options).point("apex")[-1] @ (0.5, 0, 1.0)

    for name, wanted in slopes(end).items():
        close(by[name], wanted, 1e-4, f"gradient by {name}")


def find_lengths(feature: str) -> None:
    """Find the unstressed length that lifts the apex."""
    z, beam = rest(feature).point("apex")[-1][2] + 2e-4, host(feature).left
    found = fb.find_lengths(model(feature), [beam], {("apex", "z"): z}, points=host(feature).points, **timed(feature))
    close(found.point("apex")[-1][2], z, 1e-9, "wanted height", 1.0)
    if not host(feature).is_net:
        made = Host(feature, prestrain=found.info["prestrains"]["left"])
        again = static(feature, of=fb.compile_scene(made.scene), points=made.points, start=found.state)
        close(again.point("apex")[-1][2], z, 1e-7, "height of the scene with these lengths", 1.0)


def stick_interval(feature: str) -> None:
    """Find the interval of loads in which friction holds."""
    if host(feature).friction is None:
        raise MakesNoSense("no Coulomb friction")
    found = fb.stick_interval(model(feature), host(feature).friction, within=(0.0, 3.0), **timed(feature))
    check(found.low <= 1.0 + 1e-9 <= found.high + 2e-9 and found.low < found.high, f"interval {found.low} to {found.high}")


def condensed_net(feature: str) -> None:
    """Run it on a net, condensed and not."""
    points, one, two = host(feature, net=True).points, *(model(feature, net=True, condense=yes) for yes in (True, False))
    a, b = (simulate(feature, of=each, points=points).point("apex") for each in (one, two))
    close(a, b, 1e-8, "condensed against not condensed", np.abs(b - b[0]).max())
    if "condensed beams" not in str(one):
        raise fb.SceneError("condense=True is taken, and nothing is condensed")


def threads_2(feature: str) -> None:
    """Run with two threads."""
    one, two = (simulate(feature, solver=fb.Solver(threads=n)).state.q for n in (1, 2))
    check(np.array_equal(one, two), "other bits with two threads")


def planar_equal(feature: str) -> None:
    """Run in a plane and in space."""
    if not host(feature).planar:
        raise MakesNoSense("moves, or is held, out of a plane, or documented as in space")
    flat, full = model(feature, planar=True), model(feature, planar=False)
    a, b = simulate(feature, of=flat).point("apex"), simulate(feature, of=full).point("apex")
    close(a, b, 1e-8, "run in a plane against in space", np.abs(b - b[0]).max())
    try:
        found = [static(feature, of=each).point("apex")[-1] for each in (flat, full)]
    except fb.SceneError:
        return  # equilibria are another analysis
    close(*found, 1e-8, "equilibrium in a plane against in space", 1.0)


def scene_of(row: str, k: float) -> fb.Scene:
    """Make the scene of a sweep."""
    return Host(row, k=k).scene


def sweep(feature: str) -> None:
    """Run it for two stiffnesses in another process."""
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        table = fb.sweep(scene_of, {"row": [feature], "k": [1.0, 1.1]}, run={"t_end": 0.005, "step": 1e-3}, executor=pool,
                         progress=False)
    check(not table.failures, f"{[r['error'] for r in table.rows]}"[:200])


def pictures(feature: str) -> None:
    """Draw it."""
    with tempfile.TemporaryDirectory() as folder:
        fb.plot_overview(base(feature)).savefig(f"{folder}/a.png")
        fb.animate(base(feature), f"{folder}/a.gif", progress=False)
        check(os.path.getsize(f"{folder}/a.gif") > 1000, "nothing in the film")


def forget() -> None:
    """Forget all runs and equilibria."""
    for kept in (host, model, base, rest):
        kept.cache_clear()


ANALYSES: dict[str, Callable[[str], None]] = {
    "order 2": order_2, "order 4": order_4, "tolerance": tolerance, "rho_inf": rho_inf, "gen. alpha": generalized_alpha,
    "observe": observe, "restart": restart, "save+vtk": files, "static": solve_static, "exact": contacts_exact,
    "path": solve_path, "buckling": critical_loads, "relax": relax,
    "modes": modes, "damped": modes_damped, "steady": modes_steady,
    "response": frequency_response, "sensitivity": sensitivity, "critical": critical_sensitivity, "adjoint": adjoint_run,
    "lengths": find_lengths, "stick": stick_interval, "condensed": condensed_net, "threads": threads_2,
    "planar": planar_equal, "sweep": sweep, "pictures": pictures}
