"""Meshes refined until the estimated error of the stress is small enough.

Each round solves, estimates, and asks the mesher for a new mesh whose edges spread the error evenly
(Zienkiewicz and Zhu, Int. J. Numer. Meth. Eng. 24 (1987) 337-357): many where the stress changes fast,
as at a re-entrant corner, few elsewhere.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fea.error_estimate import ErrorEstimate
from fea.errors import FeaError
from fea.sizing_field import Sizing, graded, nodal_edges, tets_wanted
from fea.solid import SolidSolution
from fea.tet_mesh import TetMesh

# Each round aims below the share asked for: meshes differ from what was wanted of them.
AIM = 0.9
# Meshes that a round may ask for before one has few enough nodes.
MESHES_PER_ROUND = 3
# Edges come out longer than wanted, since a mesher splits those far above it: with fTetWild by a tenth
# where the wish is even, by half where it is smallest. Shorter ones are asked for by this. Without, the
# L-bracket's error stalls at 7 %.
OVERSHOOT = 1.35
# Least step in which edges grow until the nodes that they ask for are allowed.
LEAST_FACTOR = 1.02
# A mesh with more nodes than allowed is asked for again with this share of them.
ROOM = 0.9
# A round that is short of nodes and brings the error down by less than this share is the last.
WORTHWHILE = 0.05


@dataclass(frozen=True)
class Round:
    """One mesh on the way.

    Attributes:
        nodes: number of nodes.
        cells: number of tetrahedra.
        relative: estimated error over the energy norm, the largest of all load cases.
        seconds: time of meshing, solving and estimating [s].
    """

    nodes: int
    cells: int
    relative: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Adapted:
    """The best mesh found.

    Attributes:
        solution: on the mesh of the least estimated error.
        history: every round, in order.
        message: empty when the error is as small as asked; else one sentence that says how small
            it got and what to do.
    """

    solution: SolidSolution
    history: tuple[Round, ...]
    message: str

    @property
    def mesh(self) -> TetMesh:
        """The mesh of the least estimated error."""
        return self.solution.problem.mesh

    @property
    def estimate(self) -> ErrorEstimate:
        """The estimated error on it."""
        return self.solution.error_estimate

    @property
    def converged(self) -> bool:
        """Whether the estimated error is at most the share asked for."""
        return not self.message


def refine(
    mesher: Callable[[Sizing | None], TetMesh],
    solve: Callable[[TetMesh], SolidSolution],
    *,
    share: float,
    rounds: int = 6,
    max_nodes: int,
    throw: bool = True,
) -> Adapted:
    """Remesh until the estimated error is at most a share of the energy norm.

    Args:
        mesher: makes a mesh of the solid, of tet4 or tet10, with edges as wanted; None asks for the
            first one. `fea.ftetwild.tetrahedralise` makes none coarser than its `edge`: start coarse.
        solve: solves all load cases on a mesh.
        share: largest estimated error over energy norm, in every load case.
        rounds: most meshes that are solved.
        max_nodes: most nodes of any of them.
        throw: whether an error above the share is raised; else it is told in `message`.

    Raises:
        FeaError: impossible wishes; a first mesh of more than `max_nodes`; whatever `mesher` and
            `solve` raise; and, unless `throw` is False, an error that stays above the share.
    """
    if not 0 < share < 1:
        raise FeaError(f"share = {share:g}: must be above 0 and below 1, such as 0.05.")
    if rounds < 1:
        raise FeaError(f"rounds = {rounds}: must be at least 1.")
    begun = time.perf_counter()
    mesh = mesher(None)
    if len(mesh.nodes) > max_nodes:
        raise FeaError(
            f"The first mesh has {len(mesh.nodes):,} nodes, more than the {max_nodes:,} allowed; start "
            "with a larger edge, or allow more nodes."
        )
    coarsest = float(nodal_edges(_corner_mesh(mesh)[0]).max())
    best: SolidSolution | None = None
    history: list[Round] = []
    wish: _Wish | None = None
    while True:
        solution = solve(mesh)
        error = _error(solution)
        now = time.perf_counter()
        history.append(Round(len(mesh.nodes), len(mesh.tets), error, now - begun))
        begun = now
        gain = 1.0 if best is None else 1 - error / _error(best)
        if best is None or gain > 0:
            best = solution
        stuck = wish is not None and wish.short and gain < WORTHWHILE
        if error <= share or stuck or len(history) == rounds:
            break
        size = solution.error_estimate.wanted_size(share=AIM * share)
        wish = _wish(mesh, size, max_nodes, coarsest)
        remeshed = _mesh_within(mesher, wish.sizing, max_nodes)
        if remeshed is None:
            break
        mesh = remeshed
    message = _message(history, wish, share=share, rounds=rounds, max_nodes=max_nodes)
    if message and throw:
        raise FeaError(message)
    return Adapted(best, tuple(history), message)


@dataclass(frozen=True, eq=False)
class _Wish:
    """What the next mesh is to be.

    Attributes:
        sizing: its wanted edges.
        short: whether they are larger than the estimate asks, for want of nodes.
        needed: nodes that the estimate asks for.
    """

    sizing: Sizing
    short: bool
    needed: int


def _wish(
    mesh: TetMesh, size: Float[np.ndarray, " nodes"], max_nodes: int, coarsest: float
) -> _Wish:
    corners, used = _corner_mesh(mesh)
    current = nodal_edges(corners)
    # Nodes of this mesh for each tet that its own edges would ask for: the same on the next mesh.
    per_tet = len(mesh.nodes) / tets_wanted(corners, current)
    edge = graded(corners, np.minimum(size[used] / OVERSHOOT, coarsest))
    needed = per_tet * tets_wanted(corners, edge)
    allowed, factor = ROOM * max_nodes, 1.0
    wanted, count = edge, needed
    while count > allowed:
        factor *= max((count / allowed) ** (1 / 3), LEAST_FACTOR)
        wanted = graded(corners, factor * edge)
        count = per_tet * tets_wanted(corners, wanted)
    return _Wish(Sizing.around(corners, wanted), factor > 1, int(needed))


def _corner_mesh(mesh: TetMesh) -> tuple[TetMesh, Int[np.ndarray, " corners"]]:
    """The mesh without its mid-edge nodes, and the numbers of the nodes that remain."""
    used, tets = np.unique(mesh.tets[:, :4], return_inverse=True)
    return TetMesh(mesh.nodes[used], tets.reshape(-1, 4).astype(np.int64)), used


def _mesh_within(
    mesher: Callable[[Sizing | None], TetMesh], sizing: Sizing, max_nodes: int
) -> TetMesh | None:
    """A mesh of at most so many nodes; None when the mesher makes more whatever is wanted."""
    for _ in range(MESHES_PER_ROUND):
        mesh = mesher(sizing)
        if len(mesh.nodes) <= max_nodes:
            return mesh
        sizing = sizing.scaled((len(mesh.nodes) / (ROOM * max_nodes)) ** (1 / 3))
    return None


def _error(solution: SolidSolution) -> float:
    return float(np.max(solution.error_estimate.relative))


def _message(
    history: list[Round], wish: _Wish | None, *, share: float, rounds: int, max_nodes: int
) -> str:
    """Empty when the share is reached; else how far it got and what to do."""
    best = min(history, key=lambda done: done.relative)
    if best.relative <= share:
        return ""
    remedies = []
    if wish is not None and (wish.short or len(history) < rounds):
        remedies.append(
            f"allow more than {max_nodes:,} nodes (about {wish.needed:,} are asked for)"
        )
    if len(history) == rounds:
        remedies.append(f"allow more than {rounds} rounds")
    return (
        f"The estimated error is {100 * best.relative:.2g} % with {best.nodes:,} nodes after "
        f"{len(history)} of {rounds} rounds, wanted {100 * share:.2g} %; {' or '.join(remedies)}."
    )
