"""Rows, results, files and pictures; what is read from a state."""
from fastbeam.interface.lazy_import import public_names

__all__, __getattr__, __dir__ = public_names(__name__)
