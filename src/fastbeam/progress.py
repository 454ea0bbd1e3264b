"""A progress bar for runs that take longer than a second; where nobody looks at a terminal, a line now and then."""
from __future__ import annotations

import os
import sys
import time
from typing import Any

# s; a run shorter than this shows nothing
QUIET_TIME = 1.0
# s between lines where stderr is no terminal
LINE_TIME = 10.0
# s; what takes longer is not foretold
LONGEST_FORETOLD = 99 * 3600.0


class Progress:
    """Bar on stderr that appears only after `QUIET_TIME`; silent when tqdm is missing.

    Where stderr is no terminal, in a log file for instance, it is a line every `LINE_TIME` instead, the first one after that
    time.

    Parameters
    ----------
    total : float
        Amount of work, in steps or in seconds of simulated time.
    label : str
        Text before the bar.
    enabled : bool, optional
        None: shown unless the environment says FASTBEAM_PROGRESS=0. True: the first line comes after `QUIET_TIME`.

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
        self._lines = not _is_terminal(sys.stderr)
        self._next = QUIET_TIME if enabled or not self._lines else LINE_TIME

    def update(self, k: float = 1) -> None:
        """Add k units of finished work."""
        self.done += k
        if not self._enabled:
            return
        elapsed = time.perf_counter() - self._start
        if self._bar is not None:
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
            self._bar.close()
            self._bar = None
        self._enabled = False

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _left(self, elapsed: float) -> str:
        """Time that is left if the rest goes on like this, as a text."""
        share = min(self.done / self.total, 1.0) if self.total > 0.0 else 1.0
        left = elapsed / share - elapsed if share > 0.0 else LONGEST_FORETOLD
        return clock_time(left) if left < LONGEST_FORETOLD else "over 99 h"

    def _line(self, elapsed: float) -> None:
        self._next = elapsed + LINE_TIME
        share = int(100.0 * min(self.done / self.total, 1.0)) if self.total > 0.0 else 100
        try:
            print(f"{self.label}: {share}% in {clock_time(elapsed)}, {self._left(elapsed)} left", file=sys.stderr, flush=True)
        except (OSError, ValueError):
            self._enabled = False          # a full disk or a closed stream is no reason to end a run

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
    """h:mm:ss, or mm:ss below an hour."""
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02}:{whole % 60:02}" if hours else f"{minutes:02}:{whole % 60:02}"


def _is_terminal(stream: Any) -> bool:
    try:
        return bool(stream.isatty())
    except (AttributeError, ValueError):
        return False
