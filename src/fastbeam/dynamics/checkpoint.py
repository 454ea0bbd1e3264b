"""Checkpoints: everything a run needs to go on bit for bit, in memory and in files that are complete or absent.

    fastbeam-checkpoint 4 <newline>
    one line of JSON: sizes, times, name and fingerprint of the model
    float64, little endian: q, v, s, force, history, mean_force, memory, impacts
    sha256 of everything before

Reading one executes nothing and allocates no more than the file is long.
"""
from __future__ import annotations

import hashlib
import json
import math
import os
import stat
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fastbeam.interface.arguments import Count, FilePath, Flag, Instance, Maybe, Number, Word, checked, number
from fastbeam.interface.errors import ResultFileError, SceneError
from fastbeam.interface.paths import check_new, check_regular
from fastbeam.kernels.state import State
from fastbeam.model.model import Model

Array = np.ndarray
MAGIC = b"fastbeam-checkpoint "
VERSION = 4
# bytes
LONGEST_HEADER, DIGEST = 65536, 32
ARRAYS = (*State._fields, "mean_force", "memory", "impacts")
# shares of a step: an end this near to a whole number of steps is one; a last step shorter than that is added to the one before
WHOLE, SLIVER = 1e-9, 0.01
# a step is at least this many times the distance of doubles at its time
RESOLVED = 4.0
STEP, NUMBERS = Number(above=0.0, unit="s"), Maybe(Instance(np.ndarray, "an array or None"))


@checked(state=Instance(State, "a State"), t=Number(), step=STEP, t_start=Number(), steps=Count(0), next_step=Maybe(STEP),
         mean_force=NUMBERS, scene=Word(), fingerprint=Word(), memory=NUMBERS, last_step=STEP, impacts=NUMBERS, began=Number())
@dataclass(frozen=True)
class Checkpoint:
    """State of a run at one time; `simulate(model, start=checkpoint, ...)` goes on as if the run had never stopped.

    Attributes
    ----------
    state : State
    t : float
        Time of the state, s.
    step : float
        Step size of the run (its first with step control), s.
    t_start, steps : float, int
        The run counts its steps from t_start and stands after that many; t is their exact product-sum t_start + steps*step
        where the step is fixed.
    next_step : float or None
        Step size that the step control proposes.
    mean_force : float64 [F] or None
        Forces of all constraints, those of sliders first, in the last step, half of what the next row records; with
        `observe=("reaction",)` followed by forces and moments of supports, joints and sections. None before the first step.
    scene, fingerprint : str
        Name and hash of the model.
    last_step : float or None
        Size of the last step, s, that mean_force belongs to.
    memory : float64 or None
        Data of the steps besides the state: rates of generalised alpha (theory.md (7.2)), mean rates of the last two steps for
        the first guess of the next, the newest as increments.
    impacts : float64 [S + R, 2] or None
        Times of the last impacts of all sliders, and joints that may stick, on rigid stops at the start and the end, s, -1.8e308
        where there was none; None where nothing has such stops.
    began : float or None
        Time of the state from which the first of these runs began, s; None: t. Loads are not asked for before it.
    """

    state: State
    t: float
    step: float
    t_start: float
    steps: int
    next_step: float | None
    mean_force: Array | None
    scene: str
    fingerprint: str
    memory: Array | None = None
    last_step: float | None = None
    impacts: Array | None = None
    began: float | None = None

    @checked(path=FilePath(), overwrite=Flag())
    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write to a file in one piece: after a kill at any moment the file is the old one or the new one. Symbolic links are
        followed.

        Raises
        ------
        ResultFileError
            The folder does not exist, the file exists (and not `overwrite`) or is something else than a checkpoint, or it cannot
            be written.
        """
        path = check_target(path, overwrite)
        head = {name: getattr(self, name) for name in ("t", "step", "t_start", "steps", "next_step", "scene", "fingerprint",
                                                   "last_step", "began")}
        extra = [() if x is None else x for x in (self.mean_force, self.memory, self.impacts)]
        arrays = [np.asarray(x, dtype="<f8") for x in (*self.state, *extra)]
        head["sizes"] = {name: x.size for name, x in zip(ARRAYS, arrays)}
        data = b"".join((MAGIC, b"%d\n" % VERSION, json.dumps(head).encode(), b"\n", *(x.tobytes() for x in arrays)))
        _replace(path, data + hashlib.sha256(data).digest())


@checked(path=FilePath())
def load_checkpoint(path: str | PathLike[str]) -> Checkpoint:
    """Read a checkpoint that `simulate(..., output=Output(checkpoint=path))` or `Checkpoint.save` wrote.

    Raises
    ------
    ResultFileError
        The file is missing, no checkpoint, of a newer format, or damaged.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise ResultFileError(f"checkpoint '{path}': no such file")
        check_regular("checkpoint", path, path)
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            first = file.readline(len(MAGIC) + 20)
            if not first.startswith(MAGIC):
                raise ResultFileError(f"checkpoint '{path}': not a fastbeam checkpoint")
            line = file.readline(LONGEST_HEADER)
            return _parse(path, first, line, file.read(size), size)
    except OSError as error:
        raise ResultFileError(f"checkpoint '{path}': cannot be read ({error})") from error


