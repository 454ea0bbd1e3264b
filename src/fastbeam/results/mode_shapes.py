"""Modes of a scene about an equilibrium, without and with damping: the results of `modes`."""
from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import Count, Flag, Number, checked
from fastbeam.interface.errors import SceneError
from fastbeam.interface.result_warnings import Tabled
from fastbeam.results.result import Result
from fastbeam.scene.placing import extent_of

if TYPE_CHECKING:
    from fastbeam.kernels.state import State

Array = np.ndarray
# frames at most: a film of an hour is a mistake
MOST_FRAMES = 20_000
SIZE, FRAMES = Number(above=0.0, most=10.0), Count(2, most=MOST_FRAMES)
# motions without vibration are shown until they have decayed to exp(-this), or have grown from that
DECAYS = 3.0
# rate of growth that may be round-off, next to the size of the rate
GROWS = 1e-10


class Motion:
    """Motion of a mode over one period.

    Shapes at phase p, from 0 to 2 pi, are a Re(x e^(i p)), triads turned by finite rotations about a Re(spin e^(i p)). With decay
    times exp(Re r t), next to the largest of that.

    Parameters
    ----------
    modes : Modes or DampedModes
    k : int
        From 0.
    amplitude : float
        Largest displacement as a share of the size of the scene; largest angle, rad, where nothing but triads turns.
    decay : bool

    Raises
    ------
    SceneError
        There is no such mode.

    Attributes
    ----------
    displacements, spins : complex128 [N, 3]
        a x and a spin, m and rad.
    period : float
        s; of motions to and fro without one 1, with decay the time in which they decay or grow by exp(3).
    """

    def __init__(self, modes: Any, k: int, amplitude: float, decay: bool) -> None:
        check_number(modes, k)
        self.positions, self.directors = modes.positions, modes.directors
        self.rate, x, turn = modes._moving(k)
        swings = self.rate.imag > 0.0
        fades = decay and self.rate.real != 0.0
        self.period = 2.0 * np.pi / self.rate.imag if swings else DECAYS / abs(self.rate.real) if fades else 1.0
        # growth and turns of the whole motion in a period
        self.growth = self.rate.real * self.period if fades else 0.0
        self.turns = float(swings or not fades)
        # a motion of nothing but triads has no displacement to scale
        moves = np.linalg.norm(x, axis=1).max(initial=0.0) > 0.5
        size = amplitude * size_of(self.positions) if moves else amplitude
        self.displacements, self.spins = size * x, size * turn

    def factor(self, share: float) -> complex:
        """Return the factor of the displacements, before their real part is taken, at a time as a share of the period."""
        return complex(np.exp(2j * np.pi * self.turns * share + self.growth * share - max(self.growth, 0.0)))

    def shape(self, share: float) -> tuple[Array, Array]:
        """Return positions [N, 3], m, and directors [N, 3, 3] at a time as a share of the period."""
        by = self.factor(share)
        return self.positions + np.real(by * self.displacements), _turned(self.directors, np.real(by * self.spins))

    def velocity(self, share: float) -> Array:
        """Return velocities of the nodes [N, 3], m/s."""
        rate = complex(self.growth, 2.0 * np.pi * self.turns) / self.period
        return np.real(rate * self.factor(share) * self.displacements)

    def reach(self) -> tuple[Array, Array]:
        """Return positions [N, 3] with the smallest and the largest coordinates that every node comes to."""
        most = np.abs(self.displacements)
        return self.positions - most, self.positions + most


def size_of(positions: Array) -> float:
    """Return the extent of a scene, m; 1 of a point."""
    return extent_of(positions[np.isfinite(positions).all(axis=1)]) or 1.0


def _turned(directors: Array, turn: Array) -> Array:
    """Turn directors [N, 3, 3] about vectors [N, 3], rad (Rodrigues)."""
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    about = turn[:, None, :]
    once = np.cross(about, directors)
    return np.asarray(directors + np.sinc(angle / np.pi) * once
                      + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * np.cross(about, once))


