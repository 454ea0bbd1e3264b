"""Kernels compiled by numba alone, as its manual describes it: the same results, chosen by a switch, or where the faster way was
not tested with a version of numba or cannot be loaded."""
from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fastbeam.kernels.jit import decorators as _jit

ROOT = Path(__file__).resolve().parents[2]
SCENES = """
import json, sys, time
import numpy as np
import fastbeam as fb
from fastbeam.kernels.jit import decorators as _jit

BAR = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
DOWN = (0.3, 0.2, -9.81)


def rail():
    return fb.Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=BAR, elements=4)


def slider(gravity=DOWN):
    on, bead = rail(), fb.PointMass("bead", mass=0.1)
    return fb.Scene(on, bead, fb.Clamp(on.start), fb.Slider("run", bead, on, at=0.3), gravity=gravity)


def plane():
    return slider((0.0, 0.0, -9.81))


def net():
    nodes = [(i, j, 0.0) for i in range(3) for j in range(3)]
    edges = [(3 * i + j, 3 * i + j + 1) for i in range(3) for j in range(2)] + [(3 * i + j, 3 * i + j + 3) for i in range(2)
                                                                               for j in range(3)]
    return fb.Scene(fb.Net("net", nodes, edges, section=BAR, elements=2, clamps=[0, 8]), gravity=DOWN)


def spring():
    anchor = fb.PointMass("anchor", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.0, position=(0, 0, -1.0), velocity=(0.3, 0.1, 0.0))
    return fb.Scene(anchor, bob, fb.Clamp(anchor), fb.Spring(anchor, bob, stiffness=200.0, length=0.7), gravity=DOWN)


def statics():
    on = rail()
    return fb.Scene(on, fb.Clamp(on.start), fb.Load("tip", on.end, force=(0.01, 0.02, 0.03)))


def run(name):
    model = fb.compile_scene(globals()[name]())
    if name == "statics":
        return fb.solve_static(model)
    return fb.simulate(model, t_end=0.05, step=0.005, observe=("energy", "momentum", "slider"), progress=False)


out = {}
for name in sys.argv[1:]:
    begin = time.process_time()
    result = run(name)
    print(f"{name}: {time.process_time() - begin:.1f} s", file=sys.stderr)
    out[name] = [x.ravel().tolist() for x in (result.state.q, result.state.s, result.series["total"])]
print(json.dumps([_jit.NUMBA_ONLY, out]))
"""


def python(code: str, *names: str, **environment: str) -> tuple[Any, str]:
    """Run code in a fresh process: the last line that it prints, from JSON, and what it says beside."""
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, check=False, timeout=2000,
                          env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "FASTBEAM_PROGRESS": "0", **environment})
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


def same(names: list[str]) -> None:
    """Both ways give the same numbers. Small functions are written into their callers in another order, where a product and a sum
    become one operation elsewhere: no bits are compared."""
    (plain, one), said = python(SCENES, *names, FASTBEAM_PLAIN_NUMBA="1")
    (fast, other), _ = python(SCENES, *names, FASTBEAM_PLAIN_NUMBA="0")
    print(said)
    assert plain and not fast and "Warning" not in said.replace("ResultWarning", "")
    for name in names:
        for x, y in zip(one[name], other[name], strict=True):
            assert x == pytest.approx(y, rel=1e-9, abs=1e-10), name


def test_masses_on_a_spring_run_without_the_fast_way() -> None:
    same(["spring"])


@pytest.mark.slow  # compiles for one to two minutes each
@pytest.mark.parametrize("names", [["slider"], ["plane"], ["net"], ["statics"]])
def test_scenes_run_without_the_fast_way(names: list[str]) -> None:
    same(names)


# ------------------------------------------------------------------------------------------------------- which way is taken
def test_setting_and_version_decide() -> None:
    low, high = _jit.TESTED
    for setting, version, expected in (("", low, None), ("", high, None), ("0", (99, 0), None), ("1", high, "")):
        assert _jit._why_numba_only(setting, version) == expected
    for version in ((low[0], low[1] - 1), (high[0], high[1] + 1), (high[0] + 1, 0)):
        assert "its faster compilation was tested with numba 0.61 to" in (_jit._why_numba_only("", version) or "")


SMALL = """
import json, sys, warnings
import numba
{change}
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    from fastbeam.kernels.jit import decorators as _jit

@_jit.inlined
def part(x):
    return 2.0 * x

@_jit.kernel
def whole(x):
    return part(x) + part(2 * x)

print(json.dumps([_jit.NUMBA_ONLY, [str(x.message) for x in said], whole(1.5)]))
"""


@pytest.mark.parametrize(("change", "text"), [
    ("numba.version_info = numba.version_info._replace(short=(99, 1))", "its faster compilation was tested with numba 0.61 to"),
    # functions take the place of classes: numba itself goes on
    ("from numba.core import caching as x; made = x.IndexDataCacheFile; x.IndexDataCacheFile = lambda *a, **k: made(*a, **k)",
     "does not work with it (TypeError: "),
    ("from numba.core import codegen as x; made = x.JITCodeLibrary; x.JITCodeLibrary = lambda *a, **k: made(*a, **k)",
     "does not work with it (TypeError: ")])
def test_numba_of_another_kind_costs_one_warning(tmp_path: Path, change: str, text: str) -> None:
    (tmp_path / "small.py").write_text(SMALL.format(change=change))
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import small"
    (plain, said, value), _ = python(code, FASTBEAM_PLAIN_NUMBA="", FASTBEAM_CACHE_DIR=str(tmp_path / "cache"))
    assert plain and value == 9.0
    assert len(said) == 1 and text in said[0] and "FASTBEAM_PLAIN_NUMBA=1 hides this warning" in said[0]


def test_terms_from_outside_switch_the_cache_of_the_plain_way_off(tmp_path: Path) -> None:
    (tmp_path / "small.py").write_text("""
import json
from typing import NamedTuple
import numpy as np
from fastbeam.kernels.jit import decorators as _jit
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.algebra.dimensions import SPACE

class Mine(NamedTuple):
    x: np.ndarray

@generic
def value(term):
    "A number."

@value.register(Mine)
@_jit.kernel
def value_of_mine(term):
    return term.x[0]

@_jit.kernel
def whole(term):
    return value.call(term)

print(json.dumps([whole(Mine(np.ones(1))), _jit.compile_counts()[0], {type(k._cache).__name__ for k in _jit.KERNELS} ==
                  {"_NoCache", "NullCache"}]))
""")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import small"
    for _ in range(2):
        assert python(code, FASTBEAM_PLAIN_NUMBA="1")[0] == [1.0, 0, True]


def test_kernels_that_are_not_to_be_compiled_are_refused() -> None:
    """Scenes can be described without a compiler; what needs one says which setting keeps it away."""
    code = ("import fastbeam as fb\nscene = fb.Scene(fb.PointMass('m', mass=1.0, position=(0, 0, 0)))\nscene.check()\n"
            "print('described')\nfb.compile_scene(scene)")
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 1 and done.stdout == "described\n"
    assert "ImportError: NUMBA_DISABLE_JIT is set, and fastbeam's kernels run as compiled code alone" in done.stderr
