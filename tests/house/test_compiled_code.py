"""What gets imported, compiled and allocated: light import, warm processes compile nothing, absent parts have no code, the time
loop allocates nothing and gives the same numbers everywhere."""
from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src"
SCENE = """
import json
import fastbeam as fb
section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500, EI2=500, EI3=500, rhoA=1, rhoI2=10, rhoI3=10)
beam = fb.Beam.straight("beam", (0, 0, 0), (10, 0, 0), section=section, elements=4, degree=2)
mass = fb.PointMass("mass", mass=3.0)
motion = fb.RigidMotion(spin=(0.1, 0.2, 0.3), velocity=(1, 2, 3))
scenes = {"beam": fb.Scene(beam, motion), "slider": fb.Scene(beam, mass, fb.Slider("s", mass, beam, at=2.0, rate=1.5), motion),
          "body": fb.Scene(fb.RigidBody("body", mass=2.0, inertia=(1, 2, 3), position=(0, 0, 0), spin=(1, 0, 2))),
          "flat body": fb.Scene(fb.RigidBody("body", mass=2.0, inertia=(1, 2, 3), position=(0, 0, 0), spin=(0, 0, 2))),
          "flat slider": fb.Scene(beam, mass, fb.Slider("s", mass, beam, at=2.0, rate=1.5), fb.RigidMotion(spin=(0, 0, 0.3)))}
"""


def python(code: str, **environment: str) -> Any:
    """Run code in a fresh process; what its last line of output says, from JSON."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=400,
                          env={**os.environ, "PYTHONPATH": str(SOURCE), "FASTBEAM_PROGRESS": "0", **environment})
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_import_is_light() -> None:
    code = """
import json, sys, time
begin = time.perf_counter()
import fastbeam
seconds = time.perf_counter() - begin
heavy = [name for name in ("numpy", "numba", "scipy", "matplotlib", "h5py", "tqdm", "pypardiso") if name in sys.modules]
print(json.dumps([heavy, seconds]))
"""
    heavy, seconds = python(code)
    print(f"import fastbeam: {1e3 * seconds:.1f} ms")
    assert heavy == []


def test_describing_a_scene_needs_no_compiler() -> None:
    code = SCENE + """
import sys
for scene in scenes.values():
    scene.check()
print(json.dumps([name for name in ("numba", "matplotlib", "h5py") if name in sys.modules]))
"""
    assert python(code) == []


RUN = SCENE + """
import time
begin = time.perf_counter()
for scene in scenes.values():
    fb.simulate(fb.compile_scene(scene), t_end=0.1, step=0.01)
from fastbeam.kernels.jit import decorators as _jit
print(json.dumps([*_jit.compile_counts(), time.perf_counter() - begin]))
"""


def test_warm_process_compiles_nothing() -> None:
    python(RUN)
    loaded, compiled, seconds = python(RUN)
    print(f"five warm scenes: {seconds:.2f} s")
    assert compiled == 0
    assert loaded >= 5


COMPILED = """
from fastbeam.kernels.jit import decorators as _jit
print(json.dumps([sorted(kernel.py_func.__name__ for kernel in _jit.KERNELS
                         if every or kernel.signatures or kernel.part.signatures) for every in (False, True)]))
"""
BEAM_KERNELS = {"pair_stiffness", "evaluate_point_in_space", "interpolate"}
SLIDER_KERNELS = {"add_slider", "predict_sliders", "solve_border", "new_place", "step_basis"}
TIE_KERNELS = {"assemble_ties", "apply_ties_in_space", "tie_coordinates", "tie_arm"}
SPATIAL_KERNELS = {"assemble_bodies", "add_bodies", "predict", "update_nodes"}
PLANAR_KERNELS = {"planar_pair", "add_planar_bodies", "planar_predict", "planar_update"}
CONDENSED_KERNELS = {"condense", "recover", "add_end_blocks"}
OTHER_KERNELS = {"external_forces", "apply_held", "add_bodies", "call_pardiso"}


def compiled_kernels(name: str, folder: Path) -> set[str]:
    """Kernels that an empty cache has to compile for a scene, all of them in one process: there is no second on one processor."""
    alone = "from fastbeam.kernels.jit import background as _background\n_background._processors = lambda: 1\n"
    code = alone + SCENE + f"fb.simulate(fb.compile_scene(scenes['{name}']), t_end=0.02, step=0.01, observe=())" + COMPILED
    compiled, known = python(code, FASTBEAM_CACHE_DIR=str(folder))
    # a kernel that was renamed would be absent for the wrong reason
    assert (BEAM_KERNELS | SLIDER_KERNELS | TIE_KERNELS | OTHER_KERNELS | SPATIAL_KERNELS | PLANAR_KERNELS
            | CONDENSED_KERNELS) <= set(known)
    # small scenes run without
    assert not CONDENSED_KERNELS & set(compiled)
    return set(compiled)


def test_scene_of_a_body_compiles_no_beams_sliders_or_ties(tmp_path: Path) -> None:
    compiled = compiled_kernels("body", tmp_path)
    assert {"run", "assemble_step", "add_bodies"} <= compiled
    assert not compiled & (BEAM_KERNELS | SLIDER_KERNELS | TIE_KERNELS | PLANAR_KERNELS | OTHER_KERNELS - {"add_bodies"})


def test_scene_in_a_plane_compiles_no_kernels_of_space(tmp_path: Path) -> None:
    compiled = compiled_kernels("flat body", tmp_path)
    assert {"run", "add_planar_bodies", "planar_predict", "planar_update"} <= compiled
    assert not compiled & (BEAM_KERNELS | SLIDER_KERNELS | TIE_KERNELS | OTHER_KERNELS | SPATIAL_KERNELS)
    assert not compiled & {"planar_pair"}


@pytest.mark.slow  # compiles the beam kernels once more
def test_scene_of_a_beam_compiles_no_bodies_sliders_or_ties(tmp_path: Path) -> None:
    compiled = compiled_kernels("beam", tmp_path)
    assert {"run", "assemble_step"} | BEAM_KERNELS <= compiled
    assert not compiled & (SLIDER_KERNELS | TIE_KERNELS | OTHER_KERNELS)


def test_scenes_of_these_tests_run_in_space_and_in_a_plane() -> None:
    code = SCENE + "print(json.dumps([name for name, scene in scenes.items() if fb.compile_scene(scene).plane is not None]))"
    assert python(code) == ["flat body", "flat slider"]


def test_a_table_has_no_entries_of_absent_parts_and_the_loop_one_code() -> None:
    code = SCENE + """
