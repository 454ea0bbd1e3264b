"""The compiled scene: tables of beams, contacts, joints and forces, and the state at the start."""
from fastbeam.interface.lazy_import import public_names

__all__, __getattr__, __dir__ = public_names(__name__)
