"""The box around a part, along the axes that a case asks for."""

import numpy as np
from jaxtyping import Float

from texmap_opt.box import Box, principal_axes
from texmap_opt.case import DesignCase
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CaseError
from texmap_opt.solid.tri_mesh import TriMesh

# Principal moments whose relative difference is below this count as equal: a round bar in facets,
# coordinates in single precision, a square section.
EQUAL_MOMENTS = 1e-3


# Axis of the box along which a 2.5-D cell is extruded when the case does not say.
USUAL_EXTRUSION = "z"


def part_box(case: DesignCase, surface: TriMesh, cell: UnitCell) -> Box:
    """The smallest box around a part with the axes of `[warp] axes`.

    Args:
        case: names the axes: "part", "principal", or three vectors; and the axis of extrusion.
        surface: of the part [mm].
        cell: of two dimensions: so has the box, its third axis that of the extrusion.

    Raises:
        CaseError: a cell of three dimensions is to be extruded.
    """
    extrusion = case.lattice.extrusion
    if cell.dimensions == 2:
        extrusion = extrusion or USUAL_EXTRUSION
    elif extrusion is not None:
        raise CaseError(
            f'{case.path.name}: [lattice] extrusion = "{extrusion}": the unit cell "{cell.name}" has '
            "three dimensions, and only one of two is extruded; remove the key, or choose a 2.5-D "
            "cell."
        )
    axes = case.warp.axes
    if axes == "part":
        turned = np.eye(3)
    elif axes == "principal":
        turned = principal_axes_of_solid(surface)
    else:
        turned = np.array(axes)
    return Box.around(surface.vertices[np.unique(surface.faces)], turned, extrusion=extrusion)


def principal_axes_of_solid(surface: TriMesh) -> Float[np.ndarray, "3 3"]:
    """Principal axes of the volume that a closed surface bounds, the longest extent first, as rows.

    Where two moments are equal every direction between their axes is principal. Then the axes are
    chosen that lie along x, y, z as far as they can: a beam of square section along x has the axes
    x, y, z.
    """
    points, weights = _with_moments_of_solid(surface)
    axes = principal_axes(points, weights)
    offset = points - weights @ points / weights.sum()
    moments = weights @ (offset @ axes.T) ** 2
    close = np.abs(np.diff(moments)) <= EQUAL_MOMENTS * moments[:-1]
    if close.all():
        return np.eye(3)
    if close.any():
        single = 0 if close[1] else 2
        return _around(axes[single], single)
    return axes


def _around(axis: Float[np.ndarray, " 3"], place: int) -> Float[np.ndarray, "3 3"]:
    """Right-handed axes, one of them given, the others as near to x, y, z as it lets them."""
    # The coordinate axis nearest to the plane normal to the given one.
    nearest = np.eye(3)[int(np.argmin(np.abs(axis)))]
    across = nearest - (nearest @ axis) * axis
    across /= np.linalg.norm(across)
    return np.roll(np.stack([axis, across, np.cross(axis, across)]), place, axis=0)


def _with_moments_of_solid(
    surface: TriMesh,
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, " samples"]]:
    """Weighted points with the volume, centroid and second moments of a solid, exactly.

    The solid is the sum of signed tets from the middle of its box to each triangle. A twentieth of
    a tet's volume at its corners and four fifths at its centroid have its moments up to order two
    (Hammer, Stroud, Mathematics of Computation 12 (1958), 272).
    """
    middle = surface.bounds.mean(axis=0)
    corners = surface.vertices[surface.faces]
    a, b, c = np.moveaxis(corners - middle, 1, 0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    centroid = middle + (a + b + c) / 4
    points = np.concatenate([middle[None], corners.reshape(-1, 3), centroid])
    weights = np.concatenate([[volume.sum()], np.repeat(volume, 3), 16 * volume]) / 20
    return points, weights
