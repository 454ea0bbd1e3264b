"""Forces by user functions: compiled functions with an address, and their tables."""
from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from fastbeam.interface.arguments import shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.forces.drag import NoWind, Wind
from fastbeam.kernels.forces.force_element import ForceElements
from fastbeam.kernels.forces.line_force import LineForces
from fastbeam.kernels.forces.planar_follower import PlanarFollowers
from fastbeam.kernels.forces.user_force import Laws, UserForces
from fastbeam.model.analyses import Analysis, Lack, dissipating, timed_loads, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Feature, OfRun
from fastbeam.model.forces.compiled_laws import (
    compiled_differences,
    compiled_force,
    compiled_slopes,
    compiled_tension,
    compiled_tension_slopes,
    compiled_wind,
    machine_code,
)
from fastbeam.model.forces.failed_laws import Asked, Lawful
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import node_lengths
from fastbeam.model.workspace import law_work
from fastbeam.scene import Beam, Drag, ForceElement, LineForce, Scene, Signal, UserForce
from fastbeam.scene.follower import FollowerForce, turning_slopes
from fastbeam.scene.links import label_of
from fastbeam.scene.user_force import numbers_of_nodes

Array = np.ndarray
# tables of forces by laws of the triad
ON_NODES = UserForces, PlanarFollowers


class UserLaws(Feature):
    """Forces by user laws, and follower loads.

    forces: forces on nodes.
    between: forces between two points.
    laws: dict of type -> failed_laws.Lawful, laws by the kinds of tables that call them, those of wind included.
    """

    key, title, order = "user_laws", "user forces, loads that follow, line forces and force elements", 120
    lacks = (
        Lack((Analysis.PLANAR,), "laws of the user's own but line forces", "the law of {name} may lead out of a plane",
             "use planar='auto'", lambda laws, asked: laws.leading_out),
        unknown_to_methods("user forces", lambda laws, asked: laws.labels),
        dissipating("user forces with dissipates=True", lambda laws, asked: [
            label_of(force) for force in laws.forces if force.dissipates]),
        Lack((Analysis.TWO_TIMES,), "laws of the user's own",
             "{who}: {name} has a user-defined law, whose force between two times of at_time= is not determined by these times",
             "give one time, or write it as a load with follower=True", lambda laws, asked: laws.pathless),
        timed_loads(lambda laws, asked: [label_of(x) for x in laws.forces if getattr(x, "time", None) is not None]),
        Lack((Analysis.STEADY,), "user forces", "{who}: steady motions do not support {name}, whose law acts in space while they "
             "are seen from a frame of their own", "use a Bushing for a bearing that is alike to all sides, or "
             "modes(damped=True) at rest with the gyroscopic moments as a law", lambda laws, asked: laws.labels),
        Lack((Analysis.SENSITIVITY,), "user forces", "{who}: derivatives do not support {name}",
             "use loads with fixed direction, or differences of equilibria", lambda laws, asked: laws.labels),
        without_adjoint("user forces", lambda laws, asked: laws.labels))

    def __init__(self, forces: list[Any], between: list[Any], laws: dict[type, Lawful]) -> None:
        self.forces, self.called_laws = forces, laws
        self.labels = tuple(label_of(force) for force in (*forces, *between))
        own = [label_of(x) for x in forces if not isinstance(x, FollowerForce)]
        # laws that may lead out of a plane, and laws without a path between two times
        self.leading_out = own + [label_of(x) for x in between if isinstance(x, ForceElement)]
        self.pathless = own + [label_of(x) for x in between]

    def describe(self) -> list[tuple[str, str, tuple[str, ...]]]:
        """Return the line of `print(model)`: all laws."""
        return [("user forces", f"{len(self.labels)} law{'s' * (len(self.labels) > 1)}: ", self.labels)]

    def link_in_plane(self, table: Any, plane: Any) -> Any:
        """Return the table of follower loads in a plane, along u and J u of each node; other tables unchanged."""
        if not isinstance(table, UserForces):
            return table
        own = table.parameters[table.first[:, None] + np.arange(6)]
        along = np.sum(own[:, :3] * plane.factor[table.node], axis=1)
        about = np.sum(own[:, 3:] * plane.normal[table.node], axis=1)
        zero = np.zeros_like(about)
        parameters = np.stack((along.real, along.imag, zero, zero, zero, about), axis=1)
        return PlanarFollowers(*table[:6], 6 * np.arange(len(own)), parameters.reshape(-1), table.place, table.laws, table.work)

    def link_of_run(self, table: Any, run: OfRun) -> Any:
        """Return tables of laws with the work array of the run; shares are copied, because paths change them."""
        if isinstance(table, ON_NODES):
            return table._replace(work=run.law_work, share=table.share.copy())
        return table._replace(work=run.law_work) if isinstance(table, (ForceElements, LineForces)) else table


