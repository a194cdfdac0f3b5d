"""The warping function that a case asks for: its drivers, combined."""

from texmap_opt.warp.background import Background
from texmap_opt.warp_inputs import WarpInputs
from texmap_opt.warping_function.driven_field import DrivenField, combined
from texmap_opt.warping_function.imported import imported_driver
from texmap_opt.warping_function.painted import painted
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import (
    Measure,
    StressSamples,
    largest_principal,
    strain_energy_density,
    stress_driver,
    von_mises,
)
from texmap_opt.warping_function.warping_function import WarpingFunction


def driving_function(inputs: WarpInputs) -> WarpingFunction:
    """The function of all drivers of a case, over the box of its grid.

    Raises:
        CaseError: a painted region or an imported result does not fit the part.
        WarpError: nothing drives the warp.
    """
    warp = inputs.section
    background = Background.of(warp, inputs.grid)
    fields = [_driven(name, inputs, background) for name in warp.driver]
    field = combined(fields, how=warp.combine, weights=warp.driver_weights)
    return field.function(background.grid, SizeLaw(warp.exponent, warp.contrast))


def _driven(name: str, inputs: WarpInputs, background: Background) -> DrivenField:
    """The field of one driver."""
    if name == "paint":
        return painted(inputs.paint, background.grid, smoothing_mm=background.smoothing_mm)
    if name == "file" and inputs.imported is not None:
        return imported_driver(
            inputs.imported,
            background.grid,
            smoothing_mm=background.smoothing_mm,
            part_points=inputs.mesh.nodes,
        )
    samples = StressSamples.from_mesh(inputs.mesh, inputs.stress, case_weights=inputs.case_weights)
    return stress_driver(
        samples,
        background.grid,
        smoothing_mm=background.smoothing_mm,
        measure=_measure(name, inputs),
        combine_cases=inputs.section.load_cases,
    )


def _measure(name: str, inputs: WarpInputs) -> Measure:
    return {
        "von-mises": von_mises,
        "principal": largest_principal,
        "strain-energy": strain_energy_density(inputs.material.E, inputs.material.nu),
    }[name]
