"""Which runs are made: sweeps of every program, references, and the wanted errors."""
from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

SCENES = ("spaghetti3d", "sliding")
PEERS = ("exudyn", "pyelastica", "opensees")
ERRORS = (1e-4, 1e-6)
BAR = 30.0  # times faster than the fastest peer

Settings = dict[str, Any]


@dataclass(frozen=True)
class Sweep:
    """Runs of one program in one scene.

    Parameters
    ----------
    program : str
    runs : list of dict
        Settings without the scene.
    limit : (int, float) or None
        Elements and step of the finest run of the extrapolation to the program's own limit; `limit_settings` are the others.
    orders : (float, float)
        In space and time, assumed in the extrapolation.
    own : bool
        Errors are measured from the program's own limit instead of from the common reference: its model is another one.
    """

    program: str
    runs: list[Settings]
    limit: tuple[int, float] | None = None
    limit_settings: Settings = field(default_factory=dict)
    orders: tuple[float, float] = (2.0, 2.0)
    own: bool = False

    def limit_runs(self) -> list[Settings]:
        """The six runs of the extrapolation."""
        if self.limit is None:
            return []
        n, h = self.limit
        pairs = ((n, h), (n // 2, h), (n, 2 * h), (n // 2, 2 * h), (n // 4, 2 * h), (n // 2, 4 * h))
        return [{"elements": a, "step": b, **self.limit_settings} for a, b in pairs]

    def all_runs(self) -> list[Settings]:
        """Every run once."""
        unique = {json.dumps(run, sort_keys=True): run for run in [*self.runs, *self.limit_runs()]}
        return list(unique.values())


def mesh(pairs: Iterable[tuple[int, float]], **others: Any) -> list[Settings]:
    """Runs from pairs (elements, step)."""
    return [{"elements": n, "step": h, **others} for n, h in pairs]


def lagrange(rows: Iterable[tuple[int, int, float]], order: int, **others: Any) -> list[Settings]:
    """Runs of fastbeam from (elements, degree, step)."""
    return [{"elements": n, "degree": p, "step": h, "order": order, **others} for n, p, h in rows]


# the common reference, and a second run of other discretisation that tells how far it can be trusted
REFERENCE: dict[str, tuple[Settings, Settings]] = {
    "spaghetti3d": (lagrange([(24, 6, 6.25e-4)], 4)[0], lagrange([(20, 5, 1.25e-3)], 4)[0]),
    "sliding": (lagrange([(64, 5, 5e-4)], 4, cable=True)[0], lagrange([(48, 4, 1e-3)], 4, cable=True)[0])}
QUICK_REFERENCE: dict[str, tuple[Settings, Settings]] = {
    "spaghetti3d": (lagrange([(16, 6, 1.25e-3)], 4)[0], lagrange([(12, 6, 2.5e-3)], 4)[0]),
    "sliding": (lagrange([(32, 5, 1e-3)], 4, cable=True)[0], lagrange([(32, 4, 1.25e-3)], 4, cable=True)[0])}

FLYING_2 = [(3, 3, 0.05), (4, 3, 0.025), (4, 3, 0.0125), (4, 4, 0.01), (6, 3, 0.01), (5, 4, 0.005), (8, 3, 0.005), (8, 3, 0.0025)]
FLYING_4 = [(2, 4, 0.25), (2, 5, 0.25), (2, 5, 0.125), (3, 4, 0.25), (3, 4, 0.125), (4, 3, 0.125), (4, 3, 0.1), (4, 4, 0.1),
            (3, 5, 0.125), (3, 5, 0.1), (6, 3, 0.1), (4, 4, 0.0625), (4, 5, 0.0625), (6, 4, 0.0625), (6, 4, 0.05), (4, 6, 0.05),
            (6, 5, 0.05), (8, 4, 0.05), (6, 4, 0.03125), (8, 4, 0.025), (6, 5, 0.025), (10, 4, 0.025), (6, 6, 0.025),
            (8, 5, 0.025), (8, 5, 0.0125), (10, 5, 0.0125), (8, 6, 0.0125), (12, 5, 0.0125), (12, 6, 0.00625)]
SLIDING_2 = [(5, 3, 0.01), (6, 3, 0.005), (6, 3, 0.0025), (8, 3, 0.005), (8, 3, 0.0025), (10, 3, 0.0025), (10, 3, 0.00125)]
SLIDING_4 = [(6, 3, 0.025), (7, 3, 0.025), (8, 3, 0.025), (7, 3, 0.2 / 9), (8, 3, 0.2 / 9), (6, 4, 0.02), (7, 3, 0.02),
             (8, 3, 0.02), (8, 4, 0.0125), (10, 3, 0.0125), (8, 4, 0.01), (12, 3, 0.01), (10, 4, 0.01), (14, 3, 0.005),
             (12, 4, 0.005), (16, 3, 0.005), (16, 4, 0.005), (20, 3, 0.005), (16, 4, 0.0025), (20, 3, 0.0025), (24, 3, 0.0025),
             (20, 4, 0.0025), (24, 4, 0.0025), (32, 3, 0.0025), (24, 5, 0.0025)]


def full() -> dict[str, list[Sweep]]:
    """Every sweep; single runs of peers take up to two minutes."""
    loose = {"tolerance": 1e-6}
    angles = {"solver": "trapezoidal", "nodes": "angles", **loose}
    flying = mesh([(10, 0.05), (10, 0.025), (20, 0.05), (20, 0.025), (40, 0.05), (40, 0.025), (40, 0.0125), (80, 0.025),
                   (80, 0.0125), (80, 0.01), (160, 0.0125), (160, 0.00625), (160, 0.005), (320, 0.005), (320, 0.0025),
                   (640, 0.00125)], **loose)
    flying += mesh([(10, 0.025), (20, 0.025)], linear="EXUdense", **loose) + mesh([(40, 0.025)], modified=False, **loose)
    flying += mesh([(20, 0.05), (20, 0.025), (40, 0.0125), (80, 0.0125), (160, 0.00625)], **angles)
    flying += mesh([(40, 0.001)], solver="RK44", nodes="angles") + mesh([(40, 0.0125)], solver="trapezoidal", **loose)
    plane = {"solver": "trapezoidal", "dim": 2}
    coarse = [(8, 0.001), (8, 0.0005), (8, 0.0004), (12, 0.0005), (12, 0.0004), (12, 0.00025), (16, 0.0005), (16, 0.00025),
              (16, 0.0002), (16, 0.0001), (24, 0.0001)]
    fine = [(16, 0.0001), (24, 0.0001), (24, 5e-5), (24, 2e-5), (32, 5e-5), (32, 2e-5), (32, 1e-5), (32, 5e-6),
            (48, 5e-6), (48, 2.5e-6)]
    glide = mesh(coarse, tolerance=1e-5, **plane) + mesh(fine, tolerance=1e-6, **plane)
    glide += mesh([(12, 0.00025), (24, 5e-5), (32, 5e-6), (32, 2.5e-6)], **plane)
    glide += mesh([(8, 0.0005), (12, 0.00025)], linear="EXUdense", tolerance=1e-5, **plane)
    glide += mesh([(16, 0.00025)], modified=False, tolerance=1e-5, **plane)
    glide += mesh([(12, 0.00025), (16, 0.0001)], solver="alpha", rho=0.8, dim=2, tolerance=1e-5)
    glide += mesh([(12, 0.00025)], solver="alpha", rho=0.8, dim=3, tolerance=1e-5)
    return {
        "spaghetti3d": [
            Sweep("fastbeam", lagrange(FLYING_2, 2) + lagrange(FLYING_4, 4)),
            Sweep("exudyn", flying, limit=(160, 0.00625)),
            Sweep("pyelastica", mesh([(10, 0.005), (20, 0.0025), (20, 0.00125), (40, 0.00125), (40, 0.000625), (80, 0.000625),
                                      (80, 0.0003125), (160, 0.0003125), (160, 0.00015625), (160, 3.90625e-5),
                                      (320, 1.953125e-5)]),
                  limit=(160, 7.8125e-5), orders=(2.0, 1.0), own=True),
            Sweep("opensees", mesh([(10, 0.05), (20, 0.05), (40, 0.05), (80, 0.05), (80, 0.025), (160, 0.0125)]),
                  limit=(80, 0.0125), own=True)],
        "sliding": [
            Sweep("fastbeam", lagrange(SLIDING_2, 2, cable=True) + lagrange(SLIDING_4, 4, cable=True)),
            Sweep("exudyn", glide, limit=(64, 5e-5), limit_settings=plane, orders=(4.0, 1.0))]}


def quick() -> dict[str, list[Sweep]]:
    """A thin selection that takes a few minutes; errors of 1e-6 are extrapolated for the peers."""
    plane = {"solver": "trapezoidal", "dim": 2}
    return {
        "spaghetti3d": [
            Sweep("fastbeam", lagrange([(6, 3, 0.01)], 2) + lagrange(FLYING_4[3:29:3], 4)),
            Sweep("exudyn", mesh([(20, 0.025), (80, 0.0125), (160, 0.0125), (160, 0.00625)]), limit=(80, 0.0125)),
            Sweep("pyelastica", mesh([(20, 0.00125), (160, 0.00015625)]), limit=(80, 0.00015625), orders=(2.0, 1.0), own=True),
            Sweep("opensees", mesh([(20, 0.05)]), limit=(40, 0.0125), own=True)],
        "sliding": [
            Sweep("fastbeam", lagrange(SLIDING_2[2::4], 2, cable=True) + lagrange(SLIDING_4[2::3], 4, cable=True)),
            Sweep("exudyn", mesh([(12, 0.0005), (12, 0.00025), (16, 0.0001), (24, 5e-5), (24, 2e-5)], **plane),
                  limit=(32, 0.0001), limit_settings=plane, orders=(4.0, 1.0))]}
