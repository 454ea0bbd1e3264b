"""Sleeves of a scene: the triad of every holder in the direction of its beam, and the conditions for NumPy."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.coulomb import coulomb_of
from fastbeam.kernels.contact.sleeve import NoTwist, Sleeves
from fastbeam.kernels.contact.sleeve_twist import TWIST, Twist
from fastbeam.kernels.empty_arrays import empty
from fastbeam.model.analyses import Analysis, Asked, Lack, unknown_to_methods
from fastbeam.model.connections import Connections
from fastbeam.model.contact.sleeve_conditions import Section
from fastbeam.model.contact.sleeve_twist import TwistFriction
from fastbeam.model.feature import Feature
from fastbeam.model.mapping import nodes_of_curve
from fastbeam.model.model import Model
from fastbeam.model.numbering import NodeList
from fastbeam.model.plane import Plane, numbers_of, to_plane
from fastbeam.scene import Scene, Sleeve

Array = np.ndarray
Line = tuple[Array, Array, Array, int]
# largest angle between the axis= of a sleeve and its beam, rad
ALIGNED = 1e-6


def sleeves_of(scene: Scene, nodes: NodeList, joints: int) -> Sleeves | None:
    """Build the table of all sleeves; joints: number of those with multipliers, whose constraints come before. Raises SceneError:
    the axis of a sleeve is not that of its beam."""
    if not scene.sleeves:
        return None
    of_slider = np.full(len(scene.sliders), -1, np.int64)
    axes = []
    for k, slider in enumerate(scene.sliders):
        if isinstance(slider, Sleeve):
            of_slider[k] = len(axes)
            axes.append(_axes(slider, nodes))
    keyed = np.array([sleeve.keyed for sleeve in scene.sleeves], np.int64)
    edges = np.array([(2.0 / sleeve.length if sleeve.length else 0.0, 1.0 / sleeve.key_radius if sleeve.key_radius else 0.0)
                      for sleeve in scene.sleeves])
    return Sleeves(of_slider, np.array([len(scene.sliders) + joints]), keyed, np.concatenate(axes).reshape(-1),
                   edges.reshape(-1), NoTwist())


class SleeveContact(Feature):
    """Sleeves, which turn with the beam."""

    key, title, order = "sleeve_contact", "sleeves", 160
    lacks = (unknown_to_methods("sleeves"),
             Lack((Analysis.EXACT,), "friction",
                  "{who}: sleeve {name!r} has friction, which only contacts='mesh' supports",
                  "lock it at its place with held=({name!r},), or leave contacts= out",
                  lambda contact, asked: contact.rubbing(asked)))

    def __init__(self, sleeves: list[Any]) -> None:
        self.sleeves = sleeves

    def rubbing(self, asked: Asked) -> list[str]:
        """Return the names of the sleeves that friction may hold."""
        forces = asked.model.slider_forces
        free = np.zeros(asked.held.size, bool) if forces is None else forces.hold_by_friction & ~asked.held
        return [forces.sliders[k].name for k in np.flatnonzero(free) if isinstance(forces.sliders[k], Sleeve)]


def twist_friction_of(scene: Scene) -> TwistFriction | None:
    """Build the feature of friction against twist in sleeves (radius=); None without any."""
    found = [k for k, sleeve in enumerate(scene.sleeves) if sleeve.radius is not None]
    return TwistFriction(np.array(found, np.int64), [scene.sleeves[k].name for k in found]) if found else None


def with_twist(scene: Scene, model: Model) -> Sleeves | None:
    """Return the sleeves of a model with their friction against twist."""
    table = model.sleeves
    if table is None or not model.twisting.size:
        return table
    every: list[Any] = list(scene.sleeves)
    n = len(every)
    arm = np.array([x.friction.coefficient * x.radius if x.radius is not None else 0.0 for x in every])
    place = np.full(n, -1, np.int64)
    place[model.twisting] = model.place("twist") + TWIST * np.arange(model.twisting.size)
    inertia = np.full(n, model.mass * model.length**2)
    work = *empty((3, n)), empty(2 * n), coulomb_of(inertia), empty(1)
    return table._replace(twist=Twist(arm, place, table.axes.copy(), *work))


def sections_in_sleeves(scene: Scene, nodes: NodeList, joints: Connections, lines: list[Line]) -> list[tuple[int, Section]]:
    """Return the number of the slider and the section at t = 0 of every sleeve."""
    out = []
    for k, (slider, (number, values, slopes, point)) in enumerate(zip(scene.sliders, lines)):
        if isinstance(slider, Sleeve):
            turn = _axes(slider, nodes)
            every = np.append(number, point)
            out.append((k, Section(every, joints.spin_root[every], np.stack((values, slopes)), nodes.directors[number], turn,
                                   turn @ nodes.directors[point], 3 if slider.keyed else 2)))
    return out


def _axes(sleeve: Sleeve, nodes: NodeList) -> Array:
    """Return R [3, 3] with D_i = sum_k R_ik d_k of the holder, so that the conditions of a keyed sleeve hold at t = 0."""
    d = sleeve.section_at_start
    if d is None:
        first, values, _ = sleeve.contact_curve.evaluate(sleeve.at)
        keep = np.flatnonzero(values[0])
        d = np.einsum("a,ajc->jc", values[0, keep], nodes.directors[nodes.start(sleeve.beam) + int(first[0]) + keep])
    # exact for directors that are not orthonormal, as between the nodes of a curved beam
    axis = np.cross(d[1], d[2])
    axis /= np.linalg.norm(axis)
    second = d[1] + np.cross(d[2], axis)
    second /= np.linalg.norm(second)
    triad = nodes.directors[nodes.number(sleeve.point)]
    axes = np.stack((axis, second, np.cross(axis, second))) @ triad.T
    if sleeve.axis is not None:
        given = sleeve.axis / np.linalg.norm(sleeve.axis)
        angle = float(np.arctan2(np.linalg.norm(np.cross(given, axes[0])), given @ axes[0]))
        if min(angle, np.pi - angle) > ALIGNED:
            raise SceneError(f"sleeve {sleeve.name!r}: its axis and {sleeve.beam.label} at={sleeve.at:.6g} make an angle of "
                             f"{np.degrees(angle):.6g} degrees at t = 0 (allowed: {np.degrees(ALIGNED):.2g}). Turn "
                             f"{sleeve.point.owner.label} or the beam, or leave axis out: the sleeve then takes the direction of "
                             "the beam")
    return axes


def sleeves_in_plane(model: Model, plane: Plane) -> tuple[Sleeves | None, Array]:
    """Return the table for nodes with 3 unknowns, and for every sleeve its three multipliers in space for a unit one in the
    plane, [O, 3]. There D_1 . J u(s) = 0 holds with u = d_1; d_2 = cos J u + sin n and d_3 = - sin J u + cos n of space."""
    sleeves: Any = model.sleeves
    if sleeves is None:
        return None, np.zeros((0, 3))
    assert model.curves is not None and model.sliders is not None
    sliders = model.sleeve_pairs[:, 0]
    holder = model.sliders.point[sliders]
    q = model.q0.reshape(-1, 4, 3)
    axis = np.einsum("ok,okc->oc", sleeves.axes.reshape(-1, 3, 3)[:, 0], q[holder, 1:])
    flat = to_plane(q[:, 1:], plane.axes)
    k = np.argmax(np.abs(plane.factor), axis=1)[holder]
    u = flat[holder, k] / plane.factor[holder, k]
    beam = np.array([nodes_of_curve(model.curves, int(c))[0] for c in model.sliders.curve[sliders]])
    cos, sin = plane.factor[beam, 1].imag, plane.normal[beam, 1]
    turn = to_plane(axis, plane.axes) * np.conj(u) / np.abs(u)
    return (sleeves._replace(axes=numbers_of(turn / np.abs(turn)), twist=NoTwist()),
            np.stack((cos, -sin, np.zeros(len(cos))), axis=1))
