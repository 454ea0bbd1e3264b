"""The public names of this package and where they are, for type checkers and for its `__getattr__`."""
from fastbeam.scene.added_mass import AddedMass as AddedMass
from fastbeam.scene.beams import Beam as Beam
from fastbeam.scene.beams import NodeRef as NodeRef
from fastbeam.scene.bodies import (
    BallJoint as BallJoint,
)
from fastbeam.scene.bodies import (
    DistributedLoad as DistributedLoad,
)
from fastbeam.scene.bodies import (
    InitialVelocity as InitialVelocity,
)
from fastbeam.scene.bodies import (
    Load as Load,
)
from fastbeam.scene.bodies import (
    PointMass as PointMass,
)
from fastbeam.scene.bodies import (
    RigidBody as RigidBody,
)
from fastbeam.scene.bodies import (
    RigidConnection as RigidConnection,
)
from fastbeam.scene.bodies import (
    RigidMotion as RigidMotion,
)
from fastbeam.scene.bushing import Bushing as Bushing
from fastbeam.scene.compound_joints import (
    CylindricalJoint as CylindricalJoint,
)
from fastbeam.scene.compound_joints import (
    PlanarJoint as PlanarJoint,
)
from fastbeam.scene.compound_joints import (
    SphericalJoint as SphericalJoint,
)
from fastbeam.scene.compound_joints import (
    UniversalJoint as UniversalJoint,
)
from fastbeam.scene.controller import Controller as Controller
from fastbeam.scene.crossings import Crossing as Crossing
from fastbeam.scene.distance_joint import DistanceJoint as DistanceJoint
from fastbeam.scene.drag import Drag as Drag
from fastbeam.scene.fixed import GROUND as GROUND
from fastbeam.scene.force_element import ForceElement as ForceElement
from fastbeam.scene.gear_coupling import GearCoupling as GearCoupling
from fastbeam.scene.joints import PrismaticJoint as PrismaticJoint
from fastbeam.scene.joints import RevoluteJoint as RevoluteJoint
from fastbeam.scene.line_force import LineForce as LineForce
from fastbeam.scene.locks import Lock as Lock
from fastbeam.scene.locks import OneSided as OneSided
from fastbeam.scene.locks import Release as Release
from fastbeam.scene.moving_mesh import MovingMesh as MovingMesh
from fastbeam.scene.nets import Net as Net
from fastbeam.scene.paths import Path as Path
from fastbeam.scene.prescribed_motion import PrescribedMotion as PrescribedMotion
from fastbeam.scene.prescribed_motion import Signal as Signal
from fastbeam.scene.scene import Scene as Scene
from fastbeam.scene.screw_joint import ScrewJoint as ScrewJoint
from fastbeam.scene.sections import Section as Section
from fastbeam.scene.sleeves import Sleeve as Sleeve
from fastbeam.scene.slider_forces import Drive as Drive
from fastbeam.scene.slider_forces import Friction as Friction
from fastbeam.scene.slider_forces import Stops as Stops
from fastbeam.scene.sliders import Slider as Slider
from fastbeam.scene.spring import Damper as Damper
from fastbeam.scene.spring import Spring as Spring
from fastbeam.scene.supports import Clamp as Clamp
from fastbeam.scene.supports import Pin as Pin
from fastbeam.scene.switches import Switch as Switch
from fastbeam.scene.user_force import UserForce as UserForce
from fastbeam.scene.winch import Winch as Winch