class Motions(Tabled):
    """Common part of modes: motions of all nodes about a shape."""

    _title = "Modes of {}"

    def __init__(self, displacements: Array, spins: Array, slides: Array, residuals: Array, source: Any, info: dict[str, Any],
                 names: Mapping[str, list[Any]], positions: Array, directors: Array) -> None:
        self.slides, self.residuals = slides, residuals
        # of nodes; rows of moving meshes are those of material points
        self._of_nodes = displacements, spins
        self.displacements, self.spins = (displacements, spins) if source is None else source.own_rows(displacements, spins)
        self.info, self.names, self.positions, self.directors = info, dict(names), positions, directors
        self._source = source

    def __len__(self) -> int:
        return self.residuals.size

    def _words(self, k: int) -> tuple[str, bool]:
        """Return the title of mode k in a picture, and whether it grows."""
        return f"{k}", False

    def _moving(self, k: int) -> tuple[complex, Array, Array]:
        """Return rate, 1/s, and displacements and spins [N, 3] of mode k as it moves, complex where these have phases."""
        return 0j, self.displacements[k], self.spins[k]

    @checked(k=Count(0), amplitude=SIZE, frames=FRAMES, decay=Flag())
    def motion(self, k: int, amplitude: float = 0.12, frames: int = 24, decay: bool = False) -> Result:
        """Return shapes of one period of a mode as snapshots of a `Result`, for ParaView (`.to_vtk`) and pictures; films:
        `animate`.

        Shapes are those of Re(x e^(i p)) at phases p from 0 on, in equal steps without the end of the period, so that they go on
        where they begin; with the velocities of the motion. Motions without a period (free, growing, more than critically damped)
        go to and fro once, in a period of 1 s.

        Parameters
        ----------
        k : int
            From 0.
        amplitude : float
            Largest displacement, as a share of the size of the scene; of modes in which nothing but triads turns the largest
            angle, rad.
        frames : int
            Snapshots.
        decay : bool
            With decay or growth, e^(r t) as it is; what does not swing decays to e^-3, or grows from that.

        Raises
        ------
        SceneError
            There is no such mode.
        """
        moving = Motion(self, k, amplitude, decay)
        shares = np.arange(frames) / frames
        phi, directors = (np.array(x) for x in zip(*(moving.shape(share) for share in shares)))
        return Result(t=moving.period * shares, names=self.names, t_snap=moving.period * shares, phi=phi, directors=directors,
                      velocities=np.array([moving.velocity(share) for share in shares]),
                      info={"scene": self.info["scene"], "method": f"mode {k}", "period": moving.period, "conserved": []})


