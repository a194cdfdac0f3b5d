"""Built-in parametric parts: the textbook's specimens, with their dimensions.

x runs along the length, y across the width, z up. Circles are polygons of the circle's own area,
so that a hole or a bar has its true cross-section.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.combine.boolean import difference, union
from texmap_opt.errors import PartError, nearest_name
from texmap_opt.solid.tri_mesh import TriMesh

# [mm] Largest distance of a chord from its arc: below what any printer resolves.
CHORD_TOLERANCE = 0.01
# A multiple of four keeps circles symmetric about both axes; so many keep tiny holes round.
LEAST_SEGMENTS = 24


@dataclass(frozen=True)
class BuiltinPart:
    """A recipe.

    Attributes:
        description: one line for `texmap` and the documentation.
        dimensions: names and default values [mm].
        limits: what the dimensions must satisfy beyond being positive: a test and its words.
        build: the surface from complete, valid dimensions.
    """

    description: str
    dimensions: Mapping[str, float]
    limits: tuple[tuple[Callable[[Mapping[str, float]], bool], str], ...]
    build: Callable[[Mapping[str, float]], TriMesh]


def builtin_part(name: str, dimensions: Mapping[str, float]) -> TriMesh:
    """Surface of a built-in part [mm].

    Args:
        name: one of `BUILTIN_PARTS`.
        dimensions: those that differ from the defaults [mm].

    Raises:
        PartError: unknown part or dimension, or dimensions that do not fit together.
    """
    if name not in BUILTIN_PARTS:
        remedy = nearest_name(name, BUILTIN_PARTS)
        raise PartError(f'[part] builtin = "{name}": there is no such part; {remedy}')
    recipe = BUILTIN_PARTS[name]
    where = f"[part] {name}:"
    for key, value in dimensions.items():
        if key not in recipe.dimensions:
            remedy = nearest_name(key, recipe.dimensions)
            raise PartError(f"{where} it has no dimension {key}; {remedy}")
        if not (math.isfinite(value) and value > 0):
            raise PartError(f"{where} {key} = {value:g} must be a finite length above 0.")
    size = {**recipe.dimensions, **{key: float(value) for key, value in dimensions.items()}}
    for holds, words in recipe.limits:
        if not holds(size):
            given = ", ".join(f"{key} = {value:g}" for key, value in size.items() if key in words)
            raise PartError(f"{where} {words}; here {given}.")
    return recipe.build(size)


def _block(size: Mapping[str, float]) -> TriMesh:
    return _box((0.0, 0.0, 0.0), (size["length_mm"], size["width_mm"], size["height_mm"]))


def _torsion_bar(size: Mapping[str, float]) -> TriMesh:
    circle = _circle((0.0, 0.0), size["diameter_mm"] / 2)
    return _prism(circle, "x", 0.0, size["length_mm"])


def _l_bracket(size: Mapping[str, float]) -> TriMesh:
    """The block less a convex piece whose one rounded corner leaves the fillet."""
    length, height, t = size["length_mm"], size["height_mm"], size["thickness_mm"]
    r = size["fillet_mm"]
    beyond = max(length, height)
    corner = _arc((t + r, t + r), r, math.pi, 1.5 * math.pi)
    cut = np.concatenate(
        [corner, [(length + beyond, t), (length + beyond, height + beyond), (t, height + beyond)]]
    )
    width = size["width_mm"]
    block = _box((0.0, 0.0, 0.0), (length, width, height))
    return difference(block, _prism(cut, "y", -width, 2 * width))


def _bracket(size: Mapping[str, float]) -> TriMesh:
    """Plate with its underside at z = 0, the lug's hole along y, four bolt holes along z."""
    length, width, t = size["length_mm"], size["width_mm"], size["plate_mm"]
    radius, center = size["lug_width_mm"] / 2, t + size["lug_height_mm"]
    plate = _box((-length / 2, -width / 2, 0.0), (length / 2, width / 2, t))
    # The lug starts inside the plate: no faces coincide.
    outline = np.concatenate(
        [[(-radius, t / 2), (radius, t / 2)], _arc((0.0, center), radius, 0.0, math.pi)]
    )
    half = size["lug_thickness_mm"] / 2
    solid = union([plate, _prism(outline, "y", -half, half)])
    pin = _circle((0.0, center), size["lug_hole_mm"] / 2)
    holes = [_prism(pin, "y", -2 * half, 2 * half)]
    x, y = length / 2 - size["bolt_inset_mm"], width / 2 - size["bolt_inset_mm"]
    for bolt in ((x, y), (-x, y), (-x, -y), (x, -y)):
        holes.append(_prism(_circle(bolt, size["bolt_hole_mm"] / 2), "z", -t, 2 * t))
    return difference(solid, *holes)


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> TriMesh:
    outline = np.array(
        [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])], dtype=float
    )
    return _prism(outline, "z", low[2], high[2])


def _prism(outline: Float[np.ndarray, "n 2"], axis: str, low: float, high: float) -> TriMesh:
    """A convex polygon, counter-clockwise, swept along an axis.

    The polygon's coordinates are (x, y) for a sweep along z, (y, z) along x and (x, z) along y.
    """
    n = len(outline)
    first, second, along = {"z": (0, 1, 2), "x": (1, 2, 0), "y": (0, 2, 1)}[axis]
    vertices = np.zeros((2 * n, 3))
    vertices[:, first], vertices[:, second] = np.tile(outline, (2, 1)).T
    vertices[:n, along], vertices[n:, along] = low, high
    i = np.arange(n)
    j = (i + 1) % n
    fan = np.stack([np.zeros(n - 2, dtype=int), i[1:-1], i[2:]], axis=1)
    sides = [np.stack([i, j, j + n], axis=1), np.stack([i, j + n, i + n], axis=1)]
    faces = np.concatenate([fan[:, ::-1], fan + n, *sides])
    # (x, z, y) is a left-handed order of axes.
    return TriMesh(vertices, faces[:, ::-1].copy() if axis == "y" else faces)


