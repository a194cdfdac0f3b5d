"""Symmetric tensors as 6-vectors: invariants and rotation; the order is stated in `fea`.

Every function takes NumPy or JAX arrays and returns the same kind.
"""

from typing import TypeVar

import numpy as np
from jaxtyping import Array, Float

Kind = TypeVar("Kind", np.ndarray, Array)

# Row and column of each component.
ROWS = np.array([0, 1, 2, 1, 0, 0])
COLUMNS = np.array([0, 1, 2, 2, 2, 1])

# Component of each place of the 3x3 tensor.
COMPONENT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def tensor(stress: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape 3 3"]:
    """The 3x3 tensor of a stress 6-vector."""
    return stress[..., COMPONENT]


def vector(stress: Float[Kind, "*shape 3 3"]) -> Float[Kind, "*shape 6"]:
    """The 6-vector of a symmetric stress tensor; shears are means of both places."""
    return (stress[..., ROWS, COLUMNS] + stress[..., COLUMNS, ROWS]) / 2


def strain_tensor(strain: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape 3 3"]:
    """The 3x3 tensor of a strain 6-vector, whose shears are engineering shears."""
    xp = strain.__array_namespace__()
    return tensor(xp.concatenate([strain[..., :3], strain[..., 3:] / 2], axis=-1))


def strain_vector(strain: Float[Kind, "*shape 3 3"]) -> Float[Kind, "*shape 6"]:
    """The 6-vector of a symmetric strain tensor, with engineering shears."""
    xp = strain.__array_namespace__()
    half = vector(strain)
    return xp.concatenate([half[..., :3], 2 * half[..., 3:]], axis=-1)


def hydrostatic(stress: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape"]:
    """Mean normal stress; negative in compression."""
    return stress.__array_namespace__().asarray(stress[..., :3].mean(axis=-1))


def deviator(stress: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape 6"]:
    """Stress without its hydrostatic part."""
    xp = stress.__array_namespace__()
    normal = stress[..., :3] - hydrostatic(stress)[..., None]
    return xp.concatenate([normal, stress[..., 3:]], axis=-1)


def von_mises(stress: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape"]:
    """Equivalent stress sqrt(3/2 s:s) of the deviator s (von Mises 1913).

    A cone, without a derivative at its tip: where the deviator is zero JAX is given the
    derivative zero, which is a subgradient, rather than the NaN of the square root.
    """
    xp = stress.__array_namespace__()
    s = deviator(stress)
    squared = 1.5 * ((s[..., :3] ** 2).sum(axis=-1) + 2 * (s[..., 3:] ** 2).sum(axis=-1))
    zero = squared == 0  # not `<= 0`: what is not a number stays so
    # The inner choice keeps the root away from zero, also for the derivative.
    return xp.asarray(xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, squared))))


def principal_values(stress: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape 3"]:
    """Principal stresses, largest first."""
    xp = stress.__array_namespace__()
    return xp.linalg.eigvalsh(tensor(stress))[..., ::-1]


def principal_directions(stress: Float[Kind, "*shape 6"]) -> Float[Kind, "*shape 3 3"]:
    """Unit principal directions as rows, of the largest principal stress first; signs arbitrary.

    Where principal stresses coincide their directions are arbitrary and have no derivative.
    """
    xp = stress.__array_namespace__()
    _, columns = xp.linalg.eigh(tensor(stress))
    return xp.swapaxes(columns, -1, -2)[..., ::-1, :]


def stress_rotation(R: Float[Kind, "*shape 3 3"]) -> Float[Kind, "*shape 6 6"]:
    """The matrix T that turns stress 6-vectors as R turns vectors: T sigma is R sigma Rᵀ.

    B. A. Auld, Acoustic Fields and Waves in Solids 1 (1973), section 3.D: Bond's matrix M.
    """
    xp = R.__array_namespace__()
    # Column w is the turned unit stress w.
    turned = xp.einsum("...ik,wkl,...jl->...wij", R, tensor(np.eye(6)), R)
    return xp.swapaxes(vector(turned), -1, -2)


def strain_rotation(R: Float[Kind, "*shape 3 3"]) -> Float[Kind, "*shape 6 6"]:
    """The same for strain 6-vectors, with engineering shears; inverse transpose of Bond's M."""
    xp = R.__array_namespace__()
    turned = xp.einsum("...ik,wkl,...jl->...wij", R, strain_tensor(np.eye(6)), R)
    return xp.swapaxes(strain_vector(turned), -1, -2)


def turned_stress(
    stress: Float[Kind, "*shape 6"], R: Float[Kind, "*#shape 3 3"]
) -> Float[Kind, "*shape 6"]:
    """Stress 6-vectors of a body that is turned by R, with its stress, in the same axes.

    Components in other axes, whose unit vectors are the rows of A: `turned_stress(stress, A)`.
    """
    xp = stress.__array_namespace__()
    return vector(xp.einsum("...ik,...kl,...jl->...ij", R, tensor(stress), R))


def turned_stiffness(
    C: Float[Kind, "*shape 6 6"], R: Float[Kind, "*#shape 3 3"]
) -> Float[Kind, "*shape 6 6"]:
    """Elasticity matrix of a material that is turned by R: T C Tᵀ, T of `stress_rotation`."""
    T = stress_rotation(R)
    xp = C.__array_namespace__()
    return xp.einsum("...vi,...ij,...wj->...vw", T, C, T)
