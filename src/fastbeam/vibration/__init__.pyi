"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.results.mode_shapes import DampedModes as DampedModes
from fastbeam.results.mode_shapes import Modes as Modes
from fastbeam.results.mode_shapes import SteadyModes as SteadyModes
from fastbeam.results.responses import FrequencyResponse as FrequencyResponse
from fastbeam.vibration.harmonic import frequency_response as frequency_response
from fastbeam.vibration.linear_buckling import BucklingModes as BucklingModes
from fastbeam.vibration.linear_buckling import critical_loads as critical_loads
from fastbeam.vibration.natural_modes import modes as modes
