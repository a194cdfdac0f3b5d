"""The driver from a file: results of another program, on its own mesh."""

from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from fea.mesh_files import RESULT_SUFFIXES
from fea.voigt import vector, von_mises
from texmap_opt.errors import CaseError, nearest_name
from texmap_opt.units import MM_PER_UNIT
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.driven_field import DrivenField
from texmap_opt.warping_function.normalised_convolution import deposit, normalised_convolution
from texmap_opt.warping_function.result_field import (
    ResultField,
    field_of_inp,
    field_of_mesh,
    field_of_points,
)
from texmap_opt.warping_function.stress_driver import Measure, StressSamples, stress_driver

# Where xx, yy, zz, yz, xz, xy stand among six components without names. "vtk": XX, YY, ZZ, XY, YZ, XZ,
# of ParaView and of CalculiX's .frd (CrunchiX manual 2.21, section 11); "abaqus": 11, 22, 33, 12, 13,
# 23, of Abaqus and of CalculiX's .dat; "voigt": the textbook's and this program's own.
ORDERS = {
    "vtk": (0, 1, 2, 4, 5, 3),
    "abaqus": (0, 1, 2, 5, 4, 3),
    "voigt": (0, 1, 2, 3, 4, 5),
}

# The two halves of a tensor given in full may differ by this part of its norm, the rounding of single
# precision; what differs more is no stress.
ASYMMETRY = 1e-4

# A place of the part has results when one of their points is this near, in diagonals of the part's
# box, or as near as their own spacing lets it be: far above what two meshes of one part differ by, far
# below a wrong unit or position.
REACH = 0.05

# Share of the part that may have none: rounded edges, a coarser surface.
UNCOVERED_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class ImportedField:
    """A scalar or a stress at scattered points.

    Attributes:
        points: positions in space [mm].
        volumes: volume each point stands for, in any unit.
        values: one column: a scalar f > 0; six: a stress in the Voigt order of `fea`.
        reach_mm: how far a place of the body can be from the nearest of the points [mm].
        name: of the field and its file, for messages.
        unit: that of the file's coordinates, for messages.
        where: file and section of the case, for messages.
    """

    points: Float[np.ndarray, "samples 3"]
    volumes: Float[np.ndarray, " samples"]
    values: Float[np.ndarray, "samples _"]
    reach_mm: float
    name: str
    unit: str
    where: str

    @property
    def is_stress(self) -> bool:
        """Whether it can turn cells."""
        return self.values.shape[1] == 6


def read_imported(
    path: Path, *, field: str, values: Path | None, unit: str, order: str | None, where: str
) -> ImportedField:
    """A field of results, to drive a warp with.

    Read are VTU, VTK, Gmsh (MSH) and XDMF files, CSV files with columns x, y, z, and INP meshes with
    a CSV of values that has a column "node" or "element" of their numbers. Values at nodes and in
    cells count by the volume that they stand for. A tensor has nine components, row by row, or six;
    in a CSV it is spelt by columns whose names begin with the field's, such as S11 or "S:XX" for S.

    Args:
        path: the results, or the INP mesh they belong to.
        field: name of the scalar or stress tensor.
        values: the CSV of an INP mesh; None for all other files.
        unit: of the coordinates, one of `MM_PER_UNIT`; that of the field does not matter, since only
            ratios do.
        order: of six components whose names the file does not tell, one of `ORDERS`; None: "abaqus"
            for an INP mesh, otherwise "vtk".
        where: file and section of the case, for messages, such as "case.toml: [imported]".

    Raises:
        CaseError: a file that cannot be read; no such field (with those there are); another number of
            components than 1, 6 or 9; values that are not finite, or, of a scalar, not positive; a
            stress that is zero everywhere.
    """
    suffix = path.suffix.lower()
    if unit not in MM_PER_UNIT:
        raise CaseError(f'{where} unit = "{unit}": {nearest_name(unit, MM_PER_UNIT)}')
    if order is None:
        order = "abaqus" if suffix == ".inp" else "vtk"
    if order not in ORDERS:
        raise CaseError(f'{where} order = "{order}": {nearest_name(order, ORDERS)}')
    if suffix not in (*RESULT_SUFFIXES, ".csv", ".inp"):
        raise CaseError(
            f"{where}: results are read from {', '.join(RESULT_SUFFIXES)}, .csv and .inp, not from "
            f'"{path.name}"; convert it, for instance with ParaView.'
        )
    if not path.is_file():
        raise CaseError(f"{where}: {path} is not a file; check the path.")
    if (suffix == ".inp") != (values is not None):
        raise CaseError(
            f"{where} values: {path.name} is a mesh without values; name the CSV that holds them."
            if values is None
            else f"{where} values: {path.name} holds its values itself; a CSV of values goes with an "
            "INP mesh only, so remove the key."
        )
    if suffix == ".csv":
        found = field_of_points(path, field, where)
    elif values is not None:
        found = field_of_inp(path, values, field, where)
    else:
        found = field_of_mesh(path, field, where)
    name = f'"{field}" of {(values or path).name}'
    kept = _usable(found, order, name, where)
    mm = MM_PER_UNIT[unit]
    return ImportedField(
        mm * found.points, found.volumes, kept, mm * found.reach, name, unit, where
    )


