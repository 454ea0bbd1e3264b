"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.interface.errors import (
    BackendError as BackendError,
)
from fastbeam.interface.errors import (
    ConvergenceError as ConvergenceError,
)
from fastbeam.interface.errors import (
    Interrupted as Interrupted,
)
from fastbeam.interface.errors import (
    ResultFileError as ResultFileError,
)
from fastbeam.interface.errors import (
    ResultWarning as ResultWarning,
)
from fastbeam.interface.errors import (
    SceneError as SceneError,
)
