"""From the names of a case file to a way of sizing."""

from texmap_opt.case_sizing import SizingSection
from texmap_opt.errors import SizingError
from texmap_opt.sizing.graded import Graded
from texmap_opt.sizing.mma import MovingAsymptotes
from texmap_opt.sizing.no_sizing import NoSizing
from texmap_opt.sizing.optimality_criteria import OptimalityCriteria
from texmap_opt.sizing.sized import AbstractSizing
from texmap_opt.sizing.strut_values import strut_values
from texmap_opt.structure.structure import Structure
from texmap_opt.warp.warped_grid import WarpedGrid


def sizing_of(section: SizingSection, structure: Structure, warp: WarpedGrid) -> AbstractSizing:
    """The way of sizing that `[sizing] method` names.

    Args:
        section: `[sizing]`.
        structure: what is sized.
        warp: the grid that it fills, with its warping function.

    Raises:
        SizingError: struts that come from no grid are to be graded.
    """

    def graded() -> Graded:
        if structure.origin is None:
            raise SizingError(
                '[sizing] method = "graded": the struts come from no grid, so the warping function is '
                "not known there; give another method."
            )
        return Graded(
            strut_values(structure, structure.origin, warp.grid, warp.f), section.grading_exponent
        )

    choices = {
        "none": lambda: NoSizing(),
        "graded": graded,
        "optimality-criteria": lambda: OptimalityCriteria(iterations=section.iterations),
        "mma": lambda: MovingAsymptotes(iterations=section.iterations),
    }
    return choices[section.method]()
