"""Whether a stiffness is that of a thin surface, such as a shell alone.

Multigrid is slow on those: a node gives way across the surface far more easily than along it, and
coarse nodes cannot follow. Direct solvers are at their best there: a surface falls apart along lines,
so that the fronts of their elimination stay small (George, "Nested dissection of a regular finite
element mesh", SIAM Journal on Numerical Analysis 10 (1973) 345-363).
"""

import numpy as np
from jaxtyping import Int
from scipy.sparse import bsr_array, csr_array
from scipy.sparse.csgraph import dijkstra

from fea.linear_solve.mkl_sparse import diagonal_blocks

# Least over largest stiffness of a node's displacement below which it is thin, for most nodes: shells
# have about the square of thickness over edge (1/20: 0.003), lattices 1, an octet block in a skin 0.1.
THIN = 0.05

# Widest front [dofs] of a surface for a direct solver: a plate of 320 x 320 squares, 616k dofs, has
# 3,800 and takes PARDISO 6 CPU seconds and 3 GB.
FRONT_LIMIT = 4000

# Nodes that are looked at.
SAMPLE = 2000


def is_thin_surface(K: bsr_array) -> bool:
    """Whether a direct solver is the better one, however many dofs there are.

    Args:
        K: in blocks of a node, displacements first.
    """
    return is_thin(K) and K.blocksize[0] * widest_front(K) <= FRONT_LIMIT


def is_thin(K: bsr_array) -> bool:
    """Whether most nodes give way far more easily in one direction than in another.

    Args:
        K: in blocks of a node, displacements first.
    """
    blocks = diagonal_blocks(K)[:, :3, :3]
    energy = np.linalg.eigvalsh(blocks[:: 1 + len(blocks) // SAMPLE])
    return bool(np.median(energy[:, 0] / energy[:, -1]) < THIN)


def widest_front(K: bsr_array) -> int:
    """Most nodes equally many edges away from one at the rim: about what separates two halves."""
    nodes = len(K.indptr) - 1
    graph = csr_array((np.ones(len(K.indices)), K.indices, K.indptr), (nodes, nodes))
    rim = int(np.argmax(_steps(graph, 0)))
    return int(np.bincount(_steps(graph, rim)).max())


def _steps(graph: csr_array, start: int) -> Int[np.ndarray, " nodes"]:
    """Edges from one node to every other; 0 where none lead."""
    steps = dijkstra(graph, unweighted=True, indices=start)
    return np.where(np.isfinite(steps), steps, 0).astype(int)
