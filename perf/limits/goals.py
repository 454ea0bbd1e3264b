"""The goals of speed and memory that this project set itself, each beside what this machine reaches now.

    python perf/limits/goals.py                      all goals but the start with an empty cache
    python perf/limits/goals.py --cold               with it (compiles for a minute)
    python perf/limits/goals.py --large              the chain and the nets at their full size, 1e5 and 1e6 elements
    python perf/limits/goals.py --only dgbsv pardiso those whose names contain a word
    python perf/limits/goals.py --quick              small sizes and short measurements
    python perf/limits/goals.py --markdown           the table ready to paste into docs/reports/performance.md

References run in the same process on the same matrices: LAPACK's band solver as SciPy has it, PARDISO on one thread or two, the
step in plain NumPy of perf/cases/plain_step.py. Ratios are therefore worth more than microseconds, which belong to the machine
that the goals were set on (AVX-512, 3.7 GHz). Goals for parts that this project builds in another way say what is there instead.
"""
from __future__ import annotations

import os

# libraries keep to one thread where they are not told otherwise
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from concurrent.futures import ThreadPoolExecutor  # noqa: E402
from dataclasses import asdict, dataclass  # noqa: E402
from functools import cached_property  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.limits import counting, traffic  # noqa: E402
from perf.limits.ceilings import Ceilings, best  # noqa: E402
from perf.limits.parts import ChainParts, iteration, shortest  # noqa: E402
from perf.limits.scaling import chain_scene, number_of_elements  # noqa: E402
from perf.places import private  # noqa: E402
from perf.printing import table  # noqa: E402

Pardiso = private("linsolve", "Pardiso")
load_mkl = private("mkl", "load_mkl")
FACTOR, SOLVE, call_pardiso = private("kernels.sparse", "FACTOR", "SOLVE", "call_pardiso")
Stepper = private("newton", "Stepper")

Array = np.ndarray
STEP = 1e-3
DEGREES = (1, 2, 3)
MANY = 100_000  # elements of a net that is not kept for the next goal


@dataclass(frozen=True)
class Verdict:
    """One line: what is asked for (None: does not apply, `note` says why), what was found, and which of both is to be larger."""

    goal: str
    bound: float | None
    found: float | None
    unit: str = ""
    at_most: bool = True
    note: str = ""

    @property
    def word(self) -> str:
        """met, missed, or a dash."""
        if self.bound is None or self.found is None:
            return "-"
        return "met" if (self.found <= self.bound if self.at_most else self.found >= self.bound) else "missed"

    def cells(self) -> list[str]:
        """One line of the table."""
        bound = "" if self.bound is None else f"{'<=' if self.at_most else '>='} {self.bound:g} {self.unit}".strip()
        found = "" if self.found is None else f"{self.found:.3g} {self.unit}".strip()
        return [self.goal, bound, found, self.word, self.note]


def band(matrix: Array, rows: Array, columns: Array, n_rows: int) -> tuple[Array, int]:
    """LAPACK's storage of blocks [blocks, n, n] at block rows and columns, and its number of diagonals on one side."""
    n = matrix.shape[1]
    k = n * (int(np.max(np.abs(rows - columns))) + 1) - 1
    i = (n * rows[:, None, None] + np.arange(n)[:, None]) + np.zeros((1, 1, n), int)
    j = (n * columns[:, None, None] + np.arange(n)) + np.zeros((1, n, 1), int)
    out = np.zeros((3 * k + 1, n * n_rows), order="F")
    out[2 * k + i - j, j] = matrix
    return out, k


def dgbsv_time(storage: Array, k: int, right: Array, seconds: float) -> tuple[float, Array]:
    """(time of factors and solution, s; solution) of SciPy's dgbsv, without the time of a call with one unknown."""
    from scipy.linalg.lapack import dgbsv
    work, b = storage.copy(order="F"), right.copy()
    tiny, one = np.ones((1, 1), order="F"), np.ones(1)

    def prepare() -> None:
        work[:] = storage
        b[:] = right

    def solve() -> None:
        dgbsv(k, k, work, b, overwrite_ab=True, overwrite_b=True)

    found = shortest(solve, seconds, prepare, lambda: dgbsv(0, 0, tiny, one, overwrite_ab=True, overwrite_b=True))
    prepare()
    x, info = dgbsv(k, k, work, b)[2:]
    if info:
        raise SystemExit("dgbsv: the matrix is singular")
    return found, x


