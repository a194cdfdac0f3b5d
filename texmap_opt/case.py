"""DesignCase: the whole input of a run, read from TOML and validated before anything is computed."""

import dataclasses
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from fea import Material
from texmap_opt.builtin_part import BUILTIN_PARTS
from texmap_opt.case_openings import (
    Drain,
    DrainSection,
    Opening,
    OpeningSection,
    drains,
    openings,
    require_skin,
)
from texmap_opt.case_sections import (
    SECTIONS,
    SURFACE_ACTIONS,
    TONNE_PER_MM3,
    AnalysisSection,
    ImportedSection,
    LatticeSection,
    LoadSection,
    OutputSection,
    PaintSection,
    PartSection,
    SupportSection,
    WarpSection,
)
from texmap_opt.case_sizing import SizingSection
from texmap_opt.case_table import number, read_section
from texmap_opt.case_warp import check_warp, painted_regions
from texmap_opt.case_zones import Zone, ZoneSection, zones
from texmap_opt.errors import CaseError, nearest_name
from texmap_opt.region import AbstractRegion
from texmap_opt.region_table import region_from_table
from texmap_opt.warping_function.painted import PaintedRegion

# Sections that may stand several times, written [[name]].
REPEATED = {
    "support": SupportSection,
    "load": LoadSection,
    "zone": ZoneSection,
    "opening": OpeningSection,
    "drain": DrainSection,
    "paint": PaintSection,
}
# Keys that name a file, relative to the case.
FILES = (("part", "file"), ("analysis", "mesh"), ("imported", "file"), ("imported", "values"))


@dataclass(frozen=True)
class Support:
    """A support with its region understood."""

    where: str
    region: AbstractRegion
    fix: tuple[str, ...]
    value_mm: tuple[float, float, float] | None


@dataclass(frozen=True)
class Load:
    """A load with its region understood; exactly the given actions are not None."""

    where: str
    case: str
    region: AbstractRegion | None
    force_N: tuple[float, float, float] | None
    pressure_MPa: float | None
    traction_MPa: tuple[float, float, float] | None
    moment_Nmm: tuple[float, float, float] | None
    gravity_m_s2: tuple[float, float, float] | None


