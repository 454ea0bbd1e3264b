"""Python's garbage collector, held while modules load: they make thousands of objects and no garbage, and to look for it takes an
eighth of the time."""
from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def held() -> Iterator[None]:
    """No collection within, and none of what was made within right behind it."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():
            # all objects are old ones from here on, looked at when old ones are
            gc.freeze()
            gc.unfreeze()
        gc.enable()
