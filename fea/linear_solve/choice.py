"""Which solver factorises which matrix; measured in docs/decisions/0001-linear-solver-choice.md."""

import numpy as np
from jaxtyping import Float

from fea.errors import FeaError
from fea.linear_solve.amg import MultigridCG
from fea.linear_solve.cg_jax import JaxCG
from fea.linear_solve.direct_pardiso import Pardiso, is_installed
from fea.linear_solve.direct_superlu import SuperLU
from fea.linear_solve.element_operator import (
    MATRIX_FREE,
    ElementOperator,
    GivenMatrix,
    as_matrix,
    matrix_shape,
)
from fea.linear_solve.interface import Factor, prepared
from fea.linear_solve.thin_structures import is_thin_surface

SOLVERS = ("auto", "pardiso", "superlu", "amg", MATRIX_FREE)

# Largest model for a direct solver [dofs], from the table in the decision note. On frames of slender
# struts (six dofs a joint) multigrid needs some hundred iterations and PARDISO keeps up longer.
PARDISO_LIMIT_SOLID = 30_000
PARDISO_LIMIT_FRAME = 50_000
SUPERLU_LIMIT = 10_000
FRAME_BLOCK = 6


def factorise(
    K: GivenMatrix,
    *,
    near_null: Float[np.ndarray, "dofs modes"] | None = None,
    solver: str = "auto",
    definite: bool = False,
) -> Factor:
    """Make a symmetric positive definite matrix ready for solving.

    Args:
        K: the matrix, both triangles, in whole node blocks (`K.blocksize` of a `bsr_array`; other
            formats of SciPy and arrays have blocks of one dof) with all diagonal blocks; or an
            operator that is never assembled, for "jax-cg".
        near_null: fields of almost no energy, the six rigid-body modes: multigrid needs them to be
            fast, and every solver looks whether K resists them.
        solver: "pardiso", "superlu", "amg", "jax-cg", or "auto": direct for small models and thin
            shells, multigrid for large ones.
        definite: the caller has shown that no motion is free, so that none need be looked for
            before solving: a third of a direct factorisation, near half of multigrid's set-up. What a
            factorisation or a solution shows of its own is still refused.

    Raises:
        SingularStiffness: when K is singular, with the free motion.
        FeaError: when K is not finite, not float64 or not in whole blocks, or the solver is
            unknown, not installed or not for this K.
    """
    K = as_matrix(K)
    if isinstance(K, ElementOperator):
        if solver not in ("auto", MATRIX_FREE):
            raise FeaError(
                f'Solver "{solver}" needs an assembled matrix; assemble K, or choose '
                f'"{MATRIX_FREE}".'
            )
        return prepared(K, JaxCG(), MATRIX_FREE, near_null, definite=definite)
    size = K.blocksize[0]
    dofs = matrix_shape(K)[0]
    name = chosen(dofs, solver, block=size, has_modes=near_null is not None)
    if solver == "auto" and name == "amg" and size == FRAME_BLOCK and is_installed():
        name = "pardiso" if is_thin_surface(K) else name
    fields = np.tile(np.eye(size), (dofs // size, 1)) if near_null is None else near_null
    methods = {
        "pardiso": Pardiso,
        "superlu": SuperLU,
        "amg": lambda: MultigridCG(fields),
        MATRIX_FREE: JaxCG,
    }
    return prepared(K, methods[name](), name, near_null, definite=definite)


def chosen(dofs: int, solver: str, *, block: int, has_modes: bool) -> str:
    """Name of the solver that `factorise` takes for a matrix of this size, unless it is a thin shell.

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
