"""From the trimmed lattice to its sized struts and their solid, at the density that was asked for."""

from dataclasses import dataclass

import numpy as np

from texmap_opt.case import DesignCase
from texmap_opt.combine.boolean import intersection
from texmap_opt.errors import SizingError
from texmap_opt.frame_model import FrameModel, frame_model
from texmap_opt.grid_plan import LEAST_PRINTABLE_RADIUS_MM
from texmap_opt.part import Part
from texmap_opt.plane_loads import eccentric_loads, out_of_plane_load
from texmap_opt.progress import Progress
from texmap_opt.sizing.choice import sizing_of
from texmap_opt.sizing.sized import AbstractSizing, Sized, SizingLimits
from texmap_opt.solid.lattice_solid import LatticeSolid, lattice_solid
from texmap_opt.solid.validity import ValidityReport, require_printable
from texmap_opt.stress_field import StressField
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.trim import Trimmed
from texmap_opt.structure.volume import LatticeVolume, lattice_volume
from texmap_opt.warp.warped_grid import WarpedGrid

# Relative difference between asked and measured density that is good enough, and how many times
# the lattice is meshed to get there: the corrected volume is a few per cent off, a second try with
# that error divided out is within half a per cent.
DENSITY_TOLERANCE = 0.005
DENSITY_TRIES = 4
# Relative accuracy of a volume reached by scaling radii, and the most steps towards it.
VOLUME_RTOL = 1e-8
# Share of struts beyond the joint model that the user is told of.
NOTABLE_THICK_SHARE = 0.1
SCALING_STEPS = 40


@dataclass(frozen=True, eq=False)
class Filling:
    """A lattice with its final radii, as struts and as a solid.

    Attributes:
        structure: joints, struts and final radii.
        model: what was sized; None where the struts are holes, or walls under loads that they carry
            only in ways that the frame does not know.
        sized: what sizing did; None there too.
        lattice: the solid S, not yet cut to the part.
        validity: what was checked on it.
        inside_mm3: volume of (S and M), measured on the meshes [mm³].
        formula_mm3: overlap-corrected volume of the structure [mm³].
    """

    structure: Structure
    model: FrameModel | None
    sized: Sized | None
    lattice: LatticeSolid
    validity: ValidityReport
    inside_mm3: float
    formula_mm3: float


@dataclass(frozen=True, eq=False)
class _Sizer:
    """What is sized, and how."""

    model: FrameModel
    method: AbstractSizing


def fill(
    case: DesignCase,
    part: Part,
    stress: StressField,
    warp: WarpedGrid,
    trimmed: Trimmed,
    progress: Progress,
) -> Filling:
    """Size the struts and mesh them, again where a measured density is asked for.

    Args:
        case: what is asked for.
        part: what is filled.
        stress: analysis of the solid part.
        warp: the grid that the struts come from.
        trimmed: the struts.
        progress: is told.

    Raises:
        SizingError: the density or volume cannot be reached.
        LatticeError: a support or load reaches no strut.
        SolidError: the lattice cannot be meshed.
    """
    target = case.lattice.relative_density
    sizer = None
    if case.lattice.kind == "rod":
        with progress.stage("frame"):
            model = _model(case, part, stress, trimmed.structure, progress)
        if model is not None:
            sizer = _Sizer(model, sizing_of(case.sizing, trimmed.structure, warp))
    volume, density = _first_volume(case, part), 0.0
    for _ in range(DENSITY_TRIES):
        filling = _filled(case, trimmed.structure, part, sizer, volume, progress)
        if target is None:
            return filling
        density = filling.inside_mm3 / part.volume
        progress.detail(f"relative density {density:.4f}")
        if abs(density / target - 1) <= DENSITY_TOLERANCE:
            return filling
        volume = filling.formula_mm3 * target / density
    raise SizingError(
        f"{case.path.name}: [lattice] relative_density = {target:g}: {DENSITY_TRIES} tries end at "
        f"{density:.4f} instead; the cells are too coarse for the part: use smaller cells, or give "
        "radius_mm."
    )


