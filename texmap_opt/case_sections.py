"""The sections of a case file: every key with its kind, default and meaning."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import fea
from fea import FeaError, Material
from texmap_opt.case_sizing import SizingSection
from texmap_opt.case_table import (
    choice,
    choices,
    directions,
    key,
    number,
    number_by_name,
    numbers,
    table,
    text,
    vector,
    whole,
    yes_no,
)
from texmap_opt.errors import CaseError

# tonne/mm³ in one g/cm³.
TONNE_PER_MM3 = 1e-9


@dataclass(frozen=True)
class PartSection:
    """`[part]`: the surface to fill."""

    file: str | None = key(
        text(), "STL, OBJ, PLY or 3MF file, relative to the case file", default=None
    )
    builtin: str | None = key(
        text(), "a built-in parametric part instead of a file, with its dimensions", default=None
    )
    unit: str = key(choice("mm", "cm", "m", "in"), "unit of the file's coordinates", default="mm")
    solid: int | None = key(
        whole(least=1),
        "which solid to take when the file holds several (1: the largest)",
        default=None,
    )
    dimensions: dict[str, float] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class MaterialSection:
    """`[material]`: a named material, or its constants, or a named one with constants replaced."""

    name: str | None = key(text(), "a material of the table in `fea.materials`", default=None)
    E_MPa: float | None = key(number(above=0.0), "Young's modulus", default=None)
    nu: float | None = key(number(above=-1.0, most=0.499), "Poisson's ratio", default=None)
    density_g_cm3: float | None = key(number(above=0.0), "density of the solid", default=None)
    yield_MPa: float | None = key(number(above=0.0), "yield stress", default=None)

    def material(self, where: str) -> Material:
        """The material meant.

        Raises:
            CaseError: for an unknown name or missing constants.
        """
        named = None
        missing = [k for k in ("E_MPa", "nu", "density_g_cm3") if getattr(self, k) is None]
        # A name of one's own needs all constants; with fewer it must be in the table.
        if self.name is not None and missing:
            try:
                named = fea.material(self.name)
            except FeaError as failure:
                raise CaseError(f"{where} name: {failure}") from failure
        if named is None and missing:
            raise CaseError(
                f"{where} {missing[0]} is missing: give a material's name, or E_MPa, nu and "
                "density_g_cm3."
            )
        density = None if self.density_g_cm3 is None else self.density_g_cm3 * TONNE_PER_MM3
        given = {"E": self.E_MPa, "nu": self.nu, "density": density, "yield_stress": self.yield_MPa}
        given = {k: v for k, v in given.items() if v is not None}
        if named is not None:
            return dataclasses.replace(named, **given)
        return Material(name=self.name or "custom", **{"yield_stress": None, **given})  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class AnalysisSection:
    """`[analysis]`: the tet mesh and its elements."""

    element: str = key(choice("tet4", "tet10"), "element of the stress analysis", default="tet10")
    edge_mm: float | None = key(
        number(above=0.0), "target edge of the tets (absent: a 25th of the diagonal)", default=None
    )
    mesh: str | None = key(
        text(),
        "take the tets of an earlier run's `stress.vtu` instead of meshing anew; the mesher is not "
        "repeatable, everything after it is",
        default=None,
    )
    max_error: float | None = key(
        number(above=0.0, most=0.5),
        "refine the tets until the estimated error of the stress, a share of its energy norm, is at "
        "most this in every load case (absent: one mesh of `edge_mm`)",
        default=None,
    )
    joint_model: bool = key(
        yes_no(),
        "stiffen the joints of the lattice's frame as fitted to solids, where the unit cell has such a "
        "model (docs/joint-model.md) and struts are round; false: beams from joint to joint",
        default=True,
    )


@dataclass(frozen=True)
class SupportSection:
    """`[[support]]`: where the part is held."""

    region: dict = key(table(), "where: see Regions")
    fix: tuple[str, ...] = key(choices("x", "y", "z"), "directions held", default=("x", "y", "z"))
    value_mm: tuple[float, float, float] | None = key(
        vector(number()), "prescribed displacement of the held directions", default=None
    )


@dataclass(frozen=True)
class LoadSection:
    """`[[load]]`: one action; loads with the same `case` act together."""

    case: str = key(text(), "name of the load case", default="load")
    region: dict | None = key(table(), "where: see Regions; not for gravity", default=None)
    force_N: tuple[float, float, float] | None = key(
        vector(number()), "resultant, spread evenly over the region", default=None
    )
    pressure_MPa: float | None = key(number(), "pressure, positive into the part", default=None)
    traction_MPa: tuple[float, float, float] | None = key(
        vector(number()), "force per area", default=None
    )
    moment_Nmm: tuple[float, float, float] | None = key(
        vector(number()), "moment about the region's centroid", default=None
    )
    gravity_m_s2: tuple[float, float, float] | None = key(
        vector(number()), "acceleration of the whole part, such as [0, 0, -9.81]", default=None
    )


SURFACE_ACTIONS = ("force_N", "pressure_MPa", "traction_MPa", "moment_Nmm")


@dataclass(frozen=True)
class LatticeSection:
    """`[lattice]`: unit cell, cell count, kind and radius."""

    cell: str = key(
        text(), "a name of `texmap cells`, or a path to a unit-cell XML", default="octet"
    )
    cells: tuple[int, ...] | None = key(
        vector(whole(least=1), or_two=True),
        "cells over the part's bounding box along x, y, z; two numbers for an extruded (2.5-D) cell, "
        "along the two axes across the extrusion in alphabetical order",
        default=None,
    )
    cell_mm: float | None = key(
        number(above=0.0),
        "cell edge, instead of `cells`; of a cell with `proportions` its first edge",
        default=None,
    )
    extrusion: str | None = key(
        choice("x", "y", "z"),
        "axis of the box along which a 2.5-D cell is extruded; the cell's own x then lies along y, z, x "
        "(absent: z)",
        default=None,
    )
    kind: str = key(
        choice("rod", "plate"),
        "rod: skin + (S and M); plate: the lattice is the void",
        default="rod",
    )
    skin_mm: float = key(number(least=0.0), "thickness of the skin; 0: none", default=1.0)
    radius_mm: float | None = key(number(above=0.0), "strut radius before sizing", default=None)
    relative_density: float | None = key(
        number(above=0.0, most=0.9),
        "instead of radius_mm: volume of (S and M), measured on the mesh, over the part's",
        default=None,
    )
    radius_mode: str = key(
        choice("constant", "scaled"),
        "scaled: the radius follows the size of the warped cell",
        default="constant",
    )
    sliver_share: float = key(
        number(least=0.0, most=0.5),
        "struts cut shorter than this share of their cell's edge are left out where both ends reach the "
        "surface anyway",
        default=0.05,
    )
    section: str | None = key(
        choice("round", "square"),
        "section of the struts of a 3-D cell (absent: the cell's own)",
        default=None,
    )
    fillet_mm: float = key(
        number(least=0.0),
        "fillet radius at joints; smaller where struts leave no room",
        default=0.0,
    )


# Drivers that read the part's own stress, and so know a tensor that can turn cells.
STRESS_DRIVERS = ("von-mises", "strain-energy", "principal")


@dataclass(frozen=True)
class WarpSection:
    """`[warp]`: how the grid of cells follows the stress."""

    method: str = key(
        choice("uniform", "best-uniform", "successive-approximation", "least-squares", "optimised"),
        "how the grid is warped",
        default="least-squares",
        later='"best-uniform" and "optimised" are not offered yet; give another.',
        not_yet=("best-uniform", "optimised"),
    )
    driver: tuple[str, ...] = key(
        choices(*STRESS_DRIVERS, "file", "paint"),
        "what the warping function f is made from: a measure of the part's own stress (principal: the "
        "largest in size), a result of another program ([imported]), regions ([[paint]]); several "
        "combine",
        default=("von-mises",),
    )
    combine: str = key(
        choice("product", "maximum", "sum"),
        "how several drivers become one f, each over its own mean",
        default="product",
    )
    driver_weights: tuple[float, ...] | None = key(
        numbers(number(above=0.0)),
        "one for each driver: its power in a product, its factor otherwise (absent: 1)",
        default=None,
    )
    load_cases: str = key(
        choice("worst", "sum"),
        "f of several load cases: the worst at each place, or their sum",
        default="worst",
    )
    case_weights: dict[str, float] | None = key(
        number_by_name(number(least=0.0)),
        "load case = factor on its stress (1 for those not named)",
        default=None,
    )
    exponent: float = key(number(above=0.0, most=4.0), "wanted size ~ f^-exponent", default=1.0)
    contrast: float = key(
        number(least=1.0, most=10.0),
        "bound on the largest over the smallest wanted cell size",
        default=3.0,
    )
    smoothing_cells: float = key(
        number(least=0.5, most=10.0),
        "standard deviation of the smoothing of f, in edges of a uniform cell; paint fades over 4.7 "
        "of these",
        default=1.0,
    )
    alignment: float = key(
        number(least=0.0),
        "weight of turning cells by the stress; 0: none turn; try 30, then 100 (least-squares)",
        default=0.0,
    )
    target: str = key(
        choice("energy", "axes"),
        "what alignment aims at, so nothing while that is 0; energy: the way the unit cell is "
        "stiffest; axes: cell axes along the principal stresses",
        default="energy",
    )
    margin_cells: int = key(whole(least=0), "cells added around the part on every side", default=1)
    axes: str | tuple = key(
        directions("part", "principal"),
        "edges of the box of cells; part: x, y, z; principal: the part's principal axes of inertia, "
        "the longest first; or three vectors at right angles, such as [[0.8, 0.6, 0], [-0.6, 0.8, 0], "
        "[0, 0, 1]]",
        default="part",
    )
    fixed_faces: tuple[str, ...] = key(
        choices("-x", "+x", "-y", "+y", "-z", "+z", least=0),
        "faces of the box, named along its axes, whose nodes stay; those of the others slide in them",
        default=(),
    )
    conform: float = key(
        number(least=0.0),
        "weight of making nodes near the part's surface follow it; 0: they need not (least-squares)",
        default=0.0,
    )
    weights: Literal["printed", "midpoint"] = key(
        choice("printed", "midpoint"),
        "f at neighbouring nodes, as the paper prints it, or half way to them, as its text promises "
        "(successive-approximation)",
        default="printed",
    )
    relaxation: float = key(
        number(above=0.0, most=1.0),
        "part of each movement that is made (successive-approximation)",
        default=1.0,
    )
    eps: float = key(
        number(above=0.0, most=0.1),
        "movement to stop at, in edges of a uniform cell (successive-approximation)",
        default=1e-6,
    )
    max_sweeps: int = key(
        whole(least=1), "when to give up (successive-approximation)", default=20_000
    )
    size_weight: float = key(
        number(above=0.0),
        "weight of the cells' size against their shape (least-squares)",
        default=10.0,
    )
    max_steps: int = key(
        whole(least=1), "trial grids after which to give up (least-squares)", default=1000
    )
    tolerance: float = key(
        number(above=0.0, most=0.1),
        "gain of another step, relative to the objective, to stop at (least-squares)",
        default=1e-4,
    )


@dataclass(frozen=True)
class PaintSection:
    """`[[paint]]`: a region where the designer asks for smaller or larger cells."""

    region: dict = key(table(), "where: see Regions; in space, so not `normal`")
    value: float = key(
        number(above=0.0),
        "f in the region; 1 elsewhere, so 2 asks for cells half as large at exponent 1; the ratio asked "
        "for never exceeds `contrast`",
    )
    falloff_mm: float = key(
        number(least=0.0),
        "distance over which f falls to 1 outside the region (at least 4.7 times the smoothing)",
        default=0.0,
    )


@dataclass(frozen=True)
class ImportedSection:
    """`[imported]`: a result of another program as the driver "file"."""

    file: str = key(
        text(), "VTU, VTK, MSH, XDMF, CSV with columns x, y, z, or INP mesh with a CSV of `values`"
    )
    field: str = key(
        text(),
        "name of a positive scalar or of a stress tensor in it; in a CSV the column's, or what the "
        "tensor's columns begin with",
    )
    values: str | None = key(
        text(),
        "CSV of an INP mesh's values, by the numbers in its column node or element",
        default=None,
    )
    unit: str = key(choice("mm", "cm", "m", "in"), "unit of the file's coordinates", default="mm")
    order: str | None = key(
        choice("vtk", "abaqus", "voigt"),
        "of a tensor's six components where the file does not name them; vtk: xx, yy, zz, xy, yz, xz; "
        "abaqus: 11, 22, 33, 12, 13, 23; voigt: xx, yy, zz, yz, xz, xy (absent: abaqus for INP, else "
        "vtk)",
        default=None,
    )


@dataclass(frozen=True)
class OutputSection:
    """`[output]`: accuracy of the geometry, and pictures."""

    tolerance_mm: float = key(
        number(above=0.0), "bound on offset, shell and boolean error", default=0.05
    )
    pictures: bool = key(yes_no(), "draw the report's pictures", default=True)


SECTIONS: dict[str, type] = {
    "part": PartSection,
    "material": MaterialSection,
    "analysis": AnalysisSection,
    "lattice": LatticeSection,
    "warp": WarpSection,
    "sizing": SizingSection,
    "output": OutputSection,
}
