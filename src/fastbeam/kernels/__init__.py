"""Pure compiled functions of arrays.

All files are imported at once: an implementation of a generic function is found only when its file has been imported, and what is
compiled without it would stay on the disk like that.
"""
from importlib import import_module
from pkgutil import iter_modules

from .._collection import held

with held():
    for _found in iter_modules(__path__):
        import_module(f"{__name__}.{_found.name}")
