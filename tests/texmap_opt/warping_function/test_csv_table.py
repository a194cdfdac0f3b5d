"""Tables of numbers, and the tensors that their columns spell."""

import numpy as np
import pytest

from texmap_opt.errors import CaseError
from texmap_opt.warping_function.csv_table import read_csv

WHERE = "case.toml: [imported]"


def read(tmp_path, text):
    path = tmp_path / "values.csv"
    path.write_text(text, encoding="utf-8")
    return read_csv(path, WHERE)


@pytest.mark.parametrize(
    "text",
    [
        "x,S_Mises\n1,2.5\n3,4.5\n",
        '"X","S_Mises"\n"1","2.5"\n"3","4.5"\n\n',
        "x ; S_Mises (MPa)\n1;2,5\n3;4,5\n",
        "x [mm]\tS_Mises [MPa]\n1\t2.5\n3\t4.5\n",
        "\ufeffx, S_Mises\r\n1, 2.5\r\n3, 4.5\r\n",
        "part,x,S_Mises\nPART-1,1,2.5\nPART-1,3,4.5\n",
        '"Stress, top",x,S_Mises\n0,1,2.5\n0,3,4.5\n',
        'x, S_Mises\n1, "2.5"\n3, "4.5"\n',
    ],
    ids=[
        "plain",
        "quoted",
        "decimal comma",
        "tab",
        "BOM",
        "column of text",
        "comma in a name",
        "blank before a quote",
    ],
)
def test_tables_of_many_programs_are_read(tmp_path, text):
    table = read(tmp_path, text)
    np.testing.assert_array_equal(table.column("x"), [1, 3])
    values, labelled = table.field("S_Mises")
    np.testing.assert_array_equal(values, [[2.5], [4.5]])
    assert not labelled
    assert table.column("y") is None and table.field("y") is None


@pytest.mark.parametrize(
    "names",
    [
        "S12,S11,S33,S23,S22,S13",
        "S-S12,S-S11,S-S33,S-S23,S-S22,S-S13",
        "S:XY,S:XX,S:ZZ,S:YZ,S:YY,S:XZ",
        "s_xy,s_xx,s_zz,s_yz,s_yy,s_zx",
    ],
)
def test_named_components_come_in_voigt_order_whatever_the_order_of_columns(tmp_path, names):
    """xx, yy, zz, yz, xz, xy."""
    table = read(tmp_path, f"{names}\n12,11,33,23,22,13\n")
    field = {"S1": "S", "S-": "S-S", "S:": "S", "s_": "s"}[names[:2]]
    values, labelled = table.field(field)
    np.testing.assert_array_equal(values, [[11, 22, 33, 23, 13, 12]])
    assert labelled
    assert table.fields()[field] == 6


def test_numbered_components_come_by_number_and_not_named(tmp_path):
    """ParaView's names; nine of them row by row."""
    values, labelled = read(tmp_path, "S:1,S:0,S:2\n1,0,2\n").field("S")
    np.testing.assert_array_equal(values, [[0, 1, 2]])
    assert not labelled


def test_both_halves_of_a_tensor_in_full_are_averaged(tmp_path):
    names = "T_xx,T_xy,T_xz,T_yx,T_yy,T_yz,T_zx,T_zy,T_zz"
    values, labelled = read(tmp_path, f"{names}\n1,2,3,2.2,4,5,3.2,5.2,6\n").field("T")
    np.testing.assert_allclose(values, [[1, 4, 6, 5.1, 3.1, 2.1]])
    assert labelled


def test_principal_stresses_are_no_tensor(tmp_path):
    table = read(tmp_path, "S1,S2,S3\n1,2,3\n")
    assert table.field("S") is None
    assert table.fields() == {"S1": 1, "S2": 1, "S3": 1}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no rows of values"),
        ("x,y\n", "has no rows of values"),
        ("x,y\n1,2\n3\n", "line 3: has 1 entries for the 2 columns"),
        ("x,y\n1,2,3\n", "line 2: has 3 entries"),
        ("x,y\n1,2\n\n3,-\n", 'line 4: column "y" has "-", which is not a number'),
        ("x,y\n1,2\n3,\n", 'line 3: column "y" has ""'),
        ("x,y\n1,2\n3,1_0\n", 'column "y" has "1_0"'),
        ("x,y\na,b\n", "no numbers in its second line"),
    ],
)
def test_broken_tables_are_refused_with_the_line(tmp_path, text, words):
    with pytest.raises(CaseError, match=words) as failure:
        read(tmp_path, text)
    assert str(failure.value).startswith(f"{WHERE}: values.csv")


def test_a_file_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(CaseError, match="is not a file; check the path"):
        read_csv(tmp_path / "none.csv", WHERE)
