"""Couplings: nodes whose motion is that of others.

A coupling makes nodes *dependent*: u_d = sum_k B_dk u_k, displacements and rotations together, with
6 x 6 blocks B that follow the positions; `fea.transfer` takes dependent nodes out of the system. Every
coupling here reproduces rigid motions exactly, so loads keep their resultant force and moment.

`Rigid` is what other programs call RBE2, `Distributing` RBE3. A dependent node may itself
carry a coupling's other nodes, as long as there is no circle.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fea.beam import BLOCK, cross_matrix
from fea.errors import FeaError, position_text

# Largest difference of the sum of shape functions from one.
PARTITION_OF_UNITY = 1e-9

# A distributing coupling resists turning about an axis with at least this share of what it does about
# the others; nodes on one line give rounding, 1e-16.
TURNS = 1e-9


class AbstractCoupling(abc.ABC):
    """Nodes that follow others; a leaf is a frozen dataclass.

    Attributes:
        joins: whether the nodes on both sides are then joined like welded parts: nothing can move that
            is not a rigid motion of all of them; for a tie, if its triangle's corners are.
    """

    joins: ClassVar[bool]

    @property
    @abc.abstractmethod
    def followers(self) -> Int[np.ndarray, " followers"]:
        """The dependent nodes, each once."""

    @property
    @abc.abstractmethod
    def links(self) -> Int[np.ndarray, "links 2"]:
        """Pairs of a dependent node and one that it follows."""

    @abc.abstractmethod
    def blocks(self, points: Float[Array, "nodes 3"]) -> Float[Array, "links 6 6"]:
        """What a unit motion of the second node of each link adds to the first."""

    @abc.abstractmethod
    def arms(self, points: Float[Array, "nodes 3"]) -> Float[Array, "followers 3"]:
        """To each follower, from the point that moves with the others and turns with them about it."""

    @abc.abstractmethod
    def check(self, points: Float[np.ndarray, "nodes 3"]) -> None:
        """Refuse what defines no motion.

        Raises:
            FeaError: with what is wrong, where, and the remedy.
        """


@dataclass(frozen=True, eq=False)
class Rigid(AbstractCoupling):
    """Nodes that move as one rigid body with a reference node.

    Loads and supports of the body go to the reference node.

    Attributes:
        reference: the node whose motion is the body's.
        nodes: those that follow it, displacements and rotations.
    """

    joins: ClassVar[bool] = True

    reference: int
    nodes: Int[np.ndarray, " nodes"]

    @property
    def followers(self) -> Int[np.ndarray, " followers"]:
        """The nodes."""
        return self.nodes

    @property
    def links(self) -> Int[np.ndarray, "links 2"]:
        """Each node with the reference."""
        return np.stack([self.nodes, np.full_like(self.nodes, self.reference)], axis=1)

    def blocks(self, points: Float[Array, "nodes 3"]) -> Float[Array, "links 6 6"]:
        """Displacement u + theta x arm, rotation theta."""
        return _carried(self.arms(points))

    def arms(self, points: Float[Array, "nodes 3"]) -> Float[Array, "followers 3"]:
        """From the reference."""
        return points[self.nodes] - points[self.reference][None]

    def check(self, points: Float[np.ndarray, "nodes 3"]) -> None:
        """See `AbstractCoupling`."""
        _check_nodes("A rigid coupling", self.nodes)


@dataclass(frozen=True, eq=False)
class Distributing(AbstractCoupling):
    """A reference node that moves as some nodes do on average, and stiffens nothing.

    Its motion is the rigid one nearest to theirs: it minimises

        sum_i w_i (|u_i - u(x_i)|² + lever² |theta_i - theta|²).

    So a load on it is spread over the nodes with the weights: a force as forces along it, a moment as
    forces w_i theta x arm (and, with a lever, moments) of its resultant.

    Attributes:
        reference: the node that follows; it may be loaded, but not fixed.
        nodes: those that it follows.
        weights: of the nodes, such as the area that each stands for; None: equal.
        lever: weight of the nodes' rotations against their displacements [mm]; zero leaves the
            rotations out, and the nodes must then not lie on one line.
    """

    # Between several bodies it holds their mean motion only.
    joins: ClassVar[bool] = False

    reference: int
    nodes: Int[np.ndarray, " nodes"]
    weights: Float[np.ndarray, "..."] | None = None
    lever: float = 0.0

    @property
    def followers(self) -> Int[np.ndarray, " followers"]:
        """The reference node."""
        return np.array([self.reference])

    @property
    def links(self) -> Int[np.ndarray, "links 2"]:
        """The reference with each node."""
        return np.stack([np.full_like(self.nodes, self.reference), self.nodes], axis=1)

    def blocks(self, points: Float[Array, "nodes 3"]) -> Float[Array, "links 6 6"]:
        """The rigid motion nearest to the nodes', from its normal equations."""
        w = jnp.asarray(self._shares)
        x = points[self.nodes]
        arm = x - (w @ x)[None]
        flexibility = jnp.linalg.inv(self._inertia(arm))
        turn = jnp.einsum("n,ij,njk->nik", w, flexibility, cross_matrix(arm))
        spin = self.lever**2 * jnp.einsum("n,ij->nij", w, flexibility)
        lifted = cross_matrix(self.arms(points)[0])
        own = jnp.einsum("n,ij->nij", w, jnp.eye(3))
        return _block(
            own - jnp.einsum("ij,njk->nik", lifted, turn),
            -jnp.einsum("ij,njk->nik", lifted, spin),
            turn,
            spin,
        )

    def arms(self, points: Float[Array, "nodes 3"]) -> Float[Array, "followers 3"]:
        """From the nodes' weighted centre."""
        centre = jnp.asarray(self._shares) @ points[self.nodes]
        return (points[self.reference] - centre)[None]

    def check(self, points: Float[np.ndarray, "nodes 3"]) -> None:
        """See `AbstractCoupling`."""
        _check_nodes("A distributing coupling", self.nodes)
        if self.weights is not None:
            if self.weights.shape != self.nodes.shape:
                raise FeaError(
                    f"A distributing coupling of {len(self.nodes)} nodes has weights of shape "
                    f"{self.weights.shape}; give one a node."
                )
            if not (self.weights > 0).all() or not np.isfinite(self.weights).all():
                raise FeaError(
                    f"A distributing coupling has the weight {self.weights.min():g}; weights must be "
                    "positive numbers."
                )
        if len(np.unique(self.nodes)) < len(self.nodes):
            node = np.flatnonzero(np.bincount(self.nodes) > 1)[0]
            raise FeaError(
                f"A distributing coupling has node {node} at {position_text(points[node])} mm more than "
                "once; name it once, with the sum of its weights."
            )
        if not 0 <= self.lever < np.inf:
            raise FeaError(
                f"The lever of a distributing coupling is {self.lever:g} mm; give 0 or more, but finite."
            )
        x = points[self.nodes]
        arm = x - self._shares @ x
        resistance = np.linalg.eigvalsh(np.asarray(self._inertia(jnp.asarray(arm))))
        if not resistance[0] > TURNS * resistance[-1]:
            raise FeaError(
                f"The {len(self.nodes)} nodes of the distributing coupling with reference node "
                f"{self.reference} lie on one line near {position_text(x[0])} mm, so that nothing defines "
                "its rotation about that line; add nodes, or give a lever (about a strut's radius), so "
                "that their own rotations count."
            )

    @property
    def _shares(self) -> Float[np.ndarray, " nodes"]:
        weights = np.ones(len(self.nodes)) if self.weights is None else self.weights
        return weights / weights.sum()

    def _inertia(self, arm: Float[Array, "nodes 3"]) -> Float[Array, "3 3"]:
        w = jnp.asarray(self._shares)
        square = jnp.einsum("n,ni,nj->ij", w, arm, arm)
        return (jnp.trace(square) + self.lever**2) * jnp.eye(3) - square


