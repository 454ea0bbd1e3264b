"""Sparse factorisations, eigenvalues and orders of elimination."""

__all__: list[str] = []
