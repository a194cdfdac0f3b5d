"""The surface a given depth below another one: the inner wall of a skin.

The level {signed distance = -depth} is found on tetrahedra that are bisected only where the
surface inside them is still farther than the tolerance from the level (`tet_lattice`,
`marching_tets`): a flat wall stays coarse, a crease is met by its own points, a curve is divided.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.combine import boolean
from texmap_opt.combine.marching_tets import zero_level
from texmap_opt.combine.tet_lattice import (
    EDGES,
    AbstractField,
    TetLattice,
    bisected,
    coarse_lattice,
)
from texmap_opt.errors import SolidError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Shares of the tolerance: for the level itself, and for leaving out triangles afterwards. The rest
# is room for what is between the sampled points.
LEVEL_SHARE = 0.5
SIMPLIFY_SHARE = 0.3
# Distance from the level, over the tolerance, at which no crease is looked for.
GOOD_SHARE = 0.1
# Coarse cubes over the longest side of the part, at most: 2 to this power.
COARSE_LEVELS = 7
# Tetrahedra at most, about 0.6 kB each while they are divided.
MAX_TETS = 3_000_000
# Points at which the error of the result, and the solid share of the part, are sampled.
SAMPLES = 20_000
# A point of the part this many depths away from the inner wall belongs to a region that is solid
# because it is thinner than two depths; nearer ones may just be in a corner.
SOLID_DEPTHS = 2.0
# Relative precision of the largest inscribed radius in messages.
RADIUS_PRECISION = 0.05


@dataclass(frozen=True, eq=False)
class Offset:
    """An inner parallel surface.

    Attributes:
        surface: the surface; None where the part is nowhere deep enough to have one.
        depth_mm: wanted depth [mm].
        error_mm: largest difference from the wanted depth found at sampled points [mm].
        solid_share: share of the part's volume that stays solid because it is thinner than two
            depths (sampled; corners do not count).
        inscribed_radius_mm: radius of the largest ball inside the part [mm]; only where there is
            no surface.
    """

    surface: TriMesh | None
    depth_mm: float
    error_mm: float
    solid_share: float
    inscribed_radius_mm: float | None = None


def offset_inward(surface: TriMesh, distance: float, tolerance: float) -> Offset:
    """The surface `distance` below a closed one, within `tolerance`.

    Args:
        surface: closed, outward oriented [mm].
        distance: depth [mm], above 0.
        tolerance: largest difference of the depth anywhere on the result [mm], above 0.

    Raises:
        SolidError: when the tolerance needs more memory than allowed, or the result misses it.
    """
    if not (distance > 0 and tolerance > 0):
        raise SolidError(
            f"An offset of {distance:g} mm within {tolerance:g} mm cannot be made: skin_mm and "
            "tolerance_mm must be above 0."
        )
    field = _DepthField(SignedDistance(surface), distance)
    # Coarse cubes: no larger than the depth where that is affordable.
    extent = float(np.ptp(surface.bounds, axis=0).max())
    cube = max(min(2 * distance, extent / 8), extent / 2**COARSE_LEVELS)
    mesh, lowest = coarse_lattice(field, surface.bounds, cube)
    mesh = _divided(mesh, tolerance)
    level = zero_level(mesh, GOOD_SHARE * tolerance).surface
    if not len(level.faces):
        radius = _inscribed_radius(field, surface.bounds, lowest)
        return Offset(None, distance, 0.0, 1.0, radius)
    result, error = _simplified(field, level, tolerance)
    return Offset(result, distance, error, _solid_share(field, surface, result))


@dataclass(frozen=True, eq=False)
class _DepthField(AbstractField):
    """Signed distance to a surface plus a depth: zero at that depth below the surface."""

    distance: SignedDistance
    depth: float

    def __call__(
        self,
        points: Float[np.ndarray, "n 3"],
        hint: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]] | None = None,
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value [mm] and its unit gradient (zero on the surface itself); see `AbstractField`."""
        distance, _, closest = self.distance.unsigned(points)
        away = np.divide(
            points - closest,
            distance[:, None],
            out=np.zeros_like(points),
            where=distance[:, None] != 0,
        )
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


def _divided(mesh: TetLattice, tolerance: float) -> TetLattice:
    """The lattice, bisected until its level is within the tolerance."""
    while True:
        flagged = np.zeros(len(mesh.tets), dtype=bool)
        fresh = np.flatnonzero(~mesh.settled)
        if not len(fresh):
            return mesh
        young = mesh.only(fresh)
        flagged[fresh] = _inaccurate(young, tolerance) | _hiding(young, tolerance)
        mesh.settled[fresh] = True
        if len(mesh.tets) + int(flagged.sum()) > MAX_TETS:
            raise SolidError(
                f"The skin cannot be found within tolerance_mm = {tolerance:g}: it needs more than "
                f"{MAX_TETS:,} tetrahedra. Raise [output] tolerance_mm."
            )
        mesh = bisected(mesh, flagged)


