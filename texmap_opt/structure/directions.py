"""Directions seen from a joint, and how much of the sphere or the circle each stands for.

The quadratures are fixed and symmetric, so that symmetric lattices have symmetric gradients: that of
the sphere has all 48 symmetries of the cube (of its 48 like triangles between mirror planes one is cut
into m² triangles, and their centres are reflected), that of the circle those of a polygon of 24 sides.
No direction lies on a mirror plane, where two struts would be the farthest and rounding would choose
between them.
"""

from functools import cache
from itertools import permutations, product

import numpy as np
from jaxtyping import Float

from texmap_opt.structure.plane_axes import plane_axes

# Directions of the circle for each of m²: as many as of the sphere. A multiple of 24 cells between
# directions, so that none lies on a mirror line of a square, a hexagon or what is inscribed in them.
CIRCLE_DIRECTIONS = 48


@cache
def sphere_quadrature(
    subdivisions: int,
) -> tuple[Float[np.ndarray, "quad 3"], Float[np.ndarray, " quad"]]:
    """Directions and solid angles: 48 m², symmetric as the cube; the weights sum to 4 pi.

    The solid angle of each triangle is exact: Van Oosterom and Strackee, IEEE Trans. Biomed. Eng.
    30 (1983) 125.
    """
    m = subdivisions
    up = [((i, j), (i + 1, j), (i, j + 1)) for i in range(m) for j in range(m - i)]
    down = [
        ((i + 1, j + 1), (i, j + 1), (i + 1, j)) for i in range(m - 1) for j in range(m - 1 - i)
    ]
    ij = np.array(up + down, float) / m
    share = np.stack([1 - ij.sum(axis=-1), ij[..., 0], ij[..., 1]], axis=-1)
    # Through a face, an edge and a corner of the cube.
    triangle = np.array([[1, 0, 0], [1 / 2, 1 / 2, 0], [1 / 3, 1 / 3, 1 / 3]])
    corner = share @ triangle
    corner /= np.linalg.norm(corner, axis=-1, keepdims=True)
    a, b, c = np.moveaxis(corner, 1, 0)
    triple = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    dots = np.sum(a * b + b * c + c * a, axis=1)
    weight = 2 * np.arctan2(triple, 1 + dots)
    centre = corner.mean(axis=1)
    centre /= np.linalg.norm(centre, axis=1, keepdims=True)
    images = [
        centre[:, order] * signs
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.concatenate(images), np.tile(weight, len(images))


def circle_quadrature(
    subdivisions: int, axis: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, "quad 3"], Float[np.ndarray, " quad"]]:
    """Directions normal to an axis and their angles [rad]: 48 m², which sum to 2 pi.

    Args:
        subdivisions: m.
        axis: unit vector.
    """
    count = CIRCLE_DIRECTIONS * subdivisions**2
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    first, second, _ = plane_axes(axis)
    directions = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return directions, np.full(count, 2 * np.pi / count)
