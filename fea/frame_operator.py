"""The stiffness of a frame as a rule for products that is never assembled."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fea.linear_solve.element_operator import masked_blocks

# Stiffness of the elements of each group, their joints, and which dofs are free.
Elements = tuple[tuple[Array, ...], tuple[Array, ...], Array]


def product(elements: Elements, u: Float[Array, "joints 6"]) -> Float[Array, "joints 6"]:
    """K u of elements, group by group; fixed dofs act as identity.

    Args:
        elements: see `Elements`.
        u: displacements and rotations.
    """
    stiffness, nodes, free = elements
    moving = jnp.where(free, u, 0.0)
    total = jnp.zeros_like(u)
    for K, at in zip(stiffness, nodes, strict=True):
        forces = jnp.einsum("eij,ej->ei", K, moving[at].reshape(len(at), K.shape[1]))
        total = total.at[at].add(forces.reshape(*at.shape, u.shape[1]))
    return jnp.where(free, total, u)


@jax.jit
def diagonal_blocks(elements: Elements) -> Float[Array, "joints 6 6"]:
    """Diagonal blocks of K, with ones on the diagonal of fixed dofs."""
    stiffness, nodes, free = elements
    joints, block = free.shape
    blocks = jnp.zeros((joints, block, block))
    for K, at in zip(stiffness, nodes, strict=True):
        corners = at.shape[1]
        whole = K.reshape(len(at), corners, block, corners, block)
        own = jnp.stack([whole[:, i, :, i] for i in range(corners)], axis=1)
        blocks = blocks.at[at].add(own)
    return masked_blocks(blocks, free)
