"""report.html: one file with everything in it; no network, no scripts."""

import base64
import io
import json
from collections.abc import Mapping
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from texmap_opt.report import plots, tables
from texmap_opt.report.overlay import colour_range
from texmap_opt.report.plots import PlotData
from texmap_opt.report.tables import Row, digits, table

# Visually lossless for such pictures, at a fifth of PNG's size.
JPEG_QUALITY = 90

CAPTIONS = {
    "load": "The part under load, coloured by von Mises stress; supports blue, loads red.",
    "grid": "Cells that meet the part, coloured by size; of a grid in three dimensions the octant in "
    "front is left out.",
    "size-error": "The same cells by achieved over wanted size: red too large, blue too small.",
    "kinds": "Cells that meet the part, coloured by the unit cell they hold; of a grid in three dimensions "
    "the octant in front is left out.",
    "radius": "Struts coloured by radius, walls by half their thickness.",
    "utilisation": "Struts coloured by utilisation: worst stress in the section over yield.",
    "cut": "The result cut open; the section is orange.",
    "whole": "The result.",
    "look": "What was planned: supports and loads, and the grid's outline.",
}

CITATIONS = (
    "Y. Chen, “3D Texture Mapping for Rapid Manufacturing”, Computer-Aided Design and Applications "
    "4 (6), 2007, 761–771, doi:10.1080/16864360.2007.10738509: the method this program extends.",
    "A. Johnen, J.-C. Weill, J.-F. Remacle, “Robust and efficient validation of the linear "
    "hexahedral element”, Procedia Engineering 203, 2017, 271–283: the certificate that no cell "
    "is folded.",
)

Report = Mapping[str, Any]


def write_page(
    report: Report,
    path: Path,
    *,
    pictures: Mapping[str, Path],
    missing: Mapping[str, str],
    plot_data: PlotData,
) -> None:
    """Write the page; the file appears whole or not at all.

    Args:
        report: the content of report.json; a section that is absent is left out.
        path: where to write.
        pictures: PNG files by name; those of `CAPTIONS` have their places, others come last.
        missing: why a picture is missing, by name.
        plot_data: arrays behind the plots.
    """
    shown = _Figures(pictures, missing)
    body = [
        _header(report),
        _headline(report),
        _warnings(report),
        _result(report, shown),
        _inputs(report, shown),
        _section("Stress", [table(_of(report, "stress"), tables.STRESS)], [shown.of("load")]),
        _warp(report, shown, plot_data),
        _structure(report, shown, plot_data),
        _sizing(report, shown, plot_data),
        shown.rest(),
        _times(report),
        _notes(report),
        _origin(report),
    ]
    html = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(_name(report))}</title><style>{_style()}</style></head>"
        f"<body><main>{''.join(body)}</main></body></html>\n"
    )
    half_written = path.with_name(path.name + ".part")
    half_written.write_text(html, encoding="utf-8")
    half_written.replace(path)


class _Figures:
    """Pictures by name, each used once."""

    def __init__(self, pictures: Mapping[str, Path], missing: Mapping[str, str]) -> None:
        self._pictures = dict(pictures)
        self._missing = dict(missing)

    def of(self, name: str) -> str:
        """The picture, the reason why it is missing, or nothing."""
        caption = CAPTIONS.get(name, escape(name))
        if name in self._pictures:
            source = _embedded(self._pictures.pop(name))
            return _figure(f'<img alt="{caption}" src="{source}">', caption)
        if name in self._missing:
            reason = escape(self._missing.pop(name))
            return _figure(f'<div class="missing">Not drawn: {reason}.</div>', caption)
        return ""

    def rest(self) -> str:
        """Pictures that no section has asked for."""
        names = [*self._pictures, *self._missing]
        return _section("More pictures", [], [self.of(name) for name in names])


