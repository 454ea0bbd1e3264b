"""Arrays between pages that nobody may touch: a kernel that reads or writes behind the end of one, or in front of its begin, ends
the process. Kernels take arrays without bounds, and such writes are seen late, or never, elsewhere.

    python tests/fenced.py end      # arrays end where a page ends; begin: they begin where one begins
"""
from __future__ import annotations

import ctypes
import faulthandler
import mmap
import sys
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "stepping")]
ZEROS, PAGE = np.zeros, mmap.PAGESIZE


def fenced(at_end: bool) -> Any:
    """What takes the place of `np.zeros`."""
    protect = ctypes.CDLL(None).mprotect

    def zeros(shape: Any, dtype: Any = float, **more: Any) -> np.ndarray:
        kind = np.dtype(dtype)
        count = int(np.prod(shape))
        size = count * kind.itemsize
        if kind.hasobject or not size or more:
            return ZEROS(shape, dtype, **more)
        pages = -(-size // PAGE)
        memory = mmap.mmap(-1, (pages + 2) * PAGE)
        begin = ctypes.addressof(ctypes.c_char.from_buffer(memory))
        for place in (begin, begin + (pages + 1) * PAGE):
            if protect(ctypes.c_void_p(place), PAGE, 0):
                raise OSError("mprotect")
        offset = PAGE + (pages * PAGE - size if at_end else 0)
        return np.frombuffer(memory, kind, count, offset).reshape(shape)

    return zeros


def rail(degree: int) -> Any:
    """A mass that slides along a beam whose elements move with it."""
    import fastbeam as fb
    ends = np.concatenate((np.linspace(0.0, 0.5, 4)[:-1], np.linspace(0.5, 2.0, 8)))
    beam = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=fb.Section.circle(radius=0.01, E=2e10, rho=2e3), elements=ends,
                            degree=degree)
    mass = fb.PointMass("mass", mass=0.5, position=(0.5, 0, 0), velocity=(1.2, 0, 0))
    slider = fb.Slider("run", mass, beam, at=0.5, rate=1.2)
    return fb.Scene(beam, mass, fb.Clamp(beam.start), fb.Clamp(beam.end), slider, fb.MovingMesh(beam, slider),
                    gravity=(0, 0, -9.81))


def main(side: str) -> None:
    """Some steps of scenes of many kinds, on all solvers."""
    from small_scenes import bead, cantilever, grid
    from test_sliders_on_nets import CASES, STEP, scene

    import fastbeam as fb
    from fastbeam.stepping.stepper import Stepper
    scenes = {name: (scene(**CASES[name]), {"condense": True, "planar": "auto" if "plane" in name else False})
              for name in ("quadratic", "ball joints", "sleeves and forces along the beams", "sleeves, forces and a border",
                           "sleeves and forces along the beams in a plane", "end on a body by a ball")}
    scenes |= {some.name: (some, {}) for some in (bead(), cantilever(), grid(3))}
    scenes |= {f"elements of degree {degree} that move, planar={planar}": (rail(degree), {"planar": planar})
               for degree, planar in ((5, False), (3, "auto"))}
    models = {name: fb.compile_scene(some, **options) for name, (some, options) in scenes.items()}
    others = {f"{name}, uneliminated": model.uneliminated(planar=False) for name, model in models.items()}
    np.zeros = fenced(side == "end")
    for name, model in {**models, **others}.items():
        backend = {"backend": "superlu"} if name in others else {}
        print(name, flush=True)
        stepper = Stepper(model, np.ones(1), threads=1, **backend)
        assert stepper.advance(0.0, STEP, 2).steps == 2, name
    print("done")


if __name__ == "__main__":
    faulthandler.enable()
    main(sys.argv[1])
