"""Scenes with beams whose elements move with contacts: what the compiler makes of them (theory.md 5.12)."""
from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider import Following
from fastbeam.model.contact.moving_meshes import Moving
from fastbeam.model.contact.moving_tables import Mesh
from fastbeam.model.contact.sliders import SlidingContact
from fastbeam.scene import (
    BallJoint,
    Beam,
    Bushing,
    Clamp,
    CylindricalJoint,
    Damper,
    DistanceJoint,
    InitialVelocity,
    Load,
    MovingMesh,
    Pin,
    PlanarJoint,
    PointMass,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    RigidConnection,
    RigidMotion,
    Scene,
    Sleeve,
    Slider,
    SphericalJoint,
    Spring,
    UniversalJoint,
)

Array = np.ndarray
JOINTS = (RevoluteJoint, PrismaticJoint, CylindricalJoint, PlanarJoint, UniversalJoint, SphericalJoint)
TAKEN = (Beam, PointMass, RigidBody, BallJoint, RigidConnection, DistanceJoint, *JOINTS, Clamp, Pin, Load, Slider, Spring, Damper,
         Bushing, InitialVelocity, RigidMotion, MovingMesh)


class Rewritten(NamedTuple):
    """Scene that is compiled, and its moving meshes."""

    scene: Scene
    meshes: list[Mesh]


def rewrite(scene: Scene) -> Rewritten | None:
    """Return a scene without its parts `MovingMesh`, and these; None without moving meshes. Raises SceneError: names a part that
    moving meshes do not know."""
    parts = [part for part in scene.parts if isinstance(part, MovingMesh)]
    if not parts:
        return None
    _refuse(scene, parts)
    fields = [InitialVelocity(part.beam, velocity=part.velocity or (0, 0, 0), spin=part.spin or (0, 0, 0)) for part in parts
              if part.velocity is not None or part.spin is not None]
    out = Scene(*(part for part in scene.parts if not isinstance(part, MovingMesh)), *fields, name=scene.name,
                gravity=scene.gravity, gravity_time=scene.gravity_time, project_velocities=scene.project_velocities)
    out.check()
    meshes = [Mesh(part.beam, list(part.sliders)) for part in parts]
    return Rewritten(out, meshes)


def _refuse(scene: Scene, parts: list[MovingMesh]) -> None:
    who = f"compile_scene: {parts[0].label}"
    beams = [part.beam for part in parts]
    if len(set(beams)) < len(beams):
        raise SceneError(f"{who}: a beam has two moving meshes; name all its sliders in one MovingMesh")
    for slider in scene.sliders:
        if sum(slider in part.sliders for part in parts) != 1:
            raise SceneError(f"{who}: slider {slider.name!r} belongs to no MovingMesh, or to several. In a scene with moving "
                             "meshes each slider needs exactly one: name it in a MovingMesh, or use with_moving_meshes(scene)")
    for part in parts:
        for slider in part.sliders:
            if slider not in scene.sliders:
                raise SceneError(f"{part.label}: slider {slider.name!r} is not in {scene.label}; add it to the scene")
            if any(slider.point.owner is beam for beam in beams) and not _is_end(slider.point):
                raise SceneError(f"{part.label}: slider {slider.name!r}: {slider.point} is an inner node of a beam with a moving "
                                 "mesh; slide its ends, or nodes of other beams")
    for x in scene.parts:
        if type(x) not in TAKEN and not isinstance(x, Sleeve):
            raise SceneError(f"{who}: scenes with moving meshes do not support {getattr(x, 'kind', type(x).__name__)} "
                             f"{getattr(x, 'name', '')!r}; leave it out, or leave the moving mesh out")
        if isinstance(x, Load) and x.follower:
            raise SceneError(f"{who}: scenes with moving meshes do not support follower load {x.name!r}; leave follower out")
        if isinstance(x, Pin | Clamp) and (x.until is not None or x.since is not None):
            raise SceneError(f"{who}: {x.name!r} is released or engages during the run, which scenes with moving meshes do not "
                             "support; leave until and since out")
        for node in _inner(x, beams):
            raise SceneError(f"{who}: {x.kind} {getattr(x, 'name', '')!r} is at {node}, which moves along the beam; only the "
                             "ends of this beam can be supported, joined and loaded")


