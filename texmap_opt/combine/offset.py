"""The surface a given depth below another one: the inner wall of a skin.

The level {signed distance = -depth} is found on tetrahedra that are bisected only where the
surface inside them is still farther than the tolerance from the level (`tet_lattice`,
`marching_tets`): a flat wall stays coarse, a crease is met by its own points, a curve is divided.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.combine import boolean
from texmap_opt.combine.depth_field import DepthField, OpenDepthField
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
# Tetrahedra at most, and the memory one takes while they are divided [bytes].
MAX_TETS = 3_000_000
TET_BYTES = 800
# Points at which the error of the result is sampled.
SAMPLES = 20_000
# Relative precision of the largest inscribed radius in messages.
RADIUS_PRECISION = 0.03


@dataclass(frozen=True, eq=False)
class Offset:
    """An inner parallel surface.

    Attributes:
        surface: the surface; None where the part is nowhere deep enough to have one.
        depth_mm: wanted depth [mm].
        error_mm: largest difference from the wanted depth found at sampled points [mm].
        inscribed_radius_mm: radius of the largest ball inside the part [mm]; only where there is
            no surface.
    """

    surface: TriMesh | None
    depth_mm: float
    error_mm: float
    inscribed_radius_mm: float | None = None


def offset_inward(
    surface: TriMesh, distance: float, tolerance: float, *, kept: TriMesh | None = None
) -> Offset:
    """The surface `distance` below a closed one, within `tolerance`.

    Args:
        surface: closed, outward oriented [mm].
        distance: depth [mm], above 0.
        tolerance: largest difference of the depth anywhere on the result [mm], above 0.
        kept: what of the surface the depth is measured from; the result then comes out of the
            rest, by half the depth. None: all of it.

    Raises:
        SolidError: when the tolerance is larger than the part or needs more memory than allowed, or
            the result misses it.
    """
    if not (distance > 0 and tolerance > 0):
        raise SolidError(
            f"An offset of {distance:g} mm within {tolerance:g} mm cannot be made: skin_mm and "
            "tolerance_mm must be above 0."
        )
    sides = np.ptp(surface.bounds, axis=0)
    if sides.min() <= tolerance:
        raise SolidError(
            f"The part, {' x '.join(f'{side:.3g}' for side in sides)} mm, is no thicker than "
            f"tolerance_mm = {tolerance:g}: lower the tolerance, or check the part's unit."
        )
    whole = SignedDistance(surface)
    closed = DepthField(whole, distance)
    bounds, field = surface.bounds, closed
    if kept is not None:
        field = OpenDepthField(whole, SignedDistance(kept), distance)
        bounds = bounds + np.array([[-field.reach], [field.reach]])
    level = level_surface(field, bounds, tolerance, cube=2 * distance)
    if not len(level.faces):
        return Offset(None, distance, 0.0, inscribed_radius(closed, surface.bounds))
    result, error = _simplified(field, level, tolerance)
    return Offset(result, distance, error)


def level_surface(
    field: AbstractField, bounds: Float[np.ndarray, "2 3"], tolerance: float, *, cube: float
) -> TriMesh:
    """The zero level of a field, within half the tolerance.

    Args:
        field: what to find the level of.
        bounds: box to search [mm].
        tolerance: see above [mm].
        cube: size of features that are found for sure [mm], as far as that is affordable.

    Raises:
        SolidError: when the tolerance needs more memory than allowed.
    """
    extent = float(np.ptp(bounds, axis=0).max())
    mesh = coarse_lattice(field, bounds, max(min(cube, extent / 8), extent / 2**COARSE_LEVELS))
    return zero_level(_divided(mesh, tolerance), GOOD_SHARE * tolerance).surface


def _divided(mesh: TetLattice, tolerance: float) -> TetLattice:
    """The lattice, bisected until its level is within the tolerance."""
    while True:
        fresh = np.flatnonzero(~mesh.settled)
        if not len(fresh):
            return mesh
        young = mesh.only(fresh)
        error = _errors(young, tolerance)
        flagged = np.zeros(len(mesh.tets), dtype=bool)
        flagged[fresh] = (error > LEVEL_SHARE * tolerance) | _hiding(young, tolerance)
        mesh.settled[fresh] = True
        if len(mesh.tets) + int(flagged.sum()) > MAX_TETS:
            raise SolidError(_too_much(float(error.max()) / LEVEL_SHARE, tolerance))
        mesh = bisected(mesh, flagged)


def _too_much(reached: float, tolerance: float) -> str:
    """What is said when a tolerance needs more tetrahedra than there may be.

    Args:
        reached: the tolerance that as many as there may be reach [mm]. For it, only those that
            exceed it are divided, which are some of those divided here: it fits.
        tolerance: that was asked for [mm].
    """
    digit = 10.0 ** np.floor(np.log10(reached) - 1)
    # Tetrahedra are as one over the tolerance, or more.
    needed = MAX_TETS * max(reached / tolerance, 1.0)
    return (
        f"The skin's inner wall within tolerance_mm = {tolerance:g} needs {_gigabytes(needed)} of "
        f"memory or more, and {_gigabytes(float(MAX_TETS))} is allowed: tolerance_mm = "
        f"{np.ceil(reached / digit) * digit:.2g} would fit."
    )


def _gigabytes(tets: float) -> str:
    return f"{tets * TET_BYTES / 1e9:.2g} GB"


def _errors(mesh: TetLattice, tolerance: float) -> Float[np.ndarray, " cells"]:
    """How far the level found in each tetrahedron is from the true one [mm], at sampled points."""
    level = zero_level(mesh, GOOD_SHARE * tolerance)
    vertices, faces, owner = level.surface.vertices, level.surface.faces, level.tet_of_face
    error = np.zeros(len(mesh.tets))
    # Centroids catch a crease inside a triangle, middles of edges one between two.
    np.maximum.at(error, owner, np.abs(mesh.sampled(vertices[faces].mean(axis=1), owner)[0]))
    row, corner = np.nonzero(faces >= level.crossings)
    _look(mesh, error, vertices, (faces[row, corner], owner[row]))
    # What is wrong already needs no second look.
    rest = error[owner] <= LEVEL_SHARE * tolerance
    ends = np.sort(faces[rest][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    beside = np.repeat(owner[rest], 3)
    keys, edge = np.unique(ends[:, 0] * len(vertices) + ends[:, 1], return_inverse=True)
    middles = (vertices[keys // len(vertices)] + vertices[keys % len(vertices)]) / 2
    _look(mesh, error, middles, (edge.reshape(-1), beside))
    return error


def _look(
    mesh: TetLattice,
    error: Float[np.ndarray, " cells"],
    points: Float[np.ndarray, "n 3"],
    shared: tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]],
) -> None:
    """Raises the error of tetrahedra to that at points they share, each looked at once.

    Args:
        mesh: the lattice.
        error: of each tetrahedron [mm]; changed.
        points: where to look [mm].
        shared: numbers of points, and for each a tetrahedron that holds it.
    """
    number, tets = shared
    number, first, back = np.unique(number, return_index=True, return_inverse=True)
    there = np.abs(mesh.sampled(points[number], tets[first])[0])
    np.maximum.at(error, tets, there[back.reshape(-1)])


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


def _simplified(field: AbstractField, level: TriMesh, tolerance: float) -> tuple[TriMesh, float]:
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


def _error(field: AbstractField, surface: TriMesh) -> float:
    """Largest distance from the wanted depth at vertices, centroids, edges and sampled points."""
    corners = surface.vertices[surface.faces]
    edges = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    # Large triangles get more points: areas decide, with a fixed generator.
    spread = spread_points(surface, SAMPLES)
    points = np.concatenate([surface.vertices, corners.mean(axis=1), edges])
    # Near the level as they are, their sides need not be asked for; those of the others tell
    # whether they are.
    values = np.concatenate([field(points, (points, np.zeros(len(points))))[0], field(spread)[0]])
    return float(np.abs(values).max())


def spread_points(surface: TriMesh, count: int) -> Float[np.ndarray, "count 3"]:
    """Points at random on a surface, evenly by area, always the same ones [mm]."""
    generator = np.random.default_rng(0)
    share = surface.face_areas / surface.face_areas.sum()
    chosen = generator.choice(len(surface.faces), count, p=share)
    weights = generator.dirichlet(np.ones(3), count)
    return np.einsum("nk,nkx->nx", weights, surface.vertices[surface.faces[chosen]])


def inscribed_radius(field: DepthField, bounds: Float[np.ndarray, "2 3"]) -> float:
    """Radius of the largest ball inside a surface [mm], by branch and bound on cubes.

    Args:
        field: of the surface.
        bounds: of the surface [mm].
    """
    size = float(np.ptp(bounds, axis=0).max())
    centres = bounds.mean(axis=0)[None]
    best = 0.0
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
