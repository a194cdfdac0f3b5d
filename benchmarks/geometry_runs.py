"""One measurement of `benchmarks/geometry.py`, alone in its process: prints a line of JSON."""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import manifold3d as m3
import numpy as np
from stopwatch import Stopwatch, peak_memory_gb

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.combine.offset import offset_inward
from texmap_opt.combine.part_with_lattice import rod_result
from texmap_opt.export.solid_file import Solid
from texmap_opt.part import read_surface
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile

# Octet cells along an edge: 24 n³ + 12 n² struts, 101,376 and 1,043,700.
CELLS, MANY_CELLS = 16, 35
# Edge of a cell, radius of struts, of fillets, and how far joints are moved at random [mm].
EDGE, RADIUS, FILLET, SWING = 5.0, 0.3, 0.15, 0.2
TOLERANCE = 0.05
SIDES = 8
# Height of the statue, thickness of its skin [mm].
HEIGHT, SKIN = 116.0, 1.0
# Octet cells along the edge of the cube that is combined: 2.0 million triangles.
COMBINED_CELLS = 10


def octet(cells: int, *, moved: bool) -> Structure:
    """A block of octet cells; moved: no two joints are alike."""
    ticks = np.linspace(0, cells * EDGE, cells + 1)
    nodes = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)
    structure = map_structure(tile(unit_cell("octet"), (cells,) * 3), nodes, RADIUS)
    if not moved:
        return structure
    shift = np.random.default_rng(0).uniform(-SWING, SWING, structure.joints.shape)
    return Structure(
        structure.joints + shift,
        structure.struts,
        structure.radii,
        structure.cut,
        structure.cell_size,
    )


def meshed(cells: int, *, moved: bool, fillet: float = 0.0) -> dict[str, Any]:
    """Direct mesh of a block."""
    clock, structure = Stopwatch(), octet(cells, moved=moved)
    before = peak_memory_gb()
    with clock.stage("mesh"):
        solid = lattice_solid(structure, tolerance_mm=TOLERANCE, segments=SIDES, fillet_mm=fillet)
    return _row(clock, before, structure) | {
        "triangles": len(solid.surface.faces),
        "volume_mm3": solid.surface.volume,
        "joint types": solid.joint_types,
        "clusters": solid.clusters,
        "error_mm": solid.error_mm,
    }


def written(*, moved: bool) -> dict[str, Any]:
    """A million struts to a binary STL."""
    clock, structure = Stopwatch(), octet(MANY_CELLS, moved=moved)
    before = peak_memory_gb()
    with clock.stage("mesh"):
        solid = lattice_solid(structure, tolerance_mm=TOLERANCE, segments=SIDES)
    with clock.stage("float32"):
        surface, snapped = printable_mesh(solid.surface)
    with tempfile.TemporaryDirectory() as folder, clock.stage("write"):
        path = Path(folder) / "lattice.stl"
        Solid(surface).save(path)
        size = path.stat().st_size
    return _row(clock, before, structure) | {
        "triangles": len(surface.faces),
        "snapped_mm": snapped,
        "file_gb": size / 1e9,
    }


def united(*, moved: bool) -> dict[str, Any]:
    """manifold3d's union of a cylinder for each strut and a sphere for each joint, in one batch."""
    clock, structure = Stopwatch(), octet(CELLS, moved=moved)
    before = peak_memory_gb()
    with clock.stage("primitives"):
        start, end = np.moveaxis(structure.joints[structure.struts], 1, 0)
        solids = [_cylinder(a, b) for a, b in zip(start, end, strict=True)]
        ball = m3.Manifold.sphere(RADIUS, SIDES)
        solids += [ball.translate(tuple(map(float, joint))) for joint in structure.joints]
    with clock.stage("union"):
        whole = m3.Manifold.batch_boolean(solids, m3.OpType.Add)
        triangles = whole.num_tri()
    return _row(clock, before, structure) | {
        "triangles": triangles,
        "volume_mm3": whole.volume(),
        "status": str(whole.status()),
    }


def _cylinder(a: np.ndarray, b: np.ndarray) -> m3.Manifold:
    axis = b - a
    length = float(np.linalg.norm(axis))
    z = axis / length
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    turned = np.column_stack([x, np.cross(z, x), z, a])
    return m3.Manifold.cylinder(length, RADIUS, RADIUS, SIDES).transform(turned)


def offset(parts: Path) -> dict[str, Any]:
    """The inner wall of the statue's skin."""
    surface = read_surface(parts / "beethoven.ply").surface
    extent = float(np.ptp(surface.bounds, axis=0).max())
    surface = TriMesh(surface.vertices * HEIGHT / extent, surface.faces)
    clock, before = Stopwatch(), peak_memory_gb()
    with clock.stage("offset"):
        inner = offset_inward(surface, SKIN, TOLERANCE)
    return {
        "stages": clock.rows(),
        "memory_before_gb": before,
        "peak_memory_gb": peak_memory_gb(),
        "struts": 0,
        "triangles": 0 if inner.surface is None else len(inner.surface.faces),
        "error_mm": inner.error_mm,
    }


def combined() -> dict[str, Any]:
    """A cube under a skin, filled with a lattice of two million triangles."""
    structure = octet(COMBINED_CELLS, moved=True)
    lattice = lattice_solid(structure, tolerance_mm=TOLERANCE / 4, segments=12).surface
    side = COMBINED_CELLS * EDGE
    box = m3.Manifold.cube((side, side, side)).to_mesh64()
    part = TriMesh(np.array(box.vert_properties)[:, :3], np.array(box.tri_verts, dtype=np.int64))
    clock, before = Stopwatch(), peak_memory_gb()
    with clock.stage("combine"):
        result = rod_result(part, lattice, skin_mm=SKIN, tolerance_mm=TOLERANCE)
    with clock.stage("float32"):
        surface, _ = printable_mesh(result.surface)
    return _row(clock, before, structure) | {
        "lattice triangles": len(lattice.faces),
        "triangles": len(surface.faces),
    }


def _row(clock: Stopwatch, before: float, structure: Structure) -> dict[str, Any]:
    return {
        "struts": len(structure.struts),
        "stages": clock.rows(),
        "memory_before_gb": before,
        "peak_memory_gb": peak_memory_gb(),
    }


def main() -> None:
    """Print the row of one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("parts", type=Path)
    asked = parser.parse_args()
    runs = {
        "uniform": lambda: meshed(CELLS, moved=False),
        "different": lambda: meshed(CELLS, moved=True),
        "filleted": lambda: meshed(CELLS, moved=False, fillet=FILLET),
        "million uniform": lambda: written(moved=False),
        "million different": lambda: written(moved=True),
        "union of uniform struts": lambda: united(moved=False),
        "union of different struts": lambda: united(moved=True),
        "offset": lambda: offset(asked.parts),
        "combine": combined,
    }
    print(json.dumps(runs[asked.run]()))


if __name__ == "__main__":
    main()
