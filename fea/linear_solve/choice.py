"""Which solver factorises which matrix; measured in docs/decisions/0001-linear-solver-choice.md."""

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from fea.errors import FeaError
from fea.linear_solve.amg import MultigridCG
from fea.linear_solve.direct_pardiso import Pardiso, is_installed
from fea.linear_solve.direct_superlu import SuperLU
from fea.linear_solve.interface import Factor, SolveFailure, order

SOLVERS = ("auto", "pardiso", "superlu", "amg")

# Largest model for a direct solver [dofs], from the table in the decision note. Frames (six dofs a
# joint) converge faster with multigrid than solids do, and fill in more.
PARDISO_LIMIT_SOLID = 100_000
PARDISO_LIMIT_FRAME = 60_000
SUPERLU_LIMIT = 20_000
FRAME_BLOCK = 6


def factorise(
    K: csr_array,
    *,
    near_null: Float[np.ndarray, "dofs modes"] | None = None,
    block: int = 1,
    solver: str = "auto",
) -> Factor:
    """Make a symmetric positive definite matrix ready for solving.

    Args:
        K: the matrix, both triangles, sorted columns.
        near_null: fields of almost no energy, the six rigid-body modes, for multigrid.
        block: dofs of a node.
        solver: "pardiso", "superlu", "amg", or "auto": direct for small models, multigrid for
            large ones.

    Raises:
        FeaError: when K is singular, or the solver is unknown or not installed.
    """
    name = chosen(order(K), solver, block=block, has_modes=near_null is not None)
    try:
        if name == "pardiso":
            return Factor(K, Pardiso(K), name)
        if name == "superlu":
            return Factor(K, SuperLU(K), name)
        if near_null is None:
            near_null = np.tile(np.eye(block), (order(K) // block, 1))
        return Factor(K, MultigridCG(K, near_null, block), name)
    except SolveFailure as failure:
        raise FeaError(failure.result.value) from failure


def chosen(dofs: int, solver: str, *, block: int, has_modes: bool) -> str:
    """Name of the solver that `factorise` takes for a matrix of this size.

    Args:
        dofs: size of the matrix.
        solver: the user's wish, one of `SOLVERS`.
        block: dofs of a node.
        has_modes: whether rigid-body modes are known; multigrid is slow without them.

    Raises:
        FeaError: when the wish is unknown or not installed.
    """
    if solver not in SOLVERS:
        raise FeaError(f'Solver "{solver}" is unknown; choose one of {", ".join(SOLVERS)}.')
    if solver == "pardiso" and not is_installed():
        raise FeaError(
            'Solver "pardiso" is not installed; install pypardiso, or choose "superlu" or "amg".'
        )
    if solver != "auto":
        return solver
    direct, limit = "superlu", SUPERLU_LIMIT
    if is_installed():
        direct = "pardiso"
        limit = PARDISO_LIMIT_FRAME if block == FRAME_BLOCK else PARDISO_LIMIT_SOLID
    return "amg" if dofs > limit and has_modes else direct
