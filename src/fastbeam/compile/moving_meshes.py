"""Scenes with beams whose elements move with contacts: what the compiler makes of them (theory.md 5.12)."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fastbeam.compile.condense import Condensed
from fastbeam.compile.order import Ordered
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.contact.slider import Following
from fastbeam.model.contact.moving_meshes import Moving, count_of_momenta
from fastbeam.model.contact.moving_tables import Mesh
from fastbeam.model.contact.sliders import SlidingContact
from fastbeam.model.tables import TablePool
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


def meshes_of(scene: Scene) -> tuple[Scene, list[Mesh]]:
    """Return a scene without its parts `MovingMesh`, and these. Raises SceneError: names a part that moving meshes do not
    know."""
    parts = [part for part in scene.parts if isinstance(part, MovingMesh)]
    if not parts:
        return scene, []
    _refuse(scene, parts)
    fields = [InitialVelocity(part.beam, velocity=part.velocity or (0, 0, 0), spin=part.spin or (0, 0, 0)) for part in parts
              if part.velocity is not None or part.spin is not None]
    out = Scene(*(part for part in scene.parts if not isinstance(part, MovingMesh)), *fields, name=scene.name,
                gravity=scene.gravity, gravity_time=scene.gravity_time, project_velocities=scene.project_velocities)
    return out, [Mesh(part.beam, list(part.sliders)) for part in parts]


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


def moving_tables(condensed: Condensed, ordered: Ordered) -> list[ElementTables]:
    """Pack the element tables of beams whose elements move, in the order of their packers."""
    row_of, out = ordered.blocks.pattern.row_of, []
    at = sum(packer.n_blocks for packer in condensed.packers.values())
    for packer in condensed.moving:
        out.append(packer.tables(row_of, ordered.blocks.element[at:at + packer.n_blocks], TablePool()))
        at += packer.n_blocks
    return out


def with_tables(model: Any, scene: Scene, meshes: list[Mesh], tables_of: list[ElementTables], own: dict[Beam, Beam]) -> Any:
    """Return the model with the terms of its moving meshes and the velocities at the start; tables_of: of the elements of every
    mesh, in the order of the beams of the scene; own: beams that the user knows, by those in their place."""
    if not meshes:
        return model
    numbers, number = model.numbers, {slider: k for k, slider in enumerate(scene.sliders)}
    every = [slider for mesh in meshes for slider in mesh.sliders]
    around = [(mesh, nodes + numbers.start(mesh.beam)) for mesh in meshes for nodes in mesh.around()]
    count, most = len(every), max(x.size for _, x in around)
    at, nodes, pairs = np.full((len(scene.sliders), 4), -1), np.full((count, most), -1), []
    pair = np.full(count, -1)
    two = np.zeros((count, 2))
    ends = np.array([np.count_nonzero((x - numbers.start(mesh.beam)) % mesh.beam.degree == 0) for mesh, x in around])
    following = Following(at, nodes, ends, np.zeros((count, most, 12)), np.zeros((count, 3)), two, np.zeros((count, 6)),
                          np.zeros((count, most)), pair, two, np.ones(1), np.zeros((count, 4), np.int64),
                          np.concatenate([mesh.reach for mesh in meshes]), np.zeros((count, 5)))
    place, first, tables, contacts = model.place_for(Moving), 0, [], []
    moved = {mesh.beam for mesh in meshes}
    of_beam = dict(zip((beam for beam in scene.beams if beam in moved), tables_of, strict=True))
    for mesh in meshes:
        sliders = np.array([number[slider] for slider in mesh.sliders])
        table = mesh.table(numbers, of_beam[mesh.beam], model.gravity, sliders, following)
        table.place[0], table.place[3], table.first[0] = place, len(pairs), first
        momenta = count_of_momenta(table)
        for k, slider in enumerate(sliders):
            at[slider, :3] = first + k, mesh.contacts[k], place + momenta + k
            if k + 1 < sliders.size:
                pair[first + k] = len(model.sleeve_pairs) + len(pairs)
                pairs.append((slider, sliders[k + 1]))
        contacts += (numbers.start(mesh.beam) + mesh.contacts).tolist()
        place, first = place + momenta + sliders.size + 1, first + sliders.size
        tables.append(table)
    for k, (_, x) in enumerate(around):
        nodes[k, :x.size] = x
    moving = Moving(tuple(tables), [slider.name for slider in every], following, np.array([number[x] for x in every]),
                    np.array(contacts), np.array(pairs, np.int64).reshape(-1, 2), np.zeros(count),
                    tuple(own.get(mesh.beam, mesh.beam) for mesh in meshes), scene.gravity_time, np.zeros(len(meshes)))
    places = {numbers.start(there): given.node_s.tolist() for there, given in own.items()}
    beams = [entry | {"s": places[entry["first"]]} if entry["first"] in places else entry for entry in model.names["beams"]]
    model = replace(model, names=model.names | {"beams": beams})
    # meshes move with the contacts, which the initial velocities of the material do not know
    v, rates = moving.with_mesh(model, model.q0, model.s0, model.v0)
    model = replace(model.with_features(replace(moving, rates=rates)), v0=v)
    return replace(model, features=tuple(x.with_following(following) if isinstance(x, SlidingContact) else x
                                         for x in model.features))
