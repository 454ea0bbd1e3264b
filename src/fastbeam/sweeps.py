"""Many runs at once: `sweep` hands cases to the processes of an executor and gathers a table of their results."""
from __future__ import annotations

import itertools
import json
import math
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union, overload

import numpy as np

from fastbeam.compile.compile import compile_scene
from fastbeam.dynamics.options import OLD, Method, Output, Solver, Start, StepControl, grouped
from fastbeam.dynamics.time_loop import simulate
from fastbeam.interface.arguments import Anything, Count, FilePath, Flag, Function, Names, Word, checked, real, shown
from fastbeam.interface.deprecation import regroup
from fastbeam.interface.errors import BackendError, ResultFileError, SceneError
from fastbeam.interface.result_warnings import MOST, Doubts, warns
from fastbeam.linalg.mkl import OnThreads, load_mkl
from fastbeam.model.model import Model
from fastbeam.results.exports import import_pandas
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result
from fastbeam.results.sweep_file import Row, SweepFile, let_go, read_sweep
from fastbeam.scene import Scene

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from pandas import DataFrame

# result of a case: numbers, texts and arrays by names, or one; and what `build` may return
Measured = Union[Mapping[str, Union["ArrayLike", None]], "ArrayLike", None]
Built = Union[Scene, Model, Result, Measured]
MOST_CASES = 10**6
# runs that wait for a free worker, of each; from how many runs of a worker on the first one compiles the kernels for all
AHEAD, MANY = 4, 8
# quantities of a run that are kept where nothing else is measured
FACTS = ("total", "balance", "lin_mom", "ang_mom", "gap")


class Sweep(Doubts):
    """Results of a sweep: a table with a row for every case, in the order of the cases.

    Attributes
    ----------
    rows : list of dict
        'run' (the number of the case), the case, what was measured, and 'error': None, or what went wrong, in one line.
    arrays : list of dict
        Arrays of every row that were measured, by name; for runs all their series, as 'series_total', and 'series_t', their
        times.
    tracebacks : dict
        Number of a case that failed -> where, as a text.
    doubts : dict
        Number of a case -> events of its run that say where numbers are not to be trusted, as texts.
    missing : list of int
        Cases that were not run; there are some in files of sweeps that were cut short.
    """

    def __init__(self, rows: list[Row], n_cases: int) -> None:
        rows = sorted(rows, key=lambda row: row["run"])
        self.rows: list[dict[str, object]] = [{"run": row["run"], **row["case"], **row["values"], "error": row["error"]}
                                              for row in rows]
        self.arrays: list[dict[str, np.ndarray]] = [row["arrays"] for row in rows]
        self.tracebacks: dict[int, str] = {row["run"]: row["traceback"] for row in rows if row.get("traceback")}
        self.doubts: dict[int, list[str]] = {row["run"]: row["doubts"] for row in rows if row.get("doubts")}
        self.missing = sorted(set(range(n_cases)) - {row["run"] for row in rows})

    @property
    def failures(self) -> list[dict[str, object]]:
        """The rows of cases that failed."""
        return [row for row in self.rows if row["error"] is not None]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[dict[str, object]]:
        return iter(self.rows)

    @overload
    def __getitem__(self, k: int) -> dict[str, object]: ...

    @overload
    def __getitem__(self, k: slice) -> list[dict[str, object]]: ...

    def __getitem__(self, k: int | slice) -> dict[str, object] | list[dict[str, object]]:
        return self.rows[k]

    @checked(name=Word())
    def column(self, name: str) -> np.ndarray:
        """Return a column of numbers as an array [rows], float64; NaN where a case has no number there, because it failed for
        instance.

        Raises
        ------
        SceneError
            No case has a number of this name.
        """
        found = [real(row.get(name)) for row in self.rows]
        if not any(x is not None for x in found):
            known = dict.fromkeys(key for row in self.rows for key, x in row.items() if real(x) is not None)
            raise SceneError(f"column: no case has a result {name!r:.60}; there are {', '.join(map(repr, known)) or 'none'}")
        return np.array([math.nan if x is None else x for x in found])

    @checked()
    def to_dataframe(self) -> DataFrame:
        """Return the rows as a pandas DataFrame.

        Raises
        ------
        BackendError
            pandas is missing.
        """
        return import_pandas().DataFrame(self.rows)

    def __repr__(self) -> str:
        names = list(self.rows[0]) if self.rows else []
        head = (f"Sweep: {len(self.rows)} cases, {len(self.failures)} failed, {len(self.missing)} missing; "
                f"columns {', '.join(map(str, names)) or 'none'}")
        return "\n".join([head, *self._doubts()])

    def _doubts(self) -> list[str]:
        found = [f"case {k}, {lines[0]}" for k, lines in self.doubts.items()]
        more = [f"and {len(found) - MOST} more cases with warnings in .doubts"] if len(found) > MOST else []
        return found[:MOST] + more


