"""Lengths and directions of struts, from joints that NumPy or JAX holds.

Every function of joints takes NumPy or JAX arrays and returns the same kind, so that JAX
differentiates lengths and directions in the joints, and through `mapped_joints` in the grid's nodes.
"""

from typing import TypeVar

import numpy as np
from jaxtyping import Array, Float, Int

Kind = TypeVar("Kind", np.ndarray, Array)


def strut_vectors(
    joints: Float[Kind, "joints 3"], struts: Int[np.ndarray, "struts 2"]
) -> Float[Kind, "struts 3"]:
    """From the first joint of each strut to its second [mm]."""
    return joints[struts[:, 1]] - joints[struts[:, 0]]


def strut_lengths(
    joints: Float[Kind, "joints 3"], struts: Int[np.ndarray, "struts 2"]
) -> Float[Kind, " struts"]:
    """Length of each strut between its joints [mm]."""
    xp = joints.__array_namespace__()
    return xp.linalg.norm(strut_vectors(joints, struts), axis=-1)


def strut_directions(
    joints: Float[Kind, "joints 3"], struts: Int[np.ndarray, "struts 2"]
) -> Float[Kind, "struts 3"]:
    """Unit vector along each strut, from its first joint; NaN where the strut has no length."""
    return strut_vectors(joints, struts) / strut_lengths(joints, struts)[:, None]


def strut_angles(
    directions: Float[np.ndarray, "struts 3"], axes: Float[np.ndarray, "struts _ 3"]
) -> Float[np.ndarray, "struts _"]:
    """Angle of each strut to each of the axes at its place, 0 to 90 degrees.

    From sine and cosine together: an arc cosine alone is wrong by 1e-8 near zero.

    Args:
        directions: of the struts, any length above zero.
        axes: as rows, any length above zero, such as the principal directions of the stress at the
            middle of each strut.
    """
    along = np.abs(np.einsum("si,sai->sa", directions, axes))
    across = np.linalg.norm(np.cross(directions[:, None], axes), axis=-1)
    return np.degrees(np.arctan2(across, along))
