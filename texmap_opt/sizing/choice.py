"""From the names of a case file to a way of sizing."""

from texmap_opt.case_sections import SizingSection
from texmap_opt.sizing.mma import MovingAsymptotes
from texmap_opt.sizing.no_sizing import NoSizing
from texmap_opt.sizing.optimality_criteria import OptimalityCriteria
from texmap_opt.sizing.sized import AbstractSizing


def sizing_of(section: SizingSection) -> AbstractSizing:
    """The way of sizing that `[sizing] method` names."""
    choices = {
        "none": lambda: NoSizing(),
        "optimality-criteria": lambda: OptimalityCriteria(iterations=section.iterations),
        "mma": lambda: MovingAsymptotes(iterations=section.iterations),
    }
    return choices[section.method]()
