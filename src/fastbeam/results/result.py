"""Results of a run: rows over time, snapshots of the shape, events, and the invariants read from them.

`ResultHeader` says which series a run records. `ResultBuffer` (memory) and `hdf5_writer.ResultWriter` (file) take the same calls
`append`, `snapshot`, `event`, `close`; `Result` is what the user reads.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import (
    LONGEST_RANGE,
    Anything,
    FilePath,
    Flag,
    Refusal,
    Word,
    checked,
    hides_others,
    is_masked,
    shown,
)
from fastbeam.interface.errors import SceneError
from fastbeam.interface.result_warnings import Doubts
from fastbeam.interface.synonyms import known
from fastbeam.results.exchanged import AT_START, balance_of, joint_of, power_of
from fastbeam.results.exports import Exports
from fastbeam.results.readings import ALONG, COLUMNS, HINTS, PLACES, ROWS, TWISTING, Readings
from fastbeam.results.rows import RowBuffer, Rows

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fastbeam.kernels.state import State
    from fastbeam.model.model import Model

# text where a result has none
NOTHING = "nothing (none recorded)"
# dict first: it is recognised without a look at abstract classes
MAPPING = dict, Mapping
# series that hold whole numbers; everything else is float64
INTEGER_SERIES = ("iterations",)
# rows of Result.table: series, label, unit
INVARIANTS = (("kinetic", "kinetic energy", "J"), ("potential", "potential energy", "J"), ("total", "total energy", "J"),
              ("balance", "energy balance", "J"),
              ("lin_mom", "linear momentum", "kg m/s"), ("ang_mom", "angular momentum", "kg m^2/s"),
              ("gap", "gap of sliders", "m"))


@dataclass
class ResultHeader:
    """Facts that are known before the first step: the model, the names, and the shape of one row of every series."""

    model_text: str = ""  # the printed model
    # JSON-able facts: scene, method, order, step, versions, ... Optional keys that have a meaning here: 'scale' {series:
    # characteristic size} for `Result.drift`; 'conserved' [series] for tables and pictures
    info: dict[str, Any] = field(default_factory=dict)
    names: dict[str, list[Any]] = field(default_factory=dict)  # see `Result`
    n_nodes: int = 0  # nodes N in the global list (snapshots hold [N, 3] and [N, 3, 3])
    # name -> shape of ONE row: () for an energy, (3,) for a momentum, (n_sliders, 3) for contact forces
    series: dict[str, tuple[int, ...]] = field(default_factory=dict)
    integer: tuple[str, ...] = INTEGER_SERIES  # series that hold whole numbers
    # velocities, spins: whether snapshots hold velocities and spins of the nodes [N, 3], too
    velocities: bool = False
    spins: bool = False
    mesh: int = 0  # nodes of elements that move, whose coordinates snapshots hold besides, [mesh, 4, 3]

    def row_tables(self) -> tuple[dict[str, tuple[int, ...]], dict[str, type]]:
        """Return row shapes and types of the time series, 't' first."""
        shapes = {"t": (), **{name: tuple(int(k) for k in shape) for name, shape in self.series.items()}}
        return shapes, {name: np.int64 if name in self.integer else np.float64 for name in shapes}

    def snapshot_tables(self) -> dict[str, tuple[int, ...]]:
        """Return row shapes of the snapshots: t_snap (), phi (N, 3), directors (N, 3, 3), and velocities, spins (N, 3) and mesh
        (M, 4, 3) where they are kept."""
        recorded = {"velocities": self.velocities, "spins": self.spins}
        moving = {name: (self.n_nodes, 3) for name, there in recorded.items() if there}
        moving |= {"mesh": (self.mesh, 4, 3)} if self.mesh else {}
        return {"t_snap": (), "phi": (self.n_nodes, 3), "directors": (self.n_nodes, 3, 3), **moving}


class ResultBuffer:
    """Buffer of a run in memory; takes the same calls as `hdf5_writer.ResultWriter`.

    header: fixes the names and shapes of all series.
    snapshots: shapes that there is memory for at first.
    """

    def __init__(self, header: ResultHeader, snapshots: int = 8) -> None:
        self.header = header
        self._rows = RowBuffer(*header.row_tables())
        self._snapshots = RowBuffer(header.snapshot_tables(), capacity=snapshots)
        self._events: list[dict[str, Any]] = []

    def append(self, rows: Rows, t: Any) -> None:
        """Add one row (t a number, s) or a block (t [m], arrays with first axis m) of all series of the header."""
        times = np.asarray(t, dtype=np.float64)
        self._rows.append({"t": times, **rows}, None if times.ndim == 0 else len(times))

    def snapshot(self, t: float, phi: np.ndarray, d: np.ndarray, v: np.ndarray | None = None,
                 w: np.ndarray | None = None, mesh: np.ndarray | None = None) -> None:
        """Keep a copy of the shape at time t (s): phi [N, 3] (m), d [N, 3, 3] (rows d1, d2, d3), v (m/s) and w (rad/s) [N, 3],
        mesh [M, 4, 3] where the header says so."""
        self._snapshots.append(shape_row(self.header, t, phi, d, v, w, mesh))

    def event(self, event: dict[str, Any]) -> None:
        """Keep an event {'kind', 'time', 'text', ...} (JSON-able)."""
        self._events.append(dict(event))

    def result(self, info: Mapping[str, Any] | None = None) -> Result:
        """Return the result so far (also for an aborted run); `info` is added to the header's."""
        series = self._rows.views()
        return Result(model_text=self.header.model_text, info={**self.header.info, **(info or {})}, names=self.header.names,
                      t=series.pop("t"), series=series, events=list(self._events), **self._snapshots.views())

    def close(self, info: Mapping[str, Any] | None = None) -> Result:
        """Return the finished result, as `result(info)`."""
        return self.result(info)


