"""Shapes of a result as a VTKHDF file: one HDF5 file with a time series that ParaView, PyVista and VTK read.

Layout: "VTKHDF format specification" of the VTK documentation, version 2.0 (VTK 9.3, ParaView 5.12 and newer), poly data that
change in time. Blocks of a collection would be tidier, but VTK 9.7 reads the first step of such a collection whatever time is
asked for. First come points for bodies, masses and sliders, then beams, as lines or as the skins of their sections. Connectivity
and what does not change in time are written once, and all steps refer to them.
"""
from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import shown
from fastbeam.interface.errors import ResultFileError, SceneError
from fastbeam.interface.paths import check_new, claim
from fastbeam.interface.synonyms import known
from fastbeam.results.hdf5_reader import import_h5py
from fastbeam.results.lines import Lines

if TYPE_CHECKING:
    from fastbeam.results.result import Result

Array = np.ndarray
SUFFIXES = (".vtkhdf", ".hdf")
# nodes up to which four points stand for one where nothing else is said
SMALL = 20_000
# bytes beyond the arrays that a file takes at most
OVERHEAD = 1 << 20
# numbers in point and cell data `kind`
KINDS = ("beam", "body", "mass", "slider")
# methods whose shapes follow each other along loads, not in time
NOT_IN_TIME = ("static", "path")
RESULTANTS = ("N", "Q2", "Q3", "T", "M2", "M3")


@dataclass
class _Shape:
    """Poly data: arrays that are constant and arrays that change in time."""

    n_points: int
    # 'Vertices', 'Lines', 'Polygons' -> corners of all cells one after the other, and where each begins
    cells: dict[str, tuple[Array, Array]]
    # constant, cell_data, dict of arrays [n_points, ...], [cells, ...]
    constant: dict[str, Array]
    cell_data: dict[str, Array]
    # name -> numbers of a point, and the values [n_points, ...] at snapshot k; 'Points' among them
    moving: dict[str, tuple[int, Callable[[int], Array]]]
    labels: dict[str, list[str]]  # names of the parts of every kind

    def size(self, steps: int, item: int) -> int:
        """Return the bytes of all arrays."""
        moving = sum(width for width, _ in self.moving.values()) * self.n_points * steps * item
        fixed = sum(x.nbytes for x in (*self.constant.values(), *self.cell_data.values()))
        return moving + fixed + sum(a.nbytes + b.nbytes for a, b in self.cells.values())


def write_vtk(result: Result, path: Path, *, overwrite: bool, surface: bool, refine: int | None, double: bool,
              sections: Any = None) -> None:
    """Write a VTKHDF file, see `Result.to_vtk`."""
    if path.suffix.lower() not in SUFFIXES:
        older = path.suffix.lower() in (".pvd", ".vtu", ".vtp", ".vtk")
        hint = "; .pvd and .vtu are older formats with a file for every time" if older else ""
        raise SceneError(f"to_vtk: path must end in .vtkhdf, got '{path.name}'{hint}")
    if not len(result.t_snap):
        raise SceneError("to_vtk: the result has no snapshots; record some with simulate(..., output=Output(snapshots=100))")
    h5py = import_h5py()
    shape = _shape(result, surface, refine, sections)
    if not shape.n_points:
        raise SceneError("to_vtk: the result has no beams, bodies or sliders to draw")
    dtype = np.float64 if double else np.float32
    where = Path(os.path.realpath(path))
    size = shape.size(len(result.t_snap), np.dtype(dtype).itemsize) + OVERHEAD
    part = where.with_name(f".{where.name}.{os.getpid()}.part")
    try:
        check_new("file", where, path, overwrite)
        free = shutil.disk_usage(where.parent).free
        if size > free:
            raise ResultFileError(f"file '{path}': needs {size / 1000000.0:.0f} MB, but only {free / 1000000.0:.0f} MB are free; "
                                  "choose another place, or leave out shapes or double=True")
        with part.open("wb") as raw:
            claim(raw.fileno(), 0, size)
        with h5py.File(part, "w", libver="latest") as file, part.open("rb+") as raw:
            claim(raw.fileno(), 0, size)
            _write(file, shape, result.t_snap, dtype, h5py)
        os.replace(part, where)
    except (OSError, RuntimeError) as error:
        raise ResultFileError(f"file '{path}': cannot be written ({error}); free disk space, or choose another path") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