def pardiso_time(parts: ChainParts, seconds: float) -> float | None:
    """The same of PARDISO on one thread, None without MKL."""
    mkl = load_mkl()
    if mkl is None:
        return None
    pattern = parts.model.pattern
    solver = Pardiso(mkl, np.searchsorted(pattern.rows, np.arange(pattern.n + 1)), pattern.columns, 1, parts.n, 1)
    t = solver.tables
    t.data[:], t.b[0] = parts.matrix().reshape(-1), parts.right()

    def solve() -> None:
        if call_pardiso(t, FACTOR, t.b, t.x) or call_pardiso(t, SOLVE, t.b, t.x):
            raise SystemExit("PARDISO failed: nothing was measured")

    with solver.threads():
        found = shortest(solve, seconds)
    same(parts.solution(), t.x[0], "PARDISO")
    return found


def same(a: Array, b: Array, whose: str) -> None:
    """Two solutions of one system.

    Raises
    ------
    SystemExit
        They differ: the times would not be comparable.
    """
    if not np.max(np.abs(a - b)) <= 1e-7 * np.max(np.abs(b)):
        raise SystemExit(f"the solutions of block elimination and {whose} differ: nothing was compared")


class Measurements:
    """Everything that several goals need, measured once.

    Parameters
    ----------
    seconds : float
        Of one measurement.
    quick, large : bool
        Sizes.
    """

    def __init__(self, seconds: float, quick: bool, large: bool) -> None:
        self.seconds, self.quick, self.large = seconds, quick, large
        self.ceilings = Ceilings(2.0**25) if quick else Ceilings()
        self._whole: dict[tuple[int, int], float] = {}
        self._nets: dict[tuple[int, int, int, int], tuple[Stepper, float]] = {}

    @property
    def sizes(self) -> tuple[int, ...]:
        """Elements of short chains."""
        return (20,) if self.quick else (20, 200, 1000)

    def whole(self, elements: int, degree: int) -> float:
        """Time of a Newton iteration of a chain, s."""
        if (elements, degree) not in self._whole:
            model = fb.compile_scene(chain_scene(elements, degree), planar=False)
            stepper = Stepper(model, np.ones(1), threads=1)
            stepper.advance(0.0, STEP, 2)
            self._whole[elements, degree] = iteration(stepper, STEP, self.seconds)[0]
        return self._whole[elements, degree]

    @cached_property
    def solvers(self) -> dict[tuple[int, int], tuple[float, float, float | None]]:
        """(block elimination, dgbsv, PARDISO), s, of the chain with all its nodes, by (elements, degree)."""
        out = {}
        for degree in DEGREES:
            for elements in self.sizes:
                model = fb.compile_scene(chain_scene(elements, degree), planar=False, eliminate_inner=False, condense=False)
                parts, pattern = ChainParts(model, STEP), model.pattern
                storage, k = band(parts.matrix(), pattern.rows, pattern.columns, pattern.n)
                spent, x = dgbsv_time(storage, k, parts.right(), self.seconds)
                same(parts.solution(), x, "dgbsv")
                out[elements, degree] = parts.elimination_time(self.seconds), spent, pardiso_time(parts, self.seconds)
        return out

    @cached_property
    def kernels(self) -> dict[int, tuple[float, float, float]]:
        """(evaluation, s; evaluation with assembly, s; operations), of an element, by degree, in a chain of 200 elements without
        elimination of inner nodes."""
        out = {}
        for degree in DEGREES:
            elements = 200
            model = fb.compile_scene(chain_scene(elements, degree), planar=False, eliminate_inner=False, condense=False)
            parts = ChainParts(model, STEP)
            out[degree] = (parts.element_time(self.seconds, False) / elements, parts.element_time(self.seconds) / elements,
                           counting.element_kernel(model, 1.0))
        return out

    def net(self, cells: int, per_beam: int, degree: int, threads: int) -> tuple[Stepper, float]:
        """(stepper of a condensed net, time of a Newton iteration by the clock on the wall, s)."""
        from perf.cases.net_step import square_net
        key = cells, per_beam, degree, threads
        if key not in self._nets:
            model = next((s.model for (c, e, p, _), (s, _) in self._nets.items() if (c, e, p) == key[:3]), None)
            model = model or fb.compile_scene(square_net(cells, per_beam, degree, "rigid"), planar=False, condense=True)
            stepper = Stepper(model, np.ones(1), threads=threads)
            spent = []

            def step() -> None:
                begin = time.perf_counter()
                outcome = stepper.advance(0.0, STEP, 1)
                if outcome.steps != 1:
                    raise SystemExit(f"the step of the net failed with status {outcome.status}: nothing was measured")
                spent.append((time.perf_counter() - begin) / outcome.iterations)

            step()
            spent.clear()
            end = time.perf_counter() + self.seconds
            while len(spent) < 3 or time.perf_counter() < end:
                step()
            if number_of_elements(model) > MANY:
                return stepper, min(spent)
            self._nets[key] = stepper, min(spent)
        return self._nets[key]