def as_series(value: Any) -> np.ndarray:
    """Numbers of any shape, not finite ones too; arrays are not copied."""
    if type(value) is np.ndarray and value.dtype.kind in "iufb":
        return value
    try:
        huge = isinstance(value, range) and len(value[:LONGEST_RANGE + 1]) > LONGEST_RANGE
        foreign = value is None or huge or isinstance(value, (bytearray, memoryview)) or is_masked(value)
        clean = None if foreign else np.asarray(value)
    except Exception:          # ragged lists, and what foreign objects raise
        clean = None
    others = isinstance(value, (list, tuple)) and clean is not None and clean.dtype.kind in "iuf" and hides_others(value)
    if clean is None or others or clean.dtype.kind not in "iufb":
        raise Refusal(f"must be numbers, got {shown(value)}")
    return clean


def _are_texts(items: Iterable[Any]) -> bool:
    return all(issubclass(kind, str) for kind in set(map(type, items)))


@dataclass(frozen=True)
class Table:
    """A mapping with texts as keys and values of one kind, as a new dict."""

    of: Any

    def __call__(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, MAPPING) or not _are_texts(value):
            raise Refusal(f"must map names to values, got {shown(value)}")
        out = {}
        for key, item in value.items():
            try:
                out[key] = self.of(item)
            except Refusal as refusal:
                raise Refusal(f"of {key!r:.60} {refusal}") from None
        return out


@dataclass(frozen=True)
class Items:
    """A list, tuple or other iterable, as a new list; all of one class where one is given."""

    of: type = object

    def __call__(self, value: Any) -> list[Any]:
        fits = isinstance(value, (list, Iterable)) and not isinstance(value, (str, bytes, type, range))
        fits = fits and not (isinstance(value, np.ndarray) and value.ndim == 0)
        items = list(value) if fits else []
        if not fits or self.of is not object and not all(isinstance(item, self.of) for item in items):
            raise Refusal(f"must be a list{f' of {self.of.__name__}' if self.of is not object else ''}, got {shown(value)}")
        return items


SERIES, NAMED = as_series, Word()


@checked(t=SERIES, series=Table(SERIES), model_text=Word(), info=Table(Anything()), names=Table(Items()), t_snap=SERIES,
         phi=SERIES, directors=SERIES, velocities=SERIES, spins=SERIES, mesh=SERIES, events=Items(dict))
