"""Where the numbers that terms remember of the steps before stand in `State.history`."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels.contact.sleeve_twist import TWIST
from fastbeam.kernels.joints.coordinates import VALUE
from fastbeam.kernels.state import State

Array = np.ndarray


class HistoryLayout:
    """Of a compiled scene: forces of sliders, the work of loads, energies taken away, works put in, how far supports have turned,
    how often they have changed, coordinates of joints, sleeves that rub on beams that turn in them, momenta of moving meshes,
    momenta of added mass, and controllers, in this order."""

    n_nodes: int
    slider_forces: Any
    accounts_loads: Any
    damped: Any
    dragged: Any
    dampers: Any
    prescribed: Any
    released: Any
    motions: Any
    twisting: Any
    moving: Any
    added: Any
    controllers: Any

    @property
    def history_size(self) -> int:
        """Numbers that terms remember of the steps before, and controllers, whose numbers come last."""
        own = 0 if self.added is None else int(self.added.size)
        return self.added_place + own + sum(x.size for x in self.controllers)

    @property
    def added_place(self) -> int:
        """Where the momenta of added mass begin."""
        return self.moving_place + (0 if self.moving is None else int(self.moving.size))

    def start_momenta(self, history: Array, q: Array, v: Array) -> None:
        """Momenta of added mass and moving meshes into a history, from coordinates and their rates [12 N], in a plane [4 N]."""
        if self.moving is not None:
            self.moving.start_momenta(history, q, v)
        if self.added is not None:
            own = self.added.momenta(q.reshape(self.n_nodes, -1), v.reshape(self.n_nodes, -1))
            history[self.added_place:self.added_place + own.size] = own

    def stop(self, state: State) -> None:
        """Take the velocities of a state away, and the momenta that stand in its history."""
        state.v[:] = 0.0
        self.start_momenta(state.history, state.q, state.v)

    def momenta_misfit(self, state: State) -> float:
        """The largest difference between velocities of a state and those of the momenta in its history, m/s."""
        out = 0.0 if self.moving is None else self.moving.misfit(state.history, state.q, state.v)
        if self.added is not None:
            own = state.history[self.added_place:self.added_place + self.added.size]
            out = max(out, self.added.misfit(own, state.q, state.v))
        return float(out)

    @property
    def moving_place(self) -> int:
        """Where the momenta of moving meshes begin."""
        return self.twist_place + TWIST * int(self.twisting.size)

    @property
    def twist_place(self) -> int:
        """Where the numbers of sleeves that rub on beams that turn in them begin."""
        return self.motion_place + (0 if self.motions is None else int(self.motions.size))

    @property
    def motion_place(self) -> int:
        """Where the numbers of free coordinates of joints begin."""
        return self.release_place + (0 if self.released is None else int(self.released.size))

    @property
    def release_place(self) -> int:
        """Where it stands how often supports have let go or taken hold."""
        return self.turn_place + (0 if self.prescribed is None else int(self.prescribed.turns_size))

    @property
    def turn_place(self) -> int:
        """Where it stands how far supports have turned since t = 0: rotation vectors of motions that turn."""
        return self.drive_place + len(self.works)

    def turns_of(self, history: Array) -> Array:
        """These numbers of a history, [3 K], rad."""
        return history[self.turn_place:self.release_place]

    def keep_turns(self, history: Array, of: Array) -> None:
        """Count turns of supports and joints in a history as in another."""
        self.turns_of(history)[:] = self.turns_of(of)
        if self.motions is not None:
            self.motions.own(history, self.motion_place)[:, VALUE] = self.motions.own(of, self.motion_place)[:, VALUE]

    @property
    def losses(self) -> tuple[str, ...]:
        """What takes energy away besides sliders: its numbers stand behind the work of loads."""
        damped, dragged = (getattr(x, "labels", ()) for x in (self.damped, self.dragged))
        return (*(f"damping of {label}" for label in damped), *self.dampers, *dragged, *self.catches)

    @property
    def catches(self) -> tuple[str, ...]:
        """Impacts of supports that take hold, the last of `losses`."""
        return () if self.released is None else tuple(self.released.losses)

    @property
    def catch_place(self) -> int:
        """Where what impacts of supports take stands."""
        return self.drive_place - len(self.catches)

    @property
    def works(self) -> tuple[str, ...]:
        """What puts energy in besides loads and drives of sliders: its numbers come last."""
        return () if self.prescribed is None else tuple(self.prescribed.labels)

    @property
    def drive_place(self) -> int:
        """Where the works of moving supports stand."""
        return self.loss_place + len(self.losses)

    @property
    def loss_place(self) -> int:
        """Where the energies stand that were taken away."""
        return self.work_place + self.accounts_loads

    @property
    def balances(self) -> bool:
        """Whether the energy has a balance: something takes energy away or puts some in."""
        return (self.release_place > 0 or (self.motions is not None and self.motions.exchanges)
                or (self.moving is not None and any(self.moving.along)))

    @property
    def work_place(self) -> int:
        """Where the work of loads stands among them."""
        return 0 if self.slider_forces is None else int(self.slider_forces.size)
