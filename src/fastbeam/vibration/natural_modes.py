"""Natural vibrations about an equilibrium, and the shapes of its unstable directions (theory.md 11)."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, overload

import numpy as np

from fastbeam.dynamics.options import START
from fastbeam.interface.arguments import Anything, Count, Flag, Number, Word, checked
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import warns
from fastbeam.kernels.state import State
from fastbeam.linalg.eigen import Eigen, SingularError, lowest
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import load_factors_at
from fastbeam.model.model import Model, check_model
from fastbeam.model.start import check_start
from fastbeam.results.mode_shapes import DampedModes, Modes, SteadyModes
from fastbeam.results.observe.resolution import mesh_events
from fastbeam.statics.static_analysis import held_sliders, which_sliders
from fastbeam.statics.steady_motion import Spin, Travel, check_steady, which_steady_motion
from fastbeam.vibration.damped_modes import MORE, Damped, damped_of
from fastbeam.vibration.linearised import Linearisation
from fastbeam.vibration.resting_sliders import locked_sliders, resting_sliders
from fastbeam.vibration.steady_modes import SteadyEigen, steady_modes_of

Array = np.ndarray
# a state whose nodes would move by less, in sizes of the scene and rad, is an equilibrium
AT_REST = 1e-8
# contact forces are found anew where they change by more
SETTLED = 1e-9
# share of the loads that may push along free motions as round-off
UNBALANCED = 1e-9
# share of the loads below which forces of constraints are round-off
NOTHING = 1e-15
LEAST = 12
# share of the kinetic energy from which on a motion circles about the axis
CIRCLES = 0.999


@overload
def modes(model: Model, *, state: State | None = ..., n: int = ..., load_factor: float = ..., at_time: float | None = ...,
          held: bool | str | Sequence[str] = ..., planar: bool | None = ..., damped: Literal[False] = ...,
          steady: None = ..., backend: str = ...) -> Modes:
    """Find modes without damping."""


@overload
def modes(model: Model, *, state: State | None = ..., n: int = ..., load_factor: float = ..., at_time: float | None = ...,
          held: bool | str | Sequence[str] = ..., planar: bool | None = ..., damped: Literal[True],
          steady: None = ..., backend: str = ...) -> DampedModes:
    """Find modes with damping."""


@overload
def modes(model: Model, *, steady: Spin | Travel, state: State | None = ..., n: int = ..., load_factor: float = ...,
          at_time: float | None = ..., held: bool | str | Sequence[str] = ..., planar: bool | None = ..., damped: bool = ...,
          backend: str = ...) -> SteadyModes:
    """Find modes about a steady motion."""


@warns
@checked(model=Anything(), state=START, n=Count(most=10_000), load_factor=Number(), at_time=Number(unit="s"),
         held=which_sliders, planar=Flag(), damped=Flag(), steady=which_steady_motion, backend=Word())
def modes(model: Model, *, state: State | None = None, n: int = 20, load_factor: float = 1.0, at_time: float | None = None,
          held: bool | str | Sequence[str] = False, planar: bool | None = None, damped: bool = False,
          steady: Spin | Travel | None = None, backend: str = "auto") -> Modes | DampedModes | SteadyModes:
    """Find the n lowest natural frequencies and modes of small vibrations about an equilibrium, with sliders, joints, bodies and
    supports: (K - w^2 M) x = 0 with K the tangent of the equilibrium, contact forces included (theory.md 11).

    Parameters
    ----------
    model : Model
    state : State, optional
        An equilibrium, `solve_static(...).state`; default: the reference. Velocities do not count.
    n : int
        Number of modes; unstable and free motions come first.
    load_factor : float
        Factor of all loads, gravity and drives of sliders, as in `solve_static`; 0: the scene without loads.
    at_time : float
        Where time functions of loads and drives are evaluated, s; needed when the scene has some.
    held : bool, str or sequence of str
        Sliders that stay where they are on their beams, as in `solve_static`. So do those that Coulomb friction or a rigid stop
        holds, that are locked, or whose motion a drive prescribes: `info["held_sliders"]`. On the others act drives that push,
        and elastic stops that are pressed, with the derivatives of their forces.
    planar : bool, optional
        True: motions in the plane of the scene alone. Default: all motions in space, unless the model was compiled with
        planar=True.
    damped : bool
        The motions x e^(r t) that these n modes become with the damping that the scene has: damped sections, linear drag,
        dampers in joints, viscous and smoothed friction and drives of sliders, laws of forces that depend on velocities. Where
        the stiffness is not symmetric, as with cross-coupled bearings, follower loads and moments with fixed axes, the n slowest
        motions, by |r|: `.unstable` counts those that grow (flutter, divergence).
    steady : Spin or Travel, optional
        About a steady motion (theory.md 17): the state is an equilibrium in it, `solve_static(model, steady=...).state`, and
        supports belong to the frame that spins, or stand where beams travel. With the damping that the scene has.
    backend : {'auto', 'pardiso', 'superlu'}

    Returns
    -------
    Modes, DampedModes or SteadyModes
        `.frequencies` (Hz), `.angular` (rad/s), `.growth`, `.displacements`, ..., `.state(k, amplitude)`; fewer than n where
        there are no more. With damped=True `.rates` (complex, 1/s), `.frequencies`, `.damping_ratios`, `.decay`, ...;
        with steady= these and `.whirl`, `.in_space`, in which forward is the sense of the spin.

    Raises
    ------
    SceneError
        The state is no equilibrium (says where and how far from one), or an argument is not usable.
    ConvergenceError
        The eigenvalues were not found: stiffness and masses are singular together.
    """
    about, _ = linearised_at("modes", model, state, load_factor, at_time, held, planar, backend, steady)
    result, found = _modes_about(about, model, n, damped, steady, backend, state)
    result.events = events_about(about, found)
    return result


def events_about(about: Linearisation, found: Eigen) -> list[dict[str, Any]]:
    """Return events where elements do not resolve an equilibrium, or sliders in its modes."""
    k, state = about.free.size, about.stepper.state
    slides = found.vectors[k:k + about.core.n_sliders].T * about.sliding
    return mesh_events(about.model, state, slides, np.real(found.values))


def _modes_about(about: Linearisation, model: Model, n: int, damped: bool, steady: Spin | Travel | None, backend: str,
                 state: State | None) -> tuple[Modes | DampedModes | SteadyModes, Eigen]:
    """Find the modes of `modes`, and the undamped motions that they come from."""
    if steady is not None:
        found = equilibrium_of("modes", about, LEAST, backend, state)
        try:
            return _steady_modes_of(about, steady_modes_of(about, found, n, backend), found, steady), found
        except SingularError:
            raise ConvergenceError(f"modes: the modes of scene {model.scene_name!r} about {steady!r} were not found; ask for "
                                   "fewer",
                                   state=state) from None
    if not damped:
        found = equilibrium_of("modes", about, n, backend, state)
        return _modes_of(about, found), found
    require(Analysis.DAMPED, model)
    found = equilibrium_of("modes", about, n + MORE, backend, state)
    try:
        return _damped_modes_of(about, damped_of(about, found, n, backend)), found
    except SingularError:
        raise ConvergenceError(f"modes: a damped mode of scene {model.scene_name!r} was not found; ask for fewer, or look at "
                               "frequency_response", state=state) from None


def linearised_at(who: str, model: Model, state: State | None, load_factor: float, at_time: float | None,
                  held: bool | str | Sequence[str], planar: bool | None, backend: str,
                  steady: Spin | Travel | None = None) -> tuple[Linearisation, State | None]:
    """Linearise a model about a state with the arguments of `modes`; return also the state as it was checked.

    Raises SceneError.
    """
    check_model(who, model)
    stays = held_sliders(model, held)
    check_backend(backend)
    flat = model.asked_for_plane if planar is None else planar
    if flat and model.plane is None:
        raise SceneError(f"planar=True: scene {model.scene_name!r} does not stay in a plane: {model.not_planar}")
    factors = load_factor * load_factors_at(who, model, at_time)
    if state is not None:
        state, _ = check_start(model, state, 1.0, at_rest=True)
    stays = stays | locked_sliders(model, state)
    # beside what travels along itself velocities along the beam are not zero
    require(Analysis.TRAVEL if isinstance(steady, Travel) else Analysis.MODES, model, who, stays)
    if at_time is None:
        require(Analysis.TIMELESS_MODES, model, who, stays)
    if steady is not None:
        check_steady(who, model, steady, factors)
        if flat and isinstance(steady, Spin) and not np.allclose(np.abs(model.plane.axes[2] @ steady.axis), 1.0, atol=1e-12):
            raise SceneError(f"{who}: planar=True needs a spin about the normal of the plane, got {steady!r}, whose inertia "
                             "forces point out of the plane")
    about = Linearisation(model, state, ~stays, factors, flat, steady=None if steady is None else (who, steady),
                          resting=resting_sliders(who, model, state, stays, at_time, load_factor))
    about.stepper.load_at(at_time or 0.0, load_factor)
    if about.stepper.motion is not None:
        about.core.motions.at_rest(about.stepper.motion, at_time or 0.0, load_factor)
    if not np.any(about.mass.diagonal() > 0.0):
        raise SceneError(f"{who}: no part that can move has mass; give sections rhoA, or add bodies")
    return about, state


def equilibrium_of(who: str, about: Linearisation, n: int, backend: str, state: State | None) -> Eigen:
    """Find the n lowest eigenvalues about an equilibrium, with the contact forces that it has.

    Raises SceneError: the state is no equilibrium.
    Raises ConvergenceError: stiffness and masses are singular together.
    """
    try:
        found = _settled(who, about, n, backend)
        return _settled(who, about, n, backend) if about.frees(who) else found
    except SingularError:
        raise ConvergenceError(f"{who} of scene {about.model.scene_name!r} were not found: stiffness and mass matrices are "
                               "singular in a common direction (a part without mass and without support), or differ too much in "
                               "size",
                               state=state) from None


def _settled(who: str, about: Linearisation, n: int, backend: str) -> Eigen:
    """Find eigenvalues about the state, once contact forces are those of the equilibrium.

    Raises SceneError: the state is no equilibrium.
    """
    k = about.free.size
    motions = k + about.core.n_sliders
    for _ in range(4):
        pencil, right = about.assembled()
        # all free motions of a rigid scene, for what follows
        found = lowest(pencil, max(n, LEAST), backend)
        # forces along free motions are round-off, or the state is no equilibrium
        free = found.vectors[:k, np.real(found.values) == 0.0]
        along = found.vectors[:motions, np.real(found.values) == 0.0].T @ right[:motions]
        residual = right.copy()
        residual[:k] -= about.mass @ (free @ along)
        move = found.factors.solve(residual[:, None])[:, 0]
        move[:k] -= free @ (free.T @ (about.mass @ move[:k]))
        size = about.sizes(move[:k])
        largest = int(np.argmax(size))
        load = about.load_size + about.force_size(right[:k])
        pushed = np.abs(free).max(axis=0, initial=0.0) @ np.abs(along) if along.size else 0.0
        drifts = bool(about.force_size(about.mass @ (free @ along)) > max(UNBALANCED * load, about.round_off(pencil)))
        if drifts or not size[largest] <= AT_REST:
            raise SceneError(_no_equilibrium(who, about, right, size, largest, drifts and pushed > 0.0))
        change = move[motions:]
        scale = found.factors.scale[motions:]
        # constraints that carry nothing have forces of round-off, which never settle
        carried = about.force_size(pencil.stiffness[:k, motions:] @ change)
        if carried <= NOTHING * load or np.linalg.norm(change / scale) <= SETTLED * np.linalg.norm(
                about.stepper.core_state.force / scale):
            break
        about.add_forces(change)
    # no half of a pair
    n -= int(0 < n < found.values.size and np.imag(found.values[n - 1]) > 0.0)
    return found._replace(values=found.values[:n], vectors=found.vectors[:, :n], noise=found.noise[:n])


def _no_equilibrium(who: str, about: Linearisation, right: Array, size: Array, largest: int, drifts: bool) -> str:
    """Form the message about a state that is no equilibrium."""
    k = about.free.size
    force, along = np.abs(right[:k]), np.abs(right[k:k + about.core.n_sliders])
    worst = int(np.argmax(force))
    label, unit = about.label(worst)
    if along.size and along.max() > force[worst]:
        label, unit, force, worst = f"slider {about.model.names['sliders'][np.argmax(along)]!r}", "N along its beam", along, int(
            np.argmax(along))
    text = f"{who}: the state is not an equilibrium: {label} has an unbalanced force of {force[worst]:.3g} {unit}"
    if drifts:
        text += ", and no support balances the sum of the loads"
    else:
        text += f"; it would move {about.label(largest)[0]} by about {size[largest]:.2g} of the size of the scene"
    return text + (". Find the equilibrium with result = fb.solve_static(model) and give state=result.state (with its "
                   "load_factor), or use the scene without loads: load_factor=0")


def _steady_modes_of(about: Linearisation, found: SteadyEigen, at_rest: Eigen, steady: Spin | Travel) -> SteadyModes:
    """Form steady modes, with the frequencies that they have as seen from space."""
    damped = _damped_modes_of(about, Damped(*found[:3]))
    whirl, in_space = np.zeros(len(damped)), np.full(len(damped), np.nan)
    if isinstance(steady, Spin):
        # of what circles about the axis with the angular frequency w in the frame, w + rate is seen from space
        share = about.circling(found.vectors[:about.free.size])
        forward = -1.0 if steady.rate < 0.0 else 1.0
        seen = forward * (steady.rate + np.array([[1.0], [-1.0]]) * damped.angular)
        whirl = np.where(np.isnan(share), 0.0, 0.5 * np.sum((1.0 + np.array((share, -share))) * np.sign(seen), axis=0))
        in_space = np.where(np.abs(share) > CIRCLES, np.where(share > 0.0, *seen), np.nan) / (2.0 * np.pi)
    info = damped.info | {"method": "modes about a steady motion", "steady": repr(steady), "complete": found.is_complete,
                          "unstable_at_rest": int(np.sum(np.real(at_rest.values) < 0.0))}
    return SteadyModes(damped.rates, damped.displacements, damped.spins, damped.slides, damped.residuals, about, info,
                       damped.names, damped.positions, damped.directors, whirl, in_space)


def _damped_modes_of(about: Linearisation, found: Damped) -> DampedModes:
    """Scale damped modes to shapes of unit size, the largest displacement real and positive."""
    k, s = about.free.size, about.core.n_sliders
    moved, spins = about.spread(found.vectors[:k])
    flat, turns = (x.reshape(len(found.rates), 3 * about.model.n_nodes) for x in (moved, spins))
    factor = np.ones(len(found.rates), complex)
    for j, (x, turn) in enumerate(zip(moved, spins)):
        size, turned = np.linalg.norm(x, axis=1).max(initial=0.0), np.linalg.norm(turn, axis=1).max(initial=0.0)
        whole, size = (flat[j], size) if size > 1e-6 * turned * about.model.length else (turns[j], turned)
        if size > 0.0:
            largest = np.abs(whole)
            peak = whole[int(np.argmax(largest > (1.0 - 1e-6) * largest.max()))]
            factor[j] = np.abs(peak) / peak / size
    by = factor[:, None, None]
    info = {"scene": about.model.scene_name, "method": "damped modes", "unknowns": k, "held_sliders": about.held_sliders,
            "moves_in": "space" if about.size == 6 else "plane"}
    return DampedModes(found.rates, by * moved, by * spins, found.vectors[k:k + s].T * factor[:, None] * about.sliding,
                       found.residuals, about, info, about.model.names, *about.own_shape())


def _modes_of(about: Linearisation, found: Eigen) -> Modes:
    """Scale modes to shapes of unit size."""
    k, s = about.free.size, about.core.n_sliders
    pencil = found.factors.pencil
    values, vectors = found.values, found.vectors
    product = pencil.stiffness @ vectors
    inertia = np.zeros_like(product)
    first, second = (np.flatnonzero(sign * np.imag(values) > 0.0) for sign in (1.0, -1.0))
    of_mass = pencil.mass @ vectors[:k]
    inertia[:k] = of_mass * np.real(values)
    inertia[:k, first] -= of_mass[:, second] * np.imag(values[first])
    inertia[:k, second] += of_mass[:, first] * np.imag(values[first])
    diagonal = np.abs(pencil.stiffness.diagonal())[:, None] + np.zeros(len(values))
    size = np.abs(values) + abs(found.factors.shift)
    diagonal[:k] += pencil.mass.diagonal()[:, None] * size
    # multipliers take the entries of their rows
    diagonal[diagonal == 0.0] = 1.0
    diagonal[pencil.multiplier] = (1.0 / found.factors.scale[pencil.multiplier, None])**2
    scale = 1.0 / np.sqrt(diagonal)
    terms = np.linalg.norm(scale * (abs(pencil.stiffness) @ np.abs(vectors)), axis=0) + np.linalg.norm(
        scale[:k] * of_mass * size, axis=0)
    residuals = np.linalg.norm(scale * (product - inertia), axis=0) / np.maximum(terms, 1e-300)
    moved, spins = about.spread(vectors[:k])
    size = np.linalg.norm(moved, axis=2).max(axis=1, initial=0.0)
    turns = np.linalg.norm(spins, axis=2).max(axis=1, initial=0.0)
    size = np.where(size > 1e-6 * turns * about.model.length, size, turns)
    size[size == 0.0] = 1.0
    size[first] = size[second] = np.maximum(size[first], size[second])
    # the sign that makes the largest component positive
    flat = moved.reshape(len(size), 3 * about.model.n_nodes)
    if flat.size:
        peak = flat[np.arange(len(size)), np.argmax(np.abs(flat) > (1.0 - 1e-6) * np.abs(flat).max(axis=1)[:, None], axis=1)]
        size = np.where((peak < 0.0) & (np.imag(values) == 0.0), -size, size)
    part = about.base_motion().T @ vectors[:k]
    by = 1.0 / size[:, None, None]
    info: dict[str, Any] = {"scene": about.model.scene_name, "method": "modes", "solver": found.factors.name,
                            "left_out": pencil.still.shape[1], "complete": found.is_complete,
                            "moves_in": "space" if about.size == 6 else "plane", "unknowns": k,
                            "held_sliders": about.held_sliders}
    return Modes(values, by * moved, by * spins, vectors[k:k + s].T / size[:, None] * about.sliding, 1.0 / size**2,
                 (part**2).T, residuals, found.noise, about, info, about.model.names, *about.own_shape())
