"""Equal joints found, so that each kind is worked out once: a uniform lattice has a few dozen."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.solid.strut_ends import StrutEnds

# Steps per unit in which directions, and per largest radius in which lengths, are compared: a
# type's shape is then off by a ten-millionth of a radius, and rings have their own places anyway.
STEPS = 1e7
# Moves the border between two steps away from round numbers, such as a direction of 1/2.
BORDER = 0.137


@dataclass(frozen=True, eq=False)
class JointTypes:
    """Types of joints of equal valence.

    Attributes:
        joints: numbers of the joints in the structure.
        type: of each of them.
        ends: ends of the struts of one joint of each type.
    """

    joints: Int[np.ndarray, " joints"]
    type: Int[np.ndarray, " joints"]
    ends: Int[np.ndarray, "types slots"]


def joint_types(ends: StrutEnds, joints: Int[np.ndarray, " joints"]) -> JointTypes:
    """Sorts joints of equal valence by the directions and sizes of what meets there."""
    members = ends.ends_of(joints)
    rows = _rows(ends, joints, members)
    # One random number a row instead of the row: rows are compared afterwards.
    factors = np.random.default_rng(0).integers(1, 2**62, rows.shape[1], dtype=np.int64) | 1
    with np.errstate(over="ignore"):
        key = (rows * factors).sum(axis=1)
    _, first, type_of = np.unique(key, return_index=True, return_inverse=True)
    if not (rows == rows[first[type_of]]).all():  # two rows had the same number
        first = type_of = np.arange(len(joints))
    return JointTypes(joints, type_of.reshape(-1), members[first])


def _rows(
    ends: StrutEnds, joints: Int[np.ndarray, " joints"], members: Int[np.ndarray, "joints slots"]
) -> Int[np.ndarray, "joints columns"]:
    """Everything that a joint's surface depends on, in whole steps."""
    size = float(ends.radius.max())
    columns: list[Float[np.ndarray, "joints columns"]] = [
        ends.axis[members].reshape(len(joints), -1),
        ends.u[members].reshape(len(joints), -1),
        ends.radius[members] / size,
        ends.slope[members],
        ends.ring[members] / size,
        ends.fillet[joints, None] / size,
    ]
    return np.floor(np.concatenate(columns, axis=1) * STEPS + BORDER).astype(np.int64)