def _parse(path: Path, first: bytes, line: bytes, body: bytes, size: int) -> Checkpoint:
    def refuse(why: str) -> ResultFileError:
        return ResultFileError(f"checkpoint '{path}': {why}")

    version = first[len(MAGIC):].strip()
    if not version.isdigit():
        raise refuse("damaged, its version is not a number")
    if int(version) != VERSION:
        raise refuse(f"format version {int(version)}, but this fastbeam reads {VERSION}; install "
                     f"{('a newer' if int(version) > VERSION else 'an older')} fastbeam")
    if hashlib.sha256(first + line + body[:-DIGEST]).digest() != body[-DIGEST:]:
        raise refuse(f"damaged or truncated, the checksum of its {size} bytes is wrong")
    try:
        head = json.loads(line)
        sizes = [int(head["sizes"][name]) for name in ARRAYS]
        times = {name: number(name, head[name]) for name in ("t", "step", "t_start")}
        next_step = None if head["next_step"] is None else number("next_step", head["next_step"])
        last_step, began = (None if head.get(name) is None else number(name, head[name]) for name in ("last_step", "began"))
        steps, scene, fingerprint = int(head["steps"]), str(head["scene"]), str(head["fingerprint"])
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise refuse(f"damaged header ({type(error).__name__}: {error})") from error
    if min(sizes) < 0 or 8 * sum(sizes) != len(body) - DIGEST:
        raise refuse(f"damaged, arrays of {sizes} numbers do not fit {len(body) - DIGEST} bytes")
    # mean forces may be followed by forces and moments of supports and joints
    if sizes[0] != sizes[1] or sizes[3] < 3 * sizes[2] or sizes[0] % 12 \
            or sizes[5] and (sizes[5] < sizes[3] or (sizes[5] - sizes[3]) % 6) \
            or sizes[7] and (sizes[7] % 2 or sizes[7] < 2 * sizes[2]):
        raise refuse(f"damaged, arrays of {sizes} numbers do not form a state")
    if not times["step"] > 0.0 or steps < 0 or not all(x is None or x > 0.0 for x in (next_step, last_step)):
        raise refuse("damaged, a step size is not > 0")
    numbers = np.frombuffer(body[:-DIGEST], dtype="<f8").astype(np.float64)
    if not np.isfinite(numbers).all():
        raise refuse("holds values that are not finite")
    *state, force, memory, impacts = (x.copy() for x in np.split(numbers, np.cumsum(sizes)[:-1]))
    return Checkpoint(State(*state), **times, steps=steps, next_step=next_step, mean_force=force if force.size else None,
                      scene=scene, fingerprint=fingerprint, memory=memory if memory.size else None, last_step=last_step,
                      impacts=impacts.reshape(-1, 2) if impacts.size else None, began=began)


def check_target(path: str | PathLike[str], overwrite: bool, probe: bool = False) -> Path:
    """Refuse a place where a checkpoint cannot or must not be written; `probe` finds out by writing an empty file beside it.
    Returns the file itself where the path is a link to it. Raises ResultFileError."""
    named = Path(path)
    try:
        path = Path(os.path.realpath(named))
        if check_new("checkpoint", path, named, overwrite):
            with path.open("rb") as file:
                if file.read(len(MAGIC)) not in (MAGIC, b""):
                    raise ResultFileError(f"checkpoint '{named}': the file exists and is not a checkpoint; choose another path")
        if probe:
            fresh = _temporary_name(path)
            fresh.open("wb").close()
            fresh.unlink()
            if not os.path.lexists(path):
                # the name itself may be impossible
                path.open("xb").close()
                path.unlink()
    except OSError as error:
        raise ResultFileError(f"checkpoint '{named}': cannot be written ({error}); choose another path") from error
    return path


def _temporary_name(path: Path) -> Path:
    """Return a name for new contents; short, because the file's own may be as long as the file system allows."""
    return path.with_name(f".checkpoint-{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]}.{os.getpid()}")


def _replace(path: Path, data: bytes) -> None:
    """Put data into a file that is complete at every moment, also after a power cut."""
    fresh = _temporary_name(path)
    try:
        try:
            with fresh.open("wb") as file:
                if path.exists():
                    os.chmod(fresh, stat.S_IMODE(path.stat().st_mode))
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(fresh, path)
        except BaseException:
            with suppress(OSError):
                fresh.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise ResultFileError(f"checkpoint '{path}': cannot be written ({error}); an earlier checkpoint there is unchanged. "
                              "Choose another path") from error
    if hasattr(os, "O_DIRECTORY"):
        # the file itself is safe without this
        with suppress(OSError):
            folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


