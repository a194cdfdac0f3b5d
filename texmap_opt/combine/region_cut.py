"""A surface cut in two along the border of a region."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.region import AbstractRegion, Intersection, Stl
from texmap_opt.solid.tri_mesh import TriMesh

# Triangles are bisected until they are this many tolerances across before one straight cut
# through them is looked at, so that no more of a region hides between the sampled points.
CUT_SIZE = 20.0
# Size at which a triangle counts as outside, and at which its middle decides, in tolerances.
OUTSIDE_SIZE = 4.0
LAST_SIZE = 0.5
# Steps of the bisection for the place where an edge crosses the border: 2^-24 of the edge.
BISECTIONS = 24
# Points of a triangle, by barycentric coordinates in quarters: corners first.
_GRID = np.array(
    [[4, 0, 0], [0, 4, 0], [0, 0, 4]]
    + [[i, j, 4 - i - j] for i in range(5) for j in range(5 - i) if max(i, j, 4 - i - j) < 4]
)
SAMPLED = _GRID / 4
# Places along a straight cut that must lie on the border.
ALONG = np.linspace(0, 1, 5)

Triangles = Float[np.ndarray, "_ 3 3"]


@dataclass(frozen=True, eq=False)
class _Facets:
    """Loose triangles with the unit normals of the facets they are cut from."""

    corners: Float[np.ndarray, "n 3 3"]
    normals: Float[np.ndarray, "n 3"]

    def only(self, chosen: Bool[np.ndarray, " n"]) -> "_Facets":
        return _Facets(self.corners[chosen], self.normals[chosen])

    @property
    def sizes(self) -> Float[np.ndarray, " n"]:
        """Largest distance of a corner from the centroid [mm]."""
        middle = self.corners.mean(axis=1, keepdims=True)
        return np.linalg.norm(self.corners - middle, axis=2).max(axis=1)

    def inside(
        self, region: AbstractRegion, shares: Float[np.ndarray, "k 3"], *, slack: float = 0.0
    ) -> Bool[np.ndarray, "n k"]:
        """Whether the region holds points of each triangle, given by barycentric coordinates."""
        points = np.einsum("kc,ncx->nkx", shares, self.corners)
        normals = np.repeat(self.normals, len(shares), axis=0)
        held = region.contains(points.reshape(-1, 3), normals, slack=slack)
        return held.reshape(-1, len(shares))


def cut_by_region(
    surface: TriMesh, region: AbstractRegion, tolerance: float
) -> tuple[TriMesh, TriMesh]:
    """The pieces of a surface inside and outside a region, as loose triangles.

    Args:
        surface: any triangles [mm].
        region: told by position and outward normal.
        tolerance: the cut is within this of the region's border [mm].
    """
    facets = _Facets(surface.vertices[surface.faces], surface.face_normals)
    facets = facets.only(surface.face_areas > 0)
    held: list[Triangles] = []
    left: list[Triangles] = []
    while len(facets.corners):
        samples = facets.inside(region, SAMPLED)
        sizes = facets.sizes
        inside = samples.all(axis=1) & (_convex(region) | (sizes <= CUT_SIZE * tolerance))
        outside = ~samples.any(axis=1) & (
            _beyond(facets, region, sizes) | (sizes <= OUTSIDE_SIZE * tolerance)
        )
        small = ~inside & ~outside & (sizes <= LAST_SIZE * tolerance)
        inside |= small & facets.inside(region, np.full((1, 3), 1 / 3))[:, 0]
        outside |= small & ~inside
        held.append(facets.corners[inside])
        left.append(facets.corners[outside])
        facets = facets.only(~inside & ~outside)
        straight = _straight_cuts(facets, region, tolerance)
        inner, outer = _cut(facets.only(straight), region)
        held.append(inner)
        left.append(outer)
        facets = _halved(facets.only(~straight))
    return _soup(held), _soup(left)


def _convex(region: AbstractRegion) -> bool:
    """Whether a triangle lies inside when its corners do."""
    if isinstance(region, Intersection):
        return all(_convex(each) for each in region.regions)
    return not isinstance(region, Stl)


def _beyond(facets: _Facets, region: AbstractRegion, sizes: np.ndarray) -> np.ndarray:
    """Triangles that the region cannot reach: their middles are too far from it."""
    beyond = np.zeros(len(sizes), dtype=bool)
    # One slack for all triangles of about one size.
    octave = np.ceil(np.log2(np.maximum(sizes, 1e-300)))
    for exponent in np.unique(octave):
        chosen = octave == exponent
        middle = facets.only(chosen).inside(
            region, np.full((1, 3), 1 / 3), slack=float(2**exponent)
        )
        beyond[chosen] = ~middle[:, 0]
    return beyond


def _straight_cuts(facets: _Facets, region: AbstractRegion, tolerance: float) -> np.ndarray:
    """Triangles that one straight cut divides well enough."""
    count = len(facets.corners)
    corners = facets.inside(region, SAMPLED[:3])
    mixed = corners.any(axis=1) & ~corners.all(axis=1) & (facets.sizes <= CUT_SIZE * tolerance)
    good = np.zeros(count, dtype=bool)
    chosen = facets.only(mixed)
    if not len(chosen.corners):
        return good
    lone, first, second = _crossings(chosen, region)
    # Along the cut the border is near.
    points = first[:, None] + ALONG[:, None] * (second - first)[:, None]
    cut = _Facets(np.repeat(points.reshape(-1, 1, 3), 3, axis=1), chosen.normals.repeat(5, axis=0))
    at = np.eye(3)[:1]
    near = cut.inside(region, at, slack=tolerance) & ~cut.inside(region, at, slack=-tolerance)
    # Away from it the samples agree.
    samples = np.einsum("kc,ncx->nkx", SAMPLED, chosen.corners)
    apex = chosen.corners[np.arange(len(lone)), lone]
    across = np.cross(second - first, chosen.normals)
    side = np.einsum("nkx,nx->nk", samples - first[:, None], across)
    same = side * np.einsum("nx,nx->n", apex - first, across)[:, None] > 0
    apex_inside = corners[mixed][np.arange(len(lone)), lone]
    agree = chosen.inside(region, SAMPLED) == (same == apex_inside[:, None])
    unsure = chosen.inside(region, SAMPLED, slack=tolerance) & ~chosen.inside(
        region, SAMPLED, slack=-tolerance
    )
    good[mixed] = near.reshape(-1, 5).all(axis=1) & (agree | unsure).all(axis=1)
    return good


def _crossings(
    facets: _Facets, region: AbstractRegion
) -> tuple[np.ndarray, Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """The corner that is alone on its side, and where the border crosses its two edges."""
    corners = facets.inside(region, SAMPLED[:3])
    row = np.arange(len(corners))
    # With one corner inside it is that one, with two the one outside.
    lone = np.where(corners.sum(axis=1) == 1, corners.argmax(axis=1), corners.argmin(axis=1))
    apex, side = facets.corners[row, lone], corners[row, lone]
    ends = []
    for k in (1, 2):
        base = facets.corners[row, (lone + k) % 3]
        near, far = np.zeros(len(row)), np.ones(len(row))
        for _ in range(BISECTIONS):
            middle = (near + far) / 2
            points = apex + middle[:, None] * (base - apex)
            same = region.contains(points, facets.normals, slack=0.0) == side
            near, far = np.where(same, middle, near), np.where(same, far, middle)
        ends.append(apex + near[:, None] * (base - apex))
    return lone, ends[0], ends[1]


def _cut(facets: _Facets, region: AbstractRegion) -> tuple[Triangles, Triangles]:
    """Triangles divided by one straight cut: the pieces inside and outside."""
    if not len(facets.corners):
        return facets.corners, facets.corners
    lone, first, second = _crossings(facets, region)
    row = np.arange(len(lone))
    apex, b, c = (facets.corners[row, (lone + k) % 3] for k in range(3))
    tip = np.stack([apex, first, second], axis=1)
    rest = np.concatenate([np.stack([first, b, c], axis=1), np.stack([first, c, second], axis=1)])
    apex_inside = facets.inside(region, SAMPLED[:3])[row, lone]
    twice = np.tile(apex_inside, 2)
    return (
        np.concatenate([tip[apex_inside], rest[~twice]]),
        np.concatenate([tip[~apex_inside], rest[twice]]),
    )


def _halved(facets: _Facets) -> _Facets:
    """Every triangle in two, across its longest edge."""
    corners = facets.corners
    row = np.arange(len(corners))
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    start = lengths.argmax(axis=1) if len(corners) else row
    a, b, c = (corners[row, (start + k) % 3] for k in range(3))
    middle = (a + b) / 2
    halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
    return _Facets(np.concatenate(halves), np.tile(facets.normals, (2, 1)))


def _soup(pieces: list[Triangles]) -> TriMesh:
    corners = np.concatenate(pieces).reshape(-1, 3)
    return TriMesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))
