"""Natural, damped, steady and buckling modes, and the response to harmonic loads."""
from fastbeam.interface.lazy_import import public_names

__all__, __getattr__, __dir__ = public_names(__name__)
