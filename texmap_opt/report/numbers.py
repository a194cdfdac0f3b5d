"""The numbers of report.json, under the names of the contract (docs/report.md)."""

import importlib.metadata
import platform
import sys
from dataclasses import asdict
from typing import Any

import numpy as np

try:
    import resource
except ModuleNotFoundError:  # Windows has no such accounting.
    resource = None

from fea.frame_checks import pieces_of
from texmap_opt.part_file import open_edges
from texmap_opt.progress import Progress
from texmap_opt.report.warp_numbers import warp_numbers
from texmap_opt.run_result import Run
from texmap_opt.structure.structure import Structure

# g in one tonne, for masses.
GRAM_PER_TONNE = 1e6
LIBRARIES = ("numpy", "scipy", "jax", "optimistix", "pytetwild", "manifold3d", "libigl", "pyvista")


def report_numbers(run: Run, progress: Progress, *, snapped_mm: float) -> dict[str, Any]:
    """All sections of the report but the times, which are known when the files are written.

    Args:
        run: what the stages left.
        progress: its warnings and the seconds of the stages so far.
        snapped_mm: largest displacement of a vertex by rounding to float32 [mm].
    """
    case = run.case
    return {
        "version": importlib.metadata.version("texmap-opt"),
        "model": _model(run),
        "case_file": case.path.name,
        "seconds": dict(progress.seconds) | {"total": progress.total()},
        "peak_memory_mb": peak_memory_mb(),
        "part": {
            "name": run.part.name,
            "triangles": len(run.part.surface.faces),
            "volume_mm3": run.part.volume,
            "area_mm2": run.part.area,
            "bounds_mm": run.part.bounds.tolist(),
            "watertight": not len(open_edges(run.part.surface.faces)),
            "notes": list(run.part.notes),
        },
        "material": {
            "name": case.material.name,
            "E_MPa": case.material.E,
            "nu": case.material.nu,
            "density_g_cm3": case.material.density * 1e9,
            "yield_MPa": case.material.yield_stress,
        },
        "tet_mesh": {
            "nodes": len(run.stress.mesh.nodes),
            "tets": len(run.stress.mesh.tets),
            "element": run.stress.mesh.element,
            "volume_mm3": run.stress.mesh.volume,
        },
        "stress": _stress(run),
        "warp": warp_numbers(run.warp),
        "structure": _structure(run),
        "sizing": _sizing(run),
        "skin": _skin(run),
        "joint_model": _joint_model(run),
        "lattice": _lattice(run),
        "result": _result(run, snapped_mm),
        "printability": None if run.printability is None else run.printability.as_dict(),
        "warnings": list(progress.warnings),
        "platform": {
            "python": platform.python_version(),
            "system": f"{platform.system()} {platform.machine()}",
        }
        | {name: importlib.metadata.version(name) for name in LIBRARIES},
    }


def peak_memory_mb() -> float | None:
    """Largest resident memory of this process so far [MB]; None where the system does not tell."""
    if resource is None:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts KiB, macOS bytes.
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def _stress(run: Run) -> dict[str, Any]:
    stress = run.stress
    von_mises = stress.von_mises
    return {
        "load_cases": list(stress.case_names),
        "max_displacement_mm": stress.max_displacement,
        "compliance_Nmm": float(stress.compliance.sum()),
        "compliance_of_cases_Nmm": stress.compliance.tolist(),
        "max_von_mises_MPa": float(von_mises.max()),
        "reaction_N": stress.reaction.tolist(),
        "load_N": stress.load_forces.sum(axis=1).tolist(),
        "residual": stress.residual,
        "estimated_error": stress.estimated_error,
    }


def _structure(run: Run) -> dict[str, Any]:
    structure = run.filling.structure
    grid = run.warp.grid
    return {
        "cell": run.cell.name,
        "cells": list(grid.cells),
        "cells_mm": grid.uniform_edge.tolist(),
        "joints": len(structure.joints),
        "struts": len(structure.struts),
        "connected_components": _pieces(run),
        "total_length_mm": float(structure.lengths().sum()),
        "trimmed": asdict(run.trimmed.counts),
        "unreached": run.unreached.numbers(),
        "struts_of_kind": _struts_of_kind(structure),
        "interfaces": [interface.numbers() for interface in run.interfaces],
    } | _walls(structure)


def _struts_of_kind(structure: Structure) -> dict[str, int]:
    """Number of struts of each unit cell, and of those that join two."""
    origin = structure.origin
    if origin is None:
        return {}
    counts = np.bincount(origin.kind, minlength=len(origin.kinds))
    return dict(zip(origin.kinds, counts.tolist(), strict=True))


def _walls(structure: Structure) -> dict[str, Any]:
    """What makes walls of the struts; nothing where they are bars."""
    walls = structure.extrusion
    if walls is None:
        return {}
    return {
        "extrusion_axis": walls.axis.tolist(),
        "mean_depth_mm": float(np.average(walls.depth, weights=structure.lengths())),
    }


def _model(run: Run) -> str | None:
    """How the lattice was analysed; None where it is a void."""
    model = run.filling.model
    if model is None:
        return None
    return "frame" if model.skin is None else "frame and skin"


def _pieces(run: Run) -> int:
    """Connected pieces of the structure, skin included where it is modelled."""
    sized, structure = run.filling.sized, run.filling.structure
    if sized is None:
        return int(structure.components().max()) + 1
    frame = sized.solution.problem
    return pieces_of(len(frame.joints), frame.links)[0]


