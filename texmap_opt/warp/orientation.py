"""How well cells are turned: the strain energy of the stress in their frames against the best there is."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import generate_binary_structure, minimum_filter

# Rows and columns of the components of a symmetric tensor, in two dimensions xx, yy, xy.
_VOIGT = {
    2: (np.array([0, 1, 0]), np.array([0, 1, 1])),
    3: (np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])),
}

# Samples per axis of the covering of rotations. In three dimensions every rotation is one of the
# cube's 24 times one with a Rodrigues vector within tan(22.5 deg) along each axis; 9 samples there
# are 12 deg apart, so none is farther than 10.3 deg from a sample. In two, 32 over half a turn.
SAMPLES = {2: 32, 3: 9}
CUBE_REACH = float(np.tan(np.pi / 8))

# Along a turn about any axis the energy is a trigonometric polynomial of degree 4, whose second
# derivative is at most 16 times half its range (Bernstein). So a sample within 10.3 deg = 0.18 rad
# of the minimum lies above it by at most 4 x 0.18^2 of the range: only such starts can lead there.
REACH = 0.13

# Starts per cell at most, of the sampled local minima the lowest.
STARTS = 8

# Newton's steps per start: from 10 deg three to five reach rounding, but for flat valleys.
NEWTON_STEPS = 8
# Shorter steps are the last [rad]: what another would gain is their fourth power.
LAST_STEP = 1e-4
# Curvature over the largest below which a direction counts as flat.
FLAT = 1e-8
# First limit of a step [rad], and by how much it shrinks after a step that did not go down.
FIRST_STEP, SHRINKING = 0.25, 0.25

_SIGNS = tuple(product((1.0, -1.0), repeat=3))

# A compliance that a rotation changes by less than this share has that symmetry.
SAME = 1e-9

# Values at a time, of all samples of some cells: 32 MB.
_BLOCK_VALUES = 4_000_000


@dataclass(frozen=True)
class EnergyShare:
    """Weighted sums over cells of the strain energy in one frame or another, in units of the input.

    Attributes:
        uniform: in the frame of the box: no cell turned.
        warped: in the frames of the cells.
        best: in the best frame of each cell.
        worst: in the worst.
    """

    uniform: float
    warped: float
    best: float
    worst: float

    @property
    def share(self) -> float | None:
        """Share of the attainable gain that is reached; None where turning changes nothing."""
        attainable = self.uniform - self.best
        if attainable <= SAME * self.worst:
            return None
        return (self.uniform - self.warped) / attainable


def strain_energy(
    compliance: Float[np.ndarray, "_ _"],
    stress: Float[np.ndarray, "cases cells d d"],
    frames: Float[np.ndarray, "cells d d"],
) -> Float[np.ndarray, " cells"]:
    """1/2 sum over load cases of sigma : C^-1 : sigma, sigma in the frame of each cell.

    Args:
        compliance: C^-1 in the axes of a cell, Voigt order, engineering shears: 6 x 6, or 3 x 3
            (xx, yy, xy) in two dimensions.
        stress: in the axes of the box.
        frames: unit vectors of each cell's frame as rows, in the axes of the box.
    """
    v = _components(frames @ stress @ np.swapaxes(frames, -1, -2))
    return np.einsum("kcv,vw,kcw->c", v, compliance, v, optimize=True) / 2


def best_energy(
    compliance: Float[np.ndarray, "_ _"], stress: Float[np.ndarray, "cases cells d d"]
) -> Float[np.ndarray, " cells"]:
    """The least `strain_energy` that any rotation gives, cell by cell.

    For a cubic cell under one load case in closed form (`_cubic_minimum`). Else all samples of a
    covering of the rotations (fewer by the symmetries of the compliance), then Newton's method from
    every sampled local minimum that can lie above the global one. Accurate to rounding where one of
    the starts lies in the global minimum's valley: at all of 16,000 points with two and three random
    stresses, against a search twice as fine. Where none does, to `REACH` of the range.

    Args:
        compliance: as for `strain_energy`.
        stress: likewise.
    """
    d = stress.shape[-1]
    if d == 3 and len(stress) == 1 and _is_cubic(compliance):
        return _cubic_minimum(compliance, stress[0])
    rotations = _covering(compliance, d)
    T = _stress_rotations(rotations.reshape(-1, d, d))
    turned = (np.swapaxes(T, -1, -2) @ compliance @ T).reshape(len(T), -1)
    block = max(1, _BLOCK_VALUES // len(T))
    best = [
        _block_minimum(compliance, stress[:, first : first + block], rotations, turned)
        for first in range(0, stress.shape[1], block)
    ]
    return np.concatenate([np.zeros(0), *best])


def worst_energy(
    compliance: Float[np.ndarray, "_ _"], stress: Float[np.ndarray, "cases cells d d"]
) -> Float[np.ndarray, " cells"]:
    """The largest `strain_energy` that any rotation gives, cell by cell; see `best_energy`."""
    return -best_energy(-compliance, stress)


def energy_share(
    compliance: Float[np.ndarray, "_ _"],
    stress: Float[np.ndarray, "cases cells d d"],
    frames: Float[np.ndarray, "cells d d"],
    weights: Float[np.ndarray, " cells"],
) -> EnergyShare:
    """Energies of some cells, and how much of what turning them can gain is gained.

    All are taken at the same places, those of the cells as they are, so they differ by rotations
    alone.

    Args:
        compliance: as for `strain_energy`.
        stress: likewise, at the centres of the cells.
        frames: likewise.
        weights: of the cells, such as the part's volume in each times the square of the stress that
            `stress` was divided by; cells of weight zero are not looked at.
    """
    counted = weights > 0
    stress, frames, weights = stress[:, counted], frames[counted], weights[counted]
    box = np.broadcast_to(np.eye(stress.shape[-1]), frames.shape)
    return EnergyShare(
        uniform=float(weights @ strain_energy(compliance, stress, box)),
        warped=float(weights @ strain_energy(compliance, stress, frames)),
        best=float(weights @ best_energy(compliance, stress)),
        worst=float(weights @ worst_energy(compliance, stress)),
    )


def _is_cubic(compliance: Float[np.ndarray, "6 6"]) -> bool:
    s11, s12, s44 = compliance[0, 0], compliance[0, 1], compliance[3, 3]
    cubic = np.diag([s11 - s12] * 3 + [s44] * 3)
    cubic[:3, :3] += s12
    return bool(np.abs(compliance - cubic).max() <= SAME * np.abs(compliance).max())


def _cubic_minimum(
    compliance: Float[np.ndarray, "6 6"], stress: Float[np.ndarray, "cells 3 3"]
) -> Float[np.ndarray, " cells"]:
    """The least energy of one stress in a cubic cell.

    With s the compliance, U = 1/2 s12 (tr sigma)^2 + s44/4 |sigma|^2 + 1/2 k sum sigma_ii^2, the last
    over the cell's axes, k = s11 - s12 - s44/2. That sum is largest, |sigma|^2, along the principal
    axes and least, (tr sigma)^2 / 3, where the deviator has no diagonal, which some frame always
    attains.
    """
    s12, s44 = compliance[0, 1], compliance[3, 3]
    k = compliance[0, 0] - s12 - s44 / 2
    squared = np.einsum("cij,cij->c", stress, stress)
    trace = np.trace(stress, axis1=1, axis2=2) ** 2
    along = squared if k < 0 else trace / 3
    return s12 * trace / 2 + s44 * squared / 4 + k * along / 2


def _components(tensors: Float[np.ndarray, "*_ d d"]) -> Float[np.ndarray, "*_ v"]:
    rows, columns = _VOIGT[tensors.shape[-1]]
    return tensors[..., rows, columns]


def _stress_rotations(rotations: Float[np.ndarray, "*_ d d"]) -> Float[np.ndarray, "*_ v v"]:
    """Matrices that take a stress vector into a frame whose unit vectors are the rows."""
    d = rotations.shape[-1]
    units = _unit_stresses(d)
    turned = np.einsum("...ik,wkl,...jl->...wij", rotations, units, rotations, optimize=True)
    return np.swapaxes(_components(turned), -1, -2)


def _unit_stresses(d: int) -> Float[np.ndarray, "v d d"]:
    rows, columns = _VOIGT[d]
    units = np.zeros((len(rows), d, d))
    units[np.arange(len(rows)), rows, columns] = 1.0
    units[np.arange(len(rows)), columns, rows] = 1.0
    return units


def _generators(d: int) -> Float[np.ndarray, "turns d d"]:
    """Skew matrices of small turns: about the three axes, or in the plane."""
    planes = ((0, 1),) if d == 2 else ((1, 2), (2, 0), (0, 1))
    A = np.zeros((len(planes), d, d))
    for k, (i, j) in enumerate(planes):
        A[k, i, j], A[k, j, i] = -1.0, 1.0
    return A


def _covering(compliance: Float[np.ndarray, "_ _"], d: int) -> Float[np.ndarray, "..."]:
    """Rotations as a block of neighbours: cosets, samples along each axis, d, d."""
    n = SAMPLES[d]
    if d == 2:
        # Half a turn: a stress turned by half a turn is the same.
        angle = np.pi * np.arange(n) / n
        turns = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return np.moveaxis(turns, -1, 0)[None]
    axis = np.linspace(-CUBE_REACH, CUBE_REACH, n)
    rodrigues = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    small = _cayley(2 * rodrigues)
    cosets = _cosets(compliance)
    return cosets[:, None, None, None] @ small[None]


def _cosets(compliance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "_ 3 3"]:
    """Of the cube's 24 rotations one of each set that turns the compliance into the same."""
    signed = [np.diag(s) @ np.eye(3)[list(p)] for p in permutations(range(3)) for s in _SIGNS]
    group = np.array([g for g in signed if np.linalg.det(g) > 0])
    T = _stress_rotations(group)
    turned = (np.swapaxes(T, -1, -2) @ compliance @ T).reshape(len(group), -1)
    apart = np.abs(turned[:, None] - turned[None]).max(axis=-1) > SAME * np.abs(compliance).max()
    # The first of each set: none before it is the same.
    return group[[bool(apart[k, :k].all()) for k in range(len(group))]]