# --- goals ------------------------------------------------------------------------------------------------------------
def against_dgbsv(m: Measurements) -> list[Verdict]:
    return [Verdict(f"block elimination / dgbsv, same band, {n} elements, degree {p}", 0.30, own / lapack)
            for (n, p), (own, lapack, _) in m.solvers.items()]


def against_pardiso(m: Measurements) -> list[Verdict]:
    return [Verdict(f"block elimination / PARDISO on one thread, {n} elements, degree {p}", 0.13,
                    None if pardiso is None else own / pardiso, note="no MKL" if pardiso is None else "")
            for (n, p), (own, _, pardiso) in m.solvers.items()]


def iteration_against_dgbsv(m: Measurements) -> list[Verdict]:
    return [Verdict(f"whole Newton iteration / dgbsv of all nodes, {n} elements, degree {p}", 0.60, m.whole(n, p) / lapack)
            for (n, p), (_, lapack, _) in m.solvers.items() if n <= 200]


def whole_iteration(m: Measurements) -> list[Verdict]:
    from perf.cases.step_time import spinning_beam
    out = []
    for n, bound in ((20, 12.0), (200, 105.0)):
        if n in m.sizes:
            stepper = Stepper(spinning_beam(2, n)[1], np.ones(1))
            stepper.advance(0.0, 0.01, 2)
            spent = iteration(stepper, 0.01, m.seconds)[0]
            for what, seconds in (("free beam of perf/cases/step_time.py", spent), ("slender chain between pins", m.whole(n, 2))):
                out.append(Verdict(f"whole Newton iteration, {n} elements, degree 2, {what}", bound, 1e6 * seconds, "us",
                                   note="with its share of what begins and ends a step"))
    for (n, p), (_, _, pardiso) in m.solvers.items():
        if n <= 200:
            out.append(Verdict(f"PARDISO's factors and solution of all nodes, one thread / whole Newton iteration, {n} elements, "
                               f"degree {p}", 4.0, None if pardiso is None else pardiso / m.whole(n, p), at_most=False,
                               note="no MKL" if pardiso is None else ""))
    return out


def kernel_time(m: Measurements) -> list[Verdict]:
    why = "strains (2.2), six of them with three directors, and the stresses of (4.6); the bound was set for (2.1)"
    return [Verdict(f"evaluation and assembly of an element, eight of a chain at a time, degree {p}", bound,
                    1e6 * m.kernels[p][1], "us", note=why) for p, bound in zip(DEGREES, (0.06, 0.17, 0.30))]


