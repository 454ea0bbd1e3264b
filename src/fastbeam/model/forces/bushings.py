"""Bushings as tables in space and in a plane, and their series at rows (forces/bushing.py)."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels.forces.bushing import Bushings
from fastbeam.kernels.state import State
from fastbeam.model.plane import TOLERANCE, NotPlanar, Plane, numbers_of

Array = np.ndarray


def _of_rotations(m: Array) -> Array:
    """Return G = 1/2 tr(M) I - M of matrices [L, 3, 3]: sum_ij G_ij (delta_ij - R_ij) is theta.M theta/2 for a small rotation
    theta."""
    return 0.5 * np.trace(m, axis1=1, axis2=2)[:, None, None] * np.eye(3) - m


def bushings(ends: Any) -> Bushings:
    """Build the table in space; ends: `links.Ends`."""
    parts, node = ends.parts, ends.node
    axes = np.array([part.directors for part in parts])
    # D_i = sum_k R_ik d_k of both nodes
    turn = np.einsum("lix,lskx->lsik", axes, ends.directors[node])
    start = np.einsum("lix,lx->li", axes, ends.phi[node[:, 1]] - ends.phi[node[:, 0]])
    stiffness, damping = (np.array([getattr(part, what) for part in parts]) for what in ("stiffness", "damping"))
    rotational = damping[:, 3:, 3:]
    some = np.stack((np.any(stiffness[:, :3, 3:], axis=(1, 2)), np.any(rotational, axis=(1, 2))), axis=1)
    return Bushings(node, ends.row, ends.block, turn.reshape(-1), start.reshape(-1), stiffness.reshape(-1),
                    _of_rotations(stiffness[:, 3:, 3:]).reshape(-1), np.ascontiguousarray(damping[:, :3, :3]).reshape(-1),
                    _of_rotations(rotational).reshape(-1), some.astype(np.int64), ends.place)


def check_plane(parts: list[Any], normal: Array) -> None:
    """Check that bushings do not couple motions in the plane with this normal with others. Raises NotPlanar: a stiffness or
    damping couples motions in the plane with others."""
    for part in parts:
        # axes with the normal as the third
        k = int(np.argmin(np.abs(normal)))
        u = np.cross(normal, np.eye(3)[k])
        u = u / np.linalg.norm(u)
        turn = np.stack((u, np.cross(normal, u), normal)) @ part.directors.T
        both = np.kron(np.eye(2), turn)
        for matrix in (part.stiffness, part.damping):
            m = both @ matrix @ both.T
            within, beyond = [0, 1, 5], [2, 3, 4]
            size = np.sqrt(np.maximum(np.diag(m), 0.0))
            # the largest entry of the same kind is the scale of round-off
            size = np.concatenate((np.full(3, size[:3].max()), np.full(3, size[3:].max())))
            if np.any(np.abs(m[np.ix_(within, beyond)]) > TOLERANCE * np.outer(size[within], size[beyond])):
                raise NotPlanar(f"{part.label} couples in-plane motions with others")


def bushings_in_plane(table: Bushings, plane: Plane) -> Bushings:
    """Return the table for nodes with 3 unknowns: axes as they lie in the plane."""
    turn = table.axes.reshape(-1, 2, 3, 3)
    return table._replace(axes=numbers_of(np.einsum("lsik,lsk->lsi", turn, plane.factor[table.node])))


class BushingRows:
    """Displacements, rotations, forces and energies of L bushings at rows; table: in space."""

    kind = "bushings"

    def __init__(self, parts: list[Any], table: Bushings) -> None:
        self.names, self._table = [str(part.name) for part in parts], table

    def series(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of their series."""
        n = len(self.names)
        vectors = ("bushing_displacement", "bushing_rotation", "bushing_force", "bushing_moment")
        return {**dict.fromkeys(vectors, (n, 3)), "bushing_energy": (n,)}

    def row(self, state: State) -> dict[str, Array]:
        """Evaluate the series of one row: displacement, rotation vector, force and moment in the axes of a, and energy."""
        from scipy.spatial.transform import Rotation
        table = self._table
        n, (a, b) = len(self.names), table.node.T
        q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
        turn = table.axes.reshape(-1, 2, 3, 3)
        axes, rates = (np.einsum("lsik,lskx->lsix", turn, x[table.node, 1:]) for x in (q, v))
        r, dr = q[b, 0] - q[a, 0], v[b, 0] - v[a, 0]
        u = np.einsum("lix,lx->li", axes[:, 0], r) - table.start.reshape(-1, 3)
        du = np.einsum("lix,lx->li", axes[:, 0], dr) + np.einsum("lix,lx->li", rates[:, 0], r)
        c = np.einsum("lix,ljx->lij", axes[:, 0], axes[:, 1])
        dc = np.einsum("lix,ljx->lij", rates[:, 0], axes[:, 1]) + np.einsum("lix,ljx->lij", axes[:, 0], rates[:, 1])
        w = 0.5 * np.stack([c[:, (i + 2) % 3, (i + 1) % 3] - c[:, (i + 1) % 3, (i + 2) % 3] for i in range(3)], axis=1)
        k = table.stiffness.reshape(n, 6, 6)
        tilt, viscosity, drag = (x.reshape(n, 3, 3) for x in (table.tilt, table.viscosity, table.drag))
        force = np.einsum("lij,lj->li", k[:, :3, :3], u) + np.einsum("lij,lj->li", k[:, :3, 3:], w)
        force += np.einsum("lij,lj->li", viscosity, du)
        coupled = np.einsum("lji,lj->li", k[:, :3, 3:], u)
        by_c = -tilt + np.einsum("lij,ljm->lim", drag, dc)
        for i in range(3):
            by_c[:, (i + 2) % 3, (i + 1) % 3] += 0.5 * coupled[:, i]
            by_c[:, (i + 1) % 3, (i + 2) % 3] -= 0.5 * coupled[:, i]
        # a spin of b changes c_ij by E_j x D_i
        moment = np.cross(np.einsum("lmj,lij->lim", c, by_c), np.eye(3)[None]).sum(axis=1)
        cosine = 0.5 * (np.trace(c, axis1=1, axis2=2) - 1.0)
        small = cosine > 0.0
        turned = np.einsum("li,lij,lj->l", w, k[:, 3:, 3:], w) / np.where(small, 1.0 + cosine, 1.0)
        energy = (0.5 * np.einsum("li,lij,lj->l", u, k[:, :3, :3], u) + np.einsum("li,lij,lj->l", u, k[:, :3, 3:], w)
                  + np.where(small, turned, np.einsum("lij,lij->l", tilt, np.eye(3) - c)))
        return {"bushing_displacement": u, "bushing_rotation": Rotation.from_matrix(c).as_rotvec(), "bushing_force": force,
                "bushing_moment": moment, "bushing_energy": energy}
