"""A mesh that moves with a bead has the order of the elements at the contact, too (contacts-ahead.md A.7); one that stands still
has none there."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_moving_mesh import Contact, Data, MovingMesh  # noqa: E402

Array = np.ndarray
# where the bead starts, how fast, and when a run ends; MovingMesh(4, 6) and (3, 6) agree in all of these digits
START, RATE, END = 0.37, 0.35, 0.8
EXACT = Contact(0.63464157399, np.array((0.63490590, -0.02591429)), np.array((-0.098189, 2.230976)))


def errors(found: Contact, exact: Contact) -> Array:
    return np.array((abs(found.s - exact.s), np.linalg.norm(found.position - exact.position),
                     np.linalg.norm(found.force - exact.force)))


def standing(elements: int, curve: str) -> Contact:
    """The same on a mesh that stands still."""
    d = Data()
    section = fb.Section(EA=400, GA2=150, GA3=150, GJ=1, EI2=1, EI3=1, rhoA=1, rhoI2=0.01, rhoI3=0.01)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, elements=elements, degree=3)
    bead = fb.PointMass("bead", mass=d.bead, velocity=(RATE, 0, 0))
    scene = fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Slider("run", bead, beam, at=START, curve=curve),
                     gravity=(0, -d.gravity, 0), gravity_time=lambda t: d.weight(t) / d.gravity)
    model = fb.compile_scene(scene, planar=True)
    run = fb.simulate(model, t_end=END, step=4e-4, order=4, every=10**6, progress=False).slider("run")
    return Contact(float(run["s"][-1]), run["position"][-1, :2], run["force"][-1, :2])


@pytest.mark.slow
def test_position_place_and_force_have_the_full_order() -> None:
    off = np.array([errors(MovingMesh(n, 3).run(START, RATE, END, 1e-9), EXACT) for n in (2, 3)])
    orders = np.log(off[0] / off[1]) / np.log(1.5)
    print(f"4 and 6 cubic elements: s, position, force off by {off[0]}, {off[1]}; orders {orders}")
    assert np.all(orders > 4.5) and np.all(off[1] < (1e-7, 2e-7, 3e-5))


@pytest.mark.slow
def test_a_mesh_that_stands_still_is_a_thousand_times_less_accurate() -> None:
    off = np.array([errors(standing(32, curve), EXACT) for curve in ("c1", "own")])
    print(f"32 cubic elements, c1 and own curve: {off}")
    # the same limit, and what the kink costs
    assert np.all(off[:, :2] < 2e-4) and np.all(off[:, 2] < 0.2)
    assert np.all(off[:, :2] > 5e-6) and np.all(off[:, 2] > 1e-3)


@pytest.mark.slow
def test_a_conserving_step_on_a_moving_mesh() -> None:
    mesh = MovingMesh(1, 3, Data(grows=0.0))
    u = mesh.start(START, RATE)
    energy = [mesh.slopes(np.inf, u)[1]]
    for _ in range(10):
        u = mesh.conserving_step(u, 0.01)
        energy.append(mesh.slopes(np.inf, u)[1])
    assert abs(u[mesh.free.size - 1] - START) > 0.02 and np.ptp(energy) < 1e-13
