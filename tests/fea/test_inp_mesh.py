"""Meshes of Abaqus and CalculiX decks, with their numbers."""

import numpy as np
import pytest

from fea import FeaError
from fea.inp_mesh import read_inp

NODES = """*HEADING
a deck
** a comment, 1, 2, 3
*Node, nset=all
 10, 0., 0., 0.
 20, 1., 0., 0.
 30, 0., 1., 0.
 40, 0., 0., 1.
 50, 1., 1., 1.
"""
TETS = "*ELEMENT, TYPE=C3D4, ELSET=body\n7, 10, 20, 30, 40\n5, 20, 30, 40, 50\n"


def read(tmp_path, text):
    path = tmp_path / "deck.inp"
    path.write_text(text)
    return read_inp(path)


def test_nodes_and_elements_keep_their_numbers(tmp_path):
    found = read(tmp_path, NODES + TETS + "*MATERIAL, NAME=steel\n*ELASTIC\n2e5, 0.3\n")
    np.testing.assert_array_equal(found.node_ids, [10, 20, 30, 40, 50])
    np.testing.assert_array_equal(found.element_ids, [7, 5])
    np.testing.assert_allclose(found.mesh.cell_volumes, [1 / 6, 1 / 3])
    np.testing.assert_array_equal(found.mesh.points[4], [1, 1, 1])


def test_an_element_of_many_nodes_takes_several_lines(tmp_path):
    """C3D20: Abaqus writes at most 16 entries a line, and ends a line that goes on with a comma."""
    box = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
    nodes = "".join(f"{n + 1}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(np.tile(box, (3, 1))))
    rest = ", ".join(str(n) for n in range(16, 21))
    element = "1, " + ", ".join(str(n) for n in range(1, 16)) + ",\n " + rest
    found = read(tmp_path, f"*NODE\n{nodes}*ELEMENT, TYPE=C3D20R\n{element}\n")
    assert found.mesh.cells[0][0] == "hexahedron20"
    np.testing.assert_allclose(found.mesh.cell_volumes, 1)


@pytest.mark.parametrize(
    ("element", "kind", "count"),
    [
        ("C3D10M", "tetra10", 10),
        ("C3D8I", "hexahedron", 8),
        ("C3D6", "wedge", 6),
        ("S4R", "quad", 4),
        ("CPS8R", "quad8", 8),
        ("CPEG4", "quad", 4),
        ("S3", "triangle", 3),
        ("T3D2", "line", 2),
        ("B32", "line3", 3),
    ],
)
def test_element_types_are_known_by_family_and_number(tmp_path, element, kind, count):
    nodes = "".join(f"{n}, {n}, {n * n % 7}, {n % 5}\n" for n in range(1, count + 1))
    row = ", ".join(str(n) for n in [99, *range(1, count + 1)])
    found = read(tmp_path, f"*NODE\n{nodes}*ELEMENT, TYPE={element}\n{row}\n")
    assert found.mesh.cells[0][0] == kind
    assert found.mesh.cells[0][1].shape == (1, count)


def test_springs_and_points_of_the_assembly_are_left_out(tmp_path):
    """An assembly numbers its reference points anew, from 1."""
    part = "*PART, NAME=p\n" + NODES + TETS + "*ELEMENT, TYPE=SPRINGA\n9, 10, 20\n*END PART\n"
    assembly = (
        "*ASSEMBLY, NAME=a\n*INSTANCE, NAME=p-1, PART=p\n*END INSTANCE\n*NODE\n10, 9., 9., 9.\n"
    )
    found = read(tmp_path, part + assembly + "*END ASSEMBLY\n*NODE PRINT\nU\n")
    np.testing.assert_array_equal(found.mesh.points[0], 0)
    np.testing.assert_array_equal(found.element_ids, [7, 5])


def test_included_files_are_followed(tmp_path):
    (tmp_path / "mesh.txt").write_text(TETS)
    found = read(tmp_path, NODES + "*INCLUDE, INPUT=mesh.txt\n")
    assert len(found.element_ids) == 2
    with pytest.raises(FeaError, match="includes itself"):
        read(tmp_path, NODES + "*INCLUDE, INPUT=deck.inp\n")
    with pytest.raises(FeaError, match=r"none\.inp is not a file"):
        read(tmp_path, NODES + "*INCLUDE, INPUT=none.inp\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds 0 nodes and no elements"),
        (NODES, "holds 5 nodes and no elements"),
        (NODES + "*ELEMENT, TYPE=SPRINGA\n1, 10, 20\n", r"fill space \(only SPRINGA\)"),
        (NODES + TETS.replace("50", "60"), "elements name node 60"),
        (NODES + TETS.replace("5, 20", "5, x"), r'the line "5, x, 30, 40, 50" under \*ELEMENT'),
        (NODES.replace("1., 1., 1.", "1., a, 1."), r"under \*NODE is not understood"),
        (NODES + TETS.replace(", 50", ""), r"under \*ELEMENT, TYPE=C3D4 is not understood"),
        ("*NODE, SYSTEM=C\n1, 1., 90., 0.\n", r"\*NODE, SYSTEM=C, which is not followed"),
        (NODES + "*NGEN\n1, 9, 1\n", r"has \*NGEN"),
        ("*PART, NAME=a\n" + NODES + "*END PART\n*PART, NAME=b\n", "has several parts"),
        ("*ASSEMBLY\n*INSTANCE, NAME=i, PART=a\n1., 0., 0.\n*NODE\n", "INSTANCE that is moved"),
    ],
)
def test_decks_that_cannot_be_followed_are_refused(tmp_path, text, words):
    with pytest.raises(FeaError, match=words):
        read(tmp_path, text)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(FeaError, match="is not a file; check the path"):
        read_inp(tmp_path / "none.inp")
