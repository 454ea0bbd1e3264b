"""A scene linearised about one of its equilibria (theory.md 11): stiffness and masses on its unknowns as sparse matrices."""
from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.nodes import Held
from fastbeam.kernels.state import State
from fastbeam.linalg.eigen import Pencil
from fastbeam.model.forces.damping_matrix import damping_map, material_map
from fastbeam.model.mapping import follow, turned
from fastbeam.model.maps import RowMap, mass_map
from fastbeam.model.model import Model
from fastbeam.model.rates import own_shape
from fastbeam.model.start import mended
from fastbeam.statics.equilibrium import without_potential
from fastbeam.statics.slider_friction import turned_with_sleeves, with_friction
from fastbeam.statics.steady_motion import Spin, SteadyForces, Travel
from fastbeam.stepping.assembled import Constraints, Equations, SaddleMatrix
from fastbeam.stepping.stepper import Stepper

if TYPE_CHECKING:
    from fastbeam.vibration.resting_sliders import RestingSliders

Array = np.ndarray
# skew part of the scaled stiffness that is no round-off
SKEW = 1e-8
# diagonal entries below this share of the largest one of their kind, forces or moments, are round-off: of the spin of a body that
# meets the moments of a sleeve alone
LEAST_DIAGONAL = 1e-8
# share of the kinetic energy that displacements across an axis have as round-off
NOT_ACROSS = 1e-9


