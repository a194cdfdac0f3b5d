"""A skin: flat triangular shells on the joints of a frame, and what makes one impossible."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.errors import FeaError, position_text
from fea.shell import Triangle

ArrayLike = Array | np.ndarray

# Height over longest edge below which a triangle has no area: half the digits of float64, and far
# below any triangle of a mesher. The stiffness grows as the inverse of this ratio.
LEAST_HEIGHT = 1e-8


@dataclass(frozen=True, eq=False)
class Skin:
    """Flat triangular shells, six dofs a node.

    The normal follows from the order of a triangle's nodes by the right-hand rule; it is the side that
    pressure pushes against and that "top" means in `fea.shell_stress`.

    Attributes:
        triangles: nodes of each; they are joints of the frame, or nodes that only the skin uses.
        thickness: of each triangle [mm].
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
    """

    triangles: Int[np.ndarray, "faces 3"]
    thickness: Float[np.ndarray, " faces"]
    E: float
    nu: float

    def triangle_values(
        self,
        points: Float[ArrayLike, "joints 3"],
        thickness: Float[ArrayLike, " faces"] | None = None,
    ) -> Triangle:
        """Corners and thickness of every triangle; JAX sees how they follow from both arguments.

        Args:
            points: positions of the joints [mm].
            thickness: to use instead of the skin's own [mm].
        """
        own = self.thickness if thickness is None else thickness
        return Triangle(jnp.asarray(points)[self.triangles], jnp.asarray(own))

    def check(self, points: Float[np.ndarray, "joints 3"]) -> None:
        """Refuse what has no stiffness, or none that means anything.

        Args:
            points: positions of the joints [mm].

        Raises:
            FeaError: for triangles on joints that do not exist, twice on the same joint or on the same
                three joints as another, for positions or thicknesses that are not numbers, for a
                thickness or an area that is not positive, and constants that no material has.
        """
        self._check_nodes(points)
        self._check_thickness(points)
        self._check_shape(points)
        if not (0 < self.E < np.inf and -1 < self.nu <= 0.5):
            raise FeaError(
                f"The skin has E = {self.E:g}, nu = {self.nu:g}: need E > 0 and -1 < nu <= 0.5."
            )

    def _check_nodes(self, points: Float[np.ndarray, "joints 3"]) -> None:
        corners = self.triangles
        if len(corners) == 0:
            raise FeaError("The skin has no triangles; give at least one, or leave the skin out.")
        wrong = np.argwhere((corners < 0) | (corners >= len(points)))
        if len(wrong):
            face, corner = wrong[0]
            raise FeaError(
                f"Triangle {face} of the skin refers to joint {corners[face, corner]}, but there are "
                f"joints 0 to {len(points) - 1}; number its corners among them."
            )
        lost = np.argwhere(~np.isfinite(points[corners]).all(axis=2))
        if len(lost):
            face, corner = lost[0]
            raise FeaError(
                f"The position of joint {corners[face, corner]}, a corner of triangle {face} of the "
                f"skin, is not a number ({position_text(points[corners[face, corner]])}); check the "
                "mesh it comes from."
            )
        ordered = np.sort(corners, axis=1)
        twice = np.flatnonzero((np.diff(ordered, axis=1) == 0).any(axis=1))
        if len(twice):
            face = int(twice[0])
            raise FeaError(
                f"Triangle {face} of the skin at {self._place(points, face)} has the same joint at two "
                f"corners ({', '.join(map(str, corners[face]))}); remove it."
            )
        first, of = np.unique(ordered, axis=0, return_index=True, return_inverse=True)[1:]
        repeated = np.flatnonzero(first[of.ravel()] != np.arange(len(corners)))
        if len(repeated):
            face = int(repeated[0])
            raise FeaError(
                f"Triangles {first[of.ravel()[face]]} and {face} of the skin at "
                f"{self._place(points, face)} have the same three joints, so the skin would count "
                "twice there; remove one and give the other the sum of their thicknesses."
            )

    def _check_thickness(self, points: Float[np.ndarray, "joints 3"]) -> None:
        if self.thickness.shape != (len(self.triangles),):
            raise FeaError(
                f"Thicknesses of the skin have shape {self.thickness.shape}; give "
                f"{(len(self.triangles),)}, one for each triangle."
            )
        # Written so that NaN counts.
        thin = np.flatnonzero(~((self.thickness > 0) & np.isfinite(self.thickness)))
        if len(thin):
            face = int(thin[0])
            raise FeaError(
                f"Triangle {face} of the skin at {self._place(points, face)} has thickness "
                f"{self.thickness[face]:g} mm; thicknesses must be positive numbers: set it, or "
                "remove the triangle."
            )

    def _check_shape(self, points: Float[np.ndarray, "joints 3"]) -> None:
        x = points[self.triangles]
        edges = x[:, [1, 2, 0]] - x
        longest = (edges**2).sum(axis=2).max(axis=1)
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        flat = np.flatnonzero(~(area > LEAST_HEIGHT * longest))
        if len(flat):
            face = int(flat[0])
            raise FeaError(
                f"Triangle {face} of the skin at {self._place(points, face)} has no area: its height "
                f"is less than {LEAST_HEIGHT:g} of its longest edge, {np.sqrt(longest[face]):.6g} mm; "
                "collapse its shortest edge, or swap the longest."
            )

    def _place(self, points: Float[np.ndarray, "joints 3"], face: int) -> str:
        return f"{position_text(points[self.triangles[face]].mean(axis=0))} mm"
