"""Offsets of the numbers of a group of 8 elements in the packed tables and in the scratch of the element loop.

Offsets count doubles; one number of each of the 8 elements takes 8 of them. Offsets that depend on the numbers of nodes and
quadrature points of an element are in `Layout`, the others are constants of this file.

Kernels call a layout `at`, and offsets by a letter and o: no, bo of the list of nodes and of blocks of a group; to the table of
a point; qo, uo, fo coordinates, second rates and forces of a node; lo what `gather_increment` gathers; po the scratch of a
point; zo or z the vectors (phi', d_i, d_i') there, eo strains or forms, so stresses, ao a shape; ro residual, ko a block of the
tangent; io, d what is stored of inner nodes, xo and xi increments.
"""
from __future__ import annotations

from typing import NamedTuple

from fastbeam.kernels.jit.decorators import inlined

# columns of `ElementTables.meta`
NODES, POINTS, CONSTANTS, LIST, BLOCKS, COUPLED, FACTORS, REFERENCE = range(8)

# kinds of entries of `Ties`: position of the target, an offset in its triad, its triad turned
POSITION, ARM, TRIAD = range(3)

# in the tables of damped sections D stands ahead of C, from which offsets count: 6 x 6, in a plane 3 x 3
VISCOSITY, VISCOSITY_IN_PLANE = -36 * 8, -9 * 8
# numbers of a nonlinear section for each strain, ahead of D and C
PARAMETERS = 4

# distance of nodes in the table of a quadrature point, behind its weight: phi_s, dir, dir_s of each
NODE_TABLE = 24

# scratch of a point in space: the seven stresses s_1 to s_7 that multiply derivatives of the quadratic forms and the three
# moments S_4 to S_6, theory.md (4.7); the 3 x 3 matrix that pairs of positions share; two shapes; then the nodes of the element
STRESSES = 10 * 8
POINT_MATRIX = STRESSES
SHAPES_AT = POINT_MATRIX + 9 * 8
# a shape has the data for derivatives of the strains (2.2): two shears, 1 / stretch, forms of twist and curvatures, the factor c;
# there is one of the means and one of the end of the step, and behind them the stretch at the end
SHAPE = 7 * 8
SHAPES = 2 * SHAPE + 8
POINT_NODES = SHAPES_AT + SHAPES
# scratch of a node at a point: six rows b_i of the middle of the step, the products D b_i with the rows of the end, (4.8), and
# the 3 x 3 matrices rotation-position and position-rotation
ROWS, PRODUCTS, ROTATION_POSITION, POSITION_ROTATION, POINT_NODE = 0, 18 * 8, 36 * 8, 45 * 8, 54 * 8

# scratch of a point in a plane: four stresses, the 2 x 2 matrix that pairs of positions share; of a node three rows, their
# products, the columns rotation-position and position-rotation
PLANAR_MATRIX, PLANAR_NODES = 4 * 8, 8 * 8
PLANAR_ROWS, PLANAR_PRODUCTS, PLANAR_ROTATION_POSITION, PLANAR_POSITION_ROTATION, PLANAR_NODE = 0, 24, 48, 64, 80

# scratch of the point that is evaluated, in the place that the tangent takes afterwards: z = (phi', d_i, d_i') in the middle and
# at the end of the step, strains, z before the last increment, that increment, stresses or quadratic forms; then the products of
# `point_stiffness`
Z = 21 * 8
MIDDLE, END, STRAINS, BEFORE, STEP, TEMPORARY = 0, Z, 2 * Z, 2 * Z + 56, 3 * Z + 56, 4 * Z + 56
# behind the strains, half their change in the step, of damped sections
HALF_CHANGE = 56
POINT_PRODUCTS = 2 * Z
POINT_SCRATCH = POINT_PRODUCTS + (49 + 9 + 18 + 18 + 12) * 8
# last of it, of nonlinear sections: six added stresses, and six moduli
ADDED, MODULI = POINT_SCRATCH - 12 * 8, POINT_SCRATCH - 6 * 8
# behind it, of every pair of nodes a < b, vectors of the middle, then of the end: three for twist and curvatures, one for the
# lengths of directors
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
    masses: int              # masses of positions, nn x nn
    director_masses: int     # masses of directors, nn x nn
    table_size: int
    # scratch: coordinates in the middle and at the end of the step, node by node, stand first
    node: int                # distance of nodes there
    rates: int               # second rates u of the coordinates, theory.md 4
    forces: int              # forces on the coordinates
    rows: int                # residual
    blocks: int              # tangent: nn x nn blocks
    points: int              # stiffness of points, for pairs of nodes
    point_stride: int        # distance of points there
    spin_rates: int          # derivatives of second rates by spins, in space
    increment: int           # coordinates before the last increment, and that increment
    tangent_forces: int      # forces of the stresses that only the tangent takes (4.6), in place of the second rates, which are
    #                          needed no more once the inertia forces are there
    twists: int              # vectors of pairs of nodes
    pairs: int               # in space sums of stresses for pairs of nodes, in the blocks of the tangent, in the quarter position
    #                          against position, which is evaluated last
    pair_size: int           # distance of pairs
    doubles: int             # in all


# sums of a pair in space: two of shears, three of twist and curvatures, one of lengths
SHEAR_2, SHEAR_3, TWIST, CURVATURE_2, CURVATURE_3, LENGTHS = 0, 8, 16, 48, 56, 64


@inlined
def layout(dofs, nn, nq):
    """Return the layout for nodes in space or in a plane."""
    n = len(dofs)
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
    twists = blocks + POINT_SCRATCH
    points = blocks + 8 * n * n * nn * nn
    if n == 6:
        points = max(points, twists + TWISTS * nn * (nn - 1))
    point_stride = POINT_NODES + POINT_NODE * nn if n == 6 else PLANAR_NODES + PLANAR_NODE * nn
    spin_rates = points + nq * point_stride
    increment = spin_rates + (144 * nn if n == 6 else 0)
    doubles = increment + 2 * node * nn
    return Layout(nn, nq, point, point_size, inertia, masses, masses + 8 * nn * nn, masses + 16 * nn * nn, 2 * node, rates,
                  forces, rows, blocks, points, point_stride, spin_rates, increment, rates, twists, blocks, 288, doubles)


def layout_of(dofs: tuple[int, ...], nn: int, nq: int) -> Layout:
    """Return `layout` for callers in Python, without compiled code."""
    found: Layout = layout.py_func(dofs, nn, nq)
    return found