class Linearisation:
    """Stiffness and masses of a model about a state.

    state: None: the reference.
    sliding: bool [S], sliders that are free to slide.
    factors: float64 [K], factors of the loads.
    flat: motions in the plane of the scene alone.
    moved: int64 [N], bits of unknowns of nodes that supports hold and that move here, 7 for positions, 56 for spins.
    steady: (str, Spin or Travel), the function that was called, and the steady motion that it is in equilibrium in.
    resting: forces along beams on sliders, which then decide which sliders are free.
    free: int64 [k], numbers of the unknowns of rows that are free.
    lift: sparse [12 N, k], these unknowns -> rates of all coordinates.
    mass: sparse [k, k].
    """

    def __init__(self, model: Model, state: State | None, sliding: Array, factors: Array, flat: bool,
                 moved: Array | None = None, steady: tuple[str, Spin | Travel] | None = None,
                 resting: RestingSliders | None = None) -> None:
        assert model.uneliminated is not None
        self.model = model
        # spins that statics may hold are motions here
        self.own = own = _released(model.uneliminated(planar=flat), moved)
        self.stepper = Stepper(own, np.ones(1), state, backend="superlu", static=True)
        plane = self.stepper.plane
        if flat and plane is None:
            raise SceneError("planar=True: the state leaves the plane of the scene; leave planar out")
        self.core, self._sliding, self.factors, self.resting = self.stepper.core, sliding, factors, resting
        self.size = len(self.core.dofs)
        self.map, self.constraints = RowMap(own, None if plane is None else plane.axes), Constraints(self.stepper)
        motions = self.core.motions
        if motions is not None and motions.holds.rubs.size:
            self.constraints.loose = motions.holds.loose(self.stepper.core_state.history)
        self.free = np.flatnonzero(self.map.free)
        self.lift = self.map.rates(self.q).tocsc()[:, self.free]
        inertia = mass_map(own, self.q.reshape(-1))
        if own.added is not None:
            inertia = inertia + own.added.mass_map(self.q)
        # motion of nodes along their beams with the places of contacts
        state, self._ways = self.stepper.state, None
        if own.moving is not None:
            self._ways = own.moving.ways(state.q, state.s)
            inertia = inertia + own.moving.inertia(state.q, state.s)[:state.q.size, :state.q.size]
        self._inertia = inertia
        self.mass = (self.lift.T @ (inertia @ self.lift)).tocsr()
        self._shift_mass = self.lift.T @ inertia
        self.loads = np.zeros_like(self.stepper.work.f_ext)
        self.stepper.put_static_loads(factors, self.loads)
        self.steady = None
        if steady is not None:
            self.steady = SteadyForces(steady[0], own, steady[1], self.map, self.size)
        self._saddle = None
        if own.n_constraints:
            self._saddle = SaddleMatrix(self.core.pattern, self.size, self.core.n_sliders, self.core.n_forces)

    @property
    def sliding(self) -> Array:
        """Sliders that are free to slide, bool [S]."""
        return self._sliding if self.resting is None else self._sliding & self.resting.free

    @property
    def held_sliders(self) -> list[str]:
        """Names of sliders that stay where they are."""
        return [name for name, is_free in zip(self.model.names["sliders"], self.sliding) if not is_free]

    @property
    def q(self) -> Array:
        """Coordinates in space [N, 4, 3]."""
        return np.asarray(self.stepper.state.q).reshape(-1, 4, 3)

    def assembled(self) -> tuple[Pencil, Array]:
        """Return stiffness and masses, and the residual forces and gaps with the present contact forces."""
        from scipy import sparse
        stepper, core = self.stepper, self.core
        work, n = stepper.work, core.pattern.n
        work.f_ext[:] = self.loads
        equations = None
        if self._saddle is not None:
            equations = self.constraints.at()
            if core.sleeves is not None:
                equations = equations._replace(bent=turned_with_sleeves(self.map, {}, stepper.state))
            equations = equations if self.resting is None else self.resting.put(equations)
        if self.steady is not None:
            work.f_ext[:] += self.steady.loads(self.q)
        stepper.parts.start(0.0)
        stepper.assemble_anew()
        right = -work.r[:8 * n].reshape(n, 8)[:, :self.size].reshape(-1)[self.free]
        keep = self.free
        if self._saddle is None or equations is None:
            blocks = work.blocks[:8 * self.size * core.pattern.keys.size].reshape(-1, self.size, 8)
            matrix = 2.0 * stepper.linear.superlu.by_rows(blocks)
        else:
            matrix = self._saddle.of(work.blocks, equations, self.sliding, 0.0)
            keep = np.concatenate((self.free, np.arange(self._saddle.nodes, self._saddle.n)))
            slope = np.where(self.sliding, -equations.sliding, 0.0)
            right = np.concatenate((right, slope, equations.gaps))
        if self.steady is not None:
            more = self.steady.stiffness(self.q)
            more.resize(matrix.shape)
            matrix = matrix + more
        matrix = matrix[keep][:, keep]
        multiplier = np.arange(keep.size) >= self.free.size + core.n_sliders
        transposed = matrix.T.tocsr()
        skew = (matrix - transposed).tocoo()
        size = self._sizes(matrix, keep, ~multiplier)
        scaled = np.abs(skew.data) / np.maximum(size[skew.row] * size[skew.col], 1e-300)
        within = (size[skew.row] > 0.0) & (size[skew.col] > 0.0)
        symmetric = not np.any(scaled[within] > SKEW)
        if symmetric:
            matrix = 0.5 * (matrix + transposed)
        return Pencil(matrix, self.mass, multiplier, symmetric, self._idle_spins(matrix, keep, sparse), self._turns(keep)), right

    def _sizes(self, matrix: Any, keep: Array, moves: Array) -> Array:
        """Return sizes of unknowns by which entries of a stiffness are scaled: roots of the diagonal, and where loads have no
        potential by the largest entry off the diagonal, as of a mass without stiffness that a force follows; 0 where there is
        none. keep: places of its rows; moves: bool [n], those that are no multipliers."""
        from scipy import sparse
        size = np.sqrt(self._diagonal(matrix, keep))
        if not any(without_potential(self.own)):
            return size
        unit = sparse.diags(np.where(self._turns(keep), 1.0, self.core.length) * moves)
        entries = abs(unit @ matrix @ unit)
        entries = entries.maximum(entries.T).tocsr()
        # round-off is no entry
        entries.data[entries.data <= SKEW * np.max(entries.data, initial=0.0)] = 0.0
        own = size * unit.diagonal()
        scaled = entries @ sparse.diags(np.where(own > 0.0, 1.0 / np.where(own > 0.0, own, 1.0), 0.0))
        found, largest = (np.asarray(x.max(axis=1).todense()).reshape(-1) for x in (scaled, entries))
        others = np.where(found > 0.0, found, np.sqrt(largest)) / np.where(self._turns(keep), 1.0, self.core.length)
        return np.where(size > 0.0, size, others)

    def _turns(self, keep: Array) -> Array:
        """Return which of these unknowns are rotations, bool."""
        return (keep < self.size * self.core.pattern.n) & (keep % self.size >= self.core.dim)

    def _diagonal(self, matrix: Any, keep: Array) -> Array:
        """Return the sizes of the diagonal entries of a stiffness, by which its entries are scaled; keep: places of its rows."""
        found = np.abs(matrix.diagonal())
        turns = self._turns(keep)
        least = [LEAST_DIAGONAL * np.max(found, where=kind, initial=0.0) for kind in (~turns, turns)]
        return np.where(found > 0.0, np.maximum(found, np.where(turns, least[1], least[0])), 0.0)

    def _idle_spins(self, matrix: Any, keep: Array, sparse: Any) -> Any:
        """Return spins of beams of nets about their axes where that changes no stress, sparse [k, j]; keep: places of the
        rows."""
        k = self.free.size
        none = sparse.csr_matrix((k, 0))
        base, static = self.model, self.model.static_held
        if static is None or static is base.held or self.size != 6:
            return none
        more = np.zeros(base.n_nodes, np.int64)
        more[static.row] = static.mask
        if base.held is not None:
            more[base.held.row] &= ~base.held.mask
        # by rows of the model in hand, whose numbers are other ones
        nodes = np.flatnonzero(more[base.pattern.row_of])
        at = np.full(self.core.pattern.n * self.size, -1)
        at[self.free] = np.arange(k)
        rows, columns, values = [], [], []
        axis = self.q[:, 1]
        count = 0
        for net in self.model.names.get("nets", []):
            starts = net["first"] + np.append(net["starts"], net["count"])
            for a in np.flatnonzero(np.isin(starts[:-1], nodes)):
                own = np.arange(starts[a], starts[a + 1])
                where = at[6 * self.core.pattern.row_of[own][:, None] + 3 + np.arange(3)]
                rows.append(where.reshape(-1))
                columns.append(np.full(where.size, count))
                values.append(axis[own].reshape(-1))
                count += 1
        if not count or min(map(np.min, rows)) < 0:
            return none
        still = sparse.csc_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(k, count))
        left = (matrix[:k, :k] @ still).tocoo()
        size = np.sqrt(self._diagonal(matrix, keep))[:k]
        weights = np.asarray((self.mass @ still).multiply(still).sum(axis=0))
        turns = size[self._turns(self.free)]
        if np.any(np.abs(left.data) > 1e-9 * size[left.row] * np.max(turns, initial=0.0)) or not np.all(weights > 0.0):
            return none
        return still.tocsr()

    def add_forces(self, change: Array) -> None:
        """Add to the contact forces [F]."""
        self.stepper.core_state.force[:] += change

    def damping(self) -> Any:
        """Return the damping matrix, sparse [k, k]. Raises SceneError: nothing is at rest in moving air."""
        of_nodes = self._on_unknowns(damping_map(self.own, self.q, *self.stepper.law_work[:2].tolist()))
        return of_nodes if self.resting is None else (of_nodes + self._damping_along(self.resting)).tocsr()

    def _damping_along(self, resting: RestingSliders) -> Any:
        """Return the damping matrix of sliders along their beams, sparse [k, k]: the gaps stay closed, so that ds/dt = c' . B
        dx/dt / c'^2."""
        from scipy import sparse
        found = self._pressed()
        s, d = found.along.shape
        of = np.repeat(np.arange(s), d), np.arange(s * d)
        share = found.along / np.sum(found.along**2, axis=1)[:, None]
        gradient = found.gradient.matrix(found.gaps.size, self.map.free.size)[:s * d][:, self.free]
        rates = sparse.csr_matrix((share.reshape(-1), of), shape=(s, s * d)) @ gradient
        return rates.T @ sparse.diags(resting.damping(found)) @ rates

    def _pressed(self) -> Equations:
        """Return the equations of the sliders without forces along beams, with their normal forces."""
        return with_friction(self.constraints, self.constraints.at(), np.zeros(self._sliding.size))

    def frees(self, who: str) -> bool:
        """Return whether a slider turns out to be free, once contact forces are those of the equilibrium; who: the function that
        was called.

        Raises SceneError: friction or a stop does not hold one that it is to hold.
        """
        return self.resting is not None and self.resting.judge(who, self._pressed(), self.load_size)

    def coriolis(self) -> Any:
        """Return forces of the steady motion against velocities, sparse [k, k], skew."""
        assert self.steady is not None
        return self._on_unknowns(self.steady.field.coriolis)

    def material(self) -> Any:
        """Return the stiffness of the material of beams alone, sparse [k, k]."""
        found = material_map(self.own, self.q)
        if self.own.moving is not None:
            found = found + self.own.moving.material(self.q, self.stepper.state.s)
        return self._on_unknowns(found)

    @property
    def load_size(self) -> float:
        """Size of all loads and forces of inertia, N; moments count as forces at the size of the scene."""
        n = self.core.pattern.n
        arm = np.where(np.arange(self.size) < self.core.dim, 1.0, self.core.length)
        parts = [self.loads] + ([] if self.steady is None else [self.steady.loads(self.q)])
        return sum(float(np.linalg.norm(x[:8 * n].reshape(n, 8)[:, :self.size] / arm)) for x in parts)

    def _on_unknowns(self, matrix: Any) -> Any:
        return (self.lift.T @ (matrix @ self.lift)).tocsr()

    def on_rows(self, of_nodes: Array) -> Array:
        """Convert forces and moments on nodes [N, 6] to forces on the unknowns [k]."""
        # what ties hand on from positions and directors; moments of followers act on the spin that they share
        rates = np.zeros((len(of_nodes), 4, 3))
        rates[:, 0] = of_nodes[:, :3]
        # sum d_i x f_i is the moment m with f_i = 1/2 m x d_i
        rates[:, 1:] = 0.5 * np.cross(of_nodes[:, None, 3:], self.q[:, 1:])
        return np.asarray(self.lift.T @ rates.reshape(-1))

    # --- shapes ---------------------------------------------------------------------------------------------------------
    def spread(self, vectors: Array) -> tuple[Array, Array]:
        """Convert unknowns [k, m] to displacements and spins of all nodes [m, N, 3] each."""
        rates = (self.lift @ vectors).T.reshape(vectors.shape[1], len(self.q), 4, 3)
        d, spins = self.q[:, 1:], np.empty((len(rates), len(self.q), 3), rates.dtype)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            # in a tenth of the time of np.cross
            spins[:, :, i] = 0.5 * (np.einsum("na,mna->mn", d[:, :, j], rates[:, :, 1:, k])
                                    - np.einsum("na,mna->mn", d[:, :, k], rates[:, :, 1:, j]))
        return rates[:, :, 0].copy(), spins

    def own_shape(self) -> tuple[Array, Array]:
        """Return positions [N, 3] and directors [N, 3, 3] of the rows of results."""
        q = own_shape(self.model, self.stepper.state)[0]
        return q[:, 0].copy(), q[:, 1:].copy()

    def own_rows(self, displacements: Array, spins: Array) -> tuple[Array, Array]:
        """Convert displacements and spins of all nodes [m, N, 3] to those of the rows of results: on moving meshes of material
        points."""
        moving, state = self.model.moving, self.stepper.state
        return (displacements, spins) if moving is None else moving.own_motion(self.q, state.s, displacements, spins)

    def base_motion(self) -> Array:
        """Return products of the masses with unit motions of everything along x, y, z [k, 3], and the mass itself, kg."""
        unit = np.zeros((len(self.q), 4, 3, 3))
        unit[:, 0] = np.eye(3)
        return np.asarray(self._shift_mass @ unit.reshape(-1, 3))

    def moved(self, displacement: Array, spin: Array, slide: Array, velocity: Array, turning: Array) -> State:
        """Return the equilibrium with its nodes moved [N, 3], triads turned by spins [N, 3] and sliders along their beams [S],
        and with velocities and spins [N, 3]; joints and sliders are closed, which they are to first order."""
        start = self.stepper.state
        q = self.q.copy()
        if self._ways is not None:
            displacement, spin = (x + y for x, y in zip((displacement, spin), np.split(
                (self._ways @ slide[self.model.moving.sliders]).reshape(-1, 6), 2, axis=1)))
        q[:, 0] += displacement
        q[:, 1:] = turned(q[:, 1:], spin)
        q = follow(self.model, q)
        v = np.zeros_like(q)
        v[:, 0] = velocity
        v[:, 1:] = np.cross(turning[:, None, :], q[:, 1:])
        fresh = self.model.state()
        self.model.keep_turns(fresh.history, start.history)
        if self.model.moving is not None:
            rates = follow(self.model, v).reshape(-1)
            v, rates = self.model.moving.with_mesh(self.model, q.reshape(-1), start.s + slide, rates)
            v = v.reshape(-1, 4, 3)
            self.model.moving.put_places(fresh.history, rates)
        if self.resting is not None:
            self.resting.remember(fresh.history)
        state = State(q.reshape(-1), follow(self.model, v).reshape(-1), start.s + slide, start.force.copy(), fresh.history)
        return mended(self.model, state)

    def in_motion(self, displacement: Array, velocity: Array, turning: Array) -> tuple[Array, Array]:
        """Convert velocities and spins [N, 3] in the frame of the steady motion to space, of nodes moved by so much.

        Raises SceneError: beams travel.
        """
        assert self.steady is not None
        motion = self.steady.motion
        if not isinstance(motion, Spin):
            raise SceneError(f"state: in {motion!r} nodes are fixed while material moves through them, and no run can begin like "
                             "this; compute the motion of the mode from its rate")
        turn = motion.rate * motion.axis
        return velocity + np.cross(turn, self.q[:, 0] + displacement - motion.point), turning + turn

    def circling(self, vectors: Array) -> Array:
        """Return how complex motions [k, m] circle about the axis of a spin in its frame: kinetic energy of displacements that
        circle about it less that of those that circle the other way, as a share of those across the axis [m]; of spins where
        these are all; NaN where nothing moves across."""
        assert self.steady is not None
        motion = self.steady.motion
        assert isinstance(motion, Spin)
        one = np.cross(motion.axis, np.eye(3)[np.argmin(np.abs(motion.axis))])
        one /= np.linalg.norm(one)
        two = np.cross(motion.axis, one)
        out = []
        for x in vectors.T:
            rates = (self.lift @ x).reshape(-1, 4, 3)
            product = (self._inertia @ rates.reshape(-1)).reshape(-1, 4, 3)[:, 0]
            moves = rates[:, 0]
            along = np.sum((moves @ motion.axis).conj() * (product @ motion.axis))
            across = float(np.real(np.sum(moves.conj() * product) - along))
            if across <= NOT_ACROSS * float(np.real(np.vdot(rates, self._inertia @ rates.reshape(-1)))):
                moves = product = 0.5 * np.cross(self.q[:, 1:], rates[:, 1:]).sum(axis=1)
                across = float(np.linalg.norm(moves @ one)**2 + np.linalg.norm(moves @ two)**2)
                across *= across > NOT_ACROSS * float(np.linalg.norm(moves))**2
            # twice the imaginary part of conj(b) a, b ahead of a by a quarter of a turn
            turning = 2.0 * float(np.imag(np.sum((moves @ two).conj() * (product @ one))))
            out.append(turning / across if across > 0.0 else np.nan)
        return np.array(out)

    # --- what is said about a state ---------------------------------------------------------------------------------------
    def sizes(self, change: Array) -> Array:
        """Return the sizes of changes of the unknowns [k], in sizes of the scene and rad."""
        return np.abs(change) / np.where(self.free % self.size < self.core.dim, self.core.length, 1.0)

    def label(self, unknown: int) -> tuple[str, str]:
        """Return the node of an unknown, and the unit of its force."""
        row, component = divmod(int(self.free[unknown]), self.size)
        node = int(np.flatnonzero(self.core.pattern.row_of == row)[0])
        return self.model.labels[node], "N" if component < self.core.dim else "N m"

    def force_size(self, forces: Array) -> float:
        """Return the size of forces and moments on the unknowns [k], N; moments count as forces at the size of the scene."""
        return float(np.linalg.norm(forces / np.where(self._turns(self.free), self.core.length, 1.0)))

    def round_off(self, pencil: Pencil) -> float:
        """Return the force, N, that round-off of coordinates makes of the stiffness; moments count as forces at the size of the
        scene."""
        forces = np.abs(pencil.stiffness.diagonal()[:self.free.size])
        return 1e-13 * float(np.max(np.where(self._turns(self.free), forces / self.core.length, forces * self.core.length),
                                    initial=0.0))


def _released(model: Model, moved: Array | None) -> Model:
    """Return the model without the spins that statics fixes, and with these unknowns of nodes free."""
    plane = model.plane
    if plane is not None:
        plane = replace(plane, model=replace(plane.model, static_held=_without(plane.model, moved)))
    return replace(model, static_held=_without(model, moved), plane=plane)


def _without(model: Model, moved: Array | None) -> Held | None:
    """Return the table of fixed unknowns without these unknowns of nodes."""
    held = model.held
    if moved is None or held is None:
        return held
    bits = moved if model.dim == 3 else np.where(moved & 7 != 0, 3, 0) | np.where(moved & 56 != 0, 4, 0)
    off = np.zeros(model.n_nodes, np.int64)
    np.bitwise_or.at(off, model.pattern.row_of, bits)
    mask = held.mask & ~off[held.row]
    of_row = np.zeros(model.n_nodes, np.int64)
    of_row[held.row] = mask
    return held._replace(mask=mask, row_mask=of_row[model.pattern.rows[held.block]],
                         column_mask=of_row[model.pattern.columns[held.block]])