def _cayley(omega: Float[np.ndarray, "*_ turns"]) -> Float[np.ndarray, "*_ d d"]:
    """The rotation with Rodrigues vector omega / 2: by omega, up to third order."""
    d = 2 if omega.shape[-1] == 1 else 3
    A = np.einsum("...k,kij->...ij", omega / 2, _generators(d))
    return np.linalg.solve(np.eye(d) - A, np.eye(d) + A)


def _block_minimum(
    compliance: Float[np.ndarray, "_ _"],
    stress: Float[np.ndarray, "cases cells d d"],
    rotations: Float[np.ndarray, "..."],
    turned: Float[np.ndarray, "samples _"],
) -> Float[np.ndarray, " cells"]:
    """The minimum over all rotations, for some cells."""
    cells, d = stress.shape[1], stress.shape[-1]
    v = _components(stress)
    products = np.einsum("kcv,kcw->cvw", v, v).reshape(cells, -1)
    values = products @ turned.T / 2
    owner, sample = _starts(values, rotations.shape[:-2])
    refined = _refined(compliance, stress[:, owner], rotations.reshape(-1, d, d)[sample])
    best = values.min(axis=1)
    np.minimum.at(best, owner, refined)
    return best


def _starts(
    values: Float[np.ndarray, "cells samples"], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, " points"], Int[np.ndarray, " points"]]:
    """Cell and sample of every local minimum that the global one may be near."""
    blocks = values.reshape(-1, *shape)
    # Two dimensions: angles, the last beside the first. Three: the faces of a cube, beyond which
    # lies another coset, or the same turned; a sample there counts as a minimum when no inner one
    # is lower.
    axes = len(shape) - 1
    beside = generate_binary_structure(axes, 1)[None, None]
    low = minimum_filter(blocks, footprint=beside, mode="wrap" if axes == 1 else "nearest")
    low = low.reshape(values.shape)
    least, largest = values.min(axis=1, keepdims=True), values.max(axis=1, keepdims=True)
    within = (values == low) & (values <= least + REACH * (largest - least))
    masked = np.where(within, values, np.inf)
    count = min(STARTS, masked.shape[1])
    lowest = np.argpartition(masked, count - 1, axis=1)[:, :count]
    owner, place = np.nonzero(np.take_along_axis(within, lowest, axis=1))
    return owner, lowest[owner, place]