def _skin(run: Run) -> dict[str, Any] | None:
    """What the frame knows of the skin; None where there is none or no frame."""
    sized = run.filling.sized
    model = run.filling.model
    if sized is None or model is None or model.skin is None:
        return None
    skin, stress = model.skin, sized.strength.skin_von_mises
    yield_stress = run.case.material.yield_stress
    worst = None if stress is None else float(stress.max())
    return {
        "triangles": len(skin.mesh.surface.faces),
        "thickness_mm": run.case.lattice.skin_mm,
        "least_thickness_mm": float(skin.mesh.thickness.min()),
        "thin_share": skin.mesh.thin_share,
        "held_back": skin.mesh.held_back,
        "tied_joints": len(skin.tie.nodes),
        "longest_arm_mm": skin.longest_arm,
        "struts_in_skin": int((skin.beyond > -np.inf).sum()),
        "max_von_mises_MPa": worst,
        "max_utilisation": None if worst is None or yield_stress is None else worst / yield_stress,
    }


def _joint_model(run: Run) -> dict[str, Any] | None:
    """What the frame's joints are stiffened by; None where they are not."""
    filling = run.filling
    if filling.model is None or filling.model.zones is None:
        return None
    zones = filling.model.zones
    models = list(zones.models.values())
    return {
        "cells": list(zones.models),
        "rigid_end": [model.rigid_end for model in models],
        "modulus": [model.modulus for model in models],
        "radius_ratio": [model.radius_ratio for model in models],
        "error": [model.error for model in models],
        "thicker_share": zones.thicker(filling.structure.radii),
    }


def _sizing(run: Run) -> dict[str, Any]:
    sized, sizing = run.filling.sized, run.case.sizing
    if sized is None:
        names = (
            "iterations",
            "converged",
            "compliance_before_Nmm",
            "compliance_after_Nmm",
            "volume_mm3",
            "max_utilisation",
            "max_euler_utilisation",
            "min_radius_mm",
            "max_radius_mm",
        )
        return {"method": sizing.method} | dict.fromkeys(names)
    return {
        "method": sizing.method,
        "iterations": sized.iterations,
        "converged": sized.converged,
        "message": sized.message,
        "compliance_before_Nmm": sized.compliance_before,
        "compliance_after_Nmm": sized.compliance_after,
        "volume_mm3": sized.volume,
        "volume_fraction": sized.volume / run.part.volume,
        "max_utilisation": sized.max_utilisation,
        "max_euler_utilisation": float(sized.strength.euler_utilisation.max()),
        "min_radius_mm": sized.min_radius,
        "max_radius_mm": sized.max_radius,
        "residual": sized.solution.residual,
        "history": {"compliance": sized.history.tolist()},
    }


def _lattice(run: Run) -> dict[str, Any]:
    filling, shape = run.filling, run.filling.validity
    return {
        "triangles": shape.triangles,
        "watertight": shape.watertight,
        "volume_mm3": shape.volume_mm3,
        "genus": shape.genus,
        "inside_mm3": filling.inside_mm3,
        "relative_density": filling.inside_mm3 / run.part.volume,
        "formula_mm3": filling.formula_mm3,
        "fillet_mm": filling.lattice.smallest_fillet_mm,
        "clamped_fillets": filling.lattice.clamped_fillets,
        "clusters": filling.lattice.clusters,
        "cluster_struts": filling.lattice.cluster_struts,
        "mesh_error_mm": filling.lattice.error_mm,
    }


def _result(run: Run, snapped_mm: float) -> dict[str, Any]:
    validity, combined = run.validity, run.combined
    volume = run.solid.surface.volume
    return {
        "triangles": validity.triangles,
        "watertight": validity.watertight,
        "volume_mm3": volume,
        "mass_g": volume * run.case.material.density * GRAM_PER_TONNE,
        "relative_density": volume / run.part.volume,
        "connected_components": validity.connected_components,
        "closed_voids": validity.closed_voids,
        "genus": validity.genus,
        "area_mm2": validity.area_mm2,
        "printable": validity.printable,
        "snapped_mm": snapped_mm,
        **_hollow(run),
        "chips_removed": combined.chips,
        "chip_volume_mm3": combined.chip_volume_mm3,
    }


def _hollow(run: Run) -> dict[str, Any]:
    """How the part is hollow behind its skin; nothing without one."""
    names = ("error_mm", "solid_share", "solid_regions", "solid_mm3", "largest_solid")
    skin = run.combined.skin
    if skin is None:
        return {f"skin_{name}": None for name in names} | {"openings": [], "drains": []}
    volumes, centres = skin.solid.volumes_mm3, skin.solid.centres
    largest = None
    if len(volumes):
        largest = {"volume_mm3": float(volumes[0]), "centre_mm": centres[0].tolist()}
    solid = float(volumes.sum())
    values = (skin.offset.error_mm, solid / run.part.volume, len(volumes), solid, largest)
    mouths = () if skin.opened is None else skin.opened.mouths_mm2
    return {f"skin_{name}": value for name, value in zip(names, values, strict=True)} | {
        "openings": [{"mouth_mm2": mouth} for mouth in mouths],
        "drains": [
            {
                "point_mm": hole.point.tolist(),
                "direction": hole.direction.tolist(),
                "length_mm": hole.length_mm,
                "open_share": hole.open_share,
            }
            for hole in skin.drains
        ],
    }
