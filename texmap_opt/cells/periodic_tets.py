"""Tets of the solid of a periodic strut cell whose opposite faces match exactly.

A mesher gives opposite faces of a cell different nodes. But most cells have mirror planes: the solid
between them, an eighth of the period, is meshed alone and reflected. Then opposite faces match by
construction, and the mirrored part alone gives all effective constants at an eighth of the cost
(`fea.homogenise_solid.homogenise_mirrored`).
"""

import numpy as np
from jaxtyping import Float, Int

from fea import FeaError, TetMesh, tetrahedralise
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.combine.boolean import intersection
from texmap_opt.errors import CellError
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile

# Sides of a round strut, a multiple of four: a strut in one or two mirror planes is then cut to a
# half or a quarter of its area exactly. With 32 the polygon's second moment of area is that of the
# circle to 1e-5.
SEGMENTS = 32
# Distance of joints from the union of their struts, in radii: what 32 sides leave of a circle.
TOLERANCE = 0.005

# Envelope of the mesher over the thinnest radius: its surface loses 0.2 % of the volume (1.7 % at
# 1/20, 0.1 % at 1/200 in twice the time), and planes are found again without doubt.
ENVELOPE_PER_RADIUS = 1 / 100

# Edge of the tets over the thinnest radius; see the convergence in docs/joint-model.md.
EDGE_PER_RADIUS = 1 / 2

# Struts beyond the mirror planes that are within this many radii of them may reach across.
REACH = 2.0

AXES = "xyz"


def mirror_spacing(cell: UnitCell) -> float:
    """Distance between a tiled cell's mirror planes across each axis, in cell edges.

    1/2 where the cell is its own mirror image: planes lie in its faces and its middle. 1 where it
    is tiled by reflection along some axis: planes lie in its faces.

    Raises:
        CellError: when the cell is neither, is no cube, or is extruded.
    """
    if cell.dimensions != 3 or len(set(cell.proportions)) > 1:
        raise CellError(
            f'unit cell "{cell.name}" is no cube of struts, so it has no tets between mirror planes of '
            "a cube; choose a cell such as octet, bcc, cube or tetrakaidecahedron."
        )
    net = _lines(cell, cell.ticks)
    for axis in np.flatnonzero(~np.array(cell.mirrored)):
        image = cell.ticks.copy()
        image[:, axis] = TICKS - image[:, axis]
        if _lines(cell, image) != net:
            raise CellError(
                f'unit cell "{cell.name}" is not its own mirror image across {AXES[axis]}, so its '
                "tets cannot be made periodic by reflection; choose a cell with mirror planes, such "
                "as octet, bcc, cube or tetrakaidecahedron."
            )
    return 1.0 if any(cell.mirrored) else 0.5


def is_cubic(cell: UnitCell) -> bool:
    """Whether exchanging any two axes leaves the cell as it is."""
    net = _lines(cell, cell.ticks)
    return all(_lines(cell, cell.ticks[:, order]) == net for order in ([1, 0, 2], [0, 2, 1]))


def mirrored_surface(cell: UnitCell, *, edge: float, radius: float) -> TriMesh:
    """Closed surface of the lattice between its mirror planes: a cube with its corner at 0.

    Args:
        cell: a cell with mirror planes.
        edge: of the cell [mm].
        radius: of struts of relative radius 1 [mm].

    Raises:
        CellError: for a cell without mirror planes.
        SolidError: when the union or the cut fails.
    """
    side = mirror_spacing(cell)
    # Cell (2, 2, 2) of a mirrored tiling is not reflected; the two before it reach into its corner.
    net = tile(cell, (4, 4, 4))
    low, high = 2.0, 2.0 + side
    ends = net.joints[net.struts]
    reach = REACH * (radius / edge) * net.relative_radius[:, None]
    near = ((ends.min(axis=1) <= high + reach) & (ends.max(axis=1) >= low - reach)).all(axis=1)
    radii = radius * net.relative_radius
    block = Structure(
        joints=(net.joints - low) * edge,
        struts=net.struts,
        radii=np.repeat(radii[:, None], 2, axis=1),
        cut=np.zeros(len(net.joints), bool),
        cell_size=np.ones(len(net.struts)),
        section=cell.section,
    ).select(near)
    solid = lattice_solid(block, tolerance_mm=TOLERANCE * radius, segments=SEGMENTS).surface
    box = TetMesh.box((side * edge, side * edge, side * edge), (1, 1, 1))
    return intersection(solid, TriMesh(box.nodes, box.boundary_facets))


