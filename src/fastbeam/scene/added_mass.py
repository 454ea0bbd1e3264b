"""Mass of the fluid that beams, nets, bodies and masses carry along."""
from __future__ import annotations

from dataclasses import KW_ONLY
from typing import ClassVar

from fastbeam.interface.arguments import Name, Number, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene.beams import Beam
from fastbeam.scene.bodies import PointMass, RigidBody
from fastbeam.scene.checks import Named, noun
from fastbeam.scene.drag import as_in_air
from fastbeam.scene.nets import Net

NOT_NEGATIVE = Number(least=0.0)


@checked(name=Name(), on=as_in_air, normal=NOT_NEGATIVE, tangential=NOT_NEGATIVE)
@noun
class AddedMass(Named):
    """Mass of fluid that a part carries along (theory.md (4.34)): 1/2 v . (m_n I + (m_t - m_n) d1 d1) v in the kinetic energy.

    It turns with the section: across d1 it is `normal`, along d1 `tangential`. It has no weight. On beams and nets both are
    those of a length, and stand at the nodes; on bodies they stand at the centre, d1 the first axis of the body.

    Parameters
    ----------
    name : str
    on : Beam, Net, RigidBody, PointMass
    normal, tangential : float
        Across and along d1, kg/m, of a body kg; >= 0. Of a round cylinder of diameter d in a fluid of the density rho across it
        is rho pi d^2/4 and along it next to nothing. A PointMass has no direction: give both, equal, half the displaced mass
        for a ball.

    Raises
    ------
    SceneError
        A coefficient is negative, both are zero, or those of a point mass differ.
    """

    kind: ClassVar[str] = "added mass"

    name: str
    on: Beam | Net | RigidBody | PointMass
    _: KW_ONLY
    normal: float = 0.0
    tangential: float = 0.0

    def __post_init__(self) -> None:
        if self.normal == self.tangential == 0.0:
            raise SceneError(f"{self.label}: give normal or tangential")
        if isinstance(self.on, PointMass) and self.normal != self.tangential:
            raise SceneError(f"{self.label}: {self.on.label} has no direction; give tangential={self.normal:g}, equal to normal, "
                             "or use a RigidBody")

    @property
    def is_slender(self) -> bool:
        """True if coefficients are per length."""
        return isinstance(self.on, (Beam, Net))