def kernel_rate(m: Measurements) -> list[Verdict]:
    share = 1e-9 * m.kernels[3][2] / m.kernels[3][0] / m.ceilings.peak()
    stepper, _ = m.net(4, 20, 3, 1)
    stepper.parts.start(STEP)
    operations = counting.condensed_beams(stepper, float(stepper.work.increment.control[0])) - counting.recovery_of_beams(stepper)
    spent = shortest(lambda: stepper.parts.assemble(STEP), m.seconds)
    return [Verdict("evaluation of an element, share of the peak of multiply-adds, degree 3", 0.60, share, at_most=False,
                    note="operations of the source, in cache, before anything is added up"),
            Verdict("evaluation and condensation of beams, eight beams at a time, the same share, degree 3", 0.60,
                    1e-9 * operations / spent / m.ceilings.peak(), at_most=False, note="with the calls from Python around it")]


def naive(m: Measurements) -> list[Verdict]:
    from perf.cases.plain_step import PlainBeam
    elements = 200
    scene = chain_scene(elements, 3)
    model = fb.compile_scene(scene, planar=False)
    plain = PlainBeam(scene.beams[0], model.q0.reshape(-1, 4, 3), model.v0.reshape(-1, 4, 3))
    dq = 1e-6 * np.random.default_rng(0).standard_normal(plain.q.shape)
    spent = shortest(lambda: plain.system(dq, STEP), m.seconds) / elements
    return [Verdict("evaluation and assembly with NumPy / here, degree 3", 30.0, spent / m.kernels[3][1], at_most=False,
                    note="perf/cases/plain_step.py: batched products, triplets to CSR")]


def lanes(m: Measurements) -> list[Verdict]:
    return [Verdict("eight lanes against one lane of the same source", None, None,
                    note="does not apply: kernels are written for eight lanes only, one element costs as much as eight")]


def assembly(m: Measurements) -> list[Verdict]:
    return [Verdict(f"assembly, share of evaluation and assembly, degree {p}", 0.15, max(added - plain, 0.0) / added)
            for p, (plain, added, _) in m.kernels.items()]


def steps_a_second(m: Measurements) -> list[Verdict]:
    return [Verdict(f"steps a second, 20 elements, four iterations, degree {p}", bound, 0.25 / m.whole(20, p), at_most=False)
            for p, bound in zip(DEGREES, (40_000.0, 24_000.0, 16_000.0))]


def python_share(m: Measurements) -> list[Verdict]:
    steps = 2000 if m.quick else 20_000
    model = fb.compile_scene(chain_scene(20, 2), planar=False)
    stepper = Stepper(model, np.ones(1))
    start = stepper.copy_state()

    def compiled() -> None:
        stepper.set_state(start)
        stepper.advance(0.0, STEP, steps)

    def whole() -> None:
        fb.simulate(model, t_end=steps * STEP, step=STEP, observe=(), output=fb.Output(snapshots=0), progress=False)

    run, loop = best(whole, repeats=3), best(compiled, repeats=3)
    return [Verdict(f"what a run of {steps} steps adds to its compiled loop, 20 elements", 0.01, max(run - loop, 0.0) / run,
                    note="no observers; includes preparing the run")]


def long_chain(m: Measurements) -> list[Verdict]:
    elements = 100_000 if m.large else 2000 if m.quick else 20_000
    degrees = (2,) if m.quick else DEGREES
    return [Verdict(f"a Newton iteration of {elements} elements in a chain, per element, degree {p}", bound,
                    1e6 * m.whole(elements, p) / elements, "us") for p, bound in zip(DEGREES, (0.35, 0.6, 0.9)) if p in degrees]