def mirrored_tets(
    cell: UnitCell, *, edge: float, radius: float, tet_edge: float | None = None
) -> TetMesh:
    """Tet4 mesh of `mirrored_surface`, with the nodes of the mirror planes exactly on them.

    Args:
        cell: a cell with mirror planes.
        edge: of the cell [mm].
        radius: of struts of relative radius 1 [mm].
        tet_edge: wanted edge of the tets [mm]; absent: half the thinnest radius.

    Raises:
        CellError: for a cell without mirror planes.
        FeaError: when the mesher fails, or no mesh remains where planes are made flat.
    """
    surface = mirrored_surface(cell, edge=edge, radius=radius)
    thinnest = radius * float(cell.relative_radius.min())
    envelope = ENVELOPE_PER_RADIUS * thinnest
    mesh = tetrahedralise(
        surface.vertices,
        surface.faces,
        edge=EDGE_PER_RADIUS * thinnest if tet_edge is None else tet_edge,
        envelope=envelope,
    )
    return on_planes(mesh, side=mirror_spacing(cell) * edge, envelope=envelope)


def periodic_tets(
    cell: UnitCell, *, edge: float, radius: float, tet_edge: float | None = None
) -> tuple[TetMesh, Float[np.ndarray, " 3"]]:
    """Tet4 mesh of one period of the lattice, opposite faces alike, and its periods [mm].

    See `mirrored_tets` for arguments and errors.
    """
    side = mirror_spacing(cell) * edge
    mesh = mirrored_tets(cell, edge=edge, radius=radius, tet_edge=tet_edge)
    return reflected(mesh), np.full(3, 2 * side)


def on_planes(mesh: TetMesh, *, side: float, envelope: float) -> TetMesh:
    """The mesh with boundary nodes within the envelope of a face of its cube moved onto it.

    Args:
        mesh: of a solid in the cube from 0 to `side`, by a mesher that strays.
        side: of the cube [mm].
        envelope: how far the mesher strays [mm].

    Raises:
        FeaError: when a cell becomes flat: the mesh is too coarse for the envelope.
    """
    nodes = mesh.nodes.copy()
    surface = np.unique(mesh.boundary_facets)
    for axis in range(3):
        for plane in (0.0, side):
            here = np.abs(nodes[surface, axis] - plane) <= envelope
            if not here.any():
                raise FeaError(
                    f"No node lies within {envelope:g} of the mirror plane {AXES[axis]} = {plane:g}; "
                    "the mesh does not reach it: take a thicker radius, or a smaller envelope."
                )
            nodes[surface[here], axis] = plane
    moved = _without_flat_cells(nodes, mesh.tets, side)
    moved.check()
    return moved


def _without_flat_cells(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 4"], side: float
) -> TetMesh:
    """Slivers at a mirror plane are flat once all their corners lie on it, and enclose nothing."""
    flat = np.zeros(len(tets), bool)
    for axis in range(3):
        for plane in (0.0, side):
            flat |= (nodes[tets, axis] == plane).all(axis=1)
    used, index = np.unique(tets[~flat], return_inverse=True)
    return TetMesh(nodes[used], index.reshape(-1, 4))


def reflected(mesh: TetMesh) -> TetMesh:
    """The mesh (its corners) and its images in the planes x = 0, y = 0 and z = 0, welded there."""
    nodes, tets = mesh.nodes, mesh.tets[:, :4]
    for axis in range(3):
        number = np.arange(len(nodes))
        apart = nodes[:, axis] != 0
        image = number.copy()
        image[apart] = len(nodes) + np.arange(apart.sum())
        flipped = nodes[apart] * np.where(np.arange(3) == axis, -1.0, 1.0)
        # Two corners change places: a reflection turns cells inside out.
        tets = np.concatenate([tets, image[tets[:, [0, 2, 1, 3]]]])
        nodes = np.concatenate([nodes, flipped])
    return TetMesh(nodes, tets)


def _lines(cell: UnitCell, ticks: Int[np.ndarray, "joints 3"]) -> set[tuple]:
    """Struts by the places of their ends and their radius."""
    return {
        (*sorted(map(tuple, ticks[ends].tolist())), float(radius))
        for ends, radius in zip(cell.struts, cell.relative_radius, strict=True)
    }
