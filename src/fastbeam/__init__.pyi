"""All public names: those of the packages."""
from fastbeam.compile import *
from fastbeam.dynamics import *
from fastbeam.gradients import *
from fastbeam.interface import *
from fastbeam.results import *
from fastbeam.scene import *
from fastbeam.statics import *
from fastbeam.sweeps import Sweep as Sweep
from fastbeam.sweeps import load_sweep as load_sweep
from fastbeam.sweeps import sweep as sweep
from fastbeam.vibration import *

__version__: str
