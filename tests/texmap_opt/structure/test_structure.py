"""The invariants of a structure are checked, and a broken one is named."""

from dataclasses import replace

import numpy as np
import pytest

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.errors import StructureError
from texmap_opt.structure.structure import Structure

S = drawn_cell(unit_cell("bcc"))


def broken(field: str, index, value) -> Structure:
    array = getattr(S, field).copy()
    array[index] = value
    return replace(S, **{field: array})


@pytest.mark.parametrize(
    ("structure", "message"),
    [
        (broken("joints", (4, 1), np.nan), "joint 4 has a coordinate that is not a finite"),
        (broken("struts", (2, 0), 9), "strut 2 ends at a joint that does not exist; there are 9"),
        (broken("struts", (2, 0), -1), "strut 2 ends at a joint that does not exist"),
        (broken("struts", 3, S.struts[0][::-1]), "strut 3 repeats an earlier strut"),
        (broken("struts", 3, 5), "strut 3 has no length"),
        (broken("radii", (1, 1), 0.0), "strut 1 has a radius that is not a positive"),
        (broken("radii", (1, 1), np.inf), "strut 1 has a radius that is not a positive"),
        (broken("cell_size", 6, -1.0), "strut 6 has a cell size that is not a positive"),
    ],
)
def test_a_broken_invariant_is_named(structure: Structure, message: str):
    with pytest.raises(StructureError, match=message):
        structure.validate()


def test_one_cell_is_sound_and_in_one_piece():
    S.validate()
    np.testing.assert_array_equal(S.components(), 0)
    np.testing.assert_array_equal(np.sort(S.degrees()), [1] * 8 + [8])
    np.testing.assert_allclose(S.lengths(), 10 * np.sqrt(3) / 2)


def test_selecting_struts_keeps_only_their_joints():
    two = S.select(np.arange(8) < 2)
    two.validate()
    assert (len(two.joints), len(two.struts)) == (3, 2)
    np.testing.assert_array_equal(two.joints[two.struts], S.joints[S.struts[:2]])


def test_separate_pieces_have_different_labels():
    far = np.concatenate([S.joints, S.joints + 100])
    both = Structure(
        far,
        np.concatenate([S.struts, S.struts + 9]),
        np.tile(S.radii, (2, 1)),
        np.zeros(18, bool),
        np.tile(S.cell_size, 2),
    )
    np.testing.assert_array_equal(both.components(), [0] * 9 + [1] * 9)
