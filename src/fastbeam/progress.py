"""A progress bar for runs that take longer than a second."""
from __future__ import annotations

import os
import sys
import time
from typing import Any

# s; a run shorter than this shows nothing
QUIET_TIME = 1.0


class Progress:
    """Bar on stderr that appears only after `QUIET_TIME`; silent when tqdm is missing.

    Parameters
    ----------
    total : float
        Amount of work, in steps or in seconds of simulated time.
    label : str
        Text before the bar.
    enabled : bool, optional
        None: shown unless the environment says FASTBEAM_PROGRESS=0.

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

    def update(self, k: float = 1) -> None:
        """Add k units of finished work."""
        self.done += k
        if not self._enabled:
            return
        if self._bar is not None:
            self._bar.update(min(self.done, self.total) - self._bar.n)
        elif time.perf_counter() - self._start > QUIET_TIME:
            self._open()

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

    def _open(self) -> None:
        try:
            from tqdm import tqdm
        except ImportError:
            self._enabled = False
            return
        layout = "{l_bar}{bar}| {elapsed}<{remaining}{postfix}"
        self._bar = tqdm(total=self.total, initial=min(self.done, self.total), desc=self.label, file=sys.stderr,
                         dynamic_ncols=True, bar_format=layout)
        # the work and the time before the bar appeared count for the remaining time
        self._bar.initial = 0
        self._bar.start_t -= time.perf_counter() - self._start
        self._bar.refresh()
