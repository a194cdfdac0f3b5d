"""Tet mesh of a part by fTetWild (Hu et al. 2020); the only user of pytetwild.

The mesher runs in a process of its own, `python -m texmap_opt.tetrahedralise IN.npz OUT.npz`: it
prints, it may crash, and it does not answer Ctrl-C; none of this reaches the caller. Its meshes
differ from run to run, so they are stored; everything after it is deterministic.
"""

import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fea import TetMesh
from texmap_opt.combine.boolean import simplified
from texmap_opt.errors import TetrahedralisationError
from texmap_opt.part import Part
from texmap_opt.tet_surface import compacted, fitted_to_surface
from texmap_opt.thickness import thinnest_wall

# Tets along the part's diagonal, when the case does not say.
EDGES_PER_DIAGONAL = 25
# fTetWild's envelope, within which its surface may stray, as shares of the diagonal: its default,
# and the least for which it ends in reasonable time.
ENVELOPE, LEAST_ENVELOPE = 1e-3, 2e-4
# The envelope also stays below these shares of the edge and of the thinnest wall.
ENVELOPE_PER_EDGE, ENVELOPE_PER_WALL = 0.1, 0.1
# A surface of more triangles is simplified first, within this share of the envelope: fTetWild's own
# collapses of 70,000 triangles take four minutes, these half a second.
MANY_FACES, SIMPLIFY_SHARE = 15_000, 0.5
# Share by which the mesh's volume may differ from the part's.
VOLUME_TOLERANCE = 0.02
# Tets that are more than a desktop's memory and its user's patience; 4 million tet4 take about 20 min.
MAX_TETS = 4_000_000
# [s] After this the mesher is taken to hang.
MAX_SECONDS = 3600.0
# tets = a V/edge³ + b A/edge²: a is that of regular tets, b fits ten parts at 1/20 of their extent
# to within a factor of 2 (2.8 for a statue whose detail is finer than the edge).
TETS_PER_VOLUME, TETS_PER_AREA = 8.5, 6.0
NODES_PER_TET = 0.24


@dataclass(frozen=True)
class TetEstimate:
    """What meshing a part will give, to within a factor of two; more where detail is fine.

    Attributes:
        tets: number of tetrahedra.
        nodes: number of nodes.
    """

    tets: int
    nodes: int


def default_edge_mm(part: Part) -> float:
    """Target edge when the case gives none [mm]: a 25th of the diagonal."""
    return part.diagonal / EDGES_PER_DIAGONAL


def estimated_counts(part: Part, *, edge_mm: float, element: str) -> TetEstimate:
    """Tets and nodes to expect.

    Args:
        part: what is to be meshed.
        edge_mm: target edge [mm].
        element: "tet4" or "tet10".
    """
    tets = TETS_PER_VOLUME * part.volume / edge_mm**3 + TETS_PER_AREA * part.area / edge_mm**2
    # Each tet has about 1.2 edges of its own, which carry the additional nodes of tet10.
    nodes = NODES_PER_TET * tets + (1.25 * tets if element == "tet10" else 0)
    return TetEstimate(int(tets), int(nodes))


def tetrahedralise(part: Part, *, edge_mm: float, element: str) -> TetMesh:
    """Tet mesh of a part, its boundary nodes on the part's surface.

    Args:
        part: a closed surface.
        edge_mm: target edge [mm].
        element: "tet4" or "tet10" (straight edges).

    Raises:
        TetrahedralisationError: impossible edge, the mesher failed, or its mesh is not the part.
    """
    if not (np.isfinite(edge_mm) and edge_mm > 0):
        raise TetrahedralisationError(f"edge_mm = {edge_mm:g}: must be a length above 0.")
    if element not in ("tet4", "tet10"):
        raise TetrahedralisationError(f'element = "{element}": must be "tet4" or "tet10".')
    estimate = estimated_counts(part, edge_mm=edge_mm, element=element)
    if estimate.tets > MAX_TETS:
        raise TetrahedralisationError(
            f"edge_mm = {edge_mm:g} would give about {estimate.tets:,} tets, more than "
            f"{MAX_TETS:,}; take a larger edge, such as {default_edge_mm(part):.3g}."
        )
    envelope = _envelope(part, edge_mm)
    nodes, tets = _meshed(part, edge_mm, envelope)
    nodes, tets = compacted(nodes, tets)
    if len(tets) == 0:
        raise TetrahedralisationError(
            f"{part.name}: the mesher returned no tets; take a smaller edge_mm than {edge_mm:g}."
        )
    _check(TetMesh(nodes, tets), part, edge_mm)
    nodes = fitted_to_surface(nodes, tets, part.surface, query=part.signed_distance, reach=envelope)
    mesh = TetMesh(nodes, tets)
    _check(mesh, part, edge_mm)
    return mesh.to_tet10() if element == "tet10" else mesh


