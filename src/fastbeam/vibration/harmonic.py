"""Steady response to harmonic loads and to supports that move harmonically, about an equilibrium (theory.md 14)."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.dynamics.options import START
from fastbeam.compile.unpack import distributed
from fastbeam.interface.arguments import Anything, Flag, Listing, Number, Numbers, Word, checked, is_masked, real, shown, take
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import warns
from fastbeam.interface.synonyms import known
from fastbeam.kernels.state import State
from fastbeam.linalg.dynamic_stiffness import PUSHED, DynamicStiffness, with_still
from fastbeam.linalg.eigen import Eigen, Pencil, Shifted, SingularError
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.model import Model
from fastbeam.model.supports import check_turned, standing_supports, supported
from fastbeam.results.observe.observer import POINTS
from fastbeam.results.observe.points import place_of
from fastbeam.results.responses import FrequencyResponse
from fastbeam.scene import Clamp, DistributedLoad, Load, NodeRef, Pin, PointMass, PrescribedMotion, RigidBody
from fastbeam.scene.checks import Place, nearest_triads
from fastbeam.statics.static_analysis import which_sliders
from fastbeam.vibration.linearised import Linearisation
from fastbeam.vibration.natural_modes import LEAST, equilibrium_of, events_about, linearised_at

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray
# loads or their names; supports, or what they hold
ALoad = str | Load | DistributedLoad
Loads = ALoad | Sequence[ALoad] | Mapping[ALoad, complex] | Mapping[str, complex]
Support = Clamp | Pin | PrescribedMotion | NodeRef | RigidBody | PointMass
MOST_FREQUENCIES = 1_000_000
# modes up to this many times the largest frequency get the damping ratio
UP_TO = 2.0
MOST_MODES = 400
# round-off of amplitudes, relative to the largest, from which on there is no response
NO_DIGITS = 1e-3
# relative change of amplitudes with that of a frequency at a mode without damping
UNDAMPED = 1e8
# share of an excitation along a free motion that is round-off
ALONG_FREE = 1e-9
# damping ratio that is lost in round-off
NO_DAMPING = 1e-15


class Excitation(NamedTuple):
    """Complex amplitudes of an excitation."""

    forces: Array     # [k], on the unknowns
    number: Array     # int64 [j]: unknowns of supports that move
    motion: Array     # [j]: their displacements, m, and turns, rad
    text: str


@warns
@checked(model=Anything(), frequencies=Numbers((None,), "finite frequencies in Hz, of shape [f]"), state=START, loads=Anything(),
         base=Anything(), damping_ratio=Number(least=0.0, most=10.0), loss_factor=Number(least=0.0, most=10.0), points=POINTS,
         load_factor=Number(), at_time=Number(unit="s"), held=which_sliders, planar=Flag(), shapes=Flag(), backend=Word())
def frequency_response(model: Model, frequencies: ArrayLike, *, state: State | None = None, loads: Loads | None = None,
                       base: ArrayLike | Mapping[Support, ArrayLike] | None = None,
                       damping_ratio: float = 0.0, loss_factor: float = 0.0, points: Mapping[str, Place] | None = None,
                       load_factor: float = 1.0, at_time: float | None = None, held: bool | str | Sequence[str] = False,
                       planar: bool | None = None, shapes: bool = False, backend: str = "auto") -> FrequencyResponse:
    """Compute steady vibrations about an equilibrium under harmonic loads or motions of supports, at each frequency from the
    equations themselves, (K + i w C - w^2 M) x = f, not from a sum over modes (theory.md 14).

    All damping of the scene is in C: damped sections, linear drag, dampers in joints, springs and bushings, viscous and
    smoothed friction and drives of sliders, laws of forces that depend on velocities. Drag by the square of the velocity has no
    linear part at rest; what Coulomb friction holds stays, as in `modes`.

    Parameters
    ----------
    model : Model
    frequencies : array_like [f]
        Hz, >= 0.
    state : State, optional
        An equilibrium, as in `modes`; default: the reference.
    loads : str, Load, DistributedLoad, sequence or mapping of them, optional
        Amplitudes of harmonic forces and moments: loads of the scene by their names, or loads made for this, on its beams, bodies
        and nodes. A mapping gives every one a factor, which may be complex: {"shaker": 1.0, other: 1j} lags by a quarter of a
        period. Time functions of loads do not count here.
    base : array_like (3,) or (6,) or mapping, optional
        Amplitude of the motion of all supports together, m, or of some of them alone: {clamp: (1e-3, 0, 0)} with the Clamp, Pin
        or PrescribedMotion, or the node that it holds. Numbers may be complex. What supports hold of triads stays. Six numbers
        are a displacement and a turn, rad, of all supports about the origin of space, of one about its node, a clamped one.
    damping_ratio : float
        Damping ratio of all modes up to twice the largest frequency, besides the damping of the scene.
    loss_factor : float
        Structural damping: stresses of beams lead their strains by this, C (1 + i loss_factor) E. The stiffness of stresses that
        there are (a taut string) loses nothing.
    points : mapping
        name -> node, body, body point, mass, or (beam, s), as in `simulate`.
    load_factor, at_time, held, planar, backend
        As in `modes`.
    shapes : bool
        Keep the motion of all nodes.

    Returns
    -------
    FrequencyResponse
        Complex amplitudes: `.point(name)` [f, 3], `.spin(name)`, `.slide(name)`, `.peaks(name)`; `plot_response` draws them.

    Raises
    ------
    SceneError
        No excitation, or one of what is not in the scene; the state is no equilibrium; a load at frequency 0 that nothing holds.
    ConvergenceError
        A frequency is that of an undamped mode, where the amplitude has no bounds.

    Examples
    --------
    >>> import numpy as np, fastbeam as fb
    >>> bar = fb.Section.circle(radius=0.01, E=2e11, rho=7800.0, damping=1e-4)
    >>> beam = fb.Beam.straight('beam', (0, 0, 0), (1, 0, 0), section=bar, elements=4)
    >>> model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    >>> shaker = fb.Load('shaker', beam.end, force=(0, 0, 1.0))
    >>> found = fb.frequency_response(model, np.linspace(5, 20, 61), loads=shaker, points={'tip': beam.end})
    >>> f'{found.peaks("tip")[0][0]:.2f} Hz'
    '14.25 Hz'
    """
    about, _ = linearised_at("frequency_response", model, state, load_factor, at_time, held, planar, backend)
    if not frequencies.size or frequencies.size > MOST_FREQUENCIES or np.any(frequencies < 0.0):
        raise SceneError(f"frequency_response, frequencies: must be 1 to {MOST_FREQUENCIES} numbers >= 0 Hz, got "
                         f"{shown(frequencies)}")
    damping_ratio, loss_factor = float(damping_ratio), float(loss_factor)
    if loss_factor:
        require(Analysis.LOSS_FACTOR, model)
    places = {name: place_of(model, name, what, about.stepper.state.s) for name, what in (points or {}).items()}
    found = equilibrium_of("frequency_response", about, LEAST, backend, state)
    moved, vectors = _base(model, base, about.q[:, 0])
    settled = about
    if moved is not None:
        settled = Linearisation(model, about.stepper.state if state is None else state, about.sliding, about.factors,
                                about.size == 3, moved, resting=about.resting)
        settled.stepper.core_state.force[:] = about.stepper.core_state.force
        settled.stepper.load_at(*about.stepper.law_work[:2].tolist())
        if settled.stepper.motion is not None:
            settled.stepper.motion.follow(about.stepper.motion)
    excitation = _excitation(model, settled, loads, vectors)
    ratios = None
    if damping_ratio > NO_DAMPING:
        ratios = _ratios(about, settled, found, damping_ratio, UP_TO * 2.0 * np.pi * float(frequencies.max()), backend)
    turning = {k for k, what in enumerate((points or {}).values()) if isinstance(what, NodeRef)}
    response = _Response(model, settled, excitation, found, places, turning, shapes)
    result = response.at(frequencies, loss_factor, ratios, backend)
    result.events = events_about(about, found)
    return result


class _Response:
    """One excitation of one linearised scene."""

    def __init__(self, model: Model, about: Linearisation, excitation: Excitation, found: Eigen,
                 places: dict[str, tuple[Array, Array]], turning: set[int], shapes: bool) -> None:
        self.model, self.about, self.excitation, self.places, self.shapes = model, about, excitation, places, shapes
        # points that are nodes of beams
        self.turning = turning
        self.found = found

    def at(self, frequencies: Array, loss_factor: float, ratios: Any, backend: str) -> FrequencyResponse:
        about, e, model = self.about, self.excitation, self.model
        pencil = with_still(about.assembled()[0], e.forces)
        damping = about.damping()
        loss = loss_factor * about.material() if loss_factor else None
        k, n = about.free.size, pencil.multiplier.size
        live = np.setdiff1d(np.arange(n), e.number)
        inside = live[live < k]
        part = Pencil(pencil.stiffness[live][:, live].tocsr(), pencil.mass[inside][:, inside].tocsr(), pencil.multiplier[live],
                      pencil.is_symmetric, pencil.still[inside], pencil.turns[live])
        system = DynamicStiffness(part, damping[inside][:, inside], None if loss is None else loss[inside][:, inside], ratios,
                                  backend)
        f, count = len(frequencies), len(self.places)
        nowhere = np.full((f, count, 3), np.nan, complex)
        out = np.zeros((f, count, 3), complex), nowhere, np.zeros((f, about.core.n_sliders), complex)
        motions = np.zeros((f, model.n_nodes, 3), complex) if self.shapes else None
        residuals, sensitivity, uncertainty = np.zeros(f), np.zeros(f), np.zeros(f)
        for j, frequency in enumerate(frequencies.tolist()):
            rate = 2j * np.pi * frequency
            right = np.zeros(n, complex)
            right[:k] = e.forces
            if e.number.size:
                moving = np.zeros(n, complex)
                moving[e.number] = e.motion
                right -= pencil.stiffness @ moving
                right[:k] -= (rate * damping + rate * rate * pencil.mass + (0.0 if loss is None else 1j * loss)) @ moving[:k]
            self._check_free(rate, right[:k])
            try:
                solver = system.factored(rate)
                x = solver.solve(right[live])
                residuals[j] = solver.residual
                by_rate = system.mass @ x * (2.0 * rate) + system.damping @ x
                lever = np.linalg.norm(solver.solve(-rate * by_rate) / solver.scale[:x.size])
                sensitivity[j] = lever / (float(np.linalg.norm(x / solver.scale[:x.size])) or 1.0)
                uncertainty[j] = solver.noise(x)
            except SingularError:
                sensitivity[j] = uncertainty[j] = np.inf
            if not uncertainty[j] < NO_DIGITS:
                raise _no_answer(model, frequency, sensitivity[j], uncertainty[j])
            whole = np.zeros(n, complex)
            whole[live] = x
            whole[e.number] += e.motion
            self._put(j, whole, out, motions)
        info = {"scene": model.scene_name, "method": "frequency response", "excitation": e.text, "solver": system.name,
                "moves_in": "space" if about.size == 6 else "plane", "unknowns": k, "loss_factor": loss_factor,
                "held_sliders": about.held_sliders,
                "modes_with_ratio": 0 if ratios is None else int(ratios[1].size)}
        names = {**model.names, "points": list(self.places)}
        return FrequencyResponse(np.array(frequencies), *out, residuals, sensitivity, uncertainty, motions, info, names,
                                 about.own_shape()[0])

    def _put(self, j: int, x: Array, out: tuple[Array, Array, Array], motions: Array | None) -> None:
        """Put amplitudes of points and sliders at frequency j into the arrays."""
        about = self.about
        k = about.free.size
        rates = (about.lift @ x[:k]).reshape(-1, 4, 3)
        for p, (nodes, weights) in enumerate(self.places.values()):
            out[0][j, p] = np.einsum("ma,mac->c", weights, rates[nodes])
            if len(nodes) == 1:
                out[1][j, p] = 0.5 * np.cross(about.q[nodes[0], 1:], rates[nodes[0], 1:]).sum(axis=0)
            elif p in self.turning:
                d = nearest_triads(np.einsum("m,mkc->kc", weights[:, 0], about.q[nodes, 1:]))
                out[1][j, p] = 0.5 * np.cross(d, np.einsum("m,mkc->kc", weights[:, 0], rates[nodes, 1:])).sum(axis=0)
        out[2][j] = x[k:k + about.core.n_sliders] * about.sliding
        if motions is not None:
            motions[j] = about.own_rows(rates[None, :, 0], np.zeros((1, len(rates), 3)))[0][0]

    def _check_free(self, rate: complex, right: Array) -> None:
        """Refuse a constant force along a free motion. Raises SceneError."""
        if rate != 0.0 or self.excitation.number.size:
            return
        still = self.found.factors.pencil.still
        size = self.about.force_size(right)
        pushed = np.abs(still.T @ right) > PUSHED * self.about.core.length * size if still.shape[1] else np.zeros(0, bool)
        free = self.found.vectors[:right.size, self.found.values == 0.0]
        along = self.about.mass @ (free @ (free.T @ right))
        if pushed.any() or self.about.force_size(along) > ALONG_FREE * size:
            raise SceneError("frequency_response: at frequency 0 the scene has no static equilibrium under the loads, because it "
                             "is not supported; leave 0 Hz out, or add supports")


def _ratios(about: Linearisation, settled: Linearisation, found: Eigen, ratio: float, highest: float,
            backend: str) -> tuple[Array, Array, Array] | None:
    """Return M times the modes up to an angular frequency, in the unknowns that respond; their frequencies and ratios.

    Raises SceneError: there are too many, or moments leave no modes that are independent.
    """
    if not found.factors.pencil.is_symmetric:
        raise SceneError("frequency_response: damping_ratio= needs a symmetric stiffness, which moments with fixed axes exclude; "
                         "use damping= of sections, or loss_factor=")
    # number of these modes, by one factorisation
    n = 20
    try:
        counted = Shifted(found.factors.pencil, highest**2, backend).below
    except SingularError:
        counted = None
    if counted is not None:
        n = min(max(counted - found.factors.pencil.still.shape[1], 0) + 1, MOST_MODES)
    while True:
        found = equilibrium_of("frequency_response", about, n, backend, None)
        w = np.sqrt(np.maximum(np.real(found.values), 0.0))
        if not w.size or w[-1] > highest or w.size < n:
            break
        if n >= MOST_MODES:
            raise SceneError(f"frequency_response: damping_ratio= needs all modes up to {highest / (2.0 * np.pi):.6g} Hz, which "
                             f"are more than {MOST_MODES}; ask for lower frequencies, or use damping= of sections or "
                             "loss_factor=")
        n = min(2 * n, MOST_MODES)
    some = np.flatnonzero((w > 0.0) & (w <= highest))
    if not some.size:
        return None
    product = about.mass @ found.vectors[:about.free.size, some]
    # the unknowns of supports that move are further ones, which are left out again
    is_free = np.isin(settled.free, about.free)
    assert int(is_free.sum()) == about.free.size
    return product, w[some], np.full(some.size, ratio)


def _no_answer(model: Model, frequency: float, sensitivity: float, uncertainty: float) -> ConvergenceError:
    """Form the error of a frequency without a response."""
    who = f"frequency_response of scene {model.scene_name!r}"
    if sensitivity > UNDAMPED:
        return ConvergenceError(f"{who}: {frequency:.10g} Hz is the frequency of an undamped mode, where the amplitude is "
                                "infinite; leave it out, or give damping: damping= of sections, Drag(linear=), damping_ratio=, "
                                "loss_factor=")
    return ConvergenceError(f"{who}: at {frequency:.10g} Hz the result is lost in round-off (share {uncertainty:.1g}): a part "
                            "has neither stiffness nor mass, or stiffnesses differ too much (beams more slender than 1e5)")


# --- what excites -----------------------------------------------------------------------------------------------------------
def _excitation(model: Model, about: Linearisation, loads: Loads | None, vectors: dict[int, Array]) -> Excitation:
    """Form the amplitudes of excitation on the unknowns; vectors: as of `_base`.

    Raises SceneError: there is none, or one on what is not in the scene.
    """
    forces, texts = np.zeros(about.free.size, complex), []
    for load, factor in _loads(model, loads):
        of_nodes = np.zeros((model.n_nodes, 6))
        try:
            if isinstance(load, Load):
                of_nodes[model.numbers.number(load.at)] = np.concatenate((load.force, load.moment))
            else:
                begin = model.numbers.start(load.beam)
                for columns, target in distributed(load):
                    of_nodes[begin:begin + len(target), columns] += target
        except KeyError:
            raise SceneError(f"frequency_response: {load.kind} {load.name!r} acts on a part that is not in scene "
                             f"{model.scene_name!r}; let it act on parts of the compiled scene") from None
        forces += factor * about.on_rows(of_nodes)
        texts.append(f"{load.kind} {load.name!r}")
    number, motion = [], []
    for node, vector in vectors.items():
        row = int(about.core.pattern.row_of[node])
        plane = about.stepper.plane
        within = vector
        if plane is not None:
            place, turn = plane.axes @ vector[:3], plane.axes @ vector[3:] if vector.size == 6 else np.zeros(3)
            if np.abs(place[2]) > 1e-9 * np.linalg.norm(place) or np.linalg.norm(turn[:2]) > 1e-9 * np.linalg.norm(turn):
                raise SceneError("frequency_response: base= moves supports out of the plane of the scene; leave planar out")
            within = np.append(place[:2], turn[2:]) if vector.size == 6 else place[:2]
        at = np.searchsorted(about.free, about.size * row + np.arange(within.size))
        number.append(at)
        motion.append(within)
    if vectors:
        texts.append("motion of the base")
    if not texts:
        raise SceneError("frequency_response: nothing excites the scene; give loads= (names of its loads, or Load objects) or "
                         "base=")
    if number:
        first, at = np.unique(np.concatenate(number), return_index=True)
        return Excitation(forces, first, np.concatenate(motion)[at].astype(complex), ", ".join(texts))
    return Excitation(forces, np.zeros(0, np.int64), np.zeros(0, complex), ", ".join(texts))


def _loads(model: Model, loads: Loads | None) -> list[tuple[Load | DistributedLoad, complex]]:
    """Return loads with their factors. Raises SceneError."""
    if loads is None:
        return []
    need = "a Load, a DistributedLoad, the name of a load of the scene, several of them, or a mapping to factors"
    if isinstance(loads, (str, Load, DistributedLoad)):
        loads = (loads,)
    pairs = list(loads.items()) if isinstance(loads, Mapping) else [
        (load, 1.0) for load in take(Listing(Anything(), need), "frequency_response, loads:", loads)]
    out = []
    for load, factor in pairs:
        if isinstance(load, str):
            if load not in model.load_parts:
                raise SceneError(f"frequency_response: scene {model.scene_name!r} has no load {load!r}; its loads: "
                                 f"{known(model.load_parts, load)}")
            load = model.load_parts[load]
        if not isinstance(load, (Load, DistributedLoad)):
            raise SceneError(f"frequency_response, loads: must be {need}, got {shown(load)}")
        out.append((load, _complex(f"the factor of {load.kind} {load.name!r}", factor)))
    return out


def _base(model: Model, base: ArrayLike | Mapping[Support, ArrayLike] | None,
          places: Array) -> tuple[Array | None, dict[int, Array]]:
    """Return bits of the unknowns of nodes that move, as `Linearisation` takes them, and displacements [3] of nodes, of those
    that turn displacements and turns [6]; places: of the nodes [N, 3].

    Raises SceneError.
    """
    if base is None:
        return None, {}
    held = standing_supports(model)
    moved, vectors = np.zeros(model.n_nodes, np.int64), {}
    if isinstance(base, Mapping):
        if not base:
            raise SceneError("frequency_response: base= is an empty mapping")
        for what, value in base.items():
            vector = _vector(f"base= of {shown(what)}", value)
            node = supported("frequency_response: base=", model, what, held)
            if vector.size == 6:
                check_turned("frequency_response: base=", model, node, held)
            vectors[node] = vector
    else:
        vector = _vector("base=", base)
        # of some axes alone
        some = np.flatnonzero((held & 7 != 0) & (held & 7 != 7))
        if some.size:
            raise SceneError("frequency_response: base= moves supports that fix a whole position, but that of "
                             f"{model.labels[some[0]]} fixes some axes only; name the supports that move: base={{support: "
                             "(...)}")
        for node in np.flatnonzero(held & 7 == 7).tolist():
            of_node = vector.copy()
            if vector.size == 6:
                of_node[:3] += np.cross(vector[3:], places[node])
            vectors[node] = of_node if held[node] & 56 == 56 else of_node[:3]
        if not vectors:
            raise SceneError(f"frequency_response: base= moves supports, but none in scene {model.scene_name!r} fixes a position")
    for node, vector in vectors.items():
        moved[node] = 63 if vector.size == 6 else 7
    return moved, vectors


def _vector(who: str, value: Any) -> Array:
    """Return three finite numbers, or six, which may be complex."""
    flat = isinstance(value, (tuple, list)) or isinstance(value, np.ndarray) and value.ndim == 1
    items = list(value) if flat and not is_masked(value) else []
    if len(items) not in (3, 6):
        raise SceneError(f"frequency_response: {who} must be 3 finite numbers, m, or 6 with a turn, rad, which may be complex, "
                         f"got {shown(value)}")
    return np.array([_complex(who, x) for x in items])


def _complex(who: str, value: Any) -> complex:
    """Return a finite number, which may be complex."""
    x = complex(value) if isinstance(value, (complex, np.complexfloating)) else real(value)
    if x is None or not np.isfinite(x) or abs(x) > 1e60:
        raise SceneError(f"frequency_response: {who} must be a finite number, which may be complex, got {shown(value)}")
    return complex(x)
