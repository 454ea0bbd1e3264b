"""One run of Exudyn: `python exudyn_run.py '{"scene": "spaghetti3d", "elements": 10, "step": 0.01, ...}'`.

Settings
--------
scene : 'spaghetti3d' or 'sliding'
elements, step : number of elements, step size in s
solver : 'alpha' (generalised-alpha), 'trapezoidal' (index 2), or an explicit one of Exudyn ('RK44', 'DOPRI5', ...)
rho : spectral radius at infinity of 'alpha'
modified : modified Newton (Jacobian kept while it contracts) or full Newton
linear : 'EXUdense', 'EigenSparse'
tolerance : relative, of Newton
nodes : spaghetti3d: 'euler_parameters', 'angles' or 'rotation_vector' (explicit solvers only)
dim : sliding: 3 (ObjectANCFCable, ObjectJointSliding) or 2 (ObjectANCFCable2D, ObjectJointSliding2D)
"""
from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import exudyn as exu  # noqa: E402
import exudyn.itemInterface as item  # noqa: E402
import numpy as np  # noqa: E402
from exudyn.beams import GenerateBeamElementsAlongLine  # noqa: E402
from exudyn.rigidBodyUtilities import RotationMatrix2EulerParameters, RotationMatrix2RotXYZ  # noqa: E402
from protocol import SAMPLES, answer, settings, steps, timed  # noqa: E402
from scenes import Sliding, Spaghetti  # noqa: E402

OPTIONS: dict[str, Any] = {"solver": "alpha", "rho": 1.0, "modified": True, "linear": "EigenSparse", "tolerance": 1e-8,
                           "nodes": "euler_parameters", "dim": 3}


class System:
    """A main system with what is read from it afterwards."""

    def __init__(self) -> None:
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.nodes: list[Any] = []
        self.elements: list[Any] = []
        self.sensors: list[Any] = []
        self.message = ""

    def finish(self, observed: Sequence[Any]) -> System:
        """Watch these nodes and assemble."""
        self.sensors = [self.mbs.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, writeToFile=False,
                                                           outputVariableType=exu.OutputVariableType.Position))
                        for node in observed]
        self.mbs.Assemble()
        return self


def spaghetti(options: dict[str, Any]) -> System:
    """Geometrically exact beam elements with two nodes, free, with the pulse on node 0."""
    system, s, n = System(), Spaghetti.SECTION, options["elements"]
    mbs, h = system.mbs, Spaghetti.LENGTH / n
    start, end = np.array(Spaghetti.START), np.array(Spaghetti.END)
    t = (end - start) / Spaghetti.LENGTH
    R = np.column_stack([t, np.cross([0, 0, 1], t), [0, 0, 1]])
    section = exu.BeamSection()
    section.stiffnessMatrix = np.diag([s.EA, s.GA, s.GA, s.GJ, s.EI, s.EI])
    section.inertia = np.diag([s.rhoJ, s.rhoI, s.rhoI])
    section.massPerLength = s.rhoA
    if options["nodes"] == "euler_parameters":
        make, turn = item.NodeRigidBodyEP, list(RotationMatrix2EulerParameters(R))
    elif options["nodes"] == "angles":
        make, turn = item.NodeRigidBodyRxyz, list(RotationMatrix2RotXYZ(R))
    else:
        from exudyn.rigidBodyUtilities import RotationMatrix2RotationVector
        make, turn = item.NodeRigidBodyRotVecLG, list(RotationMatrix2RotationVector(R))
    system.nodes = [mbs.AddNode(make(referenceCoordinates=list(start + t * h * i) + turn)) for i in range(n + 1)]
    system.elements = [mbs.AddObject(item.ObjectBeamGeometricallyExact(nodeNumbers=system.nodes[i:i + 2], length=h,
                                                                       sectionData=section)) for i in range(n)]
    marker = mbs.AddMarker(item.MarkerNodeRigid(nodeNumber=system.nodes[0]))
    for kind, peak in ((item.LoadForceVector, Spaghetti.FORCE), (item.LoadTorqueVector, Spaghetti.MOMENT)):
        def value(mbs: Any, t: float, load: Any, peak: tuple[float, ...] = peak) -> list[float]:
            return [x * Spaghetti.pulse(t) for x in peak]
        mbs.AddLoad(kind(markerNumber=marker, loadVector=[0, 0, 0], loadVectorUserFunction=value))
    return system.finish((system.nodes[0], system.nodes[-1]))