def _embedded(png: Path) -> str:
    from PIL import Image

    out = io.BytesIO()
    with Image.open(png) as image:
        image.convert("RGB").save(out, "JPEG", quality=JPEG_QUALITY, subsampling=0, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(out.getvalue()).decode()


def _style() -> str:
    return resources.files("texmap_opt.report").joinpath("page.css").read_text(encoding="utf-8")


def _of(report: Report, key: str) -> Report:
    section = report.get(key)
    return section if isinstance(section, Mapping) else {}


def _figure(content: str, caption: str) -> str:
    return f"<figure>{content}<figcaption>{caption}</figcaption></figure>"


def _section(title: str, left: list[str], figures: list[str], below: str = "") -> str:
    """Tables and small plots on the left of one picture, or above several."""
    left, figures = [piece for piece in left if piece], [f for f in figures if f]
    if not (left or figures or below):
        return ""
    if left and len(figures) == 1:
        stack = f'<div class="stack">{"".join(left)}</div>'
        inner = f'<div class="columns">{stack}{figures[0]}</div>'
    else:
        inner = f'<div class="columns even">{"".join(left)}</div>' if left else ""
        inner += f'<div class="pictures">{"".join(figures)}</div>' if figures else ""
    return f"<section><h2>{title}</h2>{inner}{below}</section>"


def _plots(*svgs: tuple[str, str]) -> str:
    figures = "".join(_figure(svg, caption) for svg, caption in svgs)
    return f'<div class="plots">{figures}</div>' if figures else ""


def _name(report: Report) -> str:
    part = _of(report, "part").get("name") or report.get("case_file") or "part"
    return f"Lattice report: {Path(str(part)).name}"


def _header(report: Report) -> str:
    pieces = [
        f"case {escape(str(report['case_file']))}" if report.get("case_file") else "",
        f"texmap-opt {escape(str(report['version']))}" if report.get("version") else "",
        f"model: {escape(str(report['model']))}" if report.get("model") else "",
    ]
    line = " · ".join(piece for piece in pieces if piece)
    return f"<header><h1>{escape(_name(report))}</h1><p>{line}</p></header>"


def _merit(name: str, value: str, note: str = "", mood: str = "") -> str:
    return (
        f'<div class="figure-of-merit {mood}"><div class="name">{name}</div>'
        f'<div class="value">{value}</div><div class="note">{note}</div></div>'
    )


def _headline(report: Report) -> str:
    result, sizing = _of(report, "result"), _of(report, "sizing")
    merits = []
    if result.get("mass_g") is not None:
        density = result.get("relative_density")
        note = "" if density is None else f"{tables.percent(density)} of the solid part"
        merits.append(_merit("Mass", f"{digits(result['mass_g'])} <small>g</small>", note))
    before, after = sizing.get("compliance_before_Nmm"), sizing.get("compliance_after_Nmm")
    if after is not None:
        note = ""
        if before:
            change = 100 * (after / before - 1)
            sign = "+" if change > 0 else "\N{MINUS SIGN}"
            note = f"{digits(before)} before sizing: {sign}{abs(change):.1f}&nbsp;%"
        merits.append(_merit("Compliance", f"{digits(after)} <small>N mm</small>", note))
    of_struts = sizing.get("max_utilisation")
    if of_struts is not None:
        of_skin = _of(report, "skin").get("max_utilisation")
        use, where = max((of_struts, "in the worst strut"), (of_skin or 0.0, "in the skin"))
        note = f"above yield, {where}" if use > 1 else f"of yield, {where}"
        merits.append(_merit("Utilisation", tables.percent(use), note, "bad" if use > 1 else ""))
    if _of(report, "structure").get("struts") is not None:
        structure = _of(report, "structure")
        note = f"{escape(str(structure.get('cell', '')))} cells"
        merits.append(_merit("Struts", tables.count(structure["struts"]), note))
    if "watertight" in result:
        faults = _faults(result)
        good = "one watertight body" if not faults else "; ".join(faults)
        value = "no" if faults else "yes"
        merits.append(_merit("Printable", value, good, "bad" if faults else "good"))
    return f'<div class="headline">{"".join(merits)}</div>' if merits else ""


def _faults(result: Report) -> list[str]:
    faults = [] if result["watertight"] else ["not watertight"]
    components = result.get("connected_components", 1)
    if components != 1:
        faults.append(f"{components} separate bodies")
    return faults


def _list(title: str, lines: Any, kind: str = "") -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{escape(str(line))}</li>" for line in lines)
    return f'<section class="{kind}"><h2>{title}</h2><ul>{items}</ul></section>'


def _warnings(report: Report) -> str:
    return _list("Warnings", report.get("warnings"), "warnings")


def _notes(report: Report) -> str:
    return _list("Notes", report.get("notes"))


def _inputs(report: Report, shown: _Figures) -> str:
    left = [
        table(_of(report, "part"), tables.PART),
        table(_of(report, "material"), tables.MATERIAL),
        table(_of(report, "tet_mesh"), tables.TET_MESH),
    ]
    return _section("Part, material and mesh", left, [shown.of("look")])


def _warp(report: Report, shown: _Figures, data: PlotData) -> str:
    warp = _of(report, "warp")
    energy, measures = _of(warp, "energy"), _of(warp, "measures")
    rows = tuple(
        Row(key, escape(key.replace("_", " ")), tables.quantity("", 3)) for key in measures
    )
    turned = energy.get("warped") is not None
    left = [
        table(warp, tables.WARP),
        _together(
            _titled("Cell sizes", table(warp, tables.WARP_SIZES)),
            _titled("End of the method", table(measures, rows)),
        ),
        _together(
            _titled("Angles", table(warp, tables.WARP_ANGLES)),
            _titled(
                "Strain energy of the cells, over that of cells not turned",
                table(energy, tables.WARP_ENERGY) if turned else "",
            ),
        ),
    ]
    figures = [shown.of("grid"), shown.of("size-error")]
    below = _plots(*_size_plots(data), *_turn_plots(data)) + _layers(data)
    return _section("Warp", left, figures, below)


def _size_plots(data: PlotData) -> list[tuple[str, str]]:
    if data.wanted_mm is None or data.achieved_mm is None or not data.wanted_mm.size:
        return []
    sizes = data.wanted_mm, data.achieved_mm
    return [
        (
            plots.size_agreement(*sizes),
            "Cell size: asked for, and what came out. Dashed: equal; solid: the fit.",
        ),
        (plots.size_ratios(*sizes), "Size that came out over the one asked for; dashed: equal."),
    ]


def _turn_plots(data: PlotData) -> list[tuple[str, str]]:
    if data.turns_deg is None or data.turn_weights is None or not data.turn_weights.any():
        return []
    if data.unturned_deg is None or data.unturned_weights is None:
        return []
    svg = plots.turns(
        (data.turns_deg, data.turn_weights), (data.unturned_deg, data.unturned_weights)
    )
    caption = (
        "Angle from cell axes to principal axes of the stress in their plane, weighted by how much "
        "the stress differs there over directions. Cells stiffest along their axes do best at 0°, "
        "those softest along them at 45°."
    )
    return [(svg, caption)]


def _layers(data: PlotData) -> str:
    """Layers of the grid side by side, on one scale of colours."""
    if not data.layers:
        return ""
    shown = np.concatenate([layer.values[layer.meets] for layer in data.layers])
    _, high, _ = colour_range(shown, middle=1.0)
    drawn = []
    for layer in data.layers:
        axis = ("first", "second", "third")[layer.axis]
        caption = (
            f"Layer of cells seen along the grid's {axis} axis, with the part's outline, coloured by "
            "achieved over wanted size; cells without colour miss the part."
        )
        drawn.append((plots.grid_layer(layer, half=high - 1), caption))
    return _plots(*drawn)


def _structure(report: Report, shown: _Figures, data: PlotData) -> str:
    cell = {"cells_mm": report["cells_mm"]} if "cells_mm" in report else {}
    left = [table({**cell, **_of(report, "structure")}, tables.STRUCTURE)]
    if data.lengths is not None and data.lengths.size:
        svg = plots.histogram(data.lengths, "strut length [mm]")
        left.append(_figure(svg, "Lengths of the struts between their joints."))
    angles, weights = data.strut_angles_deg, data.strut_weights
    if angles is not None and weights is not None and weights.any():
        caption = (
            "Angle of each strut to the direction of the numerically largest principal stress, "
            "weighted by its length and by how much that stress stands out."
        )
        left.append(_figure(plots.strut_angles(angles, weights), caption))
    return _section("Structure", left, [shown.of("radius"), shown.of("kinds")])


def _sizing(report: Report, shown: _Figures, data: PlotData) -> str:
    sizing = _of(report, "sizing")
    drawn: list[tuple[str, str]] = []
    history = _of(sizing, "history")
    if history.get("compliance"):
        drawn.append((plots.convergence(history), "Compliance over the sizing iterations."))
    if data.radii is not None and data.radii.size:
        drawn.append((plots.histogram(data.radii, "strut radius [mm]"), "Radii of the struts."))
    if data.utilisation is not None and data.utilisation.size:
        limit = 1.0 if data.utilisation.max() > 0.5 else None
        svg = plots.histogram(data.utilisation, "utilisation", limit=limit)
        drawn.append((svg, "Worst stress in each strut over the yield stress."))
    left = [
        table(sizing, tables.SIZING),
        _titled("Skin", table(_of(report, "skin"), tables.SKIN)),
        _titled("Joint model", table(_of(report, "joint_model"), tables.JOINT_MODEL)),
    ]
    return _section("Sizing", left, [shown.of("utilisation")], _plots(*drawn))


def _result(report: Report, shown: _Figures) -> str:
    left = [
        _titled("Result", table(_of(report, "result"), tables.RESULT)),
        _titled("Lattice alone", table(_of(report, "lattice"), tables.LATTICE)),
        _titled("Printability", table(_of(report, "printability"), tables.PRINTABILITY)),
    ]
    return _section("Result", left, [shown.of("cut"), shown.of("whole")])


def _titled(title: str, rows: str) -> str:
    return f"<div><h3>{title}</h3>{rows}</div>" if rows else ""


def _together(*pieces: str) -> str:
    """One column of several pieces."""
    pieces = tuple(piece for piece in pieces if piece)
    return f'<div class="stack">{"".join(pieces)}</div>' if pieces else ""


def _times(report: Report) -> str:
    seconds = dict(_of(report, "seconds"))
    total = seconds.pop("total", None)
    timed = {k: float(v) for k, v in seconds.items() if isinstance(v, int | float)}
    pieces = [] if total is None else [f"{digits(float(total), 3)} s in all"]
    if report.get("peak_memory_mb") is not None:
        pieces.append(f"{tables.count(report['peak_memory_mb'])} MB of memory at most")
    line = f"<p>{', '.join(pieces)}.</p>" if pieces else ""
    bars = _figure(plots.stage_times(timed), "Seconds per stage.") if timed else ""
    return _section("Time and memory", [], [], line + bars)


def _origin(report: Report) -> str:
    own = {"texmap-opt": report["version"]} if report.get("version") else {}
    versions = own | dict(_of(report, "versions") or _of(report, "platform"))
    rows = tuple(Row(key, escape(str(key)), tables.text) for key in versions)
    cited = "".join(f"<li>{escape(line)}</li>" for line in CITATIONS)
    raw = escape(json.dumps(report, indent=1, default=str))
    below = (
        f"<p>If these results help your work, please cite:</p><ul>{cited}</ul>"
        f"<details><summary>All numbers (report.json)</summary><pre>{raw}</pre></details>"
    )
    return _section("Versions and how to cite", [table(versions, rows)], [], below)
