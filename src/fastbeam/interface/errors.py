"""The errors and the warning of fastbeam. Each message names the object, the value, the allowed range and the next step."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fastbeam.dynamics.checkpoint import Checkpoint
    from fastbeam.kernels.state import State
    from fastbeam.results.result import Result


class SceneError(ValueError):
    """Error of a scene or an argument that is not usable; raised before anything runs, except by user functions that fail on the
    way.

    Attributes
    ----------
    result : Result or None
        Of a run that ended so: everything computed until then, with `.state` and, of a run in time, `.checkpoint`. Any other
        exception of a function on the way has the same attribute.
    """

    result: Result | None = None


class ConvergenceError(RuntimeError):
    """Error of a step or load step that did not converge.

    Attributes
    ----------
    step : int
        Number of the step that failed, counted from 0.
    time : float
        Time (dynamics, s) or load factor (statics) of the last good state.
    residuals : list of float
        Norms of the residual over the Newton iterations of the failed step.
    worst : str
        The element, node, slider or joint with the largest residual.
    state : State
        The last good state; a run can start again from it.
    result : Result or None
        Everything computed until then.
    """

    def __init__(self, message: str, *, step: int = 0, time: float = 0.0, residuals: list[float] | None = None,
                 worst: str = "", state: State | None = None, result: Result | None = None) -> None:
        super().__init__(message)
        self.step, self.time, self.residuals = step, time, list(residuals or [])
        self.worst, self.state, self.result = worst, state, result


class Interrupted(KeyboardInterrupt):
    """Interrupt (Ctrl-C) of a run, which ended as usual: rows complete, files closed, the checkpoint renewed.

    Attributes
    ----------
    result : Result or None
        Everything computed until then.
    state : State or None
        The last state, a row of the result; None where a second Ctrl-C cut a step in two.
    checkpoint : Checkpoint or None
        Of a run in time: the last state with everything to go on bit for bit.
    """

    def __init__(self, message: str = "", *, result: Result | None = None, state: State | None = None,
                 checkpoint: Checkpoint | None = None) -> None:
        super().__init__(message)
        self.result, self.state, self.checkpoint = result, state, checkpoint


class BackendError(ImportError):
    """Error of a missing optional library; the message says what to install."""


class ResultFileError(ValueError):
    """Error of a file that is not a fastbeam result or checkpoint, is damaged, or cannot be written.

    Attributes
    ----------
    result : Result or None
        Where a run ended because its file could not be written: everything computed until then, with `.state` and
        `.checkpoint` to go on from.
    """

    result: Result | None = None


class ResultWarning(UserWarning):
    """Warning about a result whose numbers are not to be trusted by its events: a mesh that is too coarse, a step that is too
    long.

    It comes once for a result, when that is complete. `warnings.simplefilter("error", fb.ResultWarning)` makes it an exception.

    Attributes
    ----------
    result : Result, Modes, ...
        What the call would have returned, with `.events`.
    """

    def __init__(self, message: str = "", *, result: object = None) -> None:
        super().__init__(message)
        self.result: Any = result


def carry(error: BaseException, result: Callable[[], Any]) -> None:
    """Attach the numbers computed so far to an exception on its way out of a run, as `.result`, if possible."""
    with suppress(Exception):
        setattr(error, "result", result())
        error.add_note("fastbeam: everything computed until then is in .result of this exception")
