"""Time of the lowest modes of a net, next to one factorisation with solution: `python perf/cases/modes.py [UNKNOWNS] [MODES]`.

The net is a square grid of welded beams of two cubic elements, held at its rim and loaded by nothing; unknowns are those of all
nodes, inner ones too.
"""
from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from perf.places import module  # noqa: E402

eigen = module("eigen")
vibration = module("vibration")


def grid(side: int) -> fb.Net:
    """side x side nodes, 1 m apart."""
    number = np.arange(side * side).reshape(side, side)
    nodes = np.stack((*np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), np.zeros((side, side))), axis=-1)
    edges = np.concatenate([np.stack((a.reshape(-1), b.reshape(-1)), axis=1)
                            for a, b in ((number[:-1], number[1:]), (number[:, :-1], number[:, 1:]))])
    rim = np.unique(np.concatenate((number[0], number[-1], number[:, 0], number[:, -1])))
    section = fb.Section.circle(radius=0.02, E=2e11, rho=7850.0)
    return fb.Net("grid", nodes.reshape(-1, 3).astype(float), edges, section=section, elements=2, degree=3, clamps=rim)


def main(unknowns: int = 100_000, n: int = 20) -> None:
    """Print times in s."""
    # a junction has two beams with five nodes between their ends
    side = max(4, round(np.sqrt(unknowns / 66.0)))
    begin = time.perf_counter()
    model = fb.compile_scene(fb.Scene(grid(side)))
    print(f"{side} x {side}: compile_scene {time.perf_counter() - begin:.1f} s")
    spent: dict[str, list[float]] = {"factor": [], "solve": [], "krylov": []}

    def timed(name: str, function: object) -> object:
        def call(*args: object) -> object:
            start = time.perf_counter()
            out = function(*args)  # type: ignore[operator]
            spent[name].append(time.perf_counter() - start)
            return out
        return call

    eigen.Shifted.__init__ = timed("factor", eigen.Shifted.__init__)  # type: ignore[method-assign, assignment]
    eigen.Shifted.solve = timed("solve", eigen.Shifted.solve)  # type: ignore[method-assign, assignment]
    lowest = vibration.lowest
    vibration.lowest = timed("krylov", lowest)  # type: ignore[assignment]
    begin = time.perf_counter()
    found = fb.modes(model, n=n)
    whole = time.perf_counter() - begin
    # the first one, with its analysis: later ones take its order
    one = spent["factor"][0] + min(spent["solve"]) / eigen.BLOCK
    first = spent["krylov"][0]
    print(f"{found.info['unknowns']} unknowns, {len(found)} modes: {whole:.1f} s, of which eigenvalues {first:.1f} s: "
          f"factorisations of {', '.join(f'{x:.2f}' for x in spent['factor'])} s, {len(spent['solve'])} solutions of "
          f"{eigen.BLOCK} of {np.mean(spent['solve']):.2f} s ({found.info['solver']})")
    print(f"one factorisation with solution: {one:.2f} s; all of it {whole / one:.1f}, eigenvalues {first / one:.1f} "
          f"times that; complete: {found.is_complete}, largest residual {found.residuals.max():.1e}")
    print(f"memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.1f} GB; first frequencies "
          f"{', '.join(f'{x:.5g}' for x in found.frequencies[:6])} Hz")


if __name__ == "__main__":
    main(*(int(x) for x in sys.argv[1:3]))
