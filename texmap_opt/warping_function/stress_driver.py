"""The driver of the paper: f is a measure of the part's stress under its loads."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.tet_mesh import TetMesh
from fea.voigt import principal_values, turned_stress, von_mises
from texmap_opt.errors import WarpError, nearest_name
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.concrete import is_concrete
from texmap_opt.warping_function.driven_field import DrivenField
from texmap_opt.warping_function.normalised_convolution import (
    deposit,
    normalised_convolution,
    presence,
)

# Stress below this part of its root mean square over the volume carries no information: it is
# discretisation error there, and its logarithm would outweigh everything around it.
STRESS_FLOOR = 1e-2

# A measure below this part of that of uniaxial tension as strong as the stress is rounding: von Mises
# stress under pure pressure comes out as some 1e-16 of it.
ROUNDING = 1e-12

CASE_COMBINATIONS = ("worst", "sum")

# A scalar per load case and point from stress 6-vectors.
Measure = Callable[[Float[Array, "cases samples 6"]], Float[Array, "cases samples"]]


@dataclass(frozen=True, eq=False)
class StressSamples:
    """Stress at scattered points of a part.

    Attributes:
        points: positions in space [mm].
        volumes: volume each point stands for [mm³]; where points are dense each counts for less.
        stress: Voigt components of each load case [MPa]; may be traced by JAX.
        case_weights: what the stress of each case is multiplied by; None: 1.
    """

    points: Float[np.ndarray, "samples 3"]
    volumes: Float[np.ndarray, " samples"]
    stress: Float[Array | np.ndarray, "cases samples 6"]
    case_weights: Float[Array | np.ndarray, " cases"] | None = None

    @classmethod
    def from_mesh(
        cls,
        mesh: TetMesh,
        stress: Float[Array | np.ndarray, "cases nodes 6"],
        *,
        case_weights: Float[Array | np.ndarray, " cases"] | None = None,
    ) -> "StressSamples":
        """Nodal stresses of a tet mesh; each tet's volume is shared evenly by its nodes."""
        share = np.repeat(mesh.volumes / mesh.tets.shape[1], mesh.tets.shape[1])
        volumes = np.bincount(mesh.tets.ravel(), weights=share, minlength=len(mesh.nodes))
        return cls(mesh.nodes, volumes, stress, case_weights)

    @property
    def weighted(self) -> Float[Array, "cases samples 6"]:
        """The stress times the weights of the cases [MPa]."""
        stress = jnp.asarray(self.stress)
        if self.case_weights is None:
            return stress
        return stress * jnp.asarray(self.case_weights)[:, None, None]


def largest_principal(
    stress: Float[Array, "cases samples 6"],
) -> Float[Array, "cases samples"]:
    """Largest principal stress in size, tension or compression [MPa]."""
    return jnp.max(jnp.abs(principal_values(stress)), axis=-1)


def strain_energy_density(E: float, nu: float) -> Measure:
    """Strain energy per volume of an isotropic solid [N mm/mm³], as a function of its stress.

    w = ((1 + nu) sigma:sigma - nu (tr sigma)²) / (2 E); Timoshenko, Goodier, Theory of Elasticity
    (1970), section 84.

    Args:
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
    """

    def density(stress: Float[Array, "cases samples 6"]) -> Float[Array, "cases samples"]:
        squared = _squared_norm(stress)
        return ((1 + nu) * squared - nu * stress[..., :3].sum(axis=-1) ** 2) / (2 * E)

    return density


