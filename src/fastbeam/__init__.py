"""fastbeam: large flexible multibody systems with sliding contact.

Geometrically exact beams with a rotationless director triad, energy-momentum conserving time integration, sliders whose sliding
coordinate is an unknown of the same step.
"""
from __future__ import annotations

import sys
from typing import Any

from fastbeam.interface.deprecation import OldModules, new_name
from fastbeam.interface.lazy_import import public_names

__version__ = "0.2.0"
_names, _get, _ = public_names(__name__)
__all__ = ["__version__", *_names]
if OldModules not in sys.meta_path:
    sys.meta_path.append(OldModules)


def __getattr__(name: str) -> Any:
    """Import a public name, or give the new one of an old name, with a FutureWarning."""
    if name not in _names and not name.startswith("_"):
        name = new_name(name) or name
    return _get(name)


def __dir__() -> list[str]:
    """List the public names."""
    return __all__
