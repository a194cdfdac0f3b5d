"""A change of variables that makes the least-squares warp well conditioned."""

from itertools import combinations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from texmap_opt.warp.grid import Grid

# Stiffness, over the alignment's weight, against an edge's turning out of its line. The residuals of
# alignment couple the turnings of a cell's edges and differ from place to place with the stress; a
# third, the mean square of a diagonal entry of a unit deviator, stands for them. Without it 12³
# bending cells at a weight of 100 need 180 steps instead of 71, with 1 the search ends 0.02 % higher.
TURNING = 0.3


class SlidingModes(eqx.Module):
    """Displacements of the nodes from cosine and sine modes; outer nodes stay on their faces.

    u = M V A^(-1/2) z. Component c of the displacement uses sine modes along axis c (zero on the
    two faces it is normal to) and cosine modes along the others (free to slide), so that all
    components strain a cell by the same products of cosines, and the objective's Hessian at the
    identity falls into one block A of d x d numbers per mode (`_hessian`). In z it is the identity.
    M holds the nodes of fixed faces.

    Source of the modes: Strang, "The discrete cosine transform", SIAM Review 41 (1999), DCT-1 and
    DST-1.

    Attributes:
        cosines, sines: per axis, nodes x modes; the modes that no sine has are zero.
        scale: A^(-1/2) of each mode: component, component, mode [mm]; zero where a
            component has no sine.
        free: where a node may move along a component.
    """

    cosines: tuple[Float[Array, "_ _"], ...]
    sines: tuple[Float[Array, "_ _"], ...]
    scale: Float[Array, " d d *nodes"]
    free: Bool[Array, " d *nodes"]

    @classmethod
    def of(cls, grid: Grid, *, size_weight: float, alignment_weight: float) -> "SlidingModes":
        """Modes of a grid.

        Args:
            grid: gives box, number of cells, and which nodes are free.
            size_weight: of the objective's size residual.
            alignment_weight: of what turns the cells.
        """
        cosines, sines, angles = [], [], []
        for n in grid.cells:
            node, mode = np.arange(n + 1)[:, None], np.arange(n + 1)
            ends = np.where((mode == 0) | (mode == n), np.sqrt(0.5), 1.0)
            angle = np.pi * mode / n
            cosines.append(jnp.asarray(np.cos(node * angle) * ends * np.sqrt(2 / n)))
            sine = np.sin(node * angle) * np.sqrt(2 / n)
            sine[:, [0, -1]] = sine[[0, -1], :] = 0.0  # rounding of sin(pi) would leave the face
            sines.append(jnp.asarray(sine))
            angles.append(angle)
        theta = np.stack(np.meshgrid(*angles, indexing="ij"))
        edge = grid.uniform_edge.reshape(-1, *[1] * grid.dimensions)
        A = _hessian(2 / edge * np.sin(theta / 2), np.cos(theta / 2), size_weight, alignment_weight)
        ends = np.array(grid.cells).reshape(-1, *[1] * grid.dimensions)
        mode = np.indices(theta.shape[1:])
        scale = _inverse_root(A, (mode > 0) & (mode < ends))
        return cls(tuple(cosines), tuple(sines), jnp.asarray(scale), jnp.asarray(grid.free))

    def displacement(self, z: Float[Array, " d *nodes"]) -> Float[Array, " d *nodes"]:
        """Displacement of the nodes [mm], component first."""
        scaled = jnp.sum(self.scale * z[None], axis=1)
        components = []
        for c in range(len(z)):
            u = scaled[c]
            # One axis at a time: (n+1)^4 operations each instead of (n+1)^6 at once.
            for k in range(len(z)):
                modes = self.sines[k] if k == c else self.cosines[k]
                u = jnp.moveaxis(jnp.tensordot(modes, u, axes=(1, k)), 0, k)
            components.append(u)
        return jnp.where(self.free, jnp.stack(components), 0.0)


def _hessian(
    wave: Float[np.ndarray, " d *nodes"],
    middle: Float[np.ndarray, " d *nodes"],
    size_weight: float,
    alignment_weight: float,
) -> Float[np.ndarray, " d d *nodes"]:
    """Second derivatives of the objective at the identity by the amplitudes of each mode.

    docs/theory/warp.md, 3.5, derives it. Within a cell a mode varies from point to point; the
    residuals at its corners and at the points of its Bezier coefficients all count.

    Args:
        wave: 2 sin(theta/2) over the edge of a cell, theta the phase from node to node [1/mm].
        middle: cos(theta/2): what is left of an amplitude half way between two nodes.
        size_weight: w.
        alignment_weight: of what turns the cells.
    """
    d = len(wave)
    # Squares of a mode at 0, 1/2 and 1 along an axis, and that of their mean half way.
    at_three, at_middle = 2 + middle**2, middle**2
    A = np.zeros((d, *wave.shape))
    for a in range(d):
        others = [b for b in range(d) if b != a]
        size = 3 * size_weight * np.prod(at_three[others], axis=0)
        A[a, a] = (4 + size) * wave[a] ** 2
        for b in others:
            turning = np.prod(at_middle[[k for k in range(d) if k != b]], axis=0)
            A[a, a] += (2 + TURNING * alignment_weight * turning) * wave[b] ** 2
    for a, b in combinations(range(d), 2):
        rest = np.prod(at_three[[k for k in range(d) if k not in (a, b)]], axis=0)
        A[a, b] = (2 + 9 * size_weight * rest) * wave[a] * wave[b] * middle[a] * middle[b]
        A[b, a] = A[a, b]
    return A


def _inverse_root(
    A: Float[np.ndarray, " d d *nodes"], moves: Bool[np.ndarray, " d *nodes"]
) -> Float[np.ndarray, " d d *nodes"]:
    """A^(-1/2) of every block, on the components that move anything; zero on the others."""
    d = len(A)
    both = moves[:, None] & moves[None]
    blocks = np.where(both, A, np.eye(d).reshape(d, d, *[1] * (A.ndim - 2)))
    values, vectors = np.linalg.eigh(np.moveaxis(blocks, (0, 1), (-2, -1)))
    roots = (vectors / np.sqrt(values)[..., None, :]) @ vectors.swapaxes(-1, -2)
    return np.where(both, np.moveaxis(roots, (-2, -1), (0, 1)), 0.0)
