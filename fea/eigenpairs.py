"""Lowest positive eigenvalues of K x = lambda B x: buckling (B = -Kg) and vibration (B = M).

With mu = 1/lambda this is B x = mu K x, K positive definite, and the largest mu are wanted: the
largest in value, not in magnitude, since B = -Kg has both signs and a negative mu belongs to the
reversed load.

A block Krylov method that solves for residuals: the basis V is orthonormal in K, the best that it
holds are the eigenvectors of V' B V (Rayleigh, Ritz), and each step adds K⁻¹ r of their residuals
r = B x - mu K x. With an exact K⁻¹ that is the block Lanczos method of Grimes, Lewis, Simon (SIAM
J. Matrix Anal. Appl. 15 (1994) 228-272); with a rough one, such as a few iterations of conjugate
gradients, it still converges to the true eigenpairs since residuals are true ones (generalised
Davidson: Morgan, Scott, SIAM J. Sci. Stat. Comput. 7 (1986) 817-825), and the multigrid solver saves
most of its iterations. A block of several vectors finds as many copies of a repeated eigenvalue,
which the symmetry of lattices, and of any strut, brings; a single starting vector finds one.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.sparse import bsr_array

from fea.errors import FeaError
from fea.linear_solve import Factor
from fea.linear_solve.element_operator import Matrix, matrix_shape

# |K x - lambda B x| / |K x| wanted. An eigenvalue's error is about its square, that of derivatives
# about its ratio to the gap between eigenvalues.
RELATIVE_RESIDUAL = 1e-8

# The same that still counts as solved where rounding ends the descent, as for linear solves.
RESIDUAL_LIMIT = 1e-6

# Vectors of the block beyond the modes that are asked for, for copies of a repeated eigenvalue. They
# need only be known this well: enough to have overtaken a copy that came late.
GUARDS = 2
GUARD_RESIDUAL = 1e-2

# Residual of K⁻¹ r asked of an iterative solver: the step that it makes is then wrong by a hundredth.
# Octet 16^3 by multigrid, lowest buckling factor: 14 s; with 1e-1 20 s, with 1e-6 28 s.
ROUGH = 1e-2

# Dofs up to which all eigenvalues are computed densely, a tenth of a second.
DENSE = 300

# Steps of the block, and size of the basis in blocks at which it is condensed to its best vectors.
STEPS = 100
BASIS_BLOCKS = 20
KEPT_BLOCKS = 5

# Steps after which a block that has met no positive eigenvalue is believed. Krylov spaces approach
# both ends of a spectrum first.
STEPS_TO_POSITIVE = 15

# Share of the largest |mu| below which mu counts as zero.
NOTHING = 1e-10

# Share of the longest below which a direction adds nothing to the basis.
DEPENDENT = 1e-12

# Starting vectors are the same in every run.
SEED = 0


class EigenResult(Enum):
    """How an eigenvalue analysis ended; the value is the sentence for the user."""

    CONVERGED = ""
    NONE_POSITIVE = (
        "No eigenvalue is positive: nothing is in compression under this load, so no multiple of it "
        "buckles the structure. Reverse the load, or choose another case."
    )
    TOO_FEW = (
        "The structure has fewer modes than were asked for: beyond those given no eigenvalue is "
        "positive. Ask for fewer."
    )
    NOT_CONVERGED = (
        "The eigenvalue iteration did not converge: too many modes lie close together, or rounding "
        'hides them. Ask for more modes, or use a direct solver (solver="pardiso" or "superlu").'
    )


@dataclass(frozen=True, eq=False)
class EigenPairs:
    """Lowest positive eigenvalues of K x = lambda B x, ascending, each with its multiplicity.

    Attributes:
        values: lambda; NaN where there is none.
        vectors: one a column, x' K x = 1.
        residual: |K x - lambda B x| / |K x| of each, computed from x itself.
        result: how the analysis ended.
        steps: of the block; 0 for a dense analysis.
    """

    values: Float[np.ndarray, " modes"]
    vectors: Float[np.ndarray, "dofs modes"]
    residual: Float[np.ndarray, " modes"]
    result: EigenResult
    steps: int


def lowest_eigenpairs(
    factor: Factor,
    B: bsr_array,
    *,
    modes: int,
    without: Float[np.ndarray, "dofs columns"] | None = None,
    throw: bool = True,
) -> EigenPairs:
    """Find the lowest positive eigenvalues of K x = lambda B x.

    Args:
        factor: of K, symmetric positive definite.
        B: symmetric.
        modes: how many.
        without: eigenvectors to leave out, linearly independent.
        throw: raise when there are not so many or they do not converge; otherwise the result says
            so.

    Raises:
        FeaError: the sentence of the `EigenResult` with its figures, when `throw`; always when
            the factor is spent, `modes` is less than one or B is not finite.
    """
    factor.refuse_when_spent()
    if modes < 1:
        raise FeaError(f"modes = {modes}; ask for at least one.")
    if not np.isfinite(B.data).all():
        raise FeaError(
            "The eigenproblem contains NaN or infinite numbers; check displacements and densities."
        )
    dofs = matrix_shape(B)[0]
    held = np.zeros((dofs, 0)) if without is None else without
    if not B.data.any():
        found = _found(factor.K, B, np.zeros(0), np.zeros((dofs, 0)), modes, 0)
    else:
        found = (_dense if dofs <= DENSE else _krylov)(factor, B, modes, held)
    if throw and found.result is not EigenResult.CONVERGED:
        raise FeaError(f"{found.result.value} {_figures(found)}")
    return found


def _figures(found: EigenPairs) -> str:
    known = int(np.isfinite(found.values).sum())
    if known == 0:
        return f"(0 of {len(found.values)} modes found)"
    worst = float(np.nanmax(found.residual))
    return f"({known} of {len(found.values)} modes found, residual {worst:.2g})"


def _dense(
    factor: Factor, B: bsr_array, modes: int, held: Float[np.ndarray, "dofs columns"]
) -> EigenPairs:
    K, identity = factor.K, np.eye(len(held))
    dense = np.asarray(K @ identity)
    free = identity
    if held.shape[1]:
        # What is orthogonal in K to the vectors to leave out.
        free = np.linalg.qr(dense @ held, mode="complete")[0][:, held.shape[1] :]
    mu, y = eigh(free.T @ (B @ free), free.T @ dense @ free)
    x = free @ y
    return _found(K, B, mu[::-1], x[:, ::-1], modes, 0)


def _krylov(
    factor: Factor, B: bsr_array, modes: int, held: Float[np.ndarray, "dofs columns"]
) -> EigenPairs:
    K, block = factor.K, modes + GUARDS
    rng = np.random.default_rng(SEED)
    basis = _Basis(K, held, room=BASIS_BLOCKS * block)
    # K⁻¹ B makes noise smooth, and zero where dofs are fixed.
    added = basis.extend(
        _roughly(factor, basis.balanced(B @ rng.standard_normal((len(held), block))))
    )
    if added.shape[1] == 0:
        return _found(K, B, np.zeros(0), np.zeros((len(held), 0)), modes, 0)
    T, step = np.zeros((0, 0)), 0
    while True:
        step += 1
        V = basis.vectors
        T = _bordered(T, V, B @ added)
        mu, y = (part[..., ::-1] for part in np.linalg.eigh(T))
        x = V @ y[:, :block]
        Kx = K @ x
        r = B @ x - Kx * mu[:block]
        rough = _relative(r, mu[:block], Kx) > _limits(mu[:block], modes)
        hopeless = step >= STEPS_TO_POSITIVE and mu[0] <= NOTHING * np.abs(mu).max()
        if hopeless or step == STEPS or not rough.any():
            break
        if V.shape[1] + block > BASIS_BLOCKS * block:
            kept = KEPT_BLOCKS * block
            basis.condense(y[:, :kept])
            T = np.diag(mu[:kept])
        added = basis.extend(_roughly(factor, basis.balanced(r[:, rough])))
        if added.shape[1] == 0:
            break
    return _found(K, B, mu, x, modes, step)


class _Basis:
    """Vectors orthonormal in K, and orthogonal in K to some that are held apart.

    Attributes:
        vectors: the basis, one a column.
    """

    def __init__(self, K: Matrix, held: Float[np.ndarray, "dofs columns"], *, room: int):
        self._K = K
        self._held = held.shape[1]
        # By columns, so that part of them is one piece of memory.
        self._space = np.zeros((len(held), self._held + room), order="F")
        self._count = 0
        self._count = self.extend(held).shape[1]
        if self._count != self._held:
            raise ValueError("vectors to leave out are linearly dependent")

    @property
    def vectors(self) -> Float[np.ndarray, "dofs basis"]:
        """Those not held apart."""
        return self._space[:, self._held : self._count]

    def balanced(self, loads: Float[np.ndarray, "dofs columns"]) -> np.ndarray:
        """The part of loads that does no work on the vectors held apart.

        K hardly resists those, so that K⁻¹ would make much of what rounding leaves of it.
        """
        Q = self._space[:, : self._held]
        return loads - self._K @ (Q @ (Q.T @ loads))

    def extend(self, D: Float[np.ndarray, "dofs columns"]) -> Float[np.ndarray, "dofs added"]:
        """Add what D spans beyond the basis, and return it."""
        V = self._space[:, : self._count]
        for _ in range(2):  # once more for what rounding left
            D = D - V @ (V.T @ (self._K @ D))
            # What is left may be a small part of what there was, so that its lengths are computed anew.
            gram = D.T @ (self._K @ D)
            length = np.sqrt(np.maximum(np.diag(gram), 0.0))
            unit = np.where(length > 0, length, 1.0)
            size, mix = np.linalg.eigh(gram / np.outer(unit, unit))
            kept = size > DEPENDENT
            D = (D / unit) @ (mix[:, kept] / np.sqrt(size[kept]))
        self._space[:, self._count : self._count + D.shape[1]] = D
        self._count += D.shape[1]
        return D

    def condense(self, mix: Float[np.ndarray, "basis kept"]) -> None:
        """Keep these orthonormal combinations of the basis only."""
        kept = self.vectors @ mix
        self._count = self._held + mix.shape[1]
        self._space[:, self._held : self._count] = kept


def _limits(mu: Float[np.ndarray, " block"], modes: int) -> Float[np.ndarray, " block"]:
    """Residuals wanted of a block, its guards last; those without a positive mu do not count."""
    limits = np.full(len(mu), GUARD_RESIDUAL)
    limits[modes:][mu[modes:] <= NOTHING * np.abs(mu).max()] = np.inf
    limits[:modes] = RELATIVE_RESIDUAL
    return limits


def _roughly(factor: Factor, rhs: Float[np.ndarray, "dofs columns"]) -> np.ndarray:
    return np.asarray(factor.solve(rhs, rtol=ROUGH).x)


def _bordered(
    T: Float[np.ndarray, "old old"], V: Float[np.ndarray, "dofs new"], Bv: np.ndarray
) -> Float[np.ndarray, "new new"]:
    """V' B V, of which the part of the old vectors is known; Bv is B times the last ones."""
    old = len(T)
    border = V.T @ Bv
    corner = (border[old:] + border[old:].T) / 2
    return np.block([[T, border[:old]], [border[:old].T, corner]])


