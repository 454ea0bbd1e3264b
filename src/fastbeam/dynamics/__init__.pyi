"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.dynamics.checkpoint import Checkpoint as Checkpoint
from fastbeam.dynamics.checkpoint import load_checkpoint as load_checkpoint
from fastbeam.dynamics.options import Method as Method
from fastbeam.dynamics.options import Output as Output
from fastbeam.dynamics.options import Solver as Solver
from fastbeam.dynamics.options import Start as Start
from fastbeam.dynamics.options import StepControl as StepControl
from fastbeam.dynamics.time_loop import simulate as simulate