# --- what is drawn ----------------------------------------------------------------------------------------------------------
def _shape(result: Result, surface: bool, refine: int | None, sections: Any) -> _Shape:
    n_nodes = result.phi.shape[1]
    lines = Lines(result.names, n_nodes, refine or (4 if n_nodes <= SMALL else 1))
    spots, kinds, parts, labels = _spots(result)
    n = len(spots)
    arms, corners = np.zeros((0, 2)), np.arange(lines.n_points)
    if surface:
        corners, arms, faces, rims = lines.surface()
        kind = "Polygons"
        connectivity = np.concatenate((faces.reshape(-1), *rims))
        ends = 4 * len(faces) + np.cumsum([len(rim) for rim in rims], dtype=np.int64)
        offsets = np.concatenate((4 * np.arange(len(faces) + 1), ends))
        of_cells = np.concatenate((lines.parts[lines.beam_of[corners[faces[:, 0]]]], np.repeat(lines.parts, 2)))
    else:
        kind, connectivity, offsets, of_cells = "Lines", corners, lines.starts, lines.parts
    cells = {"Vertices": (np.arange(n), np.arange(n + 1)), kind: (n + connectivity, offsets)}
    radius = np.sqrt(lines.outline[:, 0] * lines.outline[:, 1])[lines.beam_of]
    constant = {"kind": np.concatenate((kinds, np.zeros(len(corners), np.int64))),
                "radius": np.concatenate((np.zeros(n), radius[corners])), "s": np.concatenate((np.zeros(n), lines.s[corners]))}
    if not np.isfinite(lines.s).all():
        del constant["s"]

    def positions(k: int) -> Array:
        x = lines.points(result.phi[k])
        if surface:
            x = x[corners] + np.einsum("kc,kcx->kx", arms, lines.points(result.directors[k, :, 1:])[corners])
        return np.concatenate((result.phi[k, spots], x))

    def directors(k: int, i: int) -> Array:
        d = lines.points(result.directors[k, :, i])
        return np.concatenate((result.directors[k, spots, i], d[corners] if surface else d))

    moving: dict[str, tuple[int, Callable[[int], Array]]] = {"Points": (3, positions)}
    moving |= {f"d{i + 1}": (3, lambda k, i=i: directors(k, i)) for i in range(3)}
    velocity = _velocities(result)
    if velocity is not None:
        name, of_nodes = velocity

        def velocities(k: int) -> Array:
            v = of_nodes(k)
            along = lines.points(v)
            return np.concatenate((v[spots], along[corners] if surface else along))
        moving[name] = 3, velocities
    if sections is not None:
        for name, of_lines in _section_arrays(result, lines, sections).items():
            moving[name] = 3, lambda k, f=of_lines: np.concatenate((np.full((n, 3), np.nan), f(k)[corners]))
    if labels["slider"]:
        moving["force"] = 3, _forces(result, n + len(corners), np.flatnonzero(kinds == KINDS.index("slider")))
    labels["beam"] = lines.labels
    return _Shape(n + len(corners), cells, constant,
                  {"kind": np.concatenate((kinds, np.zeros(len(of_cells), np.int64))), "part": np.concatenate((parts, of_cells))},
                  moving, labels)


def _spots(result: Result) -> tuple[Array, Array, Array, dict[str, list[str]]]:
    """Collect bodies, masses and sliders: nodes, kinds, numbers among those of their kind [n], and names."""
    nodes: dict[str, list[int]] = {}
    labels: dict[str, list[str]] = {}
    for kind, key in (("body", "bodies"), ("mass", "masses")):
        entries = [entry for entry in result.names.get(key, []) if "drum" not in entry and "rope" not in entry]
        nodes[kind] = [entry["node"] for entry in entries]
        labels[kind] = [str(entry.get("name", "")) for entry in entries]
    nodes["slider"] = result.names.get("slider_nodes", [])
    labels["slider"] = result.names.get("sliders", []) if nodes["slider"] else []
    kinds = [np.full(len(x), KINDS.index(kind)) for kind, x in nodes.items()]
    return (np.array([k for x in nodes.values() for k in x], np.int64), np.concatenate(kinds),
            np.concatenate([np.arange(len(x)) for x in nodes.values()]), labels)


def _forces(result: Result, n: int, where: Array) -> Callable[[int], Array]:
    """Return a function of contact forces on the sliders, zero elsewhere [n, 3] (N); zero where they are not known."""
    force = result.series.get("contact_force", np.zeros((0, 0, 3)))
    # snapshots are taken at rows
    row = np.searchsorted(result.t, result.t_snap - 1e-12 * np.abs(result.t_snap))

    def values(k: int) -> Array:
        out = np.zeros((n, 3))
        if row[k] < len(force) and force.shape[1] == len(where):
            out[where] = np.nan_to_num(force[row[k]], posinf=0.0, neginf=0.0)
        return out
    return values


def _velocities(result: Result) -> tuple[str, Callable[[int], Array]] | None:
    """Return the name of the velocities of all nodes, and a function of snapshot k that returns them [N, 3] (m/s): those that the
    run kept, else slopes of the parabola through three shapes, at the first and last the nearest three; None where shapes are not
    those of a motion."""
    if result.velocities is not None:
        recorded = result.velocities
        return "velocity", lambda k: recorded[k]
    t, phi = result.t_snap, result.phi
    if len(t) < 3 or str(result.info.get("method")) in NOT_IN_TIME or not np.all(np.diff(t) > 0.0):
        return None

    def slope(k: int) -> Array:
        j = min(max(k, 1), len(t) - 2)
        a, b, c = t[j - 1:j + 2]
        # derivative at t[k] of the polynomials that are 1 at one of the three times and 0 at the others
        weights = ((2 * t[k] - b - c) / ((a - b) * (a - c)), (2 * t[k] - a - c) / ((b - a) * (b - c)),
                   (2 * t[k] - a - b) / ((c - a) * (c - b)))
        # relative to the middle shape: common parts cancel before they are weighted
        return np.asarray(weights[0] * (phi[j - 1] - phi[j]) + weights[2] * (phi[j + 1] - phi[j]))
    return "velocity_from_shapes", slope


