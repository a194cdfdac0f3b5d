"""Tets of a part: from the cache, from an earlier run's file, or from the mesher; uses meshio alone."""

from pathlib import Path

import numpy as np

from fea import TetMesh
from texmap_opt.cache import StageCache, stage_key
from texmap_opt.case import DesignCase
from texmap_opt.errors import CaseError
from texmap_opt.part import Part
from texmap_opt.tetrahedralise import default_edge_mm, tetrahedralise

# Largest relative difference in volume between a part and tets that are said to fill it.
SAME_VOLUME = 0.02


def part_tets(case: DesignCase, part: Part, cache: StageCache) -> TetMesh:
    """The tets that the case asks for.

    The mesher is not repeatable: it differs from run to run on equal input. So its result is kept,
    and `[analysis] mesh` takes the tets of an earlier run.

    Raises:
        CaseError: the file of tets cannot be read or does not fill the part.
        TetrahedralisationError: the mesher failed.
    """
    analysis = case.analysis
    if analysis.mesh is not None:
        return _tets_of_file(case, part)
    edge = analysis.edge_mm or default_edge_mm(part)
    if edge > float(np.ptp(part.bounds, axis=0).max()):
        raise CaseError(
            f"{case.path.name}: [analysis] edge_mm = {edge:g}: is longer than the part; give a "
            f"tenth of its thickness, or leave it out for {default_edge_mm(part):.3g}."
        )
    key = stage_key("tets", part.surface.vertices, part.surface.faces, edge, analysis.element)
    stored = cache.get(key)
    mesh = (
        TetMesh(stored["nodes"], stored["tets"])
        if stored
        else tetrahedralise(part, edge_mm=edge, element=analysis.element)
    )
    cache.put_new(key, stored, lambda: {"nodes": mesh.nodes, "tets": mesh.tets})
    return mesh


def _tets_of_file(case: DesignCase, part: Part) -> TetMesh:
    path = case.directory / str(case.analysis.mesh)
    where = f"{case.path.name}: [analysis] mesh = {case.analysis.mesh!r}"
    mesh = _read_tets(path, where)
    if abs(mesh.volume - part.volume) > SAME_VOLUME * part.volume:
        raise CaseError(
            f"{where}: its tets fill {mesh.volume:.4g} mm³, the part {part.volume:.4g} mm³; give "
            "the file of a run of the same part, or remove the key."
        )
    if mesh.element != case.analysis.element:
        raise CaseError(
            f"{where}: holds {mesh.element}, but element = {case.analysis.element!r}; make them agree."
        )
    return mesh


def _read_tets(path: Path, where: str) -> TetMesh:
    import meshio  # Takes a tenth of a second; runs that mesh anew do without.

    try:
        read = meshio.read(path)
    except (OSError, SystemExit, ValueError, KeyError, meshio.ReadError) as failure:
        raise CaseError(
            f"{where}: cannot be read as a mesh; give the stress.vtu of an earlier run."
        ) from failure
    for kind in ("tetra10", "tetra"):
        if kind in read.cells_dict:
            return TetMesh(
                np.asarray(read.points, float), np.asarray(read.cells_dict[kind], np.int64)
            )
    raise CaseError(f"{where}: holds no tetrahedra; give the stress.vtu of an earlier run.")
