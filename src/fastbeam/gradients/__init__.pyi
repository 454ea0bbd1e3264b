"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.gradients.adjoint import (
    AdjointRun as AdjointRun,
)
from fastbeam.gradients.adjoint import (
    RunGradient as RunGradient,
)
from fastbeam.gradients.adjoint import (
    RunSliderGradient as RunSliderGradient,
)
from fastbeam.gradients.adjoint import (
    adjoint_run as adjoint_run,
)
from fastbeam.gradients.critical_load_slopes import CriticalSlopes as CriticalSlopes
from fastbeam.gradients.critical_load_slopes import critical_sensitivity as critical_sensitivity
from fastbeam.gradients.equilibria import Sensitivity as Sensitivity
from fastbeam.gradients.equilibria import sensitivity as sensitivity