def imported_driver(
    imported: ImportedField,
    grid: BackgroundGrid,
    *,
    smoothing_mm: float,
    part_points: Float[np.ndarray, "points 3"],
    measure: Measure = von_mises,
) -> DrivenField:
    """The field of imported results: a stress as `stress_driver` makes it, of a scalar its logarithm.

    A scalar is smoothed and extended like the measure of a stress (`normalised_convolution`), and
    leaves nothing to turn cells by. Results beyond the background grid, such as those of other parts
    of an assembly, are left out.

    Args:
        imported: what was read.
        grid: the background grid.
        smoothing_mm: standard deviation of the Gaussian [mm].
        part_points: points all over the part, such as the nodes of its mesh [mm].
        measure: scalar of a stress; not used for a scalar.

    Raises:
        CaseError: if the results do not cover the part, or are a stress of zero all over it.
        WarpError: if the measure of the stress is zero everywhere.
    """
    _require_cover(imported, part_points)
    near = _within(grid, imported.points)
    points, volumes, values = (
        imported.points[near], imported.volumes[near], imported.values[near],
    )  # fmt: skip
    if imported.is_stress:
        _require_stress(values, imported.name, imported.where)
        samples = StressSamples(points, volumes, values[None])
        return stress_driver(samples, grid, smoothing_mm=smoothing_mm, measure=measure)
    at = grid.box.coordinates(points)
    smooth = normalised_convolution(grid, at, volumes, np.log(values), smoothing_mm=smoothing_mm)
    importance = deposit(grid, at, volumes)
    return DrivenField(smooth[..., 0], importance, jnp.zeros((*grid.shape, 0)))


def _usable(
    found: ResultField, order: str, name: str, where: str
) -> Float[np.ndarray, "samples _"]:
    """The values as a positive scalar or a stress in the Voigt order of `fea`."""
    values, components = found.values, found.values.shape[1]
    if not len(values):
        raise CaseError(f"{where}: {name} has no values where its mesh has cells; export both.")
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        raise CaseError(
            f"{where}: {name} is not a finite number at {int(bad.sum())} of {bad.size} points; export "
            "it again, or only the elements that have results."
        )
    if components == 1:
        bad = np.asarray(values[:, 0] <= 0)
        if bad.any():
            raise CaseError(
                f"{where}: {name} is not positive at {int(bad.sum())} of {len(bad)} points, the least "
                f"being {values.min():g}, but drives the size of cells by its logarithm; give a "
                "positive field, or the stress tensor."
            )
        return values
    if components == 9:
        tensors = values.reshape(-1, 3, 3)
        skew = np.abs(tensors - np.swapaxes(tensors, 1, 2)).max()
        if skew > ASYMMETRY * np.abs(tensors).max():
            raise CaseError(
                f"{where}: {name} is a tensor whose halves differ by up to {skew:.3g}, so no stress; "
                "give the stress."
            )
        values = vector(tensors)
    elif components != 6:
        raise CaseError(
            f"{where}: {name} has {components} components; give a scalar, or a stress with 6 or 9."
        )
    elif not found.labelled:
        values = values[:, ORDERS[order]]
    _require_stress(values, name, where)
    return values


def _require_stress(values: Float[np.ndarray, "samples 6"], name: str, where: str) -> None:
    if not values.any():
        raise CaseError(
            f"{where}: {name} is zero at all {len(values)} points, so it drives nothing; export the "
            "results of a step in which the part is loaded, or take another field."
        )


def _within(
    grid: BackgroundGrid, points: Float[np.ndarray, "samples 3"]
) -> Bool[np.ndarray, " samples"]:
    """Which points lie within the nodes of the grid; along an extrusion, within the box."""
    at = grid.box.coordinates(points)
    last = grid.origin + grid.spacing * (np.array(grid.shape) - 1)
    within = np.all((at >= grid.origin) & (at <= last), axis=1)
    if grid.box.dimensions == 2:
        low, high = grid.box.bounds[:, 2]
        along, slack = points @ grid.box.axes[2], 1e-6 * (high - low)
        within &= (along >= low - slack) & (along <= high + slack)
    return within


def _require_cover(imported: ImportedField, part_points: Float[np.ndarray, "points 3"]) -> None:
    low, high = part_points.min(axis=0), part_points.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    reach = max(REACH * diagonal, imported.reach_mm)
    away, _ = KDTree(imported.points).query(part_points)
    share = float(np.mean(away > reach))
    if share <= UNCOVERED_SHARE:
        return
    its_low, its_high = imported.points.min(axis=0), imported.points.max(axis=0)
    factor = diagonal / max(float(np.linalg.norm(its_high - its_low)), 1e-300)
    # The unit that would make the two as large as each other.
    scale = {name: mm / MM_PER_UNIT[imported.unit] for name, mm in MM_PER_UNIT.items()}
    fitting = min(scale, key=lambda name: abs(np.log(scale[name] / factor)))
    remedy = (
        "give the results of this part, at the same place."
        if fitting == imported.unit
        else f'is its unit "{fitting}" instead of "{imported.unit}"?'
    )
    raise CaseError(
        f"{imported.where}: {imported.name} does not cover the part: {100 * share:.0f} % of it is more "
        f"than {reach:.3g} mm from any result; these span {_span(its_low, its_high)}, the part "
        f"{_span(low, high)}; {remedy}"
    )


def _span(low: Float[np.ndarray, " 3"], high: Float[np.ndarray, " 3"]) -> str:
    corners = ["(" + ", ".join(f"{x:.4g}" for x in corner) + ")" for corner in (low, high)]
    return f"{corners[0]} to {corners[1]} mm"
