"""Positions of masses without a position of their own: at sliders and joints, also through other masses; extent of a scene."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.scene.axis_joint import AxisJoint
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import BallJoint, PointMass, RigidConnection
from fastbeam.scene.checks import Array
from fastbeam.scene.fixed import Ground
from fastbeam.scene.relations import referenced_nodes, who
from fastbeam.scene.sliders import Slider

if TYPE_CHECKING:
    from fastbeam.scene.scene import Scene

Joint = RigidConnection | BallJoint | AxisJoint
# points from which a farther one is looked for
MOST_FARTHER = 5


def extent_of(points: Array) -> float:
    """Return the largest distance between two of some points [n, 3], m, found by going from the one that is farthest from their
    mean to the farthest one, and on while that grows. It does not depend on directions; 0 of none."""
    if not len(points):
        return 0.0
    here, largest = points[np.argmax(np.linalg.norm(points - np.mean(points, axis=0), axis=1))], 0.0
    for _ in range(MOST_FARTHER):
        distance = np.linalg.norm(points - here, axis=1)
        far = int(np.argmax(distance))
        if distance[far] <= largest:
            break
        here, largest = points[far], float(distance[far])
    return largest


class Placing:
    """Search for the positions of masses in a scene with its present parts; count: number of parts that the scene had."""

    def __init__(self, scene: Scene) -> None:
        self._masses, self.count = scene.masses, len(scene.parts)
        # sliders, then joints of points, then rigid connections of every point mass
        self._table: dict[Any, list[Slider | Joint]] = {}
        # positions of masses that were found
        self._known: dict[Any, Array] = {}
        for link in [*scene.sliders, *scene.balls, *scene.pinned, *scene.rigid]:
            for node in referenced_nodes(link):
                if isinstance(node.owner, PointMass):
                    self._table.setdefault(node.owner, []).append(link)

    def position(self, node: NodeRef) -> Array:
        """Return the position (3,) m at t = 0 of a node. Raises SceneError: nothing places the mass."""
        owner = node.owner
        if isinstance(owner, Ground):
            return node.offset
        if isinstance(owner, Beam) or owner.position is not None:
            return node.place
        known = self._known
        if owner not in known:
            found = self._reached(owner, None)
            if found is None:
                raise SceneError(f"{owner.label} has no position: give position=(x, y, z), or place it by a Slider, BallJoint or "
                                 "RigidConnection")
            chain, position = found
            # all masses on the way have the same position
            known.update(dict.fromkeys(chain, position))
        return known[owner]

    def _placements(self, mass: PointMass) -> Iterator[tuple[Slider | Joint, Array]]:
        """Yield (slider or joint, the position at which it places a mass without position); joints may lead through other
        masses."""
        for link, place, other in self._leads(mass):
            if other is None:
                yield link, place()
            elif other is not mass:
                found = self._reached(other, mass)
                if found is not None:
                    yield link, found[1]

    def _leads(self, mass: PointMass) -> Iterator[tuple[Slider | Joint, Callable[[], Array], PointMass | None]]:
        """Yield the links of a mass without position: (slider or joint, function of its position, the mass without position there
        or None)."""
        for link in self._table.get(mass, []):
            if isinstance(link, Slider):
                yield link, partial(getattr, link, "place"), None
                continue
            other = link.b if link.a.owner is mass else link.a
            unplaced = isinstance(other.owner, PointMass) and other.owner.position is None
            yield link, partial(self.position, other), other.owner if unplaced else None

    def _reached(self, mass: PointMass, avoid: PointMass | None) -> tuple[list[PointMass], Array] | None:
        """Return the masses that lead from one without position to the first that something else places, not through another, and
        its position; None if nothing does."""
        chain, open_leads, visited = [mass], [self._leads(mass)], {mass, avoid}
        known = self._known if avoid is None else {}
        while chain:
            for _, place, other in open_leads[-1]:
                if other is None:
                    return chain, place()
                if other in known:
                    return chain, known[other]
                if other not in visited:
                    visited.add(other)
                    chain.append(other)
                    open_leads.append(self._leads(other))
                    break
            else:
                chain.pop()
                open_leads.pop()
        return None

    def check(self, tolerance: float) -> None:
        """Check that every mass has a position, and that all links that place it agree to within a tolerance, m. Raises
        SceneError."""
        once = self._placed_once()
        for mass in self._masses:
            if mass not in once:
                self._check_place(mass, tolerance)

    def _placed_once(self) -> set[PointMass]:
        """Return masses that joints join to one group in which a single slider or joint gives the position, so that nothing can
        disagree. In a long chain of masses the search from each of them would take the square of its length."""
        out: set[PointMass] = set()
        seen: set[PointMass] = set()
        for mass in self._masses:
            if mass.position is not None or mass in seen:
                continue
            group, front, places = {mass}, [mass], 0
            while front:
                for _, _, other in self._leads(front.pop()):
                    places += other is None
                    if other is not None and other not in group:
                        group.add(other)
                        front.append(other)
            seen |= group
            out |= group if places == 1 else set()
        return out

    def _check_place(self, mass: PointMass, tolerance: float) -> None:
        """Check that a mass has a position, and that all links that place it agree."""
        if mass.position is not None:
            return
        self.position(mass.center)
        (first, place), *others = self._placements(mass)
        for link, position in others:
            # once a slider or ball joint gives the position, a rigid connection keeps the resulting distance
            if isinstance(link, RigidConnection) and not isinstance(first, RigidConnection):
                continue
            gap = float(np.linalg.norm(position - place))
            if gap > tolerance:
                raise SceneError(f"{mass.label}: {who(first)} and {who(link)} place it at points {gap:.6g} m apart; make them "
                                 "agree"
                                 + (", or give its position" if isinstance(link, RigidConnection) else ""))
