"""Equations of constraints in statics, as sparse entries: the compiled rows of a step whose two ends are the present shape
(theory.md 5.1, 8), and the matrix of nodes, sliding coordinates and multipliers that they make.

    gap         g_k = phi_S - sum_A N_A(s_k) phi_A = 0, of joints and sleeves their conditions
    force       +F_k on the point, -N_A F_k on node A
    sliding     F_k . c'(s_k) = 0,   c' = sum_A N'_A phi_A

A step holds half the derivatives of its sliding equations, as it holds half the tangent of the nodes.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from operator import is_
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import ADDED, Calls, SystemRecord
from fastbeam.kernels.contact.moving_beam import MovingBeam
from fastbeam.kernels.contact.slider import NoSleeves, Sliding
from fastbeam.kernels.empty_arrays import aligned_empty
from fastbeam.kernels.joints.drives import JointDrives
from fastbeam.linalg.pattern import Pattern
from fastbeam.linalg.scaling import with_values
from fastbeam.model.gap_rows import is_constraint
from fastbeam.model.maps import free_of_rows

if TYPE_CHECKING:
    from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# entries of constraints that a structure keeps, next to those that there are
MOST_IDLE = 3


class Entries(NamedTuple):
    """Entries of a sparse matrix; several at one place are added."""

    row: Array      # int64 [*]
    column: Array   # int64 [*]
    value: Array    # float64 [*]

    def with_more(self, other: Entries) -> Entries:
        """Append other entries."""
        return Entries(*(np.concatenate(both) for both in zip(self, other)))

    def matrix(self, rows: int, columns: int) -> Any:
        """Put the entries into a sparse matrix by rows, [rows, columns]."""
        return sparse.csr_matrix((self.value, (self.row, self.column)), shape=(rows, columns))


NONE = np.zeros(0, np.int64)
NO_ENTRIES = Entries(NONE, NONE, np.zeros(0))


def entries_of_matrix(matrix: Any) -> Entries:
    """Read the entries of a sparse matrix."""
    found = matrix.tocoo()
    return Entries(found.row, found.col, found.data)


class Equations(NamedTuple):
    """Equations of constraints at one shape: S sliders, F multipliers, positions of d components, m unknowns of the nodes."""

    gap: Array         # float64 [S, d]: of sliders, m
    tangent: Array     # float64 [S, d]: c'(s), 0 of contacts on moving meshes
    sliding: Array     # float64 [S], N: F . c'
    bend: Array        # float64 [S], N/m: derivative of that by s
    gaps: Array        # float64 [F]: of all constraints, m and rad
    gradient: Entries  # [F, m]: derivative of the gaps by the unknowns of the nodes
    slide: Entries     # [S, m]: of the sliding equations
    turns: Entries     # [F, S]: minus the derivative of conditions of sleeves by s, rad/m
    idle: Array        # int64 [I]: multipliers that stay as they are
    loads: Array       # float64 [8 (rows + 1)]: forces and moments of the constraints on the rows
    bent: Entries = NO_ENTRIES      # [m, m]: stiffness that the blocks of the nodes do not have, N/m
    normal: Any = None              # float64 [S], N: F_n |c'|, normal force with the moments of sleeves
    size: Any = None                # float64 [S], N: of the contact forces
    rubbing: Entries = NO_ENTRIES   # [S, m]: of friction in the sliding equations, by the unknowns of the nodes
    by_force: Entries = NO_ENTRIES  # [S, F]: the same by the multipliers
    along: Any = None               # float64 [S, d]: `tangent`, and c'(s) of contacts on moving meshes
    neighbours: Entries = NO_ENTRIES    # [S, S]: of the sliding equations by the places of other sliders, N/m
    ways: Any = None                # sparse [m, S]: motion of nodes of moving meshes with the places; None without any


class MatrixOfBlocks:
    """Sparse matrix by rows, of blocks of nodes and other entries, whose structure changes now and then.

    pattern: blocks of the nodes.
    size: unknowns a node.
    more: unknowns behind those of the nodes.
    nodes, n: unknowns of the nodes, and of all.
    """

    def __init__(self, pattern: Pattern, size: int, more: int) -> None:
        self.nodes = size * pattern.n
        self.n = self.nodes + more
        rows, within = pattern.rows, np.arange(size)
        row, column = (size * x[:, None, None] for x in (rows, pattern.columns))
        keys = ((row + within[:, None]) * self.n + (column + within)).reshape(-1)
        at = (8 * size * np.arange(rows.size)[:, None, None] + 8 * within[:, None] + within).reshape(-1)
        order = keys.argsort()
        self._keys, self._blocks = keys[order], at[order]
        # other entries of the structure, row n + column, and where those last placed stand
        self._known = NONE
        self._at = np.zeros(0, np.int64)
        self._matrix: Any = None

    @property
    def structure(self) -> Array:
        """Other entries that the matrix has, one array as long as they are the same."""
        return self._known

    def _merge(self, keys: Array) -> None:
        """Form the structure with other entries at these keys, ascending."""
        at = self._keys.searchsorted(keys)
        new = (self._keys[np.minimum(at, self._keys.size - 1)] != keys).nonzero()[0]
        before = np.bincount(at[new], minlength=self._keys.size + 1).cumsum()
        of_blocks = np.arange(self._keys.size) + before[:-1]
        self._position = at + before[at]
        self._position[new] = at[new] + np.arange(new.size)
        merged = np.empty(self._keys.size + new.size, np.int64)
        merged[of_blocks], merged[self._position[new]] = self._keys, keys[new]
        self._source = np.zeros(merged.size, np.int64)
        self._source[of_blocks] = self._blocks
        self._added = self._position[new]
        indptr = merged.searchsorted(self.n * np.arange(self.n + 1)).astype(np.int32)
        self._matrix = sparse.csr_matrix((np.zeros(merged.size), (merged % self.n).astype(np.int32), indptr),
                                         shape=(self.n, self.n))
        self._known = keys

    def forget(self) -> None:
        """Forget the structure."""
        self._known, self._matrix = NONE, None

    def place(self, row: Array, column: Array, more: Callable[[], Array] = lambda: NONE) -> None:
        """Find the places of entries at these rows and columns [*]; several may stand at one place.

        more: returns keys, row n + column, of entries that a new structure has besides.
        """
        keys = row.astype(np.int64) * self.n + column
        place = np.minimum(self._known.searchsorted(keys), max(self._known.size - 1, 0))
        if self._matrix is None or not (self._known.size and np.array_equal(self._known[place], keys)):
            # earlier entries stay for a while, because entries that vanish come back
            before = self._known if self._known.size <= MOST_IDLE * keys.size else NONE
            every = np.sort(np.concatenate((keys, more(), before)))
            self._merge(every[np.flatnonzero(np.diff(every, prepend=-1))])
            place = self._known.searchsorted(keys)
        self._at = self._position[place]

    def filled(self, blocks: Array, factor: float, value: Array) -> Any:
        """Return the matrix, sparse [n, n], of `factor` times the blocks and the entries that `place` has placed."""
        data = self._of_blocks(blocks, factor)
        np.add.at(data, self._at, value)
        return with_values(self._matrix, data)

    def _of_blocks(self, blocks: Array, factor: float) -> Array:
        """Return the entries of the structure with `factor` times the blocks."""
        data = blocks[self._source]
        data *= factor
        data[self._added] = 0.0
        return data


class Constraints:
    """Reader of the equations of the constraints of a stepper in statics.

    stepper: stepper in statics.
    loose: bool [R], true for coordinates of joints that are free though friction or rigid stops may hold them.
    angles: angles at which friction holds sections, by the number of their sleeve, rad.
    """

    def __init__(self, stepper: Stepper) -> None:
        self.stepper = stepper
        core, self._contact = stepper.core, stepper.contact
        self._terms = Calls(tuple(term for term in stepper.terms if is_constraint(term)), ADDED)
        # beams whose elements move with contacts, which push on the places of these
        self._moving = Calls(tuple(term for term in stepper.terms if isinstance(term, MovingBeam)), ADDED)
        self._free = free_of_rows(core, core.static_held) != 0.0
        self.loose: Array | None = None
        self.angles: dict[int, float] = {}
        self._given: Array | None = None
        self._drives = next((term for term in self._terms.terms if isinstance(term, JointDrives)), None)
        self._sleeves = next((term.sleeves for term in self._terms.terms if isinstance(term, Sliding)), NoSleeves())
        self._axes = self._keyed = np.zeros(0)
        if not isinstance(self._sleeves, NoSleeves):
            self._axes, self._keyed = self._sleeves.axes.copy(), self._sleeves.keyed.copy()
        self._neighbours = NONE
        if self._contact is not None:
            self._begin()

    def _begin(self) -> None:
        """Prepare data that are the same at all shapes."""
        core, contact = self.stepper.core, self._contact
        n = len(core.dofs)
        count, most = contact.row.shape
        self._line = contact.line.reshape(-1)
        self._of_force = np.arange(8) < contact.forces[:, None]
        # numbers of the multipliers of all constraints by the columns of their lines
        self._number = contact.first_force[:, None] + np.arange(8)
        self._entry = (most * np.arange(count)[:, None] + np.arange(most)) * 8 * n
        # entries of the last structure
        self._touched = b"", b""
        self._inside = np.zeros((count, most), bool)
        sleeves, self._neighbours = contact.pair[:len(core.sleeve_pairs)], np.arange(len(core.sleeve_pairs), len(contact.pair))
        one, other = contact.pair[self._neighbours].T
        self._of_neighbours = np.concatenate((one, other)), np.concatenate((other, one))
        forces = contact.forces[sleeves[:, 1]]
        o, p = (np.arange(8) < forces[:, None]).nonzero()
        self._turns = (contact.first_force[sleeves[o, 1]] + p, sleeves[o, 0]), (o, p)
        self._third = (forces > 2).nonzero()[0]
        self._no_turns = None if o.size else Entries(*self._turns[0], np.zeros(0))

    # --- what holds coordinates -----------------------------------------------------------------------------------------
    @property
    def given(self) -> Array | None:
        """Values of coordinates of joints that are prescribed, or that friction and rigid stops hold, in their order; None: they
        stay where they are."""
        return self._given

    @given.setter
    def given(self, values: Array | None) -> None:
        self._given = values
        if values is not None and self._drives is not None:
            self._drives.given[:] = values[self.stepper.core.motions.holds.left_of_held()]

    def _loose_forces(self) -> Array:
        """Number the multipliers of coordinates that are free."""
        if self.loose is None or self._drives is None or not self.loose.any():
            return NONE
        holds = self.stepper.core.motions.holds
        left = holds.left_of_held() - holds.given.size
        free = np.flatnonzero((left >= 0) & self.loose[np.maximum(left, 0)])
        return np.asarray(self._contact.first_force[self._drives.first[0] + free])

    def _idle_moments(self) -> Array:
        """Number the multipliers of twists that nothing holds."""
        contact, sleeves = self._contact, self._sleeves
        if not self._third.size:
            return NONE
        return np.asarray(contact.first_force[contact.pair[self._third[sleeves.keyed[self._third] == 0], 1]] + 2)

    def _aim(self) -> None:
        """Hold sections at `angles`."""
        self._sleeves.axes[:], self._sleeves.keyed[:] = self._axes, self._keyed
        for o, angle in self.angles.items():
            c, s = np.cos(angle), np.sin(angle)
            second, third = self._axes.reshape(-1, 3, 3)[o, 1:]
            self._sleeves.axes.reshape(-1, 3, 3)[o, 1:] = c * second - s * third, s * second + c * third
            self._sleeves.keyed[o] = 1

    # --- equations ------------------------------------------------------------------------------------------------------
    @cached_property
    def _table(self) -> tuple[Any, Any]:
        """Terms of the constraints, and what they share, as compiled code takes them."""
        return self._terms.on(self.stepper.records[1])

    @cached_property
    def _beams(self) -> tuple[Any, Any]:
        """Beams whose elements move, and what they share but for the equations of nodes, which are not touched."""
        work = self.stepper.work
        self._own_rows = np.zeros_like(work.r)
        own = work._replace(r=self._own_rows, blocks=aligned_empty(work.blocks.size))
        return self._moving.on(SystemRecord(self.stepper.system._replace(work=own), ADDED))

    def at(self, force: Array | None = None) -> Equations:
        """Evaluate the equations at the present shape; force: other forces of all constraints [F] than those of the state."""
        state, work, core, contact = self.stepper.core_state, self.stepper.work, self.stepper.core, self._contact
        if contact is None:
            return self._none()
        if self.angles:
            self._aim()
        work.q_mid[:] = work.q_end[:] = state.q
        if core.moving is not None:
            table = self._beams
            self._own_rows[:] = 0.0
            kernels.assemble_some(*table, 0.0)
        work.r[:] = 0.0
        before = None if force is None else state.force.copy()
        if force is not None:
            state.force[:] = force
        kernels.assemble_some(*self._table, 0.0)
        if before is not None:
            state.force[:] = before
        s, d = core.n_sliders, core.dim
        touched = contact.entries.tobytes(), contact.row[self._inside].tobytes()
        if touched != self._touched or np.logical_or.reduce(self._line[self._unused]):
            self._look()
        corner, residual = contact.corner[:s], contact.residual
        gaps = residual[self._of_force]
        gradient = Entries(self._gradient.row, self._gradient.column, self._line[self._gradient.value])
        slide = Entries(self._slide.row, self._slide.column, 2.0 * self._line[self._slide.value])
        if self._drives is not None and self._given is None:
            k = self._drives.first[0] + np.arange(self._drives.which.size)
            gaps[contact.first_force[k]] = 0.0
        idle = NONE
        if self.loose is not None or self._third.size:
            loose = self._loose_forces()
            idle = np.concatenate((loose, self._idle_moments()))
            gaps[idle] = 0.0
            if loose.size:
                gradient.value[np.isin(gradient.row, loose)] = 0.0
        (of, slider), at = self._turns
        turns = self._no_turns or Entries(of, slider, contact.cross[at[0], 0, at[1]])
        tangent = along = corner[:, 8 * d:9 * d].copy()
        if core.moving is not None:
            along = tangent.copy()
            along[core.moving.sliders] = self.stepper.own["moving"].tangent[:, :d]
        found = Equations(residual[:s, :d].copy(), tangent, residual[:s, d].copy(), 2.0 * corner[:, 9 * d],
                          gaps, gradient, slide, turns, idle, -work.r, along=along)
        return found if core.moving is None else self._by_material(found)

    @property
    def ways(self) -> Any:
        """Motion of the unknowns of nodes of moving meshes with the places of sliders at the present shape, sparse [m, S]."""
        core, state, plane = self.stepper.core, self.stepper.state, self.stepper.plane
        size = len(core.dofs)
        m = size * core.pattern.n
        ways = core.moving.ways(state.q, state.s)
        if plane is not None:
            in_plane = np.zeros((3, 6))
            in_plane[:2, :3], in_plane[2, 3:] = plane.axes[:2], plane.axes[2]
            ways = sparse.kron(sparse.identity(state.q.size // 12), in_plane) @ ways
        ways = ways.tocoo()
        node, component = np.divmod(ways.row, size)
        row = size * core.pattern.row_of[node] + component
        seen = row < m
        return sparse.csr_matrix((ways.data[seen], (row[seen], core.moving.sliders[ways.col[seen]])), shape=(m, core.n_sliders))

    def _by_material(self, found: Equations) -> Equations:
        """Return the equations of a scene with moving meshes whose sliding equations are those of displacements of the material:
        nodes follow the places. Those of the nodes themselves are round-off of the stiffness of beams along their axes."""
        core, work = self.stepper.core, self.stepper.work
        n, size, of = core.pattern.n, len(core.dofs), self.ways
        forces = (self._own_rows[:8 * n] + work.r[:8 * n]).reshape(n, 8)[:, :size].reshape(-1)
        return found._replace(neighbours=self._between_places(), ways=of, sliding=found.sliding + of.T @ forces)

    def _between_places(self) -> Entries:
        """Return the derivatives of sliding equations by the places of neighbours on moving meshes."""
        value = 2.0 * self._contact.cross[self._neighbours, :, self.stepper.core.dim].T
        return Entries(*self._of_neighbours, value.reshape(-1))

    def gaps_at(self, q: Array) -> Array:
        """Evaluate the gaps of all constraints at coordinates q [12 N] in space, [F]."""
        stepper = self.stepper
        own, residual = stepper.core_state.q, self._contact.residual.copy()
        before, there = own.copy(), stepper.state._replace(q=q)
        own[:] = there.q if stepper.plane is None else stepper.plane.reduce(there).q
        found = self.at().gaps
        own[:], self._contact.residual[:] = before, residual
        return found

    def _none(self) -> Equations:
        """Return the equations of a scene without constraints."""
        none = np.zeros((0, self.stepper.core.dim))
        return Equations(none, none, none[:, 0], none[:, 0], none[:, 0], NO_ENTRIES, NO_ENTRIES, NO_ENTRIES, NONE,
                         np.zeros_like(self.stepper.work.r), along=none)

    def _look(self) -> None:
        """Find which numbers of the lines are entries: those that are not zero, and others that become so as nodes move."""
        core, contact = self.stepper.core, self._contact
        n, d = len(core.dofs), core.dim
        assert not contact.full[0]
        self._inside = np.arange(contact.row.shape[1]) < contact.entries[:, None]
        row = contact.row[self._inside]
        self._touched = contact.entries.tobytes(), row.tobytes()
        k = self._inside.nonzero()[0]
        at = self._entry[self._inside][:, None, None] + 8 * np.arange(n)[:, None] + np.arange(8)
        line = self._line[at]
        force, is_slider = self._of_force[k], k < core.n_sliders
        used = (line != 0.0) & force[:, None]
        moves, turns = (np.logical_or.reduce(x, axis=(1, 2)) for x in (used[:, :d], used[:, d:]))
        # positions act on the same components of a gap; those of nodes whose shape function vanishes have slopes
        place = is_slider & (moves | ~turns)
        used[place, :d, :d] |= np.eye(d, dtype=bool)
        moves &= ~is_slider
        used[moves, :d] |= force[moves, None]
        used[turns, d:] |= force[turns, None]
        slide = is_slider[:, None] & ((line[:, :, d] != 0.0) | np.logical_or.reduce(used, axis=2))
        unknown = n * row[:, None] + np.arange(n)
        free = self._free[unknown]
        used &= free[:, :, None]
        slide &= free
        every = force[:, None] & free[:, :, None]
        every[:, :, d] |= is_slider[:, None] & free
        unused = every & ~used
        unused[:, :, d] &= ~slide
        self._unused = at[unused]
        of, i, j = used.nonzero()
        self._gradient = Entries(self._number[k[of], j], unknown[of, i], at[used])
        of, i = slide.nonzero()
        self._slide = Entries(k[of], unknown[of, i], at[:, :, d][slide])


class SaddleMatrix(MatrixOfBlocks):
    """Matrix by rows of nodes, sliding coordinates and multipliers, from blocks of nodes and entries of constraints.

    size: unknowns a node.
    sliders, forces: numbers of sliding coordinates and of multipliers.
    """

    def __init__(self, pattern: Pattern, size: int, sliders: int, forces: int) -> None:
        super().__init__(pattern, size, sliders + forces)
        self.sliders = sliders
        # rows and columns of the entries of constraints last put in
        self._last: tuple[Any, ...] = (None,) * 7
        self._idle = b""

    def of(self, blocks: Array, equations: Equations, sliding: Array, drag: float) -> Any:
        """Form the matrix, sparse [n, n], of blocks as assembled, which are half the static tangent.

        sliding: bool [S], sliders that are free; the others have an increment of zero.
        drag: stiffness against increments of sliding coordinates, N/m.
        """
        gradient, slide, turns, bent = equations.gradient, equations.slide, equations.turns, equations.bent
        rubbing, by_force, neighbours = equations.rubbing, equations.by_force, equations.neighbours
        places = gradient.row, slide.row, turns.row, bent.row, rubbing.row, by_force.row, neighbours.row
        idle = equations.idle.tobytes()
        if idle != self._idle or not all(map(is_, places, self._last)):
            self._find_places(equations, equations.tangent.shape[1])
            self._last, self._idle = places, idle
        data = self._of_blocks(blocks, 2.0)
        free = sliding.astype(float)
        push = slide.value * free[slide.row]
        tangent = (equations.tangent * free[:, None]).reshape(-1)
        turn = turns.value * free[turns.column]
        diagonal = equations.bend + drag
        diagonal[~sliding] = 1.0
        value = np.concatenate((bent.value, push, -gradient.value, push, diagonal, tangent, turn, -gradient.value, tangent, turn,
                                -np.ones(equations.idle.size) if equations.idle.size else NO_ENTRIES.value,
                                rubbing.value * free[rubbing.row], by_force.value * free[by_force.row],
                                neighbours.value * free[neighbours.row] * free[neighbours.column]))
        np.add.at(data, self._at, value)
        found = with_values(self._matrix, data)
        return found if equations.ways is None else self._by_material(found, equations.ways, free)

    def _by_material(self, matrix: Any, ways: Any, free: Array) -> Any:
        """Transform a matrix to displacements of the material: nodes of moving meshes are displaced with the places that are
        free, too."""
        of, n = (ways @ sparse.diags(free)).tocoo(), self.n
        by = sparse.eye(n, format="csr") + sparse.csr_matrix((of.data, (of.row, self.nodes + of.col)), shape=(n, n))
        return (by.T @ matrix @ by).tocsr()

    def _find_places(self, equations: Equations, dim: int) -> None:
        """Find the places of entries of constraints in the matrix, in the order of `of`."""
        m, s = self.nodes, self.sliders
        gradient, slide, turns, bent = equations.gradient, equations.slide, equations.turns, equations.bent
        rubbing, by_force, neighbours = equations.rubbing, equations.by_force, equations.neighbours
        diagonal = m + np.arange(s)
        of, component = m + np.arange(s).repeat(dim), m + s + np.arange(dim * s)
        idle = m + s + equations.idle
        row = np.concatenate((bent.row, slide.column, gradient.column, m + slide.row, diagonal, of, m + turns.column,
                              m + s + gradient.row, component, m + s + turns.row, idle, m + rubbing.row, m + by_force.row,
                              m + neighbours.row))
        column = np.concatenate((bent.column, m + slide.row, m + s + gradient.row, slide.column, diagonal, component,
                                 m + s + turns.row, gradient.column, of, m + turns.column, idle, rubbing.column,
                                 m + s + by_force.column, m + neighbours.column))
        self.place(row, column)