@warns
@checked(build=Anything(), cases=Anything(), run=Names("must map arguments of simulate to values, as in run={'t_end': 1.0}"),
         measure=Function("(result)"), executor=Anything(), workers=Count(most=1024), threads=Count(most=1024), file=FilePath(),
         overwrite=Flag(), retry=Flag(), progress=Flag())
def sweep(build: Callable[..., Built], cases: Iterable[Mapping[str, object]] | Mapping[str, Iterable[object]], *,
          run: Mapping[str, object] | None = None, measure: Callable[[Result], Measured] | None = None,
          executor: Executor | None = None, workers: int | None = None, threads: int = 1,
          file: str | PathLike[str] | None = None, overwrite: bool = False, retry: bool = False,
          progress: bool | None = None) -> Sweep:
    """Run many cases, on all processors, and gather a table.

    The same cases give the same table, to the last bit, whatever the executor and the number of its workers. A case that fails is
    a row with its error, and the others go on.

    Parameters
    ----------
    build : callable
        Called as build(**case). Returns a Scene or Model, which `simulate` then runs with the arguments `run`; a Result; or
        what the case comes to: a mapping of names to numbers, texts and arrays, or one number.
    cases : iterable of mappings, or mapping
        Arguments of `build`. A mapping of names to lists of values stands for all their combinations, the last name fastest.
    run : mapping
        Arguments of `simulate`: {'t_end': 1.0, 'step': 1e-3}.
    measure : callable
        result -> mapping of names to numbers, texts and arrays, or one number. Without it a run gives its end time 't', its
        number of steps, drifts of what it conserves, the number of its events, and its series as arrays.
    executor : concurrent.futures.Executor
        Any: threads, processes, clusters through dask, mpi4py or others. `build` and `measure` have to be functions that it can
        hand to its workers (functions of a module). Default: processes of this machine. On Linux these are forks, which have
        everything that this process has, lambdas and compiled kernels too; elsewhere new processes, and the program needs the
        usual ``if __name__ == "__main__":``.
    workers : int
        Processes, default one for every processor that this process may use; 1: none but this one. An executor of yours is handed
        four times as many cases at once.
    threads : int
        Threads of each run, the same everywhere, so that results do not depend on where it runs.
    file : path
        Rows go to this HDF5 file as they come (`load_sweep`). Where it holds rows of the same sweep already, from one that was
        cut short, only what is missing is run.
    overwrite : bool
        Begin anew, whatever the file holds.
    retry : bool
        Run cases again that failed in the file.
    progress : bool
        Progress bar; default: on anything longer than a second.

    Raises
    ------
    SceneError
        An argument is not usable, a case is no mapping, or cannot be written to a file.
    ResultFileError
        The file holds something else, or cannot be written.
    BackendError
        A worker process died.

    Examples
    --------
    >>> import fastbeam as fb
    >>> fb.sweep(lambda a, b: {"sum": a + b}, {"a": [1, 2], "b": [10, 20]}, workers=1).rows[3]
    {'run': 3, 'a': 2, 'b': 20, 'sum': 22, 'error': None}
    """
    if not callable(build):
        raise SceneError(f"sweep: build must be a function of the entries of a case, got {shown(build)}")
    if executor is not None and (isinstance(executor, type) or not callable(getattr(executor, "submit", None))):
        raise SceneError(f"sweep: executor must be an Executor of concurrent.futures, got {shown(executor)}")
    every = list_cases(cases)
    job = Job(build, None if run is None else regroup("sweep, run", "0.2", OLD, dict(run)), measure, threads)
    done: list[Row] = []
    writer = None
    if file is not None:
        header = {"cases": [_key(k, case) for k, case in enumerate(every)], "build": _name_of(build),
                  "measure": _name_of(measure), "run": json.dumps(job.run, sort_keys=True, default=_written)}
        path = Path(os.fspath(file))
        if not overwrite and os.path.lexists(path):
            done = _kept(path, header, retry)
        writer = SweepFile(path, header, done)
    have = {row["run"] for row in done}
    todo = [(k, case) for k, case in enumerate(every) if k not in have]
    bar = Progress(len(every), "sweep", progress)
    bar.update(len(have))
    try:
        for row in _rows(job, todo, executor, workers):
            done.append(row)
            bar.update()
            if writer is not None:
                writer.append(row)
                writer.flush_when_due()
    finally:
        bar.close()
        if writer is not None:
            writer.close()
    return Sweep(done, len(every))


