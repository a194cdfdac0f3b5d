"""Axes of the plane in which the walls of an extruded lattice meet."""

import numpy as np
from jaxtyping import Float


def plane_axes(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """A right-handed system whose third axis is that of extrusion, as rows.

    The first is as near as can be to one of x, y, z: for an axis along z they are x, y, z, along x
    y, z, x, along y z, x, y; for one normal to x, y or z the first is that.

    Args:
        axis: unit vector.
    """
    longest = int(np.argmax(np.abs(axis)))
    others = [(longest + 1) % 3, (longest + 2) % 3]
    along = min(others, key=lambda k: abs(axis[k]))
    first = np.eye(3)[along] - axis[along] * axis
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])