def _refined(
    compliance: Float[np.ndarray, "_ _"],
    stress: Float[np.ndarray, "cases points d d"],
    rotations: Float[np.ndarray, "points d d"],
) -> Float[np.ndarray, " points"]:
    """Energies where Newton's method on the rotations ends, never above where it started."""
    derivatives = _derivatives(compliance, stress.shape[-1])
    energy = strain_energy(compliance, stress, rotations)
    limit = np.full(len(energy), FIRST_STEP)
    moving = np.arange(len(energy))
    for _ in range(NEWTON_STEPS):
        omega = _newton_step(derivatives, stress, rotations)
        length = np.linalg.norm(omega, axis=1)
        omega *= np.minimum(1.0, limit / np.maximum(length, limit))[:, None]
        trial = _cayley(omega) @ rotations
        reached = strain_energy(compliance, stress, trial)
        lower = reached < energy[moving]
        energy[moving[lower]] = reached[lower]
        rotations = np.where(lower[:, None, None], trial, rotations)
        limit = np.where(lower, limit, SHRINKING * np.minimum(limit, length))
        # A step this short was the last: the next would be its square.
        far = np.minimum(length, limit) > LAST_STEP
        if not far.any():
            break
        moving, limit = moving[far], limit[far]
        stress, rotations = stress[:, far], rotations[far]
    return energy