def nets(m: Measurements) -> list[Verdict]:
    out = []
    sizes = ((70, 100), (70, 10)) if m.large else ((4, 20), (8, 10)) if m.quick else ((20, 100), (60, 10))
    for (cells, per_beam), bounds in zip(sizes, ((0.25, 0.5), (0.4, 0.7))):
        for degree, bound in zip((1, 3), bounds):
            if m.quick and degree == 3:
                continue
            stepper, spent = m.net(cells, per_beam, degree, 2)
            n = number_of_elements(stepper.core)
            note = "factors at the joints are kept for a step, the bound was set for longer" if per_beam == 10 else ""
            out.append(Verdict(f"a Newton iteration of a net, {n} elements, {per_beam} a beam, two threads, per element, degree "
                               f"{degree}", bound, 1e6 * spent / n, "us", note=note))
            # room for the next
            del stepper
    return out


def condensed(m: Measurements) -> list[Verdict]:
    from perf.cases.net_step import solver, square_net
    cells, per_beam = (70, 10) if m.large else (8, 10) if m.quick else (40, 10)
    if load_mkl() is None:
        return [Verdict("iteration of a condensed net / PARDISO on all its nodes", 0.4, None, note="no MKL")]
    whole = fb.compile_scene(square_net(cells, per_beam, 1, "rigid"), solver="sparse", condense=False, eliminate_inner=False,
                             planar=False)
    threads = 1 if m.quick else 2
    pardiso = solver(whole, threads)
    spent = min(pardiso() for _ in range(3))
    stepper, own = m.net(cells, per_beam, 1, threads)
    return [Verdict(f"iteration of a condensed net / PARDISO's factors and solution of all its nodes, "
                    f"{number_of_elements(stepper.core)} elements, {per_beam} a beam, {threads} threads", 0.4, own / spent)]


def two_threads(m: Measurements) -> list[Verdict]:
    out = []
    small, beyond = ((4, 20), (6, 20)) if m.quick else ((4, 20), (20, 100))
    for (cells, per_beam), bound, where in ((small, 1.8, "in the caches"), (beyond, 1.5, "beyond the caches")):
        times = []
        for threads in (1, 2):
            stepper, _ = m.net(cells, per_beam, 1, threads)
            stepper.parts.start(STEP)
            times.append(shortest(lambda: stepper.parts.assemble(STEP), m.seconds))
        out.append(Verdict(f"evaluation and condensation, two threads against one, {number_of_elements(stepper.core)} elements, "
                           f"{where}", bound, times[0] / times[1], at_most=False, note="needs a quiet machine"))
    return out


def memory(m: Measurements) -> list[Verdict]:
    out = []
    for degree, bound in zip(DEGREES, (1.4, 2.2, 3.2)):
        elements = 2000
        stepper = Stepper(fb.compile_scene(chain_scene(elements, degree), planar=False), np.ones(1))
        out.append(Verdict(f"memory of an element of a chain, matrix and factors, degree {degree}", bound,
                           1e-3 * traffic.kept(stepper)["factors"] / elements, "kB"))
    elements = 2000 if m.quick else 20_000
    stepper = Stepper(fb.compile_scene(chain_scene(elements, 2), planar=False), np.ones(1), threads=1)
    kept = traffic.kept(stepper)
    tables = traffic.nbytes(stepper.core.simo, stepper.core.reference_strains)
    sizes = {"matrix, factors and tables of elements": kept["factors"] + tables,
             "all arrays": sum(kept.values())}
    out += [Verdict(f"memory of an element of a chain of {elements}, {what}, degree 2", 2.5, 1e-3 * size / elements, "kB")
            for what, size in sizes.items()]
    return out


