"""Rigid motions of a set of points, and in words those that supports leave free."""

import numpy as np
from jaxtyping import Bool, Float

# A motion counts as held when supports resist it with at least this fraction of the best held
# motion. Rounding of supports on one line gives 1e-8 (the squares of its noise, 1e-16, are what is
# compared); an intended support, however small, stays far above.
HELD = 1e-7

# Axes closer to a coordinate axis than this are named after it.
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
    return _modes(points, centre, _extent(points, centre), rotations=rotations).reshape(-1, 6)


def free_motion(
    points: Float[np.ndarray, "points 3"], fixed: Bool[np.ndarray, "points dofs"]
) -> str | None:
    """Name the rigid motion that supports leave to points moving as one body.

    Args:
        points: positions [mm].
        fixed: which of the three displacements (or three displacements and three rotations) of
            each point are prescribed.

    Returns:
        Words that follow "the part", such as "slides along x" or "turns about an axis along z
        through (0, 5, 0)"; None when every rigid motion is held.
    """
    centre = points.mean(axis=0)
    extent = _extent(points, centre)
    modes = _modes(points, centre, extent, rotations=fixed.shape[1] == 6)
    modes[:, 3:] *= extent  # angles weigh as much as displacements
    free = _null_space(modes[fixed])
    if free.shape[1] == 0:
        return None
    if free.shape[1] == 6:
        return "slides and turns in every direction"
    translations = free[:3] @ _null_space(free[3:])
    words = [_slides(translations)] if translations.shape[1] else []
    # The rest of the free space, which turns: without the part that only slides.
    right = np.linalg.svd(free[3:])[2][: free.shape[1] - translations.shape[1]]
    turns = free @ right.T
    turns[:3] -= translations @ (translations.T @ turns[:3])
    if turns.shape[1]:
        # Rotation modes are per extent; back to millimetres per radian.
        turns[:3] *= extent
        words.append(_turns(turns, centre, extent))
    return " and ".join(words)


def _modes(
    points: Float[np.ndarray, "points 3"],
    centre: Float[np.ndarray, " 3"],
    extent: float,
    *,
    rotations: bool,
) -> Float[np.ndarray, "points dofs 6"]:
    r = (points - centre) / extent
    modes = np.zeros((len(points), 6 if rotations else 3, 6))
    modes[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for axis in range(3):
        modes[:, :3, 3 + axis] = np.cross(np.eye(3)[axis], r)
        if rotations:
            modes[:, 3 + axis, 3 + axis] = 1.0 / extent
    return modes


def _extent(points: Float[np.ndarray, "points 3"], centre: Float[np.ndarray, " 3"]) -> float:
    extent = float(np.abs(points - centre).max())
    return extent if extent > 0 else 1.0


def _null_space(rows: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, "n free"]:
    if len(rows) == 0:
        return np.eye(rows.shape[1])
    # Of the small normal matrix, as rows may be many; 1: entries are of order one by construction.
    held, vectors = np.linalg.eigh(rows.T @ rows)
    return vectors[:, held < HELD**2 * max(held[-1], 1.0)]


def _slides(translations: Float[np.ndarray, "3 free"]) -> str:
    if translations.shape[1] == 3:
        return "slides in every direction"
    if translations.shape[1] == 1:
        return f"slides along {_direction(translations[:, 0])}"
    normal = np.cross(translations[:, 0], translations[:, 1])
    axis = int(np.argmax(np.abs(normal)))
    if _is_aligned(normal, axis):
        return f"slides along {' and '.join('xyz'.replace('xyz'[axis], ''))}"
    return f"slides in the plane normal to {_direction(normal)}"


def _turns(
    turns: Float[np.ndarray, "6 free"], centre: Float[np.ndarray, " 3"], extent: float
) -> str:
    t, w = turns[:3], turns[3:]
    count = turns.shape[1]
    if count == 1:
        t, w = t[:, 0] / np.linalg.norm(w), w[:, 0] / np.linalg.norm(w)
        where = _position(centre + np.cross(w, t), extent)
        # With a pitch the motion slides along its axis as it turns.
        verb = "turns" if abs(t @ w) < ALIGNED * extent else "screws"
        return f"{verb} about an axis along {_direction(w)} through {where}"
    # A point p, from the centre, that all turns leave at rest: t + w x p = 0 for every column.
    cross = np.concatenate([np.cross(w[:, k], np.eye(3)).T for k in range(count)])
    p = np.linalg.lstsq(cross, -t.T.ravel(), rcond=None)[0]
    rest = np.abs(cross @ p + t.T.ravel()).max() < ALIGNED * extent
    if count == 3:
        return (
            f"turns about every axis{f' through {_position(centre + p, extent)}' if rest else ''}"
        )
    normal = _direction(np.cross(w[:, 0], w[:, 1]))
    where = f" through {_position(centre + p, extent)}" if rest else ""
    return f"turns about axes{where} normal to {normal}"


def _is_aligned(direction: Float[np.ndarray, " 3"], axis: int) -> bool:
    unit = direction / np.linalg.norm(direction)
    return float(np.abs(np.delete(unit, axis)).max()) < ALIGNED


def _direction(direction: Float[np.ndarray, " 3"]) -> str:
    unit = direction / np.linalg.norm(direction)
    axis = int(np.argmax(np.abs(unit)))
    if _is_aligned(unit, axis):
        return "xyz"[axis]
    unit = unit * np.sign(unit[axis])
    return f"({', '.join(f'{round(float(c), 3) + 0.0:g}' for c in unit)})"


def _position(point: Float[np.ndarray, " 3"], extent: float) -> str:
    # Four digits of the part's size say where; + 0.0 turns -0 into 0.
    digits = 4 - int(np.floor(np.log10(extent)))
    return f"({', '.join(f'{round(float(c), digits) + 0.0:g}' for c in point)})"
