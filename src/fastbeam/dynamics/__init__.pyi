"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.dynamics.checkpoint import Checkpoint as Checkpoint
from fastbeam.dynamics.checkpoint import load_checkpoint as load_checkpoint
from fastbeam.dynamics.time_loop import simulate as simulate
