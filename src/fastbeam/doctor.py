"""`python -m fastbeam doctor`: report on the installation and the folder of kernels, and a self-test of a few seconds."""
from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from fastbeam import __version__
from fastbeam.interface.lazy_import import sparse

NEEDED = ("numpy", "scipy", "numba", "llvmlite", "h5py", "matplotlib", "tqdm")
OPTIONAL = ("pypardiso", "mkl", "pandas", "vtk", "imageio-ffmpeg")
# limits of the self-test: drift of energy relative to its size, gap relative to the length, residual of a linear system
LARGEST_DRIFT, LARGEST_GAP, LARGEST_RESIDUAL = 1e-11, 1e-13, 1e-12


def examine(say: Callable[[str], None]) -> int:
    """Report line by line; return the exit code: 0, or 1 where a test failed."""
    for line in (*versions(), *processor(), *cache()):
        say(line)
    failed = 0
    for name, test in (("a bead slides on a swinging beam", conserving_run), ("PARDISO", sparse_solver)):
        begin = time.perf_counter()
        try:
            passed, text = test()
        except Exception as error:  # any failure here is to be reported
            passed, text = False, f"{type(error).__name__}: {' '.join(str(error).split())}"
        failed += not passed
        say(f"{'ok    ' if passed else 'FAILED'}      {name}: {text} ({time.perf_counter() - begin:.1f} s)")
    from fastbeam.kernels.jit.decorators import compile_counts
    loaded, compiled = compile_counts()
    say(f"kernels     {loaded} from the cache, {compiled} compiled now")
    return min(failed, 1)


def versions() -> Iterator[str]:
    """Yield lines on fastbeam, Python and libraries."""
    yield f"fastbeam    {__version__} in {Path(__file__).parent}"
    yield f"python      {platform.python_version()} in {sys.prefix}, {platform.platform()}"
    yield "libraries   " + ", ".join(f"{name} {_version(name)}" for name in NEEDED)
    yield "optional    " + ", ".join(f"{name} {_version(name)}" for name in OPTIONAL)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


def processor() -> Iterator[str]:
    """Yield lines on the processor and MKL."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    from fastbeam.kernels.algebra.vectors import WIDTH
    mine = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield f"processor   {name}, {mine} of {os.cpu_count()} processors for this process, kernels {WIDTH} numbers wide"
    from fastbeam.linalg.mkl import load_mkl
    mkl = load_mkl()
    yield ("MKL         not found: SuperLU solves nets and long loops, several times slower; pip install pypardiso"
           if mkl is None else f"MKL         {mkl._name}, {mkl.MKL_Get_Max_Threads()} threads")
    settings = [f"{key}={value}" for key, value in sorted(os.environ.items()) if key.startswith("FASTBEAM_")]
    yield f"settings    {', '.join(settings) or 'none'}"


def cache() -> Iterator[str]:
    """Yield lines on the folder of compiled kernels."""
    from fastbeam.kernels.jit import decorators as _jit
    from fastbeam.kernels.jit.cache import is_private
    folder = Path(_jit._FOLDER)
    entries = [path for path in folder.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in entries) / 1e6
    state = "empty, the first run compiles kernels" if not entries else f"{len(entries)} files, {size:.0f} MB"
    # another folder than the usual one was taken where that is not safe
    safe = "nobody else can write to it" if is_private(folder.stat()) else "others can write to it"
    yield f"cache       {folder}: {state}; {safe}{', compiled by numba alone' if _jit.NUMBA_ONLY else ''}"


def conserving_run() -> tuple[bool, str]:
    """Run a small model; return whether energy and gap stay within their limits, and a line about them."""
    from fastbeam.compile.compile import compile_scene
    from fastbeam.dynamics.time_loop import simulate
    from fastbeam.scene import Beam, Clamp, PointMass, Scene, Section, Slider
    rail = Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=Section.circle(radius=0.01, E=1e8, rho=1000.0), elements=4)
    bead = PointMass("bead", mass=0.1)
    scene = Scene(rail, bead, Clamp(rail.start), Slider("run", bead, rail, at=0.3), gravity=(0.3, 0.2, -9.81))
    result = simulate(compile_scene(scene), t_end=0.2, step=1e-3, progress=False)
    drift, gap = result.drift("total"), float(np.abs(result.series["gap"]).max())
    steps = result.info["steps"]
    passed = drift < LARGEST_DRIFT and gap < LARGEST_GAP and steps == 200
    return passed, f"{steps} steps, drift of energy {drift:.1e}, gap {gap:.1e} m"


def sparse_solver() -> tuple[bool, str]:
    """Solve a sparse system by PARDISO; return whether that succeeds, and a line about it. A missing PARDISO is no failure."""
    from fastbeam.linalg.mkl import load_mkl
    if load_mkl() is None:
        return True, "not there"
    import pypardiso
    n = 200
    line = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    matrix = sparse.csr_array(sparse.kron(line, sparse.eye_array(n)) + sparse.kron(sparse.eye_array(n), line))
    matrix.data *= 1.0 + 0.1 * np.sin(np.arange(matrix.data.size))
    right = np.cos(np.arange(n * n))
    x = pypardiso.spsolve(sparse.csr_matrix(matrix), right)
    residual = float(np.linalg.norm(matrix @ x - right) / np.linalg.norm(right))
    return residual < LARGEST_RESIDUAL, f"{n * n} equations, residual {residual:.1e}"
