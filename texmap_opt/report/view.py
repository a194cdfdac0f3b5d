"""Where the viewer stands: a direction from the bounding box, a distance that fills the frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.report.scenes import Action, Mark

# Half the vertical view angle [degrees]: some depth, little distortion.
HALF_ANGLE_DEG = 11.0

# Away from the isometric direction on purpose: there the struts of a regular lattice hide
# behind each other.
NEAR, ASIDE, ABOVE = 1.0, 0.62, 0.58
# So much more from above when the part is a thin plate that lies flat.
ABOVE_FLAT = 0.9


# Cosine above which a direction counts as straight down.
UPRIGHT = 0.8


@dataclass(frozen=True, eq=False)
class Eye:
    """How the viewer looks.

    Attributes:
        direction: unit vector from what is seen to the eye.
        up: unit vector that is upright in the picture.
    """

    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class View:
    """A perspective camera.

    Attributes:
        position: of the eye [mm].
        focal: a point it looks at.
        centre: where the focal point appears, in -1..1 of the window.
    """

    position: Float[np.ndarray, "3"]
    focal: Float[np.ndarray, "3"]
    centre: tuple[float, float]


@dataclass(frozen=True)
class Frame:
    """The part of the window to fill, in fractions of it from the lower left corner."""

    left: float = 0.05
    right: float = 0.95
    bottom: float = 0.05
    top: float = 0.95


def eyes(extent: Float[np.ndarray, "3"], up: int = 2) -> list[Eye]:
    """Four eyes above that see the broader side; the first is the usual one. `up` is an axis."""
    a, b, c = np.eye(3)[[(up + 1) % 3, (up + 2) % 3, up]]
    near = -NEAR * b if extent @ a >= extent @ b else NEAR * a
    aside = ASIDE / NEAR * np.cross(c, near)
    sides = (near - aside, near + aside, -near - aside, -near + aside)
    flatness = max(0.0, 1 - 2 * (extent @ c) / min(extent @ a, extent @ b))
    above = (ABOVE + ABOVE_FLAT * flatness) * c
    return [Eye(_unit(side + above), c) for side in sides]


def best_eye(extent: Float[np.ndarray, "3"], marks: Sequence[Mark], up: int | None = None) -> Eye:
    """The eye towards which most of each mark's area is turned; `up` None: see `upright_axis`."""
    candidates = eyes(extent, upright_axis(marks) if up is None else up)
    score = np.zeros(len(candidates))
    for mark in marks:
        normals, areas = mark.patch.face_normals, mark.patch.face_areas
        if not areas.sum() > 0:
            continue
        facing = [
            areas @ np.clip(normals @ eye.direction, 0, None) / areas.sum() for eye in candidates
        ]
        # A mark that is well in sight (a quarter of its area) counts once, however broad.
        score += np.minimum(facing, 0.25)
    return candidates[int(np.argmax(score.round(6)))]


def eye_along(axis: Float[np.ndarray, "3"], eye: Eye) -> Eye:
    """The eye that looks along an axis, from the side on which another eye is.

    What is upright for that is so for this; y where this looks straight down.

    Args:
        axis: of any length but zero.
        eye: the other one.
    """
    direction = _unit(axis) * (1.0 if axis @ eye.direction >= 0 else -1.0)
    up = eye.up if abs(direction @ eye.up) < UPRIGHT else np.eye(3)[1]
    return Eye(direction, _unit(up - (up @ direction) * direction))


def upright_axis(marks: Sequence[Mark]) -> int:
    """1 for a part that stands on its lower y side and is pressed down on it, else 2.

    Parts are printed and modelled with z up; scans and models for pictures often have y up.
    """
    normal, force = np.zeros(3), np.zeros(3)
    for mark in marks:
        if mark.action is Action.SUPPORT:
            normal += mark.patch.face_areas @ mark.patch.face_normals
        elif mark.action in (Action.FORCE, Action.GRAVITY):
            force += mark.direction
    down = -np.eye(3)[1]
    stands = normal @ down > UPRIGHT * np.linalg.norm(normal)
    pressed = force @ down > UPRIGHT * np.linalg.norm(force)
    return 1 if stands and pressed else 2


def fitted_view(
    points: Float[np.ndarray, "nodes 3"],
    eye: Eye,
    *,
    frame: Frame,
    aspect: float,
) -> View:
    """The nearest eye from which all points appear inside the frame.

    A point q (in the eye's axes) is in sight when |q_x - c_x| <= (D - q_z) t_x, likewise in y:
    linear in the unknowns, so that the extreme points give c and the distance D.
    """
    direction = eye.direction
    right = _unit(np.cross(eye.up, direction))
    up = np.cross(direction, right)
    q = points @ np.stack([right, up, direction], axis=1)
    t = np.tan(np.radians(HALF_ANGLE_DEG))
    slopes = np.array([t * aspect * (frame.right - frame.left), t * (frame.top - frame.bottom)])
    plus = (q[:, 2:] + q[:, :2] / slopes).max(axis=0)
    minus = (q[:, 2:] - q[:, :2] / slopes).max(axis=0)
    distance = ((plus + minus) / 2).max()
    cx, cy = slopes * (plus - minus) / 2
    axis = cx * right + cy * up
    depth = q[:, 2].mean()
    centre = (frame.left + frame.right - 1, frame.bottom + frame.top - 1)
    return View(axis + distance * direction, axis + depth * direction, centre)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