def _envelope(part: Part, edge_mm: float) -> float:
    """Distance the mesh's surface may stray from the part's before it is fitted [mm]."""
    wall = thinnest_wall(part.surface, query=part.signed_distance)
    widest = min(ENVELOPE * part.diagonal, ENVELOPE_PER_EDGE * edge_mm, ENVELOPE_PER_WALL * wall)
    return max(widest, LEAST_ENVELOPE * part.diagonal)


def _check(mesh: TetMesh, part: Part, edge_mm: float) -> None:
    inverted = int((mesh.volumes <= 0).sum())
    if inverted:
        raise TetrahedralisationError(
            f"{part.name}: {inverted} of {len(mesh.tets)} tets are flat or inverted; try another "
            f"edge_mm than {edge_mm:g}."
        )
    change = mesh.volume / part.volume - 1
    if abs(change) > VOLUME_TOLERANCE:
        raise TetrahedralisationError(
            f"{part.name}: the tet mesh has {100 * change:+.2g} % of the part's volume, more than "
            f"{100 * VOLUME_TOLERANCE:g} %; take a smaller edge_mm than {edge_mm:g}."
        )


def _meshed(part: Part, edge_mm: float, envelope: float) -> tuple[np.ndarray, np.ndarray]:
    """What the mesher makes of a part, computed in a process of its own."""
    surface = part.surface
    if len(surface.faces) > MANY_FACES:
        surface = simplified(surface, SIMPLIFY_SHARE * envelope)
    with tempfile.TemporaryDirectory(prefix="texmap-tets-") as folder:
        given, made = Path(folder) / "part.npz", Path(folder) / "tets.npz"
        np.savez(
            given,
            vertices=surface.vertices,
            faces=surface.faces.astype(np.int32),
            edge=edge_mm,
            epsilon=envelope / part.diagonal,
        )
        status, said = _run_child(given, made)
        if status == 0 and made.is_file():
            with np.load(made) as result:
                return result["nodes"].astype(np.float64), result["tets"].astype(np.int64)
    if status in (-signal.SIGKILL, -signal.SIGSEGV, -signal.SIGABRT):
        cause = f"it was ended by {signal.Signals(-status).name}, often for want of memory"
    else:
        cause = said or f"exit status {status}"
    raise TetrahedralisationError(
        f"{part.name}: the tet mesher failed ({cause}); try a larger edge_mm than {edge_mm:g}, or "
        "repair the part."
    )


def _run_child(given: Path, made: Path) -> tuple[int, str]:
    """Exit status, and the last line of what the child wrote to stderr."""
    # The child finds this package wherever it is, installed or not.
    here = str(Path(__file__).resolve().parents[1])
    paths = [here, *filter(None, [os.environ.get("PYTHONPATH")])]
    child = subprocess.Popen(
        [sys.executable, "-m", "texmap_opt.tetrahedralise", str(given), str(made)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        # fTetWild leaves files of its own where it runs.
        cwd=given.parent,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        # Ctrl-C reaches the caller alone, which then ends the child for certain.
        start_new_session=True,
    )
    try:
        _, errors = child.communicate(timeout=MAX_SECONDS)
    except subprocess.TimeoutExpired as failure:
        raise TetrahedralisationError(
            f"the tet mesher did not end within {MAX_SECONDS:g} s; take a larger edge_mm."
        ) from failure
    finally:
        if child.poll() is None:
            child.kill()
            child.wait()
        if child.stderr is not None:
            child.stderr.close()
    lines = errors.decode(errors="replace").strip().splitlines()
    return child.returncode, lines[-1][:200] if lines else ""


def _child(given: Path, made: Path) -> None:
    """The body of the child process."""
    from pytetwild.pytetwild import tetrahedralize  # Only the child pays for it.

    with np.load(given) as part:
        nodes, tets = tetrahedralize(
            part["vertices"],
            part["faces"],
            edge_length_abs=float(part["edge"]),
            epsilon=float(part["epsilon"]),
            # Its own order gives negative volumes.
            vtk_ordering=True,
            quiet=True,
        )
    np.savez(made, nodes=nodes, tets=tets)


if __name__ == "__main__":
    _child(Path(sys.argv[1]), Path(sys.argv[2]))
