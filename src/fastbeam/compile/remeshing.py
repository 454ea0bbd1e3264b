"""Scenes on other meshes: beams with sliders whose elements move with the contacts."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fastbeam.compile.cut_beams import Cut
from fastbeam.interface.arguments import Anything, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.moving_places import place_at
from fastbeam.model.contact.moving_tables import KEPT
from fastbeam.scene import Beam, MovingMesh, Path, Scene, Sleeve, Slider
from fastbeam.scene.moving_mesh import check_acting, check_places, has_coulomb

Array = np.ndarray


class _Remeshed(Cut):
    """Scene with new beams in place of those with sliders."""

    def __init__(self, scene: Scene, new: dict[Beam, Beam]) -> None:
        self.given, self.new, self._paths = scene, new, {}

    def _bore(self, sleeve: Sleeve) -> dict[str, Any]:
        """Return the changes of the bore of a sleeve: only friction needs its length."""
        return {} if has_coulomb(sleeve) else {"length": 0.0}


@checked(scene=Anything())
def with_moving_meshes(scene: Scene) -> Scene:
    """Return the scene with a `MovingMesh` for every beam with sliders (theory.md 5.12).

    Beams with sliders keep their number of elements. With one slider half of them are on either side of it; with several they are
    distributed over the parts between contacts by their lengths at the start, at least one each. If contacts move far from there,
    distribute the elements by hand (`MovingMesh`), or use the scene as it is: an event `coarse` tells where elements become too
    long. Parts at the ends of these beams, and sliders on them, refer to the new beams. Sleeves hold their beam at one point;
    those with `length=` raise an error unless Coulomb friction needs the length. Everything else is unchanged.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        The argument is no scene, has no sliders, or has a beam or slider that moving meshes do not support.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"with_moving_meshes: needs a Scene, got {shown(scene)}; put the parts into one: fb.Scene(beam, ...)")
    return remeshed("with_moving_meshes", scene)[0]


def remeshed(who: str, scene: Scene) -> tuple[Scene, dict[Beam, Beam]]:
    """Return the scene with a `MovingMesh` for every beam with sliders, and the given beams by those in their place. Raises
    SceneError, as `with_moving_meshes` does; who: caller in messages."""
    if not scene.sliders:
        raise SceneError(f"{who}: {scene.label} has no sliders; compile it as it is")
    if any(isinstance(part, MovingMesh) for part in scene.parts):
        raise SceneError(f"{who}: {scene.label} has moving meshes; compile it as it is")
    on: dict[Beam, list[Slider]] = {}
    for slider in scene.sliders:
        if not isinstance(slider.beam, Beam) or isinstance(slider.beam, Path):
            raise SceneError(f"{who}: slider {slider.name!r} is on {slider.beam.label}; moving meshes need single "
                             "beams, not paths, switches or beams of nets")
        check_acting(who, slider)
        element = slider.beam.length / slider.beam.n_elements
        own = isinstance(slider, Sleeve) and slider.length and not has_coulomb(slider)
        if own and abs(slider.length - element) > 1e-12 * element:
            raise SceneError(f"{who}: sleeve {slider.name!r} has a bore of length={slider.length:.6g} m, but a "
                             "moving mesh needs a sleeve that acts at one point. Leave length out, give length=0, or compile "
                             "the scene as it is")
        on.setdefault(slider.beam, []).append(slider)
    for some in on.values():
        check_places(who, some[0].beam, some)
    new = {i: _cut(some[0].beam, sorted(slider.at for slider in some)) for i, some in on.items()}
    swap = _Remeshed(scene, new)
    parts = [swap._swapped(part) for part in scene.parts]
    sliders = [part for part in parts if isinstance(part, Slider)]
    meshes = [MovingMesh(beam, [slider for slider in sliders if slider.beam is beam]) for beam in new.values()]
    out = Scene(*parts, *meshes, name=scene.name, gravity=scene.gravity, gravity_time=scene.gravity_time,
                project_velocities=scene.project_velocities)
    return out, {there: given for given, there in new.items()}


def _cut(beam: Beam, at: list[float]) -> Beam:
    """Return the beam with element ends at the contacts at these places; beside an end of the beam, which they follow at a
    distance, where `Mesh` expects them."""
    kept = KEPT * beam.length / beam.n_elements
    places = [place_at(x, beam.length, kept * (k == 0), kept * (k == len(at) - 1)) for k, x in enumerate(at)]
    fixed = np.array([0.0, *places, beam.length])
    # half of them on either side of one contact, wherever it goes
    parts = _shares(beam.n_elements, np.ones(2) if len(at) == 1 else np.diff(fixed) / beam.length)
    ends = [np.linspace(a, b, m + 1)[:-1] for a, b, m in zip(fixed[:-1], fixed[1:], parts)]
    return replace(beam, elements=np.concatenate((*ends, [beam.length])))


def _shares(n: int, parts: Array) -> Array:
    """Return how many of n elements, at least one, belong to each of some parts, float64 [m], in proportion to their sizes."""
    # rounding removes round-off beside halves
    ideal = np.round(n * parts / np.sum(parts), 9)
    out = np.maximum(1, np.floor(ideal)).astype(int)
    while (left := n - int(out.sum())) and (left > 0 or out.max() > 1):
        k = int(np.argmax(ideal - out) if left > 0 else np.argmin(np.where(out > 1, ideal - out, np.inf)))
        out[k] += 1 if left > 0 else -1
    return out
