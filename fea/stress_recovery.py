"""One continuous stress from the stress in the cells: superconvergent patch recovery.

Zienkiewicz and Zhu, Int. J. Numer. Meth. Eng. 33 (1992) 1331-1364: around each corner node a
polynomial is fitted, by least squares, to the stress at the quadrature points of the cells there,
where it is best (Barlow 1976). Its degree is that of the element's displacement, one more than the
stress of the cell has: linear for tet4, quadratic for tet10. Mid-edge nodes take the mean of the
polynomials of the two ends. Linear stress is recovered exactly.

Surfaces. A patch of few cells, all on one side, extrapolates badly, and stress matters most there.
What is done instead was measured on Lamé's sphere and cylinder, Kirsch's plate and the manufactured
solution of the verification suite, on structured and unstructured meshes:

* tet4: the mean of what the polynomials of the inner corners next to it give at the node (the rule
  of Zienkiewicz and Zhu), or of those one cell further. Two to three times closer to the exact stress
  in the energy norm than the volume-weighted mean of the cells.
* tet10: that rule is no better than the mean of the cells, its extrapolation being quadratic. The
  patch takes in a second ring of cells, and samples weigh 1/distance⁴: the outer ring settles only
  what the inner one leaves open. 1.3 times closer than the mean of the cells on the coarsest meshes
  (six cells to a quarter circle of the sphere, eight to that of the hole), six times on the finest.

A corner of tet4 with no inner corner in reach, as in a wall one cell thick, has a patch of the second
kind. Linear cells do not resolve bending across such a wall, and there the mean of the cells would be
no worse.

Jumps. Between materials stress is not continuous, and smoothing it would be wrong on either side: the
mesh is torn there (`fea.modulus_jumps`), and each side has surfaces like any other.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from fea.elements import TETRAHEDRON_EDGES
from fea.modulus_jumps import SMOOTH_RATIO, TornMesh
from fea.tet_mesh import TetMesh

# Samples weigh 1/distance to this power in patches that reach beyond the cells of their node.
FALL_OFF = 4

# A patch determines its polynomial when the eigenvalues of its normal matrix, brought to a unit
# diagonal, span less than this: real meshes stay below 1e5, rounding alone gives 1e16.
MOST_SPREAD = 1e8

# Rings of cells a patch may have before its polynomial loses a degree: only bodies of a few cells
# have less to offer.
MOST_RINGS = 3

# Samples of the patches fitted at once: 20 MB of quadratic terms.
SAMPLES_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class RecoveredStress:
    """Stress recovered on each side of every jump; between the nodes, the shape functions.

    Attributes:
        torn: the mesh, and its pieces.
        values: stress at the nodes of the pieces (`vertices`, to tell them from those of the whole
            mesh) [MPa].
        modulus: relative modulus of each cell, the mean over the cell.
    """

    torn: TornMesh
    values: Float[np.ndarray, "cases vertices 6"]
    modulus: Float[np.ndarray, " cells"]

    @cached_property
    def at_nodes(self) -> Float[np.ndarray, "cases nodes 6"]:
        """Stress at the nodes of the whole mesh [MPa]; NaN at nodes of no cell.

        Where several sides meet, that of the stiffest: of the solid where it borders on a void. The
        mean, weighed with the volume around the node, of the sides as stiff as that but for
        `SMOOTH_RATIO`. The other sides: `of_cells`.
        """
        if self.torn.jumps is None:
            return self.values
        volume = self._around(np.ones(len(self.modulus)))
        modulus = self._around(self.modulus) / volume
        stiffest = np.zeros(len(self.torn.whole.nodes))
        np.maximum.at(stiffest, self.torn.node, modulus)
        return self._mean(volume * (modulus * SMOOTH_RATIO >= stiffest[self.torn.node]))

    def of_cells(self, cells: Bool[np.ndarray, " cells"]) -> Float[np.ndarray, "cases nodes 6"]:
        """Stress at the nodes of the whole mesh [MPa], on the side of some cells.

        Args:
            cells: which ones, such as those of a material.

        Returns:
            The mean, weighed with volume, where they have several sides; NaN where they have no node.
        """
        return self._mean(self._around(cells.astype(float)))

    def _around(self, each: Float[np.ndarray, " cells"]) -> Float[np.ndarray, " vertices"]:
        """Sum of each cell's value times its volume around the nodes of the pieces."""
        tets = self.torn.pieces.tets
        weights = np.repeat(each * self.torn.whole.volumes, tets.shape[1])
        return np.bincount(tets.ravel(), weights=weights, minlength=len(self.torn.node))

    def _mean(self, weight: Float[np.ndarray, " vertices"]) -> Float[np.ndarray, "cases nodes 6"]:
        """Weighted mean of the pieces at each node of the whole mesh."""
        (some,) = np.nonzero(weight)
        node, weight = self.torn.node[some], weight[some]
        count = len(self.torn.whole.nodes)
        total = np.bincount(node, weights=weight, minlength=count)
        share = csr_array((weight / total[node], (node, some)), shape=(count, len(self.torn.node)))
        mean = np.stack([share @ values for values in np.nan_to_num(self.values)])
        mean[:, total == 0] = np.nan
        return mean


