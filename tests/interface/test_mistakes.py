"""The likeliest mistakes in every public call: the message names what is wrong and what to write instead."""
from __future__ import annotations

from functools import cache
from typing import Any

import pytest

import fastbeam as fb

SECTION = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
ROD = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2)
MASS, BODY = fb.PointMass("bead", mass=1.0), fb.RigidBody("block", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
NET = fb.Net("roof", [(0, 0, 0), (1, 0, 0)], [(0, 1)], section=SECTION)
SCENE = fb.Scene(ROD, fb.Clamp(ROD.start))


@cache
def model() -> Any:
    return fb.compile_scene(SCENE)


@cache
def run() -> fb.Result:
    return fb.simulate(model(), t_end=1e-3, step=1e-3, progress=False)


NAMES = {"fb": fb, "sec": SECTION, "rod": ROD, "bead": MASS, "block": BODY, "net": NET, "scene": SCENE}
MISTAKES = {
    "fb.Section(1, 2, 3)": "section: takes nothing without a name, got 3 arguments; give the others by name: EA=..., GA2=...",
    "fb.Section(radius=1, E=1, rho=1)": "no argument 'radius'; Section.circle, Section.tube and Section.rectangle take sizes",
    "fb.Section.circle(0.1, 1e9, 1e3)": "give the others by name: radius=..., E=..., rho=...",
    "fb.Section.circle(diameter=0.1, E=1, rho=1)": "has no argument 'diameter'; use radius",
    "fb.Section.circle(radius=0.1, E=1, density=1)": "has no argument 'density'; use rho",
    "fb.Section.circle(radius=0.1, E=1)": "Section.circle: rho missing; it takes radius, E, rho",
    "fb.Section.circle(radius='0.1', E=1, rho=1)": "radius must be a finite number > 0 m, got '0.1'",
    "fb.Section.circle(radius=0.1, E=1, rho=1, contact=1)": "'contact'; fastbeam does not support this, docs/limits.md lists",
    "fb.Section.rectangle(hight=0.1, width=1, E=1, rho=1)": "has no argument 'hight'; did you mean height?",
    "fb.Beam.straight('b', (0,0,0), (1,0,0), sec, 4)": "takes name, start, end without a name, got 5 arguments; give the others "
                                                       "by name: d2=..., twist=..., section=..., elements=...",
    "fb.Beam.straight('b', (0,0,0), (1,0,0), section=sec)": "beam 'b': elements missing",
    "fb.Beam.straight('b', (0,0,0), (1,0,0), E=1e9, elements=4)": "no argument 'E'; use section=fb.Section.circle(radius=",
    "fb.Beam.straight('b', (0,0,0), (1,0,0), section=sec, n_elements=4)": "has no argument 'n_elements'; use elements",
    "fb.Beam.straight('b', (0,0,0), (1,0,0), section=sec, elements=4.0)": "elements must be a whole number >= 1 or the",
    "fb.Beam.straight('b', (0,0,0), (1,0,0), section='steel', elements=4)": "must be a Section, got 'steel'; use",
    "fb.Beam.straight('b', (0,0), (1,0), section=sec, elements=4)": "beam 'b': start must be 3 finite numbers, got (0, 0)",
    "fb.Beam.straight((0,0,0), (1,0,0), 'b', section=sec, elements=4)": "name must be a non-empty text, got (0, 0, 0); the",
    "fb.Beam.straight('b', (0,0,0), (0,0,0), section=sec, elements=4)": "start and end coincide at (0, 0, 0); a beam needs a",
    "fb.Beam('b', (0,0,0), (1,0,0), section=sec, elements=4)": "beam: takes name, curve without a name, got 3 arguments",
    "fb.Beam('b', (0,0,0), section=sec, elements=4)": "curve must have length and reference(s), got (0, 0, 0); use",
    "fb.PointMass('m', 1.0)": "point mass: takes name without a name, got 2 arguments; give the others by name: mass=...",
    "fb.PointMass(mass=1.0)": "point mass: name missing; it takes name, mass, position, velocity",
    "fb.PointMass('m', m=1.0)": "point mass 'm': has no argument 'm'; use mass",
    "fb.PointMass('m', mass='1 kg')": "point mass 'm': mass must be a finite number > 0 kg, got '1 kg'",
    "fb.RigidBody('b', mass=1, inertia=1.0, position=(0,0,0))": "inertia must be 3 finite principal moments or a finite 3 x 3",
    "fb.Clamp(rod)": "clamp: at names the whole beam 'rod'; use its start, end, node(i) or at(s)",
    "fb.Clamp(0)": "got 0; use beam.start, beam.end or beam.node(i)",
    "fb.Clamp('rod')": "got 'rod'; give the object itself, not a name",
    "fb.Clamp(rod.start, rod.end)": "each support holds one node, write one for every node",
    "fb.Clamp(net)": "clamp: at names the whole net 'roof'; use its node(i), or a node of its beam(k)",
    "fb.Pin()": "pin: at missing; it takes at, name, axes, until, since",
    "fb.Pin(rod.start, dofs='yz')": "pin: has no argument 'dofs'; use axes",
    "fb.Pin(rod.start, axes=2)": "pin: axes must name axes of the global frame by their letters, as in axes='yz', got 2",
    "fb.BallJoint('j', rod.end, block)": "ball joint: a must be a node of a beam, a RigidBody, a point of one, or a PointMass,",
    "fb.BallJoint(rod.end)": "ball joint: b missing; it takes a, b, name",
    "fb.RigidConnection(rod.end, rod.end)": "both sides are beam 'rod' node 6; a joint needs two different nodes",
    "fb.Load(rod.end, 'tip', force=(0,0,1))": "text, got <beam 'rod' node 6 (s = 1 m)>; the name comes first",
    "fb.Load('tip', rod, force=(0,0,1))": "load 'tip': at names the whole beam 'rod'; use its start, end",
    "fb.Load('tip', rod.end, (0,0,1))": "give the others by name: force=..., moment=..., time=...",
    "fb.Load('tip', rod.end, force=-10.0)": "load 'tip': force must be 3 finite numbers",
    "fb.Load('tip', rod.end, force=lambda t: (0,0,t))": "got a function; for changes in time give time=a function of t",
    "fb.Load('tip', rod.end, force=(0,0,1), time=2.0)": "time must be a function of t that returns a number, or None, got 2.0",
    "fb.Load('tip', rod.end, force=(0,0,1), time=lambda t: 'x')": "time must return a finite number at t = 0, got 'x'",
    "fb.Load('tip', rod.end, force=(0,0,1), time=lambda: 1.0)": "time must not fail, but raises TypeError at t = 0",
    "fb.DistributedLoad('d', rod.end, force=(0,0,1))": "a Beam, got <beam 'rod' node 6 (s = 1 m)>; give beam 'rod' itself",
    "fb.DistributedLoad('d', rod)": "distributed load 'd': give force or moment per length",
    "fb.InitialVelocity(block, velocity=(1,0,0))": "initial velocity: beam must be a Beam, got body 'block'",
    "fb.RigidMotion(rod.end, velocity=(1,0,0))": "beams, nets, bodies and point masses, got <beam 'rod' node 6 (s = 1 m)>",
    "fb.RigidMotion([], velocity=(1,0,0))": "objects is empty; name the parts that move, or leave objects out",
    "fb.Slider('s', bead, rod, 0.5)": "slider: takes name, point, beam without a name, got 4 arguments; give the others by",
    "fb.Slider('s', rod, bead, at=0.5)": "slider 's': point names the whole beam 'rod'",
    "fb.Slider('s', bead, rod.end, at=0.5)": "beam must be a Beam, got <beam 'rod' node 6 (s = 1 m)>; give beam 'rod' itself",
    "fb.Slider('s', bead, net, at=0.5)": "beam must be a Beam, got <net 'roof': 1 beams, 1 elements, 2 nodes>; use its beam(k)",
    "fb.Slider('s', bead, rod, at=0.5, spring=0.1)": "no argument 'spring'; fastbeam does not support this, docs/limits.md",
    "fb.Scene([rod, bead])": "is not a part of a scene; unpack it: scene.add(*parts)",
    "fb.Scene(rod.end)": "<beam 'rod' node 6 (s = 1 m)> is not a part of a scene; add beam 'rod'",
    "fb.Scene(rod, fb.Clamp)": "is not a part of a scene; call it to make one",
    "fb.Scene(rod, g=(0,0,-9.81))": "has no argument 'g'; use gravity",
    "fb.Scene(rod, gravity=-9.81)": "scene 'scene': gravity must be 3 finite numbers, got -9.81",
    "fb.Scene(parts=[rod])": "has no argument 'parts'; give each part without a name",
    "fb.Scene(net.beam(0))": "beam 'roof[0]' belongs to net 'roof'; add the net",
    "fb.compile_scene(rod)": "compile_scene: needs a Scene, got <beam 'rod': 1 m, 2 elements",
    "fb.compile_scene(fb.Scene())": "is empty: add at least one Beam, Net, RigidBody or PointMass",
    "fb.compile_scene(rod, bead)": "compile_scene: takes scene without a name, got 2 arguments; give the others by name:",
    "fb.compile_scene(model)": "is compiled already; pass the model on to simulate or solve_static",
    "fb.simulate(scene, t_end=1, step=0.1)": "got <scene 'scene': 1 beam ('rod'), 1 clamp>; compile it first: model =",
    "fb.simulate(model, 1.0, 0.1)": "simulate: takes model without a name, got 3 arguments; give the others by name:",
    "fb.simulate(model, t_end=1.0)": "simulate: step missing; it takes model, t_end, step",
    "fb.simulate(model, t_end=1.0, dt=0.1)": "simulate: has no argument 'dt'; use step",
    "fb.simulate(model, t_end='1', step=0.1)": "simulate, t_end: must be a finite number, got '1'",
    "fb.simulate(model, t_end=1, step=0.1, order='4')": "simulate, order: must be a whole number >= 1, got '4'",
    "fb.simulate(model, t_end=1, step=0.1, points=[rod.end])": "points: must map names to nodes, as in points={'tip':",
    "fb.simulate(model, t_end=1, step=0.1, points={'tip': rod})": "point 'tip': must be a node of a beam",
    "fb.simulate(model, t_end=1, step=0.1, observe='energy')": "must be a sequence of kinds, as in ('energy',), got 'energy'",
    "fb.simulate(model, t_end=1, step=0.1, callback=lambda t: None)": "callback: must be a function of (t, state), got one of",
    "fb.simulate(model, t_end=1, step=0.1, callback=lambda t, s: t)": "must return True to end the run, else False or None",
    "fb.simulate(model, t_end=1, step=0.1, start=result)": "start: must be a State (result.state, model.state()) or Checkpoint",
    "fb.simulate(model, t_end=1, step=0.1, filename='x')": "simulate: has no argument 'filename'; use output",
    "fb.simulate(model, t_end=1e20, step=1e-3)": "step: must be at least 6.55e+04 s, got 0.001",
    "fb.solve_static(scene)": "solve_static: needs a model, got <scene 'scene': 1 beam",
    "fb.solve_static(model, load_steps=10)": "solve_static: has no argument 'load_steps'; use load_step",
    "fb.solve_static(model, levels=10)": "levels: must be increasing load factors in (0, 1], got 10",
    "fb.load_result(result)": "load_result, path: must be the path of a file, a text or a pathlib.Path, got Result of 'scene'",
    "fb.load_result('nothing.h5')": "result file 'nothing.h5': no such file",
    "fb.load_checkpoint(5)": "load_checkpoint, path: must be the path of a file",
    "fb.plot_shapes(model)": "plot_shapes, result: must be a Result, got",
    "fb.plot_shapes(result, plane='zx')": "plot_shapes, plane: 'zx' does not exist: choose 'auto', 'xy', 'xz', 'yz' or '3d'",
    "fb.plot_shapes(result, cmap='blue')": "cmap 'blue' does not exist: choose a colour map of matplotlib",
    "fb.plot_slider(result, 0)": "plot_slider, slider: must be a text, got 0",
    "result.point('tip')": "record positions with simulate(..., points={'tip': beam.end})",
    "result.drift('energy')": "series 'energy' was not recorded: choose from .*; the energy is 'total'",
    "result.save()": "Result.save: path missing; it takes path, overwrite",
    "rod.node('end')": "beam 'rod': node 'end' does not exist, nodes run from 0 to 6",
    "rod.at(0.3)": "no node at s=0.3, the nearest nodes lie at s = ",
    "fb.NodeRef(rod, 9)": "NodeRef: beam 'rod' has no node 9, nodes run from 0 to 6",
    "fb.Net('n', [(0,0,0), (1,0,0)], section=sec)": "net 'n': edges missing",
    "fb.Net('n', [(0,0,0), (1,0,0)], [(1, 2)], section=sec)": "edges must be node numbers from 0 to 1, entry 0 has 2"}


@pytest.mark.parametrize("call", MISTAKES)
def test_message_says_what_is_wrong_and_what_to_write(call: str) -> None:
    names = NAMES | {"model": model(), "result": run()} if "model" in call or "result" in call else NAMES
    with pytest.raises((fb.SceneError, fb.ResultFileError)) as caught:
        eval(call, dict(names))
    at = 0
    for piece in MISTAKES[call].split(".*"):
        at = str(caught.value).find(piece, at)
        assert at >= 0, f"{caught.value} lacks {piece!r}"
