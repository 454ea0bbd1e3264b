"""Section forces, section moments and strains along beams, from positions and triads (theory.md 2.3)."""
from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import Anything, checked, numbers, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.state import State
from fastbeam.model.forces.nonlinear_sections import added_stresses
from fastbeam.model.model import Model, check_model
from fastbeam.model.start import own_state
from fastbeam.model.tables import elements_of, strain_gradient, strains_of
from fastbeam.results.result import Result
from fastbeam.scene import Beam
from fastbeam.scene.checks import nearest_triads

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fastbeam.scene.interpolation.basis import Basis

Array = np.ndarray
NEED = "must be arc lengths within the beam, m"


def _component(of: str, k: int) -> Any:
    """Make a property: component of a force or moment along a director, [n, m]."""
    return property(lambda found: np.einsum("tsc,tsc->ts", getattr(found, of), found.directors[:, :, k]))


@dataclass(frozen=True)
class SectionForces:
    """Forces and moments that the part of a beam behind a section exerts on the part before it, at times t and arc lengths s.

    Attributes
    ----------
    t : float64 [n]
        Times, s; in statics load factors.
    s : float64 [m]
        Reference arc lengths, m.
    N, Q2, Q3 : float64 [n, m]
        Normal force along d1 and shear forces along d2 and d3, N.
    T, M2, M3 : float64 [n, m]
        Torsion about d1 and bending moments about d2 and d3, N m.
    strains : float64 [n, m, 6]
        Axial, shear 2, shear 3, twist, curvature 2, curvature 3, less those of the reference; of the strain set of the beam.
    force, moment : float64 [n, m, 3]
        The same force and moment in axes of space, N and N m.
    position : float64 [n, m, 3]
        Places of the sections, m.
    directors : float64 [n, m, 3, 3]
        Triads of the sections, orthonormal, rows d1, d2, d3.
    strain_rates : float64 [n, m, 6] or None
        Rates of the strains, 1/s, of damped beams whose motion is known; else None, and forces are those of the strains
        alone.
    """

    t: Array
    s: Array
    force: Array
    moment: Array
    strains: Array
    position: Array
    directors: Array
    strain_rates: Array | None = None

    N, Q2, Q3 = (_component("force", k) for k in range(3))
    T, M2, M3 = (_component("moment", k) for k in range(3))


def span_of(who: str, model: Model, beam: Any) -> slice:
    """Return the nodes of a beam of a model; who: the call and argument, for messages. Raises SceneError."""
    if not isinstance(beam, Beam):
        raise SceneError(f"{who}: needs a beam of the scene, got {shown(beam)}; of a net one of its beams, net.beam(k)")
    try:
        return model.numbers.span(beam)  # type: ignore[no-any-return]
    except KeyError:
        raise SceneError(f"{who}: {beam.label} is not in scene {model.scene_name!r}; name a beam of the compiled scene") from None


