"""Positions and measures at quadrature points of straight and curved cells and facets.

The same code serves NumPy and JAX: what goes in as a JAX array, traced or not, comes out as one.
"""

from typing import TypeVar

import numpy as np
from jaxtyping import Array, Float

from fea.elements import TETRAHEDRA, TRIANGLES
from fea.quadrature import Quadrature

Kind = TypeVar("Kind", np.ndarray, Array)


def facet_points(
    x: Float[Kind, "facets corners 3"], rule: Quadrature
) -> tuple[Float[Kind, "facets quad 3"], Float[Kind, "facets quad 3"]]:
    """Positions of quadrature points [mm], and normals there times the area they stand for [mm²].

    The normal times dA is the cross product of the tangents, a polynomial, also where the facet is
    curved (degree 2 on tri6); its length, the area, is not.

    Args:
        x: node positions of each facet [mm].
        rule: on the reference triangle.
    """
    xp = x.__array_namespace__()
    element = TRIANGLES[x.shape[1]]
    position = xp.einsum("fnx,qn->fqx", x, element.shape(rule.points))
    tangents = xp.einsum("fnx,qnr->rfqx", x, element.gradient(rule.points))
    normal = xp.cross(tangents[0], tangents[1])
    return position, normal * rule.weights[None, :, None]


def cell_points(
    x: Float[Kind, "cells corners 3"], rule: Quadrature
) -> tuple[Float[Kind, "cells quad 3"], Float[Kind, "cells quad"]]:
    """Positions of quadrature points [mm], and the volume that each stands for [mm³].

    Args:
        x: node positions of each cell [mm].
        rule: on the reference tetrahedron.
    """
    xp = x.__array_namespace__()
    position = xp.einsum("cnx,qn->cqx", x, TETRAHEDRA[x.shape[1]].shape(rule.points))
    return position, cell_determinants(x, rule.points) * rule.weights[None, :]


def cell_determinants(
    x: Float[Kind, "cells corners 3"], points: Float[np.ndarray, "quad 3"]
) -> Float[Kind, "cells quad"]:
    """Determinant of the isoparametric map at reference points, six times the volume on tet4.

    Cubic in the reference position on a curved tet10, constant on straight edges.

    Args:
        x: node positions of each cell [mm].
        points: on the reference tetrahedron.
    """
    xp = x.__array_namespace__()
    linear = x.shape[1] == 4
    # The map of a tet4 has one gradient: once is enough, whatever the number of points.
    gradient = TETRAHEDRA[x.shape[1]].gradient(points[:1] if linear else points)
    a, b, c = xp.einsum("cnx,qnr->rxcq", x, gradient)
    det = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return xp.broadcast_to(det, (x.shape[0], len(points)))
