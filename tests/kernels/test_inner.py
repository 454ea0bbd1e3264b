"""Inner nodes eliminated within their elements: same steps, same equilibria, safe pivots."""
from __future__ import annotations

import numba
import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.algebra.blocks import SIX, THREE, lu_lanes, solve_lanes, subtract_lanes
from fastbeam.kernels.beams.inner_nodes import PIVOT

Array = np.ndarray
SECTION = fb.Section.circle(radius=0.02, E=5e6, rho=1000.0)


def frame(strain: str = "simo_reissner", degree: int = 3, loads: bool = False) -> fb.Scene:
    """A boom on a clamp with a body at its end, a cable on a ball joint, a bead on the boom, a mast whose inner node slides on
    the cable: ties with arms at element ends, columns on inner nodes of both sides of a contact."""
    boom = fb.Beam.straight("boom", (0, 0, 0), (2, 0, 0), section=SECTION, elements=9, degree=degree, strain=strain)
    cable = fb.Beam.straight("cable", (2, 0.1, 0), (2, 0.1, -1.5), section=SECTION, elements=5, degree=degree, strain=strain)
    load = fb.RigidBody("load", mass=0.4, inertia=(2e-3, 3e-3, 4e-3), position=(2.05, 0.0, 0.02))
    mast = fb.Beam.straight("mast", (1.6, 0.1, -0.6), (2.4, 0.1, -0.6), section=SECTION, elements=2, degree=2, strain=strain)
    bead = fb.PointMass("bead", mass=0.3)
    parts = [boom, cable, load, fb.Clamp(boom.start), fb.RigidConnection(boom.end, load),
             fb.BallJoint(load.point((-0.05, 0.1, -0.02)), cable.start)]
    if loads:
        wind = fb.DistributedLoad("wind", cable, force=(0.06, 0.02, 0))
        return fb.Scene(*parts, wind, fb.Clamp(cable.end), gravity=(0, 0, -2.0))
    return fb.Scene(*parts, mast, bead, fb.Slider("on boom", bead, boom, at=1.1, rate=0.4),
                    fb.Slider("on cable", mast.node(2), cable, at=0.6), gravity=(0, 0, -9.81))


def runs(scene: fb.Scene, solver: str = "auto", **changes: object) -> tuple[fb.Result, fb.Result]:
    """The same run with and without the elimination."""
    models = [fb.compile_scene(scene, solver=solver, eliminate_inner=eliminate) for eliminate in (True, False)]
    assert models[0].inner is not None and models[1].inner is None
    assert models[0].pattern.n < models[1].pattern.n
    options = {"t_end": 0.03, "step": 3e-3, "progress": False} | changes
    return tuple(fb.simulate(model, **options) for model in models)


def assert_same(one: fb.Result, other: fb.Result, tolerance: float) -> None:
    # two roundings of the same step; forces against the weight of the bead
    for name, scale in (("q", 1.0), ("v", 1.0), ("s", 1.0), ("force", 3.0)):
        x, y = getattr(one.state, name), getattr(other.state, name)
        assert np.max(np.abs(x - y), initial=0.0) <= tolerance * scale, name


@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_steps_are_the_same(strain: str, degree: int) -> None:
    one, other = runs(frame(strain, degree))
    assert_same(one, other, 1e-10)
    assert one.info["iterations"] == other.info["iterations"]
    assert one.drift("total") < 1e-12


@pytest.mark.parametrize("method", ["midpoint", "trapezoidal", "generalized_alpha"])
def test_steps_of_other_methods_are_the_same(method: str) -> None:
    one, other = runs(frame(), method=method)
    assert_same(one, other, 1e-9)


@pytest.mark.parametrize("backend", ["auto", "superlu"])
def test_sparse_solvers_see_the_end_nodes_only(backend: str) -> None:
    one, other = runs(frame(), solver="sparse", backend=backend)
    assert_same(one, other, 1e-10)


def test_equilibria_are_the_same() -> None:
    scene = frame(loads=True)
    one, other = (fb.solve_static(fb.compile_scene(scene, eliminate_inner=e)) for e in (True, False))
    assert np.max(np.abs(one.state.q - other.state.q)) < 1e-11


