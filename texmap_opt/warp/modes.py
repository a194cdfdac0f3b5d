"""A change of variables that makes the least-squares warp well conditioned."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from texmap_opt.warp.hex_grid import HexGrid

# Added to the eigenvalues, in units of one cell: makes the square root safe for a grid of one cell
# along an axis, and is far below the smallest eigenvalue (pi/n)² of any grid that fits in memory.
EIGENVALUE_SHIFT = 1e-6


class SlidingModes(eqx.Module):
    """Displacements of the nodes from cosine and sine modes; outer nodes stay on their faces.

    x = x0 + V (Lambda + eps)^(-1/2) z. Component c of the displacement uses sine modes along axis c
    (zero on the two faces it is normal to) and cosine modes along the others (free to slide). These
    are the eigenvectors of the Laplacian of the grid's graph, and Lambda are its eigenvalues with
    the stiffness of each axis, sum_k (h_c / h_k)² (2 - 2 cos): so smooth and rough displacements
    change the objective by about as much per unit of z.

    Source of the modes: Strang, "The discrete cosine transform", SIAM Review 41 (1999), DCT-2 and
    DST-1.

    Attributes:
        cosines: per axis, nodes x modes.
        sines: per axis, nodes x modes of the interior nodes.
        scale: per component, (Lambda + eps)^(-1/2) in mm.
    """

    cosines: tuple[Float[Array, "_ _"], ...]
    sines: tuple[Float[Array, "_ _"], ...]
    scale: tuple[Float[Array, "_ _ _"], ...]

    @classmethod
    def of(cls, grid: HexGrid, stiffness: float) -> "SlidingModes":
        """Modes of a grid, divided by the root of the objective's stiffness at the identity."""
        h = grid.uniform_edge
        cosines, sines, scale = [], [], []
        cosine_values, sine_values = [], []
        for n in grid.cells:
            node, mode = np.arange(n + 1)[:, None], np.arange(n + 1)
            C = np.cos(np.pi * mode * (node + 0.5) / (n + 1)) * np.sqrt(2 / (n + 1))
            C[:, 0] /= np.sqrt(2)
            cosines.append(jnp.asarray(C))
            cosine_values.append(2 - 2 * np.cos(np.pi * mode / (n + 1)))
            inner = np.arange(1, n)
            sines.append(jnp.asarray(np.sin(np.pi * node * inner / n) * np.sqrt(2 / n)))
            sine_values.append(2 - 2 * np.cos(np.pi * inner / n))
        for c in range(3):
            x, y, z = (
                (h[c] / h[k]) ** 2 * (sine_values[k] if k == c else cosine_values[k])
                for k in range(3)
            )
            eigenvalues = x[:, None, None] + y[:, None] + z + EIGENVALUE_SHIFT
            scale.append(jnp.asarray(h[c] / np.sqrt(stiffness * eigenvalues)))
        return cls(tuple(cosines), tuple(sines), tuple(scale))

    def displacement(self, z: tuple[Float[Array, "_ _ _"], ...]) -> Float[Array, " 3 *nodes"]:
        """Displacement of the nodes [mm], component first."""
        components = []
        for c in range(3):
            X, Y, Z = (self.sines[k] if k == c else self.cosines[k] for k in range(3))
            # One axis at a time: (n+1)^4 operations each instead of (n+1)^6 at once.
            u = jnp.einsum("abc,za->bcz", self.scale[c] * z[c], X)
            u = jnp.einsum("bcx,yb->cxy", u, Y)
            components.append(jnp.einsum("cxy,zc->xyz", u, Z))
        return jnp.stack(components)

    def at_rest(self) -> tuple[Float[Array, "_ _ _"], ...]:
        """The variables of no displacement."""
        return tuple(jnp.zeros_like(scale) for scale in self.scale)
