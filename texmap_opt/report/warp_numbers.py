"""The section `warp` of report.json."""

from typing import Any

import numpy as np

from texmap_opt.report.histograms import angle_shares, ratio_counts
from texmap_opt.warp.quality import achieved_sizes, turns
from texmap_opt.warp.warped_grid import WarpedGrid


def warp_numbers(warp: WarpedGrid) -> dict[str, Any]:
    """How the grid came about and how good it is; null where there is no stress or stiffness."""
    quality = warp.quality
    return {
        "method": warp.method,
        "dimensions": warp.grid.dimensions,
        "nodes": int(np.prod(warp.grid.nodes.shape[:-1])),
        "cells": list(warp.grid.cells),
        "min_jacobian": quality.min_jacobian,
        "folded_cells": quality.folded_cells,
        "max_aspect": quality.max_aspect,
        "min_edge": quality.min_edge,
        "scaled_jacobian": quality.scaled_jacobian,
        "mean_angle_deg": quality.mean_angle_deg,
        "mean_misalignment_deg": quality.mean_misalignment_deg,
        "turn_deg": quality.turn_deg,
        "turn_uniform_deg": quality.turn_uniform_deg,
        "size_slope": quality.size_slope,
        "size_correlation": quality.size_correlation,
        "size_error": quality.size_error,
        "part_size_slope": quality.part_size_slope,
        "part_size_correlation": quality.part_size_correlation,
        "wanted_contrast": float(warp.wanted_size.max() / warp.wanted_size.min()),
        "energy": {
            "warped": quality.energy_warped,
            "best": quality.energy_best,
            "worst": quality.energy_worst,
            "share": quality.energy_share,
        },
        "histograms": _histograms(warp),
        "iterations": warp.iterations,
        "converged": warp.converged,
        "message": warp.message,
        "measures": warp.measures,
    }


def _histograms(warp: WarpedGrid) -> dict[str, Any]:
    """Bin edges and what is in the bins."""
    count, edges = ratio_counts(achieved_sizes(warp.grid) / warp.wanted_size)
    found: dict[str, Any] = {"size_ratio": {"edges": edges.tolist(), "cells": count.tolist()}}
    if warp.quality.turn_deg is not None:
        cells, unturned = turns(warp.grid, warp.stress)
        shares = [
            angle_shares(np.degrees(kind.nearest).ravel(), kind.anisotropy.ravel(), largest=45)
            for kind in (cells, unturned)
        ]
        found["angle"] = {
            "edges_deg": shares[0][1].tolist(),
            "share": shares[0][0].tolist(),
            "share_unturned": shares[1][0].tolist(),
        }
    return found
