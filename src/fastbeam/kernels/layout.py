"""Where the numbers of a group of 8 elements stand, in the packed tables and in the scratch of the element loop.

Everything counts doubles; a number of each of 8 elements takes 8 of them. What depends on the size of elements is in `Layout`,
what does not are the constants of this file.
"""
from __future__ import annotations

from typing import NamedTuple

from .._jit import written_in

# columns of `ElementTables.meta`
NODES, POINTS, CONSTANTS, LIST, BLOCKS, COUPLED, FACTORS, REFERENCE = range(8)

# a node in the table of a point, behind the weight: phi_s, dir, dir_s
NODE_TABLE = 24

# scratch of a point in space: six stresses that multiply derivatives of quadratic forms, that of the directors' lengths and the
# three moments, theory.md (4.7); the matrix of the positions; what derivatives of the strains need; then the nodes
STRESSES = 10 * 8
POINT_MATRIX = STRESSES
SHAPES_AT = POINT_MATRIX + 9 * 8
# of one shape: shears, 1 / stretch, the forms of twist and curvatures, the factor c; of the mean, of the end, and its stretch
SHAPE = 7 * 8
SHAPES = 2 * SHAPE + 8
POINT_NODES = SHAPES_AT + SHAPES
# of a node of a point: rows of the middle, what multiplies them, matrices rotation-position and position-rotation
ROWS, PRODUCTS, ROTATION_POSITION, POSITION_ROTATION, POINT_NODE = 0, 18 * 8, 36 * 8, 45 * 8, 54 * 8

# scratch of a point in a plane: four stresses, the matrix of the positions 2 x 2; of a node three rows, what multiplies them,
# the columns rotation-position and position-rotation
PLANAR_MATRIX, PLANAR_NODES = 4 * 8, 8 * 8
PLANAR_ROWS, PLANAR_PRODUCTS, PLANAR_ROTATION_POSITION, PLANAR_POSITION_ROTATION, PLANAR_NODE = 0, 24, 48, 64, 80

# room for one point, where the tangent stands later: z in the middle and at the end, strains, z before the last increment, that
# increment, stresses or forms; then the products of `point_stiffness`
Z = 21 * 8
MIDDLE, END, STRAINS, BEFORE, STEP, SPARE = 0, Z, 2 * Z, 2 * Z + 56, 3 * Z + 56, 4 * Z + 56
ROOM = 2 * Z
ROOM_END = ROOM + (49 + 9 + 18 + 18) * 8
# behind that room, of every pair of nodes vectors of the middle, then of the end: three for twist and curvatures, one for lengths
TWISTS = 12 * 8


class Layout(NamedTuple):
    """Offsets of a group of 8 elements with nn nodes and nq points. A node has 12 coordinates and 6 unknowns in space, 4 and 3 in
    a plane; there are 6 or 3 strains."""

    nn: int
    nq: int
    # tables: from C on, which stands first
    point: int               # weight, then (phi_s, dir, dir_s) of every node
    point_size: int          # distance of points
    inertia: int             # rhoA, rhoI2, rhoI3, in a plane rhoA, rhoI
    masses: int              # of positions nn x nn
    director_masses: int     # of directors nn x nn
    table_size: int
    # scratch: coordinates in the middle and at the end of the step, node by node, stand first
    node: int                # distance of nodes there
    rates: int               # second rates of the coordinates
    forces: int              # on the coordinates
    rows: int                # residual
    blocks: int              # tangent: nn x nn blocks
    points: int              # what pairs of nodes share of the stiffness of a point
    point_room: int          # distance of points there
    spin_rates: int          # derivatives of second rates by spins, in space
    line: int                # coordinates before the last increment, and that increment
    tangent_forces: int      # what the tangent adds to the forces, in the room of the second rates, which inertia is done with
    twists: int              # vectors of pairs of nodes
    pairs: int               # sums of stresses for pairs of nodes in space: in their blocks, where positions against positions
    pair_size: int           # stand later; distance of pairs
    size: int


# sums of a pair in space: two of shears, three of twist and curvatures, one of lengths
SHEAR_2, SHEAR_3, TWIST, CURVATURE_2, CURVATURE_3, LENGTHS = 0, 8, 16, 48, 56, 64


@written_in
def layout(size, nn, nq):
    """The layout for nodes of this kind."""
    n = len(size)
    node = 96 if n == 6 else 32
    strains = 6 if n == 6 else 3
    directors = 3 if n == 6 else 2
    point_size = 8 + NODE_TABLE * nn
    point = 8 * strains * strains
    inertia = point + nq * point_size
    masses = inertia + 8 * directors
    rates = 2 * node * nn
    forces = rates + node * nn
    rows = forces + node * nn
    blocks = rows + 8 * n * nn
    twists = blocks + ROOM_END
    points = blocks + 8 * n * n * nn * nn
    if n == 6:
        points = max(points, twists + TWISTS * nn * (nn - 1))
    point_room = POINT_NODES + POINT_NODE * nn if n == 6 else PLANAR_NODES + PLANAR_NODE * nn
    spin_rates = points + nq * point_room
    line = spin_rates + (144 * nn if n == 6 else 0)
    end = line + 2 * node * nn
    return Layout(nn, nq, point, point_size, inertia, masses, masses + 8 * nn * nn, masses + 16 * nn * nn, 2 * node, rates,
                  forces, rows, blocks, points, point_room, spin_rates, line, rates, twists, blocks, 288, end)


def layout_of(size: tuple[int, ...], nn: int, nq: int) -> Layout:
    """The same for callers in Python, without compiled code."""
    found: Layout = layout.py_func(size, nn, nq)
    return found
