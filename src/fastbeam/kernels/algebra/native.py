"""Loads, stores and zeros of `vectors`, by the same names, for WIDTH of the 8 lanes of a group."""
from __future__ import annotations

from fastbeam.kernels.algebra.vectors import make_load, make_store, make_store_matrix, make_zero, native

vld, vld2, vld3, vldm = (make_load(native, n) for n in (1, 2, 3, 9))
vst, vst2, vst3, vstm = (make_store(native, n, False) for n in (1, 2, 3, 9))
vadd2, vadd3 = (make_store(native, n, True) for n in (2, 3))
vst_matrix, vadd_matrix = make_store_matrix(native, False), make_store_matrix(native, True)
vzero, vzero2, vzero3, vzerom = (make_zero(native, n) for n in (1, 2, 3, 9))
