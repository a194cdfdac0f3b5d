"""One measurement of `benchmarks/synthesis.py`, alone in its process: prints a line of JSON."""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  (compiled)
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from stopwatch import Stopwatch, peak_memory_gb

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.map import map_structure, mapped_joints, multilinear
from texmap_opt.structure.mixed_net import Layout, mixed_net
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.structure_npz import read_structure_npz, write_structure_npz
from texmap_opt.structure.structure_xml import read_structure, write_structure
from texmap_opt.structure.tile import tile
from texmap_opt.structure.trim import trim

# Octet cells along an edge: 24 n³ + 12 n² struts, 1,043,700.
CELLS = 35
# Edge of a cell, and how far a sine moves the nodes of the grid [mm].
EDGE, SWING = 10.0, 2.0
RADIUS = 0.5
# Copies of a joint nearer than this are one, for codes that weld by distance [mm].
NEAR = 1e-6
# An icosahedron subdivided so often has 20,480 triangles.
SUBDIVISIONS = 5
# Struts that the other code cuts: enough for a steady figure, few enough to wait for.
SAMPLE = 20_000


def warped_nodes(cells: int) -> np.ndarray:
    """Nodes of a grid that a smooth field has moved; its faces stay plane."""
    ticks = np.linspace(0, cells * EDGE, cells + 1)
    nodes = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)
    return nodes + SWING * np.sin(2 * np.pi * nodes[..., [1, 2, 0]] / ticks[-1]) * np.sin(
        np.pi * nodes / ticks[-1]
    )


def octet() -> Structure:
    """A million struts in a warped grid."""
    return map_structure(tile(unit_cell("octet"), (CELLS,) * 3), warped_nodes(CELLS), RADIUS)


def synthesis() -> dict[str, Any]:
    """Tile, weld and map a million octet struts."""
    clock, cell, nodes = Stopwatch(), unit_cell("octet"), warped_nodes(CELLS)
    before = peak_memory_gb()
    with clock.stage("tile and weld"):
        net = tile(cell, (CELLS,) * 3)
    with clock.stage("map"):
        structure = map_structure(net, nodes, RADIUS)
    expected = ((CELLS + 1) ** 3 + 3 * CELLS**2 * (CELLS + 1), 24 * CELLS**3 + 12 * CELLS**2)
    row = _row(clock, before, struts=len(structure.struts))
    uniform = CELLS * EDGE
    straight = np.linspace(0, uniform, CELLS + 1)
    at_rest = np.stack(np.meshgrid(straight, straight, straight, indexing="ij"), axis=-1)
    off = np.abs(mapped_joints(net, at_rest) - EDGE * net.joints).max() / uniform
    structure.validate()
    return row | {
        "counts right": (len(structure.joints), len(structure.struts)) == expected,
        "identity, share of the box": float(off),
    }


def weld_by_distance() -> dict[str, Any]:
    """The same joints and struts with copies of joints merged where they are near in space."""
    clock, cell, nodes = Stopwatch(), unit_cell("octet"), warped_nodes(CELLS)
    before = peak_memory_gb()
    with clock.stage("map copies"):
        index = np.stack(np.meshgrid(*[np.arange(CELLS)] * 3, indexing="ij"), axis=-1)
        index = index.reshape(-1, 3)
        joints = multilinear(
            nodes,
            np.repeat(index, len(cell.joints), axis=0),
            np.tile(cell.joints, (len(index), 1)),
        )
    with clock.stage("weld"):
        a, b = KDTree(joints).query_pairs(NEAR, output_type="ndarray").T
        graph = coo_array((np.ones(len(a), bool), (a, b)), shape=(len(joints),) * 2)
        count, label = connected_components(graph, directed=False)
        copies = np.arange(len(index))[:, None, None] * len(cell.joints) + cell.struts
        struts = np.unique(np.sort(label[copies.reshape(-1, 2)], axis=1), axis=0)
    return _row(clock, before, struts=len(struts)) | {"joints": int(count)}


def trimming() -> dict[str, Any]:
    """Cut a million struts at a ball of 20,480 triangles."""
    clock, structure, part = Stopwatch(), octet(), ball()
    before = peak_memory_gb()
    with clock.stage("trim"):
        trimmed = trim(structure, part, skin_mm=1.0)
    kept, counts = trimmed.structure, trimmed.counts
    return _row(clock, before, struts=len(structure.struts)) | {
        "triangles": len(part.surface.faces),
        "cut": counts.struts_cut,
        "kept": counts.struts,
        "off the facets [mm]": _off(part, kept.joints[kept.cut]),
    }


