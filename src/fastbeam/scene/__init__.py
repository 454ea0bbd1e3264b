"""The nouns of a scene: what a user writes. They hold validated data only; `compile_scene` turns them into tables."""
from __future__ import annotations

from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bushing import Bushing
from fastbeam.scene.compound_joints import CylindricalJoint, PlanarJoint, SphericalJoint, UniversalJoint
from fastbeam.scene.controller import Controller
from fastbeam.scene.crossings import Crossing
from fastbeam.scene.curves import Arc, FittedCurve, Helix, StraightLine
from fastbeam.scene.distance_joint import DistanceJoint
from fastbeam.scene.added_mass import AddedMass
from fastbeam.scene.drag import Drag
from fastbeam.scene.fixed import GROUND
from fastbeam.scene.joints import PrismaticJoint, RevoluteJoint
from fastbeam.scene.force_element import ForceElement
from fastbeam.scene.line_force import LineForce
from fastbeam.scene.locks import Lock, OneSided, Release
from fastbeam.scene.moving_mesh import MovingMesh
from fastbeam.scene.nets import Net, NetBeam
from fastbeam.scene.parts import (
    BallJoint, DistributedLoad, InitialVelocity, Load, PointMass, RigidBody, RigidConnection, RigidMotion,
)
from fastbeam.scene.paths import Path
from fastbeam.scene.prescribed import PrescribedMotion, Signal
from fastbeam.scene.scene import Scene
from fastbeam.scene.sections import Section
from fastbeam.scene.sleeves import Sleeve
from fastbeam.scene.sliders import Slider
from fastbeam.scene.sliding import Drive, Friction, Stops
from fastbeam.scene.spring import Damper, Spring
from fastbeam.scene.supports import Clamp, Pin
from fastbeam.scene.switches import Switch
from fastbeam.scene.user_force import UserForce
from fastbeam.scene.winch import Winch

__all__ = [
    "AddedMass", "Arc", "BallJoint", "Beam", "Bushing", "Clamp", "Controller", "Crossing", "CylindricalJoint", "Damper",
    "DistanceJoint", "DistributedLoad", "Drag", "Drive", "FittedCurve", "ForceElement", "Friction", "GROUND", "Helix",
    "InitialVelocity",
    "LineForce", "Load", "Lock", "MovingMesh", "Net", "NetBeam", "NodeRef", "OneSided", "Path", "Pin", "PlanarJoint", "PointMass",
    "PrescribedMotion", "PrismaticJoint", "Release", "RevoluteJoint", "RigidBody", "RigidConnection", "RigidMotion", "Scene",
    "Section", "Signal", "Sleeve", "Slider", "SphericalJoint", "Spring", "Stops", "StraightLine", "Switch", "UniversalJoint",
    "UserForce", "Winch",
]
