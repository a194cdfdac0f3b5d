"""The section of a case file on the radii of its struts: every key with its kind, default and meaning."""

from dataclasses import dataclass

from texmap_opt.case_table import choice, key, number, whole


@dataclass(frozen=True)
class SizingSection:
    """`[sizing]`: strut radii by optimisation, or by a rule."""

    method: str = key(
        choice("none", "graded", "optimality-criteria", "mma"),
        "none: as given; graded: by the rule radius ~ f^grading_exponent, f the warping function "
        "within its `contrast`; or an optimiser",
        default="optimality-criteria",
    )
    objective: str = key(
        choice("compliance", "volume"),
        "what is made small",
        default="compliance",
        later='only "compliance" is offered yet.',
    )
    volume_fraction: float | None = key(
        number(above=0.0, most=0.9),
        "overlap-corrected volume of (S and M) over the part's (absent: what the radius gives); the "
        'radii are scaled to it, also with method = "none"',
        default=None,
    )
    min_radius_mm: float | None = key(
        number(above=0.0), "smallest radius (absent: 0.4 of the uniform one)", default=None
    )
    max_radius_mm: float | None = key(
        number(above=0.0),
        "largest radius (absent: 2.5 of the uniform one, and 0.2 of the strut's length)",
        default=None,
    )
    grading_exponent: float | None = key(
        number(least=0.0, most=4.0),
        "power of f that the radius follows (graded; absent: 0.5, or 1 for the walls of a 2.5-D cell, "
        "with which sections follow f and, f a stress, all struts are stressed alike)",
        default=None,
    )
    iterations: int = key(whole(least=1), "most iterations (optimisers)", default=60)
