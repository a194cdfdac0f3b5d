"""A triangle in its own plane: axes, area, edges, gradients of area coordinates.

The plane's axes come from the corners without a branch: the first along the first edge, the third
normal by the right-hand rule. Strains are [xx, yy, xy] with engineering shear. Corner i is followed by
corner i + 1 (cyclic), and edge i runs from corner i to corner i + 1.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# A number, or one that JAX traces.
Scalar = float | Float[Array, ""]

# The corner that edge i runs to, and the corner opposite to it.
NEXT = np.array([1, 2, 0])
OPPOSITE = np.array([2, 0, 1])


class PlaneTriangle(eqx.Module):
    """The triangle seen along its normal.

    Attributes:
        axes: unit vectors as rows; the third is the normal.
        area: [mm²].
        edges: vectors along edge i in the plane's axes [mm].
        gradients: of the area coordinate of corner i [1/mm].
    """

    axes: Float[Array, "3 3"]
    area: Float[Array, ""]
    edges: Float[Array, "3 2"]
    gradients: Float[Array, "3 2"]

    @classmethod
    def of(cls, corners: Float[Array, "3 3"]) -> "PlaneTriangle":
        """Project a triangle on its plane.

        Args:
            corners: positions [mm]; not on one line.
        """
        along = corners[NEXT] - corners
        normal = jnp.cross(along[0], along[1])
        twice_area = jnp.sqrt(normal @ normal)
        first = along[0] / jnp.sqrt(along[0] @ along[0])
        third = normal / twice_area
        axes = jnp.stack([first, jnp.cross(third, first), third])
        edges = along @ axes[:2].T
        # Edge i + 1 lies opposite to corner i, and its left normal points to it.
        return cls(axes, twice_area / 2, edges, quarter_turn(edges)[NEXT] / twice_area)


def quarter_turn(vectors: Float[Array, "*shape 2"]) -> Float[Array, "*shape 2"]:
    """Vectors of a plane, turned by 90° to the left."""
    return jnp.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def dyad(a: Float[Array, "*shape 2"], b: Float[Array, "*shape 2"]) -> Float[Array, "*shape 3"]:
    """The symmetric part of a bᵀ as a strain [xx, yy, xy]."""
    return jnp.stack(
        [
            a[..., 0] * b[..., 0],
            a[..., 1] * b[..., 1],
            a[..., 0] * b[..., 1] + a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def plane_stress_root(nu: Scalar) -> Float[Array, "3 3"]:
    """R with Rᵀ R the plane-stress matrix over E: [[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu)/2]]/(1 - nu²).

    The sum and the difference of the normal strains, and the shear, do not mix.
    """
    bulk, shear = 1 / jnp.sqrt(2 * (1 - nu)), 1 / jnp.sqrt(2 * (1 + nu))
    zero = jnp.zeros_like(bulk)
    return jnp.stack(
        [
            jnp.stack([bulk, bulk, zero]),
            jnp.stack([shear, -shear, zero]),
            jnp.stack([zero, zero, shear]),
        ]
    )


# Rows are orthonormal and without mean: of corner values of a linear field they leave its slope.
# For a field with mean m and slopes s = SLOPES @ corner values, the mean square is m² + s.s/12.
SLOPES = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])
SLOPE_SHARE = 1 / 12