class Loaded:
    """Nodes of all forces by laws in a scene.

    node: int64 [K].
    share: float64 [K], 1; along beams the tributary length of the node, m.
    of: int64 [K], number of the force.
    nodes: list of int64 [*], nodes of every force.
    """

    def __init__(self, scene: Scene, nodes: NodeList) -> None:
        self.forces = scene.user_forces
        node, share = [np.zeros(0, np.int64)], [np.zeros(0)]
        for force in self.forces:
            if isinstance(force.at, Beam):
                basis = force.at.basis
                node.append(nodes.start(force.at) + np.arange(basis.n_nodes))
                share.append(node_lengths(basis.element_nodes, basis.mass_phi, basis.n_nodes))
            else:
                node.append(np.array([nodes.number(force.at)]))
                share.append(np.ones(1))
        self.nodes = node[1:]
        self.node, self.share = np.concatenate(node), np.concatenate(share)
        self.of = np.repeat(np.arange(len(self.forces)), [len(x) for x in node[1:]]).astype(np.int64)

    def table(self, row_of: Array, blocks: Any, q: Array, place: int) -> UserForces:
        """Build the term; q [N, 4, 3]: coordinates at which laws are tried; place: offset of their work in the history. Raises
        SceneError: a law that cannot be compiled, fails, or gives numbers that are not finite."""
        starts, parameters = parameters_of(self.forces)
        # parameters of every node, or one row for all
        first = [start + (x.shape[1] * np.arange(len(x)) if len(x) > 1 else np.zeros(nodes.size, np.int64))
                 for start, x, nodes in zip(starts, map(rows_of, self.forces), self.nodes)]
        addresses, differences = [], []
        for k, force in enumerate(self.forces):
            address, compiled = compiled_law(force)
            at = q[self.node[np.argmax(self.of == k)]]
            try_law(force, compiled, at)
            addresses.append((address, slopes_of(force, compiled, _given(at))))
            # code that takes the derivative by differences; kept as long as the process
            differences.append(0 if force.derivative is not None else
                               int(_differences(force.law, rows_of(force).shape[1], *_time_of(force)).address))
        along = np.array([isinstance(force.at, Beam) for force in self.forces], np.int64)
        grows = np.array([force.grows for force in self.forces], np.int64)
        return UserForces(self.node, row_of[self.node], blocks.between(self.node, self.node), self.share, grows[self.of],
                          along[self.of], np.concatenate([np.zeros(0, np.int64), *first]), parameters, np.array([place]),
                          _laws(addresses, self.of), np.array(differences, np.int64)[self.of], law_work())


def line_forces(ends: Any) -> LineForces:
    """Build the table of all forces along lines; ends: `links.Ends`. Raises SceneError: a law that cannot be compiled, fails, or
    gives numbers that are not finite; ends that meet."""
    addresses = []
    for force, length in zip(ends.parts, ends.distance.tolist()):
        if not length > 0.0:
            raise SceneError(f"{force.label}: its ends coincide, so its line has no direction; move one of them")
        address, compiled = compiled_law(force)
        given = 0.0, length, 0.0, np.array(force.parameters)
        _agree(force.label, [np.array([_called(force.label, function, given)]) for function in (force.law, compiled)], "tension")
        addresses.append((address, slopes_of(force, compiled, np.array([length, 0.0]))))
    return LineForces(ends.node, ends.row, ends.block, ends.place, *parameters_of(ends.parts), _laws(addresses), law_work())


