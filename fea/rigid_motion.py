"""Rigid motions of a set of points, and in words those that supports leave free."""

import numpy as np
from jaxtyping import Bool, Float

# A motion counts as held when supports resist it with at least this share of a motion of the whole
# extent. Rounding of supports on one line gives 1e-16 times their distance from the origin in
# extents, times the root of their number; an intended support stays far above.
HELD = 1e-8

# A part of a motion (its turning, its pitch, a direction's component) smaller than this is none.
ALIGNED = 1e-6


def rigid_body_modes(
    points: Float[np.ndarray, "points 3"], *, rotations: bool = False
) -> Float[np.ndarray, "dofs 6"]:
    """Displacements of three translations and three rotations about the centroid.

    Args:
        points: positions [mm].
        rotations: whether each point carries rotations too (six dofs: three displacements, then
            three rotation angles) or displacements only (three dofs).

    Returns:
        One column a mode; the rotations are per unit of the points' extent, so that all columns
        are of similar size.
    """
    centre = points.mean(axis=0)
    return rigid_modes(points, centre, extent_of(points, centre), rotations=rotations).reshape(
        -1, 6
    )


def free_motion(
    points: Float[np.ndarray, "points 3"],
    fixed: Bool[np.ndarray, "points dofs"],
    *,
    base_form: bool = False,
) -> str | None:
    """Name the rigid motion that supports leave to points moving as one body.

    Args:
        points: positions [mm].
        fixed: which of the three displacements (or three displacements and three rotations) of
            each point are prescribed.
        base_form: "slide along x", to follow "can" or a plural, instead of "slides along x".

    Returns:
        Words that follow "the part", such as "slides along x" or "turns about an axis along z
        through (0, 5, 0)"; None when every rigid motion is held.
    """
    centre = points.mean(axis=0)
    extent = extent_of(points, centre)
    modes = rigid_modes(points, centre, extent, rotations=fixed.shape[1] == 6)
    modes[:, 3:] *= extent  # angles weigh as much as displacements
    free = null_space(modes[fixed])
    if free.shape[1] == 0:
        return None
    return motion_in_words(free, centre=centre, extent=extent, base_form=base_form)


def motion_in_words(
    motions: Float[np.ndarray, "6 free"],
    *,
    centre: Float[np.ndarray, " 3"],
    extent: float,
    tolerance: float = ALIGNED,
    base_form: bool = False,
) -> str:
    """Describe the space of rigid motions that some motions span.

    Args:
        motions: one a column, not all zero: displacement of `centre`, then rotation times `extent`.
        centre: position of the point whose displacement is given [mm].
        extent: size of what moves [mm].
        tolerance: share of a motion that counts as nothing; for motions found with rounding.
        base_form: "slide along x", to follow "can" or a plural, instead of "slides along x".

    Returns:
        Such as "slides along x" or "turns about an axis along z through (0, 5, 0)".
    """
    s = "" if base_form else "s"
    left, size, _ = np.linalg.svd(motions, full_matrices=False)
    free = left[:, size > tolerance * size[0]]
    if free.shape[1] == 6:
        return f"slide{s} and turn{s} in every direction"
    translations = free[:3] @ null_space(free[3:], tolerance)
    words = [f"slide{s} {_slides(translations, tolerance)}"] if translations.shape[1] else []
    # The rest of the free space, which turns: without the part that only slides.
    right = np.linalg.svd(free[3:])[2][: free.shape[1] - translations.shape[1]]
    turns = free @ right.T
    turns[:3] -= translations @ (translations.T @ turns[:3])
    if turns.shape[1]:
        # Rotations are times the extent; back to millimetres per radian.
        turns[:3] *= extent
        words.append(_turns(turns, centre, extent, tolerance=tolerance, s=s))
    return " and ".join(words)