class Sections:
    """Sections of one beam of a model, of which forces are asked for.

    beam: beam of the compiled scene; also a beam of a net, `net.beam(k)`.
    s: float or array_like [m], arc lengths, m; default: the ends of all elements.
    places: places of all sliders [S], with which elements of moving meshes move; default: those of the initial state.
    Raises SceneError: the beam is not in the scene, or an arc length lies outside.
    """

    def __init__(self, model: Model, beam: Beam, s: ArrayLike | None = None, places: Array | None = None) -> None:
        # nodes of the beam among those of the model
        self.span = span_of("section", model, beam)
        self.first = self.span.start
        self.s = beam.basis.element_ends if s is None else _lengths(beam, s)
        reference = model.q0.reshape(-1, 4, 3)
        given = beam
        if places is not None and model.moving is not None and model.moving.has(self.first):
            beam = replace(beam, elements=model.moving.element_ends(self.first, places))
            reference = reference.copy()
            reference[self.span, 0], reference[self.span, 1:] = beam.reference(beam.basis.node_s)
        self.beam, basis = beam, beam.basis
        self.count = basis.n_nodes
        tables = elements_of(beam, self.first, reference[:, 0], reference[:, 1:])
        at = np.clip(np.searchsorted(basis.element_ends, self.s, side="right") - 1, 0, basis.n_elements - 1)
        self.strain = beam.strain
        # elements and points [m, g]; with one element a section its nodes stand once
        element, point = _points_about(basis, self.s, at)
        self.nodes = basis.element_nodes[element]
        self.phi, self.phi_s = basis.phi[element, point], tables.phi_s[element, point]
        self.dir, self.dir_s = tables.dir[element, point], tables.dir_s[element, point]
        self.reference = tables.reference_strains[element, point]
        if beam is not given:
            self.reference[..., 0] += model.moving.strain_change(self.first)
        self.stiffness, viscosity = beam.section.C, beam.section.D
        self.viscosity = viscosity if np.any(viscosity) else None
        # polynomials through the points of the strain energy, where strains are most accurate
        points = basis.point_s[element, point]
        self.through = np.ones_like(points)
        for k in range(points.shape[1]):
            for j in set(range(points.shape[1])) - {k}:
                self.through[:, k] *= (self.s - points[:, j]) / (points[:, k] - points[:, j])
        first, values, _ = basis.curve("own").evaluate(self.s)
        self.at_nodes, self.values = first[:, None] + np.arange(values.shape[1]), values

    def at(self, t: Array, phi: Array, directors: Array, rates: Array | None = None) -> SectionForces:
        """Evaluate the sections at n shapes of the beam: t [n], positions [n, A, 3] and directors [n, A, 3, 3] of its nodes, and
        for damped ones the rates of strains [n, m, g, 6] as `strain_rates` gives them."""
        f, d, k = self._slopes(phi, directors)
        strain = strains_of(self.strain, f, d, k) - self.reference
        stress = strain @ self.stiffness.T + added_stresses(self.beam.section, strain)
        if rates is not None and self.viscosity is not None:
            stress += rates @ self.viscosity.T
        force, moment = forces_of(self.strain, stress, f, d, k)
        position = np.einsum("sn,tsnc->tsc", self.values, phi[:, self.at_nodes])
        triads = nearest_triads(np.einsum("sn,tsnkc->tskc", self.values, directors[:, self.at_nodes]))
        # about a fixed point the moment changes along the beam by what acts on it alone, so that a polynomial follows it best
        arm = np.einsum("sgn,tsgnc->tsgc", self.phi, phi[:, self.nodes]) - position[:, :, None]
        moment = moment + np.cross(arm, force)
        force, moment, strain = (self._through(x) for x in (force, moment, strain))
        return SectionForces(np.asarray(t), self.s, force, moment, strain, position, triads,
                             None if rates is None else self._through(rates))

    def strain_rates(self, q: Array, v: Array) -> Array:
        """Return rates E_q v of the strains at the points of the quadrature [n, m, g, 6], 1/s, from coordinates and velocities of
        the nodes of the beam [n, A, 4, 3]; theory.md (2.5). Means of both ends of a step give those of the step, to second order;
        rigid motions give zero to round-off."""
        gradient = strain_gradient(self.strain, *self._slopes(q[:, :, 0], q[:, :, 1:]))
        f, d, k = self._slopes(v[:, :, 0], v[:, :, 1:])
        return np.einsum("tsgixc,tsgxc->tsgi", gradient, np.concatenate((f[..., None, :], d, k), axis=-2))

    def _slopes(self, phi: Array, d: Array) -> tuple[Array, Array, Array]:
        """Return phi' [n, m, g, 3], directors and their derivatives [n, m, g, 3, 3] at the points of the quadrature."""
        f = np.einsum("sgn,tsgnc->tsgc", self.phi_s, phi[:, self.nodes])
        return (f, *(np.einsum("sgn,tsgnkc->tsgkc", x, d[:, self.nodes]) for x in (self.dir, self.dir_s)))

    def _through(self, x: Array) -> Array:
        """Interpolate values at the points to the sections by the polynomials through them."""
        return np.einsum("sg,tsgc->tsc", self.through, x)


