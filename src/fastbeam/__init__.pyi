"""All public names: those of the packages."""
from fastbeam.compile import *
from fastbeam.dynamics import *
from fastbeam.gradients import *
from fastbeam.interface import *
from fastbeam.results import *
from fastbeam.scene import *
from fastbeam.statics import *
from fastbeam.vibration import *
from fastbeam.sweeps import Sweep as Sweep, load_sweep as load_sweep, sweep as sweep

__version__: str
