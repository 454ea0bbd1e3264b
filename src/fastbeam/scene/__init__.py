"""Scene classes that a user writes: validated data only; `compile_scene` turns it into tables."""
from fastbeam.interface.lazy_import import public_names

__all__, __getattr__, __dir__ = public_names(__name__)
