"""Ground: points that are fixed in space, as partners of links and joints."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Vector, checked, constant
from fastbeam.scene.beams import NodeRef
from fastbeam.scene.checks import Array

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class Ground:
    """Ground, which is fixed in space. There is one, `GROUND`; it need not be added to a scene.

    A joint with axes takes `GROUND` itself and lies where its other side is; a spring or distance joint needs a point of it.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, RevoluteJoint, RigidBody
    >>> arm = RigidBody('arm', mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.5, 0, 0))
    >>> RevoluteJoint(GROUND, arm.point((-0.5, 0, 0)), 'pivot', axis=(0, 0, 1)).a
    <ground at (0, 0, 0) m>
    """

    kind: ClassVar[str] = "ground"
    label: ClassVar[str] = "ground"
    directors: ClassVar[Array] = constant(np.eye(3))

    @checked(position=Vector)
    def point(self, position: ArrayLike) -> NodeRef:
        """Return the point at `position` (3,) m in space. Raises SceneError: the position is not 3 finite numbers."""
        return NodeRef(self, 0, position)

    def __repr__(self) -> str:
        return "<ground>"

    def __reduce__(self) -> Any:
        # copies of a scene share the one ground
        return "GROUND" if type(self) is Ground else (type(self), ())


GROUND = Ground()
