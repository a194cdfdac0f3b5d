"""The box that is warped: where it lies, how it is turned, and the coordinates along its edges."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import WarpError

# How far from orthonormal given axes may be, rounding of what people type.
ORTHONORMAL = 1e-6


@dataclass(frozen=True, eq=False)
class Box:
    """A cuboid in space, or, for cells that are extruded, the rectangle it has as cross-section.

    Warps compute in the box's coordinates: a point's components along the box's axes [mm], from the
    origin of space. So for a box along x, y, z coordinates are positions.

    Attributes:
        axes: unit vectors along the edges, as rows, right-handed. In two dimensions the first two
            span the cross-section and the third is the direction of extrusion.
        bounds: lowest and highest coordinate along each axis [mm], in two dimensions of the
            extrusion too.
        dimensions: 3, or 2 for cells that are extruded.
    """

    axes: Float[np.ndarray, "3 3"]
    bounds: Float[np.ndarray, "2 3"]
    dimensions: int = 3

    def __post_init__(self) -> None:
        if self.dimensions not in (2, 3):
            raise WarpError(f"A warp has 2 or 3 dimensions, not {self.dimensions}.")
        if not np.allclose(self.axes @ self.axes.T, np.eye(3), atol=ORTHONORMAL):
            raise WarpError(
                f"The axes of the warp's box are {self.axes.tolist()}; they must be three unit "
                "vectors at right angles."
            )
        if np.linalg.det(self.axes) < 0:
            raise WarpError(
                f"The axes of the warp's box are {self.axes.tolist()}, a left-handed system; swap "
                "two of them or turn one round."
            )
        # What people type has six digits; positions and coordinates invert each other to all.
        left, _, right = np.linalg.svd(self.axes)
        object.__setattr__(self, "axes", left @ right)

    @classmethod
    def aligned(cls, bounds: Float[np.ndarray, "2 3"], *, extrusion: str | None = None) -> "Box":
        """A box along x, y, z.

        Args:
            bounds: lowest and highest corner [mm].
            extrusion: "x", "y" or "z" for a warp of the cross-section normal to it; None: 3-D.
        """
        return cls.around(bounds, np.eye(3), extrusion=extrusion)

    @classmethod
    def around(
        cls,
        points: Float[np.ndarray, "samples 3"],
        axes: Float[np.ndarray, "3 3"],
        *,
        extrusion: str | None = None,
    ) -> "Box":
        """The smallest box with the given axes that holds the points.

        Args:
            points: what the box holds [mm].
            axes: unit vectors as rows, right-handed.
            extrusion: "x", "y" or "z": the first, second or third of the axes is the direction of
                extrusion, and the warp has two dimensions; None: 3-D.
        """
        # An even permutation puts the extrusion last and keeps the system right-handed.
        turn = 0 if extrusion is None else ("xyz".index(extrusion) + 1) % 3
        axes = np.roll(axes, -turn, axis=0)
        along = points @ axes.T
        bounds = np.stack([along.min(axis=0), along.max(axis=0)])
        return cls(axes, bounds, 3 if extrusion is None else 2)

    @property
    def low(self) -> Float[np.ndarray, " d"]:
        """Lowest coordinates [mm]."""
        return self.bounds[0, : self.dimensions]

    @property
    def high(self) -> Float[np.ndarray, " d"]:
        """Highest coordinates [mm]."""
        return self.bounds[1, : self.dimensions]

    @property
    def extent(self) -> Float[np.ndarray, " d"]:
        """Lengths of the edges [mm]."""
        return self.high - self.low

    def coordinates(self, points: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, "samples d"]:
        """Coordinates of points in space [mm]; in two dimensions those in the cross-section."""
        return points @ self.axes[: self.dimensions].T

    def positions(self, coordinates: Float[np.ndarray, "*_ d"]) -> Float[np.ndarray, "*_ 3"]:
        """Points in space [mm] of coordinates; in two dimensions half way along the extrusion."""
        placed = coordinates @ self.axes[: self.dimensions]
        if self.dimensions == 2:
            placed = placed + self.bounds[:, 2].mean() * self.axes[2]
        return placed

    def grown(self, margin: Float[np.ndarray, " d"]) -> "Box":
        """The box with `margin` [mm] more on both sides along each axis; less where negative."""
        by = np.zeros(3)
        by[: self.dimensions] = margin
        return Box(self.axes, self.bounds + np.stack([-by, by]), self.dimensions)


def principal_axes(
    points: Float[np.ndarray, "samples 3"], weights: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, "3 3"]:
    """Principal axes of inertia of a cloud of weighted points, the longest extent first.

    Each axis points the way its largest component is positive, the last one so that the system is
    right-handed. Where two principal moments are equal their axes are arbitrary.

    Raises:
        WarpError: if the weights do not add up to a positive number.
    """
    total = weights.sum()
    if not total > 0:
        raise WarpError("Points without weight have no principal axes.")
    offset = points - weights @ points / total
    _, columns = np.linalg.eigh((offset * weights[:, None]).T @ offset / total)
    axes = columns.T[::-1].copy()
    for k in range(2):
        axes[k] *= np.sign(axes[k, np.argmax(np.abs(axes[k]))])
    axes[2] = np.cross(axes[0], axes[1])
    return axes