def _inaccurate(mesh: TetLattice, tolerance: float) -> np.ndarray:
    """Tetrahedra in which the found level is not the true one."""
    level = zero_level(mesh, GOOD_SHARE * tolerance)
    flagged = np.zeros(len(mesh.tets), dtype=bool)
    corners = level.surface.vertices[level.surface.faces]
    # Middles of edges catch a crease between two faces, centroids one inside.
    middles = [(corners[:, k] + corners[:, k - 1]) / 2 for k in range(3)]
    for points in (corners.mean(axis=1), *middles):
        error = np.abs(mesh.sampled(points, level.tet_of_face)[0])
        flagged[level.tet_of_face[error > LEVEL_SHARE * tolerance]] = True
    return flagged


def _hiding(mesh: TetLattice, tolerance: float) -> np.ndarray:
    """Tetrahedra with an edge along which the field may cross zero and return.

    Both ends lie on one side; from each the field runs towards zero at its own slope, and the two
    lines meet beyond zero by more than the tolerance: a thin wall or a thin gap may lie between.
    """
    hiding = np.zeros(len(mesh.tets), dtype=bool)
    points = mesh.points
    for a, b in EDGES:
        i, j = mesh.tets[:, a], mesh.tets[:, b]
        along = points[j] - points[i]
        side = np.sign(mesh.values[i])
        f_i, f_j = side * mesh.values[i], side * mesh.values[j]
        slope_i = side * np.einsum("ij,ij->i", mesh.gradients[i], along)
        slope_j = -side * np.einsum("ij,ij->i", mesh.gradients[j], along)
        total = slope_i + slope_j
        meet = np.divide(f_j + slope_j - f_i, total, out=np.full_like(total, 2.0), where=total != 0)
        deepest = f_i + slope_i * meet
        facing = (f_j > 0) & (slope_i < 0) & (slope_j < 0) & (meet > 0) & (meet < 1)
        hiding |= facing & (deepest < -tolerance)
    return hiding


def _simplified(field: _DepthField, level: TriMesh, tolerance: float) -> tuple[TriMesh, float]:
    """The level with fewer triangles while it stays within the tolerance, and its error [mm]."""
    error = np.inf
    for share in (SIMPLIFY_SHARE, SIMPLIFY_SHARE / 4, SIMPLIFY_SHARE / 64):
        result = boolean.simplified(level, share * tolerance)
        if len(result.faces):
            error = _error(field, result)
            if error <= tolerance:
                return result, error
    raise SolidError(
        f"The skin's inner wall is off by {error:.3g} mm, more than tolerance_mm = {tolerance:g}. "
        "Raise [output] tolerance_mm, or change skin_mm."
    )


def _error(field: _DepthField, surface: TriMesh) -> float:
    """Largest distance from the wanted depth at vertices, centroids, edges and sampled points."""
    corners = surface.vertices[surface.faces]
    edges = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    # Large triangles get more points: areas decide, with a fixed generator.
    generator = np.random.default_rng(0)
    share = surface.face_areas / surface.face_areas.sum()
    chosen = generator.choice(len(corners), SAMPLES, p=share)
    weights = generator.dirichlet(np.ones(3), SAMPLES)
    spread = np.einsum("nk,nkx->nx", weights, corners[chosen])
    points = np.concatenate([surface.vertices, corners.mean(axis=1), edges, spread])
    distance, _, _ = field.distance.unsigned(points)
    if not field.distance.contains(spread).all():
        return field.depth
    return float(np.abs(distance - field.depth).max())


def _solid_share(field: _DepthField, surface: TriMesh, inner: TriMesh) -> float:
    generator = np.random.default_rng(0)
    low, high = surface.bounds
    points = generator.uniform(low, high, (SAMPLES, 3))
    values, _ = field(points)
    inside = values < field.depth
    skin = inside & (values > 0)
    if not skin.any():
        return 0.0
    far, _, _ = SignedDistance(inner).unsigned(points[skin])
    return float((far > SOLID_DEPTHS * field.depth).sum() / inside.sum())


def _inscribed_radius(field: _DepthField, bounds: np.ndarray, lowest: float) -> float:
    """Radius of the largest ball inside [mm], by branch and bound on cubes."""
    size = float(np.ptp(bounds, axis=0).max())
    centres = bounds.mean(axis=0)[None]
    best = field.depth - lowest
    octants = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, 8).T / 4
    while size > RADIUS_PRECISION * best and len(centres) < MAX_TETS:
        centres = (centres[:, None] + size * octants).reshape(-1, 3)
        size /= 2
        inscribed = field.depth - field(centres)[0]
        best = max(best, float(inscribed.max()))
        # A ball centred in a cube is at most half the cube's diagonal larger than at its middle.
        centres = centres[inscribed + np.sqrt(3) / 2 * size > best * (1 + RADIUS_PRECISION)]
        if not len(centres):
            break
    return best
