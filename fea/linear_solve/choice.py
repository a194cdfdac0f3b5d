"""Which solver factorises which matrix; measured in docs/decisions/0001-linear-solver-choice.md."""

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array, csr_array

from fea.errors import FeaError
from fea.linear_solve.amg import MultigridCG
from fea.linear_solve.cg_jax import JaxCG
from fea.linear_solve.direct_pardiso import Pardiso, is_installed
from fea.linear_solve.direct_superlu import SuperLU
from fea.linear_solve.element_operator import ElementOperator, matrix_shape
from fea.linear_solve.interface import Factor, prepared

SOLVERS = ("auto", "pardiso", "superlu", "amg", "jax-cg")

# Largest model for a direct solver [dofs], from the table in the decision note. On frames of slender
# struts (six dofs a joint) multigrid needs some hundred iterations and PARDISO keeps up longer.
PARDISO_LIMIT_SOLID = 30_000
PARDISO_LIMIT_FRAME = 50_000
SUPERLU_LIMIT = 10_000
FRAME_BLOCK = 6


def factorise(
    K: bsr_array | csr_array | ElementOperator,
    *,
    near_null: Float[np.ndarray, "dofs modes"] | None = None,
    solver: str = "auto",
) -> Factor:
    """Make a symmetric positive definite matrix ready for solving.

    Args:
        K: the matrix, both triangles, in whole node blocks (`K.blocksize`) with all diagonal
            blocks (a `csr_array` has blocks of one dof); or an operator that is never assembled,
            for "jax-cg".
        near_null: fields of almost no energy, the six rigid-body modes: multigrid needs them to be
            fast, and every solver looks whether K resists them.
        solver: "pardiso", "superlu", "amg", "jax-cg", or "auto": direct for small models,
            multigrid for large ones.

    Raises:
        SingularStiffness: when K is singular, with the free motion.
        FeaError: when K is not finite, not float64 or not in whole blocks, or the solver is
            unknown, not installed or not for this K.
    """
    if isinstance(K, ElementOperator):
        if solver not in ("auto", "jax-cg"):
            raise FeaError(
                f'Solver "{solver}" needs an assembled matrix; assemble K, or choose "jax-cg".'
            )
        return prepared(K, JaxCG(), "jax-cg", near_null)
    K = _blocks(K)
    size = K.blocksize[0]
    dofs = matrix_shape(K)[0]
    name = chosen(dofs, solver, block=size, has_modes=near_null is not None)
    fields = np.tile(np.eye(size), (dofs // size, 1)) if near_null is None else near_null
    methods = {
        "pardiso": Pardiso,
        "superlu": SuperLU,
        "amg": lambda: MultigridCG(fields),
        "jax-cg": JaxCG,
    }
    return prepared(K, methods[name](), name, near_null)


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


def _blocks(K: bsr_array | csr_array) -> bsr_array:
    """K in square blocks with sorted columns."""
    if isinstance(K, csr_array):
        K = bsr_array(K, blocksize=(1, 1))
    rows, columns = K.blocksize
    down, along = matrix_shape(K)
    if down != along or rows != columns:
        raise FeaError(
            f"The stiffness has {down} rows and {along} columns in blocks of {rows} by {columns}; "
            "give a square matrix in square blocks."
        )
    return K if K.has_sorted_indices else K.sorted_indices()
