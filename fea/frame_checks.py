"""What is wrong with a frame, by name and place, before anything is solved."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from fea.errors import FeaError, position_text
from fea.rigid_motion import free_motion

Joints = Float[np.ndarray, "joints 3"]
Struts = Int[np.ndarray, "struts 2"]


def check_numbers(values: Float[np.ndarray, "rows ..."], what: str, unit: str) -> None:
    """Refuse what is not a number.

    Args:
        values: one row an item.
        what: of the message, with a place for the number of the row.
        unit: of the values.

    Raises:
        FeaError: with the first such row.
    """
    bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
    if bad.size:
        row = values[bad[0]].ravel()
        shown = f"{', '.join(f'{number:g}' for number in row)} {unit}".rstrip()
        raise FeaError(f"{what.format(bad[0])}: {shown} is not a number; give finite numbers.")


def check_struts(joints: Joints, struts: Struts) -> None:
    """Refuse struts that lead nowhere or twice between the same joints.

    Raises:
        FeaError: for joints that do not exist or have no position, no length, or a repeated strut.
    """
    count = len(joints)
    check_numbers(joints, "The position of joint {}", "mm")
    if struts.size == 0:
        return
    if not 0 <= struts.min() <= struts.max() < count:
        raise FeaError(
            f"Struts refer to joints {struts.min()} to {struts.max()}, but the frame has joints 0 to "
            f"{count - 1}."
        )
    length = _lengths(joints, struts)
    if not length.min() > 0:
        worst = int(np.argmin(length))
        raise FeaError(
            f"Strut {worst} at {position_text(joints[struts[worst, 0]])} mm has no length; weld its "
            "joints."
        )
    key = np.sort(struts, axis=1).astype(np.int64) @ np.array([count, 1])
    order = np.argsort(key, kind="stable")
    twice = np.flatnonzero(np.diff(key[order]) == 0)
    if twice.size:
        first, second = order[twice[0]], order[twice[0] + 1]
        raise FeaError(
            f"Struts {first} and {second} join the same joints, {struts[first, 0]} and "
            f"{struts[first, 1]}, at {position_text(joints[struts[first, 0]])} mm; keep one of them."
        )


def check_radii(joints: Joints, struts: Struts, radii: Float[np.ndarray, "..."]) -> None:
    """Refuse radii that are no radii.

    Raises:
        FeaError: for another number of them, or one that is not a positive number.
    """
    if radii.shape != struts.shape:
        raise FeaError(f"Radii have shape {radii.shape}; give {struts.shape}, one at each end.")
    check_numbers(radii, "The radius of strut {}", "mm")
    if radii.size and not radii.min() > 0:
        worst = int(np.argmin(radii.min(axis=1)))
        raise FeaError(
            f"Strut {worst} at {position_text(joints[struts[worst, 0]])} mm has radius "
            f"{radii[worst].min():g} mm; radii must be positive."
        )


def check_modulus(struts: Struts, modulus: Float[np.ndarray, "..."]) -> None:
    """Refuse relative moduli that no material has.

    Raises:
        FeaError: for another number of them, or one that is not a positive number.
    """
    if modulus.shape != (len(struts),):
        raise FeaError(
            f"Relative moduli have shape {modulus.shape}; give {len(struts)}, one a strut."
        )
    check_numbers(modulus, "The relative modulus of strut {}", "")
    if modulus.size and not modulus.min() > 0:
        worst = int(np.argmin(modulus))
        raise FeaError(
            f"Strut {worst} has the relative modulus {modulus[worst]:g}; moduli must be positive (that "
            "of an absent strut is small, such as 1e-6)."
        )


def check_rigid_ends(joints: Joints, struts: Struts, rigid: Float[np.ndarray, "..."]) -> None:
    """Refuse rigid ends that leave nothing of a strut.

    Raises:
        FeaError: for another number of them, a negative one, or two as long as the strut.
    """
    if rigid.shape != struts.shape:
        raise FeaError(
            f"Rigid ends have shape {rigid.shape}; give {struts.shape}, one at each end."
        )
    check_numbers(rigid, "The rigid ends of strut {}", "mm")
    if not rigid.size:
        return
    if not rigid.min() >= 0:
        worst = int(np.argmin(rigid.min(axis=1)))
        raise FeaError(
            f"Strut {worst} has a rigid end of {rigid[worst].min():g} mm; give 0 or more."
        )
    length = _lengths(joints, struts)
    left = 1 - rigid.sum(axis=1) / length
    if not left.min() > 0:
        worst = int(np.argmin(left))
        raise FeaError(
            f"The rigid ends of strut {worst} at {position_text(joints[struts[worst, 0]])} mm are "
            f"{rigid[worst].sum():g} mm long together, the strut {length[worst]:g} mm; shorten them."
        )


def check_strut_loads(struts: Struts, loads: Float[np.ndarray, "..."], cases: int) -> None:
    """Refuse strut loads of another shape, or that are not numbers.

    Raises:
        FeaError: with the first such strut.
    """
    wanted = (cases, len(struts), 3, 3)
    if loads.shape != wanted:
        raise FeaError(
            f"Strut loads have shape {loads.shape}; give {wanted}: cases, struts, the first joint, "
            "middle and second joint, and x, y, z."
        )
    check_numbers(np.moveaxis(loads, 1, 0), "The load on strut {}", "N/mm")


def check_used(
    joints: Joints, fixed: Bool[np.ndarray, "joints 6"], links: Sequence[Int[np.ndarray, "_ _"]]
) -> None:
    """Refuse joints that belong to nothing and are not fixed.

    Raises:
        FeaError: with the first such joint.
    """
    idle = np.logical_not(fixed.all(axis=1))
    for rows in links:
        idle[rows.ravel()] = False
    unused = np.flatnonzero(idle)
    if unused.size:
        raise FeaError(
            f"Joint {unused[0]} at {position_text(joints[unused[0]])} mm has no strut; remove it or "
            "fix it."
        )


def pieces_of(
    joints: int, links: Sequence[Int[np.ndarray, "_ _"]]
) -> tuple[int, Int[np.ndarray, " joints"]]:
    """Number of connected pieces, and the piece of each joint.

    Args:
        joints: how many there are.
        links: joints that each row connects, such as those of struts, triangles and couplings.
    """
    pairs = [rows[:, i : i + 2] for rows in links for i in range(rows.shape[1] - 1)]
    a, b = np.concatenate(pairs).T
    graph = csr_array((np.ones(len(a)), (a, b)), shape=(joints, joints))
    pieces, piece_of = connected_components(graph, directed=False)
    return int(pieces), piece_of


def free_frame_motion(
    joints: Joints,
    fixed: Bool[np.ndarray, "joints 6"],
    links: Sequence[Int[np.ndarray, "_ _"]],
) -> str | None:
    """The rigid motion that the supports leave to a connected piece of a frame, in words.

    Joints are rigid, so that a piece has no other free motion; None means that it can be solved.

    Returns:
        Words that follow "the frame", such as "slides along x"; see `fea.rigid_motion`.
    """
    pieces, piece_of = pieces_of(len(joints), links)
    order = np.argsort(piece_of, kind="stable")
    for inside in np.split(order, np.searchsorted(piece_of[order], np.arange(1, pieces))):
        motion = free_motion(joints[inside], fixed[inside])
        if motion is not None:
            return (
                motion
                if pieces == 1
                else (
                    f"falls into {pieces} pieces, of which one of {len(inside)} joints near "
                    f"{position_text(joints[inside[0]])} mm {motion}"
                )
            )
    return None


def check_held(
    joints: Joints, fixed: Bool[np.ndarray, "joints 6"], links: Sequence[Int[np.ndarray, "_ _"]]
) -> None:
    """Refuse a frame of which a connected piece can move.

    Raises:
        FeaError: with the motion, and where the piece is.
    """
    motion = free_frame_motion(joints, fixed, links)
    if motion:
        raise FeaError(
            f"The frame is not held: it {motion}; fix more degrees of freedom, join the pieces, or "
            "remove what is loose."
        )


def _lengths(joints: Joints, struts: Struts) -> Float[np.ndarray, " struts"]:
    ends = joints[struts]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
