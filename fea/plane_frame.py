"""Frames of walls: the cross-section of an extruded (2.5-D) lattice, held in its plane.

The frame is that of `fea.frame`, in axes of its own: two in the plane, the third along the axis of
extrusion. At every joint two displacements and one rotation are left; the others are held at zero.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from fea.errors import FeaError, position_text
from fea.frame import FrameProblem
from fea.plane_checks import OUT_OF_PLANE, check_flat, check_plane_loads, out_of_plane_support

# Degrees of freedom of a joint out of the plane: uz, rx, ry.
OUT = np.array([2, 3, 4])

# Components of the axis of extrusion below this are rounding.
ALIGNED = 1e-9

# What a direction has in the plane below this is none; two such components stay within OUT_OF_PLANE.
TILT = OUT_OF_PLANE / 4


@dataclass(frozen=True, eq=False)
class PlaneFrame:
    """A frame held in its plane.

    Attributes:
        problem: the frame in axes of the plane; the third is the axis of extrusion.
        axes: these axes in space, one a row, right-handed.
    """

    problem: FrameProblem
    axes: Float[np.ndarray, "3 3"]

    def to_space(self, vectors: Float[np.ndarray, "*rows _"]) -> Float[np.ndarray, "*rows _"]:
        """Vectors of the problem, three or six components a row, in the axes of space."""
        return _turned(vectors, self.axes.T)

    def to_plane(self, vectors: Float[np.ndarray, "*rows _"]) -> Float[np.ndarray, "*rows _"]:
        """Vectors in space, three or six components a row, in the axes of the problem."""
        return _turned(vectors, self.axes)


def in_plane(frame: FrameProblem, normal: Float[np.ndarray, " 3"]) -> PlaneFrame:
    """Hold a frame in its plane.

    Supports hold what they hold of the motions in the plane: a fixed x the displacement along what x
    leaves in the plane.

    Args:
        frame: in space: positions, supports and loads. Its section is usually a `fea.Wall`.
        normal: the axis of extrusion, of any length but zero.

    Raises:
        FeaError: when joints are not in one plane, loads or prescribed values lead out of it, supports
            hold joints in directions that are not all along two axes, or there is a skin.
    """
    length = float(np.linalg.norm(normal))
    if not 0 < length < np.inf:
        raise FeaError(
            f"The axis of extrusion is {position_text(normal)}; give a vector that is not zero."
        )
    if frame.skin is not None:
        raise FeaError(
            "A frame in the plane has a skin, which bends out of it; leave the skin out, or analyse the "
            "part as a solid."
        )
    n = np.where(np.abs(normal) < ALIGNED * length, 0.0, normal)
    n = n / np.linalg.norm(n)
    check_flat(frame.joints, n)
    check_plane_loads(frame.joints, frame.forces, frame.strut_loads, n)
    axes = _axes(frame, n)
    held = _supports(frame, axes)
    joints = _turned(frame.joints, axes)
    joints[:, 2] = np.median(joints[:, 2])
    forces = _turned(frame.forces, axes)
    forces[..., OUT] = 0.0
    strut_loads = frame.strut_loads
    if strut_loads is not None:
        strut_loads = _turned(strut_loads, axes)
        strut_loads[..., 2] = 0.0
    problem = replace(
        frame,
        joints=joints,
        fixed=held.fixed,
        value=held.value,
        forces=forces,
        strut_loads=strut_loads,
    )
    return PlaneFrame(problem, axes)


def _clean(directions: Float[np.ndarray, "_ _"]) -> Float[np.ndarray, "_ _"]:
    """Without components that a slightly tilted axis of extrusion leaves: z is then not held along x."""
    return np.where(np.abs(directions) < TILT, 0.0, directions)


class _Held(NamedTuple):
    """Prescribed degrees of freedom and their values."""

    fixed: Bool[np.ndarray, "joints 6"]
    value: Float[np.ndarray, "joints 6"]


def _turned(
    vectors: Float[np.ndarray, "*rows _"], axes: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*rows _"]:
    triples = vectors.reshape(*vectors.shape[:-1], -1, 3)
    return (triples @ axes.T).reshape(vectors.shape)


def _axes(frame: FrameProblem, n: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Axes of the plane, and n: along the coordinate axes, or what is held alone, as far as may be."""
    start = np.eye(3)[np.argmin(np.abs(n))]
    first = start - (start @ n) * n
    for pattern in np.unique(frame.fixed[:, :3], axis=0):
        directions = _clean(np.eye(3)[pattern] - np.outer(n[pattern], n))
        if np.linalg.matrix_rank(directions, OUT_OF_PLANE) == 1:
            longest = np.argmax(np.linalg.norm(directions, axis=1))
            first = directions[longest]
            break
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(n, first), n])


def _supports(frame: FrameProblem, axes: Float[np.ndarray, "3 3"]) -> _Held:
    """Supports in axes of the plane, and all joints held in it but those that follow others."""
    fixed = np.zeros(frame.fixed.shape, bool)
    value = np.zeros(frame.value.shape)
    # Rotations have one direction in the plane, displacements two.
    for dofs, kept, into in (
        (slice(0, 3), np.array([0, 1]), axes[:2]),
        (slice(3, 6), np.array([5]), axes[2:]),
    ):
        for pattern in np.unique(frame.fixed[:, dofs], axis=0):
            if not pattern.any():
                continue
            joints = np.flatnonzero((frame.fixed[:, dofs] == pattern).all(axis=1))
            # What is prescribed, by the motion in the plane.
            M, given = _clean(into.T[pattern]), frame.value[joints, dofs][:, pattern]
            motion = given @ np.linalg.pinv(M, OUT_OF_PLANE).T
            off = np.abs(motion @ M.T - given).max(axis=1)
            wrong = np.flatnonzero(off > OUT_OF_PLANE * np.abs(given).max())
            if wrong.size:
                raise out_of_plane_support(frame.joints, int(joints[wrong[0]]), axes[2])
            held = _held_axes(M, frame, int(joints[0]), axes)
            at = np.ix_(joints, kept)
            fixed[at], value[at] = held, motion * held
    own = np.ones(len(fixed), bool)
    for coupling in frame.couplings:
        own[coupling.followers] = False
    fixed[np.ix_(np.flatnonzero(own), OUT)] = True
    return _Held(fixed, value)


def _held_axes(
    M: Float[np.ndarray, "_ _"], frame: FrameProblem, joint: int, axes: Float[np.ndarray, "3 3"]
) -> Bool[np.ndarray, " _"]:
    """Which axes of the plane the rows of M hold."""
    rank = int(np.linalg.matrix_rank(M, OUT_OF_PLANE))
    reaches = (M != 0).any(axis=0)
    if reaches.sum() > rank:
        raise FeaError(
            f"The support of joint {joint} at {position_text(frame.joints[joint])} mm holds it in the "
            f"plane normal to {position_text(axes[2])} along a direction oblique to that of another "
            "support; hold both directions there."
        )
    return reaches
