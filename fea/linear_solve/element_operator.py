"""A stiffness that is never assembled: products and diagonal blocks, in JAX."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.sparse import bsr_array, bsr_matrix, csr_array, issparse, sparray, spmatrix

from fea.errors import FeaError
from fea.precision import as_float64

# Solver of operators that are never assembled.
MATRIX_FREE = "jax-cg"


class ElementOperator(eqx.Module):
    """A symmetric positive definite operator on fields with `block` values at each of n nodes.

    Attributes:
        matvec: the product with a field, in pure JAX; fixed dofs act as identity and couple to
            nothing. A pytree whose leaves are the arrays it needs, such as
            `jax.tree_util.Partial(product, element_matrices, tets)`: new arrays then need no new
            compilation, where a closure would be compiled for each.
        diagonal: diagonal blocks of the nodes.
    """

    matvec: Callable[[Float[Array, "n block"]], Float[Array, "n block"]]
    diagonal: Float[Array, "n block block"]

    @property
    def block(self) -> int:
        """Dofs of a node."""
        return self.diagonal.shape[1]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, dofs of node 0 first."""
        dofs = self.diagonal.shape[0] * self.diagonal.shape[1]
        return dofs, dofs

    def __matmul__(self, x: Float[np.ndarray, "dofs ..."]) -> Float[np.ndarray, "dofs ..."]:
        """Products with the columns of a NumPy array."""
        if x.ndim == 1:
            return np.asarray(_product(self, jnp.asarray(x)))
        columns = [self @ np.ascontiguousarray(column) for column in x.T]
        return np.stack(columns, axis=1) if columns else x.copy()


def masked_blocks(
    blocks: Float[Array, "n block block"], free: Bool[Array, "n block"]
) -> Float[Array, "n block block"]:
    """Diagonal blocks of an operator whose fixed dofs act as identity and couple to nothing."""
    held = jnp.where(free[:, :, None] & free[:, None, :], blocks, 0.0)
    return held + jnp.eye(free.shape[1])[None] * jnp.where(free, 0.0, 1.0)[:, None, :]


@eqx.filter_jit
def _product(operator: ElementOperator, x: Float[Array, " dofs"]) -> Float[Array, " dofs"]:
    return operator.matvec(x.reshape(operator.diagonal.shape[:2])).reshape(-1)


# A stiffness as solvers take it: assembled in whole node blocks, or a rule for products.
Matrix = bsr_array | ElementOperator

# And as they may be given.
GivenMatrix = sparray | spmatrix | np.ndarray | ElementOperator


def as_matrix(K: GivenMatrix) -> Matrix:
    """A stiffness in square blocks with sorted columns, each entry stored once.

    Args:
        K: any matrix of SciPy or NumPy; only `bsr_array` and `bsr_matrix` have blocks, others get
            blocks of one dof. An operator stays as it is.

    Raises:
        FeaError: when it is no matrix of real numbers, not square, or its blocks are not.
    """
    if isinstance(K, ElementOperator):
        return K
    if not issparse(K) and not (isinstance(K, np.ndarray) and K.ndim == 2):
        raise FeaError(
            f"The stiffness is a {type(K).__name__}; give a sparse matrix of SciPy or a "
            "two-dimensional array."
        )
    blocks = K if isinstance(K, bsr_array | bsr_matrix) else csr_array(K).tobsr((1, 1))
    rows, columns = blocks.blocksize
    down, along = matrix_shape(blocks)
    if down != along or rows != columns:
        raise FeaError(
            f"The stiffness has {down} rows and {along} columns in blocks of {rows} by {columns}; "
            "give a square matrix in square blocks."
        )
    data = as_float64(blocks.data, "Entries of the stiffness matrix")
    matrix = bsr_array((data, blocks.indices, blocks.indptr), blocks.shape)
    if not matrix.has_canonical_format:
        matrix = matrix.copy()  # what the caller gave stays as it is
        matrix.sum_duplicates()
    return matrix


def matrix_shape(K: Matrix | csr_array | bsr_matrix) -> tuple[int, int]:
    """Rows and columns; SciPy's own annotation of `shape` allows None."""
    rows, columns = K.shape  # pyright: ignore[reportGeneralTypeIssues]
    return int(rows), int(columns)
