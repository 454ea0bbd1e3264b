"""Columns whose unstable and free directions are known: any slenderness, mesh, section, orientation, unit, and what may spin."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import fastbeam as fb

# buckling lengths: roots u of u = L sqrt(F/EI), F = P (1 - P/EA + P/GA), of a column that is clamped below and free above, and of
# one that a strut holds there (tan u = u)
FREE = tuple((k - 0.5) * np.pi for k in range(1, 8))
PINNED = (4.493409457909064, 7.725251836937707, 10.904121659428899, 14.066193912831473, 17.220755271930768)


class Column(NamedTuple):
    """A column, what it carries, and how it is meshed."""

    kind: str              # 'bare', 'strut', 'loop' or 'body'
    slenderness: float     # length over radius of gyration about the softer axis
    ratio: float           # EI of the other axis over that of the softer one
    load: float            # P in critical loads of the first mode
    elements: int
    degree: int
    planar: bool
    turn: np.ndarray       # [3, 3]: directions of the two axes of the section and of the column, by rows
    length: float
    stiffness: float       # EI of the softer axis

    @property
    def scene(self) -> fb.Scene:
        """Its scene: the strut lies along the first axis, the body hangs on a ball joint below the top."""
        at = lambda *x: tuple(self.length * np.array(x) @ self.turn)  # noqa: E731
        cut = self._section(self.stiffness, self.ratio)
        column = fb.Beam.straight("column", at(0, 0, 0), at(0, 0, 1), section=cut, elements=self.elements, degree=self.degree,
                                  d2=tuple(self.turn[0]))
        parts: list[Any] = [column, fb.Clamp(column.start)]
        gravity = np.zeros(3)
        if self.kind in ("strut", "loop"):
            strut = fb.Beam.straight("strut", at(0, 0, 1), at(1, 0, 1), section=self._section(self.stiffness, 1.0), elements=3,
                                     degree=self.degree)
            parts += [strut, fb.BallJoint(column.end, strut.start)]
            if self.kind == "strut":
                parts.append(fb.Pin(strut.end))
            else:
                # a ball joint that closes a loop, held by multipliers
                post = fb.Beam.straight("post", at(1, 0, 0.95), at(1, 0, 1), section=self._section(self.stiffness, 1.0),
                                        elements=2)
                parts += [post, fb.Clamp(post.start), fb.BallJoint(post.end, strut.end)]
        if self.kind == "body":
            body = fb.RigidBody("body", mass=1.0, inertia=(0.01 * self.length**2, 0.02 * self.length**2, 0.015 * self.length**2),
                                position=at(0, 0, 0.8))
            gravity = -self.force * self.turn[2]
            parts += [body, fb.BallJoint(column.end, body.point(at(0, 0, 0.2)))]
        else:
            parts.append(fb.Load("P", column.end, force=tuple(-self.force * self.turn[2])))
        return fb.Scene(*parts, gravity=tuple(gravity))

    def _section(self, ei: float, ratio: float) -> fb.Section:
        ea = self.stiffness * self.slenderness**2 / self.length**2
        mass = 1e-20  # weighs nothing
        return fb.Section(EA=ea, GA2=0.4 * ea, GA3=0.4 * ea, GJ=0.8 * ei, EI2=ei * ratio, EI3=ei, rhoA=mass, rhoI2=mass,
                          rhoI3=mass)

    @property
    def _shear(self) -> float:
        """(1/GA - 1/EA) of the column."""
        return 1.5 * self.length**2 / (self.stiffness * self.slenderness**2)

    @property
    def force(self) -> float:
        """P, of which P + (1/GA - 1/EA) P^2 = load EI pi^2/(4 L^2)."""
        f = self.load * self.stiffness * (FREE[0] / self.length)**2
        return float(2.0 * f / (1.0 + np.sqrt(1.0 + 4.0 * self._shear * f)))

    @property
    def unstable(self) -> int:
        """Number of unstable directions."""
        u = FREE[0] * np.sqrt(self.load)
        soft, stiff = (sum(u > root for root in roots) for roots in self._roots())
        return int(soft if self.planar else soft + stiff)

    def _roots(self) -> tuple[np.ndarray, np.ndarray]:
        """Critical u of bending in direction of the first axis of the section (EI3), and of the other (EI2)."""
        along = PINNED if self.kind in ("strut", "loop") else FREE
        return np.array(along), np.array(FREE) * np.sqrt(self.ratio)

    @property
    def margin(self) -> float:
        """How far the load is from the next critical one, as a share."""
        u2 = FREE[0]**2 * self.load
        return float(min(np.min(np.abs(u2 / roots**2 - 1.0)) for roots in self._roots()))

    @property
    def free(self) -> int:
        """Number of free motions: the strut about its axis, the body about the vertical; in the plane neither."""
        return 0 if self.kind == "bare" or self.planar else 1


def drawn(seed: int, most_elements: int = 2048, most_slender: float = 1e5) -> Column:
    """A random one whose load is 5 % or more from all critical ones."""
    draw = np.random.default_rng(seed)
    kind = ("bare", "strut", "body", "loop")[seed % 4]
    elements = int(np.exp(draw.uniform(np.log(8), np.log(most_elements))) + 0.5)
    slenderness = float(np.exp(draw.uniform(np.log(10.0 if kind == "bare" else 300.0), np.log(most_slender))))
    planar = kind != "body" and draw.uniform() < 0.25
    turn = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    turn = np.eye(3) if planar else turn * np.linalg.det(turn)
    ratio = 1.0 if planar or draw.uniform() < 0.5 else float(draw.uniform(1.2, 4.0))
    degree = int(draw.choice([2, 3, 3, 3, 4]))
    length, stiffness = 10.0**draw.uniform(-2, 2), 10.0**draw.uniform(-4, 6)
    while True:
        load = float(draw.uniform(0.3, 12.0))
        found = Column(kind, slenderness, ratio, load, elements, degree, planar, turn, length, stiffness)
        if found.margin > 0.05:
            return found


def counted(column: Column) -> tuple[int, int]:
    """Unstable and free directions of its equilibrium."""
    model = fb.compile_scene(column.scene, planar=column.planar)
    info = fb.solve_static(model, load_step=1.0).info
    return info["unstable_directions"], info["free_directions"]