def _inner(part: Any, beams: list[Beam]) -> list[Any]:
    """Return the nodes inside beams with moving meshes that a part refers to."""
    found = [getattr(part, name, None) for name in ("at", "a", "b")] if not isinstance(part, (Slider, Beam)) else []
    return [node for node in found if any(getattr(node, "owner", None) is beam for beam in beams) and not _is_end(node)]


def _is_end(node: Any) -> bool:
    """Return whether a node of a beam is one of its ends, which stay the same material points."""
    return bool(node.index in (0, node.owner.n_nodes - 1))


def rates_of_places(model: Any, meshes: list[Mesh]) -> tuple[Array, Array]:
    """Return the rates of all coordinates [N, 4, 3] of the initial state of a model whose meshes stand, for meshes that move, and
    ds/dt of their contacts [F]: nodes move over the beam as the contacts do."""
    q, v = model.q0.reshape(-1, 4, 3), model.v0.reshape(-1, 4, 3).copy()
    every = []
    for mesh in meshes:
        first = model.numbers.start(mesh.beam)
        span = slice(first, first + mesh.beam.n_nodes)
        rates = np.zeros(len(mesh.sliders))
        for k, slider in enumerate(mesh.sliders):
            at = first + int(mesh.contacts[k])
            rates[k] = (v[model.numbers.number(slider.point), 0] - v[at, 0]) @ q[at, 1]
        along, d = mesh.way() @ rates, q[span, 1:]
        v[span, 0] += along[:, None] * np.einsum("i,nic->nc", mesh.reference[:3], d)
        v[span, 1:] += np.cross((along[:, None] * np.einsum("i,nic->nc", mesh.reference[3:], d))[:, None], d)
        # to the last bit, on curved beams too
        for k, slider in enumerate(mesh.sliders):
            v[first + int(mesh.contacts[k]), 0] = v[model.numbers.number(slider.point), 0]
        every.append(rates)
    return v, np.concatenate(every)


def with_tables(model: Any, scene: Scene, meshes: list[Mesh], blocks: Any) -> Any:
    """Return the model with the terms of its moving meshes and the velocities at the start."""
    if not meshes:
        return model
    numbers, number = model.numbers, {slider: k for k, slider in enumerate(scene.sliders)}
    every = [slider for mesh in meshes for slider in mesh.sliders]
    around = [nodes + numbers.start(mesh.beam) for mesh in meshes for nodes in mesh.around()]
    count, most = len(every), max(x.size for x in around)
    at, nodes, pairs = np.full((len(scene.sliders), 3), -1), np.full((count, most), -1), []
    pair = np.full(count, -1)
    following = Following(at, nodes, np.zeros((count, most, 12)), np.zeros((count, 2)), np.zeros((count, 2)), pair,
                          np.zeros((count, 2)))
    place, first, tables, contacts = model.place_for(Moving), 0, [], []
    for mesh in meshes:
        sliders = np.array([number[slider] for slider in mesh.sliders])
        table = mesh.table(numbers, blocks, model.pattern.row_of, model.gravity, sliders, following)
        table.place[0], table.place[3], table.first[0] = place, first + len(tables), first
        momenta = 12 * len(table.node) * table.mass_point.shape[1]
        for k, slider in enumerate(sliders):
            at[slider] = first + k, mesh.contacts[k], place + momenta + k
            if k + 1 < sliders.size:
                pair[first + k] = len(model.sleeve_pairs) + len(pairs)
                pairs.append((slider, sliders[k + 1]))
        contacts += (numbers.start(mesh.beam) + mesh.contacts).tolist()
        place, first = place + momenta + sliders.size + 1, first + sliders.size
        tables.append(table)
    for k, x in enumerate(around):
        nodes[k, :x.size] = x
    v, rates = rates_of_places(model, meshes)
    moving = Moving(tuple(tables), [slider.name for slider in every], following, np.array([number[x] for x in every]),
                    np.array(contacts), np.array(pairs, np.int64).reshape(-1, 2), rates, scene.gravity_time)
    model = replace(model.with_features(moving), v0=v.reshape(-1))
    return replace(model, features=tuple(x.with_following(following) if isinstance(x, SlidingContact) else x for x in model.features))
