"""Nodes with added mass (theory.md (4.34)): tables, initial momenta in `State.history`, energy and momenta at rows."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.forces.added_mass import AddedMass
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, Lack, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Feature, OfRun, Stand
from fastbeam.model.forces.damping_and_drag import in_fluid
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import Elements
from fastbeam.scene import Scene

Array = np.ndarray


@dataclass(frozen=True)
class Added(Feature):
    """Nodes with added mass."""

    key, title, order = "added", "added mass", 110
    lacks = (
        unknown_to_methods("added mass"),
        Lack((Analysis.ORDER_4,), "different masses along and across",
             "order=4: {name}: where the masses along d1 and across it differ, velocities are of second order only, and so is "
             "the motion after it",
             "use order=2", lambda added, asked: added.labels[:1] * added.turns),
        Lack((Analysis.BLOWS,), "added mass",
             "{name}: impacts do not include the mass of the fluid, but sliders or joints have rigid stops, locks, releases or "
             "one-sided contact, or supports engage", "leave these out, or use elastic stops",
             lambda added, asked: added.labels),
        Lack((Analysis.STEADY,), "added mass", "{who}: {name}: steady motions do not include the fluid", "leave it out",
             lambda added, asked: added.labels),
        without_adjoint("added mass"))

    labels: tuple[str, ...]  # labels of the added masses
    # node, part, int64 [A]: nodes, and number of the added mass of each
    node: Array
    part: Array
    # normal, along, float64 [A]: masses of whole nodes, kg: across d1, and the excess of that along d1
    normal: Array
    along: Array
    table: AddedMass | None = None  # the term
    in_space: bool = True  # false for the tables of a plane

    @property
    def history_size(self) -> int:
        """Number of history variables, a momentum of every node."""
        return self.node.size

    @property
    def turns(self) -> bool:
        """True if the mass along d1 differs from that across, so that it turns with the section."""
        return bool(np.any(self.along != 0.0))

    def with_table(self, row_of: Array, block: Array, first: int) -> Added:
        """Return a copy with its table; block: diagonal blocks [A]; first: offset of the first momentum in the history."""
        return replace(self, table=AddedMass(self.node, row_of[self.node], block, self.normal, self.along,
                                             first + np.arange(self.history_size)))

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the inertia term; none in statics."""
        return [] if run.static else [(Stand.WATER, self.table)]

    def momenta(self, q: Array, v: Array) -> Array:
        """Return the momenta along d1 of velocities, float64 [A]; q, v [N, 12], in a plane [N, 4]."""
        d = 3 if q.shape[1] == 12 else 2
        return np.asarray(self.along * np.einsum("ac,ac->a", q[self.node, d:2 * d], v[self.node, :d]))

    def in_plane(self, plane: Any, model: Any, constraints: int) -> Added:
        """Return a copy for coordinates [4 N]."""
        return replace(self, in_space=False)

    def start_momenta(self, own: Array, q: Array, v: Array, s: Array) -> None:
        """Set the momenta along d1 at coordinates and rates [12 N], in a plane [4 N]."""
        size = 12 if self.in_space else 4
        own[:] = self.momenta(q.reshape(-1, size), v.reshape(-1, size))

    def misfit(self, own: Array, q: Array, v: Array, s: Array) -> float:
        """Return the largest difference between velocities along d1 and those of momenta own [A], m/s; q, v [12 N]."""
        there = self.along != 0.0
        off = (own - self.momenta(q.reshape(-1, 12), v.reshape(-1, 12)))[there] / self.along[there]
        return float(np.max(np.abs(off), initial=0.0))

    def add_motion(self, model: Any, state: State, out: Array) -> None:
        """Add the kinetic energy and the momenta of the fluid."""
        own = model.own(state.history, self.key)
        q, v = (x.reshape(-1, 4, 3)[self.node] for x in (state.q, state.v))
        p = self.normal[:, None] * v[:, 0] + own[:, None] * q[:, 1]
        there = self.along != 0.0
        out[0] += 0.5 * float(self.normal @ np.sum(v[:, 0]**2, axis=1))
        out[0] += 0.5 * float(np.sum(own[there]**2 / self.along[there]))
        out[1:4] += p.sum(axis=0)
        out[4:7] += np.cross(q[:, 0], p).sum(axis=0)

    def mass_map(self, q: Array) -> Any:
        """Assemble the masses on the coordinates of all nodes at q [12 N], sparse [12 N, 12 N]."""
        d1 = q.reshape(-1, 4, 3)[self.node, 1]
        blocks = self.normal[:, None, None] * np.eye(3) + self.along[:, None, None] * d1[:, :, None] * d1[:, None, :]
        at = 12 * self.node[:, None] + np.arange(3)
        rows, columns = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        return sparse.csr_matrix((blocks.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(q.size, q.size))


def added_of(scene: Scene, nodes: NodeList, elements: list[Elements]) -> Added | None:
    """Build the feature of added mass; None without any. elements: of every beam, then of every net."""
    given = scene.added_masses
    if not given:
        return None
    every, part, _, size = in_fluid(given, nodes, elements)
    normal, tangential = (np.array([getattr(x, of) for x in given])[part] for of in ("normal", "tangential"))
    return Added(tuple(f"{x.label} on {x.on.label}" for x in given), every, part, size * normal,
                 size * (tangential - normal))
