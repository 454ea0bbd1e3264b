"""Frequency response of a scene about an equilibrium: the result of `frequency_response`."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.arguments import Count, Name, checked
from fastbeam.interface.errors import SceneError
from fastbeam.interface.result_warnings import Tabled
from fastbeam.interface.synonyms import known

Array = np.ndarray
# peaks of a point that a table lists, and points
MOST_PEAKS, MOST_POINTS = 8, 30


class FrequencyResponse(Tabled):
    """Steady vibrations under harmonic excitation: every quantity is Re(X e^(i w t)) with these complex amplitudes X (theory.md
    14).

    Attributes
    ----------
    frequencies, angular : float64 [f]
        Hz, rad/s.
    displacements : complex128 [f, P, 3]
        Displacements of the points, in space (with a moving base not relative to it), m.
    spins : complex128 [f, P, 3]
        Rotations of points that are nodes, rad; NaN of others.
    slides : complex128 [f, S]
        Motion of the sliding coordinates, m.
    residuals : float64 [f]
        Residuals of the scaled equations, relative to the excitation.
    sensitivity : float64 [f]
        Relative change of the amplitudes with a relative change of the frequency; 1e9: of 16 digits 7 are left. About Q, the
        amplification, at the peak of a single mode.
    uncertainty : float64 [f]
        Uncertainty of the amplitudes by round-off of the stiffness, relative to the largest.
    motions : complex128 [f, N, 3], or None
        Displacements of all nodes, with shapes=True.
    info, names : dict
        Facts; names of parts as in a `Result`, and `points`.
    events : list of dict
        Events where the response is not to be trusted, as in a `Result`.
    positions : float64 [N, 3]
        Positions of the equilibrium.
    """

    _title = "Frequency response of {}"

    def __init__(self, frequencies: Array, displacements: Array, spins: Array, slides: Array, residuals: Array,
                 sensitivity: Array, uncertainty: Array, motions: Array | None, info: dict[str, Any], names: dict[str, list[Any]],
                 positions: Array) -> None:
        self.frequencies, self.angular = frequencies, 2.0 * np.pi * frequencies
        self.displacements, self.spins, self.slides = displacements, spins, slides
        self.residuals, self.sensitivity, self.uncertainty, self.motions = residuals, sensitivity, uncertainty, motions
        self.info, self.names, self.positions = info, names, positions

    def __len__(self) -> int:
        return self.frequencies.size

    @checked(name=Name())
    def point(self, name: str) -> Array:
        """Return the amplitudes [f, 3] of a point, m.

        Raises
        ------
        SceneError
            There is no such point.
        """
        return self.displacements[:, self._number("points", name)]

    @checked(name=Name())
    def spin(self, name: str) -> Array:
        """Return the rotations [f, 3] of a point that is a node, rad.

        Raises
        ------
        SceneError
            There is no such point.
        """
        return self.spins[:, self._number("points", name)]

    @checked(name=Name())
    def slide(self, name: str) -> Array:
        """Return the motion [f] of a slider along its beam, m.

        Raises
        ------
        SceneError
            There is no such slider.
        """
        return self.slides[:, self._number("sliders", name)]

    @checked(k=Count(0))
    def shape(self, k: int) -> Array:
        """Return displacements of all nodes [N, 3] at frequency k.

        Raises
        ------
        SceneError
            They were not kept, or there is no such frequency.
        """
        if self.motions is None:
            raise SceneError("shape: motions of all nodes were not kept; use frequency_response(shapes=True)")
        if k >= len(self):
            raise SceneError(f"frequency {k} does not exist: there are {len(self)}, counted from 0")
        return self.motions[k]

    @checked(name=Name())
    def peaks(self, name: str) -> list[tuple[float, float]]:
        """Return (frequency, Hz, amplitude, m) where the amplitude of a point is larger than at the frequencies beside it, as
        sampled; the largest first.

        Raises
        ------
        SceneError
            There is no such point.
        """
        order = np.argsort(self.frequencies)
        size = np.linalg.norm(self.point(name), axis=1)[order]
        wide = np.concatenate(([-np.inf], size, [-np.inf]))
        at = np.flatnonzero((size > wide[:-2]) & (size >= wide[2:]) & (np.arange(size.size) > 0) & (
            np.arange(size.size) < size.size - 1))
        at = at[np.argsort(-size[at], kind="stable")]
        return [(float(self.frequencies[order][k]), float(size[k])) for k in at]

    def table(self) -> str:
        """Return a text: the largest amplitude and the peaks of every point."""
        low, high = float(self.frequencies.min()), float(self.frequencies.max())
        rows = [f"response to {self.info['excitation']}: {len(self)} frequencies, {low:.6g} to {high:.6g} Hz; largest residual "
                f"{self.residuals.max():.1e}, round-off {self.uncertainty.max():.1e}"]
        names = self.names["points"]
        for name in names[:MOST_POINTS]:
            size = np.linalg.norm(self.point(name), axis=1)
            k = int(np.argmax(size))
            found = ", ".join(f"{a:.4g} m at {f:.6g} Hz" for f, a in self.peaks(name)[:MOST_PEAKS])
            rows.append(f"{name}: at most {size[k]:.4g} m at {self.frequencies[k]:.6g} Hz; peaks: {found or 'none'}")
        if len(names) > MOST_POINTS:
            rows.append(f"and {len(names) - MOST_POINTS} more points")
        return "\n".join([*rows, *self._doubts()])

    def _number(self, what: str, name: str) -> int:
        if name not in self.names[what]:
            raise SceneError(f"frequency response: there is no {what[:-1]} {name!r}; {what}: "
                             f"{known(self.names[what], name)}")
        return self.names[what].index(name)
