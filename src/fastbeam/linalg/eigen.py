"""Lowest eigenvalues of K x - B^T m = w M x, B x = 0: stiffness, constraints and masses as sparse matrices.

Krylov vectors of (K - shift M)^-1 M, in blocks, so that double and triple eigenvalues come together, orthonormal in the masses
and all of them kept (block Lanczos with full orthogonalisation; block Arnoldi where K is not symmetric). Unknowns without mass
(sliding coordinates, multipliers, triads without inertia) never enter: they follow from one more solution. Pivots of K - shift M
tell how many eigenvalues lie below a shift (Sylvester), so that none is missed.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.linalg.factors import Factoriser, Factors, Limits, factoriser_for
from fastbeam.linalg.orthonormal import NOTHING, TINY, orthonormal
from fastbeam.linalg.saddle import signs_between
from fastbeam.linalg.scaling import counted, entry_scales, equilibrated, parity, typical_factors, with_diagonal

Array = np.ndarray
# right-hand sides of a solution
BLOCK = 4
# residual of a Ritz pair next to its value, up to which it counts as converged
CONVERGED = 1e-9
# limits of solutions
LIMITS = Limits(1e-13, 1e-6, np.inf, 1e-12, 3, 19, last_bits=2.0 * np.finfo(float).eps)
# share of the largest entry of a column from which on SuperLU takes the one on the diagonal: without exchanges pivots are counted
FEW = 0.01
# share of a right-hand side that GIVE may take up: factors whose pivots were moved leave more between dependent constraints
PROXIMAL = 1e-3
# shift next to the largest stiffness over mass, where a zero eigenvalue would make the matrix singular
LEAST_SHIFT = 1e-13
# largest ratio of the lowest nonzero eigenvalue and the shift if there are zero eigenvalues; beyond, the shift is moved
CLOSE = 1e3
MOVES = 3
# added to the diagonal of the scaled matrix that is factored: for multipliers, so that dependent constraints share the
# force, and for unknowns with neither mass nor stiffness, if it is singular. Refinement with the matrix itself removes both again
GIVE, IDLE = 1e-13, 1e-10
# gap of constraints next to the largest component, scaled
OPEN = 1e-6
# round-off of x . K x, next to |x| . |K| |x|
NOISE = 8.0 * np.finfo(float).eps
# neighbours differ by more than this share where eigenvalues are counted; gaps and places in them where that is tried; unknowns
# up to which it is done by all eigenvalues of a dense matrix where pivots are not certain
DISTINCT, GAPS, SHARES, DENSE = 1e-6, 3, (0.5, 0.3), 1500
# growth of the number of Krylov vectors between two solutions of the projected problem
GROWTH = 1.04


class Pencil(NamedTuple):
    """Matrix pencil of n coordinates, of which the first have mass, and multipliers."""

    stiffness: Any        # sparse by rows [n, n]
    mass: Any             # sparse by rows [k, k], k <= n, positive semidefinite
    multiplier: Array     # bool [n]
    is_symmetric: bool
    still: Any            # sparse [k, j]: zero-energy vectors with disjoint supports, left out
    turns: Array          # bool [n]: True for coordinates that are rotations


class Eigen(NamedTuple):
    """Eigenvalues by their size, the negative ones first."""

    values: Array         # [m], complex where the matrix is not symmetric
    vectors: Array        # [n, m]: all coordinates and multipliers; of unit mass; of complex pairs the real and imaginary part
    noise: Array          # [m]: size of a zero eigenvalue by round-off of the stiffness
    is_complete: bool     # True if there are no more, or the number of pivots confirms that none below the last is missing
    factors: Shifted


class SingularError(ArithmeticError):
    """Error of a matrix for which no acceptable solution was found."""


class Shifted:
    """Factors of K - shift M, scaled to a diagonal or entries of 1; by PARDISO, or SuperLU. `order`: that of factors of the same
    pencil at another shift, which saves more than half of the time. Raises SingularError: when it is made, or solves."""

    def __init__(self, pencil: Pencil, shift: float, backend: str, order: Array | None = None) -> None:
        self.shift, self.pencil = shift, pencil
        n, k = pencil.multiplier.size, pencil.mass.shape[0]
        matrix = pencil.stiffness
        if shift:
            matrix = (matrix - shift * grown(pencil.mass, n)).tocsr()
        bordered = bool(pencil.multiplier.any()) or k < n
        once, self.scale = scales(matrix, bordered, pencil)
        # neither stiffness nor mass, such as the spin of a thin rod about its axis
        massless = np.ones(n, bool)
        massless[:k] = pencil.mass.diagonal() == 0.0
        by = factoriser_for(backend, symmetric=pencil.is_symmetric, matching=bordered, order=order)
        draw = np.random.default_rng(1).standard_normal((2 * BLOCK, n))
        self._factors = regularised(with_diagonal(matrix), by, LIMITS, (once * self.scale, self.scale), pencil.multiplier,
                                    massless,
                                  draw, PROXIMAL)
        of = self._factors.by
        assert of is not None
        self.order, self.name, negative = of.order, of.name, of.negative
        self.below = negative - int(pencil.multiplier.sum()) if pencil.is_symmetric and negative is not None else None

    def solve(self, right: Array) -> Array:
        """Solve with K - shift M for right-hand sides [n, m]."""
        x = self._factors.solve(np.ascontiguousarray(right.T))
        if x is None:
            raise SingularError
        return x.T


def regularised(matrix: Any, by: Factoriser | None, limits: Limits, scales: tuple[Array, Array], multiplier: Array, idle: Array,
              draw: Array, most: float = np.inf) -> Factors:
    """Factor a matrix whose constraints may be dependent, and with coordinates, bool `idle` [n], without stiffness.

    Solutions are tried for the first half of what is drawn [2 m, n], in scaled rows; in those of constraints and idle coordinates
    for products of the matrix with the second half, so that they can be met. most: share of these that GIVE may take up.

    Raises SingularError: no solver finds solutions that are accepted.
    """
    for share in (0.0, IDLE):
        if share and not idle.any():
            break
        found = Factors(matrix, by, limits, scales, np.where(multiplier, -GIVE, np.where(idle, share, 0.0)), FEW)
        right, x = np.split(draw, 2)
        right = np.where(multiplier | idle, (found.scaled @ x.T).T, right)
        if found.solve_scaled(right, most_given=most) is not None:
            return found
    raise SingularError


def lowest(pencil: Pencil, n: int, backend: str = "auto") -> Eigen:
    """Find the n lowest eigenvalues, fewer if there are no more. Raises SingularError: K - shift M is singular for every shift,
    or Krylov vectors do not converge."""
    shift, order = -LEAST_SHIFT * stiffest(pencil), None
    for moves in range(MOVES + 1):
        factors = Shifted(pencil, shift, backend, order)
        order = factors.order
        values, vectors, better = _krylov(factors, n, moves < MOVES)
        if better is None:
            break
        shift = better
    found = _with_noise(pencil, factors, values, vectors)
    return found._replace(is_complete=True) if found.values.size < n else _confirmed(found, n, backend)


class _Inverse:
    """Inverse of K - shift M, as an operator on the unknowns that have mass; mass: sparse [k, k], that of the pencil, times 1 or
    2."""

    def __init__(self, factors: Shifted) -> None:
        self.factors = factors
        mass, still = factors.pencil.mass, factors.pencil.still
        # of such masses roots have the same bits in other units
        heavy = mass.diagonal() > 0.0
        self._by = parity(mass.diagonal()[np.argmax(heavy)])
        self.mass = self._by * mass
        self._root = np.sqrt(np.where(heavy, self.mass.diagonal(), 1.0))
        self._weights = np.asarray((self.mass @ still).multiply(still).sum(axis=0)).reshape(-1)
        self._draw = np.random.default_rng(0)

    def anything(self) -> Array:
        """Draw a block to begin with [k, BLOCK]."""
        drawn = self._draw.standard_normal((self._root.size, BLOCK))
        return self.on(self.mass @ (drawn / self._root[:, None]))

    def on(self, right: Array) -> Array:
        """Solve for right [k, m], without the vectors `still` of the pencil."""
        pencil, k = self.factors.pencil, self._root.size
        whole = np.zeros((pencil.multiplier.size, right.shape[1]))
        whole[:k] = right / self._by
        x = self.factors.solve(whole)[:k]
        if self._weights.size:
            x -= pencil.still @ ((pencil.still.T @ (self.mass @ x)) / self._weights[:, None])
        return x


def _krylov(factors: Shifted, n: int, may_move: bool) -> tuple[Array, Array, float | None]:
    """Eigenvalues next to the shift with vectors [k, m], or a better shift."""
    pencil, inverse = factors.pencil, _Inverse(factors)
    mass, k = inverse.mass, pencil.mass.shape[0]
    most = min(k, 12 * n + 200)
    basis = np.zeros((k, min(most, 4 * n + 40) + 2 * BLOCK), order="F")
    h = np.zeros((basis.shape[1],) * 2)
    m, look = 0, min(n, most)
    block, weighed, _, _ = orthonormal(inverse.anything(), basis[:, :0], mass)
    values, y = np.zeros(0, complex), np.zeros((0, 0))
    while block.shape[1]:
        b = block.shape[1]
        if m + 2 * b > basis.shape[1]:
            more = min(basis.shape[1], max(most + 2 * BLOCK - basis.shape[1], 2 * BLOCK))
            basis = np.asfortranarray(np.pad(basis, ((0, 0), (0, more))))
            h = np.pad(h, (0, more))
        basis[:, m:m + b] = block
        known = basis[:, :m + b]
        block, weighed, remainder, h[:m + b, m:m + b] = orthonormal(inverse.on(weighed), known, mass)
        m += b
        if remainder.size:
            h[m:m + len(remainder), m - b:m] = remainder
        if m < look and m < most and block.shape[1]:
            continue
        # to solve a small projected matrix in every iteration would take longer than the iteration
        look = int(GROWTH * m)
        values, y = _ritz(h[:m, :m], pencil.is_symmetric)
        error = np.linalg.norm(remainder @ y[m - b:], axis=0) if remainder.size else np.zeros(m)
        good = error <= CONVERGED * np.abs(values)
        picks, done, better = _enough(values, good, factors, n)
        if better is not None and may_move:
            return values, basis, better
        if done or m >= most:
            break
        if not block.shape[1]:
            # closed under the operator: what is left, if anything, has equal eigenvalues
            block, weighed, _, _ = orthonormal(inverse.anything(), known, mass)
    if not m:
        return np.zeros(0), np.zeros((k, 0)), None
    if not done and block.shape[1] and m < k:
        raise SingularError
    return factors.shift + 1.0 / values[picks], basis[:, :m] @ y[:, picks], None


def _ritz(h: Array, symmetric: bool) -> tuple[Array, Array]:
    """Return values and vectors of the projected operator."""
    if symmetric:
        return np.linalg.eigh(0.5 * (h + h.T))
    values, y = np.linalg.eig(h)
    return values, y / np.linalg.norm(y, axis=0)


def _enough(values: Array, good: Array, factors: Shifted, n: int) -> tuple[Array, bool, float | None]:
    """Return the Ritz values that are the lowest eigenvalues, whether there are n of them, and a shift that suits them better."""
    with np.errstate(divide="ignore"):
        real = factors.shift + np.real(1.0 / np.where(values == 0.0, TINY, values))
    live = np.abs(values) > 1e-14 * np.max(np.abs(values), initial=0.0)
    order = np.argsort(np.where(live, real, np.inf))[:int(live.sum())]
    low = order[np.real(values[order]) < 0.0]
    above = order[np.real(values[order]) >= 0.0]
    if factors.below is not None:
        # as many as lie below the shift, those next to it first
        low = low[np.argsort(-np.abs(values[low]))][:factors.below]
        low = low[np.argsort(real[low])]
    else:
        low = low[good[low]]
    wanted = above[:max(n - low.size, 0)]
    done = (factors.below is None or low.size >= factors.below) and bool(good[low].all() and good[wanted].all())
    done &= wanted.size + low.size >= n
    picks = np.concatenate((low, wanted))[:max(n, 0)]
    shift = abs(factors.shift)
    every = np.abs(real[order[good[order]]])
    zero, elastic = every[every < 0.1 * shift], every[every > shift]
    better = None
    if zero.size and elastic.size and np.min(elastic) > CLOSE * shift:
        # zero eigenvalues drown the others
        better = -0.5 * float(np.min(elastic))
    return picks, done, better


def _with_noise(pencil: Pencil, factors: Shifted, values: Array, vectors: Array) -> Eigen:
    """Return whole vectors, of unit mass, and round-off of the values; values within round-off are set to zero."""
    k, n = pencil.mass.shape[0], pencil.multiplier.size
    if not pencil.is_symmetric:
        values, vectors = _in_pairs(values, vectors)
    whole = np.zeros((n, vectors.shape[1]))
    for j in range(0, vectors.shape[1], BLOCK):
        right = np.zeros((n, vectors[:, j:j + BLOCK].shape[1]))
        right[:k] = pencil.mass @ vectors[:, j:j + BLOCK]
        whole[:, j:j + BLOCK] = factors.solve(right)
    if pencil.still.shape[1]:
        weights = np.asarray((pencil.mass @ pencil.still).multiply(pencil.still).sum(axis=0)).reshape(-1)
        whole[:k] -= pencil.still @ ((pencil.still.T @ (pencil.mass @ whole[:k])) / weights[:, None])
    size = np.sqrt(np.maximum(np.sum(whole[:k] * (pencil.mass @ whole[:k]), axis=0), TINY))
    size[_others(values)] = size[np.flatnonzero(np.imag(values) > 0.0)]
    whole /= size
    absolute = abs(pencil.stiffness)
    live = _is_eigenvector(pencil, factors, whole, size * np.abs(values - factors.shift))
    values, whole = values[live], whole[:, live]
    free = np.where(pencil.multiplier[:, None], 0.0, np.abs(whole))
    noise = NOISE * (np.sum(free * (absolute @ free), axis=0) + 2.0 * abs(factors.shift))
    if pencil.is_symmetric:
        values = np.where(np.abs(values) <= noise, 0.0, values)
    return Eigen(values, whole, noise, False, factors)


def _is_eigenvector(pencil: Pencil, factors: Shifted, whole: Array, kept: Array) -> Array:
    """Sieve vectors [n, m], bool [m]: GIVE makes eigenvalues of its own behind all others, whose vectors do not satisfy the
    constraints, or are round-off once a refined solution has taken GIVE out. kept: remaining share of their size, [m]."""
    is_kept = kept > 0.5 if pencil.is_symmetric else np.ones(kept.size, bool)
    return is_kept & satisfied(pencil, factors.scale, whole)


def satisfied(pencil: Pencil, scale: Array, x: Array) -> Array:
    """Return which vectors [n, m] satisfy the constraints, bool [m]; scale: of rows and columns [n]."""
    if not pencil.multiplier.any():
        return np.ones(x.shape[1], bool)
    gap = np.abs(scale[pencil.multiplier, None] * (pencil.stiffness[pencil.multiplier] @ x)).max(axis=0)
    return np.asarray(gap <= OPEN * np.abs(x[~pencil.multiplier] / scale[~pencil.multiplier, None]).max(axis=0))


def _in_pairs(values: Array, vectors: Array) -> tuple[Array, Array]:
    """Return real vectors: x, y of a complex pair with K (x + i y) = w M (x + i y), where w has a positive imaginary part and
    comes first."""
    order = np.lexsort((-np.imag(values), np.abs(np.imag(values)), np.round(np.real(values), 12)))
    values, vectors = values[order], vectors[:, order]
    alone = np.flatnonzero(np.imag(values) != 0.0)
    if alone.size % 2:
        # a pair that was cut
        values, vectors = (np.delete(x, alone[-1], axis=-1) for x in (values, vectors))
    return values, np.where(np.imag(values) >= 0.0, np.real(vectors), -np.imag(vectors))


def _others(values: Array) -> Array:
    """Return the indices of the second values of complex pairs."""
    return np.flatnonzero(np.imag(values) < 0.0)


def _confirmed(found: Eigen, n: int, backend: str) -> Eigen:
    """Compare the number of eigenvalues below a shift in a gap, behind the last ones, with that of the found ones, and mark the
    result as complete; if some are missing, search from that shift for as many as there are."""
    pencil = found.factors.pencil
    if not pencil.is_symmetric or found.values.size < 2:
        return found
    still = pencil.still.shape[1]
    for last, shift in _gaps(found):
        try:
            between = Shifted(pencil, shift, backend, found.factors.order)
        except SingularError:
            continue
        if between.below is None:
            between.below = _below(pencil, shift)
        if between.below is None:
            continue
        between.below -= still * (shift > 0.0)
        if between.below == last + 1:
            return found._replace(is_complete=True)
        try:
            values, vectors, _ = _krylov(between, max(n, between.below), False)
        except SingularError:
            continue
        again = _with_noise(pencil, between, values, vectors)
        if np.sum(again.values < shift) == between.below:
            return again._replace(values=again.values[:n], vectors=again.vectors[:, :n], noise=again.noise[:n], is_complete=True)
    return found


def _gaps(found: Eigen) -> list[tuple[int, float]]:
    """Return shifts between the last eigenvalues, in clear gaps, and the numbers of the eigenvalues before them."""
    values = np.real(found.values)
    size = np.maximum(np.abs(values), np.maximum(found.noise, abs(found.factors.shift)))
    gaps = np.flatnonzero(np.diff(values) > DISTINCT * size[1:] + 2.0 * found.noise[1:])[::-1][:GAPS]
    return [(int(k), float((1.0 - share) * values[k] + share * values[k + 1])) for share in SHARES for k in gaps]


def _below(pencil: Pencil, shift: float) -> int | None:
    """Count the eigenvalues below a shift if PARDISO cannot count its pivots; None if this count is not certain either."""
    n = pencil.multiplier.size
    matrix = (pencil.stiffness - shift * grown(pencil.mass, n)).tocsr()
    once, scale = scales(matrix, True, pencil)
    matrix.data *= entry_scales(matrix, once * scale, scale)
    if n <= DENSE:
        # dependent constraints and idle coordinates are zeros
        values = np.linalg.eigvalsh(matrix.toarray())
        zero = np.abs(values) <= NOTHING
        rows = matrix[pencil.multiplier][:, ~pencil.multiplier].toarray()
        return int(np.sum((values < 0.0) & ~zero)) - (int(np.linalg.matrix_rank(rows, NOTHING)) if rows.size else 0)
    found = signs_between(matrix, pencil.multiplier)
    return None if found is None or found[1] else found[0]


def stiffest(pencil: Pencil) -> float:
    """Return the largest stiffness over mass of a coordinate; 1 if there is none."""
    mass = pencil.mass.diagonal()
    stiffness = np.abs(pencil.stiffness.diagonal()[:mass.size])
    turns = pencil.turns[:mass.size]
    heavy = (mass > 0.0) & np.where(turns, counted(stiffness, turns), counted(stiffness, ~turns))
    # spins of thin rods have next to no inertia: the median does not see them where the largest does
    return float(np.median(stiffness[heavy] / mass[heavy])) if heavy.any() else 1.0


def grown(matrix: Any, n: int) -> Any:
    """Return a matrix with rows and columns of zeros behind the others, [n, n]."""
    grown = matrix.copy()
    grown.resize((n, n))
    return grown


def scales(matrix: Any, bordered: bool, pencil: Pencil) -> tuple[float, Array]:
    """Return factors of a matrix, that of a pencil and perhaps rows behind it, and of its rows and columns, powers of two:
    products with them are exact, and the same in units that differ by such powers."""
    if bordered:
        more = np.zeros(matrix.shape[0] - pencil.multiplier.size)
        stiff = np.abs(pencil.stiffness.diagonal())
        if pencil.mass.shape[0]:
            # the stiffness of sliders may be round-off
            stiff[pencil.mass.shape[0]:] = 0.0
        whole = abs(matrix).tocsr()
        once, *begin = typical_factors(whole, np.append(pencil.multiplier, more == 0.0), np.append(pencil.turns, more > 0.0),
                              np.append(stiff, more))
        row, column = equilibrated(once * whole, (begin[0], begin[1]))
        squares = row * column
    else:
        diagonal = np.abs(matrix.diagonal())
        largest = float(np.max(diagonal, initial=0.0)) or 1.0
        once = parity(largest)
        squares = 1.0 / (once * np.maximum(diagonal, 1e-20 * largest))
    return once, np.exp2(np.round(0.5 * np.log2(squares)))