@dataclass
class Clock:
    """Time of a run. Fixed steps are counted, so that their times depend neither on rows nor on interruptions."""

    # origin, done: after `done` whole steps the time is origin + done*step
    origin: float
    now: float
    step: float
    size: float  # size of the next step; constant with a fixed step
    began: float  # time of the first state, also where the run goes on from a checkpoint
    done: int = 0
    # mean contact force of the last step, float64 [F], and its size
    before: Array | None = None
    before_size: float | None = None
    on_grid: bool = True

    def count(self, steps: int) -> float:
        """Add whole steps; the new time."""
        self.done += steps
        self.now = self.origin + self.step * self.done
        return self.now

    def plan(self, t_end: float) -> tuple[int, float]:
        """Return (whole steps from here to t_end, size of a last one that differs or 0): shorter than the others, or up to a
        hundredth longer where it would be shorter than a hundredth of them."""
        steps = (t_end - self.origin) / self.step
        n = round(steps)
        # times that are whole numbers of steps are so up to the rounding of t_end
        if n > self.done and abs(steps - n) <= _unclear(self.origin, t_end, self.step):
            return n - self.done, 0.0
        n = math.floor(steps)
        if steps - n < SLIVER and n > self.done:
            n -= 1
        return n - self.done, t_end - (self.origin + self.step * n)

    def leave_grid(self, t: float) -> None:
        """Go to a time that is no whole number of steps away."""
        self.now, self.on_grid = t, False

    def checkpoint(self, model: Model, state: State, controlled: bool, memory: Array | None,
                   impacts: Array | None = None) -> Checkpoint:
        """Return a checkpoint of the present moment."""
        origin, done, now = self.origin, self.done, self.now
        if not controlled and self.on_grid:
            now = origin + self.step * done
        elif not controlled:
            origin, done = now, 0
        before = None if self.before is None else self.before.copy()
        return Checkpoint(state, now, self.step, origin, done, self.size if controlled else None, before, model.scene_name,
                          model.fingerprint, memory, self.before_size, None if impacts is None else impacts.copy(), self.began)


def _unclear(a: float, b: float, step: float) -> float:
    """Return the share of a step below which differences between times a and b are round-off."""
    return WHOLE + 0.55 * float(np.spacing(max(abs(a), abs(b)))) / step


def check_times(now: float, t_end: float, step: float, name: str = "step") -> None:
    """Refuse runs whose times doubles cannot tell apart. Raises SceneError."""
    if not t_end > now:
        raise SceneError(f"t_end: must be greater than the time of the start, {now:g} s, got {t_end:g}")
    if t_end - now <= _unclear(now, t_end, step) * step:
        raise SceneError(f"t_end: lies {t_end - now:.3g} s after the start at {now:g} s, which is negligible against a step "
                         f"of {step:g} s; give a later t_end, or a smaller step")
    far = max(abs(now), abs(t_end))
    spacing = float(np.spacing(far))
    if not step >= RESOLVED * spacing:
        raise SceneError(f"{name}: must be at least {RESOLVED * spacing:.3g} s, got {step:g}, because floating-point times near "
                         f"{far:g} s are {spacing:.3g} s apart. Count time from the start of the run (t = 0), take larger "
                         "steps, or end earlier")


def start_clock(model: Model, start: Any, time: float | None, step: float, controlled: bool) -> tuple[State | None, Clock]:
    """Return state and clock at the start of a run. Raises SceneError: the checkpoint is one of another model, or a time is given
    beside it."""
    if not isinstance(start, Checkpoint):
        t = 0.0 if time is None else time
        return start, Clock(t, t, step, step, t)
    if time is not None:
        raise SceneError(f"start: the checkpoint belongs to t = {start.t:.6g} s; leave the time of Start out")
    if start.fingerprint != model.fingerprint:
        raise SceneError(f"start: the checkpoint belongs to another model (scene {start.scene!r}, {start.state.q.size // 12} "
                         f"nodes) than {model.scene_name!r} with {model.n_nodes} nodes, or another version or machine wrote it. "
                         "Compile the same scene, or continue without this check from "
                         "start=Start(checkpoint.state, time=checkpoint.t)")
    before = None if start.mean_force is None else start.mean_force.copy()
    began = start.t if start.began is None else start.began
    clock = Clock(start.t, start.t, step, step, began, before=before, before_size=start.last_step)
    if controlled and start.next_step is not None:
        clock.origin, clock.size = start.t_start, start.next_step
    elif not controlled and start.next_step is None and start.step == step:
        clock.origin, clock.done = start.t_start, start.steps
    return start.state, clock