from fastbeam.kernels import call_tables, loop
for name in ("beam", "slider", "flat body"):
    fb.simulate(fb.compile_scene(scenes[name]), t_end=0.02, step=0.01, observe=())
beam = next(iter(call_tables._PLANS))
print(json.dumps([[term.instance_class.__name__ for term in beam[0]],
                  [beam[1].of[beam[1].of.fields.index(name)].instance_class.__name__
                   for name in ("dofs", "method", "contact", "solver")], len(loop.run.signatures)]))
"""
    assert python(code) == [["Inner", "Beams"], ["Space", "Conserving", "NoContact", "Elimination"], 1]


def test_every_kernel_brings_all_implementations_of_generic_functions() -> None:
    # what is compiled without some of them, as in the second process, would stay on the disk like that
    code = """
import gc, json
from fastbeam.kernels.algebra import blocks
from fastbeam.kernels.jit.generic import GenericFunction

def known():
    return sorted((x.name, len(x.implementations)) for x in gc.get_objects() if isinstance(x, GenericFunction))

alone = known()
import fastbeam.compile.compile, fastbeam.dynamics.time_loop, fastbeam.statics.static_analysis
print(json.dumps([len(alone), alone == known()]))
"""
    count, same = python(code)
    assert count > 50 and same


PARTS = SCENE + """
from fastbeam.kernels.jit import background as _background
given = []
_background.start = lambda jobs, folder: given.extend(kernel.py_func.__name__ for kernel, _ in jobs)
fb.simulate(fb.compile_scene(scenes["slider"]), t_end=0.02, step=0.01, observe=())
from fastbeam.kernels.jit import decorators as _jit
missed = {kernel.py_func.__name__ for kernel in _jit.KERNELS if kernel.part.missed}
print(json.dumps([len(given), sum(map(len, (k.part.missed for k in _jit.KERNELS if k.py_func.__name__.endswith("_entry")))),
                  sorted(set(given) - missed)]))
"""


def test_second_process_is_asked_for_half_of_the_entries(tmp_path: Path) -> None:
    given, compiled, others = python(PARTS, FASTBEAM_CACHE_DIR=str(tmp_path))
    assert others == [] and 0.3 * compiled < given < 0.6 * compiled


def test_time_loop_allocates_nothing() -> None:
    code = SCENE + """
import numba
import numpy as np
from numba.core.runtime import _nrt_python, rtsys
from fastbeam.stepping.stepper import Stepper
_nrt_python.memsys_enable_stats()

def allocations(work):
    before = rtsys.get_allocation_stats()
    work()
    after = rtsys.get_allocation_stats()
    return after.alloc - before.alloc

@numba.njit
def leaky(n):
    return sum([np.zeros(3)[0] for _ in range(n)])

leaky(1)
counts = [[allocations(lambda: leaky(1)), allocations(lambda: leaky(101))]]
for name in scenes:
    stepper = Stepper(fb.compile_scene(scenes[name]), np.ones(1))
    stepper.advance(0.0, 0.01, 1)
    counts.append([allocations(lambda: stepper.advance(0.0, 0.01, n)) for n in (1, 101)])
print(json.dumps(counts))
"""
    (control_1, control_101), *loops = python(code)
    assert control_101 - control_1 >= 100  # the counter counts
    # entering compiled code wraps its arguments, a number that does not depend on the steps
    assert all(few == many for few, many in loops), loops


STATE = SCENE + """
import hashlib
out = []
for name in scenes:
    model = fb.compile_scene(scenes[name])
    for _ in range(2):
        result = fb.simulate(model, t_end=0.5, step=0.01)
        arrays = [*result.state, *result.series.values(), result.phi]
        out.append(hashlib.sha256(b"".join(x.tobytes() for x in arrays)).hexdigest())
print(json.dumps(out))
"""


def test_results_are_the_same_bits_in_every_run_process_and_number_of_threads() -> None:
    one = python(STATE, OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="1", MKL_NUM_THREADS="1")
    two = python(STATE, OMP_NUM_THREADS="2", NUMBA_NUM_THREADS="2", MKL_NUM_THREADS="2")
    assert one[0::2] == one[1::2]
    assert one == two
    assert len(set(one)) == 5


def test_public_names_do_not_depend_on_which_module_was_imported_first() -> None:
    code = """
import importlib, json, pkgutil, types
import fastbeam
for module in pkgutil.walk_packages(fastbeam.__path__, "fastbeam."):
    if module.name != "fastbeam.__main__":
        importlib.import_module(module.name)
print(json.dumps([name for name in fastbeam.__all__ if isinstance(getattr(fastbeam, name), types.ModuleType)]))
"""
    assert python(code) == []
