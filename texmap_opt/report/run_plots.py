"""The plots of a run: which values each of them shows."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from texmap_opt.report.grid_layers import grid_layers
from texmap_opt.report.plots import PlotData
from texmap_opt.report.run_scenes import mean_edge
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.strut_geometry import strut_angles, strut_vectors
from texmap_opt.warp.quality import achieved_sizes, turns
from texmap_opt.warp.warped_grid import WarpedGrid


def run_plots(
    warp: WarpedGrid,
    structure: Structure,
    part: TriMesh,
    *,
    utilisation: Float[np.ndarray, " struts"] | None,
) -> PlotData:
    """All arrays that the plots of a run are drawn from.

    Args:
        warp: the warped grid.
        structure: the sized struts.
        part: the part's surface.
        utilisation: of the struts, worst stress over yield; None where it is not known.
    """
    achieved, edge = achieved_sizes(warp.grid), mean_edge(warp.grid)
    return PlotData(
        radii=structure.radii.mean(axis=1),
        utilisation=utilisation,
        lengths=structure.lengths(),
        wanted_mm=edge * warp.wanted_size,
        achieved_mm=edge * achieved,
        layers=grid_layers(warp.grid, achieved / warp.wanted_size, warp.occupied_mm3 > 0, part),
        **({} if warp.quality.turn_deg is None else _angles(warp, structure)),
    )


def _angles(warp: WarpedGrid, structure: Structure) -> dict[str, np.ndarray]:
    """The fields of `PlotData` that need a stress with directions."""
    cells, unturned = turns(warp.grid, warp.stress)
    strut_angles_deg, strut_weights = _strut_angles(warp, structure)
    return {
        "strut_angles_deg": strut_angles_deg,
        "strut_weights": strut_weights,
        "turns_deg": np.degrees(cells.nearest).ravel(),
        "turn_weights": cells.anisotropy.ravel(),
        "unturned_deg": np.degrees(unturned.nearest).ravel(),
        "unturned_weights": unturned.anisotropy.ravel(),
    }


def _strut_angles(
    warp: WarpedGrid, structure: Structure
) -> tuple[Float[np.ndarray, " struts"], Float[np.ndarray, " struts"]]:
    """Angle of each strut to the direction of the numerically largest principal stress [deg].

    The stress is that of the cell whose centre is nearest; of several load cases the direction is
    the one whose squared tractions add up to most. The weight is the strut's length times how much
    that stress stands out from the next.
    """
    grid = warp.grid
    middles = structure.joints[structure.struts].mean(axis=1)
    _, cell = KDTree(grid.centres).query(grid.box.coordinates(middles))
    squared = np.einsum("kcij,kcjl->cil", warp.stress, warp.stress)
    values, columns = np.linalg.eigh(squared)
    largest, second = np.sqrt(np.maximum(values[:, -1], 0.0)), np.sqrt(np.maximum(values[:, -2], 0))
    axes = columns[:, :, -1] @ grid.box.axes[: grid.dimensions]
    angles = strut_angles(strut_vectors(structure.joints, structure.struts), axes[cell][:, None])
    return angles[:, 0], structure.lengths() * (largest - second)[cell]