def _segments(radius: float, angle: float) -> int:
    """Chords of an arc within `CHORD_TOLERANCE` of it."""
    sagitta = min(CHORD_TOLERANCE / radius, 1.0)
    whole = max(LEAST_SEGMENTS, math.ceil(math.pi / math.acos(1 - sagitta)))
    return math.ceil(whole * angle / (2 * math.pi) / 4) * 4


def _circle(center: tuple[float, float], radius: float) -> Float[np.ndarray, "n 2"]:
    """Regular polygon of the circle's area."""
    n = _segments(radius, 2 * math.pi)
    reach = radius * math.sqrt(2 * math.pi / (n * math.sin(2 * math.pi / n)))
    angle = 2 * math.pi * np.arange(n) / n
    return np.array(center) + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _arc(
    center: tuple[float, float], radius: float, start: float, end: float
) -> Float[np.ndarray, "n 2"]:
    """Points on an arc, both ends included [angles in radians]."""
    angle = np.linspace(start, end, _segments(radius, end - start) + 1)
    return np.array(center) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


# Names with their sizes; the cantilever is that of the verification cases.
BUILTIN_PARTS: dict[str, BuiltinPart] = {
    "cantilever": BuiltinPart(
        "a square beam along x, to be clamped at x = 0",
        {"length_mm": 100.0, "width_mm": 20.0, "height_mm": 20.0},
        (),
        _block,
    ),
    "mbb": BuiltinPart(
        "the beam of Messerschmitt-Bölkow-Blohm: long and low, held at both lower ends",
        {"length_mm": 120.0, "width_mm": 20.0, "height_mm": 20.0},
        (),
        _block,
    ),
    "three-point-bending": BuiltinPart(
        "a bending specimen, length to height to width 8 : 1 : 1",
        {"length_mm": 160.0, "width_mm": 20.0, "height_mm": 20.0},
        (),
        _block,
    ),
    "l-bracket": BuiltinPart(
        "two legs along x and z with a filleted inner corner",
        {
            "length_mm": 80.0,
            "height_mm": 80.0,
            "width_mm": 20.0,
            "thickness_mm": 25.0,
            "fillet_mm": 5.0,
        },
        (
            (
                lambda d: d["thickness_mm"] + d["fillet_mm"] < min(d["length_mm"], d["height_mm"]),
                "thickness_mm + fillet_mm must be below length_mm and height_mm",
            ),
        ),
        _l_bracket,
    ),
    "torsion-bar": BuiltinPart(
        "a round bar along x, its axis through the origin",
        {"length_mm": 100.0, "diameter_mm": 20.0},
        (),
        _torsion_bar,
    ),
    "bracket": BuiltinPart(
        "a plate with four bolt holes and an upright lug with a hole; the origin is the middle of "
        "its underside",
        {
            "length_mm": 80.0,
            "width_mm": 60.0,
            "plate_mm": 12.0,
            "bolt_hole_mm": 8.0,
            "bolt_inset_mm": 10.0,
            "lug_width_mm": 36.0,
            "lug_thickness_mm": 20.0,
            "lug_height_mm": 30.0,
            "lug_hole_mm": 16.0,
        },
        (
            (
                lambda d: d["bolt_hole_mm"] < 2 * d["bolt_inset_mm"],
                "bolt_hole_mm must be below twice bolt_inset_mm, or the holes break the rim",
            ),
            (
                lambda d: (
                    2 * d["bolt_inset_mm"] + d["bolt_hole_mm"] < min(d["length_mm"], d["width_mm"])
                ),
                "2 bolt_inset_mm + bolt_hole_mm must be below length_mm and width_mm, or the holes "
                "meet",
            ),
            (
                lambda d: (
                    d["lug_width_mm"] < d["length_mm"] and d["lug_thickness_mm"] < d["width_mm"]
                ),
                "lug_width_mm must be below length_mm and lug_thickness_mm below width_mm",
            ),
            (
                lambda d: d["lug_hole_mm"] < d["lug_width_mm"],
                "lug_hole_mm must be below lug_width_mm, or the lug has no wall",
            ),
            (
                lambda d: d["lug_hole_mm"] < 2 * d["lug_height_mm"],
                "lug_hole_mm must be below twice lug_height_mm, or the hole reaches the plate",
            ),
            (
                lambda d: not _bolts_cut_lug(d),
                "bolt_inset_mm and bolt_hole_mm must keep the bolt holes clear of the lug "
                "(lug_width_mm, lug_thickness_mm)",
            ),
        ),
        _bracket,
    ),
}


def _bolts_cut_lug(size: Mapping[str, float]) -> bool:
    """Whether a bolt hole reaches under the lug's footprint."""
    gap_x = size["length_mm"] / 2 - size["bolt_inset_mm"] - size["lug_width_mm"] / 2
    gap_y = size["width_mm"] / 2 - size["bolt_inset_mm"] - size["lug_thickness_mm"] / 2
    return math.hypot(max(gap_x, 0.0), max(gap_y, 0.0)) <= size["bolt_hole_mm"] / 2
