"""Faults: kills, restarts, full disks, damaged and hostile files, kernel caches."""
from __future__ import annotations

import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hostile_files import HOSTILE, make_hostile
from small_scenes import bead, cantilever, free_beam

import fastbeam as fb
from perf.stress.table import Row
from perf.stress.victims import RUN, damage, long_rail

VICTIMS = Path(__file__).resolve().parent / "victims.py"
H = 2e-3


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        yield from restarts(place)
        yield from kills(place, 3 if quick else 10)
        yield from full_disks(place, 3 if quick else 12)
        yield from damaged_results(place, 100 if quick else 1000)
        yield from hostile_results(place)
        yield from damaged_checkpoints(place, 300 if quick else 3000)
        if not quick:
            yield from common_start(place)


def victim(*arguments: Any, **environment: str) -> subprocess.Popen[str]:
    """A process that may end badly."""
    return subprocess.Popen([sys.executable, str(VICTIMS), *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            text=True, env={**os.environ, "FASTBEAM_PROGRESS": "0", **environment})


def lines(text: str) -> list[Any]:
    """What a victim said, without a line that was cut."""
    return [json.loads(line) for line in text.splitlines() if line.startswith("[") and line.endswith("]")]


def same(a: fb.Result, b: fb.Result) -> bool:
    """Whether all bits of the last states are equal."""
    return all(x.tobytes() == y.tobytes() for x, y in zip(a.state, b.state))


# ----------------------------------------------------------------------------------------------------------------- restarts
def timed() -> fb.Scene:
    """A cantilever under a load that changes in time."""
    scene = cantilever(0.0)
    load = fb.Load("tip", scene.beams[0].end, force=(0, 0, 20), time=lambda t: np.cos(7.0 * t))
    return fb.Scene(*scene.beams, *scene.clamps, load, name="load in time")


def restarts(place: Path) -> Iterator[Row]:
    """A run in pieces, each from the file of the one before, against the run in one."""
    for make in (free_beam, bead, timed):
        for settings in ({"order": 2}, {"order": 4}, {"order": 2, "tolerance": 1e-6}):
            model = fb.compile_scene(make())
            common: dict[str, Any] = {"t_end": 0.6, "step": H, "progress": False, **settings}
            whole = fb.simulate(model, **common)
            path, start, pieces = place / "pieces.checkpoint", None, 0
            generator = random.Random(3)
            while start is None or start.t < 0.6:
                stop = generator.uniform(0.05, 0.2) + (0.0 if start is None else start.t)
                part = fb.simulate(model, start=start, output=fb.Output(checkpoint=path), callback=lambda t, state: t >= stop,
                                   **common)
                start = fb.load_checkpoint(path)
                pieces += 1
            path.unlink()
            name = "step control" if "tolerance" in settings else f"order {settings['order']}"
            yield Row(f"restart of '{model.scene_name}', {name}", "same bits as in one run",
                      f"{pieces} pieces, {'same' if same(part, whole) else 'other'} bits, t = {part.t[-1]:g}",
                      same(part, whole) and part.t[-1] == whole.t[-1])


# -------------------------------------------------------------------------------------------------------------------- kills
def kills(place: Path, times: int) -> Iterator[Row]:
    """SIGKILL at random moments of runs with result file and checkpoint."""
    generator = random.Random(11)
    model = fb.compile_scene(long_rail())
    lost, rows_lost, ages, bad = [], [], [], []
    for k in range(times):
        path = place / f"kill{k}.h5"
        child = victim("run", path, 2 if k % 2 else 4)
        assert child.stdout is not None
        first = child.stdout.readline()
        time.sleep(generator.uniform(0.0, 3.0))
        child.send_signal(signal.SIGKILL)
        told = lines(first + child.stdout.read())
        child.wait()
        try:
            result, kept = fb.load_result(path), fb.load_checkpoint(f"{path}.checkpoint")
        except ValueError as error:
            bad.append(f"run {k}: {error}")
            continue
        n = len(result.t)
        whole = fb.simulate(model, order=2 if k % 2 else 4, progress=False,
                            **{**RUN, "t_end": max(float(result.t[-1]) if n else 0.0, kept.t) + 0.1})
        if not all(np.array_equal(x, whole.series[name][:n]) for name, x in result.series.items()):
            bad.append(f"run {k}: other rows")
        rest = fb.simulate(model, start=kept, order=2 if k % 2 else 4, progress=False, **{**RUN, "t_end": float(whole.t[-1])})
        if not same(rest, whole):
            bad.append(f"run {k}: other state after the restart")
        late = [clock for t, clock in told if n == 0 or t > result.t[-1]]
        lost.append(told[-1][1] - late[0] if late else 0.0)
        rows_lost.append(len(late))
        ages.append(sum(t > kept.t for t, _ in told))
    yield Row(f"SIGKILL at a random moment, {times} times: result file", "opens, rows are those of the run",
              bad[0] if bad else f"lost at most the last {max(lost):.2f} s ({max(rows_lost)} rows)", not bad and max(lost) < 1.0)
    yield Row(f"SIGKILL at a random moment, {times} times: checkpoint", "opens, goes on with the same bits",
              bad[0] if bad else f"at most {max(ages)} rows old (kept at every row)", not bad and max(ages) <= 1)


# --------------------------------------------------------------------------------------------------------------- full disks
def full_disks(place: Path, times: int) -> Iterator[Row]:
    """Runs whose result file meets the end of the disk."""
    limits = np.linspace(60_000, 2_500_000, times).astype(int).tolist()
    bad, kept = [], []
    for limit in limits:
        path = place / "full.h5"
        child = victim("fill", path, limit)
        out, err = child.communicate(timeout=300)
        said = lines(out)
        if child.returncode or not said or said[-1][0] != "refused":
            bad.append(f"limit {limit}: exit {child.returncode}, {(said or [err[-60:]])[-1]}"[:70])
        elif path.exists():
            n = len(fb.load_result(path).t)
            kept.append((n, said[-1][2]))
            if not said[-1][3] or n > said[-1][2]:
                bad.append(f"limit {limit}: result without the last state")
        path.unlink(missing_ok=True)
    worst = max(((m - n, n, m) for n, m in kept), default=(0, 0, 0))
    yield Row(f"file may not grow beyond {times} limits, 60 kB to 2.5 MB", "ResultFileError, file and result sound",
              bad[0] if bad else f"{times} errors; file holds {worst[1]} of {worst[2]} rows at worst, .result all", not bad)
    folder = place / "disk"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=900k", "none", str(folder)], capture_output=True).returncode:
        yield Row("disk of 900 kB", "ResultFileError, file and result sound", "not tried: no right to mount one", True)
        return
    try:
        child = victim("fill", folder / "full.h5", 0)
        out, _ = child.communicate(timeout=300)
        said = lines(out)[-1]
        n = len(fb.load_result(folder / "full.h5").t)
        ok = child.returncode == 0 and said[0] == "refused" and "No space left" in said[1] and 0 < n <= said[2]
        yield Row("disk of 900 kB", "ResultFileError, file and result sound", f"{said[0]}; file {n} rows, .result {said[2]}", ok)
    finally:
        subprocess.run(["umount", str(folder)], check=False)


# -------------------------------------------------------------------------------------------------------------------- files
def sound_files(place: Path) -> tuple[Path, Path]:
    """A result file that was closed, and one whose writer was killed."""
    closed, killed = place / "closed.h5", place / "killed.h5"
    fb.simulate(fb.compile_scene(bead()), t_end=0.6, step=H, every=3, output=closed, progress=False)
    child = victim("run", killed, 2)
    assert child.stdout is not None
    for _ in range(300):
        child.stdout.readline()
    time.sleep(0.6)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    return closed, killed


def damaged_results(place: Path, times: int) -> Iterator[Row]:
    """Random damage to result files, read in processes of their own."""
    for name, source in zip(("closed", "killed"), sound_files(place)):
        for kind in ("bit", "bytes", "zeros", "cut"):
            child = victim("read", place / "damaged.h5", source, kind, 0, times)
            try:
                out, err = child.communicate(timeout=max(300, times))
            except subprocess.TimeoutExpired:
                child.kill()
                out, err = child.communicate()[0], "hangs"
            said = lines(out)
            last: Any = said[-1] if said else ["nothing"]
            ok = child.returncode == 0 and last[0] == "counts" and last[1]["WRONG"] == last[1]["other error"] == 0
            what = {"bit": "one bit flipped", "bytes": "random bytes", "zeros": "zeros", "cut": "cut"}[kind]
            happened = (", ".join(f"{count} {how}" for how, count in last[1].items()) if last[0] == "counts"
                        else f"exit {child.returncode} at {last}: {err[-40:]}")
            yield Row(f"{name} result file, {what}, {times} times", "refused or unchanged, no crash", happened, ok)


def hostile_results(place: Path) -> Iterator[Row]:
    """Files made to harm."""
    path, source = place / "hostile.h5", place / "short.h5"
    fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=0.01, output=source, progress=False)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in HOSTILE:
        message = make_hostile(source, path, name)
        begin = time.perf_counter()
        try:
            happened = repr(fb.load_result(path))
        except fb.ResultFileError as error:
            happened = str(error).split("': ", 1)[1]
        except Exception as error:  # anything else is what this part looks for
            happened = repr(error)
        refused = re.search(message, happened) is not None
        yield Row(f"hostile result file: {name}", "refused at once, with its cause", happened[:70],
                  refused and time.perf_counter() - begin < 10.0)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    yield Row("memory for all hostile files", "no huge allocation", f"{grown:.0f} MB more than before", grown < 300)


