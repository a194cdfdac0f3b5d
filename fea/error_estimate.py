"""How far the stress of a mesh is from the exact one, and how fine the mesh would have to be.

Zienkiewicz and Zhu, Int. J. Numer. Meth. Eng. 24 (1987) 337-357: the recovered stress is so much
closer to the exact stress than that of the cells that the difference of the two is nearly the error.
With patch recovery the ratio of estimated to true error tends to one (the second of their papers of
1992, same journal, 33, 1365-1382).

Where the modulus jumps, stress is recovered on each side apart. What the two sides' tractions then
lack for balance is error as well, and the only one that is seen where each cell has a modulus of its
own: there the recovered stress of a cell is nothing but its own (`fea.traction_balance`). With every
face of a homogeneous solid taken for a jump, 0.9 of the true error is estimated on tet4, 0.6 to 0.7 on
tet10, whose tractions jump less than its stress errs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import root_scalar

from fea.elements import TETRAHEDRON_EDGES, barycentric
from fea.errors import FeaError
from fea.isoparametric import cell_determinants
from fea.quadrature import TETRAHEDRON_2, TETRAHEDRON_5
from fea.stress_recovery import RecoveredStress
from fea.tet_mesh import TetMesh
from fea.traction_balance import balancing_stress

# Rules exact for the square of the estimated error where edges are straight: it has the degree of
# the shape functions.
RULES = {"tet4": TETRAHEDRON_2, "tet10": TETRAHEDRON_5}

# Polynomial degree of the displacement.
DEGREES = {"tet4": 1, "tet10": 2}

# One step makes no edge shorter or longer than this times what it was: far from the present mesh
# the law of convergence says little.
FINEST, COARSEST = 1 / 4, 2.0

# Cells computed at once: 30 MB of stress at their points for tet10.
CELLS_AT_ONCE = 1 << 15


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Estimated error of the stress in the energy norm |s|² = ∫ s C⁻¹ s dV, twice the energy.

    Attributes:
        mesh: the mesh.
        cells: estimated error of each cell [sqrt(N mm)].
        stress_norm: energy norm of the stress of the cells [sqrt(N mm)].
    """

    mesh: TetMesh
    cells: Float[np.ndarray, "cases cells"]
    stress_norm: Float[np.ndarray, " cases"]

    @cached_property
    def error_norm(self) -> Float[np.ndarray, " cases"]:
        """Estimated error of the whole solid [sqrt(N mm)]."""
        return np.linalg.norm(self.cells, axis=1)

    @cached_property
    def energy_norm(self) -> Float[np.ndarray, " cases"]:
        """Estimated energy norm of the exact stress [sqrt(N mm)].

        Exact and computed energy differ by that of the error, where no displacement other than
        zero is prescribed.
        """
        return np.hypot(self.stress_norm, self.error_norm)

    @cached_property
    def relative(self) -> Float[np.ndarray, " cases"]:
        """Estimated error over energy norm, from 0 to 1; 0 where there is no stress."""
        unloaded = self.energy_norm == 0
        return self.error_norm / np.where(unloaded, 1.0, self.energy_norm)

    def size_factors(self, *, share: float) -> Float[np.ndarray, " cells"]:
        """New over old edge of each cell for the fewest cells that bring the error to a share.

        A cell of error e whose edge h becomes r h is replaced by r⁻³ cells with the error e rᵖ
        together, p the degree of the displacement. The sum of r⁻³ is least, while the sum of
        e² r²ᵖ is the square of the error allowed, where every new cell has the same error
        (Lagrange): r = c e^(-2/(2p + 3)). That is the optimal mesh of Li and Bettess, Commun. Numer.
        Meth. Eng. 11 (1995) 857-868. Zienkiewicz and Zhu (1987), with r = c e^(-1/p), and Oñate and
        Bugeda, Eng. Comput. 10 (1993) 307-321, with r = c (e²/V)^(-1/2p) (equal errors per volume
        V), meet the same total with more cells: they refine too much where the error is and coarsen
        too much elsewhere. c is found with r held between `FINEST` and `COARSEST`.

        At a re-entrant edge the error of a cell falls as r^λ, λ < p being the power of the distance
        with which the displacement varies there: 0.5 at a crack, 0.545 where two faces meet at a
        right angle (Williams, J. Appl. Mech. 19 (1952) 526-528). Zienkiewicz and Zhu put 0.5 for p
        in such cells. Here p stays, as nothing but the cells at the edge itself has λ: a step
        refines them less than it would take, the next estimate sees what is left of their error,
        and a few steps lead to the same mesh.

        Args:
            share: wanted relative error, such as 0.05.

        Returns:
            The smallest factor of all load cases.

        Raises:
            FeaError: when the share is not between 0 and 1.
        """
        if not 0 < share < 1:
            raise FeaError(f"share = {share:g}: must be above 0 and below 1, such as 0.05.")
        p = DEGREES[self.mesh.element]
        factors = np.full(len(self.mesh.tets), COARSEST)
        for error, norm in zip(self.cells, self.energy_norm, strict=True):
            factors = np.minimum(factors, _factors(error, float(share * norm), p))
        return factors

    def wanted_size(self, *, share: float) -> Float[np.ndarray, " nodes"]:
        """Edges at the nodes [mm] that ask for as many cells around each as `size_factors`.

        A cell's old edge is the mean of its six, the measure that meshers take: the edge of the
        regular tetrahedron of its volume would be shorter, and next to nothing for a sliver.

        Args:
            share: wanted relative error, such as 0.05.

        Returns:
            NaN at nodes of no cell.

        Raises:
            FeaError: when the share is not between 0 and 1.
        """
        mesh = self.mesh
        x = mesh.nodes[mesh.tets[:, :4]]
        a, b = TETRAHEDRON_EDGES.T
        old = np.linalg.norm(x[:, a] - x[:, b], axis=-1).mean(axis=1)
        # The number of cells is the integral of 1/edge³, so that is what is averaged.
        density = (self.size_factors(share=share) * old) ** -3
        nodes = mesh.tets.ravel()
        volume, count = (
            np.bincount(
                nodes, weights=np.repeat(each, mesh.tets.shape[1]), minlength=len(mesh.nodes)
            )
            for each in (mesh.volumes, mesh.volumes * density)
        )
        return np.cbrt(np.divide(volume, count, out=np.full_like(volume, np.nan), where=count > 0))