def stress_driver(
    samples: StressSamples,
    grid: BackgroundGrid,
    *,
    smoothing_mm: float,
    measure: Measure = von_mises,
    combine_cases: str = "worst",
) -> DrivenField:
    """The field of a stress: log f from a measure of it, and the stress itself for turning cells.

    log f and the stress of every case, over its root mean square in the part, are averaged over a
    Gaussian neighbourhood and extended beyond the part (`normalised_convolution`). Averaging the
    logarithm, a stress concentration of a few nodes does not decide for the size of its whole
    neighbourhood; averaging the stress itself, a neighbourhood that carries little does not decide
    for the direction of one that carries much. The stress fades where the part ends (`presence`).

    Args:
        samples: stress at points in the part.
        grid: the background grid.
        smoothing_mm: standard deviation of the Gaussian [mm]; half the edge of a cell is the least
            that a grid of such cells can follow.
        measure: scalar of a stress, positive wherever the stress is not zero.
        combine_cases: one of `CASE_COMBINATIONS`. "worst": f is the largest measure over the load
            cases, each point fears its own worst case; "sum": their sum.

    Raises:
        WarpError: if the measure is zero everywhere, or not finite somewhere; for an unknown
            combination of the cases.
    """
    if combine_cases not in CASE_COMBINATIONS:
        raise WarpError(
            f'Load cases cannot be combined by "{combine_cases}"; '
            f"{nearest_name(combine_cases, CASE_COMBINATIONS)}"
        )
    stress, volumes = samples.weighted, jnp.asarray(samples.volumes)
    of_case = measure(stress)
    f = jnp.max(of_case, axis=0) if combine_cases == "worst" else jnp.sum(of_case, axis=0)
    if is_concrete(f):
        _require_drive(f, stress, measure)
    fields = _fields(f, stress, volumes, jnp.asarray(grid.box.axes))
    points = grid.box.coordinates(samples.points)
    smooth = normalised_convolution(
        grid, points, samples.volumes, fields, smoothing_mm=smoothing_mm
    )
    importance = deposit(grid, points, samples.volumes)
    # Cells outside the part carry nothing: their direction must not compete with that of the others.
    # The root, since energies go with the square of the stress.
    inside = np.sqrt(presence(grid, points, samples.volumes, smoothing_mm=smoothing_mm))
    return DrivenField(smooth[..., 0], importance, smooth[..., 1:] * inside[..., None])


def _require_drive(
    f: Float[Array, " samples"], stress: Float[Array, "cases samples 6"], measure: Measure
) -> None:
    bad = int(jnp.sum(~jnp.isfinite(f)))
    if bad:
        raise WarpError(
            f"The stress is not a finite number at {bad} of {len(f)} points, so no warp can "
            "follow it: check the analysis."
        )
    norm = jnp.sqrt(jnp.max(jnp.sum(_squared_norm(stress), axis=0)))
    if norm == 0:
        raise WarpError(
            f"The stress that drives the warp is 0 MPa at all {len(f)} points in every load case, "
            "so nothing drives it: apply a load that strains the part."
        )
    tension = jnp.zeros((1, 1, 6)).at[..., 0].set(norm)
    if not jnp.max(f) > ROUNDING * measure(tension)[0, 0]:
        raise WarpError(
            f"The stress of up to {float(norm):.3g} MPa has a measure of zero at all {len(f)} points, "
            "as pure pressure has no von Mises stress, so nothing drives the warp: take another "
            "measure, such as the largest principal stress."
        )


@eqx.filter_jit
def _fields(
    f: Float[Array, " samples"],
    stress: Float[Array, "cases samples 6"],
    volumes: Float[Array, " samples"],
    axes: Float[Array, "3 3"],
) -> Float[Array, "samples _"]:
    """What is averaged: log f, and the stress along the axes over its root mean square, case by case."""
    rms = jnp.sqrt(jnp.average(f**2, weights=volumes))
    log_f = jnp.log(jnp.maximum(f, STRESS_FLOOR * rms))
    squared = jnp.sum(_squared_norm(stress), axis=0)
    along = turned_stress(stress, axes[None, None]) / jnp.sqrt(
        jnp.average(squared, weights=volumes)
    )
    return jnp.concatenate([log_f[:, None], *along], axis=1)


def _squared_norm(stress: Float[Array, "cases samples 6"]) -> Float[Array, "cases samples"]:
    """sigma:sigma of each stress; the off-diagonal components count twice."""
    return (stress[..., :3] ** 2).sum(axis=-1) + 2 * (stress[..., 3:] ** 2).sum(axis=-1)
