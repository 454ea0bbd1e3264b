"""Energies of all parts of a result over time, and coordinates of its joints."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import known

if TYPE_CHECKING:
    from fastbeam.results.result import Result

Array = np.ndarray
# key of `Result.info`: energy that mending the start dissipated, J
AT_START = "books of the start"
# series, its name, kind of part, sign in the balance
ACCOUNTS = (("friction_loss", "friction", "slider", 1.0), ("stop_loss", "stops", "slider", 1.0),
            ("lock_loss", "lock", "slider", 1.0),
            ("drive_work", "drive", "slider", -1.0), ("joint_loss", "damper", "joint", 1.0),
            ("joint_friction", "friction", "joint", 1.0), ("joint_stop_loss", "stops", "joint", 1.0),
            ("joint_work", "motor", "joint", -1.0))


def balance_of(result: Result) -> dict[str, Array]:
    """Return `Result.balance`, from a result that has energies."""
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
    energies |= {part: np.full(len(result.t), x) for part, x in result.info.get(AT_START, {}).items() if x != 0.0}
    energies["sum"] = np.sum(list(energies.values()), axis=0)
    return energies


def power_of(result: Result, name: str) -> Array:
    """Return `Result.power`, from a result that has energies."""
    parts = balance_of(result)
    if name not in parts:
        raise SceneError(f"power: the balance has no {name!r}; it has {known(parts, name)}. A part without any energy exchange "
                         "has no entry")
    t = result.t
    if len(t) < 3 or not np.all(np.diff(t) > 0.0):
        raise SceneError(f"power: needs three rows at times that grow, here {len(t)}; record more with every=1")
    return np.asarray(np.gradient(parts[name], t, edge_order=2))


# names of the rate and the force of a coordinate
RATES = {"angle": "spin", "distance": "speed", "swing": "swing_rate", "twist": "spin"}
FORCES = {"angle": "torque", "distance": "force", "swing": "cone_torque", "twist": "torque"}
# other forces on coordinates, and the list of joints that have them
PUSHED = {"drive": "driven", "coupling": "coupled"}


def joint_of(result: Result, name: str) -> dict[str, Array]:
    """Return `Result.joint`, of a joint with recorded coordinates."""
    out: dict[str, Array] = {}
    series = result.series
    mine = [k for k, joint in enumerate(result.names["joints"]) if joint == name]
    shown = [k for k in mine if result.names["coordinates"][k] in RATES]
    for what in dict.fromkeys(result.names["coordinates"][k] for k in shown):
        same = [k for k in shown if result.names["coordinates"][k] == what]
        # several of a kind stand in columns
        at = same[0] if len(same) == 1 else same
        out[what], out[RATES[what]] = series["joint_value"][:, at], series["joint_rate"][:, at]
        if "joint_force" in series and name in result.names.get("held", ()):
            out[FORCES[what]] = series["joint_force"][:, at]
    for key in ("energy", "loss", "work"):
        if f"joint_{key}" in series:
            out[key] = series[f"joint_{key}"][:, mine].sum(axis=1)
    for key, of in PUSHED.items():
        if f"joint_{key}" in series and name in result.names.get(of, ()):
            out[key] = series[f"joint_{key}"][:, shown[0] if len(shown) == 1 else shown]
    for key in ("friction", "stop"):
        of = "joint_friction" if key == "friction" else "joint_stop_loss"
        if of in series and name in result.names.get("held", ()):
            out[f"{key}_loss"] = series[of][:, mine].sum(axis=1)
    return out