def estimate_error(
    mesh: TetMesh,
    C: Float[np.ndarray, "6 6"],
    at_quadrature: Float[np.ndarray, "cases cells quad 6"],
    recovered: RecoveredStress,
    *,
    modulus: Float[np.ndarray, "cells samples"] | None = None,
) -> ErrorEstimate:
    """Estimate the error of the cells' stress by its difference from the recovered stress.

    Args:
        mesh: the mesh.
        C: elasticity matrix [MPa].
        at_quadrature: stress at the quadrature points of the cells [MPa].
        recovered: stress at the nodes, from `fea.stress_recovery` with the same modulus.
        modulus: factor on C, one a cell or one at each quadrature point; 1 by default. The error is
            weighed with the mean of its inverse over the cell.

    Raises:
        FeaError: when stress is not a number somewhere.
    """
    pieces, values = recovered.torn.pieces, recovered.values
    if not (np.isfinite(at_quadrature).all() and np.isfinite(values[:, pieces.tets]).all()):
        raise FeaError("Stress is not a number somewhere, so its error cannot be estimated.")
    element, rule = mesh.element_type, RULES[mesh.element]
    # Columns R with C⁻¹ = R Rᵀ: the energy norm is the plain one of s R.
    R = np.linalg.inv(np.linalg.cholesky(C)).T
    flexible = 1 / (np.ones((len(mesh.tets), 1)) if modulus is None else modulus)
    N = element.shape(rule.points)
    # The cell's own stress at the rule's points: as extrapolated to its corners, linear between.
    linear = barycentric(rule.points)
    raw = linear @ element.extrapolation[:4]
    cells, squares = np.zeros(at_quadrature.shape[:2]), np.zeros(len(at_quadrature))
    nodal = (values.reshape(-1, 6) @ R).reshape(values.shape)
    unbalanced, lacking = _lacking(recovered)
    lacking = lacking @ R
    for first in range(0, len(mesh.tets), CELLS_AT_ONCE):
        some = slice(first, first + CELLS_AT_ONCE)
        tets = mesh.tets[some]
        those = slice(*np.searchsorted(unbalanced, (first, first + CELLS_AT_ONCE)))
        weight = cell_determinants(mesh.nodes[tets], rule.points) * rule.weights
        weight = weight * flexible[some].mean(axis=1, keepdims=True)
        volume = flexible[some] * mesh.jacobians[some] * element.quadrature.weights
        for case in range(len(cells)):
            own = at_quadrature[case, some]
            own = (own.reshape(-1, 6) @ R).reshape(own.shape)
            # cell, rule point, node or quadrature point, component
            e = N @ nodal[case, pieces.tets[some]] - raw @ own
            e[unbalanced[those] - first] += linear @ lacking[case, those]
            cells[case, some] = np.sqrt(np.einsum("cp,cpv,cpv->c", weight, e, e))
            squares[case] += np.einsum("cq,cqv,cqv->", volume, own, own)
    return ErrorEstimate(mesh, cells, np.sqrt(squares))


def _lacking(
    recovered: RecoveredStress,
) -> tuple[Int[np.ndarray, " cells"], Float[np.ndarray, "cases cells 4 6"]]:
    """Cells whose tractions are not balanced, and the stress that they lack at their corners."""
    jumps = recovered.torn.jumps
    if jumps is None:
        return np.zeros(0, dtype=np.int64), np.zeros((len(recovered.values), 0, 4, 6))
    return balancing_stress(recovered, jumps)


def _factors(
    error: Float[np.ndarray, " cells"], allowed: float, p: int
) -> Float[np.ndarray, " cells"]:
    """New over old edge of each cell, so that the errors add up to what is allowed."""
    if not error.any():
        return np.full(len(error), COARSEST)
    # Errors of nothing would have edges of any length; the bounds cut those off anyway.
    shape = np.maximum(error, np.finfo(float).eps * error.max()) ** (-2 / (2 * p + 3))

    def factors(log_c: float) -> Float[np.ndarray, " cells"]:
        return np.clip(np.exp(log_c) * shape, FINEST, COARSEST)

    def excess(log_c: float) -> float:
        return float((error**2 * factors(log_c) ** (2 * p)).sum() / allowed**2 - 1)

    low, high = float(np.log(FINEST / shape.max())), float(np.log(COARSEST / shape.min()))
    if excess(low) >= 0:
        return factors(low)
    if excess(high) <= 0:
        return factors(high)
    # To a millionth, far below what a mesher keeps of a wanted edge.
    return factors(root_scalar(excess, bracket=(low, high), xtol=1e-6).root)