def _relative(
    r: Float[np.ndarray, "dofs columns"],
    mu: Float[np.ndarray, " columns"],
    Kx: Float[np.ndarray, "dofs columns"],
) -> Float[np.ndarray, " columns"]:
    """|B x - mu K x| / |mu K x|, which is |K x - lambda B x| / |K x|."""
    size = np.abs(mu) * np.linalg.norm(Kx, axis=0)
    return np.divide(np.linalg.norm(r, axis=0), size, out=np.full(len(mu), np.inf), where=size > 0)


def _found(
    K: Matrix,
    B: bsr_array,
    mu: Float[np.ndarray, " some"],
    x: Float[np.ndarray, "dofs columns"],
    modes: int,
    steps: int,
) -> EigenPairs:
    """Judge the first eigenpairs of B x = mu K x, mu descending."""
    largest = np.abs(mu).max(initial=0.0)
    values, residual = np.full(modes, np.nan), np.full(modes, np.nan)
    vectors = np.zeros((len(x), modes))
    count = int((mu[:modes] > NOTHING * largest).sum())
    if count:
        Kx = K @ x[:, :count]
        values[:count], vectors[:, :count] = 1 / mu[:count], x[:, :count]
        residual[:count] = _relative(B @ x[:, :count] - Kx * mu[:count], mu[:count], Kx)
    result = EigenResult.CONVERGED
    if count == 0:
        result = EigenResult.NONE_POSITIVE
    elif not (residual[:count] <= RESIDUAL_LIMIT).all():
        result = EigenResult.NOT_CONVERGED
    elif count < modes:
        result = EigenResult.TOO_FEW
    return EigenPairs(values, vectors, residual, result, steps)
