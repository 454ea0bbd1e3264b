"""The sparse solvers take the same steps as the block elimination, and nets run through whichever suits them."""
from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.algebra.blocks import SIX, THREE
from fastbeam.kernels.linalg import pardiso as kernels
from fastbeam.kernels.linalg.pardiso import block_residual, distance, solve_sparse
from fastbeam.linalg import linear_system as linsolve
from fastbeam.linalg.halves import cut
from fastbeam.linalg.linear_system import Pardiso, SuperLU
from fastbeam.linalg.mkl import load_mkl
from fastbeam.stepping.condensed import Team

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bead, cantilever, drifts, free_beam, grid, straight  # noqa: E402

SAME = 1e-12  # of coordinates of size 1, after 20 steps that each end at round-off
ROUND_OFF = 1e-12


def dense_net() -> fb.Scene:
    """A cube of 8 x 8 x 8 crossings: the elimination would fill it."""
    return grid(8, 8, elements=1, degree=1)


def needs_mkl() -> None:
    if load_mkl() is None:
        pytest.skip("MKL is not installed")


def final_state(scene: fb.Scene, solver: str, backend: str = "auto") -> tuple[fb.Result, np.ndarray]:
    result = fb.simulate(fb.compile_scene(scene, solver=solver), t_end=0.4, step=0.02, solver=backend)
    return result, np.concatenate((result.state.q, result.state.s))


@pytest.mark.parametrize("make", [free_beam, bead])
@pytest.mark.parametrize("backend", ["pardiso", "superlu", "no mkl"])
def test_sparse_solvers_take_the_steps_of_the_elimination(make: object, backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if backend == "pardiso":
        needs_mkl()
    chain, expected = final_state(make(), "chain")
    if backend == "no mkl":
        monkeypatch.setenv("FASTBEAM_NO_MKL", "1")
    sparse, found = final_state(make(), "sparse", "auto" if backend == "no mkl" else backend)
    names = {"pardiso": "PARDISO, ", "superlu": "SuperLU", "no mkl": "SuperLU (MKL not found)"}
    assert sparse.info["solver"].startswith(names[backend])
    assert chain.info["solver"].startswith("block elimination, 0 steps")
    assert chain.info["fallbacks"] == sparse.info["fallbacks"] == 0
    assert np.max(np.abs(found - expected)) <= SAME
    assert max(drifts(sparse).values()) <= ROUND_OFF


def test_statics_by_the_sparse_solvers_is_the_same() -> None:
    chain = fb.solve_static(fb.compile_scene(cantilever(), solver="chain"))
    tip = chain.state.q[-12:-9]
    assert tip[2] > 0.3  # it bends visibly, the loads are no small perturbation
    for backend in ("auto", "superlu"):
        sparse = fb.solve_static(fb.compile_scene(cantilever(), solver="sparse"), backend=backend)
        assert np.max(np.abs(sparse.state.q - chain.state.q)) <= SAME


@pytest.mark.parametrize(("moment", "planar"), [(False, False), (False, True), (True, False)])
def test_statics_takes_symmetric_factors_where_no_moments_act(moment: bool, planar: bool) -> None:
    needs_mkl()
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    load = {"moment": (0, 3.0, 0)} if moment else {"force": (0.5, 0, 20.0)}
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, **load))
    sparse, chain = (fb.solve_static(fb.compile_scene(scene, solver=name, planar=planar)) for name in ("sparse", "chain"))
    assert sparse.info["solver"].startswith("PARDISO, " if moment else "PARDISO (symmetric), ")
    assert np.max(np.abs(sparse.state.q - chain.state.q)) <= SAME
    # Newton's method squares the increments with either
    assert sparse.info["iterations"] <= chain.info["iterations"] + 2


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("symmetric", [False, True])
def test_pardiso_solves_with_the_matrix_or_its_symmetric_part(size: int, symmetric: bool) -> None:
    needs_mkl()
    rng = np.random.default_rng(7)
    n = 7
    pairs = np.array([(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 0), (1, 4)])
    rows, columns = np.concatenate((pairs, pairs[:, ::-1], np.stack((np.arange(n),) * 2, axis=1))).T
    order = np.lexsort((columns, rows))
    rows, columns = rows[order], columns[order]
    blocks = np.zeros((rows.size, size, 8))
    blocks[:, :, :size] = rng.standard_normal((rows.size, size, size))
    blocks[rows == columns, :, :size] += 12.0 * np.eye(size)
    dense = np.zeros((n, size, n, size))
    dense[rows, :, columns] = blocks[:, :, :size]
    dense = dense.reshape(n * size, n * size)
    solver = Pardiso(load_mkl(), np.searchsorted(rows, np.arange(n + 1)), columns, 1, size, 1, symmetric=symmetric)
    right = rng.standard_normal(n * size)
    panel = right.copy()
    with solver.threads():
        assert solve_sparse(solver.tables, blocks.reshape(-1), panel, 1, SIX if size == 6 else THREE)
    matrix = 0.5 * (dense + dense.T) if symmetric else dense
    np.testing.assert_allclose(panel, np.linalg.solve(matrix, right), rtol=0.0, atol=1e-12)
    # residual and its scale with one half of the blocks
    t = solver.tables
    t.x[0] = rng.standard_normal(n * size)
    block_residual(t, t.x, t.b, t.r, SIX if size == 6 else THREE)
    np.testing.assert_allclose(t.r[0], right - matrix @ t.x[0], rtol=0.0, atol=1e-13)
    scale = np.linalg.norm(np.abs(right) + np.abs(matrix) @ np.abs(t.x[0]))
    found = distance(t, t.x, t.b, t.r, t.y, SIX if size == 6 else THREE)
    assert found == pytest.approx(np.linalg.norm(t.r[0]) / scale, rel=1e-12)