def _points_about(basis: Basis, s: Array, at: Array) -> tuple[Array, Array]:
    """Choose the points of the strain energy for sections s [m] in elements `at`: elements [m, 1] or [m, g] and numbers [g] or
    [m, g] of points. They are those of the element; of splines with points of weight zero the `degree` ones that are nearest."""
    if np.all(basis.weight > 0.0):
        return at[:, None], np.arange(basis.weight.shape[1])
    element, point = np.nonzero(basis.weight > 0.0)
    order = np.argsort(basis.point_s[element, point])
    element, point = element[order], point[order]
    near = np.searchsorted(basis.point_s[element, point], s)
    count = min(basis.degree, element.size)
    window = np.clip(near - (count + 1) // 2, 0, element.size - count)[:, None] + np.arange(count)
    return element[window], point[window]


def forces_of(name: str, stress: Array, f: Array, d: Array, k: Array) -> tuple[Array, Array]:
    """Return force dW/d(phi') and moment sum d_i x dW/d(d_i') of a section [..., 3], from stresses conjugate to the strains [...,
    6]."""
    s = [stress[..., i, None] for i in range(6)]
    d1, d2, d3 = (d[..., i, :] for i in range(3))
    if name == "simo_reissner":
        shear2, shear3 = (np.einsum("...c,...c->...", f, x)[..., None] for x in (d2, d3))
        along = f - shear2 * d2 - shear3 * d3
        stretch = np.sqrt(np.einsum("...c,...c->...", f, f)[..., None] - shear2**2 - shear3**2)
        force = s[0] * along / stretch + s[1] * d2 + s[2] * d3
        c = 1.75 - 0.25 * np.einsum("...ic,...ic->...", d, d)[..., None]
        slopes = (0.5 * c * (s[5] * d2 - s[4] * d3), 0.5 * c * (s[3] * d3 - s[5] * d1), 0.5 * c * (s[4] * d1 - s[3] * d2))
    else:
        force = s[0] * f + s[1] * d2 + s[2] * d3 + s[4] * k[..., 2, :] - s[5] * k[..., 1, :]
        slopes = (0.0 * f, 0.5 * s[3] * d3 - s[5] * f, s[4] * f - 0.5 * s[3] * d2)
    moment = np.cross(d1, slopes[0]) + np.cross(d2, slopes[1]) + np.cross(d3, slopes[2])
    return force, moment


def _lengths(beam: Beam, s: ArrayLike) -> Array:
    one = real(s)
    found = numbers(s) if one is None else np.array([one])
    if found is None or found.ndim != 1 or not found.size or not np.all((found >= 0.0) & (found <= beam.length)):
        raise SceneError(f"section: s {NEED}, here 0 to {beam.length:.6g} of {beam.label}, got {shown(s)}")
    return found


def _on_moving_mesh(model: Model, shapes: Result | State, beam: Beam, s: ArrayLike | None, t: Array, phi: Array,
                    directors: Array) -> SectionForces:
    """Compute the forces of a beam whose elements move, with a mesh of its own for every shape."""
    if isinstance(shapes, State):
        places = shapes.s[None]
    else:
        if "s_slide" not in shapes.series or not np.isin(t, shapes.t).all():
            raise SceneError(f"section_forces: the elements of {beam.label} move with its contacts, whose places at the times of "
                             "the shapes this result does not have; run with observe=('slider', ...) and rows at all times of "
                             "snapshots, or give a State")
        places = shapes.series["s_slide"][np.searchsorted(shapes.t, t)]
        if shapes.mesh is not None:
            phi, directors = phi.copy(), directors.copy()
            phi[:, model.moving.nodes], directors[:, model.moving.nodes] = shapes.mesh[:, :, 0], shapes.mesh[:, :, 1:]
    found = []
    for k, place in enumerate(places):
        sections = Sections(model, beam, s, place)
        found.append(sections.at(t[k:k + 1], phi[k:k + 1, sections.span], directors[k:k + 1, sections.span]))
    names = "force", "moment", "strains", "position", "directors"
    return SectionForces(np.asarray(t), found[0].s, *(np.concatenate([getattr(x, name) for x in found]) for name in names))


@checked(model=Anything(), shapes=Anything(), beam=Anything(), s=Anything())
def section_forces(model: Model, shapes: Result | State, beam: Beam, s: ArrayLike | None = None) -> SectionForces:
    """Compute normal force, shear forces, torsion and bending moments along a beam.

    Parameters
    ----------
    model : Model
        Model of the run.
    shapes : Result or State
        All shapes of a result (`t_snap`), or one state.
    beam : Beam
        Beam of the scene; also a beam of a net, `net.beam(k)`.
    s : float or array_like [m]
        Arc lengths in the reference, m; default: the ends of all elements. Behind a point load where it stands on an element end.

    Returns
    -------
    SectionForces
        N, Q2, Q3, T, M2, M3 [n, m] and more. In an element they are polynomials through the points of its strain energy, of
        splines of degree 2 and 3 through as many points about the section as the degree says: forces and the moments about a
        fixed point, which follow what acts on the element (theory.md (2.7)).

        Stresses of `damping` are in them where the motion is known: of a State, and of a Result with velocities
        (`observe=("velocity", ...)`); of other runs in time a warning says that they are missing. They follow the velocities at
        that time, which go up and down from step to step where steps do not resolve a fast motion that is heavily damped (behind
        a sudden load); rows of `observe=("section", ...)` are means of steps, free of that.

    Raises
    ------
    SceneError
        A model that is not compiled, shapes of another model, a beam that is not in it, an arc length outside the beam.

    Examples
    --------
    >>> import fastbeam as fb
    >>> bar = fb.Section.circle(radius=0.01, E=2e11, rho=7800.0)
    >>> beam = fb.Beam.straight('beam', (0, 0, 0), (1, 0, 0), section=bar, elements=4)
    >>> model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load('tip', beam.end, force=(0, 0, -1e-3))))
    >>> result = fb.solve_static(model)
    >>> f'{abs(fb.section_forces(model, result.state, beam, 0.0).M2[0, 0]):.6f}'
    '0.001000'
    """
    check_model("section_forces", model)
    v = None
    if isinstance(shapes, Result):
        t, phi, directors = shapes.t_snap, shapes.phi, shapes.directors
        if shapes.velocities is not None and shapes.spins is not None:
            v = np.concatenate((shapes.velocities[:, :, None], np.cross(shapes.spins[:, :, None], directors)), axis=2)
    elif isinstance(shapes, State):
        q, v = (x.reshape(1, -1, 4, 3) for x in own_state(model, shapes)[:2])
        t, phi, directors = np.zeros(1), q[:, :, 0], q[:, :, 1:]
    else:
        raise SceneError(f"section_forces: shapes must be a Result or a State (result.state), got {shown(shapes)}")
    if phi.shape[1] != model.n_nodes:
        raise SceneError(f"section_forces: the shapes have {phi.shape[1]} nodes, but the model of scene {model.scene_name!r} has "
                         f"{model.n_nodes}; give the model of that run, and keep shapes with output=Output(snapshots=...)")
    if len(t) and model.moving is not None and model.moving.has(span_of("section_forces", model, beam).start):
        return _on_moving_mesh(model, shapes, beam, s, t, phi, directors)
    sections = Sections(model, beam, s)
    phi, directors, rates = phi[:, sections.span], directors[:, sections.span], None
    if sections.viscosity is not None and v is not None:
        rates = sections.strain_rates(np.concatenate((phi[:, :, None], directors), axis=2), v[:, sections.span])
    elif sections.viscosity is not None and len(t) and "t_end" in shapes.info:
        warnings.warn(f"section_forces: {beam.label} has damping, but this result has no velocities of its shapes, so stresses "
                      "by strain rates are left out; run with observe=('velocity', ...), or with observe=('section', ...) for "
                      "rows of points", stacklevel=3)
    return sections.at(t, phi, directors, rates)