def trimming_by_rays() -> dict[str, Any]:
    """Crossings of some of the struts with the same ball by trimesh's rays and Rtree."""
    clock, structure, part = Stopwatch(), octet(), ball()
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(structure.struts), SAMPLE, replace=False)
    start, end = np.moveaxis(structure.joints[structure.struts[chosen]], 1, 0)
    before = peak_memory_gb()
    with clock.stage("crossings"):
        mesh = trimesh.Trimesh(part.surface.vertices, part.surface.faces, process=False)
        places, ray, _ = mesh.ray.intersects_location(start, end - start, multiple_hits=True)
        away = np.linalg.norm(places - start[ray], axis=1)
        met = away <= np.linalg.norm(end - start, axis=1)[ray]
    return _row(clock, before, struts=SAMPLE) | {"cut": len(np.unique(ray[met]))}


def ball() -> Part:
    """A ball that fills most of the lattice's box."""
    sphere = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS, radius=0.48 * CELLS * EDGE)
    vertices = np.asarray(sphere.vertices) + CELLS * EDGE / 2
    return Part(TriMesh(vertices, np.asarray(sphere.faces, np.int64)), "ball")


def xml() -> dict[str, Any]:
    """Write and read back structure.xml of a million struts."""
    return _through_file("structure.xml", write_structure, read_structure)


def npz() -> dict[str, Any]:
    """The same as NPZ."""
    return _through_file(
        "structure.npz",
        lambda structure, path, provenance: write_structure_npz(
            path, structure, provenance=provenance
        ),
        lambda path: read_structure_npz(path)[0],
    )


def xml_tree() -> dict[str, Any]:
    """Read the same file into a tree by lxml, and its numbers out of that."""
    clock = Stopwatch()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "structure.xml"
        write_structure(octet(), path, provenance={})
        before = peak_memory_gb()
        with clock.stage("read"):
            root = etree.parse(str(path)).getroot()
            joints = np.array([joint.text.split() for joint in root.iter("joint")], float)
            struts = [
                (int(s.get("from")), int(s.get("to")), float(s.get("radius_from")))
                for s in root.iter("strut")
            ]
    return _row(clock, before, struts=len(struts)) | {"joints": len(joints)}


def mixed() -> dict[str, Any]:
    """Octet and kelvin in one block of 50,653 cells, in lumps of some cells: many interfaces."""
    clock, n = Stopwatch(), 37
    x = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"))
    waves = np.sin(0.5 * x[0]) + np.sin(0.4 * x[1]) + np.sin(0.6 * x[2])
    cells: tuple[UnitCell, ...] = (unit_cell("octet"), unit_cell("kelvin"))
    before = peak_memory_gb()
    with clock.stage("tile and join"):
        net, _ = mixed_net(Layout(cells, (waves > 0).astype(np.int64)))
    ends = net.struts.T
    graph = coo_array((np.ones(len(net.struts)), tuple(ends)), shape=(len(net.joints),) * 2)
    pieces = connected_components(graph, directed=False)[0]
    return _row(clock, before, struts=len(net.struts)) | {"components": int(pieces)}


RUNS = {
    "synthesis": synthesis,
    "weld by distance": weld_by_distance,
    "trim": trimming,
    "trimesh rays": trimming_by_rays,
    "xml": xml,
    "lxml tree": xml_tree,
    "npz": npz,
    "mixed": mixed,
}


def _through_file(name: str, write: Any, read: Any) -> dict[str, Any]:
    clock, structure = Stopwatch(), octet()
    before = peak_memory_gb()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        with clock.stage("write"):
            write(structure, path, provenance={"cell": "octet"})
        size = path.stat().st_size
        with clock.stage("read"):
            again = read(path)
    same = all(
        np.array_equal(getattr(structure, name), getattr(again, name))
        for name in ("joints", "struts", "radii", "cut", "cell_size")
    )
    if structure.origin is None or again.origin is None:
        raise ValueError("the structure lost where its struts came from")
    same &= np.array_equal(structure.origin.cell, again.origin.cell)
    return _row(clock, before, struts=len(structure.struts)) | {
        "file [MB]": round(size / 1e6, 1),
        "same bits": same,
    }


def _off(part: Part, points: np.ndarray) -> float:
    """Largest distance of points from the part's facets [mm]."""
    return float(np.abs(part.signed_distance(points)[0]).max())


def _row(clock: Stopwatch, before: float, *, struts: int) -> dict[str, Any]:
    return {
        "struts": struts,
        "stages": clock.rows(),
        "memory_before_gb": before,
        "peak_memory_gb": peak_memory_gb(),
    }


def main() -> None:
    """Print the row of the run that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", choices=sorted(RUNS))
    print(json.dumps(RUNS[parser.parse_args().run]()))


if __name__ == "__main__":
    main()
