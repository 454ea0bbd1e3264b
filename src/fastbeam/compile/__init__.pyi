"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.compile.compile import compile_scene as compile_scene
from fastbeam.compile.remeshing import with_moving_meshes as with_moving_meshes
