"""The reference of all keys, docs/case.md, written from the code that reads them.

`python -m texmap_opt.case_reference > docs/case.md` writes it anew.
"""

import dataclasses
import sys
from dataclasses import MISSING

import fea
from texmap_opt.builtin_part import BUILTIN_PARTS
from texmap_opt.case import REPEATED
from texmap_opt.case_sections import SECTIONS, ImportedSection
from texmap_opt.region_table import REGION_KEYS

INTRODUCTION = """# The case file

Written from the code by `python -m texmap_opt.case_reference > docs/case.md`; a test keeps it true.
Lengths are mm, forces N, stresses MPa. Relative paths start at the case file's folder. An unknown key,
a wrong type or an impossible value ends the program with code 2 and one sentence.
"""


def case_reference() -> str:
    """The whole page as Markdown."""
    parts = [INTRODUCTION]
    titles = {name: f"[{name}]" for name in (*SECTIONS, "imported")} | {
        name: f"[[{name}]]" for name in REPEATED
    }
    sections = {**SECTIONS, **REPEATED, "imported": ImportedSection}
    order = [
        "part",
        "material",
        "analysis",
        "support",
        "load",
        "lattice",
        "zone",
        "opening",
        "drain",
        "warp",
        "paint",
        "imported",
        "sizing",
        "output",
    ]
    for name in order:
        section = sections[name]
        doc = (section.__doc__ or "").strip().split("`: ", 1)[-1].capitalize()
        parts.append(f"## `{titles[name]}`\n\n{doc}\n\n{_table(section)}\n")
    rows = "\n".join(f"| `{key}` | {doc} |" for key, doc in REGION_KEYS.items())
    parts.append(
        "## Regions\n\nA region is a table; with several keys all of them must hold.\n\n"
        f"| key | meaning |\n|---|---|\n{rows}\n"
    )
    built = "\n".join(
        f"| `{name}` | {part.description} | "
        + ", ".join(f"`{key}` {value:g}" for key, value in part.dimensions.items())
        + " |"
        for name, part in BUILTIN_PARTS.items()
    )
    parts.append(
        "## Built-in parts\n\nDimensions stand in `[part]` beside `builtin`.\n\n"
        f"| builtin | what | dimensions and defaults |\n|---|---|---|\n{built}\n"
    )
    parts.append(
        "## Named materials\n\n" + ", ".join(f"`{m}`" for m in fea.material_names()) + "\n"
    )
    return "\n".join(parts)


def _table(section: type) -> str:
    rows = []
    for declared in dataclasses.fields(section):
        if "kind" not in declared.metadata:
            continue
        kind, doc = declared.metadata["kind"], declared.metadata["doc"]
        default = declared.default
        shown = (
            "required" if default is MISSING else "" if default is None else f"`{_toml(default)}`"
        )
        later = f" *{declared.metadata['later']}*" if declared.metadata["later"] else ""
        rows.append(f"| `{declared.name}` | {kind.name} | {shown} | {doc}{later} |")
    return "| key | value | default | meaning |\n|---|---|---|---|\n" + "\n".join(rows)


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


if __name__ == "__main__":
    sys.stdout.write(case_reference())