@dataclass(frozen=True)
class DesignCase:
    """Everything a run depends on.

    Attributes:
        path: the case file.
        part, analysis, lattice, warp, sizing, output: the sections, defaults filled in.
        material: elastic constants and density in MPa and tonne/mm³.
        supports, loads, zones, openings, drains, paint: with their regions understood.
        imported: the result of another program that drives the warp; None: there is none.
        tables: the TOML tables that `to_toml` writes back.
    """

    path: Path
    part: PartSection
    material: Material
    analysis: AnalysisSection
    supports: tuple[Support, ...]
    loads: tuple[Load, ...]
    lattice: LatticeSection
    zones: tuple[Zone, ...]
    openings: tuple[Opening, ...]
    drains: tuple[Drain, ...]
    warp: WarpSection
    paint: tuple[PaintedRegion, ...]
    imported: ImportedSection | None
    sizing: SizingSection
    output: OutputSection
    tables: dict[str, Any]

    @property
    def load_cases(self) -> tuple[str, ...]:
        """Names of the load cases in the order of their first appearance."""
        return tuple(dict.fromkeys(load.case for load in self.loads))

    @property
    def input_files(self) -> tuple[Path, ...]:
        """Files that a run reads and that no output may replace."""
        cells = [self.lattice.cell, *(zone.cell for zone in self.zones)]
        named = [self.part.file, *(cell for cell in cells if cell.endswith(".xml"))]
        if self.imported is not None:
            named += [self.imported.file, self.imported.values]
        for name in ("support", "load", "zone", "opening", "paint"):
            named += [_region_file(entry.get("region")) for entry in self.tables.get(name, [])]
        return (self.path, *(self.directory / name for name in named if name))

    @property
    def directory(self) -> Path:
        """Folder that relative paths of the case refer to."""
        return self.path.resolve().parent

    @staticmethod
    def from_toml(
        path: str | Path, *, part_file: str | Path | None = None, warp_method: str | None = None
    ) -> "DesignCase":
        """Read and validate a case file.

        Args:
            path: the TOML file.
            part_file: replaces `[part] file`, relative to the working directory.
            warp_method: replaces `[warp] method`.

        Raises:
            CaseError: for anything that is missing, unknown or impossible.
        """
        path = Path(path)
        try:
            tables = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as failure:
            raise CaseError(
                f"{path}: cannot be read ({failure.strerror}); give the path of a case file, or "
                "write a starter with `texmap new DIR`."
            ) from failure
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as failure:
            raise CaseError(f"{path}: is not valid TOML: {failure}.") from failure
        if part_file is not None:
            given = _section(tables, "part", path.name)
            kept = {k: v for k, v in given.items() if k != "builtin" and not k.endswith("_mm")}
            tables["part"] = kept | {"file": str(Path(part_file).resolve())}
        if warp_method is not None:
            tables["warp"] = _section(tables, "warp", path.name) | {"method": warp_method}
        return DesignCase.from_tables(tables, path)

    @staticmethod
    def from_tables(tables: dict[str, Any], path: Path) -> "DesignCase":
        """Validate tables already read; `path` names the file in messages."""
        file = path.name
        known = {*SECTIONS, *REPEATED, "imported"}
        for name in tables:
            if name not in known:
                raise CaseError(f"{file}: [{name}] is not a section; {nearest_name(name, known)}")
        tables = _with_plate_default(tables)
        sections = {
            name: read_section(section, tables.get(name, {}), f"{file}: [{name}]")
            for name, section in SECTIONS.items()
            if name != "part"
        }
        case = DesignCase(
            path=path,
            part=_part_section(tables.get("part", {}), file),
            material=sections.pop("material").material(f"{file}: [material]"),
            supports=_supports(tables, file, path.resolve().parent),
            loads=_loads(tables, file, path.resolve().parent),
            zones=zones(_read_all(tables, "zone", file), file, path.resolve().parent),
            openings=openings(_read_all(tables, "opening", file), file, path.resolve().parent),
            drains=drains(_read_all(tables, "drain", file), file),
            paint=painted_regions(_read_all(tables, "paint", file), file, path.resolve().parent),
            imported=_imported(tables, file),
            tables=tables,
            **sections,
        )
        _check_together(case, file)
        return case

    def to_toml(self) -> str:
        """The case as TOML, all defaults filled in, paths absolute."""
        material = self.material
        tables: dict[str, Any] = {
            "part": _known(self.part) | self._dimensions(),
            "material": {
                "name": material.name,
                "E_MPa": material.E,
                "nu": material.nu,
                "density_g_cm3": material.density / TONNE_PER_MM3,
            },
            "analysis": _known(self.analysis),
        }
        if material.yield_stress is not None:
            tables["material"]["yield_MPa"] = material.yield_stress
        for name in ("lattice", "warp", "sizing", "output"):
            tables[name] = _known(getattr(self, name))
        for name in [name for name in REPEATED if self.tables.get(name)]:
            tables[name] = [_known(section) for section in _read_all(self.tables, name)]
        if self.imported is not None:
            tables["imported"] = _known(self.imported)
        self._anchor(tables)
        return tomli_w.dumps(tables)

    def _dimensions(self) -> dict[str, float]:
        """Dimensions of a built-in part, defaults filled in."""
        recipe = BUILTIN_PARTS.get(self.part.builtin or "")
        return (
            self.part.dimensions
            if recipe is None
            else {**recipe.dimensions, **self.part.dimensions}
        )

    def _anchor(self, tables: dict[str, Any]) -> None:
        """Make the paths of files absolute."""
        for section, entry in FILES:
            if entry in tables.get(section, {}):
                tables[section][entry] = str((self.directory / tables[section][entry]).resolve())
        for table in (tables["lattice"], *tables.get("zone", [])):
            cell = self.directory / table["cell"]
            if cell.suffix.lower() == ".xml":
                table["cell"] = str(cell.resolve())
        for name in REPEATED:
            for action in tables.get(name, []):
                self._anchor_region(action.get("region", {}))

    def _anchor_region(self, region: dict[str, Any]) -> None:
        """Make the path of a region's file absolute."""
        stl = region.get("stl")
        if isinstance(stl, str):
            region["stl"] = str((self.directory / stl).resolve())
        elif isinstance(stl, dict):
            region["stl"] = stl | {"file": str((self.directory / stl["file"]).resolve())}


def _region_file(region: Any) -> str | None:
    """The file that a region's table names, relative to the case; None without one."""
    stl = region.get("stl") if isinstance(region, dict) else None
    return stl.get("file") if isinstance(stl, dict) else stl


def _section(tables: dict[str, Any], name: str, file: str) -> dict[str, Any]:
    section = tables.get(name, {})
    if not isinstance(section, dict):
        raise CaseError(f"{file}: [{name}] = {section!r}: must be a table of keys.")
    return section


def _with_plate_default(tables: dict[str, Any]) -> dict[str, Any]:
    """Sizing is "none" where the case leaves it open and the lattice is a void."""
    lattice, sizing = tables.get("lattice", {}), tables.get("sizing", {})
    voids = isinstance(lattice, dict) and lattice.get("kind") == "plate"
    if voids and isinstance(sizing, dict) and "method" not in sizing:
        return tables | {"sizing": {"method": "none"} | sizing}
    return tables


def _known(section: Any) -> dict[str, Any]:
    """A section's declared keys that have a value, as TOML can hold them."""
    values = {}
    for declared in dataclasses.fields(section):
        value = getattr(section, declared.name)
        if "kind" in declared.metadata and value is not None:
            values[declared.name] = list(value) if isinstance(value, tuple) else value
    return values


def _part_section(table: Any, file: str) -> PartSection:
    where = f"{file}: [part]"
    dimensions = {}
    if isinstance(table, dict) and "builtin" in table:
        dimension = number(above=0.0)
        for name in [name for name in table if name.endswith("_mm")]:
            try:
                dimensions[name] = dimension.read(table[name])
            except ValueError as failure:
                raise CaseError(f"{where} {name} = {table[name]!r}: {failure}") from failure
    part = read_section(PartSection, table, where, extra=frozenset(dimensions))
    if (part.file is None) == (part.builtin is None):
        raise CaseError(f"{where}: give either file or builtin.")
    return dataclasses.replace(part, dimensions=dimensions)


