"""Events that say "do not trust this number": which kinds they are, how results show them, and the Python warning."""
from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any, TypeVar

from fastbeam.interface import notebook
from fastbeam.interface.errors import ResultWarning

T = TypeVar("T", bound=Callable[..., Any])
# kinds of events that make numbers untrustworthy; the others report what happened, or was done at the start
KINDS = ("coarse", "contact", "reversed", "unresolved", "drift", "massless", "order", "extrapolation", "leap", "lagging load",
         "shock")
# events that a text shows
MOST = 6


class Doubts:
    """Base of a result with events: the lines that `table()`, `repr` and notebooks end with."""

    events: Sequence[Mapping[str, Any]] = ()

    def _doubts(self) -> list[str]:
        return doubts(self.events)


class Tabled(Doubts):
    """Base of a result that its table shows, in texts and notebooks."""

    _title = "{}"
    info: dict[str, Any]

    def table(self) -> str:
        """Return a text: what is not to be trusted."""
        return "\n".join(self._doubts())

    def __str__(self) -> str:
        return self.table()

    def _repr_html_(self) -> str:
        return notebook.text(self._title.format(self.info["scene"]), self.table())


def doubts(events: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for every event that makes numbers untrustworthy; the first few are shown."""
    found = [f"{event['kind']}: {event.get('text', '')}" for event in events if event.get("kind") in KINDS]
    more = [f"and {len(found) - MOST} more like these in .events"] if len(found) > MOST else []
    return [f"unreliable result, {line}" for line in found[:MOST]] + more


def warns(function: T) -> T:
    """Decorate an analysis, above `@checked`: issue a ResultWarning if its result has such events, once that is complete.

    It names the line of the program that called; where fastbeam itself did, there is none.
    """
    @wraps(function)
    def call(*args: Any, **given: Any) -> Any:
        result = function(*args, **given)
        lines = result._doubts()
        if lines:
            frame, level = sys._getframe(1), 2
            while frame.f_back is not None and frame.f_globals.get("__name__") == "fastbeam.interface.deprecation":
                frame, level = frame.f_back, level + 1
            if not str(frame.f_globals.get("__name__")).startswith("fastbeam."):
                warnings.warn(ResultWarning("\n  ".join([f"{function.__name__}: {lines[0]}", *lines[1:]]), result=result),
                              stacklevel=level)
        return result
    return call  # type: ignore[return-value]
