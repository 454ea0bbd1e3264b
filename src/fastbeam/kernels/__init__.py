"""Pure compiled functions of arrays.

All files but those of `jit` are imported at once: an implementation of a generic function is found only when its file has been
imported, and what is compiled without it would stay on the disk like that.
"""
from importlib import import_module
from pkgutil import walk_packages

from fastbeam.interface.lazy_import import held

__all__: list[str] = []

with held():
    for _found in walk_packages(__path__, f"{__name__}."):
        if not _found.name.startswith(f"{__name__}.jit."):
            import_module(_found.name)
