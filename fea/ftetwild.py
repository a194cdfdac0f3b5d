"""Tet mesh of a closed surface by fTetWild (Hu et al. 2020); the only user of pytetwild.

The mesher runs in a process of its own: it prints, it may crash, and it does not answer Ctrl-C; none
of this reaches the caller. Its meshes differ from run to run on equal input.

What fTetWild makes of a surface: its boundary lies within an envelope of the surface, so planes are
flat to within the envelope, not to rounding, and sharp edges may be cut by as much. Whoever selects
facets or nodes of a face gives a tolerance of the envelope.

What fTetWild makes of wanted edges (pytetwild 0.4.2, measured on a cube of 20 mm and read in
fTetWild's source, `apply_sizingfield`):

* It first makes and optimises a mesh of the global edge without them, then asks for the wanted edge
  at that mesh's nodes, once, gives new nodes the mean of the edge that they split, and splits, swaps
  and smooths until every edge is below 4/3 of what is wanted. A wanted 2 mm came out as 2.2 mm in
  the median, 1 mm as 1.1 mm, 0.5 mm at a corner of the part as 0.5 mm.
* So the global edge is an upper bound: a mesh of 2 mm has 1,550 nodes, and 1,510 to 1,540 where 4,
  8 or 16 mm is wanted. Nor is a large edge met: 8 and 20 mm both gave 3 mm, a twelfth of the
  diagonal.
* So a spot finer than the global edge is met only where that first mesh has a node. It has some at
  corners and along sharp edges of the part, where stress peaks: 0.2 mm wanted at a corner, growing
  by 0.5 mm/mm, came out as 0.47 mm within the first millimetre. In the middle of a face the smallest
  edge is what is wanted at the nearest node of the first mesh: there 0.2 mm gave 1.1 to 1.2 mm with
  global edges of 2 and 8 mm.
* Where the background ends the global edge holds, and nodes of the surface stray by the envelope:
  the background must reach beyond the surface. `Sizing.around` sees to it.
"""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fea.errors import FeaError
from fea.sizing_field import Sizing
from fea.tet_mesh import TetMesh

# fTetWild's envelope, within which its surface may stray, as shares of the diagonal: its default,
# and the least for which it ends in reasonable time.
ENVELOPE, LEAST_ENVELOPE = 1e-3, 2e-4
# The envelope also stays below this share of the smallest wanted edge.
ENVELOPE_PER_EDGE = 0.1
# Tets that are more than a desktop's memory and its user's patience; 4 million tet4 take about 20 min.
MAX_TETS = 4_000_000
# [s] After this the mesher is taken to hang.
MAX_SECONDS = 3600.0
# tets = a V/edge³ + b A/edge²: a is that of regular tets, b fits ten parts at 1/20 of their extent
# to within a factor of 2 (2.8 for a statue whose detail is finer than the edge).
TETS_PER_VOLUME, TETS_PER_AREA = 8.5, 6.0
# Share by which the mesh's volume may differ from what the surface encloses.
VOLUME_TOLERANCE = 0.02
# Loose crumbs that the mesher leaves are below this share of the volume; larger pieces are solids.
CRUMB = 1e-3
CHILD = "import sys; from fea.ftetwild import _child; _child(sys.argv[1], sys.argv[2])"


def tetrahedralise(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "faces 3"],
    *,
    edge: float,
    sizing: Sizing | None = None,
    envelope: float | None = None,
) -> TetMesh:
    """Tet4 mesh of the solid inside a closed surface: one connected piece of positive volumes.

    Args:
        vertices: of the surface [mm], such as `fea.mesh_files.read_surface` returns.
        triangles: counter-clockwise seen from outside.
        edge: target edge everywhere, and the upper bound of `sizing` [mm].
        sizing: where smaller edges are wanted; see the module's text for how they are met.
        envelope: distance that the mesh's boundary may stray from the surface [mm]. Absent: a
            thousandth of the diagonal, or a tenth of the smallest wanted edge when that is less.

    Raises:
        FeaError: impossible edge or envelope, a surface that is not closed or holds several solids,
            a mesher that fails, hangs or runs out of memory.
    """
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0))) if len(vertices) else 0.0
    volume, area = enclosed_volume(vertices, triangles), _area(vertices, triangles)
    if not (np.isfinite(volume) and volume > 0):
        raise FeaError(
            f"The surface encloses a volume of {volume:.4g} mm³; give a closed surface whose triangles "
            "run counter-clockwise seen from outside."
        )
    _check_edge(edge, volume, area, diagonal)
    smallest = edge if sizing is None else min(edge, float(sizing.edge.min()))
    if envelope is None:
        envelope = min(ENVELOPE * diagonal, ENVELOPE_PER_EDGE * smallest)
        envelope = max(envelope, LEAST_ENVELOPE * diagonal)
    if not (np.isfinite(envelope) and 0 < envelope < diagonal):
        raise FeaError(f"envelope = {envelope:g}: must be a length above 0 and below {diagonal:g}.")
    nodes, tets = _meshed(vertices, triangles, edge, envelope / diagonal, sizing)
    mesh = _largest_piece(nodes, tets, edge)
    inverted = int((mesh.volumes <= 0).sum())
    if inverted:
        raise FeaError(
            f"{inverted} of {len(mesh.tets)} tets are flat or inverted; try another edge than {edge:g}."
        )
    change = mesh.volume / volume - 1
    if abs(change) > VOLUME_TOLERANCE:
        raise FeaError(
            f"The tets have {100 * change:+.2g} % of the volume that the surface encloses, more than "
            f"{100 * VOLUME_TOLERANCE:g} % off; close the surface, remove overlaps, or take a smaller "
            f"edge than {edge:g}."
        )
    return mesh


