"""`texmap cells`: the library as a table, and in the order of a property."""

import json
from dataclasses import replace

import pytest

from texmap_opt.cache import StageCache
from texmap_opt.cells import catalogue
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.listing import listing, listing_text
from texmap_opt.cells.ranking import Ranking, ranking, wish_of
from texmap_opt.cli import main
from texmap_opt.errors import InputError

NAMES = ("bcc", "column", "cube", "square")
# None of what bends, stretches or shears is near its neighbour in these orders: factors of 2 and more.
ORDERS = {
    # Chains of struts along x, by how much of the material they are; then bending.
    ("E", "1,0,0"): ["square", "cube", "bcc", "column"],
    # The diagonal is that of bcc's struts.
    ("E", "1,1,1"): ["bcc", "cube", "column"],
    ("E", "0,0,1"): ["square", "column", "cube", "bcc"],
    # What the paper asks for: stiff in one direction and flexible in the others.
    ("E_ratio", None): ["column", "square", "bcc", "cube"],
    ("G", "1,0,0"): ["bcc", "cube", "column", "square"],
}


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> StageCache:
    return StageCache(tmp_path_factory.mktemp("kept"))


def ranked(cache: StageCache, name: str, direction: str | None = None, **more) -> Ranking:
    cells = [unit_cell(name) for name in NAMES]
    wish = wish_of(name, direction, 0.1, **more)
    return ranking(cells, wish, cache=cache, computing=lambda _: None)


@pytest.mark.parametrize(("name", "direction"), ORDERS)
def test_cells_come_in_the_order_of_their_mechanics(cache, name: str, direction: str | None):
    assert [row.cell.name for row in ranked(cache, name, direction).rows] == ORDERS[name, direction]


def test_ascending_turns_the_order_round(cache):
    names = [row.cell.name for row in ranked(cache, "E", "1,0,0", ascending=True).rows]
    assert names == ORDERS["E", "1,0,0"][::-1]


def test_cells_without_the_property_are_left_out_and_the_reason_is_told_once(cache):
    found = ranked(cache, "E", "1,1,1")
    assert list(found.left_out) == ["square"]
    assert "left out: square: a 2.5-D cell has it in its plane" in found.text()
    found = ranked(cache, "zener")
    assert list(found.left_out) == ["column"]
    assert found.as_dict()["direction"] is None
    two = replace(found, left_out={"column": "not cubic", "other": "not cubic"})
    assert two.text().endswith("left out: column, other: not cubic")
    assert two.text().count("left out") == 1


def test_the_table_is_aligned_and_cut_to_the_terminal(cache):
    cells = [unit_cell(name) for name in NAMES]
    rows = listing(cells, cache=cache, computing=lambda _: None)
    assert [row.cell.name for row in rows] == list(NAMES)  # 3-D first
    lines = listing_text(rows, 100).splitlines()[:5]
    assert max(map(len, lines)) == 100
    start = lines[0].index("description")
    for line, row in zip(lines[1:], rows, strict=True):
        assert line[start - 2 : start] == "  "
        assert row.cell.description.startswith(line[start:].rstrip("…"))


@pytest.fixture
def few_cells(monkeypatch, cache):
    """A library of two cells: homogenising takes a second or two each."""
    monkeypatch.setattr(catalogue, "cell_names", lambda: ["cube", "square"])
    monkeypatch.setenv("TEXMAP_CACHE_DIR", str(cache.directory))


def run(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["cells", *arguments])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


@pytest.mark.usefixtures("few_cells")
def test_the_command_lists_and_ranks(capsys):
    code, out, _ = run(capsys, "--json")
    assert code == 0
    rows = json.loads(out)
    assert [row["name"] for row in rows] == ["cube", "square"]
    assert rows[0]["maxwell_number"] == -6 and rows[0]["class"] == "bending"
    assert 0.033 < rows[0]["relative_modulus"] < 0.05  # a third of the density, and what joints add
    code, out, err = run(capsys, "--rank", "E", "--direction", "0,0,1", "--json")
    # Nothing is computed twice.
    assert (code, err) == (0, "")
    assert [row["name"] for row in json.loads(out)["cells"]] == ["square", "cube"]
    code, out, _ = run(capsys, "--dimensions", "2")
    assert "square" in out and "cube" not in out


@pytest.mark.usefixtures("few_cells")
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rank", "stiffness"], 'property "stiffness" is not one that cells are ranked by'),
        (["--rank", "E", "--direction", "1,0"], 'direction "1,0" is not three numbers'),
        (["--rank", "E", "--density", "1.5"], "density 1.5: the relative density must be above 0"),
        (["--rank", "bulk", "--direction", "1,0,0"], 'property "bulk" has no direction'),
        (["--density", "0"], "--density needs --rank"),
    ],
)
def test_a_wrong_wish_is_one_sentence_and_code_2(capsys, arguments: list[str], said: str):
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"texmap: {said}")
    assert err.count("\n") == 1


def test_a_wish_without_words_is_along_x_at_a_tenth():
    wish = wish_of("E", None, None)
    assert (wish.direction, wish.density, wish.ascending) == ((1.0, 0.0, 0.0), 0.1, False)
    with pytest.raises(InputError):
        wish_of("E", "0,0,0", None)
