"""report.html: self-contained, and whole whatever is missing."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.report.grid_layers import grid_layers
from texmap_opt.report.page import write_page
from texmap_opt.report.plots import MOST_POLYGONS, PlotData
from texmap_opt.report.tables import DASH, THIN_SPACE
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.grid import Grid

REPORT = {
    "version": "0.1.0",
    "model": "frame",
    "case_file": "case.toml",
    "seconds": {"part": 0.2, "tets": 5.0, "warp": 3.1, "total": 8.3},
    "peak_memory_mb": 812.4,
    "part": {
        "name": "bracket <1>.stl",
        "triangles": 5050,
        "volume_mm3": 64000.0,
        "watertight": True,
    },
    "tet_mesh": {"nodes": 60321, "tets": 38211, "element": "tet10"},
    "stress": {
        "max_displacement_mm": 0.0834,
        "compliance_Nmm": 41.7,
        "max_von_mises_MPa": 235.2,
        "reaction_N": [[0.0, 1.2e-12, 500.0]],
        "residual": 3.1e-11,
        "estimated_error": 0.041,
    },
    "warp": {
        "method": "least-squares",
        "nodes": 1463,
        "min_jacobian": 0.41,
        "folded_cells": 0,
        "max_aspect": 2.31,
        "mean_angle_deg": 21.3,
        "turn_deg": 7.1,
        "turn_uniform_deg": 11.3,
        "iterations": 41,
        "converged": True,
        "message": "",
        "size_slope": 0.981,
        "energy": {"warped": 0.62, "best": 0.5, "worst": 1.9, "share": 0.76},
        "measures": {"gradient_norm": 3.2e-7},
    },
    "structure": {"cell": "octet", "cells": [16, 8, 4], "joints": 2525, "struts": 13184},
    "sizing": {
        "method": "optimality-criteria",
        "compliance_before_Nmm": 612.0,
        "compliance_after_Nmm": 306.0,
        "max_utilisation": 0.83,
        "history": {"compliance": [612.0, 400.0, 306.0], "volume": [9600.0, 9600.0, 9600.0]},
    },
    "lattice": {"triangles": 931210, "watertight": True, "volume_mm3": 9588.2, "genus": 8212},
    "result": {
        "triangles": 1021332,
        "watertight": True,
        "volume_mm3": 14311.2,
        "mass_g": 38.21,
        "relative_density": 0.2236,
        "connected_components": 1,
        "closed_voids": 1,
    },
    "printability": {
        "closed_voids": {"count": 2, "total_mm3": 4321.0, "largest": []},
        "walls": {"smallest_mm": 0.41, "percentile_5_mm": 0.62, "median_mm": 1.0},
        "gaps": {"smallest_mm": None, "percentile_5_mm": None, "median_mm": None},
        "overhang": {
            "build_direction": [0.0, 0.0, 1.0],
            "limit_deg": 45.0,
            "share": 0.121,
            "best_direction": [0.0, 0.6, 0.8],
            "best_share": 0.07,
        },
        "struts": {"count": 812, "length_mm": 2031.0, "share": 0.25},
        "after_stl": {"same": True},
    },
    "warnings": ["3.2 < 4 cells across"],
    "notes": ["no skin in the frame"],
}

RNG_SEED = 4
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def plot_data() -> PlotData:
    rng = np.random.default_rng(RNG_SEED)
    size = rng.uniform(3, 6, 200)
    return PlotData(
        radii=rng.uniform(0.3, 0.8, 500),
        utilisation=rng.uniform(0, 0.83, 500),
        lengths=rng.uniform(2, 4, 500),
        wanted_mm=size,
        achieved_mm=size * rng.uniform(0.9, 1.1, 200),
        strut_angles_deg=rng.uniform(0, 90, 500),
        strut_weights=rng.uniform(0, 1, 500),
        turns_deg=rng.uniform(0, 20, 600),
        turn_weights=rng.uniform(0, 1, 600),
        unturned_deg=rng.uniform(0, 45, 600),
        unturned_weights=rng.uniform(0, 1, 600),
        layers=layers((4, 3, 5)),
    )


def layers(cells):
    grid = Grid.uniform(Box.aligned(np.array([[0.0, 0, 0], [4, 3, 5]])), cells)
    part = TriMesh(np.array([[0.0, 0, 0], [4, 0, 0], [0, 3, 0], [0, 0, 5]]), TETRAHEDRON)
    values = np.linspace(0.7, 1.2, grid.cell_count)
    return grid_layers(grid, values, np.arange(grid.cell_count) % 3 > 0, part)


@pytest.fixture
def picture(tmp_path) -> Path:
    from PIL import Image

    png = tmp_path / "picture.png"
    Image.new("RGB", (40, 30), "teal").save(png)
    return png


def written(tmp_path, report, *, pictures=None, missing=None, plots=None) -> str:
    path = tmp_path / "report.html"
    write_page(
        report, path, pictures=pictures or {}, missing=missing or {}, plot_data=plots or PlotData()
    )
    assert not (tmp_path / "report.html.part").exists()
    return path.read_text(encoding="utf-8")


class Loaded(HTMLParser):
    """Collects what a browser would fetch, and tags left open."""

    def __init__(self):
        super().__init__()
        self.fetched, self.open, self.ids = [], [], []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.fetched += [values[k] for k in ("src", "srcset", "data", "poster") if k in values]
        if tag in ("link", "script", "iframe", "object", "image", "use"):
            self.fetched.append(values.get("href") or values.get("xlink:href") or tag)
        self.ids += [values["id"]] if "id" in values else []
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(html: str) -> Loaded:
    page = Loaded()
    page.feed(html)
    assert page.open == []
    return page


def test_the_page_fetches_nothing_and_runs_nothing(tmp_path, picture):
    names = ("load", "grid", "size-error", "radius", "utilisation", "cut", "whole", "look", "other")
    html = written(tmp_path, REPORT, pictures=dict.fromkeys(names, picture), plots=plot_data())
    page = parsed(html)
    assert page.fetched
    assert all(s.startswith(("data:image/", "#")) for s in page.fetched)
    assert sum(s.startswith("data:image/jpeg;base64,") for s in page.fetched) == len(names)
    assert "<script" not in html
    assert not re.search(r"https?://|@import|url\((?!#)", html)
    assert len(page.ids) == len(set(page.ids))


def test_the_headline_says_mass_compliance_and_that_it_prints(tmp_path):
    html = written(tmp_path, REPORT)
    headline = html[html.index('class="headline"') : html.index("<section")]
    assert "38.21" in headline
    assert "306" in headline
    assert "612 before sizing: \N{MINUS SIGN}50.0&nbsp;%" in headline
    assert "one watertight body" in headline


def test_the_headline_names_the_skin_where_it_is_nearer_to_yield_than_the_struts(tmp_path):
    html = written(tmp_path, REPORT | {"skin": {"max_utilisation": 1.2}})
    headline = html[html.index('class="headline"') : html.index("<section")]
    assert "120 %" in headline
    assert "above yield, in the skin" in headline
    assert "83 %" in written(tmp_path, REPORT | {"skin": {"max_utilisation": 0.4}})


def test_the_joint_model_stands_beside_its_error(tmp_path):
    model = {"rigid_end": [1.72, 0.8], "error": [0.054, 0.213], "thicker_share": 0.46}
    html = written(tmp_path, REPORT | {"joint_model": model})
    assert "<h3>Joint model</h3>" in html
    assert "counted as that</th><td>46 %</td>" in html
    assert "at most</th><td>5.4 %, 21.3 %</td>" in html
    assert "Joint model" not in written(tmp_path, REPORT | {"joint_model": None})


def test_a_result_in_pieces_is_not_called_printable(tmp_path):
    broken = REPORT["result"] | {"connected_components": 3, "watertight": False}
    html = written(tmp_path, REPORT | {"result": broken})
    assert "not watertight; 3 separate bodies" in html


def test_numbers_have_units_and_sensible_digits(tmp_path):
    html = written(tmp_path, REPORT)
    for text in ("64\u202f000 mm³", "0.0834 mm", "235.2 MPa", "0, 0, 500 N", "16 × 8 × 4"):
        assert text in html
    assert "3.1 × 10<sup>-11</sup>" in html


@pytest.mark.parametrize("absent", list(REPORT))
def test_a_missing_section_is_left_out_and_the_rest_stays(tmp_path, absent):
    some = PlotData(lengths=np.linspace(2, 4, 50), layers=layers((2, 1, 2))[:1])
    html = written(tmp_path, {k: v for k, v in REPORT.items() if k != absent}, plots=some)
    parsed(html)
    assert ("octet" in html) == (absent != "structure")


def test_an_empty_report_is_still_a_page(tmp_path):
    parsed(written(tmp_path, {}))


def test_sizing_values_of_none_are_dashes_and_no_headline(tmp_path):
    none = dict.fromkeys(REPORT["sizing"], None) | {"method": "none"}
    html = written(tmp_path, REPORT | {"sizing": none})
    parsed(html)
    assert "<th>compliance after</th><td>–</td>" in html
    assert "before sizing" not in html


def test_the_warp_shows_sizes_angles_energies_layers_and_how_it_ended(tmp_path):
    html = written(tmp_path, REPORT, plots=plot_data())
    section = html[html.index("<h2>Warp</h2>") : html.index("<h2>Structure</h2>")]
    for text in (
        "slope of achieved over wanted (log)</th><td>0.981</td>",
        "share of the attainable gain</th><td>76 %</td>",
        "gradient norm</th><td>3.20 × 10<sup>-7</sup></td>",
    ):
        assert text in section
    assert section.count("<svg") == 3 + 3
    # The angle that depends on the order of the axes comes last.
    angles = [section.index(f"<td>{degrees} °</td>") for degrees in ("7.1", "11.3", "21.3")]
    assert angles == sorted(angles)
    for axis in ("first", "second", "third"):
        assert f"seen along the grid's {axis} axis" in section


def test_without_a_stress_there_are_no_angles_and_no_energies(tmp_path):
    data = plot_data()
    sizes = PlotData(wanted_mm=data.wanted_mm, achieved_mm=data.achieved_mm)
    warp = REPORT["warp"] | {"energy": dict.fromkeys(REPORT["warp"]["energy"]), "turn_deg": None}
    html = written(tmp_path, REPORT | {"warp": warp}, plots=sizes)
    parsed(html)
    assert "Strain energy of the cells" not in html
    assert "nearest principal axis [" not in html
    assert "achieved over wanted cell size" in html


def test_a_layer_of_very_many_cells_is_a_picture_in_the_plot(tmp_path):
    """One polygon a cell would make the page heavy."""
    n = int(np.sqrt(MOST_POLYGONS)) + 1
    many = layers((2, n, n))[:1]
    html = written(tmp_path, {}, plots=PlotData(layers=many))
    page = parsed(html)
    assert any(source.startswith("data:image/png") for source in page.fetched)
    assert len(html) < 400_000


def test_one_size_for_all_cells_has_plots_too(tmp_path):
    same = np.full(20, 2.5)
    achieved = np.where(np.arange(20) == 3, np.nan, same)
    parsed(written(tmp_path, {}, plots=PlotData(wanted_mm=same, achieved_mm=achieved)))


def test_a_missing_picture_says_why(tmp_path, picture):
    html = written(
        tmp_path, REPORT, pictures={"cut": picture}, missing={"whole": "no OpenGL <here>"}
    )
    assert "Not drawn: no OpenGL &lt;here&gt;." in html
    assert html.count("data:image/jpeg") == 1


def test_names_from_outside_cannot_become_markup(tmp_path):
    html = written(tmp_path, REPORT | {"warnings": ["<b>bold</b>"]})
    assert "bracket &lt;1&gt;.stl" in html
    assert "<b>" not in html


def test_all_numbers_are_in_the_page(tmp_path):
    html = written(tmp_path, REPORT)
    from html import unescape

    raw = unescape(re.search(r"<pre>(.*)</pre>", html, re.DOTALL).group(1))
    assert json.loads(raw) == REPORT


@pytest.mark.parametrize("radii", [np.full(5, 0.5), np.array([0.5]), np.zeros(3)])
def test_equal_radii_still_have_a_histogram(tmp_path, radii):
    parsed(written(tmp_path, REPORT, plots=PlotData(radii=radii, utilisation=0 * radii)))


def test_the_same_numbers_give_the_same_page(tmp_path):
    assert written(tmp_path, REPORT, plots=plot_data()) == written(
        tmp_path, REPORT, plots=plot_data()
    )


def test_printability_is_told_in_words(tmp_path):
    html = written(tmp_path, REPORT)
    for words in (
        "4 321 mm³ in 2 closed voids",
        "0.41, 0.62, 1 mm",
        "12.1 % below 45° along (0, 0, 1); 7 % along (0, 0.6, 0.8)",
        "812, 25 % of their length",
    ):
        assert words.replace("4 321", f"4{THIN_SPACE}321") in html
    assert f"<th>gaps: smallest, 5 %, median</th><td>{DASH}</td>" in html