@checked(path=FilePath())
def load_sweep(path: str | PathLike[str]) -> Sweep:
    """Read the file of a sweep, also of one that was killed or is running.

    Raises
    ------
    ResultFileError
        The file is missing, no sweep, or damaged.
    """
    header, rows = read_sweep(Path(os.fspath(path)))
    return Sweep(rows, len(header.get("cases", ())))


# --- cases ------------------------------------------------------------------------------------------------------------------
def list_cases(cases: Any) -> list[dict[str, Any]]:
    """List all cases as dicts; combinations of the values of a mapping. Raises SceneError: they are neither mappings nor lists of
    values."""
    if isinstance(cases, Mapping):
        lists = {name: list(values) if _is_list(values) else None for name, values in cases.items()}
        wrong = next((name for name, values in lists.items() if values is None or not isinstance(name, str)), None)
        if wrong is not None:
            raise SceneError(f"sweep: cases[{shown(wrong)}] must be a list of values, got {shown(cases[wrong])}; one case alone "
                             "is cases=[{...}]")
        count = math.prod(len(values) for values in lists.values() if values is not None)
        _check_count(count)
        return [dict(zip(lists, values)) for values in itertools.product(*lists.values())]  # type: ignore[arg-type]
    if not _is_list(cases):
        raise SceneError(f"sweep: cases must be a list of mappings, or a mapping of names to lists of values, got {shown(cases)}")
    out = []
    for case in itertools.islice(cases, MOST_CASES + 1):
        if not isinstance(case, Mapping) or not all(isinstance(name, str) for name in case):
            raise SceneError(f"sweep: case {len(out)} must map names of arguments of build to values, got {shown(case)}")
        out.append(dict(case))
    _check_count(len(out))
    return out


def _is_list(values: Any) -> bool:
    if isinstance(values, range):
        return len(values[:MOST_CASES + 1]) <= MOST_CASES
    return isinstance(values, Iterable) and not isinstance(values, (str, bytes, type, Mapping)) and not (
        isinstance(values, np.ndarray) and values.ndim == 0)


def _check_count(n: int) -> None:
    if n > MOST_CASES:
        raise SceneError(f"sweep: needs at most {MOST_CASES} cases, got more; divide them into several sweeps")


