"""The variables of the least-squares warp: displacements about a grid, carried along by it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from texmap_opt.warp.grid import Grid
from texmap_opt.warp.modes import SlidingModes


class Variables(eqx.Module):
    """Nodes as a function of well-conditioned variables: x = x1 + J V A^(-1/2) z.

    V A^(-1/2) z (`SlidingModes`) is a displacement of the uniform grid that costs about |z|²/2. J,
    the gradient of the grid about which z counts, carries it along: where that grid has the wanted
    sizes, size over wanted size then changes by the divergence of the displacement to first order,
    whatever the cell's size, shape and direction are (docs/theory/warp.md, 3.5).

    Attributes:
        modes: of the uniform grid.
        nodes: x1, component first [mm].
        gradient: J at each node, relative to the uniform grid: component, axis, node.
    """

    modes: SlidingModes
    nodes: Float[Array, " d *nodes"]
    gradient: Float[Array, " d d *nodes"]

    @classmethod
    def about(
        cls, nodes: Float[Array, " d *nodes"], grid: Grid, modes: SlidingModes
    ) -> "Variables":
        """Variables that are zero at `nodes`.

        Args:
            nodes: of a grid without folds, component first [mm].
            grid: any grid with the same box and number of cells.
            modes: of that grid.
        """
        x = np.asarray(nodes)
        gradient = [np.gradient(x, axis=1 + axis) / h for axis, h in enumerate(grid.uniform_edge)]
        return cls(modes, jnp.asarray(nodes), jnp.asarray(np.stack(gradient, axis=1)))

    def at(self, z: Float[Array, " d *nodes"]) -> Float[Array, " d *nodes"]:
        """The nodes, component first [mm]."""
        moved = jnp.sum(self.gradient * self.modes.displacement(z)[None], axis=1)
        return self.nodes + jnp.where(self.modes.free, moved, 0.0)
