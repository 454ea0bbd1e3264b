"""Cross-sections: stiffness and inertia of a beam per unit length."""
from __future__ import annotations

import math
from dataclasses import KW_ONLY, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import LARGEST, SMALLEST, Number, Numbers, Refusal, Word, checked, constant, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.checks import Array, Takes, noun

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

STIFFNESS = ("EA", "GA2", "GA3", "GJ", "EI2", "EI3")
# 31/32 zeta(5) = sum of 1/n^5 over odd n
ODD_FIFTH_POWERS = 31.0 / 32.0 * 1.0369277551433699
LENGTH, FACTOR = Number(above=0.0, unit="m"), Number(above=0.0)
MASS, INERTIA = Number(above=0.0, unit="kg/m"), Number(least=0.0, unit="kg m")


def as_damping(value: Any) -> float | Array:
    """Check of a retardation time, six of them, or a viscosity matrix: a number, an array (6,) or (6, 6)."""
    found = numbers(value)
    if found is None or found.shape not in ((), (6,), (6, 6)) or not np.all(np.abs(found) <= LARGEST):
        raise Refusal("must be a retardation time in s, six of them, or a viscosity matrix (6, 6), finite numbers, got "
                      f"{shown(value)}")
    if found.ndim < 2:
        if np.any(found < 0.0) or np.any((found != 0.0) & (found < SMALLEST)):
            raise Refusal(f"must be a retardation time >= 0 s, got {shown(value)}; less than {SMALLEST:g} s counts as none: "
                          "write 0")
        return float(found) if found.ndim == 0 else constant(found)
    _, skew, least = checks.symmetry(found)
    if skew > 1e-9:
        raise Refusal(f"a matrix must be symmetric, but differs from its transpose by {skew:.3g} of its diagonal")
    if least < -1e-12:
        raise Refusal("a matrix must be positive semidefinite, because others add energy; its smallest eigenvalue is "
                      f"{least:.3g} (after scaling to a unit diagonal)")
    return constant(0.5 * (found + found.T))


DAMPING = as_damping
MATERIAL = {"E": Number(above=0.0, unit="N/m^2"), "G": Number(above=0.0, unit="N/m^2"), "rho": Number(above=0.0, unit="kg/m^3"),
            "nu": Number(), "shear_factor": FACTOR, "damping": DAMPING, "name": Word()}


class SectionLaw:
    """Base class for laws of sections from outside the package: stresses added to C E, each a function of its strain
    (docs/extending.md)."""

    kind: ClassVar[str] = "section law"  # noun in messages
    term: ClassVar[Any] = None  # instance of the named tuple for which the kernels of the law are registered

    @property
    def parameters(self) -> Array:
        """Numbers of the kernels for each strain (6, 4), in the order of C; a strain with zeros has no added stress."""
        return np.zeros((6, 4))


def as_law(value: Any) -> SectionLaw:
    """Check of a section law."""
    if not isinstance(value, SectionLaw):
        raise Refusal(f"must be an object of a class derived from fastbeam.extend.SectionLaw, got {shown(value)}")
    return value


