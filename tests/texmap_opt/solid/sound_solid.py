"""What every solid must be: one closed surface that encloses each place once or not at all."""

import numpy as np
from jaxtyping import Float
from lattices import loops

from texmap_opt.solid.surface_points import points_by_face
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import ValidityReport, validity
from texmap_opt.structure.structure import Structure

# Points and triangles whose solid angles are summed at once: arrays of 8 MB.
TERMS = 1_000_000
# Rounding of a sum of some thousand solid angles over 4 pi is 1e-12; the next integer is 1 away.
ROUNDING = 1e-6


def assert_sound(surface: TriMesh, lattice: Structure, *, points: int = 60) -> ValidityReport:
    """Closed, oriented, single fans, accepted by manifold3d; genus of the graph; winding 0 or 1."""
    report = assert_valid(surface, size=float(lattice.radii.min()), points=points)
    assert (report.genus, report.connected_components) == loops(lattice)
    return report


def assert_valid(surface: TriMesh, *, size: float, points: int = 60) -> ValidityReport:
    """The same of a solid whose genus is not known.

    Args:
        surface: the solid.
        size: of its smallest parts [mm]: how far from the surface points are looked at.
        points: how many.
    """
    report = validity(surface)
    assert report.printable, report.faults
    winding = winding_numbers(surface, points_near(surface, size, points))
    wrong = (np.abs(winding) > ROUNDING) & (np.abs(winding - 1) > ROUNDING)
    assert not wrong.any(), f"enclosed {winding[wrong]} times"
    assert (winding > 0.5).any() and (winding < 0.5).any()
    return report


def points_near(surface: TriMesh, size: float, count: int) -> Float[np.ndarray, "points 3"]:
    """Points at random within `size` of triangles taken evenly from the list [mm]."""
    random = np.random.default_rng(0)
    near, faces = points_by_face(surface, count, random)
    # Most very near, where a surface that crosses itself by a little encloses twice.
    away = size * 10 ** random.uniform(-4, 0, len(near)) * random.choice([-1, 1], len(near))
    return near + away[:, None] * surface.face_normals[faces]


def winding_numbers(
    surface: TriMesh, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Sum of all triangles' solid angles over 4 pi (Van Oosterom and Strackee 1983)."""
    step = max(1, TERMS // len(surface.faces))
    corners = surface.vertices[surface.faces]
    sums = []
    for start in range(0, len(points), step):
        a, b, c = np.moveaxis(corners - points[start : start + step, None, None], 2, 0)
        la, lb, lc = (np.sqrt(np.einsum("pfd,pfd->pf", x, x)) for x in (a, b, c))
        volume = np.einsum("pfd,pfd->pf", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("pfd,pfd->pf", x, y) for x, y in ((a, b), (b, c), (c, a)))
        angle = 2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        sums.append(angle.sum(axis=1) / (4 * np.pi))
    return np.concatenate(sums)