def _as_json(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {shown(value)}")


def _key(k: int, case: Mapping[str, Any]) -> str:
    try:
        return json.dumps(case, sort_keys=True, default=_as_json)
    except (TypeError, ValueError) as error:
        raise SceneError(f"sweep: case {k} contains something that a file cannot store ({error}); let build make it from numbers "
                         "and texts, or leave out file=") from None


def _name_of(function: Any) -> str:
    name = getattr(function, "__qualname__", type(function).__name__)
    return "" if function is None else f"{getattr(function, '__module__', '')}.{name}"


def _written(value: Any) -> Any:
    """Return a value of an argument for JSON: arrays as lists, groups of arguments as mappings, else the name of its class."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, (Method, Output, Solver, Start, StepControl)):
        return vars(value)
    return str(value) if isinstance(value, PathLike) else type(value).__name__


def _kept(path: Path, header: dict[str, Any], retry: bool) -> list[Row]:
    """Return rows of a file that need not be computed again."""
    found, rows = read_sweep(path)
    differing = [name for name in ("build", "measure", "run") if found.get(name) != header[name]]
    if differing:
        name = differing[0]
        raise ResultFileError(f"sweep file '{path}': holds a sweep with another {name} ({str(found.get(name))[:80]} instead of "
                              f"{header[name][:80]}); choose another path, or overwrite=True")
    before = found.get("cases", [])
    places: dict[str, list[int]] = {}
    for k, key in enumerate(header["cases"]):
        places.setdefault(key, []).append(k)
    out = []
    for row in rows:
        # cases may have been added or put into another order; equal ones are computed once each
        key = before[row["run"]] if row["run"] < len(before) else ""
        if places.get(key) and not (retry and row["error"] is not None):
            out.append({**row, "run": places[key].pop(0)})
    return out


# --- one run ----------------------------------------------------------------------------------------------------------------
class Job:
    """Work on one case: build, run and measure; handed to workers."""

    def __init__(self, build: Callable[..., Built], run: dict[str, Any] | None, measure: Callable[[Result], Measured] | None,
                 threads: int) -> None:
        self.build, self.run, self.measure, self.threads = build, run, measure, threads

    def __call__(self, k: int, case: dict[str, Any]) -> Row:
        """Return the row of a case, a failed one too."""
        row: Row = {"run": k, "case": json.loads(json.dumps(case, default=_as_shown)), "values": {}, "error": None, "arrays": {}}
        try:
            with nullcontext() if _mkl() is None else OnThreads(_mkl(), self.threads):
                row["values"], row["arrays"], lines = self._found(case)
            if lines:
                row["doubts"] = lines
            taken = next((name for name in (*row["values"], *row["arrays"]) if name in case or name in ("run", "error")), None)
            if taken is not None:
                raise SceneError(f"measured value {taken!r} has the name of another column; choose another name")
        except Exception as error:
            said = " ".join(str(error).split())
            row |= {"error": f"{type(error).__name__}: {said}", "traceback": traceback.format_exc(limit=-5)}
        return row

    def _arguments(self, run: dict[str, Any]) -> dict[str, Any]:
        """Return the given arguments of `simulate`; without shapes, and on the threads of the sweep, where they do not say."""
        output, solver = grouped(Output, run.get("output")), grouped(Solver, run.get("solver"))
        return {"progress": False, **run, "output": replace(output, snapshots=output.snapshots or 0),
                "solver": replace(solver, threads=solver.threads or self.threads)}

    def _found(self, case: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray], list[str]]:
        """Return numbers and arrays of a case, and events of its run that say where these are not to be trusted."""
        found = self.build(**case)
        if isinstance(found, Scene):
            found = compile_scene(found)
        if isinstance(found, Model):
            if self.run is None:
                raise SceneError("build returned a scene, but no run arguments were given; add run={'t_end': ..., 'step': ...}")
            found = simulate(found, **self._arguments(self.run))
        lines = found._doubts() if isinstance(found, Result) else []
        if isinstance(found, Result) and self.measure is None:
            facts = {"t": float(found.t[-1]) if len(found.t) else math.nan, "steps": found.info.get("steps"),
                     "events": len(found.events)}
            drifts = {f"drift_{name}": found.drift(name) for name in FACTS if name in found.series and found.is_conserved(name)}
            return facts | drifts, {"series_t": found.t, **{f"series_{name}": x for name, x in found.series.items()}}, lines
        return *split(self.measure(found) if self.measure is not None and isinstance(found, Result) else found), lines


def split(found: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Split measured values into numbers and texts, and arrays. Raises SceneError: it is something else."""
    values: dict[str, Any] = {}
    arrays: dict[str, np.ndarray] = {}
    for name, x in (found if isinstance(found, Mapping) else {"value": found}).items():
        array = None if x is None or isinstance(x, (str, bytes)) else np.asarray(x)
        if isinstance(x, bytes) or not isinstance(name, str) or array is not None and array.dtype.kind not in "biuf":
            raise SceneError("build or measure must return a mapping of names to numbers, texts and arrays, or one number; "
                             f"{shown(name)} is {shown(x)}")
        if array is not None and array.ndim:
            arrays[name] = array
        else:
            values[name] = x if array is None else array.item()
    return values, arrays


def _as_shown(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else shown(value)


@cache
def _mkl() -> Any:
    return load_mkl()


# --- many runs --------------------------------------------------------------------------------------------------------------
def _rows(job: Job, todo: list[tuple[int, dict[str, Any]]], executor: Executor | None, workers: int | None) -> Iterator[Row]:
    """Yield rows as cases are finished."""
    n = workers or _processors()
    if executor is not None:
        yield from _through(executor, job, todo, n)
        return
    n = min(n, len(todo))
    if n <= 1:
        yield from (job(k, case) for k, case in todo)
        return
    pending = iter(todo)
    if len(todo) >= MANY * n:
        # forks have what this process has: kernels are compiled, and loaded, once for all
        yield job(*next(pending))
    with _pool(job, n) as pool:
        yield from _through(pool, _INHERITED if _forks() else job, list(pending), n)


def _through(executor: Executor, job: Any, todo: list[tuple[int, dict[str, Any]]], n: int) -> Iterator[Row]:
    waiting: set[Future[Row]] = set()
    pending = iter(todo)
    try:
        while True:
            for k, case in itertools.islice(pending, AHEAD * n - len(waiting)):
                with warnings.catch_warnings():
                    # native threads of MKL wait for work, nothing else; newer Pythons warn of any
                    warnings.simplefilter("ignore", DeprecationWarning)
                    waiting.add(executor.submit(job, k, case))
            if not waiting:
                return
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
    except BrokenExecutor as error:
        raise BackendError(f"sweep: a worker process died ({error}), perhaps for lack of memory. Rows until then are in the "
                           "file, if there is one: the same call continues from there, with fewer workers=") from error
    finally:
        for future in waiting:
            future.cancel()


class _InheritedJob:
    """The job that forks inherit, so that nothing but cases goes to them."""

    job: Job | None = None

    def __call__(self, k: int, case: dict[str, Any]) -> Row:
        assert self.job is not None
        return self.job(k, case)

    def __reduce__(self) -> Any:
        return "_INHERITED"


_INHERITED = _InheritedJob()


def _begin(job: Job | None, threads: int, parent: int) -> None:
    """Prepare a worker: Ctrl-C and locks are left to the process that hands out cases, and the worker ends with that process."""
    let_go()
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["FASTBEAM_THREADS"] = str(threads)
    if job is not None:
        _INHERITED.job = job


def _end_with(parent: int) -> None:
    """End this process when its parent was killed, which cannot tell it."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


@contextmanager
def _pool(job: Job, n: int) -> Iterator[Executor]:
    import multiprocessing
    forks = _forks()
    context = multiprocessing.get_context("fork" if forks else "spawn")
    pool = ProcessPoolExecutor(n, mp_context=context, initializer=_begin,
                               initargs=(job if forks else None, job.threads, os.getpid()))
    try:
        yield pool
    except BaseException:
        # nobody waits for runs that are of no use any more
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()


def _forks() -> bool:
    return sys.platform == "linux"


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
