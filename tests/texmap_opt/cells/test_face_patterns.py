"""What lies in the faces of unit cells, and who shares it."""

import numpy as np
import pytest

from texmap_opt.cells.catalogue import cell_names, unit_cell
from texmap_opt.cells.face_patterns import face_pattern, face_patterns_text
from texmap_opt.cells.unit_cell import TICKS


def test_the_face_of_an_octet_has_corners_centre_and_half_diagonals():
    pattern = face_pattern(unit_cell("octet"), 2, 1)
    half, end = TICKS // 2, TICKS
    assert pattern.points == {(0, 0), (0, end), (end, 0), (end, end), (half, half)}
    assert pattern.lines == {
        frozenset([(half, half), corner]) for corner in [(0, 0), (0, end), (end, 0), (end, end)]
    }
    joints = unit_cell("octet").joints[pattern.joints]
    np.testing.assert_array_equal(joints[:, 2], 1.0)


@pytest.mark.parametrize("name", cell_names())
def test_opposite_faces_match_as_the_tiling_rule_asks(name):
    """Copies meet with their other side, mirrored cells with the same side of their image."""
    cell = unit_cell(name)
    for axis, mirrored in enumerate(cell.mirrored):
        image = tuple(mirrored and k == axis for k in range(cell.dimensions))
        met = face_pattern(cell, axis, 0, reflected=image)
        pattern = face_pattern(cell, axis, 1)
        assert pattern.points == met.points
        assert pattern.lines == met.lines


def test_a_reflected_tetrahedron_has_the_other_diagonal():
    cell = unit_cell("tetrahedron")
    there = face_pattern(cell, 2, 0, reflected=(True, False, False))
    assert not face_pattern(cell, 2, 0).lines & there.lines


def test_the_text_says_which_cells_share_the_joints_of_a_face():
    library = [unit_cell(name) for name in ("bcc", "cube", "diamond", "square", "vector")]
    text = face_patterns_text(unit_cell("cube"), library)
    assert text.count("\n") == 0
    assert text.startswith("-x +x -y +y -z +z: 4 joints, 4 struts; shares joints with: ")
    assert "bcc (other struts)" in text
    assert "vector" in text
    assert "diamond" not in text
    assert "square" not in text
    alone = face_patterns_text(unit_cell("diamond"), library)
    assert "shares all joints with none" in alone