def _newton_step(
    derivatives: tuple[Float[np.ndarray, "turns _"], Float[np.ndarray, "turns_squared _"]],
    stress: Float[np.ndarray, "cases points d d"],
    rotations: Float[np.ndarray, "points d d"],
) -> Float[np.ndarray, "points turns"]:
    """Turns -|H|^-1 g: downhill also where the Hessian H is not definite."""
    slope, bend = derivatives
    v = _components(rotations @ stress @ np.swapaxes(rotations, -1, -2))
    products = np.einsum("kcv,kcw->cvw", v, v).reshape(v.shape[1], -1)
    gradient = products @ slope.T
    turns = gradient.shape[1]
    curvature, axes = np.linalg.eigh((products @ bend.T).reshape(-1, turns, turns))
    size = np.abs(curvature)
    size = np.maximum(size, FLAT * size.max(axis=1, keepdims=True) + np.finfo(float).tiny)
    along = (gradient[:, None] @ axes)[:, 0] / size
    return -(axes @ along[..., None])[..., 0]


def _derivatives(
    compliance: Float[np.ndarray, "_ _"], d: int
) -> tuple[Float[np.ndarray, "turns _"], Float[np.ndarray, "turns_squared _"]]:
    """Rows whose products with sum v v' are gradient and Hessian of the energy by small turns.

    With G_k the effect of turn k on the stress vector, v <- exp(sum omega_k G_k) v and
    U = 1/2 v' S v: dU/domega_k = v' S G_k v, and the second derivative is
    v' G_k' S G_l v + 1/2 v' S (G_k G_l + G_l G_k) v.
    """
    A, units = _generators(d), _unit_stresses(d)
    changes = np.einsum("kij,wjl->kwil", A, units) - np.einsum("wij,kjl->kwil", units, A)
    G = np.swapaxes(_components(changes), -1, -2)
    slope = np.einsum("vw,kwx->kvx", compliance, G)
    twice = np.einsum("kvw,lwx->klvx", slope, G)
    bend = np.einsum("kwv,lwx->klvx", G, slope)
    bend += (twice + np.swapaxes(twice, 0, 1)) / 2
    return slope.reshape(len(A), -1), bend.reshape(len(A) ** 2, -1)
