"""Functions of the user's own that give no number on the way: the message names whose they are, and when."""
from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

SECTION = fb.Section.circle(radius=0.02, E=1e9, rho=1000.0)
H = 1e-3


def rod() -> fb.Beam:
    return fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SECTION, elements=2)


def root_of_time(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = math.sqrt(0.0035 - t) if t < 0.0035 else math.nan


def root_of_place(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = -50.0 * np.sqrt(1e-4 + x[2])


def along(t, length, rate, p):  # type: ignore[no-untyped-def]
    return np.sqrt(0.0035 - t)


def between(t, x, rotation, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[0] = np.log(0.0035 - t)


def fine(t, x, d, v, w, p, force, moment):  # type: ignore[no-untyped-def]
    force[2] = 1.0


def failing(*parts: Any, **options: Any) -> str:
    beam = rod()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), *(part(beam) for part in parts), gravity=(0, 0, -9.81)),
                             planar=False)
    with pytest.raises((fb.ConvergenceError, fb.SceneError)) as caught:
        fb.simulate(model, t_end=0.1, step=H, progress=False, **options)
    return str(caught.value)


@pytest.mark.parametrize(("make", "says"), [
    (lambda b: fb.UserForce("gust", b.end, root_of_time), r"user force 'gust': its law gives \(0, 0, nan, 0, 0, 0\), which is no "
                                                          r"finite force, at t = 0.0035 s, beam 'rod' node 6"),
    (lambda b: fb.UserForce("gust", b, root_of_time), r"user force 'gust': its law gives \(0, 0, nan"),
    (lambda b: fb.UserForce("soil", b.end, root_of_place), r"user force 'soil': its law gives \(0, 0, nan"),
    (lambda b: fb.LineForce(b.end, fb.GROUND.point((2, 0, 5)), "rope", law=along), "line force 'rope': its law gives"),
    (lambda b: fb.ForceElement(b.end, fb.GROUND.point((2, 0, 5)), "pad", law=between), "force element 'pad': its law gives"),
], ids=["node", "beam", "place", "line", "element"])
def test_a_law_that_becomes_no_number_is_named(make: Any, says: str) -> None:
    import re
    # beside one that does nothing wrong
    assert re.search(says, found := failing(lambda b: fb.UserForce("wind", b.end, fine), make)), found
    assert "compressed to nothing" not in found and "Let it give finite numbers there" in found


def test_which_load_a_time_function_belongs_to_is_said() -> None:
    def broken(t: float) -> float:
        return 1.0 if t < 0.003 else math.nan

    says = failing(lambda b: fb.Load("steady", b.end, force=(0, 0, 1), time=lambda t: 1.0 + t),
                   lambda b: fb.Load("push", b.end, force=(0, 0, 1), time=broken))
    assert "time function of load 'push': must return a finite number, got nan at t = 0.00" in says
    says = failing(lambda b: fb.DistributedLoad("snow", b, force=(0, 0, 1), time=broken))
    assert "time function of distributed load 'snow': must" in says
    # one function of two loads
    says = failing(*(lambda b, name=name: fb.Load(name, b.end, force=(0, 0, 1), time=broken) for name in ("one", "two")))
    assert "time function of load 'one', load 'two': must" in says
    beam = rod()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81), gravity_time=broken))
    with pytest.raises(fb.SceneError, match="time function of gravity: must return a finite number, got nan"):
        fb.simulate(model, t_end=0.01, step=H, progress=False)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("push", beam.end, force=(0, 0, 1), time=broken)))
    with pytest.raises(fb.SceneError, match="time function of load 'push': must return a finite number, got nan at t = 1 s"):
        fb.solve_static(model, at_time=1.0)


def test_a_collapse_is_still_one() -> None:
    beam = rod()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.UserForce("wind", beam.end, fine),
                                      fb.Load("push", beam.end, force=(0, 0, 1e9))), planar=False)
    with pytest.raises(fb.ConvergenceError) as caught:
        fb.simulate(model, t_end=1.0, step=1e-2, progress=False)
    assert "its law" not in str(caught.value)
