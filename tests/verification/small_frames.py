"""A small frame without symmetry, and the order of a Taylor remainder along a random direction."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.couplings import Distributing, Rigid
from fea.frame import FrameProblem
from fea.sections import Round
from fea.skin import Skin


def space_frame(
    *, cells: int = 2, skin: bool = False, coupling: type[Rigid | Distributing] | None = None
) -> FrameProblem:
    """A jittered block on clamped feet, two load cases that press on its head.

    Args:
        cells: along each edge.
        skin: whether its head is covered.
        coupling: whether the load acts on a reference joint above the head, and how it follows.
    """
    rng = np.random.default_rng(3)
    side = cells + 1
    grid = np.stack(np.meshgrid(*[np.arange(float(side))] * 3, indexing="ij"), -1).reshape(-1, 3)
    joints = grid * [10, 9, 8] + rng.uniform(-1, 1, (side**3, 3))
    step = np.abs(grid[:, None] - grid[None]).sum(axis=2)
    a, b = np.nonzero(np.triu((step > 0) & (step < 3) & (np.ptp(grid, axis=0).max() > 0)))
    near = np.linalg.norm(joints[a] - joints[b], axis=1) < 14.5
    struts = np.stack([a[near], b[near]], axis=1)
    head = np.flatnonzero(grid[:, 2] == cells)
    fixed = np.repeat((grid[:, 2] == 0)[:, None], 6, axis=1)
    forces = rng.normal(size=(2, len(joints), 6)) * 0.1
    forces[:, head, 2] -= 2.0
    couplings: tuple[Rigid | Distributing, ...] = ()
    if coupling is not None:
        reference = len(joints)
        joints = np.concatenate([joints, joints[head].mean(axis=0)[None] + [[1.0, -1.0, 6.0]]])
        fixed = np.concatenate([fixed, np.zeros((1, 6), dtype=bool)])
        forces = np.concatenate([forces, np.zeros((2, 1, 6))], axis=1)
        forces[:, reference, :3] = [1.0, 0.5, -8.0]
        couplings = (coupling(reference, head[:4]),)
    count = len(struts)
    return FrameProblem(
        joints=joints,
        struts=struts,
        radii=rng.uniform(0.4, 0.6, (count, 2)),
        E=1000.0,
        nu=0.3,
        section=Round(),
        fixed=fixed,
        value=np.zeros(fixed.shape),
        forces=forces,
        rigid_ends=rng.uniform(0.2, 0.8, (count, 2)),
        modulus=rng.uniform(0.8, 1.2, count),
        strut_loads=rng.normal(size=(2, count, 3, 3)) * 0.02,
        skin=_cover(head.reshape(side, side), rng) if skin else None,
        couplings=couplings,
    )


def _cover(head: np.ndarray, rng: np.random.Generator) -> Skin:
    a, b, c, d = head[:-1, :-1], head[1:, :-1], head[1:, 1:], head[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return Skin(triangles, rng.uniform(0.3, 0.5, len(triangles)), 1500.0, 0.25)


def remainder_orders(
    function: Callable[[Array], Array],
    at: Float[np.ndarray, "..."],
    *,
    steps: tuple[float, ...] = (2e-3, 1e-3),
) -> Float[np.ndarray, " halvings"]:
    """Observed orders of |g(h) - g(0) - h g'| as h halves, along a random direction."""
    direction = np.random.default_rng(1).normal(size=at.shape)
    # A tenth of the size of the values, or of the distances between them, is a large change.
    direction *= 0.1 * max(min(np.abs(at).max(), 3.0), 0.1) / np.abs(direction).max()
    slope = float(np.vdot(jax.grad(function)(jnp.asarray(at)), direction))
    start = float(function(jnp.asarray(at)))
    rest = np.array(
        [abs(float(function(jnp.asarray(at + h * direction))) - start - h * slope) for h in steps]
    )
    assert abs(slope) > 1e-6 * abs(start)
    return np.log2(rest[:-1] / rest[1:])