def lattice(*sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Structure by rows of a lattice of nodes, each coupled to its neighbours."""
    place = np.stack(np.meshgrid(*(np.arange(n) for n in sides), indexing="ij"), axis=-1).reshape(-1, len(sides))
    near = np.abs(place[:, None] - place).sum(axis=2) <= 1
    return np.concatenate(([0], np.cumsum(near.sum(axis=1)))), np.nonzero(near)[1]


@pytest.mark.parametrize("sides", [(9, 14), (40,), (2, 2, 12)])
def test_cut_leaves_two_halves_that_nothing_couples(sides: tuple[int, ...]) -> None:
    indptr, indices = lattice(*sides)
    first, second, between = cut(indptr, indices)
    assert np.array_equal(np.sort(np.concatenate((first, second, between))), np.arange(indptr.size - 1))
    assert min(first.size, second.size) >= 0.35 * (indptr.size - 1)
    side = np.zeros(indptr.size - 1, int)
    side[first], side[second] = 1, 2
    rows = np.repeat(np.arange(side.size), np.diff(indptr))
    assert set((side[rows] * side[indices]).tolist()) <= {0, 1, 4}


def test_cut_of_what_falls_apart_and_of_what_holds_together() -> None:
    indptr, indices = lattice(30)
    apart = np.concatenate((indptr, indptr[-1] + indptr[1:])), np.concatenate((indices, indices + 30))
    assert cut(*apart)[2].size == 1
    full = np.arange(0, 901, 30), np.tile(np.arange(30), 30)
    assert cut(*full) is None


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("columns", [1, 4])
def test_two_halves_solve_and_use_their_factors_again(size: int, columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    needs_mkl()
    monkeypatch.setattr(linsolve, "HALVES_FROM", 0)
    rng = np.random.default_rng(11)
    indptr, indices = lattice(9, 14)
    n = indptr.size - 1
    rows = np.repeat(np.arange(n), np.diff(indptr))
    blocks = np.zeros((rows.size, size, 8))
    blocks[:, :, :size] = rng.standard_normal((rows.size, size, size))
    blocks[rows == indices, :, :size] += 12.0 * np.eye(size)
    solver = Pardiso(load_mkl(), indptr, indices, columns, size, 1, reproducible=True)
    assert solver.halves is not None
    shape = SIX if size == 6 else THREE

    def check(good: bool = True) -> None:
        dense = np.zeros((n, size, n, size))
        dense[rows, :, indices] = blocks[:, :, :size]
        right = rng.standard_normal((n * size, columns))
        panel = np.zeros((n * size, 8))
        panel[:, :columns] = right
        assert solver.solve(blocks.reshape(-1), panel.reshape(-1), 8, shape, Team(2).each) == good
        if good:
            found = np.linalg.solve(dense.reshape(n * size, -1), right)
            np.testing.assert_allclose(panel[:, :columns], found, rtol=0.0, atol=1e-10)

    check()
    blocks[:, :, :size] *= 1.0 + 1e-4 * rng.standard_normal((rows.size, size, size))
    check()
    # factors, refinements, solutions with earlier factors
    assert solver.tables.counts[:3].tolist() == [1, 0, 1]
    kernels.begin_step(solver.tables)
    check()
    assert solver.tables.counts[:3].tolist() == [2, 0, 1]
    blocks[:, :, :size] += 3.0 * rng.standard_normal((rows.size, size, size))
    check()
    assert solver.tables.counts[:3].tolist() == [3, 0, 1]
    # a row of zeros
    for k in range(indptr[7], indptr[8]):
        blocks[k, 0] = 0.0
    kernels.begin_step(solver.tables)
    check(good=False)
    blocks[0, 0, 0] = np.nan
    check(good=False)


def test_pardiso_without_mkl_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FASTBEAM_NO_MKL", "1")
    with pytest.raises(fb.BackendError, match="no MKL runtime was found; pip install pypardiso, or use backend='auto'"):
        fb.simulate(fb.compile_scene(free_beam(), solver="sparse"), t_end=0.1, step=0.02, solver="pardiso")


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(fb.SceneError, match="solver: 'dense' does not exist: choose 'auto', 'chain' or 'sparse'"):
        fb.compile_scene(free_beam(), solver="dense")


def test_chain_solver_is_refused_for_a_net() -> None:
    with pytest.raises(fb.SceneError, match="solver='chain' cannot solve this scene efficiently, because it is a net and its "
                                            "matrix would fill; use solver='auto'"):
        fb.compile_scene(dense_net(), solver="chain")


def test_small_net_of_rigidly_joined_beams_conserves_everything_in_both_solvers() -> None:
    scene = grid(3)
    assert len(scene.beams) == 12
    auto = fb.compile_scene(scene)
    assert auto.solver == "chain"  # its fill is small
    expected = fb.simulate(auto, t_end=0.2, step=0.02)
    found = fb.simulate(fb.compile_scene(scene, solver="sparse"), t_end=0.2, step=0.02)
    for result in (expected, found):
        assert max(drifts(result).values()) <= ROUND_OFF
    assert np.max(np.abs(found.state.q - expected.state.q)) <= SAME


def test_net_with_much_fill_goes_to_the_sparse_solver_by_itself() -> None:
    model = fb.compile_scene(dense_net())
    assert model.solver == "sparse" and "sparse solver" in str(model)
    result = fb.simulate(model, t_end=0.04, step=0.02)
    assert result.info["solver"].startswith("PARDISO" if load_mkl() is not None else "SuperLU")
    assert result.info["fallbacks"] == 0
    assert max(drifts(result).values()) <= ROUND_OFF


def test_factors_are_used_again_within_a_step_and_everything_is_conserved() -> None:
    needs_mkl()
    net = grid(4, 4, elements=2, degree=2)
    options = {"t_end": 0.4, "step": 0.02, "progress": False}
    again = fb.simulate(fb.compile_scene(net, solver="sparse"), **options)
    counts = [int(x) for x in re.findall(r"(\d+) factorisations, used again (\d+) times", again.info["solver"])[0]]
    # the first iteration of every step factors, and what stays of its factors serves for others
    assert sum(counts) == again.info["iterations"]
    assert 20 <= counts[0] < again.info["iterations"] and counts[1] >= 20
    assert max(drifts(again).values()) <= ROUND_OFF
    never = fb.simulate(fb.compile_scene(net, solver="sparse"), solver="superlu", **options)
    assert np.max(np.abs(again.state.q - never.state.q)) <= SAME


def test_superlu_gives_no_solution_of_a_singular_matrix() -> None:
    # two block rows, the second a copy of the first
    blocks = np.zeros((4, 6, 8))
    blocks[:, :, :6] = np.random.default_rng(1).standard_normal((6, 6))
    solver = SuperLU(np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), 2, 6)
    right = np.random.default_rng(2).standard_normal((1, 12))
    assert solver.solve(blocks, right) is None
    blocks[0] += np.eye(6, 8)
    blocks[3] += np.eye(6, 8)
    x = solver.solve(blocks, right)
    matrix = blocks[:, :, :6].reshape(2, 2, 6, 6).transpose(0, 2, 1, 3).reshape(12, 12)
    np.testing.assert_allclose(matrix @ x[0], right[0], rtol=0.0, atol=1e-12)
    blocks[0, 0, 0] = np.nan
    assert solver.solve(blocks, right) is None