def net_on_two_threads(m: Measurements) -> list[Verdict]:
    from perf.cases.net_step import iteration as one_step
    from perf.cases.net_step import square_net
    out = []
    sizes = [(6, 20, 1)] if m.quick else [(31, 50, 2), (71, 10, 1)]
    for cells, per_beam, degree in sizes + ([(71, 100, 1)] if m.large else []):
        model = fb.compile_scene(square_net(cells, per_beam, degree, "rigid"), planar=False, condense=True)
        # in turn: the machine is faster in one minute than in the next; and two runs at once, for what it gives at all
        alone, two = [one_step(model, 1) for _ in range(2)], one_step(model, 2)
        rounds = 4 if m.quick else 12
        with ThreadPoolExecutor(2) as pool:
            times = np.array([[alone[0](), two(), 0.5 * sum(pool.map(lambda run: run(), alone))] for _ in range(rounds)])
        ratio, given = np.median(times[:, :1] / times[:, 1:] * (1.0, 2.0), axis=0)
        out.append(Verdict(f"a Newton iteration of a net, one thread / two, {number_of_elements(model)} elements, {per_beam} a "
                           f"beam, degree {degree}", 1.7, float(ratio), at_most=False,
                           note=f"two runs of one thread at once: {given:.2f}; medians of {rounds} in turn"))
    return out


def start_up(m: Measurements) -> list[Verdict]:
    from perf.suite.regression import fresh
    fresh()
    times = np.array([fresh() for _ in range(1 if m.quick else 5)]).min(axis=0)
    return [Verdict("import fastbeam", 0.1, float(times[0]), "s"),
            Verdict("import to first step with a slider, kernels in the cache", 0.8, float(times[1]), "s")]


def cold_start(m: Measurements) -> list[Verdict]:
    from perf.suite.regression import cold_start as cold
    return [Verdict("import to first step with a slider, empty cache", 3.0, cold()["first step"][0], "s")]


GOALS: dict[str, Callable[[Measurements], list[Verdict]]] = {
    "dgbsv": against_dgbsv, "pardiso": against_pardiso, "iteration": iteration_against_dgbsv, "whole": whole_iteration,
    "kernel time": kernel_time, "kernel rate": kernel_rate, "naive kernel": naive, "lanes": lanes, "assembly": assembly,
    "steps": steps_a_second, "python": python_share, "long chain": long_chain, "nets": nets, "condensed": condensed,
    "two threads": two_threads, "net threads": net_on_two_threads, "memory": memory, "start": start_up, "cold": cold_start}


def chosen(words: list[str] | None, cold: bool) -> list[str]:
    """Goals that contain a word, or all, those of an empty cache only where `cold`.

    Raises
    ------
    SystemExit
        There is none.
    """
    names = [name for name in GOALS if (any(word in name for word in words) if words else cold or name != "cold")]
    if not names:
        raise SystemExit(f"no goal contains {words}: choose from {', '.join(GOALS)}")
    return names


HEADER = ["goal", "asked for", "found", "", "note"]


def main() -> int:
    """Measure and print; with --strict the number of goals that were missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="WORD", help="goals whose names contain a word; --list names them")
    parser.add_argument("--list", action="store_true", help="name the goals and end")
    parser.add_argument("--cold", action="store_true", help="also the start with an empty cache, which compiles for a minute")
    parser.add_argument("--large", action="store_true", help="chain and nets at the sizes that the goals were set for")
    parser.add_argument("--quick", action="store_true", help="small sizes and short measurements")
    parser.add_argument("--seconds", type=float, help="time of one measurement, default 0.5")
    parser.add_argument("--strict", action="store_true", help="exit with the number of missed goals")
    parser.add_argument("--markdown", action="store_true", help="print the table as it stands in docs/reports/performance.md")
    parser.add_argument("--json", type=Path, help="write all values to this file")
    options = parser.parse_args()
    if options.list:
        print("\n".join(GOALS))
        return 0
    names = chosen(options.only, options.cold)
    m = Measurements(options.seconds or (0.02 if options.quick else 0.5), options.quick, options.large)
    found = [verdict for name in names for verdict in GOALS[name](m)]
    print(table(HEADER, [verdict.cells() for verdict in found], options.markdown, left=range(len(HEADER))))
    if options.json:
        from perf.machine import machine
        rows = [asdict(verdict) | {"verdict": verdict.word} for verdict in found]
        options.json.write_text(json.dumps({"machine": machine(), "goals": rows}, indent=1) + "\n")
    return sum(verdict.word == "missed" for verdict in found) if options.strict else 0


if __name__ == "__main__":
    raise SystemExit(main())
