"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.gradients.adjoint import (
    AdjointRun as AdjointRun, RunGradient as RunGradient, RunSliderGradient as RunSliderGradient, adjoint_run as adjoint_run,
)
from fastbeam.gradients.critical_loads import CriticalSlopes as CriticalSlopes, critical_sensitivity as critical_sensitivity
from fastbeam.gradients.equilibria import Sensitivity as Sensitivity, sensitivity as sensitivity
