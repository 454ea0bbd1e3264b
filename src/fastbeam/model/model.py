"""The compiled scene: constant tables, and the list of the work that is present."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface import notebook
from fastbeam.interface.arguments import Count, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import Inner
from fastbeam.kernels.beams.nodes import NODES_SCRATCH, Bodies, Held
from fastbeam.kernels.beams.planar_nodes import PlanarBodies, PlanarTies
from fastbeam.kernels.beams.ties import Ties
from fastbeam.kernels.contact.curves import Paths
from fastbeam.kernels.contact.slider import END_SLACK
from fastbeam.kernels.contact.slider_forces import FREE, HELD, HISTORY
from fastbeam.kernels.layout import NODES, POINTS, layout_of
from fastbeam.kernels.linalg.carriers import Carriers
from fastbeam.kernels.linalg.substructures import ELEMENTS, Substructures, front_size
from fastbeam.kernels.state import State
from fastbeam.linalg.pattern import Pattern
from fastbeam.model.feature import Feature
from fastbeam.model.features import WithFeatures
from fastbeam.model.fingerprint import fingerprint_of
from fastbeam.model.holding import Holding
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.model.loading import Loading, Remarks
from fastbeam.model.mapping import state_for

Array = np.ndarray
# round-off of arc lengths at ends of tracks of switches, as a share of them
TRACK_SLACK = 4.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Model(WithFeatures):
    """Everything a run needs and nothing it changes; made by `compile_scene`, printed by `print(model)`."""

    scene_name: str
    n_nodes: int
    # simo, green: elements with strain set (2.2), (2.1)
    simo: ElementTables | None
    green: ElementTables | None
    reference_strains: Array  # float64 [*]: strains of all elements that are free of stress at the start, by `ElementTables.meta`
    # inner, substructures, carriers, bodies, ties, held: None where the scene has none; then no code is compiled for them
    inner: Inner | None
    substructures: Substructures | None
    carriers: Carriers | None
    bodies: Bodies | PlanarBodies | None
    links: tuple[Any, ...]  # tables of springs and other links between two points, one of each kind
    kept: list[ConstrainedJoint]  # joints with multipliers, in the order of their constraints behind the sliders
    kept_softness: Array  # float64 [J]: share of 1/a, theory.md (5.5), in the equations of each of these joints
    ties: Ties | PlanarTies | None
    held: Held | None
    static_held: Held | None  # fixed unknowns in statics: includes one spin of every beam of a net that may spin about its axis
    pattern: Pattern  # order, blocks and elimination plan
    spinless: Array  # int8 [N]: 1 where a triad does not turn
    spin_root: Array  # int64 [N]: the node whose spin a node shares
    # q0, v0, s0: initial state; q [12 N], v [12 N], s [S]
    q0: Array
    v0: Array
    s0: Array
    length: float  # size of the scene, m
    # smallest EI / (EA length^2) of all elements, EA the stiffest of extension and shear, EI the softest of torsion and bending.
    # Increments above this size, relative to the length, change axial forces by EA times their square, which bends a beam more
    # than the increments do
    softest: float
    n_blocks: int
    names: dict[str, list[Any]]
    numbers: Any  # finds the global number of a node of the scene
    loading: Loading  # loads and gravity, whose attributes are attributes of the model, too
    dofs: tuple[int, ...] = SPACE  # tuple with one entry for each unknown of a node: 6, in the tables of a planar scene 3
    plane: Any = None  # Plane of a planar scene, and its tables with 3 unknowns a node
    # makes the model of the same scene for a sparse solver, without elimination of inner nodes; its argument is `planar`
    uneliminated: Callable[..., Model] | None = None
    uncondensed: Callable[[], Model] | None = None  # makes the model of the same scene in space, whose beams are not condensed
    features: tuple[Feature, ...] = ()  # features of the scene, in the order of their history variables
    remarks: Remarks = Remarks()  # remarks on the model, whose attributes are attributes of the model, too
    find_holding: Callable[[], Holding] | None = None  # callable that makes `holding` on its first use

    @property
    def labels(self) -> list[str]:
        """Beam and node, body or mass of every node."""
        return self.numbers.labels  # type: ignore[no-any-return]

    @cached_property
    def holding(self) -> Holding:
        """Supports, and joints that are eliminated."""
        assert self.find_holding is not None
        return self.find_holding()

    @property
    def fixed_mask(self) -> Array:
        """Unknowns of every node that are fixed at the start, one bit for each of the six, int64 [N]; those of slave nodes count
        as fixed."""
        return self.fixed_in(None)

    def fixed_in(self, state: State | None) -> Array:
        """Return the mask of fixed unknowns as in `fixed_mask`, with the supports that have let go or taken hold in a state."""
        of_row = np.zeros(self.n_nodes, np.int64)
        if self.held is not None:
            of_row[self.held.row] = self.held.mask
        if self.released is not None and state is not None:
            self.released.put(self.released.off(self.own(state.history, "released")), of_row)
        return of_row[self.pattern.row_of]

    @property
    def blows(self) -> bool:
        """True if moving air exerts forces at rest."""
        return self.dragged is not None and bool(self.dragged.blows)

    @property
    def has_blows(self) -> bool:
        """True if velocities of sliders, joints or supports may jump."""
        forces, motions = self.slider_forces, self.motions
        return bool(forces is not None and (forces.lets_go or np.any(forces.restitutions >= 0.0))
                    or self.released is not None and self.released.losses
                    or motions is not None and motions.holds.has_rigid_stops)

    @property
    def reaction_names(self) -> list[str]:
        """Names of supports, eliminated joints and joints with multipliers, in the order of their reactions."""
        return [*self.holding.support_names, *self.holding.joint_names, *self.constrained_joint_names]

    @property
    def constrained_joint_names(self) -> list[str]:
        """Names of the joints with multipliers; a joint may be several links."""
        return list(dict.fromkeys(one.joint for link in self.kept for _, one in link.shares))

    @cached_property
    def mass(self) -> float:
        """Mass of the scene, kg; 1 if nothing has mass."""
        return float(self.gravity_weight.sum()) or 1.0

    @cached_property
    def n_sliders(self) -> int:
        """Number of sliders."""
        return self.s0.size

    @cached_property
    def n_constraints(self) -> int:
        """Number of constraints with multipliers: sliders, then joints, then moments of sleeves."""
        return self.n_sliders + len(self.kept) + len(self.sleeve_pairs)

    @cached_property
    def carried(self) -> Array:
        """True for constraints of sliders, or sleeves, that are condensed with their beam (compile/carriers.py), bool [C]."""
        out = np.zeros(self.n_constraints, bool)
        if self.carriers is not None:
            out[self.carriers.slider] = True
            out[self.sleeve_pairs[:, 1]] = out[self.sleeve_pairs[:, 0]]
        return out

    @cached_property
    def n_bordered(self) -> int:
        """Number of constraints that are not condensed: rows of the block matrix or a dense border."""
        return int(np.sum(~self.carried))

    @property
    def bordered_sliders(self) -> int:
        """Number of sliders that are not condensed."""
        return int(np.sum(~self.carried[:self.n_sliders]))

    @cached_property
    def sleeve_pairs(self) -> Array:
        """Slider and moment constraint of every sleeve, int64 [O, 2]."""
        if self.sleeves is None:
            return np.zeros((0, 2), np.int64)
        sliders = np.flatnonzero(self.sleeves.of_slider >= 0)
        return np.stack((sliders, self.sleeves.first[0] + self.sleeves.of_slider[sliders]), axis=1)

    @cached_property
    def coupled(self) -> Array:
        """Pairs of constraints that are coupled by own unknowns, int64 [O, 2]: `sleeve_pairs`, then contacts of moving meshes and
        the next on their beams."""
        return self.sleeve_pairs if self.moving is None else np.concatenate((self.sleeve_pairs, self.moving.pairs))

    @property
    def constraint_names(self) -> list[str]:
        """Sliders, joints with multipliers and moments of sleeves, for messages."""
        names = self.names["sliders"]
        return [*(f"slider {name!r}" for name in names), *(link.name for link in self.kept),
                *(f"sleeve {names[k]!r} (moments)" for k in self.sleeve_pairs[:, 0])]

    @cached_property
    def forces(self) -> Array:
        """Number of forces of every constraint, int64 [C]."""
        moments = 3 if self.dim == 3 else 1
        return np.array([self.dim] * self.n_sliders + [link.forces(self.dim) for link in self.kept]
                        + [moments] * len(self.sleeve_pairs), np.int64)

    @cached_property
    def first_force(self) -> Array:
        """Number of the first force of every constraint among all forces, int64 [C]."""
        return np.cumsum(self.forces) - self.forces

    @cached_property
    def n_forces(self) -> int:
        """Number of forces of all constraints."""
        return int(self.forces.sum())

    @cached_property
    def softness(self) -> Array:
        """Share of 1/a, theory.md (5.5), in the equations of every constraint, float64 [C]; 0: plain multipliers."""
        return np.concatenate((np.ones(self.n_sliders), self.kept_softness, np.ones(len(self.sleeve_pairs))))

    @cached_property
    def unknowns(self) -> Array:
        """Number of unknowns of every constraint, int64 [C]: sliders have a place and a mean gap besides forces, moments of
        sleeves a copy of a spin and idle unknowns up to the same number."""
        out = self.forces.copy()
        out[:self.n_sliders] = out[self.n_sliders + len(self.kept):] = self.border
        return out

    @cached_property
    def dim(self) -> int:
        """Components of a position: 3, in the tables of a planar scene 2."""
        return 3 if self.dofs == SPACE else 2

    def rows_in(self, x: Array) -> Array:
        """Return the unknowns of the nodes [rows, 3 or 6] in an array that pads every row to 8 numbers; a view."""
        n = self.pattern.n
        return x[:8 * n].reshape(n, 8)[:, :len(self.dofs)]

    def blocks_in(self, x: Array) -> Array:
        """Return blocks [m, 3 or 6, 8] in the array that holds them; a view."""
        size = len(self.dofs)
        return x[:8 * size * self.pattern.keys.size].reshape(-1, size, 8)

    @cached_property
    def border(self) -> int:
        """Border unknowns of a slider: force, s, mean gap."""
        return 2 * self.dim + 1

    @cached_property
    def columns(self) -> int:
        """Right-hand sides of a solve: residual and borders."""
        return 1 + self.border * self.n_bordered

    @property
    def border_size(self) -> int:
        """Doubles of a dense border of all constraints; 0 without any."""
        return self.columns * (self.columns + len(self.dofs) * self.n_nodes) if self.n_bordered else 0

    @cached_property
    def width(self) -> int:
        """Columns of the panel of right-hand sides: one, or those of sliders padded to 8."""
        return -(-self.columns // 8) * 8 if self.columns > 1 else 1

    @property
    def past_size(self) -> int:
        """Number of values of the last two steps that a run keeps for the predictor, besides the increments of the last step."""
        return 5 + len(self.dofs) * self.n_nodes + 2 * (self.dim + 1) * self.n_sliders

    @cached_property
    def scratch_size(self) -> int:
        """Doubles of the scratch of one thread, for the largest group of elements, or eight nodes."""
        metas = [t.meta for t in (self.simo, self.green) if t is not None]
        kinds = {divmod(kind, 1000) for m in metas for kind in np.unique(1000 * m[:, NODES] + m[:, POINTS]).tolist()}
        most = max([NODES_SCRATCH, *(layout_of(self.dofs, nn, nq).doubles for nn, nq in kinds)])
        return most if self.substructures is None else most + front_size(len(self.dofs))

    @property
    def n_unknowns(self) -> int:
        """Number of scalar unknowns of a run: free nodal unknowns, constraint forces, sliding coordinates."""
        return self.own_unknowns if self.plane is None else int(self.plane.model.own_unknowns)

    @property
    def own_unknowns(self) -> int:
        """Number of scalar unknowns of these tables, whether or not the scene has a plane."""
        return len(self.dofs) * self.n_rows - self.n_fixed + self.n_forces + self.n_sliders

    @property
    def n_rows(self) -> int:
        """Number of block rows of all nodes; welded beams of a net share one."""
        return int(self.pattern.row_of.max()) + 1

    @property
    def n_fixed(self) -> int:
        """Number of fixed unknowns, those of slave nodes included."""
        return 0 if self.held is None else int(np.sum(self.held.mask[:, None] >> np.arange(len(self.dofs)) & 1))

    @property
    def solver(self) -> str:
        """'chain' (block elimination in compiled code) or 'sparse' (PARDISO, SuperLU)."""
        return "sparse" if self.pattern.plan is None else "chain"

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all tables and the initial state, the same in every process of a machine; functions of time count only as
        present."""
        return fingerprint_of(self)

    @checked(node=Count(0))
    def node_label(self, node: int) -> str:
        """Return beam and node, body or mass of a global node number. Raises SceneError: there is no such node."""
        if node >= self.n_nodes:
            raise SceneError(f"model of {self.scene_name!r}: node {node} does not exist, they run from 0 to {self.n_nodes - 1}")
        return self.labels[node]

    def state(self) -> State:
        """Return a new copy of the initial state."""
        history = self.start_history(self.q0, self.v0, self.s0)
        return State(self.q0.copy(), self.v0.copy(), self.s0.copy(), np.zeros(self.n_forces), history)

    def ends_at(self, s: Array) -> Array:
        """Return the arc lengths of the ends of curves, as `slider_ends`; on switches, of the tracks of sliders at s [S]."""
        ends = self.slider_ends.copy()
        for k, spans in self.spans.items():
            ends[k] = spans[int(np.argmin(np.maximum(spans[:, 0] - s[k], s[k] - spans[:, 1])))]
        return ends

    def limits_at(self, s: Array, history: Array | None = None) -> Array:
        """Return the arc lengths between which sliders at s [S] may go, of their tracks or of rigid stops, float64 [S, 2];
        history: of the state, default that of the start."""
        ends = self.ends_at(s)
        return ends if self.slider_forces is None else np.asarray(self.slider_forces.limits(ends, s, self.along_of(history)))

    def step_limits_at(self, s: Array, history: Array | None) -> Array:
        """Return the arc lengths between which a step may lead sliders at s [S], float64 [S, 2]: as `limits_at`; infinite for
        those that are locked or released, whose s stays to round-off, at an end of the beam too."""
        out = self.limits_at(s, history)
        if self.slider_forces is not None:
            out[self.along_of(history)[:, HELD] != FREE] = -np.inf, np.inf
        return out

    def slack_at(self, limits: Array) -> Array:
        """Return the round-off by which sliders may be beyond their limits [S, 2], float64 [S]."""
        low, high = limits.T
        # a closed path has no ends, but may have one stop
        slack = END_SLACK * np.where(high < np.inf, high, np.abs(low))
        # a place beyond the end of a track opens a gap on the next track, where both meet at a corner
        on_switch = list(self.spans)
        slack[on_switch] = TRACK_SLACK * np.maximum(np.abs(low), np.abs(high))[on_switch]
        return np.asarray(slack)

    def put_limits(self, out: Array, s: Array, history: Array | None = None) -> Array:
        """Put limits and the round-off beyond them into `out`, as compiled code takes them, float64 [S, 3]."""
        out[:, :2] = self.step_limits_at(s, history)
        out[:, 2] = self.slack_at(out[:, :2])
        return out

    def along_of(self, history: Array | None) -> Array:
        """Return the history variables of sliders in a history, or at the start, float64 [S, 11]: a view."""
        own = self.slider_forces.initial_history if history is None else self.own(history, "slider_forces")
        return np.asarray(own.reshape(-1, HISTORY))

    @property
    def track(self) -> str:
        """Kind of curve of the sliders, 'path' or 'beam', for messages."""
        return "path" if isinstance(self.curves, Paths) else "beam"

    @cached_property
    def slider_ends(self) -> Array:
        """Arc lengths of the ends of the curves of sliders, infinite for closed paths, float64 [S, 2]."""
        ends = np.stack((np.zeros(self.n_sliders), self.slider_lengths), axis=1)
        if isinstance(self.curves, Paths) and self.sliders is not None:
            ends[self.curves.period[self.sliders.curve] > 0.0] = -np.inf, np.inf
        return ends

    def state_for(self, names: Mapping[str, list[object]], state: State, moving: Feature | None = None) -> State:
        """Map a state of another model, with these names of parts and moving meshes, to this model; see `Result.state_for`."""
        return state_for(self, names, state, moving)  # type: ignore[arg-type]

    @property
    def panel_rows(self) -> int:
        """Rows of the panel of right-hand sides: nodes that the solver sees; with sliders all but those of condensed beams."""
        if self.columns == 1:
            return self.pattern.n
        return self.n_nodes if self.substructures is None else int(self.substructures.counts[0])

    @property
    def condensed_elements(self) -> int:
        """Elements in condensed beams."""
        return 0 if self.substructures is None else 8 * int(self.substructures.group[:, ELEMENTS].sum())

    def groups_of_beams(self) -> tuple[Array, Array]:
        """Return the rows of `substructures.group` of condensed beams with strain set (2.2), and of those with (2.1)."""
        assert self.substructures is not None
        n = int(self.substructures.counts[1])
        return self.substructures.group[:n], self.substructures.group[n:]

    def others(self, tables: ElementTables, groups: Array) -> int:
        """Return the number of element groups in tables of one strain set that belong to no condensed beam (`groups`) and to no
        condensed beam with sliders."""
        carried = 0
        if self.carriers is not None:
            carried = int(self.carriers.tables[self.carriers.tables[:, 1] == (tables is self.green), 3].sum())
        return len(tables.meta) - int(groups[:, ELEMENTS].sum()) - carried

    @cached_property
    def by_rows(self) -> bool:
        """True if sliders are rows of the block matrix (theory.md 9) and not a dense border."""
        return self.n_constraints > 0 and self.pattern.plan is not None and self.substructures is None

    def __str__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return notebook.text(f"Model of {self.scene_name}", self.text)


def check_model(who: str, model: Any) -> None:
    """Check that a model is compiled. Raises SceneError: names the function that was called."""
    if not isinstance(model, Model):
        raise SceneError(f"{who}: needs a model, got {shown(model)}; compile it first: model = fb.compile_scene(scene)")