@dataclass(frozen=True, eq=False)
class Tie(AbstractCoupling):
    """Nodes fastened to triangles by the triangles' shape functions.

    A node moves with the point of its triangle where the shape functions are as given, and turns with
    it about the arm from there to the node.

    Attributes:
        nodes: those that follow.
        corners: the three nodes of each one's triangle.
        shape: shape functions (barycentric coordinates) of the point it is fastened to.
    """

    joins: ClassVar[bool] = True

    nodes: Int[np.ndarray, " nodes"]
    corners: Int[np.ndarray, "..."]
    shape: Float[np.ndarray, "..."]

    @property
    def followers(self) -> Int[np.ndarray, " followers"]:
        """The nodes."""
        return self.nodes

    @property
    def links(self) -> Int[np.ndarray, "links 2"]:
        """Each node with its three corners."""
        return np.stack([np.repeat(self.nodes, 3), self.corners.ravel()], axis=1)

    def blocks(self, points: Float[Array, "nodes 3"]) -> Float[Array, "links 6 6"]:
        """The rigid block of the arm, times each shape function."""
        moved = _carried(self.arms(points))
        blocks = jnp.einsum("ni,nxy->nixy", jnp.asarray(self.shape), moved)
        return blocks.reshape(-1, BLOCK, BLOCK)

    def arms(self, points: Float[Array, "nodes 3"]) -> Float[Array, "followers 3"]:
        """From the points of the triangles."""
        foot = jnp.einsum("ni,nix->nx", jnp.asarray(self.shape), points[self.corners])
        return points[self.nodes] - foot

    def check(self, points: Float[np.ndarray, "nodes 3"]) -> None:
        """See `AbstractCoupling`."""
        _check_nodes("A tie", self.nodes)
        if not self.corners.shape == self.shape.shape == (len(self.nodes), 3):
            raise FeaError(
                f"A tie of {len(self.nodes)} nodes has corners of shape {self.corners.shape} and shape "
                f"functions of shape {self.shape.shape}; give three of each a node."
            )
        off = np.abs(self.shape.sum(axis=1) - 1)
        if not off.max() <= PARTITION_OF_UNITY:
            worst = int(np.argmax(off))
            raise FeaError(
                f"The shape functions of the tie of node {self.nodes[worst]} at "
                f"{position_text(points[self.nodes[worst]])} mm sum to {self.shape[worst].sum():g}; they "
                "must sum to 1."
            )