def rigid_modes(
    points: Float[np.ndarray, "points 3"],
    centre: Float[np.ndarray, "*#points 3"],
    extent: float | Float[np.ndarray, " points"],
    *,
    rotations: bool = False,
) -> Float[np.ndarray, "points dofs 6"]:
    """Displacement (and rotation) of points by the six rigid motions of `motion_in_words`.

    Args:
        points: positions [mm].
        centre: of the motions, one or one a point.
        extent: that rotations are multiplied with, one or one a point.
        rotations: whether each point carries its rotation too.
    """
    r = (points - centre) / np.reshape(extent, (-1, 1))
    modes = np.zeros((len(points), 6 if rotations else 3, 6))
    modes[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for axis in range(3):
        modes[:, :3, 3 + axis] = np.cross(np.eye(3)[axis], r)
        if rotations:
            modes[:, 3 + axis, 3 + axis] = 1.0 / extent
    return modes


def extent_of(points: Float[np.ndarray, "points 3"], centre: Float[np.ndarray, " 3"]) -> float:
    """Largest distance along an axis from the centre [mm]; 1 for a single point."""
    extent = float(np.abs(points - centre).max())
    return extent if extent > 0 else 1.0


def null_space(
    rows: Float[np.ndarray, "rows n"], tolerance: float = HELD
) -> Float[np.ndarray, "n free"]:
    """Orthonormal columns that the rows take to less than the tolerance.

    By singular values of the triangular factor, of the rows themselves and not of their squares,
    so that rounding of rows of order one stays near 1e-16.
    """
    n = rows.shape[1]
    if len(rows) == 0:
        return np.eye(n)
    R = np.linalg.qr(rows, mode="r") if len(rows) > n else rows
    _, size, right = np.linalg.svd(R)
    return right[int(np.count_nonzero(size >= tolerance)) :].T


def _slides(translations: Float[np.ndarray, "3 free"], tolerance: float) -> str:
    if translations.shape[1] == 3:
        return "in every direction"
    if translations.shape[1] == 1:
        return f"along {_direction(translations[:, 0], tolerance)}"
    normal = np.cross(translations[:, 0], translations[:, 1])
    axis = int(np.argmax(np.abs(normal)))
    if _is_aligned(normal, axis, tolerance):
        return f"along {' and '.join('xyz'.replace('xyz'[axis], ''))}"
    return f"in the plane normal to {_direction(normal, tolerance)}"


def _turns(
    turns: Float[np.ndarray, "6 free"],
    centre: Float[np.ndarray, " 3"],
    extent: float,
    *,
    tolerance: float,
    s: str,
) -> str:
    t, w = turns[:3], turns[3:]
    count = turns.shape[1]
    if count == 1:
        t, w = t[:, 0] / np.linalg.norm(w), w[:, 0] / np.linalg.norm(w)
        where = _position(centre + np.cross(w, t), extent)
        # With a pitch the motion slides along its axis as it turns.
        verb = "turn" if abs(t @ w) < tolerance * extent else "screw"
        return f"{verb}{s} about an axis along {_direction(w, tolerance)} through {where}"
    # A point p, from the centre, that all turns leave at rest: t + w x p = 0 for every column.
    cross = np.concatenate([np.cross(w[:, k], np.eye(3)).T for k in range(count)])
    p = np.linalg.lstsq(cross, -t.T.ravel(), rcond=None)[0]
    rest = np.abs(cross @ p + t.T.ravel()).max() < tolerance * extent
    where = f" through {_position(centre + p, extent)}" if rest else ""
    if count == 3:
        return f"turn{s} about every axis{where}"
    normal = _direction(np.cross(w[:, 0], w[:, 1]), tolerance)
    return f"turn{s} about axes{where} normal to {normal}"


def _is_aligned(direction: Float[np.ndarray, " 3"], axis: int, tolerance: float) -> bool:
    unit = direction / np.linalg.norm(direction)
    return float(np.abs(np.delete(unit, axis)).max()) < tolerance


def _direction(direction: Float[np.ndarray, " 3"], tolerance: float) -> str:
    unit = direction / np.linalg.norm(direction)
    axis = int(np.argmax(np.abs(unit)))
    if _is_aligned(unit, axis, tolerance):
        return "xyz"[axis]
    unit = unit * np.sign(unit[axis])
    return f"({', '.join(f'{round(float(c), 3) + 0.0:g}' for c in unit)})"


def _position(point: Float[np.ndarray, " 3"], extent: float) -> str:
    # Four digits of the part's size say where; + 0.0 turns -0 into 0.
    digits = 4 - int(np.floor(np.log10(extent)))
    return f"({', '.join(f'{round(float(c), digits) + 0.0:g}' for c in point)})"
