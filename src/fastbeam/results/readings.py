"""Readings of the rows of a result besides energies and sliders: velocities, section forces, reactions."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import Anything, Word, checked, shown
from fastbeam.interface.errors import SceneError

if TYPE_CHECKING:
    from fastbeam.scene import BallJoint, Clamp, Pin, PrescribedMotion, RigidConnection
    from fastbeam.scene.links import Link

# series of sliders with friction, drives, stops or locks: velocity, forces on the point in the direction of growing s, energies
EXCHANGED = ("friction_loss", "drive_work", "stop_energy", "stop_loss", "lock_loss")
ALONG = ("slide_rate", "force_along", "friction_force", "drive_force", "stop_force", "lock_force", *EXCHANGED)
# series of sleeves with friction on beams that turn in them: angle, rad, and moment of friction on the beam, N m, about d_1
TWISTING = ("twist", "twist_moment")
# series of joint coordinates: angles or distances and their rates; energies of springs, dampers and motors
FREE, IN_JOINTS = ("joint_value", "joint_rate"), ("joint_energy", "joint_loss", "joint_work")
# quantities of springs, and of bushings
SPRINGS, BUSHINGS = ("length", "force", "energy"), ("displacement", "rotation", "force", "moment", "energy")
# one row of the series that pictures and tables read; words: as many as there are names of that kind
ROWS: dict[str, tuple[int | str, ...]] = {
    **dict.fromkeys(("kinetic", "strain", "gravity", "potential", "total", "balance", "external_work", "inner_energy",
                     "iterations", "step_size", "load_factor", "unstable_directions"), ()),
    **dict.fromkeys(("lin_mom", "ang_mom", "inner_spin", "center"), (3,)),
    **dict.fromkeys(("gap", "s_slide", *ALONG, *TWISTING), ("sliders",)), "losses": ("losses",), "works": ("works",),
    **dict.fromkeys((*FREE, *IN_JOINTS, "joint_force", "joint_friction"), ("joints",)),
    **dict.fromkeys(("winch_length", "winch_speed"), ("winches",)), "winch_tension": ("winches", 2),
    **{f"spring_{name}": ("springs",) for name in SPRINGS}, "bushing_energy": ("bushings",),
    **{f"bushing_{name}": ("bushings", 3) for name in BUSHINGS[:-1]},
    **dict.fromkeys(("contact_force", "contact_moment", "slider_position"), ("sliders", 3)), "reaction": ("reactions", 2, 3),
    **dict.fromkeys(("points", "point_velocity", "point_spin", "point_acceleration", "section_force", "section_moment"),
                    ("points", 3)), "point_directors": ("points", 3, 3), "section_balance": ("points", 2, 3)}
# a series with a column for each name of a kind
COLUMNS = {"sliders": "s_slide", "points": "points", "reactions": "reaction", "joints": "joint_value",
           "springs": "spring_length", "bushings": "bushing_energy", "winches": "winch_length"}
# keys of the entries of names: numbers of nodes, or of nodes from 'first' on
PLACES = {"beams": ("first", "count"), "nets": ("first", "count"), "bodies": ("node",), "masses": ("node",)}
# advice for series that are missing
HINTS = {"points": "record positions with simulate(..., points={'tip': beam.end})", "energy": "the energy is 'total'",
         "momentum": "momenta are 'lin_mom' and 'ang_mom'",
         **dict.fromkeys(("kinetic", "strain", "gravity", "potential"), "record it with simulate(..., observe=('energy', ...))"),
         **{series: f"record it with simulate(..., observe=('{kind}', ...), points={{'tip': beam.end}})" for series, kind in (
             ("point_velocity", "velocity"), ("point_spin", "spin"), ("point_directors", "orientation"),
             ("point_acceleration", "acceleration"))},
         "section_force": "record it with simulate(..., observe=('section', ...), points={'root': (beam, 0.0)})",
         "reaction": "record it with simulate(..., observe=('reaction', ...))",
         **dict.fromkeys(("spring_length", "bushing_energy", "winch_length"),
                         "record it with simulate(..., observe=('spring', ...))"),
         **dict.fromkeys(("inner_energy", "inner_spin", "center"), "record it with simulate(..., observe=('inner', ...))")}
NAMED = Word()
SECTION = (("section_force", ("N", "Q2", "Q3")), ("section_moment", ("T", "M2", "M3")))


class Readings:
    """Readings of a result, whose `_series(name)` and `_index(kind, noun, name)` find what was recorded."""

    series: Any
    _series: Any
    _index: Any

    @checked(name=NAMED)
    def velocity(self, name: str) -> np.ndarray:
        """Return the velocity of an observed point [n, 3], m/s; needs `observe=("velocity", ...)`.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such point.
        """
        return self._of_point("point_velocity", name)

    @checked(name=NAMED)
    def acceleration(self, name: str) -> np.ndarray:
        """Return the acceleration of an observed point [n, 3], m/s^2; needs `observe=("acceleration", ...)`.

        Changes of the velocity over the steps before and after a row, in the mean, as contact forces are: of second order in the
        step. At both ends of the run and behind impacts from short steps ahead or back, NaN where these fail. Jumps of velocities
        (impacts, supports that catch) are not in it.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such point.
        """
        return self._of_point("point_acceleration", name)

    @checked(name=NAMED)
    def spin(self, name: str) -> np.ndarray:
        """Return the angular velocity at an observed point [n, 3], rad/s, in axes of space: of its body, or of the section of its
        beam. Needs `observe=("spin", ...)`. A point mass, which nothing turns, has that of the connection that holds it, or 0.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such point.
        """
        return self._of_point("point_spin", name)

    @checked(name=NAMED)
    def orientation(self, name: str) -> np.ndarray:
        """Return the triad at an observed point over time [n, 3, 3], rows d1, d2, d3 in axes of space: of its body, or of the
        section of its beam. Needs `observe=("orientation", ...)`.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such point.
        """
        return self._of_point("point_directors", name)

    def _of_point(self, series: str, name: str) -> np.ndarray:
        recorded: np.ndarray = self._series(series)
        return recorded[:, self._index("points", "point", name)]

    @checked(name=NAMED)
    def section(self, name: str) -> dict[str, np.ndarray]:
        """Return section forces at an observed point of a beam over time, [n] each: N, Q2, Q3 (N) along d1, d2, d3, and T, M2, M3
        (N m) about them; the part behind the section, at larger arc lengths, exerts them on the part before it. Needs
        `observe=("section", ...)`; NaN where the point lies on no beam. Along whole beams: `fb.section_forces`.

        Damped sections (`damping=`) add the stresses of rates of strains, means of the steps around a row as contact forces
        are, of second order in the step.

        With `observe=("section", "reaction", ...)` also 'force' (N) and 'moment' about the section (N m) in space, [n, 3] each,
        from the balance of what lies behind it: in equilibrium with reactions, loads and inertia to round-off (theory.md (4.35));
        means of the steps around a row, as reactions are. They are not known of beams whose elements move with contacts.

        Raises
        ------
        SceneError
            They were not recorded, or there is no such point.
        """
        series = [(self._series(what), names) for what, names in SECTION]
        k = self._index("points", "point", name)
        out = {component: x[:, k, c] for x, names in series for c, component in enumerate(names)}
        if "section_balance" in self.series:
            balance = self._series("section_balance")
            out |= {"force": balance[:, k, 0], "moment": balance[:, k, 1]}
        return out

    @checked(name=NAMED)
    def spring(self, name: str) -> dict[str, np.ndarray]:
        """Return the series of a spring or damper, [n] each: length (m), force (N, positive where it pulls, that of its damper
        included), energy (J) and, where energies were recorded, loss: energy that its damper dissipated since the start (J).
        Needs `observe=("spring", ...)`.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such spring.
        """
        return self._elastic("spring", ("spring", "damper"), name, SPRINGS)

    @checked(name=NAMED)
    def bushing(self, name: str) -> dict[str, np.ndarray]:
        """Return the series of a bushing in the axes that its side a carries: displacement (m) of the point of b and rotation
        (vector, rad) of its triad since t = 0, force (N) and moment (N m) that b exerts on it, dampers included, [n, 3] each;
        energy (J) and, where energies were recorded, loss (J) [n]. Needs `observe=("spring", ...)`.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such bushing.
        """
        return self._elastic("bushing", ("bushing",), name, BUSHINGS)

    @checked(name=NAMED)
    def winch(self, name: str) -> dict[str, np.ndarray]:
        """Return the series of a winch, [n] each: unstressed free length (m), its rate, speed (m/s), tensions at the ends of the
        rope, at the drum and at the load (N; of one segment without its inertia). Needs `observe=("spring", ...)`.

        Raises
        ------
        SceneError
            It was not recorded, or there is no such winch.
        """
        length, tension = self._series("winch_length"), self._series("winch_tension")
        k = self._index("winches", "winch", name)
        return {"length": length[:, k], "speed": self._series("winch_speed")[:, k], "drum_tension": tension[:, k, 0],
                "load_tension": tension[:, k, 1]}

    def _elastic(self, kind: str, nouns: tuple[str, ...], name: str, what: tuple[str, ...]) -> dict[str, np.ndarray]:
        """Return the series of one spring or bushing."""
        self._series(COLUMNS[f"{kind}s"])
        k = self._index(f"{kind}s", kind, name)
        out = {key: self._series(f"{kind}_{key}")[:, k] for key in what}
        if "total" in self.series:
            labels = [f"damping of {noun} {name!r}" for noun in nouns] + [f"damping of {name}"]
            at = [i for i, label in enumerate(self.names.get("losses", [])) if label in labels]
            out["loss"] = self.series["losses"][:, at[0]] if at else np.zeros(len(out["energy"]))
        return out

    @checked(name=Anything())
    def reaction(self, name: str | Clamp | Pin | PrescribedMotion | RigidConnection | BallJoint | Link) -> dict[str, np.ndarray]:
        """Return the force and moment of a support or joint, [n, 3] each: 'force' (N) and 'moment' (N m). A support exerts them
        on what it holds, about its node; a joint on its second part, about the point of the first. Needs
        `observe=("reaction", ...)`.

        In rows of a run they are means of the steps around a row, as contact forces are. NaN where they are not determined: of
        supports and joints that hold the same parts more than once.

        Parameters
        ----------
        name : str, support or joint
            As in `result.names["reactions"]`, or the part itself.

        Raises
        ------
        SceneError
            They were not recorded, or there is no such support or joint.
        """
        label = getattr(name, "name", name)
        if not isinstance(label, str) or isinstance(name, type):
            raise SceneError(f"reaction: name must be the name of a support or joint, or the part itself, got {shown(name)}")
        series = self._series("reaction")
        k = self._index("reactions", "support or joint", label)
        return {"force": series[:, k, 0], "moment": series[:, k, 1]}