def _read_all(tables: dict[str, Any], name: str, file: str = "case") -> list:
    entries = tables.get(name, [])
    if not isinstance(entries, list):
        raise CaseError(f"{file}: [{name}] must be written [[{name}]], once for each.")
    return [
        read_section(REPEATED[name], entry, f"{file}: [[{name}]] {i}")
        for i, entry in enumerate(entries, start=1)
    ]


def _supports(tables: dict[str, Any], file: str, base: Path) -> tuple[Support, ...]:
    sections = _read_all(tables, "support", file)
    if not sections:
        raise CaseError(
            f"{file}: has no [[support]]: the part would fly away; add one with a region and "
            'fix = ["x", "y", "z"].'
        )
    supports = []
    for i, section in enumerate(sections, start=1):
        where = f"{file}: [[support]] {i}"
        region = region_from_table(section.region, f"{where} region", base)
        value = section.value_mm or (0.0, 0.0, 0.0)
        for axis, component in zip("xyz", value, strict=True):
            if component and axis not in section.fix:
                raise CaseError(
                    f"{where} value_mm = {list(value)}: moves {axis}, which is not in fix = "
                    f"{list(section.fix)}; add it there or give 0."
                )
        supports.append(Support(where, region, section.fix, section.value_mm))
    return tuple(supports)


def _loads(tables: dict[str, Any], file: str, base: Path) -> tuple[Load, ...]:
    sections = _read_all(tables, "load", file)
    if not sections:
        raise CaseError(f"{file}: has no [[load]]: add one with a region and force_N.")
    loads = []
    for i, section in enumerate(sections, start=1):
        where = f"{file}: [[load]] {i}"
        values = {name: getattr(section, name) for name in (*SURFACE_ACTIONS, "gravity_m_s2")}
        given = {name: value for name, value in values.items() if value is not None}
        if not given:
            raise CaseError(
                f"{where}: does nothing; give {', '.join(SURFACE_ACTIONS)} or gravity_m_s2."
            )
        for name, value in given.items():
            if not any(value if isinstance(value, tuple) else (value,)):
                raise CaseError(f"{where} {name} = {value}: is zero; give a value or remove it.")
        on_surface = any(name in given for name in SURFACE_ACTIONS)
        if on_surface and section.region is None:
            raise CaseError(f"{where} region is missing: say where the load acts.")
        if not on_surface and section.region is not None:
            raise CaseError(f"{where} region: gravity acts on the whole part; remove the region.")
        region = None
        if section.region is not None:
            region = region_from_table(section.region, f"{where} region", base)
        loads.append(Load(where=where, case=section.case, region=region, **values))
    return tuple(loads)


def _imported(tables: dict[str, Any], file: str) -> ImportedSection | None:
    if "imported" not in tables:
        return None
    return read_section(ImportedSection, tables["imported"], f"{file}: [imported]")


def _check_together(case: DesignCase, file: str) -> None:
    """Limits that involve more than one key."""
    lattice, sizing, analysis = case.lattice, case.sizing, case.analysis
    if analysis.mesh is not None and analysis.max_error is not None:
        raise CaseError(
            f"{file}: [analysis] max_error = {analysis.max_error:g}: the tets of mesh = "
            f"{analysis.mesh!r} are taken as they are; give one of them."
        )
    require_skin((*case.openings, *case.drains), lattice.skin_mm)
    for a, b in (("cells", "cell_mm"), ("radius_mm", "relative_density")):
        if (getattr(lattice, a) is None) == (getattr(lattice, b) is None):
            raise CaseError(f"{file}: [lattice]: give either {a} or {b}.")
    if lattice.relative_density is not None and sizing.volume_fraction is not None:
        raise CaseError(
            f"{file}: [sizing] volume_fraction = {sizing.volume_fraction:g}: contradicts [lattice] "
            f"relative_density = {lattice.relative_density:g}; give one of them."
        )
    check_warp(
        case.warp, file, load_cases=case.load_cases, paint=case.paint, imported=case.imported
    )
    if lattice.kind == "plate" and case.warp.alignment > 0 and case.warp.target == "energy":
        raise CaseError(
            f'{file}: [warp] target = "energy": the struts of kind = "plate" are holes and carry '
            'nothing, so no orientation of theirs is the stiffest; give target = "axes" or '
            "alignment = 0."
        )
    if lattice.kind == "plate" and sizing.method != "none":
        raise CaseError(
            f'{file}: [sizing] method = "{sizing.method}": the struts of kind = "plate" are '
            'holes and carry nothing; give "none".'
        )
    low, high = sizing.min_radius_mm, sizing.max_radius_mm
    if low is not None and high is not None and low > high:
        raise CaseError(
            f"{file}: [sizing] min_radius_mm = {low:g}: is above max_radius_mm = {high:g}; swap them."
        )
