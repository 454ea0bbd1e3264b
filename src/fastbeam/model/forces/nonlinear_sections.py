"""Sections with laws from outside the package, `scene.SectionLaw`: their numbers in the tables of elements, and their limits."""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.interface.arguments import LARGEST, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.nonlinear_sections import (
    Nonlinear,
    put_law,
    put_section_stresses,
    section_energy,
    section_modulus,
    section_stress,
)
from fastbeam.kernels.jit.sources import is_term
from fastbeam.kernels.layout import PARAMETERS, VISCOSITY
from fastbeam.model.analyses import Analysis, Lack, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Feature
from fastbeam.scene import Beam, Net, Scene
from fastbeam.scene.sections import Section

Array = np.ndarray
# strains up to which a law is compared with its energy, number of intervals from zero, and difference that is allowed
STRAINS = "Gamma1", "Gamma2", "Gamma3", "K1", "K2", "K3"
LARGEST_STRAINS, INTERVALS, ALLOWED = (1e-3, -1e-3, 0.1, -0.1), 400, 1e-2


def numbers_of(section: Section) -> Array:
    """Return the numbers of the law of a section, [6 * PARAMETERS]; zeros without a law. Raises SceneError: they are none."""
    if section.law is None:
        return np.zeros(6 * PARAMETERS)
    given = section.law.parameters
    found = numbers(given)
    if found is None or found.shape != (6, PARAMETERS) or not np.all(np.abs(found) <= LARGEST):
        raise SceneError(f"{_name(section)}: parameters must be finite numbers (6, {PARAMETERS}), got {shown(given)}")
    return np.asarray(found, dtype=float).reshape(-1)


def parameters_of(sections: Sequence[Section]) -> Array | None:
    """Return the numbers of the laws of sections, [n, 6 * PARAMETERS]; None where all are linear."""
    return np.array([numbers_of(x) for x in sections]) if any(x.law is not None for x in sections) else None


@dataclass(frozen=True)
class NonlinearSections(Feature):
    """Beams and nets whose sections have a law."""

    key, title, order = "nonlinear_sections", "sections with a law from outside", 35
    lacks = tuple(Lack((analysis,), "stresses that are nonlinear in the strains", text, instead, lambda law, asked: law.labels)
                  for analysis, text, instead in (
        (Analysis.PLANAR, "section laws are available in space only, and {name} has one", "use planar='auto'"),
        (Analysis.FILTERED, "rho_inf: {names} has a section law, whose stresses are not filtered", "leave rho_inf out"),
        (Analysis.EXACT, "contacts='exact' takes the stiffness matrix of sections alone, and {names} has a law", "leave it out"),
        (Analysis.LENGTHS, "{who} takes the stiffness matrix of sections alone, and {names} has a law",
         "change prestrain= yourself until the force is found"),
        (Analysis.LOSS_FACTOR, "{who} takes the stiffness matrix of sections alone, and {names} has a law",
         "use damping= of sections"),
        (Analysis.BUCKLING, "{who} takes tangents that are linear in the load, and {names} has a section law",
         "follow the equilibria with solve_path"))) + (
        unknown_to_methods("section laws", lambda law, asked: law.labels),
        without_adjoint("section laws", lambda law, asked: law.labels))

    labels: tuple[str, ...]  # of the beams and nets
    of: dict[str, tuple[Any, int]]  # instance of the named tuple of the law, and doubles ahead of C, by strain sets

    @property
    def constants(self) -> Iterable[Array]:
        """The names of the laws."""
        return [np.frombuffer(f"{type(term).__module__}.{type(term).__qualname__}".encode(), np.uint8)
                for term, _ in self.of.values()]

    def section_law(self, strain: str, law: Any, static: bool) -> Any:
        """Return the law with added stresses."""
        return Nonlinear(law, *self.of[strain]) if strain in self.of else law

    def describe(self) -> list[tuple[str, str, Sequence[str]]]:
        """Return the line of `print(model)`."""
        return [("section laws", "of ", self.labels)]