def test_nodes_with_another_role_stay() -> None:
    beam = fb.Beam.straight("beam", (0, 0, 0), (3, 0, 0), section=SECTION, elements=24, degree=2)
    # groups of 8 elements: the pin keeps those of the middle one
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Pin(beam.node(2 * 10 + 1))))
    assert model.inner is not None
    assert model.inner.element.size == 16
    assert model.pattern.n == beam.n_nodes - 16
    spline = fb.Beam.straight("spline", (0, 0, 0), (3, 0, 0), section=SECTION, elements=24, interpolation="bspline", degree=3)
    assert fb.compile_scene(fb.Scene(spline)).inner is None


def test_failed_step_names_an_inner_node() -> None:
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=SECTION, elements=4, degree=4)
    scene = fb.Scene(beam, fb.Load("blow", beam.node(6), force=(0, 0, 4e6)), fb.Clamp(beam.start))
    with pytest.raises(fb.ConvergenceError) as failed:
        fb.simulate(fb.compile_scene(scene), t_end=1.0, step=0.5, solver=fb.Solver(max_iterations=2), progress=False)
    assert "node" in failed.value.worst


def lanes(matrices: Array) -> Array:
    return np.ascontiguousarray(matrices.transpose(1, 2, 0)).reshape(-1)


@numba.njit
def factor_lanes(a, out, size):
    return lu_lanes(a, 0, out, 0, PIVOT, size)


@numba.njit
def solve_columns(lu, b, out, size):
    n = len(size)
    for c in range(0, 8 * n, 8):
        solve_lanes(lu, 0, b, c, 8 * n, out, c, 8 * n, size)


@numba.njit
def minus_product(a, b, c, columns, size):
    subtract_lanes(a, 0, b, 0, c, 0, columns, size)


def solved(a: Array, b: Array) -> Array:
    """A^-1 B of 8 blocks."""
    n = a.shape[1]
    size = SIX if n == 6 else THREE
    lu, out = np.zeros(8 * n * n), np.zeros(8 * n * n)
    assert factor_lanes(lanes(a), lu, size)
    solve_columns(lu, lanes(b), out, size)
    return out.reshape(n, n, 8).transpose(2, 0, 1)


@pytest.mark.parametrize("n", [6, 3])
def test_blocks_are_solved_lane_by_lane(n: int) -> None:
    a, b = np.random.default_rng(1).standard_normal((2, 8, n, n))
    a += 6.0 * np.eye(n)
    assert np.allclose(solved(a, b), np.linalg.solve(a, b), rtol=0, atol=1e-13)


@pytest.mark.parametrize("columns", [1, 3, 6])
@pytest.mark.parametrize("size", [SIX, THREE], ids=["space", "plane"])
def test_products_are_subtracted_lane_by_lane(size: tuple[int, ...], columns: int) -> None:
    rng = np.random.default_rng(4)
    n = len(size)
    a, b, c = rng.standard_normal((8, n, n)), *rng.standard_normal((2, 8, n, columns))
    out = lanes(c)
    minus_product(lanes(a), lanes(b), out, (0,) * columns, size)
    assert np.allclose(out.reshape(n, columns, 8).transpose(2, 0, 1), c - a @ b, rtol=0, atol=1e-13)


def test_stiff_and_soft_directions_leave_a_small_residual() -> None:
    # axial against bending stiffness of a slender beam
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.standard_normal((8, 6, 6)))[0]
    a = turn @ (np.logspace(0, 12, 6)[:, None] * turn.transpose(0, 2, 1))
    x = rng.standard_normal((8, 6, 6))
    b = a @ x
    residual = np.abs(a @ solved(a, b) - b).max(axis=(1, 2))
    assert np.all(residual < 1e-13 * np.abs(b).max(axis=(1, 2)))


@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_singular_blocks_are_refused(bad: float) -> None:
    a = np.random.default_rng(3).standard_normal((8, 6, 6)) + 6.0 * np.eye(6)
    a[6, 2] = bad
    assert not factor_lanes(lanes(a), np.zeros(288), SIX)
