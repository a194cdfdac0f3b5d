"""The nodes that couplings leave, and how all others follow them: u = T q.

With q on the nodes that are left, the structure's stiffness is Tᵀ K T and its loads Tᵀ f: symmetric,
without multipliers or penalties (Cook, Malkus, Plesha, Witt, Concepts and Applications of Finite
Element Analysis, 4th ed., section 13.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import bsr_array

from fea.beam import BLOCK
from fea.couplings import AbstractCoupling


@dataclass(frozen=True, eq=False)
class Transfer:
    """u = T q for given positions.

    Attributes:
        couplings: what makes nodes dependent.
        points: positions of all nodes [mm].
        step: the blocks B, from all nodes to the dependent ones.
        matrix: T; the columns of dependent nodes are empty.
        dependent: which nodes follow others.
    """

    couplings: tuple[AbstractCoupling, ...]
    points: Float[np.ndarray, "nodes 3"]
    step: bsr_array
    matrix: bsr_array
    dependent: Bool[np.ndarray, " nodes"]

    @classmethod
    def of(
        cls, couplings: Sequence[AbstractCoupling], points: Float[np.ndarray, "nodes 3"]
    ) -> "Transfer":
        """Find T of couplings that `check_couplings` has passed.

        Args:
            couplings: at least one.
            points: positions of all nodes [mm].
        """
        nodes = len(points)
        dependent = np.zeros(nodes, dtype=bool)
        dependent[np.concatenate([coupling.followers for coupling in couplings])] = True
        links = np.concatenate([coupling.links for coupling in couplings])
        blocks = np.concatenate([np.asarray(c.blocks(jnp.asarray(points))) for c in couplings])
        step = _block_matrix(links, blocks, nodes)
        return cls(tuple(couplings), points, step, _closed(step, dependent), dependent)

    def spread(self, q: Float[np.ndarray, "cases nodes 6"]) -> Float[np.ndarray, "cases nodes 6"]:
        """Fields on all nodes from those on independent nodes, T q."""
        return _times(self.matrix, q)

    def gathered(
        self, forces: Float[np.ndarray, "cases nodes 6"]
    ) -> Float[np.ndarray, "cases nodes 6"]:
        """Forces and moments on independent nodes, Tᵀ f; zero on dependent ones."""
        return _times(self.matrix.T, forces)

    def gradient(
        self, a: Float[np.ndarray, "cases nodes 6"], u: Float[np.ndarray, "cases nodes 6"]
    ) -> Float[np.ndarray, "nodes 3"]:
        """Derivative of sum_c a_c' T q_c by the positions, a and q held; u = T q.

        From u = B u + q: du = (1 - B)⁻¹ dB u, and the inverse is a finite sum.
        """
        total = _summed(self.step.T, a)
        points = jnp.asarray(self.points)
        return np.asarray(sum(_coupling_gradient(c, points, total, u) for c in self.couplings))

    def geometric_stiffness(
        self, exerted: Float[np.ndarray, "nodes 6"]
    ) -> Float[np.ndarray, "nodes 3 3"]:
        """Second-order stiffness of the couplings' arms, by the rotation of each node [N mm].

        The end of an arm a that turns by theta moves by theta x (theta x a)/2 beyond the first order.
        Under a force F there that changes the energy by -F.(theta x (theta x a))/2, which is negative
        where F presses on the arm. Moments are left out, as those of struts are.

        Args:
            exerted: what the couplings must carry, loads less K u.
        """
        force = self._carried(exerted)
        arm = np.zeros_like(force)
        for coupling in self.couplings:
            arm[coupling.followers] = coupling.arms(jnp.asarray(self.points))
        both = force[:, :, None] * arm[:, None, :]
        trace = np.trace(both, axis1=1, axis2=2)
        return trace[:, None, None] * np.eye(3) - (both + both.transpose(0, 2, 1)) / 2

    def geometric_gradient(
        self, exerted: Float[np.ndarray, "nodes 6"], x: Float[np.ndarray, "nodes 6"]
    ) -> tuple[Float[np.ndarray, "nodes 3"], Float[np.ndarray, "nodes 6"]]:
        """Derivatives of the work of `geometric_stiffness` on x, by positions and by what is exerted."""
        force, points = self._carried(exerted), jnp.asarray(self.points)
        moved, by_points = np.zeros_like(x), np.zeros_like(self.points)
        for coupling in self.couplings:
            at = coupling.followers
            theta = x[at, 3:]
            arm, pull = jax.vjp(coupling.arms, points)
            moved[at, :3] = -np.cross(theta, np.cross(theta, arm))
            (by,) = pull(jnp.asarray(-np.cross(theta, np.cross(theta, force[at]))))
            by_points += np.asarray(by)
        moved = _summed(self.step, moved[None])
        return by_points + self.gradient(exerted[None], moved), moved[0]

    def _carried(self, exerted: Float[np.ndarray, "nodes 6"]) -> Float[np.ndarray, "nodes 3"]:
        """Force on each node, with that of all nodes that follow it."""
        return _summed(self.step.T, exerted[None])[0, :, :3]


def _coupling_gradient(
    coupling: AbstractCoupling,
    points: Float[Array, "nodes 3"],
    a: Float[np.ndarray, "cases nodes 6"],
    u: Float[np.ndarray, "cases nodes 6"],
) -> Float[Array, "nodes 3"]:
    follower, leader = coupling.links.T

    def value(points: Float[Array, "nodes 3"]) -> Float[Array, ""]:
        # case, link, dof of the follower, dof of the leader
        return jnp.einsum("cli,lij,clj->", a[:, follower], coupling.blocks(points), u[:, leader])

    return jax.grad(value)(points)


def _block_matrix(
    links: Int[np.ndarray, "links 2"], blocks: Float[np.ndarray, "links 6 6"], nodes: int
) -> bsr_array:
    order = np.lexsort((links[:, 1], links[:, 0]))
    row, column = links[order].T
    indptr = np.searchsorted(row, np.arange(nodes + 1)).astype(np.int32)
    size = nodes * BLOCK
    return bsr_array((blocks[order], column.astype(np.int32), indptr), shape=(size, size))


def _closed(step: bsr_array, dependent: Bool[np.ndarray, " nodes"]) -> bsr_array:
    """T = (1 + B + B² + ...) P with P the identity on independent nodes; B has no circles."""
    free = np.flatnonzero(~dependent)
    one = np.tile(np.eye(BLOCK), (len(free), 1, 1))
    power = T = _block_matrix(np.stack([free, free], axis=1), one, len(dependent))
    while True:
        power = bsr_array(step @ power, blocksize=(BLOCK, BLOCK))
        if power.nnz == 0:
            return T
        T = bsr_array(T + power, blocksize=(BLOCK, BLOCK))


def _times(
    matrix: bsr_array, fields: Float[np.ndarray, "cases nodes 6"]
) -> Float[np.ndarray, "cases nodes 6"]:
    return (matrix @ fields.reshape(len(fields), -1).T).T.reshape(fields.shape)


def _summed(
    step: bsr_array, fields: Float[np.ndarray, "cases nodes 6"]
) -> Float[np.ndarray, "cases nodes 6"]:
    """(1 - step)⁻¹ of fields, a finite sum."""
    total = more = fields
    while (more := _times(step, more)).any():
        total = total + more
    return total
