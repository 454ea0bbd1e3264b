"""Interface of public calls: checked arguments, errors, old names."""
from fastbeam.interface.lazy_import import public_names

__all__, __getattr__, __dir__ = public_names(__name__)
