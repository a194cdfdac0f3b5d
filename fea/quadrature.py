"""Quadrature on the reference triangle and tetrahedron.

Weights sum to the size of the reference domain: 1/2 for the triangle, 1/6 for the tetrahedron.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Points and weights that integrate polynomials up to a degree exactly.

    Attributes:
        points: on the reference domain.
        weights: one a point, all positive.
        degree: highest total degree integrated exactly.
    """

    points: Float[np.ndarray, "quad dim"]
    weights: Float[np.ndarray, " quad"]
    degree: int


def _symmetric(orbits: list[tuple[tuple[float, ...], float]], degree: int) -> Quadrature:
    """All distinct permutations of barycentric coordinates; orbit weights are fractions of 1."""
    points, weights = [], []
    for barycentric, weight in orbits:
        for point in sorted(set(permutations(barycentric))):
            points.append(point[1:])
            weights.append(weight)
    dimension = len(orbits[0][0]) - 1
    measure = {2: 1 / 2, 3: 1 / 6}[dimension]
    return Quadrature(np.array(points), measure * np.array(weights), degree)


def _orbit(a: float, corners: int) -> tuple[float, ...]:
    """One coordinate free, the others a."""
    return (1 - (corners - 1) * a, *[a] * (corners - 1))


# Strang & Fix, An Analysis of the Finite Element Method (1973), table 4.1: 3 points.
TRIANGLE_2 = _symmetric([(_orbit(1 / 6, 3), 1 / 3)], 2)

# Dunavant, Int. J. Numer. Meth. Eng. 21 (1985) 1129-1148: 6 points.
TRIANGLE_4 = _symmetric(
    [
        (_orbit(0.44594849091596488632, 3), 0.22338158967801146570),
        (_orbit(0.09157621350977074346, 3), 0.10995174365532186764),
    ],
    4,
)

TETRAHEDRON_1 = _symmetric([(_orbit(1 / 4, 4), 1.0)], 1)

# Hammer, Marlowe, Stroud (1956): 4 points.
TETRAHEDRON_2 = _symmetric([(_orbit((5 - np.sqrt(5)) / 20, 4), 1 / 4)], 2)

# Walkington, "Quadrature on simplices of arbitrary dimension" (2000): 14 points.
_A = 0.045503704125649649492
TETRAHEDRON_5 = _symmetric(
    [
        (_orbit(0.31088591926330060980, 4), 0.11268792571801585080),
        (_orbit(0.092735250310891226402, 4), 0.073493043116361949544),
        ((_A, _A, 0.5 - _A, 0.5 - _A), 0.042546020777081466438),
    ],
    5,
)
