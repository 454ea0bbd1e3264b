"""Time and size of a VTKHDF file: a net of 100 000 elements, 100 shapes; beside it a plain write of as many bytes.

    python perf/cases/paraview.py [--elements 100000] [--frames 100] [--folder DIR]
"""
from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

import fastbeam as fb


def net_of(elements: int, frames: int) -> fb.Result:
    """A result with shapes of a net, ten elements of degree 2 a beam."""
    beams = elements // 10
    count = 21 * beams
    x = np.linspace(0.0, 1.0, 21)[None, :, None] * (1.0, 0.0, 0.0) + np.arange(beams)[:, None, None] * (0.0, 0.1, 0.0)
    phi = x.reshape(1, count, 3) + np.linspace(0.0, 1.0, frames)[:, None, None]
    names = {"nets": [{"name": "net", "first": 0, "count": count, "starts": (21 * np.arange(beams)).tolist(),
                       "junctions": [], "outlines": [0.01, 0.01, True]}]}
    t = np.arange(frames, dtype=float)
    return fb.Result(t=t, names=names, t_snap=t, phi=phi, directors=np.tile(np.eye(3), (frames, count, 1, 1)))


def main() -> None:
    """Write both files and print their rates."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--elements", type=int, default=100_000)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--folder", default=None)
    chosen = parser.parse_args()
    result = net_of(chosen.elements, chosen.frames)
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        file = Path(folder) / "run.vtkhdf"
        begin = time.perf_counter()
        result.to_vtk(file)
        written = time.perf_counter() - begin
        size = file.stat().st_size / 1e6
        print(f"{chosen.elements} elements, {result.phi.shape[1]} points, {chosen.frames} shapes: {size:.0f} MB in "
              f"{written:.2f} s, {size / written:.0f} MB/s")
        block = np.zeros(1 << 22, np.uint8)
        begin = time.perf_counter()
        with (Path(folder) / "plain").open("wb") as raw:
            for _ in range(round(size * 1e6 / block.size)):
                raw.write(block)
            raw.flush()
            os.fsync(raw.fileno())
        plain = time.perf_counter() - begin
        print(f"a plain write of as many bytes, to the disk: {size / plain:.0f} MB/s")


if __name__ == "__main__":
    main()
