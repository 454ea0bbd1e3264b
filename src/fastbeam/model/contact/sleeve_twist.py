"""Friction of beams that turn in unkeyed sleeves: tables, values at the start of a run, and rows (theory.md 5.8)."""
from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from fastbeam.kernels.contact.sleeve import KnownTwist, NoTwist, Rubbing, Sleeves
from fastbeam.kernels.contact.sleeve_twist import ANGLE, SIGN, STICKS, TWIST, Twist
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.model.analyses import Analysis, Lack, without_adjoint
from fastbeam.model.contact.sleeve_conditions import Section, sections
from fastbeam.model.feature import Feature
from fastbeam.model.mapping import contact
from fastbeam.model.model import Model

Array = np.ndarray
# largest difference, relative to 1 + angle, between an angle in the history and that of the coordinates of the same state, rad
STALE = 1e-11
# velocities below this share of the fastest motion count as zero
AT_REST = 1e-12


def sleeves_of_run(table: Sleeves, at_rest: bool = False) -> Sleeves:
    """Return the table with the arrays of one run; at_rest: in statics, where friction of twists fixes sections as keys do."""
    if at_rest:
        return table._replace(keyed=table.keyed.copy(), axes=table.axes.copy(), twist=NoTwist())
    if not isinstance(table.twist, Twist):
        return table
    return table._replace(axes=table.axes.copy(), twist=deepcopy(table.twist))


def rubbing(terms: tuple[Any, ...]) -> Sleeves | None:
    """Find the sleeves with friction against twist of their beams among the terms of a run; None without any."""
    return next((x.sleeves for x in terms if isinstance(x, Rubbing)), None)


def with_known_twist(terms: tuple[Any, ...], running: tuple[Any, ...]) -> tuple[Any, ...]:
    """Replace equations for moments of friction by the moments of the state; running: terms of the run, with the axes of
    sections."""
    sleeves = rubbing(running)
    if sleeves is None:
        return terms
    (own,) = [x for x in terms if isinstance(x, Sleeves)]
    known = own._replace(axes=sleeves.axes, twist=KnownTwist())
    return tuple(x._replace(sleeves=known) if isinstance(x, Sliding) else known if isinstance(x, Sleeves) else x
                 for x in terms if not isinstance(x, Rubbing))


class TwistFriction(Feature):
    """Friction of beams that turn in unkeyed sleeves.

    of: int64 [R], numbers of the sleeves.
    names: names of the sleeves.
    """

    key, title, order, is_told_first = "twist", "friction of beams that turn in sleeves (radius=)", 90, True
    lacks = (
        Lack((Analysis.EXACT, Analysis.RELAX, Analysis.PATH, Analysis.LENGTHS, Analysis.MODES, Analysis.TRAVEL,
              Analysis.SENSITIVITY), "friction",
             "{who}: sleeve {name!r} has friction of a beam that turns in it (radius=), which this analysis does not support",
             "leave radius out, or fix the twist by keyed=True. solve_static supports it, and so does a run until it comes to "
             "rest", lambda twist, asked: twist.names),
        without_adjoint("friction", lambda twist, asked: [f"friction of the beam that turns in sleeve {name!r} (radius=)"
                                                          for name in twist.names]))

    def __init__(self, of: Array, names: list[str]) -> None:
        self.of, self.names = of, names

    @property
    def history_size(self) -> int:
        """Number of history variables of all sleeves."""
        return TWIST * int(self.of.size)


def twist_label(slider: str) -> str:
    """Return the name of the twist in the sleeve of a slider, for messages about friction."""
    return f"{slider}: twist"


def numbers_of(model: Model, history: Array) -> Array:
    """Return the history variables of sleeves with friction against twist, float64 [R, 4], see kernels/contact/sleeve_twist.py: a
    view."""
    return model.own(history, "twist").reshape(-1, TWIST)


def _sine_and_cosine(axes: Array, d: Array) -> tuple[float, float]:
    """Return sine and cosine of the angle from D_2, D_3 to d_2, d_3, times the length of the latter; axes, d [3, 3]."""
    return float(axes[1] @ d[2] - axes[2] @ d[1]) / 2.0, float(axes[1] @ d[1] + axes[2] @ d[2]) / 2.0


def angle_of(section: Section, known: float) -> float:
    """Return the angle of a section in its sleeve, rad, on the turn nearest to `known`."""
    found = float(np.arctan2(*_sine_and_cosine(section.axes, np.einsum("a,ajc->jc", section.shapes[0], section.d))))
    return found + 2.0 * np.pi * float(np.round((known - found) / (2.0 * np.pi)))


def start_twisting(model: Model, history: Array, q: Array, v: Array, s: Array) -> None:
    """Update angles and signs of velocities in a history to coordinates q, v [N, 4, 3] and places s [S]. Sections that the run
    before left at rest stay at rest."""
    every = sections(model, s, q)
    fastest = float(np.max(np.abs(v), initial=0.0))
    for own, o in zip(numbers_of(model, history), model.twisting.tolist()):
        section, k = every[o], int(model.sleeve_pairs[o, 0])
        found = angle_of(section, float(own[ANGLE]))
        if abs(found - own[ANGLE]) > STALE * (1.0 + abs(found)):
            own[ANGLE] = found
        rate = rate_of(model, section, k, q, v, s, own[ANGLE])
        own[SIGN] = np.sign(rate) if abs(rate) > AT_REST * fastest and own[STICKS] == 0.0 else 0.0


def rate_of(model: Model, section: Section, k: int, q: Array, v: Array, s: Array, angle: float) -> float:
    """Return the velocity of the angle of a section in the sleeve of slider k, rad/s."""
    _, tangent, relative = contact(model, k, float(s[k]), q, v)
    along = float(relative @ tangent / (tangent @ tangent))
    d, slope = (np.einsum("a,ajc->jc", shapes, section.d) for shapes in section.shapes[:2])
    moving = np.einsum("a,ajc->jc", section.shapes[0], v[section.nodes[:-1], 1:]) + along * slope
    there = section.turned_by(angle)
    lead = _sine_and_cosine(there.turn @ v[section.nodes[-1], 1:], d)[0] + _sine_and_cosine(there.axes, moving)[0]
    return lead / _sine_and_cosine(there.axes, d)[1]


def angles(model: Model, history: Array) -> Array:
    """Return the angle by which the section has turned about d_1 in every sleeve since t = 0, rad, [O]; 0 without friction
    against twist."""
    out = np.zeros(len(model.sleeve_pairs))
    out[model.twisting] = -numbers_of(model, history)[:, ANGLE]
    return out


def push_of_twist(section: Section, angle: float) -> float:
    """Return the force along the beam, N, of a moment of friction of 1 N m: a beam with twist in its reference moves like a
    screw; angle: as in `angles`."""
    return float(section.turned_by(-angle).values(1)[2])
