"""Built-in parts: watertight, and of the volume that solid geometry gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.builtin_part import BUILTIN_PARTS, CHORD_TOLERANCE, builtin_part
from texmap_opt.errors import PartError
from texmap_opt.repair import repaired


def bracket_volume(d):
    """Plate + lug (rectangle and half disc) - pin hole - bolt holes."""
    r = d["lug_width_mm"] / 2
    lug = 2 * r * d["lug_height_mm"] + np.pi * r**2 / 2 - np.pi * d["lug_hole_mm"] ** 2 / 4
    plate = d["length_mm"] * d["width_mm"] - np.pi * d["bolt_hole_mm"] ** 2
    return plate * d["plate_mm"] + lug * d["lug_thickness_mm"]


def l_bracket_volume(d):
    """Two legs, less the corner they share, plus the fillet (1 - π/4) r²."""
    t, r = d["thickness_mm"], d["fillet_mm"]
    area = t * (d["length_mm"] + d["height_mm"] - t) + (1 - np.pi / 4) * r**2
    return area * d["width_mm"]


def block_volume(d):
    return d["length_mm"] * d["width_mm"] * d["height_mm"]


VOLUMES = {
    "cantilever": block_volume,
    "mbb": block_volume,
    "three-point-bending": block_volume,
    "torsion-bar": lambda d: np.pi * d["diameter_mm"] ** 2 / 4 * d["length_mm"],
    "l-bracket": l_bracket_volume,
    "bracket": bracket_volume,
}


@pytest.mark.parametrize("name", BUILTIN_PARTS)
def test_a_builtin_part_is_one_flawless_solid_of_the_right_volume(name):
    surface = builtin_part(name, {})
    assert repaired(surface, name).notes == ()
    # Circles have their own area exactly; the lug's round top and the fillet are within chords.
    expected = VOLUMES[name](BUILTIN_PARTS[name].dimensions)
    np.testing.assert_allclose(surface.volume, expected, rtol=3e-4)


@pytest.mark.parametrize("name", ["cantilever", "torsion-bar"])
def test_volume_without_arcs_is_exact(name):
    surface = builtin_part(name, {})
    expected = VOLUMES[name](BUILTIN_PARTS[name].dimensions)
    np.testing.assert_allclose(surface.volume, expected, rtol=1e-12)


def test_the_cantilever_is_that_of_the_verification_cases():
    np.testing.assert_array_equal(builtin_part("cantilever", {}).bounds, [[0, 0, 0], [100, 20, 20]])


@settings(derandomize=True, max_examples=15, deadline=None)
@given(diameter=st.floats(0.5, 200))
def test_circles_stay_within_the_chord_tolerance(diameter):
    surface = builtin_part("torsion-bar", {"diameter_mm": diameter})
    radius = np.linalg.norm(surface.vertices[:, 1:], axis=1)
    chord = np.cos(np.pi / (len(surface.vertices) // 2)) * radius
    assert (np.abs(radius - diameter / 2) <= CHORD_TOLERANCE).all()
    assert (np.abs(chord - diameter / 2) <= CHORD_TOLERANCE).all()


@settings(derandomize=True, max_examples=15, deadline=None)
@given(scale=st.floats(0.2, 5), name=st.sampled_from(sorted(BUILTIN_PARTS)))
def test_volume_grows_with_the_cube_of_all_dimensions(scale, name):
    size = {key: value * scale for key, value in BUILTIN_PARTS[name].dimensions.items()}
    np.testing.assert_allclose(
        builtin_part(name, size).volume, builtin_part(name, {}).volume * scale**3, rtol=3e-3
    )


@pytest.mark.parametrize(
    ("name", "size", "words"),
    [
        ("cantilver", {}, 'did you mean "cantilever"'),
        ("cantilever", {"lenght_mm": 3.0}, 'did you mean "length_mm"'),
        ("cantilever", {"length_mm": -3.0}, "length_mm = -3 must be"),
        ("cantilever", {"length_mm": float("nan")}, "finite"),
        ("torsion-bar", {"diameter_mm": 0.0}, "above 0"),
        ("l-bracket", {"thickness_mm": 80.0}, "thickness_mm = 80"),
        ("bracket", {"bolt_hole_mm": 25.0}, "break the rim"),
        ("bracket", {"bolt_inset_mm": 28.0}, "the holes meet"),
        ("bracket", {"lug_width_mm": 90.0}, "below length_mm"),
        ("bracket", {"lug_hole_mm": 36.0}, "has no wall"),
        ("bracket", {"lug_height_mm": 7.0}, "reaches the plate"),
        ("bracket", {"lug_width_mm": 70.0, "lug_thickness_mm": 50.0}, "clear of the lug"),
    ],
)
def test_impossible_dimensions_are_refused_with_values_and_limit(name, size, words):
    with pytest.raises(PartError, match=words):
        builtin_part(name, size)