def estimated_tets(volume: float, area: float, *, edge: float) -> float:
    """Tets to expect, to within a factor of two; more where the surface has detail below the edge.

    Args:
        volume: of the solid [mm³].
        area: of its surface [mm²].
        edge: target edge [mm].
    """
    return TETS_PER_VOLUME * volume / edge**3 + TETS_PER_AREA * area / edge**2


def enclosed_volume(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "faces 3"]
) -> float:
    """Volume inside a closed surface, by the divergence theorem [mm³]; negative when inside out."""
    if len(triangles) == 0:
        return 0.0
    a, b, c = np.moveaxis(vertices[triangles] - vertices[triangles[0, 0]], 1, 0)
    return float(np.einsum("ij,ij->", np.cross(a, b), c)) / 6


def _area(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "faces 3"]
) -> float:
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2


def _check_edge(edge: float, volume: float, area: float, diagonal: float) -> None:
    if not (np.isfinite(edge) and edge > 0):
        raise FeaError(f"edge = {edge:g}: must be a length above 0.")
    tets = estimated_tets(volume, area, edge=edge)
    if tets > MAX_TETS:
        raise FeaError(
            f"edge = {edge:g} would give about {tets:,.0f} tets, more than {MAX_TETS:,}; take a larger "
            f"edge, such as {diagonal / 25:.3g}."
        )


def _largest_piece(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 4"], edge: float
) -> TetMesh:
    """The largest face-connected piece by volume, without nodes that nothing uses."""
    if len(tets) == 0:
        raise FeaError(f"The mesher returned no tets; take a smaller edge than {edge:g}.")
    whole = TetMesh(nodes, tets)
    a, b = whole.face_neighbours.T
    links = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(len(tets), len(tets)))
    _, label = connected_components(links, directed=False)
    size = np.bincount(label, weights=np.abs(whole.volumes))
    solids = int((size > CRUMB * size.sum()).sum())
    if solids > 1:
        raise FeaError(
            f"The mesh falls into {solids} pieces that share no face; give the surface of one solid "
            f"at a time, or a smaller edge than {edge:g} where they touch."
        )
    used, index = np.unique(tets[label == np.argmax(size)], return_inverse=True)
    return TetMesh(nodes[used], index.reshape(-1, 4).astype(np.int64))


def _meshed(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "faces 3"],
    edge: float,
    epsilon: float,
    sizing: Sizing | None,
) -> tuple[Float[np.ndarray, "nodes 3"], Int[np.ndarray, "cells 4"]]:
    """What the mesher makes of a surface, computed in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="fea-tets-") as folder:
        given, made = Path(folder) / "surface.npz", Path(folder) / "tets.npz"
        background = {}
        if sizing is not None:
            background = {
                "bg_vertices": sizing.nodes,
                "bg_tets": sizing.tets.astype(np.int32),
                "bg_values": sizing.edge,
            }
        np.savez(
            given,
            vertices=vertices,
            faces=triangles.astype(np.int32),
            edge_length_abs=edge,
            epsilon=epsilon,
            **background,
        )
        status, said = _run_child(given, made)
        if status == 0 and made.is_file():
            with np.load(made) as result:
                return result["nodes"].astype(np.float64), result["tets"].astype(np.int64)
    if status in (-signal.SIGKILL, -signal.SIGSEGV, -signal.SIGABRT):
        cause = f"it was ended by {signal.Signals(-status).name}, often for want of memory"
    else:
        cause = said or f"exit status {status}"
    raise FeaError(
        f"The tet mesher failed ({cause}); try a larger edge than {edge:g}, or repair the surface."
    )


def _run_child(given: Path, made: Path) -> tuple[int, str]:
    """Exit status, and the last line of what the child wrote to stderr."""
    # The child finds this package wherever it is, installed or not.
    here = str(Path(__file__).resolve().parents[1])
    paths = [here, *filter(None, [os.environ.get("PYTHONPATH")])]
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(given), str(made)],
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
        raise FeaError(
            f"The tet mesher did not end within {MAX_SECONDS:g} s; take a larger edge."
        ) from failure
    finally:
        if child.poll() is None:
            child.kill()
            child.wait()
        if child.stderr is not None:
            child.stderr.close()
    lines = errors.decode(errors="replace").strip().splitlines()
    return child.returncode, lines[-1][:200] if lines else ""


def _child(given: str, made: str) -> None:
    """The body of the child process."""
    from pytetwild.pytetwild import tetrahedralize  # Only the child pays for it.

    with np.load(given) as surface:
        arrays = {name: surface[name] for name in surface.files}
    nodes, tets = tetrahedralize(
        arrays.pop("vertices"),
        arrays.pop("faces"),
        edge_length_abs=float(arrays.pop("edge_length_abs")),
        epsilon=float(arrays.pop("epsilon")),
        # Its own order gives negative volumes.
        vtk_ordering=True,
        quiet=True,
        **arrays,
    )
    np.savez(made, nodes=nodes, tets=tets)
