"""Equilibria against Exudyn: python perf/peers/statics.py (after python perf/peers/environments.py exudyn)

Each scene is solved by both programs with meshes that become finer; printed are the error of the tip against a reference, the
times of a solve, and how much longer the peer takes at an error that is not smaller than ours. Each runs on one thread. A beam
element of constant strain holds a circle exactly, so that the roll-up has no error of the peer to compare at.

rollup : cantilever of length 1 under the end moment 2 pi EI/L, a full circle (exact)
deep   : arch of 215 degrees, radius 1, clamped and hinged, under 8 EI/R^2 at its top (its limit is 8.97: F. W. DaDeppo,
         R. Schmidt, 1975); the place of the top
shallow: arch of 40 degrees, radius 1, clamped at both ends, its top pushed down by 0.06, past the limit point; the force at the
         top. Displacement control, which both programs have (theirs has no arc length)
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

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from perf.peers.environments import environment, interpreter, trouble  # noqa: E402

LOAD_STEPS = 8
REPEATS = 7
MESHES = {"fastbeam": (2, 4, 8, 16, 32), "exudyn": (4, 8, 16, 32, 64, 128)}
SCENES = {"rollup": dict(EA=1e4, GA=1e4, GJ=1.0, EI=1.0), "bend45": dict(EA=1e7, GA=5e6, GJ=5e6 / 6.0, EI=1e7 / 12.0),
          "deep": dict(EA=1e5, GA=1e5, GJ=1.0, EI=1.0), "shallow": dict(EA=3e4, GA=1e4, GJ=1.0, EI=1.0)}
# half the angle of an arch, rad; the load of its top, or what it is pushed down by
ARCHES = {"deep": (np.deg2rad(107.5), 8.0), "shallow": (np.deg2rad(20.0), 0.06)}


def length_of(scene: str) -> float:
    """Of its beam."""
    return 1.0 if scene == "rollup" else 100.0 * np.pi / 4.0 if scene == "bend45" else 2.0 * ARCHES[scene][0]


def fastbeam(scene: str, elements: int) -> tuple[list[float], float]:
    """Tip, and the shortest time of a solve, s."""
    import fastbeam as fb
    c = SCENES[scene]
    section = fb.Section(EA=c["EA"], GA2=c["GA"], GA3=c["GA"], GJ=c["GJ"], EI2=c["EI"], EI3=c["EI"], rhoA=1.0,
                         rhoI2=1.0, rhoI3=1.0)
    if scene == "rollup":
        rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), d2=(0, 1, 0), section=section, elements=elements)
        load = fb.Load("end", rod.end, moment=(0, 0, 2.0 * np.pi * c["EI"]))
    elif scene in ARCHES:
        half, value = ARCHES[scene]
        x, y = np.sin(half), np.cos(half)
        rod = fb.Beam.arc("rod", (-x, y, 0), (y, x, 0), (x, -y, 0), radius=1.0, angle=2.0 * half, section=section,
                          elements=elements)
        top = rod.at(rod.length / 2)
        if scene == "deep":
            load = fb.Load("top", top, force=(0, -value, 0))
        else:
            load = fb.PrescribedMotion("top", top, displacement=lambda t: np.array([-value * t]), axes="y")
    else:
        rod = fb.Beam.arc("rod", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=100.0, angle=np.pi / 4.0, section=section,
                          elements=elements)
        load = fb.Load("end", rod.end, force=(0, 0, 600.0))
    others = [{"deep": fb.Pin, "shallow": fb.Clamp}[scene](rod.end)] if scene in ARCHES else []
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), *others, load))
    options: dict[str, Any] = dict(load_step=1.0 / LOAD_STEPS, largest_load_step=1.0 / LOAD_STEPS, observe=(),
                                   points={"tip": top if scene in ARCHES else rod.end})
    if scene == "shallow":
        options |= dict(at_time=1.0, observe=("reaction",))
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        result = fb.solve_static(model, **options)
        times.append(time.perf_counter() - begin)
    if scene == "shallow":
        return [0.0, float(result.reaction("top")["force"][-1, 1]), 0.0], min(times)
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
        nodes, frames, length = [], [], length_of(scene)
        for s in np.linspace(0.0, 1.0, elements + 1):
            a = 0.0 if scene == "rollup" else s * np.pi / 4.0
            place = [s, 0.0, 0.0] if scene == "rollup" else [100.0 * np.sin(a), 100.0 * (1.0 - np.cos(a)), 0.0]
            if scene in ARCHES:
                a = ARCHES[scene][0] * (1.0 - 2.0 * s)
                place = [-np.sin(a), np.cos(a), 0.0]
            turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
            frames.append((place, turn))
            given = place + list(RotationMatrix2EulerParameters(turn))
            nodes.append(mbs.AddNode(item.NodeRigidBodyEP(referenceCoordinates=given)))
        for pair in zip(nodes[:-1], nodes[1:]):
            mbs.AddObject(item.ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=length / elements,
                                                            sectionData=section))
        body = mbs.AddObject(item.ObjectGround())
        grounds = [mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localHT=exu.HT(rotation=turn, translation=place)))
                   for place, turn in (frames[0], frames[-1])]
        first, last = (mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=n)) for n in (nodes[0], nodes[-1]))
        mbs.AddObject(item.GenericJoint(markerNumbers=[grounds[0], first]))
        if scene in ARCHES:
            value, top = ARCHES[scene][1], nodes[elements // 2]
            mbs.AddObject(item.GenericJoint(markerNumbers=[grounds[1], last],
                                            constrainedAxes=[1, 1, 1] + 3 * [int(scene == "shallow")]))
            if scene == "deep":
                mbs.AddLoad(item.LoadForceVector(markerNumber=mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=top)),
                                                 loadVector=[0, -value, 0]))
            else:
                fixed = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(item.NodePointGround()), coordinate=0))
                moved = mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=top, coordinate=1))
                push = mbs.AddObject(item.CoordinateConstraint(
                    markerNumbers=[fixed, moved], offsetUserFunction=lambda mbs, t, number, offset: -value * t))
        elif scene == "rollup":
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
        if scene == "shallow":
            tip = [0.0, float(np.ravel(mbs.GetObjectOutput(push, exu.OutputVariableType.Force))[0]), 0.0]
        else:
            at = top if scene == "deep" else nodes[-1]
            tip = [float(x) for x in mbs.GetNodeOutput(at, exu.OutputVariableType.Position)]
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
        # places by the length of the beam, a force by itself
        size = float(np.linalg.norm(exact)) if scene == "shallow" else length_of(scene)
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
    raise SystemExit(main())