def nonlinear_of(scene: Scene) -> NonlinearSections | None:
    """Build the feature of sections with laws; None without any. Raises SceneError: a law cannot be used."""
    parts: list[Beam | Net] = [part for part in (*scene.beams, *scene.nets) if any(x.law is not None for x in _sections(part))]
    if not parts:
        return None
    for part in parts:
        if np.any(part.prestress):
            raise SceneError(f"{part.label}: prestress= takes the stiffness matrix of the section alone, which has a law; give "
                             "prestrain=")
    laws: dict[str, dict[type, Section]] = {}
    known: set[bytes] = set()
    for part in parts:
        for section in _sections(part):
            if section.law is None:
                continue
            _check_term(section)
            key = f"{type(section.law)}".encode() + numbers_of(section).tobytes()
            if key not in known:
                known.add(key)
                _compare(section)
            laws.setdefault(part.strain, {})[type(section.law.term)] = section
    for strain, kinds in laws.items():
        if len(kinds) > 1:
            one, other = (_name(x) for x in list(kinds.values())[:2])
            raise SceneError(f"{one} and {other}: beams of one scene with strain={strain!r} take laws of one kind; put both into "
                             "one law, with a parameter that chooses")
    of = {}
    for strain, kinds in laws.items():
        damped = any(np.any(x.damping) for part in (*scene.beams, *scene.nets) if part.strain == strain for x in _sections(part))
        of[strain] = next(iter(kinds.values())).law.term, 8 * 6 * PARAMETERS - (VISCOSITY if damped else 0)
    return NonlinearSections(tuple(part.label for part in parts), of)


def added_stresses(section: Section, strains: Array) -> Array:
    """Return the stresses that the law of a section adds at strains [..., 6]; zeros without a law."""
    out = np.zeros(strains.size)
    if section.law is not None:
        put_section_stresses(section.law.term, numbers_of(section), np.ascontiguousarray(strains).reshape(-1), out)
    return out.reshape(strains.shape)


def _sections(part: Beam | Net) -> tuple[Section, ...]:
    return tuple(part.sections) if isinstance(part, Net) else (part.section,)


def _name(section: Section) -> str:
    law: Any = section.law
    return f"{law.kind} of section {section.name!r}" if section.name else str(law.kind)


def _check_term(section: Section) -> None:
    """Check the named tuple of a law. Raises SceneError."""
    kind = type(section.law)
    term = kind.term
    if not is_term(type(term)):
        raise SceneError(f"{_name(section)}: {kind.__name__}.term must be an instance of a named tuple of your own, got "
                         f"{shown(term)}")
    for question in (section_energy, section_stress, section_modulus):
        if not question.covers(type(term)):
            raise SceneError(f"{_name(section)}: there is no @{question.name}.register({type(term).__name__}), or its module has "
                             "not been imported")


def _compare(section: Section) -> None:
    """Compare stress and modulus of a law with the differences of its energy and stress. Raises SceneError: they differ."""
    assert section.law is not None
    term = section.law.term
    for name, p in zip(STRAINS, numbers_of(section).reshape(6, PARAMETERS)):
        for largest in LARGEST_STRAINS if p.any() else ():
            strains = np.linspace(0.0, largest, INTERVALS + 1)
            found = np.empty((strains.size, 3))
            for e, out in zip(strains.tolist(), found):
                put_law(term, e, tuple(p.tolist()), out)
            if not np.all(np.isfinite(found)):
                raise SceneError(f"{_name(section)}: energy, stress or modulus of strain {name} is not finite between 0 and "
                                 f"{largest:g}")
            for k, (one, other) in enumerate((("energy", "stress"), ("stress", "modulus"))):
                change, by = found[-1, k] - found[0, k], found[:, k + 1]
                integral = float(np.sum(0.5 * (by[1:] + by[:-1])) * strains[1])
                size = float(np.sum(np.abs(by)) * abs(strains[1]))
                if abs(change - integral) > ALLOWED * size:
                    raise SceneError(f"{_name(section)}: from strain 0 to {largest:g} the {one} of {name} changes by "
                                     f"{change:.6g}, but the integral of the {other} is {integral:.6g}; the {other} must be its "
                                     "derivative")