def _section_arrays(result: Result, lines: Lines, sections: Any) -> dict[str, Callable[[int], Array]]:
    """Return functions of snapshot k: forces (N, Q2, Q3) and moments (T, M2, M3) of sections at all points of lines [M, 3],
    linear between the arc lengths that are given; NaN on beams without section forces. Raises SceneError: `sections` is no dict
    of section forces, names a beam that is not there, or belongs to other shapes."""
    need = "to_vtk: sections must be a dict of names of beams and what section_forces(model, result, beam) returns"
    if not isinstance(sections, Mapping):
        raise SceneError(f"{need}, got {shown(sections)}")
    found = []
    for name, forces in sections.items():
        at = lines.labels.index(name) if name in lines.labels else -1
        points = np.flatnonzero(lines.parts[lines.beam_of] == at)
        if not points.size or np.isnan(lines.s[points]).any():
            raise SceneError(f"to_vtk: sections: {shown(name)} is not a beam of this result; choose from "
                             f"{known(lines.labels, name)}")
        if not all(hasattr(forces, x) for x in ("t", "s", *RESULTANTS)):
            raise SceneError(f"{need}, got {shown(forces)} for beam '{name}'")
        if not np.array_equal(forces.t, result.t_snap):
            raise SceneError(f"to_vtk: sections of beam '{name}' are those of {len(forces.t)} other shapes than the "
                             f"{len(result.t_snap)} of this result; section_forces(model, result, beam) of the same result")
        found.append((points, lines.s[points], forces.s, [np.asarray(getattr(forces, x)) for x in RESULTANTS]))

    if not found:
        return {}

    def values(k: int, which: slice) -> Array:
        out = np.full((lines.n_points, 3), np.nan)
        for points, at, s, resultants in found:
            order = np.argsort(s)
            for i, x in enumerate(resultants[which]):
                out[points, i] = np.interp(at, s[order], x[k, order])
        return out
    return {"section_force": lambda k: values(k, slice(0, 3)), "section_moment": lambda k: values(k, slice(3, 6))}


# --- the file ---------------------------------------------------------------------------------------------------------------
def _write(file: Any, shape: _Shape, times: Array, dtype: Any, h5py: Any) -> None:
    n, steps = shape.n_points, len(times)
    for kind, labels in shape.labels.items():
        # VTK leaves these alone; people and scripts read them
        file.create_dataset(f"names/{kind}", data=np.array(labels, dtype=object), shape=(len(labels),), dtype=h5py.string_dtype())
    group = file.create_group("VTKHDF")
    group.attrs["Version"] = np.array([2, 0])
    group.attrs.create("Type", np.bytes_("PolyData"))
    group["NumberOfPoints"] = np.array([n])
    for kind in ("Vertices", "Lines", "Polygons", "Strips"):
        corners, offsets = shape.cells.get(kind, (np.zeros(0, np.int64), np.zeros(1, np.int64)))
        group[f"{kind}/NumberOfCells"] = np.array([len(offsets) - 1])
        group[f"{kind}/NumberOfConnectivityIds"] = np.array([len(corners)])
        group[f"{kind}/Connectivity"], group[f"{kind}/Offsets"] = corners, offsets
    series = group.create_group("Steps")
    series.attrs["NSteps"] = steps
    series["Values"] = times
    series["PartOffsets"], series["NumberOfParts"] = np.zeros(steps, np.int64), np.ones(steps, np.int64)
    series["PointOffsets"] = n * np.arange(steps)
    series["CellOffsets"] = series["ConnectivityIdOffsets"] = np.zeros((steps, 4), np.int64)
    for place, arrays in (("PointData", shape.constant), ("CellData", shape.cell_data)):
        for name, x in arrays.items():
            group[f"{place}/{name}"] = x.astype(dtype) if x.dtype.kind == "f" else x.astype(np.int32)
            series[f"{place}Offsets/{name}"] = np.zeros(steps, np.int64)
    sets = {}
    for name, (width, _) in shape.moving.items():
        sets[name] = group.create_dataset(name if name == "Points" else f"PointData/{name}", (steps * n, width), dtype)
        if name != "Points":
            series[f"PointDataOffsets/{name}"] = n * np.arange(steps)
    for k in range(steps):
        for name, (_, values) in shape.moving.items():
            sets[name][k * n:(k + 1) * n] = np.ascontiguousarray(values(k), dtype)
