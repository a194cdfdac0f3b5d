"""The solids that closed shells bound: outer shells with the voids inside them."""

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.edge_pairs import EdgePairs
from texmap_opt.errors import PartError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh


def solids_of(surface: TriMesh) -> tuple[list[TriMesh], int]:
    """Each solid's own surface, and the number of shells that had to be turned.

    A shell of positive volume is a solid; one of negative volume is a void of the smallest shell
    around it. An outermost shell of negative volume is inside out: it is turned, and everything
    inside it with it.

    Args:
        surface: closed shells, each consistently oriented.

    Raises:
        PartError: a void lies in a void.
    """
    label = EdgePairs(surface.faces).shells
    shells = [_piece(surface, label == k) for k in range(int(label.max()) + 1)]
    inside = _containment(shells)
    turned = 0
    for outer in np.flatnonzero(~inside.any(axis=1)):
        if shells[outer].volume < 0:
            family = [outer, *np.flatnonzero(inside[:, outer])]
            for k in family:
                shells[k] = TriMesh(shells[k].vertices, shells[k].faces[:, ::-1])
            turned += len(family)
    volumes = np.array([shell.volume for shell in shells])
    pieces: dict[int, list[TriMesh]] = {int(k): [shells[k]] for k in np.flatnonzero(volumes > 0)}
    for k in np.flatnonzero(volumes <= 0):
        around = np.flatnonzero(inside[k])
        parent = int(around[np.argmin(np.abs(volumes[around]))])
        if parent not in pieces:
            raise PartError(
                "a shell that faces inwards lies directly inside another one that does, so inside "
                "and outside contradict each other; turn one of them."
            )
        pieces[parent].append(shells[k])
    return [_joined(parts) for parts in pieces.values()], turned


def _containment(shells: list[TriMesh]) -> Bool[np.ndarray, "n n"]:
    """[i, j]: shell i lies inside shell j, whichever way j is oriented."""
    n = len(shells)
    inside = np.zeros((n, n), dtype=bool)
    bounds = np.stack([shell.bounds for shell in shells])
    # The middle of a face: unlike a vertex it is not where shells touch.
    probe = np.stack([_middle_of_largest_face(shell) for shell in shells])
    for j, shell in enumerate(shells):
        within = (bounds[:, 0] >= bounds[j, 0]) & (bounds[:, 1] <= bounds[j, 1])
        within = np.flatnonzero(within.all(axis=1))
        within = within[within != j]
        if within.size:
            winding = SignedDistance(shell).winding_number(probe[within])
            inside[within, j] = np.abs(winding) > 0.5
    # Two shells that coincide would each contain the other: the larger number is the inner one.
    both = inside & inside.T
    inside[np.triu(both)] = False
    return inside


def _middle_of_largest_face(shell: TriMesh) -> Float[np.ndarray, " 3"]:
    return shell.vertices[shell.faces[int(np.argmax(shell.face_areas))]].mean(axis=0)


def _piece(surface: TriMesh, chosen: Bool[np.ndarray, " faces"]) -> TriMesh:
    return surface.select(chosen)


def _joined(parts: list[TriMesh]) -> TriMesh:
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return TriMesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))
