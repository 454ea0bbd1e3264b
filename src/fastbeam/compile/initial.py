"""Initial state: positions, triads and velocities that agree with all connections, supports and sliders."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fastbeam.compile.projection import along_curve, project, strain_rates
from fastbeam.compile.tracks import contact_curve_of
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.layout import ARM, TRIAD
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, refuse, told
from fastbeam.model.connections import Connections, fixed_axes
from fastbeam.model.contact.sleeve_conditions import Section
from fastbeam.model.contact.sleeves import sections_in_sleeves
from fastbeam.model.forces.winches import Hoists
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.model.model import Model
from fastbeam.model.moving_supports import support_rates
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import Elements
from fastbeam.scene import Beam, PointMass, PrescribedMotion, RigidBody, Scene

Array = np.ndarray
# m/s and rad/s: smaller mismatches of velocities count as zero
NO_VELOCITY = 1e-100
# largest strain rate of a rigid part, relative to the largest velocity over the size of the scene
BENDS = 1e-6
# smallest strain of waves from a support with an initial velocity that raises an event
LEAST_SHOCK = 1e-9
# remedies for velocities that do not agree
GIVE_RIGID_MOTION = "give connected parts one RigidMotion, or velocities that agree"
FROM_ZERO = "let its function begin with zero velocity, or give the parts that it moves their velocities (RigidMotion)"
GIVE_SLIDING_SPEED = "give its point the velocity of the beam there, and its sliding speed as rate="


class Mismatch(NamedTuple):
    """Violation of a constraint by initial velocities: its name, its size as a speed, m/s, its size as text with its unit, and a
    remedy."""

    what: str
    speed: float
    amount: str
    remedy: str


def _speed_of(wrong: Mismatch) -> float:
    return wrong.speed


def initial_rates(scene: Scene, nodes: NodeList, joints: Connections, elements: list[Elements],
                  kept: list[ConstrainedJoint], at_rest: Callable[[], Model]) -> tuple[Array, tuple[tuple[str, str], ...]]:
    """Return the rates of the coordinates at t = 0 [12 N], and kinds and texts of events. kept: joints with multipliers; at_rest:
    makes the model of the scene at rest, for projection of velocities. Raises SceneError: velocities that a connection, a support
    or a slider does not allow, unless the scene asks for their projection and there is one."""
    n = len(nodes)
    lines = _contact_lines(scene, nodes)
    v, omega = _given_velocities(scene, nodes)
    moving = support_rates(scene, nodes, joints)
    notes = []
    # a projection includes the velocities of moving supports
    for motion in (x for x in scene.prescribed if x.since is None and not scene.project_velocities):
        at = nodes.number(motion.at)
        notes += _shock(nodes, elements, motion, at, [of[at] - x[at] for of, x in zip(moving, (v, omega))])
        v[at] = np.where(fixed_axes(np.array([motion.mask]))[0], moving[0][at], v[at])
        omega[at] = moving[1][at] if motion.mask & 56 else omega[at]
    _follow_sliders(scene, nodes, v, lines)
    for x in (v, omega):
        # squares of smaller numbers are lost
        x[np.abs(x) < NO_VELOCITY] = 0.0
    tied = joints.tied
    masses = [nodes.start(mass) for mass in scene.masses if mass.velocity is None and tied[nodes.start(mass)]]
    v[masses], omega[masses] = (x[masses] for x in tied_velocities(nodes, joints, v, omega))
    held = sections_in_sleeves(scene, nodes, joints, lines)
    wrong = _mismatch(scene, nodes, joints, v, omega, lines, kept, held, moving)
    if wrong:
        scale = max([_speed(nodes, v, omega), *(abs(slider.rate or 0.0) for slider in scene.sliders)])
        worst = max(wrong, key=_speed_of)
        if worst.speed > 1e-10 * scale + NO_VELOCITY:
            if not scene.project_velocities:
                raise SceneError(f"{worst.what}: the initial velocities violate it by {worst.amount}; {worst.remedy}, or use "
                                 "Scene(..., project_velocities=True), which finds compatible rigid motions of the parts")
            if scene.winches:
                refuse(list(told(Analysis.PROJECTION, [Hoists(scene.winches)])), worst.what)
            given = v, omega
            v, omega, energies = project(at_rest(), scene, v, omega, moving)
            left = max(_mismatch(scene, nodes, joints, v, omega, lines, kept, held, moving), key=_speed_of,
                       default=Mismatch("", 0.0, "", ""))
            if left.speed > 1e-7 * max(scale, _speed(nodes, v, omega)):
                raise SceneError(f"{left.what}: no initial velocities satisfy all connections, supports and sliders; "
                                 f"{left.amount} remain after projection. Change the rate of a slider, or remove a support")
            changed = _change(nodes, given, (v, omega), energies)
            before, (rate, where) = strain_rates(nodes, elements, *given)[0], strain_rates(nodes, elements, v, omega)
            if rate > before + BENDS * _speed(nodes, v, omega) / _size(nodes):
                changed += (f"; no rigid motions of the parts are compatible, so {nodes.labels[where]} begins with a strain rate "
                            f"of {rate:.3g} 1/s, which sends waves through it. Give its velocities as a field (InitialVelocity), "
                            "or let motions of supports and drives begin at rest")
            notes.append(("projected", changed))
    # fixed nodes stand still exactly, prescribed ones move as prescribed, also after a projection: no step would correct them
    for x, of, which in ((v, moving[0], fixed_axes(joints.held) & ~tied[:, None]),
                         (omega, moving[1], (joints.held & 56 != 0) & (joints.spin_root == np.arange(n)))):
        x[which] = of[which]
    follows = tied_velocities(nodes, joints, v, omega)
    v[tied], omega[tied] = (x[tied] for x in follows)
    # untouched zeros take no memory
    rates = np.zeros((n, 4, 3))
    if v.any():
        rates[:, 0] = v
    if omega.any():
        rates[:, 1:] = np.cross(omega[:, None, :], nodes.directors)
    return rates.reshape(-1), tuple(notes)


def state_without_velocities(scene: Scene, nodes: NodeList, kept: list[ConstrainedJoint]) -> State:
    """Make a state without velocities; kept: joints with multipliers."""
    q = np.concatenate((nodes.phi[:, None], nodes.directors), axis=1)
    s = np.array([slider.at for slider in scene.sliders], dtype=float)
    forces = 3 * s.size + sum(link.forces(3) for link in kept) + 3 * len(scene.sleeves)
    return State(q.reshape(-1), np.zeros(q.size), s, np.zeros(forces))


def _shock(nodes: NodeList, elements: list[Elements], motion: PrescribedMotion, at: int,
           jumps: list[Array]) -> list[tuple[str, str]]:
    """Return the event of a support that begins with a velocity and a spin which the scene does not give its beam there; jumps:
    differences, m/s and rad/s."""
    mask = np.array([motion.mask])
    velocity, spin = (float(np.linalg.norm(x)) for x in (jumps[0] * fixed_axes(mask)[0], jumps[1] * bool(motion.mask & 56)))
    strain = 0.0
    for part in elements:
        section = np.unique(part.section[np.any(part.nodes == at, axis=1)])
        stiff, mass = part.stiffness[section][:, np.arange(6), np.arange(6)], part.inertia[section][:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            slowness, radius = np.sqrt(mass / stiff[:, 0]), np.sqrt(np.max(stiff[:, 3:], axis=1) / stiff[:, 0])
            strain = max(strain, float(np.max(np.nan_to_num(slowness * (velocity + spin * radius)), initial=0.0)))
    if strain <= LEAST_SHOCK:
        return []
    much = " and ".join([f"{velocity:.3g} m/s"] * (velocity > 0.0) + [f"{spin:.3g} rad/s"] * (spin > 0.0))
    return [("shock", f"{motion.label} begins with {much}, but {nodes.labels[at]} and the nodes next to it do not. This velocity "
                      f"jump sends waves with strains of about {strain:.1g} (velocity over wave speed), whose fronts no mesh "
                      "resolves. Let its function begin with zero velocity, give its beam the velocity (RigidMotion, "
                      "InitialVelocity), or use Scene(..., project_velocities=True)")]


def _change(nodes: NodeList, given: tuple[Array, Array], found: tuple[Array, Array], energies: tuple[float, float]) -> str:
    """Describe the changes by a projection: the largest change of a velocity, or of a spin where none changed, and the kinetic
    energy."""
    moved, turned = (np.linalg.norm(new - old, axis=1) for new, old in zip(found, given))
    k, i = int(np.argmax(moved)), int(np.argmax(turned))
    much = moved[k] > 1e-10 * turned[i] * _size(nodes)
    what = f"{moved[k]:.6g} m/s at {nodes.labels[k]}" if much else f"{turned[i]:.6g} rad/s at {nodes.labels[i]}"
    before, after = energies
    return (f"the initial velocities were projected: velocities change by up to {what}, and the kinetic energy changes from "
            f"{before:.6g} to {after:.6g} J")


def _speed(nodes: NodeList, v: Array, omega: Array) -> float:
    """Return the largest velocity, that of spins over the size of the scene included, m/s."""
    return max(float(np.max(np.linalg.norm(v, axis=1))), float(np.max(np.linalg.norm(omega, axis=1))) * _size(nodes))


def _size(nodes: NodeList) -> float:
    return nodes.extent or 1.0


def _contact_lines(scene: Scene, nodes: NodeList) -> list[tuple[Array, Array, Array, int]]:
    """Return the nodes under every slider, their shape functions and slopes, and the sliding node."""
    out = []
    for slider in scene.sliders:
        out.append((*contact_curve_of(scene, nodes, slider).at(slider.at), nodes.number(slider.point)))
    return out


def place_points(scene: Scene, nodes: NodeList) -> None:
    """Move sliding points onto their discrete curves, before their positions are used: a mass without position all the way, one
    on the reference as far as that is off, other points by the round-off of typed positions. The first step would close a gap,
    and that impact would stay in the motion for ever. Raises SceneError: a point lies further off its curve, or two sliders want
    it at different places."""
    lines = _contact_lines(scene, nodes)
    for slider, line in zip(scene.sliders, lines):
        point, mass = line[3], slider.point.owner
        if slider.starts_off:
            continue
        curve = line[1] @ nodes.phi[line[0]]
        gap = float(np.linalg.norm(nodes.phi[point] - curve))
        # `Scene.check` has found positions of masses on the reference
        moves = isinstance(mass, PointMass) and (mass.position is None or isinstance(slider.beam, Beam))
        if gap > 1e-9 * slider.beam.length and not moves:
            raise SceneError(f"slider {slider.name!r}: {slider.point} lies {gap:.3g} m off the discrete curve of "
                             f"{slider.beam.label} at={slider.at:.6g}. The interpolation of a curved beam is exact at its nodes "
                             "only. Start at a node, use more elements or a higher degree, or slide a PointMass without "
                             "position, or at beam.reference(s)")
        nodes.phi[point] = curve
    for slider, (number, values, _, point) in zip(scene.sliders, lines):
        if slider.starts_off:
            continue
        gap = float(np.linalg.norm(nodes.phi[point] - values @ nodes.phi[number]))
        if gap > 1e-12 * (slider.beam.length + float(np.max(np.abs(nodes.phi[point])))):
            raise SceneError(f"slider {slider.name!r}: another slider places {slider.point} {gap:.3g} m off {slider.beam.label} "
                             f"at={slider.at:.6g}; give positions and at= with all digits, and on curved beams start at nodes")
    moved = {line[3] for slider, line in zip(scene.sliders, lines) if not slider.starts_off}
    for ball in scene.balls:
        a, b = nodes.number(ball.a), nodes.number(ball.b)
        gap = float(np.linalg.norm(nodes.phi[a] - nodes.phi[b]))
        round_off = 32.0 * float(np.finfo(float).eps * np.max(np.abs(nodes.phi)))
        if {a, b} & moved and gap > 4e-9 * _size(nodes) + round_off:
            raise SceneError(f"{ball.name}: the slider of {nodes.labels[a if a in moved else b]} places it {gap:.3g} m away from "
                             "the other side of the joint. It lies on the discrete curve of a beam, which is exact at the nodes "
                             "only. Join there, or use more elements or a higher degree")


def _given_velocities(scene: Scene, nodes: NodeList) -> tuple[Array, Array]:
    """Sum the velocities of the scene: v [N, 3], spin [N, 3]."""
    n = len(nodes)
    v, omega = np.zeros((n, 3)), np.zeros((n, 3))
    for net in scene.nets:
        for mine, given in zip((v, omega), net.motion):
            mine[nodes.span(net)] += given
    for field in scene.velocities:
        at, s = nodes.span(field.beam), field.beam.node_s
        v[at] += field.beam.basis.fit_positions(field.velocity_at(s))
        omega[at] += field.spin_at(s)
    for part in [*scene.bodies, *scene.masses]:
        at = nodes.span(part)
        if part.velocity is not None:
            v[at] += part.velocity
        if isinstance(part, RigidBody):
            omega[at] += part.spin
    for motion in scene.motions:
        for part in motion.objects or [*scene.beams, *scene.nets, *scene.bodies, *scene.masses]:
            at = nodes.span(part)
            v[at] += motion.velocity + np.cross(motion.spin, nodes.phi[at] - motion.about)
            omega[at] += motion.spin
    if nodes.arm_owner:
        owner, arm = np.array(nodes.arm_owner).T
        omega[arm] = omega[owner]
        v[arm] = v[owner] + np.cross(omega[owner], nodes.phi[arm] - nodes.phi[owner])
    return v, omega


def _follow_sliders(scene: Scene, nodes: NodeList, v: Array, lines: list[tuple[Array, Array, Array, int]]) -> None:
    """Set the velocity of point masses without a given one to that of their slider, and those of crossings and ropes."""
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        mass = slider.point.owner
        if isinstance(mass, PointMass) and mass.velocity is None and not slider.starts_off:
            moved = any(m.objects is None or mass in m.objects for m in scene.motions)
            along = (slopes @ nodes.phi[number]) * (slider.rate or 0.0)
            if slider.rate is not None or not moved:
                v[point] = values @ v[number] + along
            # with a rigid motion and no rate the mass keeps the motion it was given
    for knot in scene.knots:
        # velocity with which the crossing stays on both curves
        sides = [line for slider, line in zip(scene.sliders, lines) if slider.point.owner is knot]
        moving = [values @ v[number] for number, values, _, _ in sides]
        tangents = [slopes @ nodes.phi[number] for number, _, slopes, _ in sides]
        rates = np.linalg.lstsq(np.stack((tangents[0], -tangents[1]), axis=1), moving[1] - moving[0], rcond=None)[0]
        v[sides[0][3]] = 0.5 * (moving[0] + moving[1] + rates[0] * tangents[0] + rates[1] * tangents[1])
    for winch in scene.winches:
        # velocities of points of a rope are interpolated between its ends
        ends = v[[nodes.number(winch.drum), nodes.number(winch.load)]]
        share = (np.arange(1, winch.segments) / winch.segments)[:, None]
        v[[nodes.start(point) for point in winch.points]] = (1.0 - share) * ends[0] + share * ends[1]


def tied_velocities(nodes: NodeList, joints: Connections, v: Array, omega: Array) -> tuple[Array, Array]:
    """Return the velocities and spins that slave nodes get from their master nodes, both [N, 3]; for other nodes zero velocity
    and their own spin."""
    owner, kind, target = joints.owner, joints.kind, joints.target
    spin = omega.copy()
    share = v[target]
    arm = kind == ARM
    to = target[arm]
    share[arm] = np.cross(omega[to], (joints.offset[arm][:, None, :] @ nodes.directors[to])[:, 0])
    turns = kind == TRIAD
    velocity = np.stack([np.bincount(owner[~turns], share[~turns, c], minlength=len(v)) for c in range(3)], axis=1)
    spin[owner[turns]] = omega[target[turns]]
    return velocity, spin


def _mismatch(scene: Scene, nodes: NodeList, joints: Connections, v: Array, omega: Array,
              lines: list[tuple[Array, Array, Array, int]], kept: list[ConstrainedJoint], held: list[tuple[int, Section]],
              moving: tuple[Array, Array]) -> list[Mismatch]:
    """Return the largest violation of every kind by the velocities."""
    size = _size(nodes)
    tied, turning = joints.tied, nodes.rank != 9
    alone = joints.spin_root == np.arange(len(v))
    velocity, spin = tied_velocities(nodes, joints, v, omega)
    out = []

    def add(what: str, amount: float, turns: bool, remedy: str) -> None:
        out.append(Mismatch(what, amount * size if turns else amount, f"{amount:.6g} {'rad/s' if turns else 'm/s'}", remedy))

    driven = [nodes.number(motion.at) for motion in scene.prescribed if motion.since is None]
    for what, error, where in (
            ("connection of {}", v - velocity, tied),
            ("connection of {} (rotation)", omega - spin, tied & turning),
            ("support of {}", np.where(fixed_axes(joints.held), v - moving[0], 0.0), ~tied & (joints.held & 7 != 0)),
            ("support of {} (rotation)", omega - moving[1], alone & (joints.held & 56 != 0) & turning)):
        k = np.flatnonzero(where)
        if k.size:
            amount = np.linalg.norm(error[k], axis=1)
            worst = int(np.argmax(amount))
            remedy = GIVE_RIGID_MOTION if k[worst] not in driven else FROM_ZERO
            add(what.format(nodes.labels[k[worst]]), float(amount[worst]), "rotation" in what, remedy)
    moving_nodes = (np.any(v, axis=1) | np.any(omega, axis=1)).tolist()
    for link in kept:
        at_rest = not (any(moving_nodes[k] for k in link.node) or link.law.rate)
        if at_rest or not link.law.holds:
            continue
        rates = sum(by_v @ v[k] + by_spin @ omega[k] for k, by_v, by_spin in link.by_velocities(nodes.coordinates(link.node)))
        rates = rates - link.rates()
        add(link.name, float(np.linalg.norm(rates)), bool(link.law.is_angle), FROM_ZERO if link.law.rate else GIVE_RIGID_MOTION)
    for slider, (number, values, slopes, point) in zip(scene.sliders, lines):
        if slider.starts_off:
            continue
        relative = v[point] - values @ v[number]
        tangent = slopes @ nodes.phi[number]
        rate = float(relative @ tangent / (tangent @ tangent))
        add(f"slider {slider.name!r}", float(np.linalg.norm(relative - rate * tangent)), False, GIVE_SLIDING_SPEED)
        if slider.rate is not None:
            add(f"slider {slider.name!r} (rate {slider.rate:g} m/s against {rate:g} m/s)", abs(rate - slider.rate), False,
                GIVE_SLIDING_SPEED)
    for k, section in held:
        spins, of_holder = section.by_spins()
        lead, along = along_curve(nodes, lines[k])
        rate = sum(float(along[i] @ v[node]) for i, node in enumerate(lead))
        turning = np.einsum("pac,ac->p", spins, omega[section.roots[:-1]]) + of_holder @ omega[section.roots[-1]]
        add(f"sleeve {scene.sliders[k].name!r} (rotation)", float(np.linalg.norm(turning + section.values(1) * rate)), True,
            GIVE_RIGID_MOTION)
    return out
