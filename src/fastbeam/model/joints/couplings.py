"""Screws and gears of a compiled scene: constraints that couple two coordinates of joints each."""
from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from fastbeam.kernels.joints.coupling import JointCouplings
from fastbeam.kernels.joints.drives import KnownForces
from fastbeam.kernels.terms import NoTies
from fastbeam.model.analyses import unknown_to_methods
from fastbeam.model.feature import Feature, OfRun, Stand
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.model.joints.coordinates import Coordinate

Array = np.ndarray


class Coupling:
    """Constraint of two coordinates of joints: the gap is the sum of both, each times its factor; its unit is that of the second.

    coupled, node: as in `ConstrainedJoint`.
    """

    is_vector, holds, rate = False, True, 0.0

    def __init__(self, coupled: tuple[tuple[float, ConstrainedJoint], ...], node: tuple[int, ...]) -> None:
        self.is_angle = coupled[-1][1].law.is_angle
        self._parts = [(factor, one.law, [node.index(k) for k in one.node]) for factor, one in coupled]

    def forces(self, dim: int) -> int:
        """Return 1, the number of multipliers."""
        return 1

    def lead(self, x: Array) -> Array:
        """Return the derivative [1, n, 4, 3] of the gap by the coordinates of all nodes."""
        out = np.zeros((1, *x.shape))
        for factor, law, at in self._parts:
            out[:, at] += factor * law.lead(x[at])
        return out

    def within(self, axes: Array) -> Array:
        """Return the identity [1, 1]: a plane leaves both coordinates free."""
        return np.eye(1)


def couplings_of(relations: list[Any], freedoms: list[Any]) -> tuple[list[ConstrainedJoint], Array]:
    """Return the constraints of D relations between joint coordinates, and the numbers of these, int64 [D, 2]; freedoms:
    coordinates, nodes and frames as in `links.Links`."""
    first: dict[Any, int] = {}
    for k, (freedom, *_) in enumerate(freedoms):
        first.setdefault(freedom.joint, k)
    which = np.array([[first[joint] + k for joint, k in (one.first, one.second)] for one in relations], np.int64).reshape(-1, 2)
    out = []
    for relation, numbers in zip(relations, which.tolist()):
        coupled: tuple[tuple[float, ConstrainedJoint], ...] = ()
        for factor, k in zip((-relation.ratio, 1.0), numbers):
            freedom, at, frame = freedoms[k]
            one = ConstrainedJoint(freedom.force_label("coupling"), at, Coordinate(freedom.shape, frame))
            coupled += ((factor, one),)
        node = tuple(dict.fromkeys(k for _, one in coupled for k in one.node))
        out.append(ConstrainedJoint(relation.label, node, Coupling(coupled, node), coupled))
    return out, which


class Couplings(Feature):
    """Screws and gears, D of them.

    links: their constraints.
    which: int64 [D, 2], the coordinates among those that the joints of the scene leave free.
    joints: names of all coupled joints.
    """

    key, title, order = "couplings", "screws and gears", 85
    constrains = True
    lacks = (unknown_to_methods("screws and gears", lambda couplings, asked: couplings.labels),)

    def __init__(self, links: list[ConstrainedJoint], which: Array, joints: list[str]) -> None:
        self.labels, self.which, self.joints = [link.name for link in links], which, joints
        # float64 [D, 2]
        self.factor = np.array([[factor for factor, _ in link.coupled] for link in links])

    @property
    def constants(self) -> tuple[Array, Array]:
        """Coordinates and their factors."""
        return self.which, self.factor

    def describe(self) -> list[tuple[str, str, list[str]]]:
        """Return the line of `print(model)`."""
        return [("coupled joints", "", self.labels)]

    @staticmethod
    def _first(model: Any) -> int:
        """Return the number of the first of their constraints among all."""
        return int(model.n_sliders + [bool(link.coupled) for link in model.kept].index(True))

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the term of all couplings."""
        own, model = run.own.get("motions"), run.model
        if own is None:
            return []
        which = np.searchsorted(model.motions.rows, self.which)
        first, count = self._first(model), len(which)
        if run.known:
            return [(Stand.JOINTS, KnownForces(own.motion, which.reshape(-1), self.factor.reshape(-1),
                                               first + np.repeat(np.arange(count), 2)))]
        ties = NoTies() if model.ties is None else model.ties
        return [(Stand.JOINTS, JointCouplings(own.motion, which, self.factor, np.array([first]), ties))]

    def follow(self, ways: Array) -> Array:
        """Return increments of all joint coordinates [C] with those that couplings derive from increments other than zero."""
        out = ways.copy()
        for _ in self.which:
            for (i, j), (a, b) in zip(self.which.tolist(), self.factor.tolist()):
                if out[i] != 0.0:
                    out[j] = -a / b * out[i]
                elif out[j] != 0.0:
                    out[i] = -b / a * out[j]
        return out

    # --- at rows ------------------------------------------------------------------------------------------------------
    def series(self, kinds: Collection[str], model: Any) -> dict[str, tuple[int, ...]]:
        """Return the shape of the forces on joint coordinates."""
        return {"joint_coupling": (len(model.motions.names),)} if "joint" in kinds else {}

    def read_forces(self, kinds: Collection[str], model: Any, force: Array) -> dict[str, Array]:
        """Return the forces of couplings on all joint coordinates, N or N m, [C]."""
        if "joint" not in kinds:
            return {}
        at = model.first_force[self._first(model)]
        out = np.zeros(len(model.motions.names))
        np.add.at(out, self.which, self.factor * force[at:at + len(self.which), None])
        return {"joint_coupling": out}

    def named(self, kinds: Collection[str]) -> dict[str, list[str]]:
        """Return the joints that are coupled."""
        return {"coupled": self.joints} if "joint" in kinds else {}
