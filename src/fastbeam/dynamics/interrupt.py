"""Ctrl-C in a run: it waits for a moment at which state, clock and files agree, and ends the run there."""
from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from fastbeam.dynamics.control import StepSizes
from fastbeam.kernels.jit.parts import WholeCompiler
from fastbeam.kernels.loop import OK
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper

# s; compiled calls last about as long. A step that lasts longer is left between its iterations where these are called from Python
CALL_TIME = 0.1
Handler = Callable[[int, FrameType | None], Any]


class Interrupts:
    """Context in which the first Ctrl-C is only noted, until `serve` hands it to the handler that was there before (Python's
    raises KeyboardInterrupt). A second one goes to that handler at once, as does one during compilation, which takes seconds and
    changes nothing, and one inside `at_once`.

    Python delivers signals to the main thread; elsewhere, and where SIGINT is ignored, this does nothing.

    asked: whether a Ctrl-C waits.
    """

    def __init__(self) -> None:
        self.asked = False
        self._at_once = False
        self._before: Handler | None = None

    def __enter__(self) -> Interrupts:
        before = signal.getsignal(signal.SIGINT)
        if callable(before) and threading.current_thread() is threading.main_thread():
            try:
                signal.signal(signal.SIGINT, self._take)
            except ValueError:
                return self  # not the main interpreter
            self._before = before
        return self

    def __exit__(self, *exc: object) -> None:
        if self._before is not None:
            before, self._before = self._before, None
            signal.signal(signal.SIGINT, before)
            if self.asked and exc[0] is None:
                before(signal.SIGINT, sys._getframe())

    def serve(self) -> None:
        """Hand on a Ctrl-C that waits. Raises KeyboardInterrupt unless the handler does something else."""
        if self.asked and self._before is not None:
            self.asked = False
            self._before(signal.SIGINT, sys._getframe())

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let a Ctrl-C act at once in this block: around code of the user, which may take any time."""
        self._at_once = True
        try:
            self.serve()
            yield
        finally:
            self._at_once = False

    def _take(self, number: int, frame: FrameType | None) -> None:
        if self._before is not None and (self.asked or self._at_once or _compiles(frame)):
            self.asked = False
            self._before(number, frame)
        else:
            self.asked = True


def _compiles(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code is not WholeCompiler.compile_extra.__code__:
        frame = frame.f_back
    return frame is not None


def _never() -> bool:
    return False


class Calls:
    """Calls of a stepper over many steps, short enough for Ctrl-C to be seen between them. Results do not depend on how steps are
    cut into calls.

    intact: after an exception: whether the state is the one before the call.
    failed: raised by a function of time after some steps of a call; raised again by the next call.
    burst: steps of a call.
    slow: whether a step takes so long that it may have to be left.
    """

    def __init__(self, stepper: Stepper, interrupts: Interrupts) -> None:
        self.stepper, self.interrupts, self.intact = stepper, interrupts, False
        self.failed: Exception | None = None
        self.burst, self.slow = 1, True

    def advance(self, t: float, h: float, n: int, done: int = 0) -> Outcome:
        """Take steps as `Stepper.advance`; fewer where a Ctrl-C waits, or a function of time fails behind them."""
        if self.failed is not None:
            self.intact = True
            raise self.failed
        if n <= self.burst and not self.slow:
            # nearly all calls take this branch
            self.intact = False
            begin = time.perf_counter()
            try:
                part = self.stepper.advance(t, h, n, done)
            except Exception:
                self.intact = not self.stepper.begun
                if n == 1 or self.stepper.begun:
                    raise
                # steps are taken one by one, up to the one that fails
                return self._one_by_one(t, h, n, done)
            if time.perf_counter() - begin > CALL_TIME:
                self.burst, self.slow = 1, True
            return part
        whole: Outcome | None = None
        while True:
            taken = 0 if whole is None else whole.steps
            k = min(n - taken, self.burst)
            # a step that is left has overwritten the first guess of the next
            saved = self.stepper.save() if self.slow else None
            self.intact, self.stepper.stop = False, self._waits if self.slow else _never
            begin = time.perf_counter()
            try:
                part = self.stepper.advance(t, h, k, done + taken)
            except KeyboardInterrupt:
                if saved is not None and not taken:
                    self.stepper.load(saved)
                    self.intact = True
                raise
            except Exception:
                self.intact = not (self.stepper.begun or taken)
                if self.stepper.begun or n == 1:
                    raise
                return self._one_by_one(t, h, n - taken, done + taken, whole)
            finally:
                self.stepper.stop = _never
            if saved is not None and part.status == OK and not part.steps:
                self.stepper.load(saved)
            each = (time.perf_counter() - begin) / max(part.steps, 1)
            whole = part if whole is None else part.after(whole)
            self.slow = each > CALL_TIME
            self.burst = max(1, min(int(CALL_TIME / max(each, 1e-9)), max(self.burst, 8 * k)))
            if part.status != OK or whole.steps >= n or self.interrupts.asked:
                return whole

    def _one_by_one(self, t: float, h: float, n: int, done: int, before: Outcome | None = None) -> Outcome:
        """Take steps up to the one for which a function of time fails; before: steps of this call, if any."""
        whole = before
        for k in range(done, done + n):
            try:
                part = self.stepper.advance(t, h, 1, k)
            except Exception as failed:
                self.intact = whole is None and not self.stepper.begun
                if whole is None or self.stepper.begun:
                    raise
                self.failed = failed
                break
            whole = part if whole is None else part.after(whole)
            if part.status != OK or not part.steps or self.interrupts.asked:
                break
        assert whole is not None
        return whole

    def controlled(self, control: StepSizes, t: float, h: float, step: int) -> tuple[float, float, Outcome]:
        """Take a step as `StepSizes.advance`; none where a Ctrl-C waits."""
        self.intact, self.stepper.stop = False, self._waits
        begin = time.perf_counter()
        try:
            return control.advance(self.stepper, t, h, step)
        except BaseException:
            self.intact = True
            raise
        finally:
            self.stepper.stop, self.slow = _never, time.perf_counter() - begin > CALL_TIME

    def _waits(self) -> bool:
        return self.interrupts.asked