def _carried(arm: Float[Array, "links 3"]) -> Float[Array, "links 6 6"]:
    """Motion at the end of a rigid arm by that at its start: u + theta x arm, theta."""
    one = jnp.broadcast_to(jnp.eye(3), (len(arm), 3, 3))
    return _block(one, -cross_matrix(arm), jnp.zeros_like(one), one)


def _block(
    uu: Float[Array, "links 3 3"],
    ur: Float[Array, "links 3 3"],
    ru: Float[Array, "links 3 3"],
    rr: Float[Array, "links 3 3"],
) -> Float[Array, "links 6 6"]:
    """From displacement (u) and rotation (r) of one node to those of another."""
    return jnp.concatenate(
        [jnp.concatenate([uu, ur], axis=2), jnp.concatenate([ru, rr], axis=2)], axis=1
    )


def _check_nodes(what: str, nodes: Int[np.ndarray, " nodes"]) -> None:
    if len(nodes) == 0:
        raise FeaError(f"{what} has no nodes; widen the region that chooses them, or leave it out.")


def check_couplings(
    couplings: Sequence[AbstractCoupling],
    points: Float[np.ndarray, "nodes 3"],
    fixed: Bool[np.ndarray, "nodes 6"],
) -> None:
    """Refuse couplings that define no motion, or too many.

    Args:
        couplings: any number.
        points: positions of all nodes [mm].
        fixed: prescribed dofs.

    Raises:
        FeaError: when a coupling is malformed, a node follows twice or follows itself, or is fixed and
            follows others.
    """
    nodes = len(points)
    for coupling in couplings:
        links = coupling.links
        if links.size and not 0 <= links.min() <= links.max() < nodes:
            raise FeaError(
                f"Couplings refer to nodes {links.min()} to {links.max()}, but the model has nodes 0 to "
                f"{nodes - 1}."
            )
        coupling.check(points)
    if not couplings:
        return
    count = np.zeros(len(points), dtype=int)
    for coupling in couplings:
        np.add.at(count, coupling.followers, 1)
    twice = np.flatnonzero(count > 1)
    if twice.size:
        raise FeaError(
            f"Node {twice[0]} at {position_text(points[twice[0]])} mm follows others {count[twice[0]]} "
            "times through couplings; a node can follow once."
        )
    dependent = count > 0
    links = np.concatenate([coupling.links for coupling in couplings])
    inner = links[dependent[links[:, 1]]]
    graph = coo_array((np.ones(len(inner)), (inner[:, 0], inner[:, 1])), shape=(len(points),) * 2)
    parts, part = connected_components(graph, directed=True, connection="strong")
    itself = inner[:, 0] == inner[:, 1]
    if parts < len(points) or itself.any():
        size = np.bincount(part, minlength=parts)
        circle = np.flatnonzero(size[part] > 1) if parts < len(points) else inner[itself, 0]
        raise FeaError(
            f"Node {circle[0]} at {position_text(points[circle[0]])} mm follows itself through its "
            "couplings; take it out of one of them."
        )
    held = np.flatnonzero(dependent & fixed.any(axis=1))
    if held.size:
        raise FeaError(
            f"Node {held[0]} at {position_text(points[held[0]])} mm is fixed, but it follows others "
            "through a coupling; fix the nodes that it follows (of a rigid coupling, the reference "
            "node), or use a rigid coupling for a support."
        )
