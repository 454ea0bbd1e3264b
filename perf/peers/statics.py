"""Equilibria against Exudyn: python perf/peers/statics.py (after python perf/peers/environments.py exudyn)

Each scene is solved by both programs with meshes that become finer; printed are the error of the tip against a reference, the
times of a solve, and how much longer the peer takes at an error that is not smaller than ours. Each runs on one thread. A beam
element of constant strain holds a circle exactly, so that the roll-up has no error of the peer to compare at.

rollup : cantilever of length 1 under the end moment 2 pi EI/L, a full circle (exact)
bend45 : 45 degrees of a circle of radius 100 under an end force of 600 across its plane (K.-J. Bathe, S. Bolourchi, 1979)
"""
from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from environments import environment, interpreter, trouble

LOAD_STEPS = 8
REPEATS = 7
MESHES = {"fastbeam": (2, 4, 8, 16, 32), "exudyn": (4, 8, 16, 32, 64, 128)}
SCENES = {"rollup": dict(EA=1e4, GA=1e4, GJ=1.0, EI=1.0), "bend45": dict(EA=1e7, GA=5e6, GJ=5e6 / 6.0, EI=1e7 / 12.0)}


def fastbeam(scene: str, elements: int) -> tuple[list[float], float]:
    """Tip, and the shortest time of a solve, s."""
    import fastbeam as fb
    c = SCENES[scene]
    section = fb.Section(EA=c["EA"], GA2=c["GA"], GA3=c["GA"], GJ=c["GJ"], EI2=c["EI"], EI3=c["EI"], rhoA=1.0,
                         rhoI2=1.0, rhoI3=1.0)
    if scene == "rollup":
        rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), d2=(0, 1, 0), section=section, elements=elements)
        load = fb.Load("end", rod.end, moment=(0, 0, 2.0 * np.pi * c["EI"]))
    else:
        rod = fb.Beam.arc("rod", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=100.0, angle=np.pi / 4.0, section=section,
                          elements=elements)
        load = fb.Load("end", rod.end, force=(0, 0, 600.0))
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), load))
    options: dict[str, Any] = dict(load_step=1.0 / LOAD_STEPS, largest_load_step=1.0 / LOAD_STEPS, points={"tip": rod.end},
                                   observe=())
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        result = fb.solve_static(model, **options)
        times.append(time.perf_counter() - begin)
    return result.point("tip")[-1].tolist(), min(times)


def exudyn(scene: str, elements: int) -> tuple[list[float], float]:
    """The same."""
    import exudyn as exu
    import exudyn.itemInterface as item
    from exudyn.rigidBodyUtilities import RotationMatrix2EulerParameters
    c = SCENES[scene]
    times, tip = [], [float("nan")] * 3
    for _ in range(REPEATS):
        mbs = exu.SystemContainer().AddSystem()
        section = exu.BeamSection()
        section.stiffnessMatrix = np.diag([c["EA"], c["GA"], c["GA"], c["GJ"], c["EI"], c["EI"]])
        section.inertia, section.massPerLength = np.eye(3), 1.0
        nodes, length = [], 1.0 if scene == "rollup" else 100.0 * np.pi / 4.0
        for s in np.linspace(0.0, 1.0, elements + 1):
            a = 0.0 if scene == "rollup" else s * np.pi / 4.0
            place = [s, 0.0, 0.0] if scene == "rollup" else [100.0 * np.sin(a), 100.0 * (1.0 - np.cos(a)), 0.0]
            turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
            given = place + list(RotationMatrix2EulerParameters(turn))
            nodes.append(mbs.AddNode(item.NodeRigidBodyEP(referenceCoordinates=given)))
        for pair in zip(nodes[:-1], nodes[1:]):
            mbs.AddObject(item.ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=length / elements,
                                                            sectionData=section))
        ground = mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=mbs.AddObject(item.ObjectGround())))
        first, last = (mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=n)) for n in (nodes[0], nodes[-1]))
        mbs.AddObject(item.GenericJoint(markerNumbers=[ground, first]))
        if scene == "rollup":
            mbs.AddLoad(item.LoadTorqueVector(markerNumber=last, loadVector=[0, 0, 2.0 * np.pi * c["EI"]]))
        else:
            mbs.AddLoad(item.LoadForceVector(markerNumber=last, loadVector=[0, 0, 600.0]))
        mbs.Assemble()
        st = exu.SimulationSettings()
        st.solution.file.write = False
        st.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        st.parallel.numberOfThreads = 1
        st.staticSolver.numberOfLoadSteps, st.staticSolver.verboseMode = LOAD_STEPS, 0
        st.staticSolver.newton.relativeTolerance = 1e-9
        begin = time.perf_counter()
        try:
            mbs.SolveStatic(st)
        except Exception:
            return tip, float("nan")
        times.append(time.perf_counter() - begin)
        tip = [float(x) for x in mbs.GetNodeOutput(nodes[-1], exu.OutputVariableType.Position)]
    return tip, min(times)


def asked(program: str, scene: str, elements: int) -> tuple[np.ndarray, float]:
    """Tip and time from a process of its own."""
    done = subprocess.run([interpreter(program), __file__, program, scene, str(elements)], capture_output=True, text=True,
                          env=environment(program))
    try:
        tip, seconds = json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        return np.full(3, np.nan), np.nan
    return np.array(tip, float), seconds


def reference(scene: str) -> np.ndarray:
    """Exact, or our own with 64 elements."""
    return np.zeros(3) if scene == "rollup" else asked("fastbeam", scene, 64)[0]


def main() -> int:
    if len(sys.argv) == 4:
        program, scene, elements = sys.argv[1:]
        print(json.dumps({"fastbeam": fastbeam, "exudyn": exudyn}[program](scene, int(elements))))
        return 0
    if why := trouble("exudyn"):
        print(f"exudyn {why}")
        return 1
    for scene in SCENES:
        exact = reference(scene)
        size = 1.0 if scene == "rollup" else 100.0 * np.pi / 4.0
        print(f"{scene}: reference {np.round(exact, 6)}\n  program   elements      error   ms a solve")
        rows: dict[str, list[tuple[float, float]]] = {}
        for program, meshes in MESHES.items():
            for elements in meshes:
                tip, seconds = asked(program, scene, elements)
                error = float(np.linalg.norm(tip - exact)) / size
                rows.setdefault(program, []).append((error, seconds))
                print(f"  {program:9s} {elements:8d} {error:10.1e} {1e3 * seconds:12.2f}")
        for error, seconds in rows["exudyn"]:
            own = [t for e, t in rows["fastbeam"] if e <= error]
            if own and seconds == seconds:
                print(f"  at an error of {error:.1e} exudyn takes {seconds / min(own):.1f} times as long")
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    raise SystemExit(main())