@checked(**dict.fromkeys(STIFFNESS, FACTOR), rhoA=MASS, rhoI2=INERTIA, rhoI3=INERTIA, damping=DAMPING, name=Word(), law=as_law)
@noun
class Section:
    """Stiffness and inertia of a cross-section; d2 and d3 are its principal axes, X2 and X3 the coordinates along them.

    Parameters
    ----------
    EA, GA2, GA3 : float
        Axial stiffness and shear stiffness along d2 and d3 (shear factors included), N, > 0.
    GJ, EI2, EI3 : float
        Torsion stiffness, bending stiffness about d2 (E int X3^2 dA) and about d3 (E int X2^2 dA), N m^2, > 0.
    rhoA : float
        Mass per length, kg/m, > 0.
    rhoI2, rhoI3 : float
        rho int X2^2 dA and rho int X3^2 dA (theory.md (1.2)), kg m, >= 0. They weigh the velocities of d2 and d3.
    damping : float, (6,) or (6, 6)
        Damping of Kelvin and Voigt (theory.md (2.5)): a retardation time, s, >= 0; one of every strain in the order of C; or D,
        symmetric, not negative, N s to N m^2 s.
    name : str
        Shown in messages.
    law : SectionLaw, optional
        Law from outside the package with stresses that are nonlinear in the strains, in addition to C E (docs/extending.md).

    Raises
    ------
    SceneError
        A value is not finite or out of range.
    """

    kind: ClassVar[str] = "section"

    _: KW_ONLY
    EA: float
    GA2: float
    GA3: float
    GJ: float
    EI2: float
    EI3: float
    rhoA: float
    rhoI2: float
    rhoI3: float
    damping: Takes[ArrayLike, float | Array] = 0.0
    name: str = ""
    law: SectionLaw | None = None
    _matrix: Array | None = field(default=None, repr=False)
    _outline: tuple[float, float, bool] | None = field(default=None, repr=False)

    @checked(law=as_law)
    def with_law(self, law: SectionLaw) -> Section:
        """Return the section with a law that adds stresses. Raises SceneError: it is no `SectionLaw`."""
        return replace(self, law=law)

    @property
    def C(self) -> Array:
        """Stiffness matrix (6, 6) in the order Gamma1, Gamma2, Gamma3, K1, K2, K3 (theory.md (2.3)); a fresh copy."""
        if self._matrix is not None:
            return self._matrix.copy()
        return np.diag([self.EA, self.GA2, self.GA3, self.GJ, self.EI2, self.EI3])

    @property
    def D(self) -> Array:
        """Viscosity matrix (6, 6) of theory.md (2.5); a fresh copy."""
        if np.ndim(self.damping) == 2:
            return np.array(self.damping)
        root = np.sqrt(np.broadcast_to(self.damping, 6))
        return self.C * np.outer(root, root)

    @property
    def couples(self) -> bool:
        """True when stiffness or damping couples two strains."""
        D = self.D
        return not self.is_diagonal or bool(np.any(D - np.diag(np.diag(D))))

    @property
    def is_diagonal(self) -> bool:
        """True when the stiffness couples no two strains."""
        return self._matrix is None or not np.any(self._matrix - np.diag(np.diag(self._matrix)))

    @property
    def is_isotropic(self) -> bool:
        """True when turning the section about the axis of a beam changes none of its stiffness."""
        return self.is_diagonal and math.isclose(self.GA2, self.GA3, rel_tol=1e-12) and math.isclose(self.EI2, self.EI3,
                                                                                                     rel_tol=1e-12)

    @property
    def outline(self) -> tuple[float, float, bool]:
        """Outline for pictures: half the size along d2 and along d3, m, and whether it is round (an ellipse) or a rectangle. For
        a section given by stiffnesses that of the ellipse with the same radii of gyration, sqrt(EI/EA)."""
        if self._outline is not None:
            return self._outline
        return 2.0 * math.sqrt(self.EI3 / self.EA), 2.0 * math.sqrt(self.EI2 / self.EA), True

    @property
    def inertia(self) -> tuple[float, float, float]:
        """(rhoA, rhoI2, rhoI3)."""
        return self.rhoA, self.rhoI2, self.rhoI3

    @classmethod
    @checked(height=LENGTH, width=LENGTH, GJ=FACTOR, **MATERIAL)
    def rectangle(cls, *, height: float, width: float, E: float, rho: float, nu: float = 0.3, G: float | None = None,
                  shear_factor: float = 5.0 / 6.0, GJ: float | None = None, damping: ArrayLike = 0.0,
                  name: str = "") -> Section:
        """Make a rectangle of `height` along d2 and `width` along d3 (m); E in N/m^2, rho in kg/m^3.

        G defaults to E / (2 (1 + nu)); GJ to St Venant's exact torsion series (Timoshenko and Goodier, Theory of
        Elasticity, art. 109); the shear factor 5/6 is that of a parabolic shear stress. damping: as of a Section.

        Raises
        ------
        SceneError
            A size or constant is not positive, or nu lies outside (-1, 0.5].

        Examples
        --------
        >>> from fastbeam.scene import Section
        >>> bar = Section.rectangle(height=0.02, width=0.01, E=210e9, rho=7850.0)
        >>> round(bar.EA), round(bar.EI3, 3), round(bar.rhoA, 4)
        (42000000, 1400.0, 1.57)
        """
        h, w, k = height, width, shear_factor
        G = _shear_modulus(_who("rectangle", name), E, nu, G)
        twist = G * _rectangle_torsion(h, w) if GJ is None else GJ
        area, i22, i33 = h * w, w * h**3 / 12.0, h * w**3 / 12.0       # int X2^2 dA, int X3^2 dA
        return cls(EA=E * area, GA2=k * G * area, GA3=k * G * area, GJ=twist, EI2=E * i33, EI3=E * i22,
                   rhoA=rho * area, rhoI2=rho * i22, rhoI3=rho * i33, damping=damping, name=name,
                   _outline=(0.5 * h, 0.5 * w, False))

    @classmethod
    @checked(radius=LENGTH, **MATERIAL)
    def circle(cls, *, radius: float, E: float, rho: float, nu: float = 0.3, G: float | None = None,
               shear_factor: float | None = None, damping: ArrayLike = 0.0, name: str = "") -> Section:
        """Make a full circle of `radius` (m); E in N/m^2, rho in kg/m^3.

        G defaults to E / (2 (1 + nu)), the shear factor to 6 (1 + nu) / (7 + 6 nu) (Cowper, J. Appl. Mech. 33, 1966;
        0.886 for nu = 0.3). damping: as of a Section.

        Raises
        ------
        SceneError
            A size or constant is not positive, or nu lies outside (-1, 0.5].

        Examples
        --------
        >>> from fastbeam.scene import Section
        >>> rod = Section.circle(radius=0.01, E=70e9, rho=2700.0)
        >>> round(rod.EI2, 4), round(rod.EI2 / rod.GJ, 3)
        (549.7787, 1.3)
        """
        return cls._round(_who("circle", name), radius, 0.0, E, rho, nu, G, shear_factor, damping, name)

    @classmethod
    @checked(radius=LENGTH, thickness=LENGTH, **MATERIAL)
    def tube(cls, *, radius: float, thickness: float, E: float, rho: float, nu: float = 0.3, G: float | None = None,
             shear_factor: float | None = None, damping: ArrayLike = 0.0, name: str = "") -> Section:
        """Make a circular tube of outer `radius` and wall `thickness` (m); E in N/m^2, rho in kg/m^3.

        The shear factor defaults to Cowper's (1966) 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2)
        with m = inner / outer radius: from the full circle's value down to about 0.53 for a thin wall. damping: as of a
        Section.

        Raises
        ------
        SceneError
            A size or constant is not positive, the wall is thicker than the radius, or nu lies outside (-1, 0.5].
        """
        who = _who("tube", name)
        if thickness > radius:
            raise SceneError(f"{who}: thickness={thickness:g} exceeds the outer radius {radius:g} m")
        return cls._round(who, radius, radius - thickness, E, rho, nu, G, shear_factor, damping, name)

    @classmethod
    def _round(cls, who: str, outer: float, inner: float, E: Any, rho: Any, nu: Any, G: Any, shear_factor: Any,
               damping: Any, name: str) -> Section:
        """Make a circle or tube from both radii."""
        G = _shear_modulus(who, E, nu, G)
        if shear_factor is None:
            m2 = (inner / outer) ** 2
            shear_factor = 6 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
        k = shear_factor
        area = math.pi * (outer - inner) * (outer + inner)
        second = area * (outer**2 + inner**2) / 4.0
        return cls(EA=E * area, GA2=k * G * area, GA3=k * G * area, GJ=2 * G * second, EI2=E * second, EI3=E * second,
                   rhoA=rho * area, rhoI2=rho * second, rhoI3=rho * second, damping=damping, name=name,
                   _outline=(outer, outer, True))

    @classmethod
    @checked(C=Numbers((6, 6), "6 x 6 finite numbers"), rhoA=MASS, rhoI2=INERTIA, rhoI3=INERTIA, damping=DAMPING, name=Word())
    def from_matrix(cls, C: ArrayLike, *, rhoA: float, rhoI2: float, rhoI3: float, damping: ArrayLike = 0.0,
                    name: str = "") -> Section:
        """Make a section from a full stiffness matrix (6, 6) in the order Gamma1, Gamma2, Gamma3, K1, K2, K3.

        The fields EA ... EI3 then hold the diagonal of C. damping: as of a Section.

        Raises
        ------
        SceneError
            C is not 6 x 6, not symmetric (1e-9 of its entries' scale) or not positive definite.
        """
        who = _who("from_matrix", name)
        diagonal = np.diag(C)
        if np.any(diagonal <= 0.0):
            raise SceneError(f"{who}: C must be positive definite, its smallest eigenvalue is "
                             f"{float(np.linalg.eigvalsh(0.5 * (C + C.T))[0]):.6g}")
        scaled, skew, smallest = checks.symmetry(C)
        if skew > 1e-9:
            i, j = np.unravel_index(int(np.argmax(np.abs(scaled - scaled.T))), (6, 6))
            raise SceneError(f"{who}: C must be symmetric, C[{i},{j}]={C[i, j]:.6g} but C[{j},{i}]={C[j, i]:.6g}")
        if smallest <= 1e-14:
            raise SceneError(f"{who}: C must be positive definite, its smallest eigenvalue is {smallest:.3g} "
                             "(after scaling to a unit diagonal)")
        symmetric = checks.constant(0.5 * (C + C.T))
        values = dict(zip(STIFFNESS, (float(x) for x in diagonal)))
        return cls(**values, rhoA=rhoA, rhoI2=rhoI2, rhoI3=rhoI3, damping=damping, name=name, _matrix=symmetric)


def _who(kind: str, name: str) -> str:
    return f"section {name!r}" if name else f"Section.{kind}"


def _shear_modulus(who: str, E: float, nu: float, G: float | None) -> float:
    """Return G, from nu unless given."""
    if not -1.0 < nu <= 0.5:
        raise SceneError(f"{who}: nu={nu:g} lies outside (-1, 0.5]")
    return E / (2.0 * (1.0 + nu)) if G is None else G


def _rectangle_torsion(height: float, width: float) -> float:
    """Return J (m^4) of a rectangle: a b^3 (1/3 - 64/pi^5 b/a sum_odd tanh(n pi a / 2 b) / n^5), a >= b."""
    a, b = max(height, width), min(height, width)
    # sum of (tanh - 1) / n^5 converges like exp(-n pi); the sum of 1/n^5 is known in closed form
    total = ODD_FIFTH_POWERS
    for n in range(1, 26, 2):
        total -= 2.0 / (1.0 + math.exp(min(n * math.pi * a / b, 700.0))) / n**5
    return a * b**3 * (1.0 / 3.0 - 64.0 / math.pi**5 * (b / a) * total)
