"""Energies of all parts of a result over time, and what its joints leave free."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .result import Result

Array = np.ndarray
# series, what it is called, kind of part, sign in the balance
ACCOUNTS = (("friction_loss", "friction", "slider", 1.0), ("stop_loss", "stops", "slider", 1.0),
            ("lock_loss", "lock", "slider", 1.0),
            ("drive_work", "drive", "slider", -1.0), ("joint_loss", "damper", "joint", 1.0),
            ("joint_friction", "friction", "joint", 1.0), ("joint_stop_loss", "stops", "joint", 1.0),
            ("joint_work", "motor", "joint", -1.0))


def balance_of(result: Result) -> dict[str, Array]:
    """`Result.balance`, from a result that has energies."""
    series = result.series
    energies = {name: np.asarray(series[name]) for name in ("kinetic", "strain")}
    stops = series["stop_energy"].sum(axis=1) if "stop_energy" in series else np.zeros(len(result.t))
    if np.any(stops):
        energies["stops"] = stops
    if "external_work" in series:
        energies["loads"] = -series["external_work"]
    else:
        energies["gravity"] = series["gravity"]
        loads = series["potential"] - energies["strain"] - energies["gravity"] - stops
        if np.any(np.abs(loads) > 1e-14 * np.max(np.abs(series["potential"]), initial=0.0)):
            energies["loads"] = loads
    for name, noun, kind, sign in ACCOUNTS:
        for k, part in enumerate(result.names.get(f"{kind}s", []) if name in series else []):
            if np.any(series[name][:, k]):
                # a joint may have two coordinates
                key = f"{noun} of {kind} {part!r}"
                energies[key] = energies.get(key, 0.0) + sign * series[name][:, k]
    for name, sign in (("losses", 1.0), ("works", -1.0)):
        energies |= {part: sign * x for part, x in zip(result.names.get(name, []), series.get(name, np.zeros((0, 0))).T)}
    if "filter_loss" in series:
        energies |= dict(zip(("dissipated by filters", "stored in filters"), series["filter_loss"].T))
    energies["sum"] = np.sum(list(energies.values()), axis=0)
    return energies


def joint_of(result: Result, name: str) -> dict[str, Array]:
    """`Result.joint`, of a joint with recorded coordinates."""
    out: dict[str, Array] = {}
    mine = [k for k, joint in enumerate(result.names["joints"]) if joint == name]
    for k in mine:
        what = result.names["coordinates"][k]
        rate = "spin" if what == "angle" else "speed"
        out[what], out[rate] = result.series["joint_value"][:, k], result.series["joint_rate"][:, k]
        if "joint_force" in result.series and name in result.names.get("held", ()):
            out["torque" if what == "angle" else "force"] = result.series["joint_force"][:, k]
    for key in ("energy", "loss", "work"):
        if f"joint_{key}" in result.series:
            out[key] = result.series[f"joint_{key}"][:, mine].sum(axis=1)
    if "joint_drive" in result.series and name in result.names.get("driven", ()):
        out["drive"] = result.series["joint_drive"][:, mine].sum(axis=1)
    for key in ("friction", "stop"):
        series = "joint_friction" if key == "friction" else "joint_stop_loss"
        if series in result.series and name in result.names.get("held", ()):
            out[f"{key}_loss"] = result.series[series][:, mine].sum(axis=1)
    return out
