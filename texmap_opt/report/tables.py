"""Tables of the page: which numbers of `report.json`, their names, and how they are written."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

DASH = "–"

# Components this much smaller than the largest are written as zero.
ROUNDING = 1e-9

# Keeps the digits of a number together, unlike a common space.
THIN_SPACE = "\u202f"


@dataclass(frozen=True)
class Row:
    """One line of a table: the key in the section, what it is called, how its value is written."""

    key: str
    name: str
    write: Callable[[Any], str]


def digits(value: float, figures: int = 4) -> str:
    """A number with so many significant figures, thousands apart, powers of ten when extreme."""
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e9:
        mantissa, exponent = f"{value:.{figures - 1}e}".split("e")
        return f"{mantissa} × 10<sup>{int(exponent)}</sup>"
    decimals = max(0, figures - len(str(int(abs(value)))))
    if abs(value) < 1:
        text = f"{float(f'{value:.{figures}g}'):.{figures + 4}f}"
    else:
        text = f"{value:,.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace(",", THIN_SPACE)


def quantity(unit: str, figures: int = 4) -> Callable[[Any], str]:
    """Writes a number, a list of them, or a list of such lists (one line each), with a unit."""

    def write(value: Any) -> str:
        if not isinstance(value, list | tuple):
            return f"{digits(float(value), figures)} {unit}".strip()
        if value and isinstance(value[0], list | tuple):
            return "<br>".join(write(one) for one in value)
        numbers = [float(one) for one in value]
        # Beside a force of 500 N, 1e-12 N is rounding.
        least = ROUNDING * max((abs(number) for number in numbers), default=0.0)
        written = [digits(one if abs(one) > least else 0.0, figures) for one in numbers]
        return f"{', '.join(written)} {unit}".strip()

    return write


def percent(value: Any) -> str:
    """A fraction in percent, or a list of them."""
    if isinstance(value, list | tuple):
        return ", ".join(percent(one) for one in value)
    return f"{digits(100 * float(value), 3)} %"


def count(value: Any) -> str:
    """A whole number, or the counts along three axes."""
    if isinstance(value, list | tuple):
        return " × ".join(count(one) for one in value)
    return f"{int(value):,}".replace(",", THIN_SPACE)


def yes_no(value: Any) -> str:
    """Yes or no, coloured: yes is the good answer."""
    return '<span class="yes">yes</span>' if value else '<span class="no">no</span>'


def none_wanted(value: Any) -> str:
    """A count that should be zero."""
    return count(value) if not value else f'<span class="no">{count(value)}</span>'


def one_wanted(value: Any) -> str:
    """A count that should be one."""
    return count(value) if value == 1 else f'<span class="no">{count(value)}</span>'


def text(value: Any) -> str:
    """Words as they are, or a list of them."""
    if isinstance(value, list | tuple):
        return ", ".join(text(one) for one in value)
    return escape(str(value))


def counts(value: Any) -> str:
    """Numbers of things by their names."""
    return ", ".join(f"{escape(str(name))} {count(number)}" for name, number in value.items())


def share_of(value: Any) -> str:
    """The `share` in a table of numbers, in percent."""
    return percent(value["share"])


def trapped(value: Any) -> str:
    """Powder in closed voids."""
    if not value["count"]:
        return "none"
    return f"{digits(value['total_mm3'])} mm³ in {count(value['count'])} closed voids"


def widths(value: Any) -> str:
    """Smallest distance between facing walls, that of 5 % of their area, and the median."""
    found = [value[name] for name in ("smallest_mm", "percentile_5_mm", "median_mm")]
    known = [digits(width, 3) for width in found if width is not None]
    return f"{', '.join(known)} mm" if known else DASH


def hanging(value: Any) -> str:
    """What needs supports along the build direction, and along the best one."""
    along, best = (
        f"({', '.join(digits(c, 3) for c in value[name])})"
        for name in ("build_direction", "best_direction")
    )
    return (
        f"{percent(value['share'])} below {digits(value['limit_deg'])}° along {along}; "
        f"{percent(value['best_share'])} along {best}"
    )


def flat_struts(value: Any) -> str:
    """Struts that lie too flatly."""
    return f"{count(value['count'])}, {percent(value['share'])} of their length"


def same_after_stl(value: Any) -> str:
    """Whether the solid is the same after an STL file."""
    return yes_no(value["same"])


def interfaces(value: Any) -> str:
    """How kinds of unit cells were joined, one line for each two kinds."""
    lines = [
        f"{escape(' | '.join(one['kinds']))}: {escape(one['method'])} ({count(one['faces'])} faces, "
        f"{count(one['shared_joints'])} shared joints, {count(one['split_struts'])} split struts, "
        f"{count(one['transition_struts'])} transition struts)"
        for one in value
    ]
    return "<br>".join(lines) or "nowhere"


def table(section: Mapping[str, Any], rows: tuple[Row, ...]) -> str:
    """The rows whose keys the section has; empty when there are none."""
    lines = [
        f"<tr><th>{row.name}</th><td>{_written(section[row.key], row.write)}</td></tr>"
        for row in rows
        if row.key in section
    ]
    return f"<table>{''.join(lines)}</table>" if lines else ""


def _written(value: Any, write: Callable[[Any], str]) -> str:
    if value is None or value == "":
        return DASH
    try:
        return write(value)
    except (TypeError, ValueError, OverflowError):
        # Not what the row expects: better shown as it is than left out.
        return escape(str(value))


PART = (
    Row("name", "part", text),
    Row("triangles", "triangles", count),
    Row("volume_mm3", "volume", quantity("mm³")),
    Row("area_mm2", "surface area", quantity("mm²")),
    Row("watertight", "watertight", yes_no),
)
MATERIAL = (
    Row("name", "material", text),
    Row("E_MPa", "Young's modulus", quantity("MPa")),
    Row("nu", "Poisson's ratio", quantity("")),
    Row("density_g_cm3", "density", quantity("g/cm³")),
    Row("yield_MPa", "yield stress", quantity("MPa")),
)
TET_MESH = (
    Row("element", "element", text),
    Row("nodes", "nodes", count),
    Row("tets", "tets", count),
)
STRESS = (
    Row("load_cases", "load cases", text),
    Row("max_von_mises_MPa", "largest von Mises stress", quantity("MPa")),
    Row("max_displacement_mm", "largest displacement", quantity("mm")),
    Row("compliance_Nmm", "compliance of the solid part", quantity("N mm")),
    Row("reaction_N", "reaction of each case", quantity("N")),
    Row("residual", "relative residual", quantity("", 2)),
    Row("estimated_error", "estimated error of the stress (share of energy)", quantity("", 2)),
)
WARP = (
    Row("method", "method", text),
    Row("nodes", "grid nodes", count),
    Row("folded_cells", "folded cells", none_wanted),
    Row("min_jacobian", "smallest Jacobian (Bézier bound)", quantity("", 3)),
    Row("max_aspect", "largest aspect ratio", quantity("", 3)),
    Row("min_edge", "shortest edge over the uniform one", quantity("", 3)),
    Row("scaled_jacobian", "smallest scaled Jacobian", quantity("", 3)),
    Row("iterations", "iterations", count),
    Row("converged", "converged", yes_no),
    Row("message", "remark", text),
)
WARP_SIZES = (
    Row("wanted_contrast", "largest over smallest wanted size", quantity("", 3)),
    Row("size_slope", "slope of achieved over wanted (log)", quantity("", 3)),
    Row("size_correlation", "correlation of the two", quantity("", 3)),
    Row("part_size_slope", "slope over the cells of the part", quantity("", 3)),
    Row("part_size_correlation", "correlation over them", quantity("", 3)),
    Row("size_error", "error of the size (rms)", percent),
)
WARP_ANGLES = (
    Row("turn_deg", "angle to the nearest principal axis", quantity("°", 3)),
    Row("turn_uniform_deg", "the same, cells not turned", quantity("°", 3)),
    Row("mean_angle_deg", "to the larger stress (depends on the order of axes)", quantity("°", 3)),
)
WARP_ENERGY = (
    Row("share", "share of the attainable gain", percent),
    Row("warped", "of the cells as they are", quantity("", 4)),
    Row("best", "each cell turned best", quantity("", 4)),
    Row("worst", "each cell turned worst", quantity("", 4)),
)
STRUCTURE = (
    Row("cell", "unit cell", text),
    Row("cells", "cells", count),
    Row("cells_mm", "uniform cell", quantity("mm", 3)),
    Row("joints", "joints", count),
    Row("struts", "struts", count),
    Row("struts_of_kind", "struts of each kind", counts),
    Row("interfaces", "kinds of cells meet", interfaces),
    Row("connected_components", "connected components", one_wanted),
    Row("total_length_mm", "total strut length", quantity("mm")),
    Row("unreached", "volume farther than a cell from struts", share_of),
    Row("extrusion_axis", "walls extruded along", quantity("", 3)),
    Row("mean_depth_mm", "mean depth of the walls in the part", quantity("mm", 3)),
)
SIZING = (
    Row("method", "method", text),
    Row("compliance_before_Nmm", "compliance before (equal radii)", quantity("N mm")),
    Row("compliance_after_Nmm", "compliance after", quantity("N mm")),
    Row("volume_mm3", "lattice volume, overlaps counted once", quantity("mm³")),
    Row("volume_fraction", "of the part's volume", percent),
    Row("max_utilisation", "largest utilisation (stress over yield)", percent),
    Row("max_euler_utilisation", "largest compression over Euler's load", percent),
    Row("min_radius_mm", "smallest radius", quantity("mm", 3)),
    Row("max_radius_mm", "largest radius", quantity("mm", 3)),
    Row("iterations", "iterations", count),
    Row("converged", "converged", yes_no),
    Row("message", "remark", text),
)
SKIN = (
    Row("triangles", "triangles", count),
    Row("thickness_mm", "thickness", quantity("mm", 3)),
    Row("least_thickness_mm", "smallest thickness", quantity("mm", 3)),
    Row("max_von_mises_MPa", "largest von Mises stress", quantity("MPa")),
    Row("max_utilisation", "largest utilisation (stress over yield)", percent),
    Row("tied_joints", "strut ends that it holds", count),
)
JOINT_MODEL = (
    Row("cells", "of unit cells", text),
    Row("rigid_end", "rigid end of a strut over its radius", quantity("", 3)),
    Row("modulus", "change of modulus over radius/length", quantity("", 3)),
    Row("radius_ratio", "fitted up to a radius/length of", quantity("", 3)),
    Row("error", "error there, of the uniform cell, at most", percent),
    Row("thicker_share", "struts thicker than that, counted as that", percent),
)
LATTICE = (
    Row("watertight", "watertight", yes_no),
    Row("triangles", "triangles", count),
    Row("volume_mm3", "volume", quantity("mm³")),
    Row("inside_mm3", "volume inside the part", quantity("mm³")),
    Row("relative_density", "of the part's volume", percent),
    Row("genus", "genus", count),
)
RESULT = (
    Row("watertight", "watertight", yes_no),
    Row("connected_components", "connected components", one_wanted),
    Row("closed_voids", "closed voids", count),
    Row("triangles", "triangles", count),
    Row("volume_mm3", "volume", quantity("mm³")),
    Row("mass_g", "mass", quantity("g")),
    Row("relative_density", "volume over the part's", percent),
    Row("skin_error_mm", "bound on the skin's error", quantity("mm", 2)),
    Row("snapped_mm", "largest shift by rounding to float32", quantity("mm", 2)),
)
PRINTABILITY = (
    Row("closed_voids", "trapped powder", trapped),
    Row("walls", "walls and struts: smallest, 5 %, median", widths),
    Row("gaps", "gaps: smallest, 5 %, median", widths),
    Row("overhang", "surface that needs supports", hanging),
    Row("struts", "struts that lie too flatly", flat_struts),
    Row("after_stl", "the same after an STL file", same_after_stl),
)
