"""Fields that are zero at the inner wall of a skin: of the whole surface, or of a part of it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.combine.tet_lattice import AbstractField
from texmap_opt.signed_distance import SignedDistance

Hint = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]] | None


@dataclass(frozen=True, eq=False)
class DepthField(AbstractField):
    """Signed distance to a closed surface plus a depth: zero at that depth below the surface.

    Attributes:
        distance: to the surface.
        depth: below it; above it where negative [mm].
    """

    distance: SignedDistance
    depth: float

    def __call__(
        self, points: Float[np.ndarray, "n 3"], hint: Hint = None
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value [mm] and its unit gradient (zero on the surface itself); see `AbstractField`."""
        distance, away = _away(self.distance, points)
        if hint is None:
            inside = self.distance.contains(points)
        else:
            # Within its distance of the surface a point sees no change of side: three times as
            # fast as asking the winding number everywhere.
            places, values = hint
            known = values - self.depth
            inside = known < 0
            far = np.linalg.norm(points - places, axis=1) >= np.abs(known)
            doubtful = np.flatnonzero(far)
            inside[doubtful] = self.distance.contains(points[doubtful])
        side = np.where(inside, -1.0, 1.0)
        return side * distance + self.depth, side[:, None] * away


@dataclass(frozen=True, eq=False)
class OpenDepthField(AbstractField):
    """Zero at a depth below that part of a closed surface which keeps its skin.

    Negative in the part where it is farther than the depth from what keeps its skin, and on into
    the open by half the depth: there the void inside comes out.

    Attributes:
        distance: to the closed surface.
        kept: distance to what keeps its skin.
        depth: thickness of the skin [mm].
    """

    distance: SignedDistance
    kept: SignedDistance
    depth: float

    @property
    def reach(self) -> float:
        """How far the void stands out of the openings [mm]."""
        # Less than the depth: beside the kept surface, outside, the field then stays positive.
        return self.depth / 2

    def __call__(
        self, points: Float[np.ndarray, "n 3"], hint: Hint = None
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value [mm] and its unit gradient; see `AbstractField`. The hint is of no use here."""
        from_kept, off_kept = _away(self.kept, points)
        skin = self.depth - from_kept
        distance, outward = _signed(self.distance, points, skin + self.reach)
        air = distance - self.reach
        inner = skin >= air
        return np.where(inner, skin, air), np.where(inner[:, None], -off_kept, outward)


@dataclass(frozen=True, eq=False)
class FarField(AbstractField):
    """Negative in a solid where it is farther than a reach from another one inside it.

    Attributes:
        distance: to the closed surface of the solid.
        inner: to that of the other one.
        reach: see above [mm].
    """

    distance: SignedDistance
    inner: SignedDistance
    reach: float

    def __call__(
        self, points: Float[np.ndarray, "n 3"], hint: Hint = None
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value [mm] and its unit gradient; see `AbstractField`. The hint is of no use here."""
        near, toward = _away(self.inner, points)
        # Sides are asked for only where they matter: the winding number is what takes time.
        deep = np.flatnonzero(near > self.reach)
        near[deep[self.inner.contains(points[deep])]] *= -1
        near = self.reach - near
        out, outward = _signed(self.distance, points, near)
        nearer = near >= out
        return np.where(nearer, near, out), np.where(nearer[:, None], -toward, outward)


def _signed(
    distance: SignedDistance, points: np.ndarray, least: np.ndarray
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Distance to a closed surface [mm], negative inside, and its gradient.

    The sign may be wrong where the distance is below `least`.
    """
    length, away = _away(distance, points)
    side = np.ones(len(points))
    asked = np.flatnonzero(length > least)
    side[asked[distance.contains(points[asked])]] = -1.0
    return side * length, side[:, None] * away


def _away(
    distance: SignedDistance, points: np.ndarray
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Distance [mm] and the direction away from the nearest point; zero on the surface itself."""
    length, _, closest = distance.unsigned(points)
    column = length[:, None]
    away = np.divide(points - closest, column, out=np.zeros(points.shape), where=column != 0)
    return length, away
