"""The case file: what is read is what was written, and the reference in docs/ is what is read."""

import tomllib
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from sound_case import BOX, CASE, FACES, write_stl

from texmap_opt.case import DesignCase
from texmap_opt.case_reference import case_reference
from texmap_opt.case_sections import ImportedSection
from texmap_opt.errors import CaseError
from texmap_opt.warping_function.imported import ORDERS

ROOT = Path(__file__).parents[2]


def written(folder: Path, text: str) -> Path:
    path = folder / "case.toml"
    path.write_text(text)
    return path


def test_a_case_written_with_all_defaults_reads_back_as_the_same_case(tmp_path: Path):
    case = DesignCase.from_toml(written(tmp_path, CASE))
    again = DesignCase.from_toml(written(tmp_path, case.to_toml()))
    assert again.to_toml() == case.to_toml()
    assert again.lattice == case.lattice
    assert again.material.E == case.material.E
    assert tomllib.loads(case.to_toml())["warp"]["contrast"] == 3.0


PAINTED = """[warp]
driver = ["von-mises", "paint", "file"]
combine = "sum"
driver_weights = [1.0, 2.0, 0.5]
load_cases = "sum"
case_weights = { load = 2.0 }
axes = [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]
fixed_faces = ["-x", "+z"]
[[paint]]
region = { sphere = { center = [20, 10, 10], radius = 5 } }
value = 2.0
[[paint]]
region = { stl = { file = "box.stl", unit = "cm" } }
value = 0.5
falloff_mm = 3.0
[imported]
file = "mesh.inp"
field = "S"
values = "stress.csv"
"""


def test_a_case_with_paint_and_an_imported_result_reads_back_as_the_same_case(tmp_path: Path):
    write_stl(tmp_path / "box.stl", BOX, FACES)
    text = CASE.replace('[warp]\nmethod = "uniform"\n', PAINTED)
    case = DesignCase.from_toml(written(tmp_path, text))
    (tmp_path / "elsewhere").mkdir()
    again = DesignCase.from_toml(written(tmp_path / "elsewhere", case.to_toml()))
    assert again.to_toml() == case.to_toml()
    assert again.warp == case.warp
    assert again.warp.case_weights == {"load": 2.0}
    assert [painted.value for painted in again.paint] == [2.0, 0.5]
    assert again.paint[1].falloff_mm == 3.0
    # The copy lies in another folder and still means the same files.
    files = {tmp_path / name for name in ("box.stl", "mesh.inp", "stress.csv")}
    assert files <= set(case.input_files)
    assert files <= set(again.input_files)