def recovered_stress(
    mesh: TetMesh,
    at_quadrature: Float[np.ndarray, "cases cells quad 6"],
    *,
    modulus: Float[np.ndarray, "cells samples"] | None = None,
    groups: Int[np.ndarray, " cells"] | None = None,
) -> RecoveredStress:
    """Stress at the nodes [MPa] by superconvergent patch recovery, apart on each side of jumps.

    Args:
        mesh: tet4 or tet10, straight or curved.
        at_quadrature: stress at the quadrature points of the cells [MPa]; any components do.
        modulus: factor on the material's stiffness, one a cell or one at each quadrature point; 1
            by default. Patches do not reach across faces where it jumps (`fea.modulus_jumps`). A
            cell all of whose faces are jumps keeps its own stress, extrapolated to its nodes.
        groups: a number for each cell, such as that of its part: patches stay within one.

    Raises:
        FeaError: when moduli are no positive numbers.
    """
    if modulus is None:
        modulus = np.ones((len(mesh.tets), 1))
    torn = TornMesh.between(mesh, modulus, groups=groups)
    return RecoveredStress(torn, _smooth(torn.pieces, at_quadrature), modulus.mean(axis=1))


def _smooth(
    mesh: TetMesh, at_quadrature: Float[np.ndarray, "cases cells quad 6"]
) -> Float[np.ndarray, "cases nodes 6"]:
    """Stress at the nodes [MPa], smooth wherever cells share them; NaN at nodes of no cell."""
    cases, cells, quad, components = at_quadrature.shape
    samples = _Samples(
        # cell, node, space, quad point
        np.einsum("cnx,qn->cqx", mesh.nodes[mesh.tets], mesh.element_type.shape_at_quadrature),
        at_quadrature.transpose(1, 2, 0, 3).reshape(cells, quad, -1),
    )
    corners = mesh.tets[:, :4]
    around = csr_array(
        (np.ones(4 * cells, dtype=np.int32), (corners.ravel(), np.repeat(np.arange(cells), 4))),
        shape=(len(mesh.nodes), cells),
    )
    used, inner = np.zeros((2, len(mesh.nodes)), dtype=bool)
    used[corners] = True
    inner[corners] = True
    inner[mesh.boundary_facets] = False

    linear = mesh.element == "tet4"
    degree = 1 if linear else 2
    fits = _Fits.none(mesh.nodes, degree, samples.stress.shape[-1])
    fits.add(samples, np.flatnonzero(inner), around[inner], degree=degree, fall_off=0)
    stress = np.full((len(mesh.nodes), samples.stress.shape[-1]), np.nan)
    if linear:
        _spread(fits, around, stress, np.flatnonzero(used & ~fits.known))
    _fit_wider(fits, samples, around, np.flatnonzero(used & ~fits.known & np.isnan(stress[:, 0])))
    stress[fits.known] = fits.coefficients[fits.known, 0]
    if not linear:
        ends, first = corners[:, TETRAHEDRON_EDGES].reshape(-1, 2), mesh.tets[:, 4:].ravel()
        middle, first = np.unique(first, return_index=True)
        a, b = ends[first].T
        at = mesh.nodes[middle]
        stress[middle] = (fits.evaluate(a, at) + fits.evaluate(b, at)) / 2
    return stress.reshape(-1, cases, components).transpose(1, 0, 2)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Stress where the cells compute it best.

    Attributes:
        position: quadrature points of the cells [mm].
        stress: components of all cases there [MPa].
    """

    position: Float[np.ndarray, "cells quad 3"]
    stress: Float[np.ndarray, "cells quad values"]


@dataclass(frozen=True, eq=False)
class _Fits:
    """Polynomials of (x - node) / size, one for each node that has its own; filled in steps.

    Attributes:
        nodes: positions [mm].
        size: of each node's patch [mm].
        coefficients: of the terms of `_terms`; first the value at the node.
        known: which nodes have a polynomial.
    """

    nodes: Float[np.ndarray, "nodes 3"]
    size: Float[np.ndarray, " nodes"]
    coefficients: Float[np.ndarray, "nodes terms values"]
    known: Bool[np.ndarray, " nodes"]

    @classmethod
    def none(cls, nodes: Float[np.ndarray, "nodes 3"], degree: int, values: int) -> "_Fits":
        """No polynomial yet."""
        terms = _terms(np.zeros((1, 3)), degree).shape[-1]
        count = len(nodes)
        return cls(
            nodes, np.ones(count), np.zeros((count, terms, values)), np.zeros(count, dtype=bool)
        )

    def evaluate(
        self, at: Int[np.ndarray, " n"], x: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n values"]:
        """Polynomials of the nodes `at`, each at its own position x [mm]."""
        degree = 1 if self.coefficients.shape[1] == 4 else 2
        terms = _terms((x - self.nodes[at]) / self.size[at, None], degree)
        return np.einsum("nt,ntv->nv", terms, self.coefficients[at])

    def add(
        self,
        samples: _Samples,
        at: Int[np.ndarray, " n"],
        patches: csr_array,
        *,
        degree: int,
        fall_off: int,
    ) -> None:
        """Fit the polynomials of nodes whose patch determines one; the others stay unknown.

        Args:
            samples: what is fitted.
            at: the nodes.
            patches: cells of each node's patch: the columns of its row.
            degree: of the polynomials.
            fall_off: samples weigh 1/distance to this power.
        """
        cells = np.diff(patches.indptr)
        quad = samples.position.shape[1]
        # Patches of equal size go together, filled up with cells of no weight to the largest.
        order = np.argsort(cells, kind="stable")
        while len(order):
            # From the end: the last patch is the largest.
            largest = int(cells[order[-1]])
            count = max(1, SAMPLES_AT_ONCE // (quad * largest))
            order, some = order[:-count], order[-count:]
            place = np.arange(largest)
            filled = place < cells[some, None]
            cell = patches.indices[np.where(filled, patches.indptr[some, None] + place, 0)]
            self._fit(samples, at[some], cell, filled, degree=degree, fall_off=fall_off)

    def _fit(
        self,
        samples: _Samples,
        at: Int[np.ndarray, " n"],
        cell: Int[np.ndarray, "n places"],
        filled: Bool[np.ndarray, "n places"],
        *,
        degree: int,
        fall_off: int,
    ) -> None:
        quad = samples.position.shape[1]
        d = samples.position[cell].reshape(len(at), -1, 3) - self.nodes[at, None]
        distance = np.sqrt(np.einsum("nsx,nsx->ns", d, d))
        filled = np.repeat(filled, quad, axis=1)
        size = np.where(filled, distance, 0.0).max(axis=1)
        weight = filled * (size[:, None] / distance) ** fall_off
        P = _terms(d / size[:, None, None], degree)
        WP = np.swapaxes(P * weight[:, :, None], 1, 2)  # node, term, sample
        # Normal equations, brought to a unit diagonal: flat patches have small terms, not bad ones.
        A = WP @ P
        diagonal = np.einsum("ntt->nt", A)
        scale = 1 / np.sqrt(np.maximum(diagonal, np.finfo(float).tiny))
        eigenvalues, V = np.linalg.eigh(A * scale[:, :, None] * scale[:, None, :])
        good = eigenvalues[:, -1] < MOST_SPREAD * eigenvalues[:, 0]
        V = V[good]
        values = samples.stress.shape[-1]
        right = WP[good] @ samples.stress[cell[good]].reshape(len(V), WP.shape[2], values)
        modes = np.swapaxes(V, 1, 2) @ (scale[good, :, None] * right)
        solved = scale[good, :, None] * (V @ (modes / eigenvalues[good, :, None]))
        self.coefficients[at[good], : P.shape[2]] = solved
        self.size[at[good]] = size[good]
        self.known[at[good]] = True


def _terms(d: Float[np.ndarray, "*shape 3"], degree: int) -> Float[np.ndarray, "*shape terms"]:
    """Monomials of the complete polynomial of a degree: 1, then x y z, then xx yy zz yz xz xy."""
    x, y, z = np.moveaxis(d, -1, 0)
    terms = [np.ones_like(x), x, y, z, x * x, y * y, z * z, y * z, x * z, x * y]
    return np.stack(terms[: (1, 4, 10)[degree]], axis=-1)


def _spread(
    fits: _Fits,
    around: csr_array,
    stress: Float[np.ndarray, "nodes values"],
    at: Int[np.ndarray, " n"],
) -> None:
    """Give nodes the mean of the polynomials next to them, or one cell further."""
    near = around[at] @ around.T
    for _ in range(2):
        row, column = near.tocoo().coords
        row, column = row[fits.known[column]], column[fits.known[column]]
        values = fits.evaluate(column, fits.nodes[at[row]])
        total = csr_array(
            (np.ones(len(row)), (row, np.arange(len(row)))), shape=(len(at), len(row))
        )
        count = np.bincount(row, minlength=len(at))
        found = count > 0
        stress[at[found]] = (total @ values)[found] / count[found, None]
        at, near = at[~found], csr_array((near[~found] @ around) @ around.T)


def _fit_wider(
    fits: _Fits, samples: _Samples, around: csr_array, at: Int[np.ndarray, " n"]
) -> None:
    """Fit to patches of more rings; where no ring suffices, polynomials of lower degree."""
    degree = 1 if fits.coefficients.shape[1] == 4 else 2
    while len(at) and degree >= 0:
        patches = around[at]
        for _ in range(1, MOST_RINGS):
            patches = csr_array((patches @ around.T) @ around)
            fits.add(samples, at, patches, degree=degree, fall_off=FALL_OFF)
            open_ = ~fits.known[at]
            at, patches = at[open_], patches[open_]
        degree -= 1
