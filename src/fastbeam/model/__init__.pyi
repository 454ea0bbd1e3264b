"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.model.model import Model as Model