def test_typed_axes_become_exactly_orthonormal(tmp_path: Path):
    """Three digits of a turn by 30 degrees; the nearest right-handed axes are taken."""
    typed = "axes = [[0.866, 0.5, 0], [-0.5, 0.866, 0], [0, 0, 3]]"
    text = CASE.replace('"uniform"', f'"uniform"\n{typed}')
    axes = np.array(DesignCase.from_toml(written(tmp_path, text)).warp.axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    np.testing.assert_allclose(axes, [[c, s, 0], [-s, c, 0], [0, 0, 1]], atol=1e-4)


def test_orders_of_a_tensor_are_those_that_the_reader_knows():
    assert ImportedSection(file="a.csv", field="S", order=None).order is None
    kind = next(f for f in fields(ImportedSection) if f.name == "order").metadata["kind"]
    assert [kind.read(name) for name in ORDERS] == list(ORDERS)


@pytest.mark.parametrize("study", ["cantilever", "bracket", "statue"])
def test_the_shipped_cases_are_valid(study: str):
    case = DesignCase.from_toml(ROOT / "studies" / study / "case.toml")
    assert case.supports
    assert case.loads


def test_the_reference_of_all_keys_is_up_to_date():
    """Written anew by `python -m texmap_opt.case_reference > docs/case.md`."""
    assert (ROOT / "docs" / "case.md").read_text() == case_reference()


@pytest.mark.parametrize("method", ["best-uniform", "optimised"])
def test_a_method_that_is_not_offered_is_refused_in_the_words_of_the_reference(
    tmp_path: Path, method: str
):
    text = CASE.replace('method = "uniform"', f'method = "{method}"')
    with pytest.raises(CaseError) as refused:
        DesignCase.from_toml(written(tmp_path, text))
    value, words = str(refused.value).split(": ", 2)[1:]
    assert f"*{words}*" in case_reference() and "not offered yet" in words
    assert method in value


def test_material_constants_override_a_named_material(tmp_path: Path):
    text = CASE.replace('name = "PA12"', 'name = "PA12"\nyield_MPa = 12.0')
    case = DesignCase.from_toml(written(tmp_path, text))
    assert case.material.name == "PA12"
    assert case.material.yield_stress == 12.0
    assert case.material.E > 0


def test_density_becomes_tonne_per_cubic_millimetre(tmp_path: Path):
    text = CASE.replace('name = "PA12"', "E_MPa = 1000\nnu = 0.3\ndensity_g_cm3 = 2.0")
    assert DesignCase.from_toml(written(tmp_path, text)).material.density == pytest.approx(2e-9)


def test_the_part_on_the_command_line_replaces_that_of_the_case(tmp_path: Path):
    case = DesignCase.from_toml(written(tmp_path, CASE), part_file=tmp_path / "other.stl")
    assert case.part.file == str(tmp_path / "other.stl")


def test_loads_of_one_name_are_one_load_case(tmp_path: Path):
    load = CASE[CASE.index("[[load]]") : CASE.index("[lattice]")]
    text = CASE.replace(
        load, load + load + '[[load]]\ncase = "own"\ngravity_m_s2 = [0, 0, -9.81]\n'
    )
    case = DesignCase.from_toml(written(tmp_path, text))
    assert case.load_cases == ("load", "own")


def test_a_void_has_no_stiffest_way_to_turn(tmp_path: Path):
    text = CASE.replace("skin_mm = 1.0", 'skin_mm = 1.0\nkind = "plate"')
    turned = text.replace('"uniform"', '"least-squares"\nalignment = 5.0')
    with pytest.raises(CaseError, match='target = "axes"'):
        DesignCase.from_toml(written(tmp_path, turned))
    along = turned.replace("alignment = 5.0", 'alignment = 5.0\ntarget = "axes"')
    assert DesignCase.from_toml(written(tmp_path, along)).warp.alignment == 5.0


def test_sizing_of_a_void_defaults_to_none(tmp_path: Path):
    text = CASE.replace("skin_mm = 1.0", 'skin_mm = 1.0\nkind = "plate"')
    assert DesignCase.from_toml(written(tmp_path, text)).sizing.method == "none"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cell_mm = 10.0", "cell_mm = 10.0\ncells = [4, 2, 2]", "either cells or cell_mm"),
        ("radius_mm = 0.8", "", "either radius_mm or relative_density"),
        ("force_N = [0, 0, -10]", "", "does nothing"),
        ("force_N = [0, 0, -10]", "force_N = [0, -10]", "three numbers"),
        ("force_N = [0, 0, -10]", "force_N = [0, 0, nan]", "finite"),
        ('name = "PA12"', "E_MPa = 1000", "nu is missing"),
        ("cell_mm = 10.0", "cell_mm = true", "must be a number"),
        ('method = "uniform"', 'method = "optimised"', "not offered yet"),
        ('method = "uniform"', 'driver = ["von-mises", "von-mises"]', "twice"),
        ('method = "uniform"', "driver_weights = [1.0, 0.0]", "above 0"),
        ('method = "uniform"', 'driver = ["paint"]', "needs a table [[paint]]"),
        ('method = "uniform"', 'driver = ["file"]', "needs a table [imported]"),
        ('method = "uniform"', 'axes = "main"', "principal"),
        ('method = "uniform"', "axes = [[1, 0, 0], [0, 0, 0], [0, 0, 1]]", "length zero"),
        ('method = "uniform"', 'fixed_faces = ["x"]', "fixed_faces"),
        ('method = "uniform"', 'fixed_faces = ["-x", "-x"]', "twice"),
        ('method = "uniform"', "case_weights = {}", "table of numbers"),
        ('method = "uniform"', "case_weights = { load = -1.0 }", "at least 0"),
        ('method = "uniform"', "smoothing_cells = 0.1", "at least 0.5"),
        ('method = "uniform"', "[imported]\nfile = 'r.vtu'", "field is missing"),
        ('method = "uniform"', "[imported]\nfile = 'r.vtu'\nfield = 'S'", "drives nothing"),
        ("[[support]]", "[support]", "[[support]]"),
    ],
)
def test_entries_that_contradict_or_miss_are_refused(
    tmp_path: Path, old: str, new: str, words: str
):
    assert old in CASE
    with pytest.raises(CaseError, match=r"case\.toml") as refused:
        DesignCase.from_toml(written(tmp_path, CASE.replace(old, new, 1)))
    assert words in str(refused.value)


def test_a_part_on_the_command_line_replaces_a_built_in_one_with_its_dimensions(tmp_path: Path):
    text = CASE.replace('file = "box.stl"', 'builtin = "cantilever"\nlength_mm = 50')
    case = DesignCase.from_toml(written(tmp_path, text), part_file=tmp_path / "other.stl")
    assert case.part.builtin is None
    assert case.part.dimensions == {}


def test_a_named_material_may_have_another_modulus(tmp_path: Path):
    text = CASE.replace('name = "PA12"', 'name = "PA12"\nE_MPa = 1000')
    material = DesignCase.from_toml(written(tmp_path, text)).material
    assert material.E == 1000
    assert material.name == "PA12"


def test_dimensions_of_a_built_in_part_are_written_with_their_defaults(tmp_path: Path):
    text = CASE.replace('file = "box.stl"', 'builtin = "cantilever"\nlength_mm = 50')
    part = tomllib.loads(DesignCase.from_toml(written(tmp_path, text)).to_toml())["part"]
    assert part["length_mm"] == 50
    assert part["width_mm"] == 20


@pytest.mark.parametrize(("entry", "override"), [("warp = 3\n", {"warp_method": "uniform"})])
def test_an_override_of_what_is_no_table_is_refused(tmp_path: Path, entry: str, override: dict):
    with pytest.raises(CaseError, match="must be a table"):
        DesignCase.from_toml(
            written(tmp_path, entry + CASE.replace("[warp]", "[lattice2]")), **override
        )


def test_a_number_beyond_all_measure_is_refused(tmp_path: Path):
    text = CASE.replace("radius_mm = 0.8", "radius_mm = " + "9" * 400)
    with pytest.raises(CaseError, match="finite"):
        DesignCase.from_toml(written(tmp_path, text))


def test_a_displacement_of_a_direction_that_is_free_is_refused(tmp_path: Path):
    text = CASE.replace("[[load]]", 'fix = ["x"]\nvalue_mm = [0, 0, 1]\n[[load]]')
    with pytest.raises(CaseError, match="moves z"):
        DesignCase.from_toml(written(tmp_path, text))
