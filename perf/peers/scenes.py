"""Numbers of the two scenes in SI units: one home for every program, so that each script only maps them to its own objects.

Needs nothing but Python: it is imported inside the environments of the peers.
"""
from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Section:
    """Section of a beam, the same in both transverse directions.

    Parameters
    ----------
    EA, GA, GJ, EI : float
        Axial, shear, torsion and bending stiffness.
    rhoA, rhoI, rhoJ : float
        Mass per length; rotary inertia per length about a transverse axis and about the axis of the beam.
    """

    EA: float
    GA: float
    GJ: float
    EI: float
    rhoA: float
    rhoI: float
    rhoJ: float


class Spaghetti:
    """Free beam after Simo and Vu-Quoc (1988): an end is pushed and turned by a triangular pulse, then the beam flies freely.

    Force and moment act in fixed directions on the end at `START`; kinks of the pulse lie at 0, 2.5 and 5 s.
    """

    START = (6.0, 0.0, 0.0)
    END = (0.0, 8.0, 0.0)
    LENGTH = 10.0
    SECTION = Section(EA=1e4, GA=1e4, GJ=500.0, EI=500.0, rhoA=1.0, rhoI=10.0, rhoJ=20.0)
    FORCE = (20.0, 0.0, 0.0)
    MOMENT = (0.0, -100.0, -200.0)
    PEAK = 2.5
    T_END = 5.0

    @classmethod
    def pulse(cls, t: float) -> float:
        """Factor of force and moment at time t."""
        return max(0.0, min(t / cls.PEAK, 2.0 - t / cls.PEAK))


class Sliding:
    """Point mass that slides without friction on a beam with both ends pinned, under gravity along -y.

    The beam lies straight along x and at rest; the mass starts on it at `START` with velocity `SPEED` along it.
    """

    LENGTH = 2.0
    SECTION = Section(EA=2.5e4, GA=1e4, GJ=10.0, EI=10.0, rhoA=1.0, rhoI=1e-3, rhoJ=2e-3)
    MASS = 1.0
    GRAVITY = 9.81
    START = 0.2
    SPEED = 1.0
    T_END = 1.0
    # a beam without shear strain and rotary inertia, such as Exudyn's cables, is the limit GA to infinity, rhoI to 0
    CABLE_GA = 1e8
    CABLE_RHOI = 1e-7
