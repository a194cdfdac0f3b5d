"""The driver of the paper: f is the von Mises stress of the part under its loads."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from fea.tet_mesh import TetMesh
from fea.voigt import deviator, tensor, von_mises
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.normalised_convolution import deposit, normalised_convolution
from texmap_opt.warping_function.warping_function import SizeLaw, WarpingFunction

# Stress below this part of its root mean square over the volume carries no information: it is
# discretisation error there, and its logarithm would outweigh everything around it.
STRESS_FLOOR = 1e-2


@dataclass(frozen=True, eq=False)
class StressSamples:
    """Stress at scattered points of a part.

    Attributes:
        points: positions [mm].
        volumes: volume each point stands for [mm³]; where points are dense each counts for less.
        stress: Voigt components of each load case [MPa].
    """

    points: Float[np.ndarray, "samples 3"]
    volumes: Float[np.ndarray, " samples"]
    stress: Float[np.ndarray, "cases samples 6"]

    @classmethod
    def from_mesh(
        cls, mesh: TetMesh, stress: Float[np.ndarray, "cases nodes 6"]
    ) -> "StressSamples":
        """Nodal stresses of a tet mesh; each tet's volume is shared evenly by its nodes."""
        share = np.repeat(mesh.volumes / mesh.tets.shape[1], mesh.tets.shape[1])
        volumes = np.bincount(mesh.tets.ravel(), weights=share, minlength=len(mesh.nodes))
        return cls(mesh.nodes, volumes, stress)

    @cached_property
    def von_mises(self) -> Float[np.ndarray, " samples"]:
        """Largest von Mises stress over the load cases [MPa]: each point fears its own worst case.

        Cases are not scaled to each other: a load that hardly stresses the part must not shape it.
        """
        return von_mises(self.stress).max(axis=0)


def stress_driver(
    samples: StressSamples,
    box: Float[np.ndarray, "2 3"],
    *,
    smoothing_mm: float,
    law: SizeLaw,
) -> WarpingFunction:
    """The warping function of a stress field.

    log f, with f the von Mises stress, and the normalised deviator of every case are averaged over
    a Gaussian neighbourhood and extended beyond the part (`normalised_convolution`). Averaging the
    logarithm, a stress concentration of a few nodes does not decide for its whole neighbourhood.

    Args:
        samples: stress at points in the part.
        box: lowest and highest corner of the grid to be warped [mm].
        smoothing_mm: standard deviation of the Gaussian [mm]; half the edge of a cell is the least
            that a grid of such cells can follow.
        law: exponent and contrast.

    Raises:
        WarpError: if the stress is zero everywhere or not finite, or the background grid too large.
    """
    worst = samples.von_mises
    rms = float(np.sqrt(np.average(worst**2, weights=samples.volumes)))
    if not np.isfinite(rms):
        bad = int(np.sum(~np.isfinite(worst)))
        raise WarpError(
            f"The stress is not a finite number at {bad} of {len(worst)} points, so no warp can "
            "follow it: check the analysis."
        )
    if rms == 0.0:
        raise WarpError(
            f"The von Mises stress is 0 MPa at all {len(worst)} points in every load case, so "
            "nothing drives the warp: apply a load that strains the part."
        )
    grid = BackgroundGrid.covering(box, smoothing_mm)
    log_f = np.log(np.maximum(worst, STRESS_FLOOR * rms))
    directions = _normalised_deviator(samples.stress, samples.volumes)
    fields = np.concatenate([log_f[:, None], directions], axis=1)
    smooth = normalised_convolution(
        grid, samples.points, samples.volumes, fields, smoothing_mm=smoothing_mm
    )
    importance = deposit(grid, samples.points, samples.volumes[:, None])[..., 0]
    return WarpingFunction.on_grid(grid, smooth[..., 0], smooth[..., 1:], importance, law)


def _normalised_deviator(
    stress: Float[np.ndarray, "cases samples 6"], volumes: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, "samples _"]:
    """S = dev(sigma) / sqrt(|sigma|² + floor²), all cases side by side.

    1 in norm under pure shear, 0 under isotropic stress and where there is next to no stress.
    """
    squared = np.sum(tensor(stress) ** 2, axis=(-2, -1))
    floor = STRESS_FLOOR**2 * np.average(squared, weights=volumes, axis=1)[:, None]
    # A case without any stress has no direction either; 1 keeps its zeros from dividing by zero.
    scale = np.sqrt(np.where(squared + floor > 0, squared + floor, 1.0))
    return np.concatenate(deviator(stress) / scale[..., None], axis=1)
