"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.statics.dynamic_relaxation import relax as relax
from fastbeam.statics.finding_lengths import find_lengths as find_lengths
from fastbeam.statics.form_finding import force_density as force_density
from fastbeam.statics.paths.equilibrium_paths import solve_path as solve_path
from fastbeam.statics.static_analysis import solve_static as solve_static
from fastbeam.statics.steady_motion import Spin as Spin
from fastbeam.statics.steady_motion import Travel as Travel
from fastbeam.statics.stick_limits import stick_interval as stick_interval
