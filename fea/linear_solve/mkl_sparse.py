"""Threaded products of sparse block matrices, by the MKL library that PARDISO comes with.

Where MKL is not installed SciPy's own products are used, on one core; results agree to rounding.
Names and codes are those of the oneMKL reference, "Inspector-executor Sparse BLAS Routines".
"""

import ctypes
import math
import weakref

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array

from fea.errors import FeaError
from fea.linear_solve.direct_pardiso import mkl_library
from fea.linear_solve.element_operator import matrix_shape

# Codes of MKL: a general matrix, as it stands, blocks stored row by row, indices from zero.
GENERAL, NON_TRANSPOSE, ROW_MAJOR, FROM_ZERO = 20, 10, 101, 0
ALLOCATION_FAILED = 2

# Letter in MKL's names, and the C type, of each precision.
PRECISIONS = {np.float64: ("d", ctypes.c_double), np.float32: ("s", ctypes.c_float)}


class MatrixDescription(ctypes.Structure):
    """`struct matrix_descr`: kind of matrix; triangle and diagonal are for special ones."""

    _fields_ = (("type", ctypes.c_int), ("mode", ctypes.c_int), ("diagonal", ctypes.c_int))


class ThreadedMatrix:
    """A block matrix whose products with vectors use all cores.

    Attributes:
        matrix: the matrix, in square blocks; MKL reads its arrays, so they must not be changed.
    """

    def __init__(self, matrix: bsr_array):
        self.matrix = in_blocks(matrix, math.gcd(*matrix.blocksize))
        # MKL refuses matrices without entries.
        self._library = mkl_library() if self.matrix.nnz else None
        if self._library is None:
            return
        letter, self._number = PRECISIONS[matrix.dtype.type]
        self._multiply = getattr(self._library, f"mkl_sparse_{letter}_mv")
        self._handle = _create(self._library, self.matrix)
        release = weakref.finalize(self, self._library.mkl_sparse_destroy, self._handle)
        # At interpreter exit MKL may be gone already, and the process returns its memory anyway.
        release.atexit = False

    def times(
        self,
        x: Float[np.ndarray, " columns"],
        into: Float[np.ndarray, " rows"] | None = None,
        *,
        alpha: float = 1.0,
        beta: float = 0.0,
    ) -> Float[np.ndarray, " rows"]:
        """Return alpha A x + beta y, written to y = `into` (a new vector if none is given)."""
        y = np.zeros(matrix_shape(self.matrix)[0], self.matrix.dtype) if into is None else into
        if self._library is None:
            y *= beta
            y += alpha * (self.matrix @ x)
            return y
        _check(
            self._multiply(
                NON_TRANSPOSE,
                self._number(alpha),
                self._handle,
                MatrixDescription(GENERAL, 0, 0),
                ctypes.c_void_p(x.ctypes.data),
                self._number(beta),
                ctypes.c_void_p(y.ctypes.data),
            )
        )
        return y


def multiply(a: bsr_array, b: bsr_array, *, ordered: bool = True) -> bsr_array:
    """The product A B of two float64 matrices of square blocks of one size.

    Args:
        a: the first matrix.
        b: the second.
        ordered: whether its columns shall be sorted, which takes a fifth of the time and
            factors of further products do not need.
    """
    library = mkl_library()
    if library is None or a.nnz == 0 or b.nnz == 0:
        product = bsr_array(a @ b, blocksize=a.blocksize)
        if ordered:
            product.sort_indices()
        return product
    result = ctypes.c_void_p()
    factors = _create(library, a), _create(library, b)
    try:
        _check(library.mkl_sparse_spmm(NON_TRANSPOSE, *factors, ctypes.byref(result)))
    finally:
        for handle in factors:
            library.mkl_sparse_destroy(handle)
    if ordered:
        _check(library.mkl_sparse_order(result))
    return _exported(library, result, (matrix_shape(a)[0], matrix_shape(b)[1]))


def in_blocks(matrix: bsr_array, size: int) -> bsr_array:
    """The same matrix in square blocks of a size that divides its own, with 32-bit indices."""
    down, along = matrix.blocksize[0] // size, matrix.blocksize[1] // size
    per_row = np.diff(matrix.indptr)
    indptr = np.concatenate([[0], np.cumsum(np.repeat(along * per_row, down))]).astype(np.int32)
    if down == along == 1:
        data = np.ascontiguousarray(matrix.data)
        return bsr_array((data, matrix.indices.astype(np.int32, copy=False), indptr), matrix.shape)
    # Where the parts of each block go: a block row becomes `down` rows of `along` times as many.
    row = np.repeat(np.arange(len(per_row)), per_row)
    inside = np.arange(len(row)) - matrix.indptr[row]
    first = indptr[down * row[:, None] + np.arange(down)] + along * inside[:, None]
    place = first[:, :, None] + np.arange(along)
    data = np.zeros((len(row) * down * along, size, size), matrix.dtype)
    # block, part down, row, part along, column -> block, part down, part along, row, column
    parts = matrix.data.reshape(-1, down, size, along, size).transpose(0, 1, 3, 2, 4)
    data[place] = parts
    indices = np.zeros(len(data), np.int32)
    indices[place] = along * matrix.indices[:, None, None] + np.arange(along)
    return bsr_array((data, indices, indptr), matrix.shape)


