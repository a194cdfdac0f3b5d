"""Scalars that designs are judged by, as functions of a displacement field that JAX differentiates.

Made for `fea.displacement`; any function of it written in JAX serves as well.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.boundary_conditions import traction_forces
from fea.elements import displacement_gradients
from fea.solid import SolidProblem, quadrature_stress
from fea.tet_mesh import TetMesh
from fea.voigt import von_mises

ArrayLike = Array | np.ndarray

# Exponent of a stress norm: near the largest value, and still smooth enough to optimise
# (Le, Norato, Bruns, Ha, Tortorelli, Struct. Multidisc. Optim. 41 (2010) 605-620, use 4 to 16).
STRESS_EXPONENT = 8.0


def compliance(
    displacement: Float[ArrayLike, "cases nodes block"],
    forces: Float[ArrayLike, "cases nodes block"],
) -> Float[Array, " cases"]:
    """Work u.f of the forces of each case [N mm]."""
    return jnp.einsum("cni,cni->c", displacement, forces)


def mean_displacement(
    mesh: TetMesh,
    facets: Int[np.ndarray, "facets corners"],
    displacement: Float[ArrayLike, "cases nodes 3"],
    *,
    nodes: Float[ArrayLike, "nodes 3"] | None = None,
) -> Float[Array, "cases 3"]:
    """Mean over the area of some facets [mm]: the work of a unit force spread over them.

    Args:
        mesh: gives positions where `nodes` is left out.
        facets: rows of `mesh.boundary_facets`.
        displacement: of the nodes [mm].
        nodes: their positions [mm].

    Raises:
        FeaError: when the facets have no area.
    """
    share = traction_forces(mesh, facets, np.array([1.0, 0.0, 0.0]), nodes=nodes)[:, 0]
    return jnp.einsum("n,cni->ci", share / share.sum(), displacement)


def p_norm(
    values: Float[ArrayLike, "*shape"], weights: Float[ArrayLike, "*shape"], *, p: float
) -> Float[Array, ""]:
    """Generalised mean (sum w v^p / sum w)^(1/p) of values that are not negative.

    It lies between the mean and the largest value, which it approaches as p grows. Powers are taken
    of values over their largest, so that none overflows.
    """
    # The scale cancels, so no derivative goes through it; where all is zero, any scale will do.
    largest = jax.lax.stop_gradient(jnp.max(jnp.asarray(values)))
    scale = jnp.where(largest > 0, largest, 1.0)
    ratio = jnp.asarray(values) / scale
    mean = jnp.sum(weights * ratio**p) / jnp.sum(jnp.asarray(weights))
    zero = mean == 0
    return jnp.where(zero, 0.0, scale * jnp.where(zero, 1.0, mean) ** (1 / p))


def stress_p_norm(
    problem: SolidProblem,
    displacement: Float[ArrayLike, "cases nodes 3"],
    *,
    p: float = STRESS_EXPONENT,
    nodes: Float[ArrayLike, "nodes 3"] | None = None,
    modulus: Float[ArrayLike, "cells samples"] | None = None,
) -> Float[Array, " cases"]:
    """Generalised mean over the volume of the von Mises stress of each case [MPa]; see `p_norm`.

    What `fea.displacement` was given by name must be given here too; see `fea.quadrature_stress`.

    Args:
        problem: gives cells and material, and what the arguments leave out.
        displacement: of the nodes [mm].
        p: exponent.
        nodes: positions [mm].
        modulus: relative modulus.
    """
    mesh = problem.mesh
    stress = von_mises(quadrature_stress(problem, displacement, nodes=nodes, modulus=modulus))
    x = jnp.asarray(mesh.nodes if nodes is None else nodes)[mesh.tets]
    _, volume = displacement_gradients(x, jnp.zeros_like(x), mesh.element_type)
    return jnp.stack([p_norm(case, volume, p=p) for case in stress])