def sliding(options: dict[str, Any]) -> System:
    """ANCF cable elements (no shear, no rotary inertia) and a sliding joint."""
    system, s, n, dim = System(), Sliding.SECTION, options["elements"], options["dim"]
    mbs, h = system.mbs, Sliding.LENGTH / n
    data: dict[str, Any] = {"massPerLength": s.rhoA, "bendingStiffness": s.EI, "axialStiffness": s.EA}
    template = item.ObjectANCFCable(**data) if dim == 3 else item.ObjectANCFCable2D(**data)
    pin = [True] * dim + [False] * dim
    made = GenerateBeamElementsAlongLine(mbs, [0, 0, 0], [Sliding.LENGTH, 0, 0], n, beamTemplate=template,
                                         gravity=[0, -Sliding.GRAVITY, 0], groundConstraintsStart=pin, groundConstraintsEnd=pin)
    system.elements = made["elements"]
    if dim == 3:
        node = mbs.AddNode(item.NodePoint(referenceCoordinates=[Sliding.START, 0, 0], initialVelocities=[Sliding.SPEED, 0, 0]))
        body = mbs.AddObject(item.MassPoint(mass=Sliding.MASS, nodeNumber=node))
        markers = [mbs.AddMarker(item.MarkerBodyBeamShape(bodyNumber=e)) for e in system.elements]
    else:
        node = mbs.AddNode(item.NodePoint2D(referenceCoordinates=[Sliding.START, 0], initialVelocities=[Sliding.SPEED, 0]))
        body = mbs.AddObject(item.MassPoint2D(mass=Sliding.MASS, nodeNumber=node))
        markers = [mbs.AddMarker(item.MarkerBodyCable2DCoordinates(bodyNumber=e)) for e in system.elements]
    marker = mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=body))
    mbs.AddLoad(item.Force(markerNumber=marker, loadVector=[0, -Sliding.MASS * Sliding.GRAVITY, 0]))
    first = min(int(Sliding.START / h), n - 1)
    state = mbs.AddNode(item.NodeGenericData(initialCoordinates=[first, Sliding.START], numberOfDataCoordinates=2))
    joint: dict[str, Any] = {"markerNumbers": [marker, markers[first]], "slidingMarkerNumbers": markers,
                             "slidingMarkerOffsets": [h * i for i in range(n)], "nodeNumber": state}
    if dim == 3:
        mbs.AddObject(item.ObjectJointSliding(constrainRotations=[0, 0, 0], **joint))
    else:
        mbs.AddObject(item.ObjectJointSliding2D(useClassicalFormulation=options["solver"] != "trapezoidal", **joint))
    system.nodes = [node]
    return system.finish(system.nodes)


def solve(system: System, options: dict[str, Any], t_end: float) -> None:
    """Integrate; a failure is noted in the system."""
    st = exu.SimulationSettings()
    st.solution.file.write = False
    st.solution.sensors.writePeriod = t_end / SAMPLES
    st.linearSolver.solverType = getattr(exu.LinearSolverType, options["linear"])
    st.parallel.numberOfThreads = 1
    ti = st.timeIntegration
    ti.numberOfSteps, ti.endTime, ti.verboseMode = SAMPLES * steps(t_end, options["step"]), t_end, 0
    # a step that fails shall fail the run, not be cut unnoticed
    ti.adaptiveStep = ti.automaticStepSize = False
    ti.newton.useModifiedNewton = options["modified"]
    ti.newton.relativeTolerance = options["tolerance"]
    ti.generalizedAlpha.spectralRadius = options["rho"]
    kinds = {"alpha": exu.DynamicSolverType.GeneralizedAlpha, "trapezoidal": exu.DynamicSolverType.TrapezoidalIndex2}
    kind = kinds.get(options["solver"]) or getattr(exu.DynamicSolverType, options["solver"])
    try:
        system.mbs.SolveDynamic(st, solverType=kind)
    except Exception as error:  # Exudyn raises SystemError and others where Newton does not converge
        system.message = (str(error).split(" [Python file")[0].splitlines() or [type(error).__name__])[0]


def energy(system: System) -> float:
    """Kinetic, elastic and gravity energy of beam and mass; the scene conserves it."""
    kind, total, h = exu.OutputVariableType, 0.0, Sliding.LENGTH / len(system.elements)
    for element in system.elements:
        for variable in (kind.KineticEnergy, kind.PotentialEnergy):
            total += float(np.sum(system.mbs.GetObjectOutputBody(element, variable, [0, 0, 0])))
        for x, weight in ((0.5 - 0.15**0.5, 5 / 18), (0.5, 8 / 18), (0.5 + 0.15**0.5, 5 / 18)):
            y = system.mbs.GetObjectOutputBody(element, kind.Position, [x * h, 0, 0])[1]
            total += Sliding.SECTION.rhoA * h * weight * Sliding.GRAVITY * float(y)
    v = system.mbs.GetNodeOutput(system.nodes[-1], kind.Velocity)
    y = system.mbs.GetNodeOutput(system.nodes[-1], kind.Position)[1]
    return total + 0.5 * Sliding.MASS * float(v @ v) + Sliding.MASS * Sliding.GRAVITY * float(y)


def main() -> None:
    """Run what the command line asks for."""
    options = {**OPTIONS, **settings()}
    flying = options["scene"] == "spaghetti3d"
    build, t_end = (spaghetti, Spaghetti.T_END) if flying else (sliding, Sliding.T_END)
    t_end = options.get("t_end", t_end)
    system, times = timed(lambda: build(options), lambda system: solve(system, options, t_end))
    wanted = np.arange(1, SAMPLES + 1) * t_end / SAMPLES
    tables = [system.mbs.GetSensorStoredData(sensor)[1:] for sensor in system.sensors]
    if not system.message and any(len(rows) != SAMPLES or np.abs(rows[:, 0] - wanted).max() > 1e-9 for rows in tables):
        system.message = f"stored rows at other times than wanted, the last time is {system.mbs.systemData.GetTime():g} s"
    points = [] if system.message else [rows[k, 1:4] for k in range(SAMPLES) for rows in tables]
    extra = {}
    if not flying and not system.message:
        # the scene conserves the total energy, at the start the kinetic energy of the mass
        begin = 0.5 * Sliding.MASS * Sliding.SPEED**2
        extra["energy_change"] = abs(energy(system) - begin) / begin
    answer("exudyn", exu.config.Version(), points, times, system.message, extra)


if __name__ == "__main__":
    main()