def single(matrix: bsr_array) -> bsr_array:
    """The same matrix in single precision; both share their indices."""
    parts = (matrix.data.astype(np.float32), matrix.indices, matrix.indptr)
    return bsr_array(parts, matrix.shape)


def merged_blocks(matrix: bsr_array, size: int) -> bsr_array:
    """Join square blocks into larger ones, each of which must be there as a whole."""
    parts = size // matrix.blocksize[0]
    if parts == 1:
        return matrix
    counts = np.diff(matrix.indptr)[::parts] // parts
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    row = np.repeat(np.arange(len(counts)), counts)
    inside = np.arange(len(row)) - indptr[row]
    first = matrix.indptr[parts * row[:, None] + np.arange(parts)] + parts * inside[:, None]
    place = first[:, :, None] + np.arange(parts)
    # block, part down, part along, row, column -> block, row, column
    data = matrix.data[place].transpose(0, 1, 3, 2, 4).reshape(-1, size, size)
    indices = (matrix.indices[place[:, 0, 0]] // parts).astype(np.int32)
    return bsr_array((data, indices, indptr), matrix.shape)


def diagonal_blocks(matrix: bsr_array) -> Float[np.ndarray, "nodes k k"]:
    """Diagonal blocks of a square matrix, zero where it has none."""
    row = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
    own = row == matrix.indices
    blocks = np.zeros((len(matrix.indptr) - 1, *matrix.blocksize), matrix.dtype)
    blocks[row[own]] = matrix.data[own]
    return blocks


def _create(library: ctypes.CDLL, matrix: bsr_array) -> ctypes.c_void_p:
    """MKL's handle of a matrix of square blocks; it points into the matrix' arrays."""
    handle = ctypes.c_void_p()
    size = matrix.blocksize[0]
    rows, columns = matrix_shape(matrix)
    starts = matrix.indptr.ctypes.data
    create = getattr(library, f"mkl_sparse_{PRECISIONS[matrix.dtype.type][0]}_create_bsr")
    _check(
        create(
            ctypes.byref(handle),
            FROM_ZERO,
            ROW_MAJOR,
            rows // size,
            columns // size,
            size,
            ctypes.c_void_p(starts),
            ctypes.c_void_p(starts + matrix.indptr.itemsize),
            ctypes.c_void_p(matrix.indices.ctypes.data),
            ctypes.c_void_p(matrix.data.ctypes.data),
        )
    )
    return handle


def _exported(library: ctypes.CDLL, handle: ctypes.c_void_p, shape: tuple[int, int]) -> bsr_array:
    """A float64 matrix that MKL made, in MKL's memory, which goes when its values do."""
    base, layout, rows, columns, size = (ctypes.c_int() for _ in range(5))
    starts, ends, indices = (ctypes.POINTER(ctypes.c_int)() for _ in range(3))
    data = ctypes.POINTER(ctypes.c_double)()
    found = (base, layout, rows, columns, size, starts, ends, indices, data)
    _check(library.mkl_sparse_d_export_bsr(handle, *map(ctypes.byref, found)))
    indptr = np.concatenate([[0], np.ctypeslib.as_array(ends, (rows.value,))]).astype(np.int32)
    blocks = int(indptr[-1])
    if blocks == 0:
        library.mkl_sparse_destroy(handle)
        return bsr_array(shape, blocksize=(size.value, size.value), dtype=np.float64)
    column = np.ctypeslib.as_array(indices, (blocks,)).copy()
    array = ctypes.c_double * (blocks * size.value**2)
    memory = ctypes.cast(data, ctypes.POINTER(array)).contents
    # Every array that looks at the values keeps `memory`.
    release = weakref.finalize(memory, library.mkl_sparse_destroy, handle)
    release.atexit = False
    values = np.ctypeslib.as_array(memory).reshape(blocks, size.value, size.value)
    return bsr_array((values, column, indptr), shape)


def _check(status: int) -> None:
    if status == ALLOCATION_FAILED:
        raise MemoryError
    if status:
        raise FeaError(
            f"MKL refused a sparse product (status {status}); choose another solver, such as "
            '"superlu".'
        )
