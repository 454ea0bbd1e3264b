"""A progress bar for runs that take longer than a second, in terminals and notebooks; elsewhere a line now and then."""
from __future__ import annotations

import os
import sys
import time
from typing import Any

from fastbeam.interface import notebook

# s; a run shorter than this shows nothing
QUIET_TIME = 1.0
# s to the first line where stderr is no terminal; the pause doubles from line to line up to this one
LINE_TIME, LONGEST_PAUSE = 10.0, 1200.0
# s between two pictures of a bar in a notebook
NOTEBOOK_TIME = 0.2
# s; longer remaining times are not shown, nor any before this share of the work is done
LONGEST_FORETOLD, LEAST_SHARE = 24 * 3600.0, 1e-3


class Progress:
    """Bar on stderr that appears only after `QUIET_TIME`; silent when tqdm is missing.

    Where stderr is no terminal, in a log file for instance, it is a line `LINE_TIME` after the first update instead, and others
    after pauses that double. What happens before the first update, compilation of kernels above all, tells nothing about the time
    that is left.

    total: amount of work, in steps or in seconds of simulated time.
    label: text before the bar.
    enabled: None: shown unless the environment says FASTBEAM_PROGRESS=0. True: the first line comes after `QUIET_TIME`.

    Examples
    --------
    >>> with Progress(3, "steps") as progress:
    ...     progress.update(3)
    >>> progress.done
    3.0
    """

    def __init__(self, total: float, label: str = "", enabled: bool | None = None) -> None:
        self.total, self.label, self.done = float(total), label, 0.0
        self._enabled = os.environ.get("FASTBEAM_PROGRESS", "1") != "0" if enabled is None else bool(enabled)
        self._start = time.perf_counter()
        self._bar: Any = None
        self._notebook = self._enabled and notebook.is_notebook()
        self._lines = not (self._notebook or _is_terminal(sys.stderr))
        self._pause = LINE_TIME
        self._next = QUIET_TIME if enabled or not self._lines else LINE_TIME
        self._mark: tuple[float, float] | None = None

    def update(self, k: float = 1) -> None:
        """Add k units of finished work."""
        self.done += k
        if not self._enabled:
            return
        elapsed = time.perf_counter() - self._start
        if self._mark is None:
            self._mark = elapsed, self.done
            if self._lines and self._next == LINE_TIME:
                # what came before is told by itself
                self._next += elapsed
        if self._notebook:
            if elapsed > self._next:
                self._draw(elapsed)
        elif self._bar is not None:
            self._bar.bar_format = self._layout(elapsed)
            self._bar.update(min(self.done, self.total) - self._bar.n)
        elif elapsed > self._next:
            if self._lines:
                self._line(elapsed)
            else:
                self._open(elapsed)

    def close(self) -> None:
        """Finish the bar; safe to call twice."""
        if self._bar is not None:
            self._bar.clear() if self._notebook else self._bar.close()
            self._bar = None
        self._enabled = False

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _left(self, elapsed: float) -> str:
        """Return the time that is left if the rest goes on like the work so far, as a text; '?' where nothing is known."""
        begin, done = self._mark or (0.0, 0.0)
        moved = min(self.done, self.total) - done
        if self.done >= self.total:
            return clock_time(0.0)
        if moved <= LEAST_SHARE * self.total:
            return "?"
        left = (elapsed - begin) * (self.total - self.done) / moved
        return clock_time(left) if left < LONGEST_FORETOLD else "over 24 h"

    @property
    def share(self) -> float:
        """Part of the work that is done, 0 to 1."""
        return min(self.done / self.total, 1.0) if self.total > 0.0 else 1.0

    def _line(self, elapsed: float) -> None:
        self._next, self._pause = elapsed + self._pause, min(2.0 * self._pause, LONGEST_PAUSE)
        left = self._left(elapsed)
        try:
            print(f"{self.label}: {int(100.0 * self.share)}% in {clock_time(elapsed)}{'' if left == '?' else f', {left} left'}",
                  file=sys.stderr, flush=True)
        except (OSError, ValueError):
            self._enabled = False          # a full disk or a closed stream is no reason to end a run

    def _draw(self, elapsed: float) -> None:
        self._next = elapsed + NOTEBOOK_TIME
        try:
            self._bar = self._bar or notebook.Line()
            self._bar.show(self.share, f"{self.label}: {int(100.0 * self.share)}%, {clock_time(elapsed)}, "
                                       f"{self._left(elapsed)} left")
        except Exception:  # whatever a front end lacks: nobody waits for a bar
            self._bar, self._enabled = None, False

    def _layout(self, elapsed: float) -> str:
        return "{l_bar}{bar}| {elapsed}<" + self._left(elapsed) + "{postfix}"

    def _open(self, elapsed: float) -> None:
        try:
            from tqdm import tqdm
        except ImportError:
            self._enabled = False
            return
        self._bar = tqdm(total=self.total, initial=min(self.done, self.total), desc=self.label, file=sys.stderr,
                         dynamic_ncols=True, bar_format=self._layout(elapsed))
        # the work and the time before the bar appeared count for the remaining time
        self._bar.initial = 0
        self._bar.start_t -= elapsed
        self._bar.refresh()


def clock_time(seconds: float) -> str:
    """Return a time as h:mm:ss, or mm:ss below an hour."""
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02}:{whole % 60:02}" if hours else f"{minutes:02}:{whole % 60:02}"


def _is_terminal(stream: Any) -> bool:
    try:
        return bool(stream.isatty())
    except (AttributeError, ValueError):
        return False