class Modes(Motions):
    """Natural vibrations of a scene about an equilibrium, by w^2, unstable ones first (theory.md 11).

    Attributes
    ----------
    squared : float64 [n]
        w^2, rad^2/s^2: negative where the motion grows, 0 where it is free (within the round-off of the stiffness).
    angular, frequencies : float64 [n]
        w, rad/s, and w/2 pi, Hz; 0 where the motion is free or grows without swinging.
    growth : float64 [n]
        Rate, 1/s, with which the motion grows; 0 of vibrations.
    displacements, spins : float64 [n, N, 3]
        Motion of all nodes. The largest displacement is 1 m, or, where nothing but triads turns, the largest spin 1 rad.
    slides : float64 [n, S]
        Motion of the sliding coordinates, m.
    modal_mass : float64 [n]
        Modal mass of shapes of this size: twice the kinetic energy at unit velocity, kg (kg m^2 where triads turn).
    effective_mass : float64 [n, 3]
        Share of a mode in the inertia against motions of the base along x, y, z, kg; at a free or growing mode too.
    residuals : float64 [n]
        Size of K x - B^T m - w^2 M x, relative to the sum of the sizes of its terms.
    uncertainty : float64 [n]
        Uncertainty of w^2 by round-off of the stiffness.
    left_out : int
        Beams of nets that may spin about their axes: their free motions are not among the modes.
    is_complete : bool
        Whether the number of pivots of K - w^2 M confirms that no mode below the last is missing.
    info, names : dict
        Facts; names of parts as in a `Result`.
    events : list of dict
        Events where the modes are not to be trusted, as in a `Result`.
    positions : float64 [N, 3]
        Positions of the equilibrium.
    directors : float64 [N, 3, 3]
    """

    def __init__(self, values: Array, displacements: Array, spins: Array, slides: Array, modal_mass: Array,
                 effective_mass: Array, residuals: Array, uncertainty: Array, source: Any, info: dict[str, Any],
                 names: Mapping[str, list[Any]], positions: Array, directors: Array) -> None:
        super().__init__(displacements, spins, slides, residuals, source, info, names, positions, directors)
        root = np.sqrt(values.astype(complex))
        self.squared = np.real(values).astype(float)
        self.angular, self.growth = np.real(root), np.abs(np.imag(root))
        self.frequencies = self.angular / (2.0 * np.pi)
        self.modal_mass, self.effective_mass, self.uncertainty = modal_mass, effective_mass, uncertainty
        self.left_out, self.is_complete = int(info["left_out"]), bool(info["complete"])

    @property
    def unstable(self) -> int:
        """Number of modes that grow."""
        return int(np.sum(self.growth > 0.0))

    @checked(k=Count(0))
    def shape(self, k: int) -> tuple[Array, Array]:
        """Return mode k as rates of positions [N, 3] and of directors [N, 3, 3].

        Raises
        ------
        SceneError
            There is no such mode.
        """
        check_number(self, k)
        return self.displacements[k], np.cross(self.spins[k][:, None, :], self.directors)

    @checked(k=Count(0), amplitude=Number(unit="m"), phase=Number(unit="rad"))
    def state(self, k: int, amplitude: float, phase: float = 0.0) -> State:
        """Return a state to start a run from, or to draw: the equilibrium moved by amplitude cos(phase) times mode k, with the
        velocities of a vibration, -amplitude w sin(phase) times the mode.

        Triads turn by finite rotations; joints and sliders, which a mode closes to first order, are closed exactly. With
        phase=-pi/2 the run starts from the equilibrium itself. Modes that are free or grow have the velocity
        -amplitude sin(phase) times the mode.

        Parameters
        ----------
        k : int
            From 0.
        amplitude : float
            Largest displacement of a node, m; of modes in which nothing but triads turns the largest angle, rad.
        phase : float
            rad.

        Raises
        ------
        SceneError
            There is no such mode.
        """
        check_number(self, k)
        a = amplitude * float(np.cos(phase))
        rate = -amplitude * (float(self.angular[k]) or 1.0) * float(np.sin(phase))
        x, turn = (of[k] for of in self._of_nodes)
        return self._source.moved(a * x, a * turn, a * self.slides[k], rate * x, rate * turn)

    def _words(self, k: int) -> tuple[str, bool]:
        what = f"grows, {self.growth[k]:.4g} 1/s" if self.growth[k] else f"{self.frequencies[k]:.5g} Hz"
        return what if self.squared[k] else "free", bool(self.growth[k])

    def _moving(self, k: int) -> tuple[complex, Array, Array]:
        rate, x, turn = complex(self.growth[k], self.angular[k]), self.displacements[k], self.spins[k]
        if not (rate.real and rate.imag):
            return rate, x.astype(complex), turn.astype(complex)
        # of what grows and swings two modes are listed, a and b, the motion is that of a - i b, and b + i a a quarter behind
        pairs = (self.growth > 0.0) & (self.angular > 0.0)
        other = k + 1 if np.sum(pairs[:k]) % 2 == 0 else k - 1
        sign = 1j * (k - other)
        return rate, x + sign * self.displacements[other], turn + sign * self.spins[other]

    def table(self) -> str:
        """Return a text: frequency, w, rate of growth, residual and effective masses of every mode."""
        rows = [f"{'mode':>4} {'Hz':>14} {'rad/s':>14} {'growth 1/s':>11} {'residual':>9}   effective mass x, y, z [kg]"]
        for k in range(len(self)):
            masses = " ".join(f"{x:10.3g}" for x in self.effective_mass[k])
            rows.append(f"{k:4d} {self.frequencies[k]:14.8g} {self.angular[k]:14.8g} {self.growth[k]:11.4g} "
                        f"{self.residuals[k]:9.1e}   {masses}")
        more = []
        if self.left_out:
            more.append(f"{self.left_out} beams of nets may spin about their axes; these modes are not listed")
        if not self.is_complete:
            more.append("an inertia count could not confirm that no modes are missing between these")
        return "\n".join([*rows, *more, *self._doubts()])


