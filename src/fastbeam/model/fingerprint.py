"""Hash of a compiled scene, by which results and checkpoints recognise their model."""
from __future__ import annotations

from hashlib import sha256
from typing import Any

import numpy as np


def fingerprint_of(model: Any) -> str:
    """Return the hash of all tables and the initial state, the same in every process of a machine; functions of time count only
    as present."""
    digest = sha256()
    tables = (model.simo, model.green, model.bodies, *model.links, model.ties, model.held, model.curves, model.sliders)
    # tables of joints contain the ties of the model again
    parts = [x for table in tables for x in ((None,) if table is None else table) if x is None or isinstance(x, np.ndarray)]
    parts += [model.reference_strains, model.pattern.row_of, model.spinless, *_load_vectors(model), model.gravity,
              model.gravity_weight, model.constant_load, model.q0, model.v0, model.s0, model.slider_lengths,
              *(model.sleeves or ())[:5]]
    parts += [] if model.sleeves is None or not model.twisting.size else [*model.sleeves.twist[:3]]
    if model.slider_forces is not None:
        t = model.slider_forces.tables
        parts += [t.friction, t.viscous, t.smoothing, t.stops, t.drive, t.gains, t.given, model.limits_at(model.s0),
                  model.slider_forces.restitutions, model.slider_forces.plan]
    parts += [] if model.prescribed is None else [model.prescribed.own]
    parts += [] if model.released is None else model.released.arrays
    parts += [np.array([one.period, one.start, *one.memory]) for one in model.controllers]
    if model.motions is not None:
        holds = model.motions.holds
        parts += [*model.motions.table[:-2], holds.given, holds.rubs, holds.limits, holds.stopped, holds.stops, holds.shares,
                  holds.ends, holds.restitutions, holds.driven, holds.gains]
    if model.dragged is not None:
        parts += [model.dragged.node, model.dragged.coefficient, model.dragged.air]
        parts += [np.array([time is None for time in model.dragged.times])] if model.dragged.timed else []
        parts += [model.dragged.wind.first, model.dragged.wind.parameters] if model.dragged.windy else []
    parts += [] if model.added is None else [model.added.node, model.added.normal, model.added.along]
    parts += [x for feature in model.features for x in feature.constants]
    for x in parts:
        digest.update(b"-" if x is None else f"{x.dtype.str}{x.shape}".encode())
        if x is not None:
            digest.update(np.ascontiguousarray(x).reshape(-1).view(np.uint8))
    if model.spans:
        digest.update(model.slider_forces.choices.encode())
    digest.update(str([model.plane is None, *(time is None for time in (*model.load_times, model.gravity_time))]).encode())
    return digest.hexdigest()


def _load_vectors(model: Any) -> list[np.ndarray]:
    loads, count = model.loads, len(model.load_times)
    first = loads.first.reshape(min(count, 1), 8 * (model.n_nodes + 1))
    return [first] if count < 2 else [first, loads.vector, loads.row, loads.value]
