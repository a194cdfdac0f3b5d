"""Tets of a part: from the cache, from an earlier run's file, or from the mesher, refined or not."""

from collections.abc import Callable

import numpy as np

from fea import FeaError, SolidSolution, TetMesh
from fea.adaptive import refine
from fea.mesh_files import read_tets
from texmap_opt.cache import StageCache, stage_key
from texmap_opt.case import DesignCase
from texmap_opt.errors import CaseError, TetrahedralisationError
from texmap_opt.part import Part
from texmap_opt.tetrahedralise import default_edge_mm, tetrahedralise

# Largest relative difference in volume between a part and tets that are said to fill it.
SAME_VOLUME = 0.02
# Most meshes on the way to `max_error`, and most nodes of one: a solve of about a minute.
MAX_ROUNDS, MAX_NODES = 8, 300_000


def part_tets(
    case: DesignCase,
    part: Part,
    cache: StageCache,
    *,
    solve: Callable[[TetMesh], SolidSolution],
) -> TetMesh:
    """The tets that the case asks for.

    The mesher is not repeatable: it differs from run to run on equal input. So its result is kept,
    and `[analysis] mesh` takes the tets of an earlier run.

    Args:
        case: says where the tets come from, and how large the estimated error may be.
        part: what they fill.
        cache: where they are kept.
        solve: the analysis of all load cases on some tets; called when the case gives `max_error`.

    Raises:
        CaseError: the file of tets cannot be read or does not fill the part.
        TetrahedralisationError: the mesher failed, or the estimated error stays above `max_error`.
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
    # The error depends on the analysis; one mesh of an edge does not.
    refined_for = None
    if analysis.max_error is not None:
        refined_for = (analysis.max_error, case.material, case.supports, case.loads)
    key = stage_key(
        "tets", part.surface.vertices, part.surface.faces, edge, analysis.element, refined_for
    )
    stored = cache.get(key)
    if stored:
        return TetMesh(stored["nodes"], stored["tets"])
    if analysis.max_error is None:
        mesh = tetrahedralise(part, edge_mm=edge, element=analysis.element)
    else:
        mesh = _refined_tets(case, part, edge, analysis.max_error, solve)
    cache.put(key, {"nodes": mesh.nodes, "tets": mesh.tets})
    return mesh


def _refined_tets(
    case: DesignCase,
    part: Part,
    edge: float,
    max_error: float,
    solve: Callable[[TetMesh], SolidSolution],
) -> TetMesh:
    where = f"{case.path.name}: [analysis] max_error = {max_error:g}"
    try:
        adapted = refine(
            lambda sizing: tetrahedralise(
                part, edge_mm=edge, element=case.analysis.element, sizing=sizing
            ),
            solve,
            share=max_error,
            rounds=MAX_ROUNDS,
            max_nodes=MAX_NODES,
            throw=False,
        )
    except FeaError as failure:
        raise TetrahedralisationError(f"{where}: {failure}") from failure
    if not adapted.converged:
        least = min(adapted.history, key=lambda done: done.relative)
        last = len(adapted.history)
        raise TetrahedralisationError(
            f"{where}: the estimated error is {100 * least.relative:.2g} % with {least.nodes:,} nodes "
            f"after {last} of {MAX_ROUNDS} rounds; give a larger max_error, "
            'element = "tet10", or a fillet to inner corners.'
        )
    return adapted.mesh


def _tets_of_file(case: DesignCase, part: Part) -> TetMesh:
    path = case.directory / str(case.analysis.mesh)
    where = f"{case.path.name}: [analysis] mesh = {case.analysis.mesh!r}"
    try:
        mesh = read_tets(path)
    except FeaError as failure:
        said = str(failure).removesuffix(".")
        raise CaseError(f"{where}: {said}, or give the stress.vtu of an earlier run.") from failure
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