def damaged_checkpoints(place: Path, times: int) -> Iterator[Row]:
    """Random damage to a checkpoint."""
    good, path = place / "good.checkpoint", place / "damaged.checkpoint"
    fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H, output=fb.Output(checkpoint=good), progress=False)
    data = good.read_bytes()
    refused, other = 0, []
    tried = 0
    for seed in range(times):
        generator = np.random.default_rng(seed)
        broken = damage(data, ("bit", "bytes", "zeros", "cut")[seed % 4], generator)
        if broken == data:
            continue
        tried += 1
        path.write_bytes(broken)
        try:
            fb.load_checkpoint(path)
            other.append(f"seed {seed}: read")
        except fb.ResultFileError:
            refused += 1
        except Exception as error:  # anything else is what this part looks for
            other.append(f"seed {seed}: {error!r}")
    yield Row(f"checkpoint damaged {tried} times", "refused", other[0] if other else f"{refused} refused", not other)


# ------------------------------------------------------------------------------------------------------------------- caches
def common_start(place: Path) -> Iterator[Row]:
    """Three processes that start at once on an empty cache, and a cache that cannot be written."""
    names = ["free_beam", "bead", "bead"]
    cache = {"FASTBEAM_CACHE_DIR": str(place / "cache")}
    at = time.time() + 3.0
    children = [victim("start", name, at, **cache) for name in names]
    told = [lines(child.communicate(timeout=900)[0]) for child in children]
    again = [lines(victim("start", name, 0.0, **cache).communicate(timeout=300)[0]) for name in names[:2]]
    good = all(told) and all(again)
    ok = good and [x[0][0] for x in told] == [again[0][0][0], again[1][0][0], again[1][0][0]] and all(x[0][2] == 0 for x in again)
    yield Row("three processes start at once on an empty cache", "all succeed, same bits, next one compiles nothing",
              f"{sum(map(bool, told))} succeed; later {[x[0][2] for x in again if x]} compiled", ok)
    (place / "file").write_text("no folder")
    (place / "spare").mkdir()
    said = lines(victim("start", "free_beam", 0.0, FASTBEAM_CACHE_DIR=str(place / "file"),
                        TMPDIR=str(place / "spare")).communicate(timeout=900)[0])
    ok = good and bool(said) and said[0][0] == again[0][0][0] and said[0][3].startswith(str(place / "spare"))
    yield Row("cache folder that cannot be written", "temporary folder of the user, same bits",
              "same bits, kept in the temporary folder" if ok else str(said), ok)