class DampedModes(Motions):
    """Motions Re(x e^(r t)) of a scene with damping about an equilibrium, by |r| (theory.md 14).

    A vibration is listed by its motion with positive Im r; with more than critical damping it is two motions without vibration,
    each with a rate of its own.

    Attributes
    ----------
    rates : complex128 [n]
        r, 1/s.
    decay : float64 [n]
        -Re r, 1/s; negative where the motion grows.
    angular, frequencies : float64 [n]
        Im r, rad/s, and Im r/2 pi, Hz: of the damped vibration; 0 of what does not swing.
    undamped : float64 [n]
        |r|, rad/s: where damping does not couple modes the angular frequency without it.
    damping_ratios : float64 [n]
        -Re r/|r|: 1 or -1 of what does not swing; 0 of a free motion.
    displacements, spins : complex128 [n, N, 3]
        Motion of all nodes. The largest displacement is 1 m, or, where nothing but triads turns, the largest spin 1 rad.
    slides : complex128 [n, S]
        Motion of the sliding coordinates, m.
    residuals : float64 [n]
        Size of (K + r C + r^2 M) x - B^T m, relative to the sum of the sizes of its terms.
    info, names : dict
        Facts; names of parts as in a `Result`.
    events : list of dict
        Events where the modes are not to be trusted, as in a `Result`.
    positions, directors : float64 [N, 3], [N, 3, 3]
        Shape of the equilibrium.
    """

    _title = "Damped modes of {}"

    def __init__(self, rates: Array, displacements: Array, spins: Array, slides: Array, residuals: Array, source: Any,
                 info: dict[str, Any], names: Mapping[str, list[Any]], positions: Array, directors: Array) -> None:
        super().__init__(displacements, spins, slides, residuals, source, info, names, positions, directors)
        self.rates = rates
        self.decay, self.angular, self.undamped = 0.0 - np.real(rates), np.imag(rates), np.abs(rates)
        self.frequencies = self.angular / (2.0 * np.pi)
        self.damping_ratios = np.divide(self.decay, self.undamped, out=np.zeros(rates.size), where=self.undamped > 0.0)

    @property
    def unstable(self) -> int:
        """Number of modes that grow, by more than round-off of their rates."""
        return int(np.sum(self.decay < -GROWS * self.undamped))

    @checked(k=Count(0), amplitude=Number(unit="m"), phase=Number(unit="rad"))
    def state(self, k: int, amplitude: float, phase: float = 0.0) -> State:
        """Return a state to start a run from: the equilibrium moved by amplitude Re(x e^(i phase)), with the velocities of the
        motion; in space, with those of the spin, where the modes are those of a steady motion.

        Parameters
        ----------
        k : int
            From 0.
        amplitude : float
            Largest displacement of a node, m; of modes in which nothing but triads turns the largest angle, rad.
        phase : float
            rad.

        Raises
        ------
        SceneError
            There is no such mode, or beams travel: their nodes stand still while their material passes.
        """
        check_number(self, k)
        a = amplitude * np.exp(1j * phase)
        (x, turn), rate = (of[k] for of in self._of_nodes), self.rates[k]
        moved = np.real(a * x)
        return self._source.moved(moved, np.real(a * turn), np.real(a * self.slides[k]),
                                  *self._in_space(moved, np.real(a * rate * x), np.real(a * rate * turn)))

    def _in_space(self, displacement: Array, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Return velocities and spins [N, 3] in space of nodes moved by so much."""
        return velocity, spin

    def _words(self, k: int) -> tuple[str, bool]:
        grows = bool(self.decay[k] < 0.0)
        swing = f"{self.frequencies[k]:.5g} Hz, " if self.frequencies[k] else ""
        rate = f"{'grows' if grows else 'decays'}, {abs(self.decay[k]):.4g} 1/s"
        rate = f"ratio {self.damping_ratios[k]:.3g}" if swing else rate
        return swing + rate if self.rates[k] else "free", grows

    def _moving(self, k: int) -> tuple[complex, Array, Array]:
        return complex(self.rates[k]), self.displacements[k], self.spins[k]

    def table(self) -> str:
        """Return a text: damped and undamped frequency, damping ratio, decay and residual of every mode."""
        rows = [f"{'mode':>4} {'Hz':>14} {'undamped Hz':>14} {'damping ratio':>14} {'decay 1/s':>12} {'residual':>9}"]
        for k in range(len(self)):
            rows.append(f"{k:4d} {self.frequencies[k]:14.8g} {self.undamped[k] / (2.0 * np.pi):14.8g} "
                        f"{self.damping_ratios[k]:14.7g} {self.decay[k]:12.5g} {self.residuals[k]:9.1e}")
        if self.unstable:
            rows.append(f"{self.unstable} of these motions grow: flutter where they have a frequency, divergence where they have "
                        "none")
        return "\n".join([*rows, *self._doubts()])


class SteadyModes(DampedModes):
    """Motions Re(x e^(r t)) about a steady motion, by |r| (theory.md 17): as `DampedModes`, seen from the frame that spins, or
    beside which beams travel.

    Attributes
    ----------
    whirl : float64 [n]
        About a spin: 1 for modes that circle the axis forward, in the sense of the spin, as seen from space, -1 backward, 0 for
        motions to and fro or along the axis, and for a `Travel`. By share of the kinetic energy.
    in_space : float64 [n]
        Frequency of modes that circle as seen from space, Hz; positive forward. NaN for others.
    is_complete : bool
        Whether a count of signs confirms that no mode below the last is missing; False where K alone is not stable, as beyond a
        critical speed, or something is damped.
    """

    _title = "Modes of {} in steady motion"

    def __init__(self, rates: Array, displacements: Array, spins: Array, slides: Array, residuals: Array, source: Any,
                 info: dict[str, Any], names: Mapping[str, list[Any]], positions: Array, directors: Array, whirl: Array,
                 in_space: Array) -> None:
        super().__init__(rates, displacements, spins, slides, residuals, source, info, names, positions, directors)
        self.whirl, self.in_space, self.is_complete = whirl, in_space, bool(info["complete"])

    def _in_space(self, displacement: Array, velocity: Array, spin: Array) -> tuple[Array, Array]:
        return self._source.in_motion(displacement, velocity, spin)  # type: ignore[no-any-return]

    def table(self) -> str:
        """Return a text: frequency in the frame and in space, whirl, growth and residual of every mode."""
        rows = [f"{'mode':>4} {'Hz':>14} {'Hz in space':>14} {'whirl':>8} {'decay 1/s':>12} {'residual':>9}   "
                f"{self.info['steady']}"]
        for k in range(len(self)):
            rows.append(f"{k:4d} {self.frequencies[k]:14.8g} {self.in_space[k]:14.8g} {self.whirl[k]:8.3f} "
                        f"{self.decay[k]:12.5g} {self.residuals[k]:9.1e}")
        if not self.is_complete:
            rows.append("a count could not confirm that no modes are missing between these")
        return "\n".join([*rows, *self._doubts()])


def check_number(modes: Motions, k: int) -> None:
    """Check that there is a mode of this number.

    Raises
    ------
    SceneError
    """
    if k >= len(modes):
        raise SceneError(f"mode {k} does not exist: there are {len(modes)}, counted from 0")
