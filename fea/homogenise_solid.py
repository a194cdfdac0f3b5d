"""Effective stiffness of a periodic solid of tetrahedra: voids, one material or several.

As in `fea.homogenise` the displacement is E x plus a field that repeats, and

    C_ij = (1/V) u_i' K u_j

over six unit strains on one factor (Michel, Moulinec, Suquet, Comput. Methods Appl. Mech. Engrg. 172
(1999) 109, section 2). Nodes on opposite faces match, and each pair is one unknown.

Where three mirror planes cut the cell, an eighth of it is enough. Under a normal strain the field is
its own mirror image: planes stay plane and slide freely. Under the shear xy it changes its sign in the
planes across x and y: there it vanishes along the plane and is free across; z is as before. Each is a
set of supports on the faces of the eighth, so four factors of an eighth replace one of the whole.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array

from fea.assembly import Pattern, Reduced
from fea.errors import FeaError, position_text
from fea.linear_solve import SingularStiffness, factorise
from fea.materials import AbstractMaterial
from fea.mechanisms import describe_mode
from fea.periodicity import (
    SAME,
    UNIT_STRAINS,
    Images,
    cell_volume,
    check_connected,
    held,
    images,
    summed_blocks,
)
from fea.precision import require_x64
from fea.rigid_motion import rigid_body_modes
from fea.solid import SolidProblem
from fea.tet_mesh import TetMesh

# Out-of-balance forces below this share of the forces themselves are rounding: of a homogeneous cell.
BALANCED = 1e-12

# |f - K u| / |f| of the fields. Energies, and so C, are off by its square only.
RESIDUAL = 1e-8

# Largest share of its stiffness by which a material may couple normal stress and shear and still be
# its own mirror image.
MIRRORED = 1e-9

AXES = "xyz"


@dataclass(frozen=True, eq=False)
class HomogenisedSolid:
    """What six unit strains do to a cell of a periodic solid.

    Attributes:
        mesh: the cell, or its eighth.
        C: effective elasticity matrix [MPa], Voigt order.
        displacement: of the nodes under each unit strain [mm], with the part that is E x.
        density: share of the cell's volume that is solid.
        residual: largest true |f - K u| / |f| over the six.
        iterations: of an iterative solver; 0 for a direct one.
    """

    mesh: TetMesh
    C: Float[np.ndarray, "6 6"]
    displacement: Float[np.ndarray, "6 nodes 3"]
    density: float
    residual: float
    iterations: int


def homogenise_solid(
    mesh: TetMesh,
    periods: Float[np.ndarray, "3 3"],
    material: AbstractMaterial | Sequence[AbstractMaterial],
    *,
    material_of: Int[np.ndarray, " cells"] | None = None,
    solver: str = "auto",
) -> HomogenisedSolid:
    """Effective stiffness of a periodic solid.

    Args:
        mesh: what is solid in one period, with the same nodes on opposite faces.
        periods: the three period vectors, one a row [mm].
        material: of all cells of the mesh, or several materials.
        material_of: number of the material of each cell, where there are several.
        solver: see `fea.linear_solve.factorise`.

    Raises:
        FeaError: when the mesh is malformed, wider than a period, opposite faces do not match, it
            falls into several, or numbers of materials do not exist.
        SingularStiffness: when a part can move at no cost.
    """
    require_x64()
    volume = cell_volume(periods)
    mesh.check()
    image = images(mesh.nodes, periods)
    _check_faces(mesh, periods, image)
    number, count = image.number, len(image.first)
    corners = mesh.tets.shape[1]
    links = np.stack([np.repeat(mesh.tets[:, 0], corners - 1), mesh.tets[:, 1:].ravel()], axis=1)
    check_connected(number[links], mesh.nodes[image.first], "solid")

    K = _stiffness(mesh, material, material_of)
    row = np.repeat(np.arange(len(number)), np.diff(K.indptr))
    merged = held(summed_blocks(number[row], number[K.indices], K.data, count))
    affine = _affine(mesh.nodes)
    load = np.zeros((count, 3, 6))
    np.subtract.at(load, number, _balanced(K, affine, number))
    load[0] = 0.0
    near_null = rigid_body_modes(mesh.nodes[image.first])
    near_null[:3] = 0.0
    try:
        factor = factorise(merged, near_null=near_null, solver=solver)
        solved = factor.solve(load.reshape(-1, 6), rtol=RESIDUAL)
    except SingularStiffness as failure:
        raise _named(failure, mesh, number) from failure
    factor.free()
    u = affine + np.moveaxis(solved.x.reshape(count, 3, 6), -1, 0)[:, number]
    C = _energies(K, u) / volume
    return HomogenisedSolid(mesh, C, u, mesh.volume / volume, solved.residual, solved.iterations)


def homogenise_mirrored(
    mesh: TetMesh,
    material: AbstractMaterial | Sequence[AbstractMaterial],
    *,
    material_of: Int[np.ndarray, " cells"] | None = None,
    solver: str = "auto",
) -> HomogenisedSolid:
    """Effective stiffness of a periodic solid from the eighth between its mirror planes.

    The planes are those that bound the mesh's box, across x, y and z; opposite faces need not match.
    The result is orthotropic.

    Args:
        mesh: what is solid in the eighth of the cell.
        material: of all cells of the mesh, or several materials; planes of symmetry across x, y, z.
        material_of: number of the material of each cell, where there are several.
        solver: see `fea.linear_solve.factorise`.

    Raises:
        FeaError: when the mesh is malformed, or a material is not its own mirror image.
        SingularStiffness: when a part can move at no cost.
    """
    require_x64()
    mesh.check()
    for each in _materials(material):
        _check_mirrored(each)
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    on_plane = (np.abs(mesh.nodes - low) <= SAME * (high - low)) | (
        np.abs(mesh.nodes - high) <= SAME * (high - low)
    )
    # node, plane's axis, displacement's component: what a normal strain fixes on each plane.
    symmetric = on_plane[:, :, None] & np.eye(3, dtype=bool)
    antisymmetric = on_plane[:, :, None] & ~np.eye(3, dtype=bool)
    K, pattern = _stiffness(mesh, material, material_of), _pattern(mesh)
    u = np.zeros((6, len(mesh.nodes), 3))
    residual, iterations = 0.0, 0
    for cases, plain in (([0, 1, 2], (0, 1, 2)), ([3], (0,)), ([4], (1,)), ([5], (2,))):
        mirror = np.isin(np.arange(3), plain)[:, None]
        fixed = np.where(mirror, symmetric, antisymmetric).any(axis=1)
        u[cases], solved = _supported(mesh, K, Reduced.from_pattern(pattern, fixed), cases, solver)
        residual, iterations = max(residual, solved[0]), max(iterations, solved[1])
    volume = float(np.prod(high - low))
    C = _energies(K, u) / volume
    # Fields of different symmetry do no work on each other over the whole cell, though on its eighth.
    own = np.zeros((6, 6), dtype=bool)
    own[:3, :3] = own[[3, 4, 5], [3, 4, 5]] = True
    return HomogenisedSolid(
        mesh, np.where(own, C, 0.0), u, mesh.volume / volume, residual, iterations
    )


def _supported(
    mesh: TetMesh, K: bsr_array, reduced: Reduced, cases: list[int], solver: str
) -> tuple[Float[np.ndarray, "cases nodes 3"], tuple[float, int]]:
    """Fields of some unit strains where the rest of the displacement vanishes on fixed dofs."""
    affine = _affine(mesh.nodes)[cases]
    load = -_balanced(K, affine, np.arange(len(mesh.nodes)))
    load[reduced.fixed] = 0.0
    modes = reduced.restrict(rigid_body_modes(mesh.nodes).reshape(-1, 3, 6))
    try:
        factor = factorise(reduced.matrix(K), near_null=modes, solver=solver)
        solved = factor.solve(reduced.restrict(load), rtol=RESIDUAL)
    except SingularStiffness as failure:
        if failure.mode is None:
            raise
        mode = reduced.expand(failure.mode[:, None], np.zeros(reduced.fixed.shape))[0]
        words = describe_mode(mesh.nodes, mode)
        raise SingularStiffness(
            f"The mirrored solid is a mechanism: {words}; join it to the rest.", failure.mode
        ) from failure
    factor.free()
    rest = reduced.expand(solved.x, np.zeros(reduced.fixed.shape))
    return affine + rest, (solved.residual, solved.iterations)


def _materials(
    material: AbstractMaterial | Sequence[AbstractMaterial],
) -> tuple[AbstractMaterial, ...]:
    return (material,) if isinstance(material, AbstractMaterial) else tuple(material)


def _pattern(mesh: TetMesh) -> Pattern:
    return Pattern.from_groups([mesh.tets], len(mesh.nodes))


def _stiffness(
    mesh: TetMesh,
    material: AbstractMaterial | Sequence[AbstractMaterial],
    material_of: Int[np.ndarray, " cells"] | None,
) -> bsr_array:
    """K of the cell without supports and without its neighbours [N/mm]."""
    materials, cells = _materials(material), len(mesh.tets)
    of = np.zeros(cells, int) if material_of is None else material_of
    if of.shape != (cells,) or not 0 <= of.min() <= of.max() < len(materials):
        raise FeaError(
            f"Numbers of materials have shape {of.shape} and go from {of.min()} to {of.max()}; give "
            f"{cells}, one a cell, from 0 to {len(materials) - 1}."
        )
    if material_of is None and len(materials) > 1:
        raise FeaError(f"There are {len(materials)} materials; say which cell is of which.")
    pattern, nodes = _pattern(mesh), len(mesh.nodes)
    K = None
    for index, each in enumerate(materials):
        problem = SolidProblem(
            mesh,
            each,
            fixed=np.zeros((nodes, 3), dtype=bool),
            value=np.zeros((nodes, 3)),
            forces=np.zeros((0, nodes, 3)),
            modulus=(of == index).astype(float)[:, None],
        )
        part = problem.stiffness(pattern)
        K = part if K is None else bsr_array((K.data + part.data, K.indices, K.indptr), K.shape)
    if K is None:
        raise FeaError("There is no material; give at least one.")
    return K


def _affine(points: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "6 nodes 3"]:
    """E x for each unit strain, about the middle, where rounding is least."""
    return np.einsum("cij,nj->cni", UNIT_STRAINS, points - points.mean(axis=0))


def _balanced(
    K: bsr_array, u: Float[np.ndarray, "cases nodes 3"], number: Int[np.ndarray, " nodes"]
) -> Float[np.ndarray, "nodes 3 cases"]:
    """Forces K u; of a case where they balance at every number but for rounding, zeros."""
    force = (K @ u.reshape(len(u), -1).T).reshape(-1, 3, len(u))
    total = np.zeros((int(number.max()) + 1, 3, len(u)))
    np.add.at(total, number, force)
    noise = np.abs(total).max(axis=(0, 1)) <= BALANCED * np.abs(force).max(axis=(0, 1))
    return np.where(noise, 0.0, force)


def _energies(K: bsr_array, u: Float[np.ndarray, "6 nodes 3"]) -> Float[np.ndarray, "6 6"]:
    columns = u.reshape(6, -1)
    energies = columns @ (K @ columns.T)
    return (energies + energies.T) / 2


def _check_faces(mesh: TetMesh, periods: Float[np.ndarray, "3 3"], image: Images) -> None:
    """Every facet in a face of the cell must have its image in the opposite face."""
    share = np.linalg.solve(periods.T, mesh.nodes.T).T
    low, high = share.min(axis=0), share.max(axis=0)
    wide = int(np.argmax(high - low))
    if high[wide] - low[wide] > 1 + SAME:
        raise FeaError(
            f"The mesh spans {high[wide] - low[wide]:.6g} periods along period {wide + 1}; give the part "
            "of the solid in one period, or check the periods."
        )
    facets = mesh.boundary_facets
    for axis in np.flatnonzero(high - low >= 1 - SAME):
        faces = [
            facets[(np.abs(share[facets, axis] - end[axis]) <= SAME).all(axis=1)]
            for end in (low, high)
        ]
        keys = [np.sort(image.number[face], axis=1) for face in faces]
        for this, other in ((0, 1), (1, 0)):
            lone = _missing(keys[this], keys[other])
            if lone is not None:
                place = mesh.nodes[faces[this][lone]].mean(axis=0)
                raise FeaError(
                    f"The mesh does not repeat with period {axis + 1}: its facet at "
                    f"{position_text(place)} mm has no match in the opposite face; mesh opposite faces "
                    "alike, node by node."
                )


def _missing(here: Int[np.ndarray, "facets k"], there: Int[np.ndarray, "more k"]) -> int | None:
    """The first row of one array that is not among those of the other."""
    known = set(map(tuple, there.tolist()))
    return next((i for i, row in enumerate(map(tuple, here.tolist())) if row not in known), None)


def _check_mirrored(material: AbstractMaterial) -> None:
    C = material.stiffness
    own: Bool[np.ndarray, "6 6"] = np.eye(6, dtype=bool)
    own[:3, :3] = True
    coupling = float(np.abs(C[~own]).max())
    if coupling > MIRRORED * float(np.abs(C).max()):
        raise FeaError(
            f'Material "{material.name}" is not its own mirror image across x, y and z: it couples '
            f"stresses by {coupling:.3g} MPa; turn its axes to those of the cell, or homogenise the "
            "whole cell."
        )


def _named(
    failure: SingularStiffness, mesh: TetMesh, number: Int[np.ndarray, " nodes"]
) -> SingularStiffness:
    """The same failure, with what moves."""
    if failure.mode is None:
        return failure
    mode = failure.mode.reshape(-1, 3)[number]
    words = describe_mode(mesh.nodes, mode)
    return SingularStiffness(
        f"The periodic solid is a mechanism: {words}; join it to the rest, or to its neighbours.",
        failure.mode,
    )