class Result(Readings, Exports, Doubts):
    """A finished or aborted run.

    Parameters
    ----------
    model_text : str
        The printed model.
    info : dict
        JSON-able facts about the run (scene, method, step, solver, iterations, wall time, versions, ...).
    names : dict of lists
        'sliders', 'points', 'losses', 'works': names in the order of the series. 'beams': {'name', 'first', 'count',
        'element_ends'} with first node, number of nodes and element end nodes in the global list. 'nets': {'name', 'first',
        'count', 'starts', 'junctions'}, the last two of every beam and every node of the net, counted from 'first'. 'bodies' and
        'masses': {'name', 'node'}. 'ropes' of winches: {'name', 'nodes'}, from the drum to the load.
        'slider_nodes': node of each slider's point (optional).
    t : ndarray [n]
        Times of the rows, s.
    series : dict of ndarray
        'kinetic', 'potential', 'strain', 'gravity', 'total' [n] (J); 'lin_mom' (kg m/s), 'ang_mom' (kg m^2/s) [n, 3]; 'gap',
        's_slide' [n, n_sliders] (m); 'contact_force' [n, n_sliders, 3] (N; info['contact_force'] says which it is, NaN where no
        steps tell it); 'contact_moment' of sleeves [n, n_sliders, 3] (N m, on the holder); 'points', 'slider_position' [n, ...,
        3] (m); 'losses', 'works' [n, parts] (J), energies taken away and put in since the start;
        'iterations', 'step_size' [n]. Only what was recorded is present.
    t_snap, phi, directors : ndarray [m], [m, N, 3], [m, N, 3, 3]
        Shapes at selected times: positions (m) and triads (rows d1, d2, d3).
    velocities, spins : ndarray [m, N, 3], optional
        Rates of the nodes at these times, m/s and rad/s, from runs with `observe=("velocity", ...)`; else None.
    mesh : ndarray [m, M, 4, 3], optional
        Positions and directors of nodes that move along their beams, whose rows of phi, directors, velocities and spins are those
        of material points at the arc lengths `beam.node_s`; else None.
    events : list of dict
        {'kind', 'time', 'text', ...}.

    Raises
    ------
    SceneError
        An argument is of the wrong kind, a series does not have as many rows as t, or a snapshot array does not fit t_snap.

    Examples
    --------
    >>> import numpy as np
    >>> run = Result(t=np.array([0.0, 1.0]), series={"total": np.array([2.0, 2.0])})
    >>> run.drift("total")
    0.0
    """

    # moving meshes of the model, for `state_for`
    _moving: Any = None

    def __init__(self, *, t: ArrayLike, series: Mapping[str, ArrayLike] | None = None, model_text: str = "",
                 info: Mapping[str, object] | None = None, names: Mapping[str, Iterable[object]] | None = None,
                 t_snap: ArrayLike | None = None, phi: ArrayLike | None = None, directors: ArrayLike | None = None,
                 velocities: ArrayLike | None = None, spins: ArrayLike | None = None, mesh: ArrayLike | None = None,
                 events: Iterable[Mapping[str, object]] = ()) -> None:
        self.model_text = model_text
        self.info: dict[str, Any] = dict(info or {})
        self.names: dict[str, list[Any]] = {key: list(value) for key, value in (names or {}).items()}
        self.t = np.asarray(t, dtype=np.float64)
        self.series: dict[str, np.ndarray] = {name: np.asarray(value) for name, value in (series or {}).items()}
        self.t_snap = np.zeros(0) if t_snap is None else np.asarray(t_snap, dtype=np.float64)
        self.phi = np.zeros((0, 0, 3)) if phi is None else np.asarray(phi, dtype=np.float64)
        self.directors = np.zeros((*self.phi.shape, 3)) if directors is None else np.asarray(directors, dtype=np.float64)
        self.velocities, self.spins, self.mesh = (None if x is None else np.asarray(x, dtype=np.float64)
                                                  for x in (velocities, spins, mesh))
        self.events: list[dict[str, Any]] = [dict(event) for event in events]
        self._check_shapes()

    @checked(name=NAMED)
    def point(self, name: str) -> np.ndarray:
        """Return the path of an observed point [n, 3], m."""
        return self._series("points")[:, self._index("points", "point", name)]

    @checked(name=NAMED)
    def slider(self, name: str) -> dict[str, np.ndarray]:
        """Return the series of one slider: s [n] (m), force [n, 3] (N, on the slider; NaN where it is not known), gap [n] (m);
        position [n, 3] (m) where recorded; where there are sleeves, moment [n, 3] (N m, on the holder); where some have friction
        on beams that turn in them, twist, the angle by which the beam has turned about d_1 in the sleeve (rad), and twist_moment,
        that of friction on the beam about d_1 (N m), [n]."""
        k = self._index("sliders", "slider", name)
        out = {"s": self._series("s_slide")[:, k], "gap": self._series("gap")[:, k]}
        out["force"] = self._series("contact_force")[:, k]
        same = ((x, x) for x in (*ALONG, *TWISTING))
        for series, key in (("slider_position", "position"), ("contact_moment", "moment"), *same):
            if series in self.series:
                out[key] = self.series[series][:, k]
        return out

    @checked(name=NAMED)
    def joint(self, name: str) -> dict[str, np.ndarray]:
        """Return the series of the joint coordinates of a joint with axes, zero at t = 0, [n], two of a kind in columns: angle
        (rad) and spin (rad/s), distance (m) and speed (m/s), swing, swing_rate and twist; energy of its springs and stops, loss
        of its dampers, work of its motors or drives (J); where one is prescribed, has friction or rigid stops, its torque (N m),
        force (N) or cone_torque, friction_loss and stop_loss (J); drive, the torque or force of drives that push, and coupling,
        that of a thread or of gears, in columns where there are several.

        Raises
        ------
        SceneError
            There is no such joint, or it leaves nothing free.
        """
        self._index("joints", "joint", name)
        return joint_of(self, name)

    @checked()
    def balance(self) -> dict[str, np.ndarray]:
        """Return energies of all parts over time, [n] each, J: stored ('kinetic', 'strain', 'stops', 'gravity'), taken away
        ('friction of slider ...', 'damping of beam ...', 'damper of joint ...'), and with a minus put in ('drive of slider ...',
        'motor of joint ...', 'motion of ...', 'loads'); 'sum' is constant.

        Where loads change in time or are moments, 'loads' is their work and that of gravity since the start.

        Raises
        ------
        SceneError
            The run did not record energies.
        """
        self._series("kinetic")
        return balance_of(self)

    @checked(name=NAMED)
    def power(self, name: str) -> np.ndarray:
        """Return the rate of an entry of `balance()` over time [n], W: with its sign there, so that what a damper takes is
        positive and what a motor puts in negative. Rates are differences of the energies of neighbouring rows, of second order in
        their distance: record rows often enough (`every=1`).

        Raises
        ------
        SceneError
            The run did not record energies, has fewer than three rows, or there is no such entry.
        """
        self._series("kinetic")
        return power_of(self, name)

    @checked(name=NAMED)
    def deviation(self, name: str) -> np.ndarray:
        """Return the relative deviation of a series from its first row [n]: |x - x0| / scale.

        The scale is `info['scale'][name]` where the run stored one, else the largest |x| over time. A gap should vanish:
        its deviation is the largest |gap| of all sliders, in m unless info['scale'] holds a length for it.
        """
        x = np.asarray(self._series(name), dtype=np.float64)
        if len(x) == 0 or x.size == 0:
            return np.zeros(len(x))
        rows = x.reshape(len(x), -1)
        scale = (self.info.get("scale") or {}).get(name)
        if name == "gap":
            return np.abs(rows).max(axis=1) / (scale or 1.0)
        difference = np.linalg.norm(rows - rows[0], axis=1)
        scale = scale or np.linalg.norm(rows, axis=1).max()
        return difference / scale if scale != 0.0 else difference

    @checked(name=NAMED)
    def drift(self, name: str) -> float:
        """Return the largest relative deviation of a series from its start (see `deviation`); NaN where the series holds NaN."""
        return float(self.deviation(name).max(initial=0.0))

    @checked(name=NAMED)
    def is_conserved(self, name: str) -> bool:
        """Return whether the run expected this series to be constant: listed in info['conserved'], or no list was stored."""
        conserved = self.info.get("conserved")
        return name not in ("kinetic", "potential") and (conserved is None or name in conserved)

    @checked()
    def table(self) -> str:
        """Return a table of energies, momenta and gap: first value, last value, largest relative drift; where something
        dissipates or drives also of the parts of the balance (`balance()`); events that say where numbers are not to be
        trusted."""
        first, second = self._rows_of_table()
        lines = [f"{label:<28}{start:>16}{end:>16}{drift:>14}" for label, start, end, drift in first]
        if second:
            width = max(28, *(2 + len(label) for label, *_ in second))
            lines += ["", *(f"{label:<{width}}{start:>16}{end:>16}" for label, start, end, _ in second)]
        return "\n".join([*lines, *self._doubts()])

    def _rows_of_table(self) -> tuple[list[tuple[str, str, str, str]], list[tuple[str, str, str, str]]]:
        """Return the cells of the table: quantities, and parts of the balance where there are some, each below its header."""
        rows = [("quantity", "start", "end", "max drift")]
        for name, label, unit in INVARIANTS:
            x = self.series.get(name)
            if x is None or x.size == 0:
                continue
            flat = x.reshape(len(x), -1)
            # vectors and gaps show their size: the norm of a momentum, the largest gap of all sliders
            size = flat[:, 0] if x.ndim == 1 else np.abs(flat).max(axis=1) if name == "gap" else np.linalg.norm(flat, axis=1)
            label = f"{'|' + label + '|' if x.ndim > 1 else label} [{unit}]"
            drift = f"{self.drift(name):.2e}" if self.is_conserved(name) else "-"
            rows.append((label, f"{size[0]:.8e}", f"{size[-1]:.8e}", drift))
        exchanges = "balance" in self.series or AT_START in self.info
        parts = self.balance() if len(self.t) and exchanges and "kinetic" in self.series else {}
        own = [name for name in parts if name not in ("kinetic", "strain", "gravity", "sum")]
        below = [(f"{name} [J]", f"{parts[name][0]:.8e}", f"{parts[name][-1]:.8e}", "") for name in own]
        return rows, [("parts of the balance", "start", "end", ""), *below] if own else []

    @checked(model=Anything())
    def state_for(self, model: Model) -> State:
        """Return the state at the end of this run for another model: `simulate(model, start=run.state_for(model))`.

        Parts with the same name and the same nodes keep their positions, triads and velocities, sliders of the same name their
        place and, where they have as many locks, what these have done; supports that have let go stay so. Parts that only the
        other model has take those of its initial state, moved with what they are joined to or slide on; parts that it does not
        have are left out.

        Raises
        ------
        SceneError
            The result was read from a file, which holds no state; a part has other nodes than its namesake.
        """
        state = getattr(self, "state", None)
        if state is None:
            raise SceneError("state_for: this result has no state, because files do not contain it; use the result of the run "
                             "itself, or a checkpoint to continue in the same model")
        if isinstance(model, type) or not hasattr(model, "state_for") or not hasattr(model, "n_nodes"):
            raise SceneError(f"state_for: needs a compiled model, got {shown(model)}; model = fb.compile_scene(scene)")
        return model.state_for(self.names, state, self._moving)

    @checked(path=FilePath(), overwrite=Flag())
    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the result to an HDF5 file; `fastbeam.load_result(path)` gives it back.

        Raises
        ------
        BackendError
            h5py is missing.
        ResultFileError
            The file exists (and not `overwrite`), or its folder does not.
        """
        from fastbeam.results.hdf5_writer import save_result
        save_result(self, path, overwrite=overwrite)

    @checked()
    def header(self) -> ResultHeader:
        """Return the header that a run with these series would have started with."""
        return ResultHeader(model_text=self.model_text, info=self.info, names=self.names, n_nodes=self.phi.shape[1],
                            series={name: x.shape[1:] for name, x in self.series.items()},
                            integer=tuple(name for name, x in self.series.items() if x.dtype.kind in "iub"),
                            velocities=self.velocities is not None, spins=self.spins is not None,
                            mesh=0 if self.mesh is None else self.mesh.shape[1])

    def __repr__(self) -> str:
        span = f"t = {self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) else "no rows"
        name = f" of '{self.info['scene']}'" if self.info.get("scene") else ""
        head = (f"Result{name}: {len(self.t)} rows, {span}; {len(self.t_snap)} snapshots of {self.phi.shape[1]} nodes; "
                f"{len(self.events)} events; series {', '.join(sorted(self.series)) or 'none'}")
        return "\n".join([head, *self._doubts()])

    def _series(self, name: str) -> np.ndarray:
        if name not in self.series:
            hint = HINTS.get(name, "")
            raise SceneError(f"series '{name:.60}' was not recorded: choose from "
                             f"{known(sorted(self.series), name, NOTHING)}{hint and f'; {hint}'}")
        return self.series[name]

    def _index(self, kind: str, noun: str, name: str) -> int:
        names = self.names.get(kind, [])
        if name not in names:
            raise SceneError(f"{noun} '{name:.60}' is not in this result: choose from {known(sorted(names), name, NOTHING)}")
        k, columns = names.index(name), self._series(COLUMNS[kind]).shape[1]
        if k >= columns:
            raise SceneError(f"{noun} '{name:.60}' has no rows: the series of this result hold {columns} of {len(names)}")
        return k

    def _check_shapes(self) -> None:
        if self.t.ndim != 1 or self.t_snap.ndim != 1:
            raise SceneError(f"Result: t and t_snap must be lists of times, got shapes {self.t.shape} and {self.t_snap.shape}")
        n, m, shape = len(self.t), len(self.t_snap), self.phi.shape
        self._check_names(shape[1] if len(shape) == 3 and m else None)
        for name, x in self.series.items():
            row = ROWS.get(name)
            if row is not None and x.ndim and len(x) == n and (
                    x.ndim != 1 + len(row) or any(isinstance(k, int) and k != size for k, size in zip(row, x.shape[1:]))):
                raise SceneError(f"series '{name}': a row has shape {x.shape[1:]}, should have {row}")
            if x.ndim == 0 or len(x) != n:
                raise SceneError(f"series '{name}': shape {x.shape} does not have the {n} rows of t")
        if len(shape) != 3 or shape[0] != m or shape[2] != 3 or self.directors.shape != (*shape, 3):
            raise SceneError(f"snapshots: phi {shape} and directors {self.directors.shape} do not fit {m} times t_snap; "
                             f"expected ({m}, N, 3) and ({m}, N, 3, 3)")
        for name, x in (("velocities", self.velocities), ("spins", self.spins)):
            if x is not None and x.shape != shape:
                raise SceneError(f"snapshots: {name} {x.shape} do not fit positions {shape}")
        if self.mesh is not None and (self.mesh.ndim != 4 or self.mesh.shape[0] != m or self.mesh.shape[2:] != (4, 3)):
            raise SceneError(f"snapshots: mesh {self.mesh.shape} does not fit {m} times t_snap; expected ({m}, M, 4, 3)")

    def _check_names(self, n_nodes: int | None) -> None:
        """Refuse `names` whose nodes do not fit their number (None: no shapes are there)."""
        for kind in (*COLUMNS, "losses", "works"):
            if not _are_texts(self.names.get(kind, ())):
                raise SceneError(f"names: '{kind}' must hold texts, got {shown(self.names[kind])}")
        nodes = self.names.get("slider_nodes", [])
        if not all(_is_node(k, n_nodes) for k in nodes) or nodes and len(nodes) != len(self.names.get("sliders", [])):
            raise SceneError(f"names: 'slider_nodes' must hold a node number for every slider, got {shown(nodes)}")
        for rope in self.names.get("ropes", []):
            chain = rope.get("nodes") if isinstance(rope, MAPPING) else None
            if not isinstance(chain, list) or len(chain) < 2 or not all(_is_node(k, n_nodes) for k in chain):
                raise SceneError(f"names: an entry of 'ropes' must hold nodes, two at least, got {shown(rope)}")
        for kind, keys in PLACES.items():
            for entry in self.names.get(kind, []):
                fits = isinstance(entry, MAPPING) and all(_is_node(entry.get(key), None) for key in keys)
                if fits and n_nodes is not None:
                    fits = entry[keys[0]] + (entry[keys[1]] if len(keys) > 1 else 1) <= n_nodes
                if not fits:
                    raise SceneError(f"names: an entry of '{kind}' must hold {' and '.join(keys)} among the "
                                     f"{'nodes' if n_nodes is None else f'{n_nodes} nodes'}, got {shown(entry)}")
                inner = [*entry.get("starts", ()), *entry.get("junctions", ())]
                ends = entry.get("element_ends", ())
                first, count = entry.get("first", 0), entry.get("count", 0)
                if not (_are_nodes(inner, 0, count) and _are_nodes(ends, first, count)):
                    raise SceneError(f"names: an entry of '{kind}' names nodes that it does not have")


def shape_row(header: ResultHeader, t: float, phi: np.ndarray, d: np.ndarray, v: np.ndarray | None, w: np.ndarray | None,
              mesh: np.ndarray | None) -> Rows:
    """Return a shape as a row of the tables of snapshots."""
    return {"t_snap": t, "phi": phi, "directors": d, **({"velocities": v} if header.velocities else {}),
            **({"spins": w} if header.spins else {}), **({"mesh": mesh} if header.mesh else {})}


def _are_nodes(numbers: Any, first: int, count: int) -> bool:
    """Tell whether all of some numbers are those of `count` nodes from `first` on."""
    numbers = list(numbers)
    whole = all(issubclass(kind, (int, np.integer)) and kind is not bool for kind in set(map(type, numbers)))
    return whole and (not numbers or first <= min(numbers) and max(numbers) < first + count)


def _is_node(k: Any, n: int | None) -> bool:
    """Return whether k is the number of one of n nodes (None: of any number)."""
    return isinstance(k, (int, np.integer)) and not isinstance(k, bool) and 0 <= k and (n is None or k < n)
