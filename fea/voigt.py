"""Symmetric tensors as 6-vectors and their invariants; the order is stated in `fea`."""

import numpy as np
from jaxtyping import Float

# Row and column of each component.
ROWS = np.array([0, 1, 2, 1, 0, 0])
COLUMNS = np.array([0, 1, 2, 2, 2, 1])

# Component of each place of the 3x3 tensor.
COMPONENT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def tensor(stress: Float[np.ndarray, "*shape 6"]) -> Float[np.ndarray, "*shape 3 3"]:
    """The 3x3 tensor of a stress 6-vector."""
    return stress[..., COMPONENT]


def vector(stress: Float[np.ndarray, "*shape 3 3"]) -> Float[np.ndarray, "*shape 6"]:
    """The 6-vector of a symmetric stress tensor; shears are means of both places."""
    return (stress[..., ROWS, COLUMNS] + stress[..., COLUMNS, ROWS]) / 2


def strain_tensor(strain: Float[np.ndarray, "*shape 6"]) -> Float[np.ndarray, "*shape 3 3"]:
    """The 3x3 tensor of a strain 6-vector, whose shears are engineering shears."""
    return tensor(strain * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]))


def hydrostatic(stress: Float[np.ndarray, "*shape 6"]) -> Float[np.ndarray, "*shape"]:
    """Mean normal stress; negative in compression."""
    return np.asarray(stress[..., :3].mean(axis=-1))


def deviator(stress: Float[np.ndarray, "*shape 6"]) -> Float[np.ndarray, "*shape 6"]:
    """Stress without its hydrostatic part."""
    volumetric = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return stress - hydrostatic(stress)[..., None] * volumetric


def von_mises(stress: Float[np.ndarray, "*shape 6"]) -> Float[np.ndarray, "*shape"]:
    """Equivalent stress sqrt(3/2 s:s) of the deviator s (von Mises 1913)."""
    s = deviator(stress)
    normal = (s[..., :3] ** 2).sum(axis=-1)
    shear = (s[..., 3:] ** 2).sum(axis=-1)
    return np.asarray(np.sqrt(1.5 * (normal + 2 * shear)))


def principal_values(stress: Float[np.ndarray, "*shape 6"]) -> Float[np.ndarray, "*shape 3"]:
    """Principal stresses, largest first."""
    return np.linalg.eigvalsh(tensor(stress))[..., ::-1]


def principal_directions(
    stress: Float[np.ndarray, "*shape 6"],
) -> Float[np.ndarray, "*shape 3 3"]:
    """Unit principal directions as rows, of the largest principal stress first; signs arbitrary."""
    _, columns = np.linalg.eigh(tensor(stress))
    return np.swapaxes(columns, -1, -2)[..., ::-1, :]
