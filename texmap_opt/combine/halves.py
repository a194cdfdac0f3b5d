"""A solid cut in two by a plane, for looking into it and for printing it in pieces."""

import numpy as np
from jaxtyping import Float

from texmap_opt.combine import boolean
from texmap_opt.errors import InputError
from texmap_opt.solid.tri_mesh import TriMesh


def middle_plane(surface: TriMesh) -> tuple[Float[np.ndarray, " 3"], float]:
    """The plane across the longest side of a surface's box, half way: unit normal and offset [mm]."""
    low, high = surface.bounds
    axis = int(np.argmax(high - low))
    return np.eye(3)[axis], float((low + high)[axis] / 2)


def plane_from_text(text: str) -> tuple[Float[np.ndarray, " 3"], float]:
    """The plane `n . x = offset` as typed after `--plane`: nx,ny,nz,offset with n of any length.

    Returns:
        the unit normal, and the distance of the plane from the origin along it [mm]: the offset as
        typed, which is not divided by the length of n.

    Raises:
        InputError: it is not four finite numbers, or the normal is zero.
    """
    where = f"--plane {text}"
    try:
        numbers = np.array([float(entry) for entry in text.split(",")])
    except ValueError as failure:
        raise InputError(f"{where}: must be numbers with commas between ({failure}).") from failure
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise InputError(f"{where}: must be the four finite numbers nx,ny,nz,offset.")
    length = float(np.linalg.norm(numbers[:3]))
    if length == 0:
        raise InputError(f"{where}: the normal has no length; give a direction such as 1,0,0.")
    return numbers[:3] / length, float(numbers[3])


def halves(
    surface: TriMesh, normal: Float[np.ndarray, " 3"], offset: float
) -> tuple[TriMesh, TriMesh]:
    """The solids behind and in front of a plane, both closed.

    Args:
        surface: closed, outward oriented [mm].
        normal: unit normal of the plane; points to the second solid.
        offset: distance of the plane from the origin along it [mm].

    Raises:
        InputError: the plane misses the solid.
        SolidError: the surface is no solid.
    """
    along = surface.vertices[surface.faces].reshape(-1, 3) @ normal
    low, high = float(along.min()), float(along.max())
    if not low < offset < high:
        raise InputError(
            f"The plane {offset:g} mm along {_shown(normal)} misses the solid, which reaches from "
            f"{low:.4g} to {high:.4g} mm there; give an offset between."
        )
    front, back = boolean.split_by_plane(surface, normal, offset)
    return back, front


def _shown(vector: np.ndarray) -> str:
    return "[" + ", ".join(f"{x:.4g}" for x in vector) + "]"
