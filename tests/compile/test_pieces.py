"""What `print(model)` says about joints that are there and that are not."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import SECTION, bead, grid, straight  # noqa: E402


def says(*parts: object) -> list[str]:
    """The lines about pieces and missing joints."""
    lines = str(fb.compile_scene(fb.Scene(*parts))).splitlines()
    return [" ".join(line.split()) for line in lines if line.split()[0] in ("together", "NOT")]


def test_connected_pieces_are_counted() -> None:
    a, b, c = (straight(name, (0, y, 0), (1, y, 0)) for name, y in (("a", 0), ("b", 1), ("c", 2)))
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(0, 0.5, 0))
    ring = fb.PointMass("ring", mass=1.0)
    assert says(a, b, c, body) == ["together 4 connected pieces"]
    assert says(a, b, c, body, fb.RigidConnection(a.start, body)) == ["together 3 connected pieces"]
    assert says(a, b, c, body, fb.RigidConnection(a.start, body), fb.BallJoint(body.point((0, 0.5, 0)), b.start), ring,
                fb.Slider("s", ring, c, at=0.5)) == ["together 2 connected pieces"]
    assert says(*bead().parts) == says(*grid(2).parts) == ["together 1 connected piece"]
    net = fb.Net("net", [(0, 0, 5), (1, 0, 5), (2, 0, 5), (0, 1, 5), (1, 1, 5)], [(0, 1), (1, 2), (3, 4)], section=SECTION,
                 joints="ball")
    assert says(net, a) == ["together 3 connected pieces"]


def test_free_ends_that_touch_are_named() -> None:
    a, b = straight("a", (0, 0, 0), (1, 0, 0)), straight("b", (1, 0, 0), (2, 0, 0))
    missing = "NOT JOINED {} lie at the same place without a joint"
    assert says(a, b) == ["together 2 connected pieces", missing.format("beam 'a' node 6 and beam 'b' node 0")]
    assert says(a, b, fb.BallJoint(a.end, b.start)) == ["together 1 connected piece"]
    # an end on a node within a beam, on a body, on a mass
    tee = straight("tee", (0.5, 0, 0), (0.5, 1, 0))
    assert says(a, tee)[1:] == [missing.format("beam 'a' node 3 and beam 'tee' node 0")]
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    assert says(a, body)[1:] == [missing.format("beam 'a' node 6 and body 'body'")]
    mass = fb.PointMass("mass", mass=1.0, position=(1, 0, 0))
    assert says(a, mass)[1:] == [missing.format("beam 'a' node 6 and point mass 'mass'")]
    # two joined, a third forgotten
    c = straight("c", (1, 0, 0), (1, 1, 0))
    assert says(a, b, c, fb.RigidConnection(a.end, b.start))[1:] == [
        missing.format("beam 'a' node 6 and beam 'b' node 0 and beam 'c' node 0")]
    # a ring whose ends were not closed
    ring = fb.Beam.arc("ring", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=2.0 * np.pi, section=SECTION, elements=8)
    assert says(ring)[1:] == [missing.format("beam 'ring' node 0 and beam 'ring' node 24")]


@pytest.mark.parametrize("gap", [1e-8, 1e-6, 1e-4, 9e-4])
def test_free_ends_that_all_but_touch_are_named(gap: float) -> None:
    # as typed coordinates do: 0.866, 0.333333
    a, b = straight("a", (0, 0, 0), (1, 0, 0)), straight("b", (1 + gap, 0, 0), (2, 0, 0))
    apart = "NOT JOINED {} lie " + f"{gap:.2g} m apart without a joint"
    assert says(a, b) == ["together 2 connected pieces", apart.format("beam 'a' node 6 and beam 'b' node 0")]
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(1, gap, 0))
    assert says(a, body)[1:] == [apart.format("beam 'a' node 6 and body 'body'")]
    tee = straight("tee", (0.5, gap, 0), (0.5, 1, 0))
    assert says(a, tee)[1:] == [apart.format("beam 'tee' node 0 and beam 'a' node 3")]
    # a ring that does not quite close
    ring = fb.Beam.arc("ring", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=2.0 * np.pi - gap, section=SECTION, elements=8)
    assert says(ring)[1:] == [apart.format("beam 'ring' node 0 and beam 'ring' node 24")]


def test_ends_that_all_but_touch_for_a_reason_are_not_named() -> None:
    gap = 1e-4
    a, b = straight("a", (0, 0, 0), (1, 0, 0)), straight("b", (1 + gap, 0, 0), (2, 0, 0))
    for joint in (fb.RigidConnection(a.end, b.start), fb.Spring(a.end, b.start, stiffness=1.0, length=0.0)):
        assert says(a, b, joint) == ["together 1 connected piece"]
    assert len(says(a, b, fb.Clamp(a.end), fb.Pin(b.start))) == 1
    cart = fb.PointMass("cart", mass=1.0)
    assert len(says(a, cart, fb.Slider("run", cart, a, at=gap))) == 1
    # of the beam's length: the gap of a small thing is none of a large one, and many elements do not matter
    fine = straight("fine", (0, 0, 0), (1, 0, 0), elements=500)
    assert len(says(fine)) == 1
    small = straight("small", (1 + gap, 0, 0), (1.01, 0, 0))
    assert len(says(a, small)) == 1
    far = straight("far", (1.002, 0, 0), (2, 0, 0))
    assert len(says(a, far)) == 1


def test_many_ends_that_all_but_touch() -> None:
    # a tree finds the same as distances one by one
    import fastbeam.compile.pieces as searched
    n = 200
    beams = [straight(f"{k}", (k, 0.2 * (k % 7), 0), (k + 1, 0.2 * ((k + 1) % 7) + 1e-5 * (k % 3), 0)) for k in range(n)]
    lines = says(*beams)
    few, searched.FEW = searched.FEW, 0
    try:
        assert says(*beams) == lines
    finally:
        searched.FEW = few
    apart = sum(k % 3 > 0 for k in range(n - 1))
    assert lines[-1] == f"NOT JOINED nor are {apart - 4} other ends that almost touch something"


def test_ends_that_touch_for_a_reason_are_not() -> None:
    a, b = straight("a", (0, 0, 0), (1, 0, 0)), straight("b", (1, 0, 0), (2, 0, 0))
    assert len(says(a, b, fb.Clamp(a.end), fb.Pin(b.start))) == 1
    assert len(says(a, b, fb.Clamp(a.end))) == 2
    # a mass that starts at the end of its rail, and an end that slides
    cart = fb.PointMass("cart", mass=1.0)
    assert says(a, cart, fb.Slider("run", cart, a, at=0.0)) == ["together 1 connected piece"]
    assert says(a, b, fb.Slider("run", b.start, a, at=1.0)) == ["together 1 connected piece"]
    # a crossing without an end, and control points
    assert len(says(a, straight("x", (0.5, -0.5, 0), (0.5, 0.5, 0)))) == 1
    arch = fb.Beam.arc("arch", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=1.0, section=SECTION, elements=4, degree=2,
                       interpolation="bspline")
    control = fb.compile_scene(fb.Scene(arch)).q0.reshape(-1, 12)[2, :3]
    assert len(says(arch, straight("s", tuple(control), (5, 5, 5)))) == 1


def test_a_long_list_is_cut() -> None:
    beams = [straight(f"{k}", (k, 0, 0), (k + 1, 0, 0)) for k in range(8)]
    lines = says(*beams)
    assert lines[0] == "together 8 connected pieces" and len(lines) == 6
    assert lines[-1] == "NOT JOINED nor are the nodes at 3 other places"


@pytest.mark.parametrize("torn", [0, 3])
def test_meshes_whose_nodes_were_not_merged_are_found(torn: int) -> None:
    # two halves of a net that share a line of nodes, some of them twice
    n = 40
    line = np.array([(x, 0.0, 0.0) for x in range(n)])
    up, down = line + (0.3, 1.0, 0.0), line - (0.2, 1.0, 0.0)
    nodes = np.concatenate((line, up, down, line[:torn]))
    top = [(k, n + k) for k in range(n)]
    bottom = [((3 * n + k) if k < torn else k, 2 * n + k) for k in range(n)]
    net = fb.Net("net", nodes, top + bottom + [(n + k, n + k + 1) for k in range(n - 1)], section=SECTION)
    lines = says(net)
    assert lines[0] == f"together {1 + torn} connected piece{'s' if torn else ''}"
    assert len(lines) == 1 + torn


def test_hinges_join_what_lies_together() -> None:
    from small_scenes import straight
    a, b = straight("a", (0, 0, 0), (1, 0, 0)), straight("b", (1, 0, 0), (2, 0, 0))
    block = fb.RigidBody("block", mass=1.0, inertia=(1, 1, 1), position=(2, 0, 0))
    scene = fb.Scene(a, b, block, fb.Clamp(a.start), fb.RevoluteJoint(a.end, b.start, axis=(0, 1, 0)),
                     fb.PrismaticJoint(b.end, block, axis=(1, 0, 0)))
    text = str(fb.compile_scene(scene))
    assert "1 connected piece\n" in text and "NOT JOINED" not in text
    # a spring to somewhere else joins nothing that lies at its end
    loose = fb.Scene(a, b, fb.Clamp(a.start), fb.Spring(b.start, a.start, stiffness=1.0))
    assert "NOT JOINED" in str(fb.compile_scene(loose))