def force_elements(ends: Any) -> ForceElements:
    """Build the table of all force elements; ends: `links.Ends`. Raises SceneError: a law that cannot be compiled, fails, or
    gives numbers that are not finite."""
    parts, node = ends.parts, ends.node
    axes = np.array([part.directors for part in parts])
    # D_i = sum_k R_ik d_k of both nodes
    turn = np.einsum("lix,lskx->lsik", axes, ends.directors[node])
    start = np.einsum("lix,lx->li", axes, ends.phi[node[:, 1]] - ends.phi[node[:, 0]])
    addresses = []
    for part, place in zip(parts, start):
        address, compiled = compiled_law(part)
        at = np.concatenate((place[None], np.eye(3)))
        try_law(part, compiled, at)
        addresses.append((address, slopes_of(part, compiled, _given(at))))
    return ForceElements(node, ends.row, ends.block, ends.place, turn.reshape(-1), *parameters_of(parts), _laws(addresses),
                         law_work())


def _laws(addresses: list[tuple[int, int]], of: Array | None = None) -> Laws:
    """Return the addresses of laws and of their derivatives; of: number of the law of every row, default: one row each."""
    both = np.array(addresses, np.int64).reshape(-1, 2)
    both = both if of is None else both[of]
    return Laws(both[:, 0].copy(), both[:, 1].copy())


def parameters_of(parts: Sequence[Any]) -> tuple[Array, Array]:
    """Return the offset of the parameters of every part, int64 [L], and the parameters of all; a part without parameters has its
    own offset, too, which identifies a law that failed."""
    numbers = [rows_of(part).reshape(-1) for part in parts]
    ends = np.cumsum([max(1, x.size) for x in numbers], dtype=np.int64)
    all_of = np.zeros(int(ends[-1]) if len(parts) else 0)
    starts = np.concatenate(([0], ends))[:-1].astype(np.int64)
    for x, start in zip(numbers, starts.tolist()):
        all_of[start:start + x.size] = x
    return starts, all_of


def _given(q: Array) -> Array:
    """Return the arguments of a law, [18], for a node with coordinates [4, 3] at rest."""
    return np.concatenate((q.reshape(-1), np.zeros(6)))


def slopes_of(force: UserForce | LineForce | ForceElement, law: Any, given: Array) -> int:
    """Return the address of the derivative of a law, 0 without one; law: the compiled law for Python. Raises SceneError: numba
    cannot compile the derivative, it fails, or it is not that of the law."""
    if force.derivative is None:
        return 0
    who, n = label_of(force), rows_of(force).shape[1]
    on_line = isinstance(force, LineForce)
    make = _tension_slopes if on_line else _slopes
    address, compiled = machine_code(who, "derivative", lambda: make(force.derivative, n, *_time_of(force)))
    # tests/kernels/test_law_slopes.py checks the derivative of follower loads
    if force.derivative is not turning_slopes:
        check_slopes(who, law, compiled, given, rows_of(force)[0], on_line)
    return address


def check_slopes(who: str, law: Any, derivative: Any, given: Array, parameters: Array, on_line: bool) -> None:
    """Check that a derivative is finite at the start, and agrees with differences of the law there at some velocity. At a kink of
    the law it may be the slope of either side, or between. Raises SceneError."""
    rates = slice(1, 2) if on_line else slice(12, 18)
    for speed in (0.0, 0.1):
        at = given.copy()
        at[rates] += speed * np.linspace(1.0, 0.5, at[rates].size)
        try:
            with np.errstate(all="ignore"):
                found = _derivative(derivative, at, parameters, on_line)
        except Exception as failed:
            raise SceneError(f"{who}: its derivative failed at the start, {type(failed).__name__}: "
                             f"{str(failed)[:200]}") from failed
        base = _law(law, at, parameters, on_line)
        far, largest = float(np.max(np.abs(at))), float(np.max(np.abs(np.nan_to_num(found))))
        scale = np.array([far, 0.1]) if on_line else np.repeat([max(1e-3, np.max(np.abs(at[:3]))), 1.0, 0.1], [3, 9, 6])
        for j in range(at.size):
            size = 1e-6 * max(scale[j], 1e-6 * far)
            sides = []
            for step in (-size, size):
                moved = at.copy()
                moved[j] += step
                sides.append((_law(law, moved, parameters, on_line) - base) / step)
            # tolerance of one-sided differences: curvature and round-off
            slack = 1e-3 * np.max(np.abs(sides)) + (1e-13 * np.max(np.abs(base)) + ROUND_OFF * largest * far) / size
            low, high = np.minimum(*sides) - slack, np.maximum(*sides) + slack
            # slopes of speeds vanish at rest
            wrong = ~((found[:, j] >= low) & (found[:, j] <= high) if speed else np.isfinite(found[:, j]))
            if wrong.any():
                i = int(np.argmax(wrong))
                what, by = ("tension", ("length", "rate")[j]) if on_line else (_name(i, FOUND_NAMES), _name(j, GIVEN_NAMES))
                raise SceneError(f"{who}: its derivative returns {found[i, j]:.6g} for the change of {what} with {by}, but "
                                 f"differences of its law give {0.5 * (sides[0][i] + sides[1][i]):.6g}; correct it, or leave "
                                 "derivative= out")


