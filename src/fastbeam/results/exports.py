"""Exports of a result to other programs: files for ParaView, tables for pandas."""
from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface import notebook
from fastbeam.interface.arguments import Anything, Count, FilePath, Flag, checked
from fastbeam.interface.errors import BackendError
from fastbeam.interface.result_warnings import KINDS
from fastbeam.results.readings import ROWS, SECTION

if TYPE_CHECKING:
    from pandas import DataFrame

    from fastbeam.dynamics.checkpoint import Checkpoint
    from fastbeam.kernels.state import State
    from fastbeam.results.observe.resultants import SectionForces

XYZ, PAIR, AXES = ("x", "y", "z"), ("force", "moment"), ("d1", "d2", "d3")


class Exports:
    """Methods of `Result` for other programs."""

    t: np.ndarray
    series: dict[str, np.ndarray]
    names: dict[str, list[Any]]
    info: dict[str, Any]
    # set by runs; files hold neither
    state: State
    checkpoint: Checkpoint

    @checked(path=FilePath(), overwrite=Flag(), surface=Flag(), refine=Count(most=64), double=Flag(), sections=Anything())
    def to_vtk(self, path: str | PathLike[str], *, overwrite: bool = False, surface: bool = False, refine: int | None = None,
               double: bool = False, sections: Mapping[str, SectionForces] | None = None) -> None:
        """Write the snapshots to a VTKHDF file (.vtkhdf), a time series for ParaView (5.12 and newer), PyVista and VTK.

        Beams are lines, bodies, masses and points of sliders are points. Point data: `kind` (0 beam, 1 body, 2 mass, 3 slider),
        `radius` (m; of sections that are no circle sqrt of the product of both half sizes), triads `d1`, `d2`, `d3`, `s` (arc
        length of beams, m; not in nets), `force` on sliders (N). `velocity` of nodes (m/s, of axes where beams are skins) from
        runs with `observe=("velocity", ...)`, else `velocity_from_shapes`: the slope of the parabola through three snapshots, as
        good as these are dense. Where `sections` are given `section_force` (N, Q2, Q3) and `section_moment` (T, M2, M3), linear
        between the arc lengths given, NaN elsewhere. Cell data: `kind`, and `part`, the number of the part among those of its
        kind, whose names stand in the file at names/beam and so on.

        Parameters
        ----------
        path : path
            Ends in .vtkhdf.
        overwrite : bool
            Replace an existing file.
        surface : bool
            Beams as the skins of their sections instead of lines: round or rectangular, with their twist. Of a section given by
            stiffnesses the ellipse with the same radii of gyration.
        refine : int
            Points of a line from one node of a beam to the next, on the curve that the beam is; default: 4 up to 20 000 nodes,
            else 1. Beams of nets are lines through their nodes.
        double : bool
            Numbers of 8 bytes instead of 4.
        sections : mapping
            Name of a beam -> `section_forces(model, result, beam, s=...)` of this result.

        Raises
        ------
        BackendError
            h5py is missing.
        SceneError
            The result holds no snapshots, the path ends in something else, or section forces belong to something else.
        ResultFileError
            The file exists (and not `overwrite`), its folder does not, or there is no room for it.
        """
        from fastbeam.results.vtkhdf import write_vtk
        write_vtk(self, Path(path), overwrite=overwrite, surface=surface, refine=refine, double=double,  # type: ignore[arg-type]
                  sections=sections)

    def _repr_html_(self) -> str:
        return html_of(self)

    @checked()
    def to_dataframe(self) -> DataFrame:
        """Return all series as a pandas DataFrame, with the rows of the result; the index is the time, s (statics: the load
        factor).

        Columns are named after series, names and components: 'total', 'lin_mom.x', 's_slide[ring]', 'contact_force[ring].x',
        'points[tip].z'. Facts of the run are in `.attrs`.

        Raises
        ------
        BackendError
            pandas is missing.
        """
        pandas = import_pandas()
        frame = pandas.DataFrame(columns_of(self.series, self.names), index=pandas.Index(self.t, name="t"))
        frame.attrs |= {key: value for key, value in self.info.items() if isinstance(value, (str, int, float))}
        return frame


def import_pandas() -> Any:
    """Import pandas. Raises BackendError: it is missing."""
    try:
        import pandas
    except ImportError as error:
        raise BackendError("tables need pandas: pip install pandas; .series of results and .rows of sweeps hold the same"
                           ) from error
    return pandas


def html_of(result: Any) -> str:
    """Return HTML that notebooks show of a result: invariants with their drift, and events."""
    first, second = result._rows_of_table()
    facts = f"{len(result.t)} rows, {len(result.t_snap)} snapshots of {result.phi.shape[1]} nodes"
    if len(result.t):
        facts += f", t = {result.t[0]:g} to {result.t[-1]:g}"
    told = [event for event in result.events if event.get("kind") not in KINDS]
    notes = [f"{event.get('kind', '')}: {event.get('text', '')}" for event in told[:notebook.MOST_ROWS]]
    return notebook.table(f"Result {result.info.get('scene', '')!s:.80}", first[0], [*first[1:], *second],
                          [facts, *notes, *result._doubts()])


def columns_of(series: Mapping[str, np.ndarray], names: Mapping[str, list[Any]]) -> dict[str, np.ndarray]:
    """Return columns [n] of all series, by names such as 'contact_force[ring].x'."""
    out: dict[str, np.ndarray] = {}
    for name, x in series.items():
        shape = ROWS.get(name, ())
        kind = shape[0] if shape and isinstance(shape[0], str) else "sliders"
        # the last axis of vectors are components, any other are parts
        vector = x.shape[-1] == 3 and (x.ndim > 2 or shape == (3,))
        for index in np.ndindex(x.shape[1:]):
            parts = list(index)
            axis = f".{dict(SECTION).get(name, XYZ)[parts.pop()]}" if vector else ""
            label = ""
            if parts:
                labels, k = names.get(kind, []), parts.pop(0)
                label = f"[{labels[k] if k < len(labels) and labels.count(labels[k]) == 1 else k}]"
            words = AXES if name == "point_directors" else PAIR if x.shape[-2:] == (2, 3) else ()
            label += "".join(f".{words[k] if len(words) > k else k}" for k in parts)
            out[f"{name}{label}{axis}"] = x[(slice(None), *index)]
    return out
