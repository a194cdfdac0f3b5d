"""What takes a frame out of its plane, by name and place, before anything is solved."""

import numpy as np
from jaxtyping import Bool, Float

from fea.errors import FeaError, position_text

# Share of the largest load, or of the frame's extent, that counts as nothing: the rounding of forces
# summed over a meshed surface is 1e-12, that of positions kept in single precision 1e-7.
OUT_OF_PLANE = 1e-6

REASON = (
    "walls bend about their axis of extrusion only, and out of their plane they are plates, which this "
    "model does not know"
)


def check_flat(joints: Float[np.ndarray, "joints 3"], normal: Float[np.ndarray, " 3"]) -> None:
    """Refuse joints that do not lie in one plane.

    Args:
        joints: positions [mm].
        normal: unit vector.

    Raises:
        FeaError: with the joint that is furthest off.
    """
    height = joints @ normal
    off = height - np.median(height)
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > OUT_OF_PLANE * float(np.ptp(joints, axis=0).max()):
        raise FeaError(
            f"Joint {worst} at {position_text(joints[worst])} mm lies {abs(off[worst]):.3g} mm out of the "
            f"plane of the others, normal to {position_text(normal)}; a frame of walls needs all joints in "
            "one plane."
        )


def check_plane_loads(
    joints: Float[np.ndarray, "joints 3"],
    forces: Float[np.ndarray, "cases joints 6"],
    strut_loads: Float[np.ndarray, "cases struts 3 3"] | None,
    normal: Float[np.ndarray, " 3"],
) -> None:
    """Refuse loads out of the plane.

    Args:
        joints: positions [mm].
        forces: forces [N] and moments [N mm] on the joints.
        strut_loads: force per length [N/mm]; None: none.
        normal: unit vector.

    Raises:
        FeaError: with the largest such load.
    """
    extent = float(np.ptp(joints, axis=0).max())
    force, moment = forces[..., :3], forces[..., 3:]
    along = np.abs(force @ normal)
    across = np.linalg.norm(moment - (moment @ normal)[..., None] * normal, axis=-1)
    largest = np.linalg.norm(force, axis=-1).max(axis=1, initial=0.0)
    turning = np.maximum(np.linalg.norm(moment, axis=-1).max(axis=1, initial=0.0), largest * extent)
    for size, limit, unit, where in (
        (along, largest, "N", "along"),
        (across, turning, "N mm", "about an axis across"),
    ):
        excess = size - OUT_OF_PLANE * limit[:, None]
        case, joint = divmod(int(np.argmax(excess)), len(joints))
        if size[case, joint] > OUT_OF_PLANE * limit[case]:
            raise FeaError(
                f"Load case {case} acts on joint {joint} at {position_text(joints[joint])} mm with "
                f"{size[case, joint]:.3g} {unit} {where} {position_text(normal)}, the axis of extrusion; "
                f"load the lattice in its plane, as {REASON}."
            )
    if strut_loads is None:
        return
    along = np.abs(strut_loads @ normal).max(axis=2)
    limit = np.linalg.norm(strut_loads, axis=-1).max(axis=(1, 2), initial=0.0)
    excess = along - OUT_OF_PLANE * limit[:, None]
    case, strut = divmod(int(np.argmax(excess)), along.shape[1])
    if along[case, strut] > OUT_OF_PLANE * limit[case]:
        raise FeaError(
            f"Load case {case} acts on strut {strut} with {along[case, strut]:.3g} N/mm along "
            f"{position_text(normal)}, the axis of extrusion; load the lattice in its plane, as {REASON}."
        )


def check_walls(
    joints: Float[np.ndarray, "joints 3"],
    fixed: Bool[np.ndarray, "joints 6"],
    value: Float[np.ndarray, "joints 6"],
    own: Bool[np.ndarray, " joints"],
) -> Float[np.ndarray, " 3"]:
    """Refuse a frame of walls that can leave its plane.

    Args:
        joints: positions [mm].
        fixed: degrees of freedom whose value is prescribed.
        value: the values.
        own: joints that do not follow others, which hold them.

    Returns:
        The axis of extrusion, one of the coordinate axes.

    Raises:
        FeaError: when joints are not held in a plane normal to an axis, or are not in one plane, or
            are moved out of it.
    """
    for axis, out in enumerate(([0, 4, 5], [1, 3, 5], [2, 3, 4])):
        if not fixed[own][:, out].all():
            continue
        normal = np.eye(3)[axis]
        check_flat(joints, normal)
        moved = np.flatnonzero(own & (value[:, out] != 0).any(axis=1))
        if moved.size:
            raise out_of_plane_support(joints, int(moved[0]), normal)
        return normal
    raise FeaError(
        "A frame of walls is not held in its plane; fix, at every joint, the displacement along the axis "
        f"of extrusion and the rotations about the other two, as fea.in_plane does: {REASON}."
    )


def out_of_plane_support(
    joints: Float[np.ndarray, "joints 3"], joint: int, normal: Float[np.ndarray, " 3"]
) -> FeaError:
    """The error of a support that moves or turns a joint out of the plane."""
    return FeaError(
        f"The support of joint {joint} at {position_text(joints[joint])} mm prescribes a motion out of the "
        f"plane normal to {position_text(normal)}; prescribe motions in the plane only, as {REASON}."
    )
