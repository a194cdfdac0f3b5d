"""A change of variables that makes the least-squares warp well conditioned."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from texmap_opt.warp.grid import Grid


class SlidingModes(eqx.Module):
    """Displacements of the nodes from cosine and sine modes; outer nodes stay on their faces.

    x = x0 + M V A^(-1/2) z. Component c of the displacement uses sine modes along axis c (zero on
    the two faces it is normal to) and cosine modes along the others (free to slide), so that the
    divergence of all components is made of the same products of cosines, and the objective's
    Hessian at the identity falls into one small block per mode. With kappa the vector of the mode's
    wave numbers, a displacement along kappa changes the size of cells and costs
    `stretch` |kappa|², one across it only shears them and costs `shear` |kappa|²: A has these two
    values, and its inverse root is known. M holds the nodes of fixed faces.

    Source of the modes: Strang, "The discrete cosine transform", SIAM Review 41 (1999), DCT-1 and
    DST-1.

    Attributes:
        cosines, sines: per axis, nodes x modes; the modes that no sine has are zero.
        direction: kappa / |kappa| per mode; zero where kappa is.
        across, along: (A)^(-1/2) across and along kappa [mm].
        free: where a node may move along a component.
    """

    cosines: tuple[Float[Array, "_ _"], ...]
    sines: tuple[Float[Array, "_ _"], ...]
    direction: Float[Array, " d *nodes"]
    across: Float[Array, "*nodes"]
    along: Float[Array, "*nodes"]
    free: Bool[Array, " d *nodes"]

    @classmethod
    def of(
        cls,
        grid: Grid,
        *,
        shear: float,
        stretch: float,
        free: Bool[np.ndarray, " d *nodes"],
    ) -> "SlidingModes":
        """Modes of a grid.

        Args:
            grid: gives box and number of cells.
            shear: stiffness of the objective against shear at the identity.
            stretch: the same against change of size.
            free: see the attribute.
        """
        cosines, sines, wave = [], [], []
        for n, h in zip(grid.cells, grid.uniform_edge, strict=True):
            node, mode = np.arange(n + 1)[:, None], np.arange(n + 1)
            ends = np.where((mode == 0) | (mode == n), np.sqrt(0.5), 1.0)
            angle = np.pi * mode / n
            cosines.append(jnp.asarray(np.cos(node * angle) * ends * np.sqrt(2 / n)))
            sine = np.sin(node * angle) * np.sqrt(2 / n)
            sine[:, [0, -1]] = sine[[0, -1], :] = 0.0  # rounding of sin(pi) would leave the face
            sines.append(jnp.asarray(sine))
            wave.append(2 / h * np.sin(angle / 2))
        kappa = np.stack(np.meshgrid(*wave, indexing="ij"))
        size = np.sqrt(np.sum(kappa**2, axis=0))
        # The mode without a wave moves nothing: every component needs a sine.
        inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
        return cls(
            tuple(cosines),
            tuple(sines),
            jnp.asarray(kappa * inverse),
            jnp.asarray(inverse / np.sqrt(shear)),
            jnp.asarray(inverse / np.sqrt(stretch)),
            jnp.asarray(free),
        )

    def displacement(self, z: Float[Array, " d *nodes"]) -> Float[Array, " d *nodes"]:
        """Displacement of the nodes [mm], component first."""
        lengthwise = jnp.sum(self.direction * z, axis=0)
        scaled = (
            self.across[None] * z + self.direction * ((self.along - self.across) * lengthwise)[None]
        )
        components = []
        for c in range(len(z)):
            u = scaled[c]
            # One axis at a time: (n+1)^4 operations each instead of (n+1)^6 at once.
            for k in range(len(z)):
                modes = self.sines[k] if k == c else self.cosines[k]
                u = jnp.moveaxis(jnp.tensordot(modes, u, axes=(1, k)), 0, k)
            components.append(u)
        return jnp.where(self.free, jnp.stack(components), 0.0)
