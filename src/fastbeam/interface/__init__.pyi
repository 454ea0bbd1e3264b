"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.interface.errors import (
    BackendError as BackendError, ConvergenceError as ConvergenceError, Interrupted as Interrupted,
    ResultFileError as ResultFileError, ResultWarning as ResultWarning, SceneError as SceneError,
)