def _model(
    case: DesignCase, part: Part, stress: StressField, structure: Structure, progress: Progress
) -> FrameModel | None:
    """The frame; None where nothing is sized and the loads are none that walls carry."""
    walls = structure.extrusion
    if walls is not None:
        refused = out_of_plane_load(case, stress, walls)
        if refused is not None and case.sizing.method == "none":
            progress.warn(f"{refused}; nothing is said about stiffness and strength")
            return None
        for note in eccentric_loads(case, stress, walls):
            progress.warn(note)
    return frame_model(structure, part, case, stress)


def _first_volume(case: DesignCase, part: Part) -> float | None:
    """Overlap-corrected volume to aim at [mm³]; None: what the given radii have."""
    for fraction in (case.sizing.volume_fraction, case.lattice.relative_density):
        if fraction is not None:
            return fraction * part.volume
    return None


def _filled(
    case: DesignCase,
    structure: Structure,
    part: Part,
    sizer: _Sizer | None,
    volume: float | None,
    progress: Progress,
) -> Filling:
    sized = model = None
    with progress.stage("sizing"):
        if volume is not None:
            structure = _scaled_to_volume(structure, volume)
            _check_printable(structure)
        if sizer is not None:
            model = sizer.model
            sized = sizer.method.size(
                model.with_structure(structure),
                SizingLimits(volume, case.sizing.min_radius_mm, case.sizing.max_radius_mm),
            )
            structure = sized.structure
            progress.detail(
                f"compliance {sized.compliance_before:.4g} -> {sized.compliance_after:.4g} N mm"
            )
            if not sized.converged:
                progress.warn(f"sizing: {sized.message}")
            _warn_of_thick_struts(model, structure, progress)
    with progress.stage("lattice"):
        lattice = lattice_solid(
            structure, tolerance_mm=case.output.tolerance_mm, fillet_mm=case.lattice.fillet_mm
        )
        checked = require_printable(lattice.surface, "The lattice")
        inside = intersection(lattice.surface, part.surface).volume
        progress.detail(f"{len(lattice.surface.faces):,} triangles")
        for note in lattice.notes(case.lattice.fillet_mm):
            progress.warn(note)
    return Filling(structure, model, sized, lattice, checked, inside, lattice_volume(structure))


def _warn_of_thick_struts(model: FrameModel, structure: Structure, progress: Progress) -> None:
    zones = model.zones
    thicker = 0.0 if zones is None else zones.thicker(structure.radii)
    if zones is not None and thicker > NOTABLE_THICK_SHARE:
        models = zones.models.values()
        limits = ", ".join(f"{model.radius_ratio:g}" for model in models)
        errors = ", ".join(f"{100 * model.error:.2g}" for model in models)
        progress.warn(
            f"sizing: {100 * thicker:.0f} % of the struts are thicker than the joint model was fitted "
            f"to (radius over length {limits}) and count as that thick, so that its error of {errors} % "
            "does not cover them; larger cells would be slimmer"
        )


def _check_printable(structure: Structure) -> None:
    thinnest = float(structure.radii.min())
    if thinnest < LEAST_PRINTABLE_RADIUS_MM:
        raise SizingError(
            f"The asked volume makes struts of {thinnest:.3g} mm radius, thinner than the "
            f"{LEAST_PRINTABLE_RADIUS_MM:g} mm that print: raise [sizing] volume_fraction or "
            "[lattice] relative_density, or use larger cells."
        )


def _scaled_to_volume(structure: Structure, volume: float) -> Structure:
    """All radii times one factor, so that the overlap-corrected volume is `volume` [mm³].

    Volume grows a little slower than the square of the factor (overlaps grow with its cube), so
    each step takes the square root of the missing ratio and the iteration contracts. That of walls
    grows a little slower than the factor.

    Raises:
        SizingError: the cells fill up before that volume is reached.
    """
    measure = LatticeVolume.of(structure)
    power = 2.0 if structure.extrusion is None else 1.0
    radii, shortest = structure.radii, float(np.median(structure.lengths()))
    for _ in range(SCALING_STEPS):
        ratio = volume / float(measure(structure.joints, radii))
        if abs(ratio - 1) <= VOLUME_RTOL:
            return structure.with_radii(radii)
        radii = radii * ratio ** (1 / power)
        if float(np.median(radii)) > shortest / 2:
            break
    raise SizingError(
        f"A lattice of {volume:.4g} mm³ fills its cells up: lower [sizing] volume_fraction or "
        "[lattice] relative_density, or use larger cells."
    )
