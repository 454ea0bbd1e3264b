"""The compiled scene: constant tables, and the list of the work that is present."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from .arguments import LARGEST, Count, checked, real, shown
from .errors import SceneError
from .kernels.beam import ElementTables
from .kernels.carriers import Carriers
from .kernels.curves import Curves
from .kernels.inner import Inner
from .kernels.kinds import SPACE
from .kernels.layout import layout_of
from .kernels.nodes import NODES_SCRATCH, Bodies, Held
from .kernels.planar_nodes import PlanarBodies, PlanarTies
from .kernels.slider import Contact, ContactInRows, ContactOfCarriers, Sliders
from .kernels.substructures import Substructures, front_size, place_stores
from .kernels.terms import NoTies
from .kernels.ties import Ties
from .kernels.work import Line, State, Work
from .kept import KeptLink
from .mapping import state_for
from .pattern import Pattern

Array = np.ndarray


@dataclass
class Model:
    """Everything a run needs and nothing it changes; made by `compile_scene`, printed by `print(model)`.

    Attributes
    ----------
    simo, green : ElementTables or None
        Elements with strain set (2.2), (2.1).
    inner, substructures, carriers, bodies, ties, held, curves, sliders : tables or None
        None where the scene has none; then no code is compiled for them.
    links : tuple
        Tables of springs and other links between two points, one of each kind.
    kept : list of links.KeptLink
        Joints with multipliers, in the order of their constraints behind the sliders.
    static_held : Held or None
        What is held in statics: with one spin of every beam of a net that may spin about its axis.
    pattern : Pattern
        Order, blocks and elimination plan.
    spinless : int8 [N]
        1 where a triad does not turn.
    spin_root : int64 [N]
        The node whose spin a node shares.
    loads : float64 [K, 8 (N + 1)]
        Load vectors in row layout; `load_times[k]` their factor (None: constant).
    q0, v0, s0 : initial state; q [12 N], v [12 N], s [S].
    length : float
        Size of the scene, m.
    numbers : numbering.NodeList
        Finds the global number of a node of the scene.
    size : tuple
        Of as many numbers as a node has unknowns: 6, in the tables of a planar scene 3.
    plane : planar.Plane or None
        Where the scene stays in a plane: the plane and the tables of the same scene with 3 unknowns a node.
    not_planar : str
        Why there is no plane.
    asked_for_plane : bool
        Whether it was compiled with planar=True: nothing but the plane is of interest.
    plain : callable
        Makes the model of the same scene for a sparse solver, without elimination of inner nodes; its argument is `planar`.
    uncondensed : callable
        Makes the model of the same scene in space, whose beams are not condensed.
    massless : tuple of str
        Beams without rotary inertia whose triads nothing holds.
    projected : str
        What a projection of the initial velocities changed; empty where there was none.
    joints : dict
        Names of the joints at a node.
    load_names : list of str
        What each time function belongs to.
    """

    scene_name: str
    n_nodes: int
    simo: ElementTables | None
    green: ElementTables | None
    inner: Inner | None
    substructures: Substructures | None
    carriers: Carriers | None
    bodies: Bodies | PlanarBodies | None
    links: tuple[Any, ...]
    kept: list[KeptLink]
    ties: Ties | PlanarTies | None
    held: Held | None
    static_held: Held | None
    curves: Curves | None
    sliders: Sliders | None
    pattern: Pattern
    spinless: Array
    spin_root: Array
    loads: Array
    load_times: list[Callable[[float], float] | None]
    gravity: Array
    gravity_time: Callable[[float], float] | None
    gravity_weight: Array
    constant_load: Array
    q0: Array
    v0: Array
    s0: Array
    slider_lengths: Array
    length: float
    n_blocks: int
    names: dict[str, list[Any]]
    labels: list[str]
    numbers: Any
    text: str = ""
    size: tuple[int, ...] = SPACE
    plane: Any = None
    not_planar: str = ""
    asked_for_plane: bool = False
    plain: Callable[..., Model] | None = None
    uncondensed: Callable[[], Model] | None = None
    massless: tuple[str, ...] = ()
    projected: str = ""
    joints: dict[int, list[str]] = field(default_factory=dict)
    load_names: list[str] = field(default_factory=list)

    @property
    def held_mask(self) -> Array:
        """Of every node which of its six unknowns are held, bit by bit, int64 [N]; tied coordinates count as held."""
        of_row = np.zeros(self.n_nodes, np.int64)
        if self.held is not None:
            of_row[self.held.row] = self.held.mask
        return of_row[self.pattern.row_of]

    @property
    def n_sliders(self) -> int:
        """Number of sliders."""
        return self.s0.size

    @property
    def n_constraints(self) -> int:
        """Number of constraints with multipliers: sliders, then joints."""
        return self.n_sliders + len(self.kept)

    @property
    def constraint_names(self) -> list[str]:
        """Sliders and joints with multipliers, for messages."""
        return [f"slider {name!r}" for name in self.names["sliders"]] + [link.name for link in self.kept]

    @property
    def forces(self) -> Array:
        """Of every constraint the number of its forces, int64 [C]."""
        return np.array([self.dim] * self.n_sliders + [link.forces(self.dim) for link in self.kept], np.int64)

    @property
    def unknowns(self) -> Array:
        """Of every constraint the number of its unknowns, int64 [C]: a slider has its place and mean gap besides forces."""
        return self.forces + (self.dim + 1) * (np.arange(self.n_constraints) < self.n_sliders)

    @property
    def dim(self) -> int:
        """Components of a position: 3, in the tables of a planar scene 2."""
        return 3 if self.size == SPACE else 2

    @property
    def border(self) -> int:
        """Border unknowns of a slider: force, s, mean gap."""
        return 2 * self.dim + 1

    @property
    def columns(self) -> int:
        """Right-hand sides of a solve: residual and borders."""
        return 1 if self.carriers is not None else 1 + self.border * self.n_constraints

    @property
    def border_size(self) -> int:
        """Doubles of a dense border of all constraints; 0 without any."""
        columns = 1 + self.border * self.n_constraints if self.n_constraints else 0
        return columns * (columns + len(self.size) * self.n_nodes)

    @property
    def width(self) -> int:
        """Columns of the panel of right-hand sides: one, or those of sliders padded to 8."""
        return -(-self.columns // 8) * 8 if self.columns > 1 else 1

    @property
    def past_size(self) -> int:
        """Numbers that a run keeps of the last two steps for the first guess of the next, besides the increments of the last."""
        return 5 + len(self.size) * self.n_nodes + 2 * (self.dim + 1) * self.n_sliders

    @cached_property
    def softest(self) -> float:
        """EI / (EA length^2), the smallest of all elements, with the stiffest of extension and shear and the softest of torsion
        and bending: from increments of this size on (relative to the length) the change of the forces that they cause, EA times
        their square, bends a beam more than they do."""
        out = np.inf
        for tables in (self.simo, self.green):
            if tables is not None:
                stiff = tables.tab[np.unique(tables.meta[:, 2])[:, None, None] + 56 * np.arange(6)[:, None] + np.arange(8)]
                long, bend = stiff[:, :3].max(axis=1), stiff[:, 3:]
                bend = np.where(bend > 0.0, bend, np.inf).min(axis=1)
                out = min(out, float(np.min(bend / (long * self.length**2))))
        return out

    @property
    def n_unknowns(self) -> int:
        """Free unknowns of the nodes, and force and position of every slider; those that a run solves for."""
        return self.own_unknowns if self.plane is None else int(self.plane.model.own_unknowns)

    @property
    def own_unknowns(self) -> int:
        """The same of these tables, whether or not the scene has a plane."""
        return len(self.size) * self.n_rows - self.n_held + int(self.forces.sum()) + self.n_sliders

    @property
    def n_rows(self) -> int:
        """Block rows of all nodes; welded beams of a net share one."""
        return int(self.pattern.row_of.max()) + 1

    @property
    def n_held(self) -> int:
        """Number of held unknowns, those of tied nodes included."""
        return 0 if self.held is None else int(np.sum(self.held.mask[:, None] >> np.arange(len(self.size)) & 1))

    @property
    def solver(self) -> str:
        """'chain' (block elimination in compiled code) or 'sparse' (PARDISO, SuperLU)."""
        return "sparse" if self.pattern.plan is None else "chain"

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all tables and the initial state; functions of time count only by being there. Of the same scene it is the
        same in every process of one machine."""
        digest = sha256()
        tables = (self.simo, self.green, self.bodies, *self.links, self.ties, self.held, self.curves, self.sliders)
        # the ties of a joint are those of the model
        parts = [x for table in tables for x in ((None,) if table is None else table) if x is None or isinstance(x, np.ndarray)]
        parts += [self.pattern.row_of, self.spinless, self.loads, self.gravity, self.gravity_weight, self.constant_load, self.q0,
                  self.v0, self.s0, self.slider_lengths]
        for x in parts:
            digest.update(b"-" if x is None else f"{x.dtype.str}{x.shape}".encode())
            if x is not None:
                digest.update(np.ascontiguousarray(x).reshape(-1).view(np.uint8))
        digest.update(str([self.plane is None, *(time is None for time in (*self.load_times, self.gravity_time))]).encode())
        return digest.hexdigest()

    @checked(node=Count(0))
    def node_label(self, node: int) -> str:
        """Beam and node, body or mass of a global node number.

        Raises
        ------
        SceneError
            There is no such node.
        """
        if node >= self.n_nodes:
            raise SceneError(f"model of scene {self.scene_name!r}: node {node} does not exist, they run from 0 to "
                             f"{self.n_nodes - 1}")
        return self.labels[node]

    def state(self) -> State:
        """A fresh copy of the initial state."""
        return State(self.q0.copy(), self.v0.copy(), self.s0.copy(), np.zeros(self.forces.sum()))

    def state_for(self, names: dict[str, list[Any]], state: State) -> State:
        """A state of another model, with these names of parts, as one of this model; see `Result.state_for`."""
        return state_for(self, names, state)

    @cached_property
    def _scratch(self) -> int:
        """Doubles that the largest group of elements needs, or eight nodes."""
        metas = [t.meta for t in (self.simo, self.green) if t is not None]
        sizes = [layout_of(self.size, int(nn), int(nq)).size for m in metas for nn, nq in np.unique(m[:, :2], axis=0)]
        most = max([*sizes, NODES_SCRATCH])
        return most if self.substructures is None else most + front_size(len(self.size))

    @property
    def panel_rows(self) -> int:
        """Rows of the panel of right-hand sides: those that the solver sees; with sliders all but those of condensed beams."""
        if self.columns == 1:
            return self.pattern.n
        return self.n_nodes if self.substructures is None else int(self.substructures.counts[0])

    @property
    def condensed_elements(self) -> int:
        """Elements in condensed beams."""
        return 0 if self.substructures is None else 8 * int(self.substructures.group[:, 1].sum())

    def groups_of_beams(self) -> tuple[Array, Array]:
        """Rows of `substructures.group` of the condensed beams with strain set (2.2), and of those with (2.1)."""
        assert self.substructures is not None
        n = int(self.substructures.counts[1])
        return self.substructures.group[:n], self.substructures.group[n:]

    def others(self, tables: ElementTables, groups: Array) -> int:
        """Groups of elements in tables of one strain set that belong to no condensed beam, of `groups`, and to no carrier."""
        carried = 0
        if self.carriers is not None:
            carried = int(self.carriers.tables[self.carriers.tables[:, 1] == (tables is self.green), 3].sum())
        return len(tables.meta) - int(groups[:, 1].sum()) - carried

    def scratch(self) -> Array:
        """Scratch of one thread."""
        return aligned(self._scratch)

    def substructure_work(self) -> Substructures | None:
        """The condensed beams with work arrays of one run."""
        if self.substructures is None:
            return None
        return place_stores(self.substructures, len(self.size))

    def work(self, keep: bool = True, rates: bool = False) -> Work:
        """Work arrays of one run; keep: with room for the state before a step; rates: for a method with rates of its own
        (generalised alpha)."""
        n, s, size = self.n_nodes, self.n_sliders, len(self.size)
        kept = int(keep)
        q = self.q0.size
        # what is not a beam takes the coordinates from these
        moved = q * (rates or self.sliders is not None or self.ties is not None or self.bodies is not None or bool(self.links))
        border = self.border * self.n_constraints
        # what only a dense border needs
        dense = 0 if self.by_rows or self.carriers is not None else border
        panel = 0 if self.by_rows else size * self.panel_rows * self.width
        theta = _padded((size - self.dim) * n)
        return Work(dphi=_padded(self.dim * n), theta=theta, q_mid=np.zeros(moved), q_end=np.zeros(moved),
                    u=np.zeros(q * (rates or self.bodies is not None)), s_end=np.zeros(s), f_ext=np.zeros(8 * (n + 1)),
                    r=np.zeros(8 * (n + 1)),
                    blocks=aligned(8 * size * (self.n_blocks + 1)), pivots=np.zeros(size * self.pattern.n, np.int64),
                    panel=aligned(panel), rows=aligned((dense + 1) * self.width),
                    schur=np.zeros((dense, dense)), y=np.zeros(border),
                    scratch=self.scratch(), keep_q=np.zeros(kept * q), keep_v=np.zeros(kept * q), keep_s=np.zeros(kept * s),
                    keep_force=np.zeros(kept * self.forces.sum()), keep_dphi=np.zeros(kept * self.dim * n),
                    keep_theta=np.zeros(kept * theta.size),
                    past=np.zeros(self.past_size),
                    keep_past=np.zeros(kept * self.past_size),
                    line=Line(np.array([0.0, self.softest, -1.0]), theta, np.zeros(8 * (n + 1)),
                              NoTies() if self.ties is None else _padded(self.dim * n)))

    @property
    def by_rows(self) -> bool:
        """Whether sliders are rows of the block matrix (theory.md 9) and not a dense border."""
        return self.n_constraints > 0 and self.pattern.plan is not None and self.substructures is None

    @property
    def entries(self) -> int:
        """Entries that a constraint may have: those of every node of a slider's beam and its point, or of both ends of a joint;
        fewer at first where constraints are rows, and room for more is made when one has them."""
        # each as often as a tied node passes it on
        widest = 1 if self.ties is None else int(np.max(np.diff(self.ties.start)))
        ends = 2 * widest if self.kept else 0
        if self.curves is None:
            return ends
        most = int(self.curves.shape[:, 2].max())
        if self.by_rows:
            most = min(most, int(self.curves.count.max()))
            return max(ends, most + 1 + (widest > 1) * (most + 4 * widest))
        # and the spin of every node
        return max(ends, (most + 1) * widest + most)

    @property
    def entries_of_an_element(self) -> int:
        """Entries more of a slider that passes from one element to the next in a step, 2 where nothing is known."""
        first = np.zeros(0, np.int64) if self.curves is None else self.curves.first
        return max(2, int(np.max(np.diff(first), initial=0)))

    def contact(self, entries: int | None = None) -> Contact | None:
        """Work arrays of the constraints, with room for so many entries (default: `entries`)."""
        n, row = self.n_constraints, 8 * len(self.size)
        if not n:
            return None
        shape = np.zeros((1, 3), np.int64) if self.curves is None else self.curves.shape
        entries = entries or (0 if self.carriers is not None else self.entries)
        first = np.cumsum(self.unknowns) - self.unknowns if self.by_rows else self.border * np.arange(n)
        kind = ContactInRows if self.by_rows else Contact if self.carriers is None else ContactOfCarriers
        return kind(basis=np.zeros((5, shape[:, 2].max())), legendre=np.zeros((3, shape[:, 1].max())),
                    entries=np.zeros(n, np.int64), row=np.zeros((n, entries), np.int64), column=np.zeros((n, row * entries)),
                    line=np.zeros((n, row * entries)), corner=np.zeros((n, 64)), residual=np.zeros((n, 8)),
                    element=np.zeros(n, np.int64), forces=self.forces, first=first,
                    first_force=np.cumsum(self.forces) - self.forces, compliance=np.zeros(n), remaining=np.zeros(n),
                    full=np.zeros(1, np.int64), augmented=np.zeros(4))

    def inner_work(self) -> Inner | None:
        """The eliminated nodes with work arrays of one run."""
        if self.inner is None:
            return None
        inner = self.inner
        rhs = np.zeros_like(inner.rhs) if isinstance(inner.rhs, np.ndarray) else inner.rhs
        return inner._replace(store=aligned(inner.store.size), rhs=rhs,
                              mark=np.zeros_like(inner.mark), found=np.zeros_like(inner.found), state=np.ones(1))

    def load_factors(self, times: Array, steps: Array) -> Array:
        """Mean factor of every load vector over steps [t, t + h], [n, K]: three Gauss points, so that impulses of smooth loads
        are exact to order 6 and a step stays symmetric."""
        x = 0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6)
        w = np.array([5.0, 8.0, 5.0]) / 18.0
        out = np.ones((len(times), len(self.load_times)))
        points = (np.asarray(times)[:, None] + x * np.asarray(steps)[:, None]).reshape(-1)
        for k, time in enumerate(self.load_times):
            if time is not None:
                values = np.array([factor_at(time, float(t)) for t in points]).reshape(-1, 3)
                # written out: a matrix product rounds a row differently in calls of different length
                out[:, k] = w[0] * values[:, 0] + w[1] * values[:, 1] + w[2] * values[:, 2]
        return out

    def __str__(self) -> str:
        return self.text


def check_model(who: str, model: Any) -> None:
    """Refuse what is not compiled.

    Raises
    ------
    SceneError
        Names the function that was called.
    """
    if not isinstance(model, Model):
        raise SceneError(f"{who}: needs a model, got {shown(model)}; compile it first: model = fb.compile_scene(scene)")


def factor_at(time: Callable[[float], float], t: float) -> float:
    """A time function at t as a number.

    Raises
    ------
    SceneError
        It returned something else, or nothing finite.
    """
    value = time(t)
    factor = real(value)
    if factor is None or not abs(factor) <= LARGEST:
        raise SceneError("time function of a load or of gravity: must return a finite number, got "
                         f"{shown(value)} at t = {t:.6g} s")
    return factor


def _padded(n: int) -> Array:
    """n zeros with room for a row of 8 behind the last, so that short rows may be read as long ones."""
    return np.zeros(n + 8)[:n]


def aligned(n: int) -> Array:
    """n zeros on a cache line."""
    raw = np.zeros(n + 8)
    shift = (-raw.ctypes.data // 8) % 8
    return raw[shift:shift + n]
