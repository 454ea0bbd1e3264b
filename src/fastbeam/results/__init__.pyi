"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.results.hdf5_reader import load_result as load_result
from fastbeam.results.observe.resultants import section_forces as section_forces
from fastbeam.results.plots.animation import animate as animate
from fastbeam.results.plots.plots import (
    plot_balance as plot_balance,
)
from fastbeam.results.plots.plots import (
    plot_invariants as plot_invariants,
)
from fastbeam.results.plots.plots import (
    plot_modes as plot_modes,
)
from fastbeam.results.plots.plots import (
    plot_overview as plot_overview,
)
from fastbeam.results.plots.plots import (
    plot_response as plot_response,
)
from fastbeam.results.plots.plots import (
    plot_shapes as plot_shapes,
)
from fastbeam.results.plots.plots import (
    plot_slider as plot_slider,
)
from fastbeam.results.result import Result as Result
