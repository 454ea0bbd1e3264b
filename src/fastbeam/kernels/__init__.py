"""Pure compiled functions of arrays.

All files are imported at once: an implementation of a generic function is found only when its file has been imported, and what is
compiled without it would stay on the disk like that.
"""
import gc
from importlib import import_module
from pkgutil import iter_modules

# thousands of objects and no garbage: to look for it takes an eighth of the time
_collects = gc.isenabled()
gc.disable()
try:
    for _found in iter_modules(__path__):
        import_module(f"{__name__}.{_found.name}")
finally:
    if _collects:
        gc.enable()
