"""Beams of a result as lines with directors and the outline of their sections, for pictures and files for other programs.

Everything is read from the names of a result (`Result`): of beams besides what stands there 's' and 'length' (m), 'degree',
'half_2', 'half_3' and 'round' of the section (`Section.outline`), and of splines 'spline_ends', arc lengths of the element ends;
of nets 'outlines', three numbers a section, and 'outline_of', the section of every beam. Names may come from a file of an older
version or of somebody who meant harm: what is missing or does not fit is replaced by lines through the nodes.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fastbeam.interface.arguments import numbers, real
from fastbeam.interface.errors import SceneError
from fastbeam.scene.interpolation.basis import build_basis

Array = np.ndarray
# corners of a round section
SIDES = 16


class Lines:
    """Points along all beams of a result, one beam after the other, then those of nets and the ropes of winches.

    names: `Result.names`.
    refine: points from one node to the next; nets and ropes are lines through their nodes in any case.
    starts: int [B + 1], first point of every beam, then their number M.
    parts: int [B], entry of `labels` that every line belongs to.
    labels: names of beams, then of nets and winches.
    s: float64 [M], arc length, m; NaN in nets and ropes, whose names do not tell it.
    outline: float64 [B, 3], half sizes along d2 and d3, m, and 1 where the section is round, 0 for a rectangle.
    """

    def __init__(self, names: Mapping[str, Any], n_nodes: int, refine: int = 1) -> None:
        beams, nets, ropes = (names.get(kind, []) for kind in ("beams", "nets", "ropes"))
        if not beams and not nets and n_nodes and not names.get("bodies") and not names.get("masses"):
            beams = [{"name": "nodes", "first": 0, "count": n_nodes}]
        self.labels = [str(entry.get("name", "")) for entry in (*beams, *nets, *ropes)]
        # of every entry: nodes, their weights and number at a point, points of lines, arc lengths, outlines, its number
        found: list[tuple[Any, ...]] = []
        for k, entry in enumerate(beams):
            at, node, weight, count = _samples(entry, refine)
            shape = _number(entry.get("half_2")), _number(entry.get("half_3")), entry.get("round") is not False
            found.append((node, weight, count, [len(at)], at, [shape], [k]))
        for k, net in enumerate(nets, len(beams)):
            n = int(net["count"])
            # checked where a result is made: numbers of its nodes
            starts = np.unique(np.asarray([0, *net.get("starts", ())], dtype=np.int64))
            found.append((net["first"] + np.arange(n), np.ones(n), np.ones(n, np.int64), np.diff(starts, append=n),
                          np.full(n, np.nan), _net_outlines(net, len(starts)), np.full(len(starts), k)))
        for k, rope in enumerate(ropes, len(beams) + len(nets)):
            nodes = np.asarray(rope["nodes"], dtype=np.int64)
            n = len(nodes)
            found.append((nodes, np.ones(n), np.ones(n, np.int64), [n], np.full(n, np.nan), [(0.0, 0.0, 1.0)], [k]))
        columns, values, counts, lengths, s, outline, parts = zip(*found) if found else ((),) * 7
        self._columns, self._values = _joined(columns, np.int64), _joined(values, float)
        self._rows = np.concatenate(([0], np.cumsum(_joined(counts, np.int64))))
        self.starts = np.concatenate(([0], np.cumsum(_joined(lengths, np.int64))))
        self.s, self.parts = _joined(s, float), _joined(parts, np.int64)
        self.outline = np.concatenate([np.asarray(x, float).reshape(-1, 3) for x in outline] or [np.zeros((0, 3))])
        self.n_points = int(self.starts[-1])
        # one node a point: no sums
        self._direct = len(self._columns) == self.n_points and bool(np.all(self._values == 1.0))

    @property
    def beam_of(self) -> Array:
        """Number of the line that every point belongs to, int [M]."""
        return np.repeat(np.arange(len(self.parts)), np.diff(self.starts))

    def points(self, x: Array) -> Array:
        """Return values [M, ...] at the points from those of the nodes, [N, ...]."""
        if self._direct:
            first, n = (int(self._columns[0]), self.n_points) if self.n_points else (0, 0)
            if n and self._columns[-1] - first == n - 1 and np.all(np.diff(self._columns) == 1):
                return x[first:first + n]
            return x[self._columns]
        if not self.n_points:
            return np.zeros((0, *x.shape[1:]))
        flat = x.reshape(len(x), -1)
        return np.add.reduceat(self._values[:, None] * flat[self._columns], self._rows[:-1], axis=0).reshape(-1, *x.shape[1:])

    def surface(self) -> tuple[Array, Array, Array, list[Array]]:
        """Return the skins of the beams: of every corner its point [K] and its distances along d2 and d3 [K, 2] (m); of every
        four-sided face its corners [F, 4]; the rims of both ends of every beam, [corners] each."""
        at, arms, faces, rims = [], [], [], []
        angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
        base = 0
        for k in range(len(self.parts)):
            first, last = int(self.starts[k]), int(self.starts[k + 1])
            h2, h3, is_round = self.outline[k]
            ring = (np.stack((np.cos(angle), np.sin(angle)), axis=1) if is_round
                    else np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])) * (h2, h3)
            n, m = last - first, len(ring)
            at.append(np.repeat(np.arange(first, last), m))
            arms.append(np.tile(ring, (n, 1)))
            corner = base + np.arange(n * m).reshape(n, m)
            following = np.roll(corner, -1, axis=1)
            faces.append(np.stack((corner[:-1], following[:-1], following[1:], corner[1:]), axis=-1).reshape(-1, 4))
            rims += [corner[0, ::-1], corner[-1]]
            base += n * m
        return (_joined(at, np.int64), np.concatenate(arms or [np.zeros((0, 2))]),
                np.concatenate(faces or [np.zeros((0, 4), np.int64)]), rims)


def _samples(entry: Mapping[str, Any], refine: int) -> tuple[Array, Array, Array, Array]:
    """Return points on a beam: arc lengths [m], nodes and weights [w], and how many of these each point has, int [m]."""
    first, count = int(entry["first"]), int(entry["count"])
    found = numbers(entry.get("s"))
    node_s = found if found is not None and found.shape == (count,) else np.full(count, np.nan)
    at_nodes = node_s, first + np.arange(count), np.ones(count), np.ones(count, np.int64)
    spline = "spline_ends" in entry
    if not np.all(np.diff(node_s, prepend=-1.0) > 0.0) or count < 2 or not (spline or refine > 1):
        return at_nodes
    try:
        ends = entry["spline_ends"] if spline else node_s[np.asarray(entry["element_ends"]) - first]
        basis = build_basis("bspline" if spline else "lagrange", entry.get("degree", (count - 1) // max(len(ends) - 1, 1)),
                            np.asarray(ends, float), float(ends[-1]))
        if basis.n_nodes != count:
            return at_nodes
        between = node_s[:-1, None] + np.arange(refine) / refine * np.diff(node_s)[:, None]
        at = np.append(between.reshape(-1), node_s[-1])
        node, values, _ = basis.curve("own").evaluate(np.clip(at, 0.0, ends[-1]))
    except (SceneError, ValueError, TypeError, KeyError, IndexError):
        return at_nodes
    columns = first + node[:, None] + np.arange(values.shape[1])
    if columns.max() >= first + count:
        return at_nodes
    return at, columns.reshape(-1), values.reshape(-1), np.full(len(at), values.shape[1])


def _net_outlines(net: Mapping[str, Any], n: int) -> Array:
    """Return outlines [n, 3] of the beams of a net."""
    every, which = (x if isinstance(x, list) else [] for x in (net.get("outlines"), net.get("outline_of")))
    table = np.array([_number(x) for x in every[:len(every) // 3 * 3]]).reshape(-1, 3)
    if which == [] and len(table):
        which = [0] * n
    if len(which) != n or not all(isinstance(k, int) and 0 <= k < len(table) for k in which):
        return np.tile((0.0, 0.0, 1.0), (n, 1))
    return table[np.asarray(which, np.int64)]


def _number(x: Any) -> float:
    """Return a finite size, 0 where it is none."""
    size = real(x)
    return size if size is not None and 0.0 <= size < np.inf else 0.0


def _joined(arrays: list[Any], dtype: Any) -> Array:
    return np.concatenate([np.asarray(x, dtype) for x in arrays]) if arrays else np.zeros(0, dtype)