# relative round-off of a law in its arguments
ROUND_OFF = 1e-15
GIVEN_NAMES, FOUND_NAMES = ("position", "directors", "velocity", "spin"), ("force", "moment")


def _name(at: int, names: tuple[str, ...]) -> str:
    """Return the name of component `at` of the vectors `names`, of three numbers each, nine for directors."""
    for name in names:
        size = 9 if name == "directors" else 3
        if at < size:
            return f"{name}[{at // 3}, {at % 3}]" if size == 9 else f"{name}[{at}]"
        at -= size
    raise IndexError(at)


def _law(law: Any, given: Array, parameters: Array, on_line: bool) -> Array:
    """Evaluate a law, [6], or on a line [1]."""
    if on_line:
        return np.array([law(0.0, given[0], given[1], parameters)])
    out = np.zeros(6)
    law(0.0, *_parts_of(given), parameters, out[:3], out[3:])
    return out


def _derivative(derivative: Any, given: Array, parameters: Array, on_line: bool) -> Array:
    """Evaluate the derivative of a law, [6, 18], or on a line [1, 2]."""
    if on_line:
        return np.array([derivative(0.0, given[0], given[1], parameters)], dtype=float)
    out = np.zeros((6, 18))
    derivative(0.0, *_parts_of(given), parameters, out)
    return out


def _parts_of(given: Array) -> tuple[Array, ...]:
    """Split arguments [18] into position, directors, velocity and spin."""
    return given[:3].copy(), given[3:12].reshape(3, 3).copy(), given[12:15].copy(), given[15:].copy()


def _called(who: str, function: Any, given: tuple[Any, ...]) -> Any:
    try:
        with np.errstate(all="ignore"):
            value = function(*given)
            if value is None:
                raise SceneError(f"{who}: its law returns nothing at the start; it must return the tension, N")
            return float(value)
    except SceneError:
        raise
    except Exception as failed:
        raise SceneError(f"{who}: its law failed at the start, {type(failed).__name__}: {str(failed)[:200]}") from failed


def compiled_law(force: UserForce | LineForce | ForceElement) -> tuple[int, Any]:
    """Return the address of a law, and the law for Python; kept as long as the process. Raises SceneError: numba cannot compile
    the law."""
    make = _tension if isinstance(force, LineForce) else _compiled
    return machine_code(label_of(force), "law", lambda: make(force.law, rows_of(force).shape[1], *_time_of(force)))


def rows_of(force: UserForce | LineForce | ForceElement | Drag) -> Array:
    """Return the parameters of the nodes of a part, [n, m]; one row where all nodes have the same."""
    return numbers_of_nodes(force) if isinstance(force, UserForce) else np.array(force.parameters)[None]


def _time_of(force: UserForce | LineForce | ForceElement) -> tuple[Any, ...]:
    """Return the function of time that is a factor of the force, as a tuple; empty without any."""
    time = getattr(force, "time", None)
    return () if time is None else (time.compilable if isinstance(time, Signal) else time,)


_compiled, _tension, _blowing = cache(compiled_force), cache(compiled_tension), cache(compiled_wind)
_slopes, _tension_slopes, _differences = cache(compiled_slopes), cache(compiled_tension_slopes), cache(compiled_differences)


