"""What is asked of every stiffness, whatever the solver: finite, positive, no motion free.

A motion v is free when its energy vᵀ K v is rounding. Every entry of K carries a relative error of
about eps, of either sign, so the energy carries eps sqrt(Σ (v_i K_ij v_j)²). Measured energies of free
solids and bars are within once this noise; a clamped bar 1000 times as long as thick, whose softest
motion has an energy of only 7e-14 (K of unit diagonal), is 1600 times above it.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array

from fea.linear_solve.element_operator import ElementOperator, Matrix
from fea.linear_solve.solve_result import SolveFailure, SolveResult
from fea.precision import refuse_single_precision

# A motion counts as free when its energy is below this many times the noise.
FREE = 10.0

# And as too soft to be solved for when noise leaves less than two digits of its energy.
SOFT = 100.0

# Directions of the given fields smaller than this share of the largest are rounding.
DEPENDENT = 1e-12

# Steps of inverse iteration. Each divides everything but the softest motion by its ratio of
# stiffness to the softest one; for a free motion the first step is enough.
INVERSE_ITERATIONS = 3

# Stiffness added to the diagonal, as a share of it, so that a singular matrix can be factorised and
# its free motion found: far above rounding, far below the softest motion of other kinds.
SHIFT = 1e-10


# Relative residuals of multigrid's probe for free motions, and the share of a field that may be lost
# in it. Where all was held, solids lost 0.1 % of it, slender frames 7 %, at a third of the iterations of a
# solve; a free motion is most of the field.
ROUGH, HALF_SOLVED, LOST = 0.3, 1e-2, 0.3

# Steps that take rounding of single precision off a free motion: 74 times the noise became 5 after 6
# steps, 2 after 12 and 0.2 after 18.
DESCENTS = 24

# A motion whose energy, over that of its dofs moved one by one, is above this is held; below, it is
# compared with the noise. A clamped bar 100 times as long as thick under an end load has 7e-10.
STIFF = 1e-9


def check_matrix(K: Matrix) -> None:
    """See that all entries are float64 and finite, those of the diagonal positive.

    Raises:
        FeaError: for single precision.
        SolveFailure: otherwise; the free motion of a dof without stiffness is that dof.
    """
    values = np.asarray(K.diagonal) if isinstance(K, ElementOperator) else K.data
    refuse_single_precision(values, "Entries of the stiffness matrix")
    if not np.isfinite(values).all():
        raise SolveFailure(SolveResult.NOT_FINITE)
    diagonal = diagonal_of(K)
    if not (diagonal > 0).all():
        mode = np.zeros(len(diagonal))
        mode[np.argmin(diagonal)] = 1.0
        raise SolveFailure(SolveResult.SINGULAR, mode)
    if isinstance(K, ElementOperator) and not np.isfinite(K @ np.ones(len(diagonal))).all():
        raise SolveFailure(SolveResult.NOT_FINITE)


def check_rigid_motion(K: Matrix, near_null: Float[np.ndarray, "dofs modes"]) -> None:
    """See that K resists every combination of the given fields.

    Conjugate gradients converge on a singular system when the load happens to be consistent, so
    free motion has to be looked for.

    Raises:
        SolveFailure: with the combination that is free.
    """
    weight = near_null.T @ (diagonal_of(K)[:, None] * near_null)
    size, directions = np.linalg.eigh(weight)
    keep = size > DEPENDENT * size[-1]
    basis = near_null @ (directions[:, keep] / np.sqrt(size[keep]))
    if basis.shape[1]:
        _, combination = np.linalg.eigh(basis.T @ (K @ basis))
        check_motion(K, basis @ combination[:, 0])


def check_definite(K: bsr_array, solve: Callable[[np.ndarray], np.ndarray]) -> None:
    """Tell a singular matrix from a definite one after a direct factorisation.

    Rounding can turn the zero pivots of a free motion into small positive ones. Inverse iteration
    from a rough field finds the softest motion.

    Args:
        K: the matrix.
        solve: K⁻¹ times columns.

    Raises:
        SolveFailure: when that motion is free, or too soft to be computed.
    """
    check_motion(K, softest_motion(K, solve))


def check_solution(
    K: Matrix, x: Float[np.ndarray, "dofs columns"], b: Float[np.ndarray, "dofs columns"]
) -> None:
    """See that an iterative solver's solutions are no free motions that the load set going.

    Raises:
        SolveFailure: when one is free, or too soft to be computed.
    """
    size = np.einsum("i,ij,ij->j", diagonal_of(K), x, x)
    energy = np.einsum("ij,ij->j", x, b)
    for column in np.flatnonzero(energy < STIFF * size):
        check_motion(K, np.ascontiguousarray(x[:, column]))


def check_held(K: Matrix, solve: Callable[[np.ndarray, float], np.ndarray]) -> None:
    """Look for a free motion that is not rigid, such as a hinge, with an iterative solver.

    The iteration converges whenever the load does no work on such a motion. But it cannot give
    back a field that contains it: y - K⁻¹ K y keeps just that part.

    Args:
        K: the stiffness.
        solve: K⁻¹ times columns, to a relative residual.

    Raises:
        SolveFailure: when a motion is free, or too soft to be computed.
    """
    root = np.sqrt(diagonal_of(K))
    rough = root * np.random.default_rng(0).standard_normal(len(root))  # the same every time
    y = solve(rough[:, None], ROUGH)  # mostly the softest motions
    lost = y - solve(K @ y, HALF_SOLVED)
    if np.linalg.norm(root * lost[:, 0]) > LOST * np.linalg.norm(root * y[:, 0]):
        lost -= solve(K @ lost, SHIFT)
        check_motion(K, _without_roughness(K, lost[:, 0]))


def _without_roughness(K: Matrix, motion: Float[np.ndarray, " dofs"]) -> Float[np.ndarray, " dofs"]:
    """A motion with less energy, by steepest descent scaled with the diagonal.

    Multigrid's single precision leaves roughness on a free motion, which has energy.
    """
    diagonal = diagonal_of(K)
    for _ in range(DESCENTS):
        force = K @ motion
        down = force / diagonal
        work, energy = float(down @ force), float(down @ (K @ down))
        if not (work > 0 and energy > 0):
            break
        motion = motion - work / energy * down
    return motion


def softest_motion(
    K: bsr_array, solve: Callable[[np.ndarray], np.ndarray]
) -> Float[np.ndarray, " dofs"]:
    """The field with the least energy for its size, on K of unit diagonal, by inverse iteration."""
    root = np.sqrt(K.diagonal())
    y = np.random.default_rng(0).standard_normal(len(root))  # the same field every time
    for _ in range(INVERSE_ITERATIONS):
        y = root * solve((root * y / np.abs(y).max())[:, None])[:, 0]
        if not np.isfinite(y).all():
            raise SolveFailure(SolveResult.SINGULAR)
    return y / (root * np.abs(y).max())


def shifted(K: bsr_array) -> bsr_array:
    """K with a diagonal a little larger, which can be factorised when K is only just singular."""
    data = K.data.copy()
    row = np.repeat(np.arange(len(K.indptr) - 1), np.diff(K.indptr))
    own = np.flatnonzero(row == K.indices)
    place = np.arange(K.blocksize[0])
    data[own[:, None], place, place] *= 1 + SHIFT
    return bsr_array((data, K.indices, K.indptr), K.shape)


def check_motion(K: Matrix, motion: Float[np.ndarray, " dofs"]) -> None:
    """See that a motion has energy well above rounding.

    Raises:
        SolveFailure: when it is free, with the motion, or too soft to be computed.
    """
    energy = float(motion @ (K @ motion))
    if energy > STIFF * float(diagonal_of(K) @ motion**2):
        return
    noise = _noise(K, motion)
    if not energy > FREE * noise:
        raise SolveFailure(SolveResult.SINGULAR, motion)
    if energy < SOFT * noise:
        figures = f"a soft motion has {energy / noise:.2g} times the energy that rounding gives it"
        raise SolveFailure(SolveResult.INACCURATE, figures=f"{figures}, limit {SOFT:g}")


def diagonal_of(K: Matrix) -> Float[np.ndarray, " dofs"]:
    """Diagonal entries."""
    if isinstance(K, ElementOperator):
        return np.einsum("nii->ni", np.asarray(K.diagonal)).reshape(-1)
    return K.diagonal()


def _noise(K: Matrix, motion: Float[np.ndarray, " dofs"]) -> float:
    """Rounding in the energy of a motion, if every entry of K has a relative error of eps."""
    square = motion**2
    if isinstance(K, ElementOperator):
        # The blocks beside the diagonal are not at hand; together they are about as large.
        own = np.einsum("nij,nj->ni", np.asarray(K.diagonal) ** 2, square.reshape(-1, K.block))
        total = 2 * float(square @ own.reshape(-1))
    else:
        total = float(square @ (bsr_array((K.data**2, K.indices, K.indptr), K.shape) @ square))
    return np.finfo(float).eps * np.sqrt(total)