def wind_of(drags: list[Drag], part: Array, place: Array) -> Wind | NoWind:
    """Build the table of all winds; part: int64 [D], number of the drag of a node; place: float64 [D, 3], where the air is
    evaluated. Raises SceneError: a wind that cannot be compiled, fails, or gives numbers that are not finite."""
    if all(drag.wind is None for drag in drags):
        return NoWind()
    addresses = np.zeros(len(drags), np.int64)
    for k, drag in enumerate(drags):
        if drag.wind is None:
            continue
        address, compiled = machine_code(drag.label, "wind", lambda: _blowing(drag.wind, drag.parameters.size))
        found = []
        for function in (drag.wind, compiled):
            out = np.zeros(3)
            try:
                with np.errstate(all="ignore"):
                    function(0.0, place[np.argmax(part == k)].copy(), np.array(drag.parameters), out)
            except Exception as failed:
                raise SceneError(f"{drag.label}: its wind failed at the start, {type(failed).__name__}: "
                                 f"{str(failed)[:200]}") from failed
            found.append(out)
        _agree(drag.label, found, "the velocity of the air", "wind")
        addresses[k] = address
    starts, parameters = parameters_of(drags)
    return Wind(Laws(addresses[part], np.zeros(part.size, np.int64)), starts[part], parameters, law_work())


def try_law(force: UserForce | ForceElement, compiled: Any, q: Array) -> None:
    """Check a law at the start by one call in Python and one compiled."""
    who = label_of(force)
    time = getattr(force, "time", None)
    factor = 1.0 if time is None else float(time(0.0))
    given = 0.0, q[0].copy(), q[1:].copy(), np.zeros(3), np.zeros(3), rows_of(force)[0]
    found = []
    for function, share in ((force.law, factor), (compiled, 1.0)):
        out = np.zeros(3), np.zeros(3)
        try:
            with np.errstate(all="ignore"):
                function(*given, *out)
        except Exception as failed:
            raise SceneError(f"{who}: its law failed at the start, {type(failed).__name__}: {str(failed)[:200]}") from failed
        found.append(share * np.concatenate(out))
        _check_finite(who, found[-1], "force and moment")
    _agree(who, found, "force and moment")


def _check_finite(who: str, found: Array, what: str, law: str = "law") -> None:
    if not np.isfinite(found).all():
        raise SceneError(f"{who}: its {law} returns {shown(found)} for {what} at the start; it must return finite numbers")


def _agree(who: str, found: list[Array], what: str, law: str = "law") -> None:
    """Check that a law gives finite numbers, equal in Python and compiled."""
    for one in found:
        _check_finite(who, one, what, law)
    if not np.allclose(*found, rtol=1e-9, atol=1e-9 * np.max(np.abs(found[0]), initial=0.0)):
        raise SceneError(f"{who}: its {law} returns {shown(found[0])} in Python, but {shown(found[1])} compiled. Variables that "
                         "it reads besides its arguments are constants once it is compiled; pass them in parameters=")


def asked_of(part: Any, t: float, given: Array, parameters: Array) -> Asked:
    """Return the calls of the functions of a part in Python at time t; given, parameters: arguments in compiled code."""
    parameters, derivative, out = parameters[:rows_of(part).shape[1]].copy(), getattr(part, "derivative", None), np.zeros(6)
    position = given[:3].copy()
    if isinstance(part, FollowerForce):
        # the law is part of the package: only the function of time can fail
        time: Any = part.time
        return Asked(label_of(part), {}, [("time function", lambda: time(t), None)])
    if isinstance(part, LineForce):
        length, rate = given[:2].tolist()
        both = [("law", part.law), *([("derivative", derivative)] if derivative else [])]
        return Asked(part.label, {"length": length, "rate": rate},
                     [(noun, partial(f, t, length, rate, parameters), None) for noun, f in both])
    if not isinstance(part, (UserForce, ForceElement)):
        return Asked(part.label, {"position": position}, [("wind", lambda: part.wind(t, position, parameters, out[:3]), out)])
    velocity, spin, slopes = given[12:15].copy(), given[15:18].copy(), np.zeros((6, 18))
    state = t, position, given[3:12].reshape(3, 3).copy(), velocity, spin, parameters
    calls: list[Any] = [("law", lambda: part.law(*state, out[:3], out[3:]), out)]
    if derivative:
        calls.append(("derivative", lambda: derivative(*state, slopes), slopes))
    return Asked(label_of(part), {"position": position, "velocity": velocity, "spin": spin}, calls)
