"""A named field of another program's results: where it is known, and how much each place counts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from fea.errors import FeaError
from fea.inp_mesh import read_inp
from fea.mesh_files import read_results
from fea.result_mesh import ResultMesh
from texmap_opt.errors import CaseError
from texmap_opt.warping_function.csv_table import CsvTable, read_csv

# No point of a convex body of diameter D is farther than this times D from its centroid: d / (d + 1)
# for d = 3 (Minkowski; Bonnesen, Fenchel, Theorie der konvexen Körper, 1934, section 34); the nearest
# corner of a polytope is nearer.
WITHIN_CELL = 0.75

# Points without a mesh count by the cube of the distance to the neighbour of this rank, the room they
# have (Loftsgaarden, Quesenberry, Annals of Mathematical Statistics 36 (1965) 1049-1051). A lower rank
# follows chance, a higher one blurs the density.
DENSITY_NEIGHBOURS = 8

# Names that programs give to coordinates (ParaView, Ansys) and to numbers of nodes and elements.
COORDINATE_NAMES = ("{axis}", "points:{n}", "points_{n}", "{axis} location", "{axis} coordinate")
NUMBER_NAMES = ("{}", "{} id", "{}_id", "{}id", "{} number", "{} label")


@dataclass(frozen=True, eq=False)
class ResultField:
    """Values at scattered points, as in the file.

    Attributes:
        points: positions, in the file's unit.
        volumes: volume each point stands for; of sheets area, of bars length.
        values: components of the field.
        labelled: whether the file names the components; they then are in the Voigt order of `fea`.
        reach: how far a place of the body can be from the nearest of the points, in the file's unit.
    """

    points: Float[np.ndarray, "samples 3"]
    volumes: Float[np.ndarray, " samples"]
    values: Float[np.ndarray, "samples _"]
    labelled: bool
    reach: float


def field_of_mesh(path: Path, field: str, where: str) -> ResultField:
    """A field of a VTU, VTK, MSH or XDMF file; that of the nodes if the cells have one of its name too.

    Raises:
        CaseError: the file cannot be read, or has no such field.
    """
    try:
        mesh = read_results(path)
    except FeaError as failure:
        raise CaseError(f"{where}: {failure}") from failure
    if field in mesh.point_data:
        return _at_nodes(mesh, mesh.point_data[field], labelled=False)
    if field in mesh.cell_data:
        values = mesh.cell_data[field]
        return _at_cells(mesh, np.arange(len(values)), values, labelled=False)
    at_nodes = [_named(name, v.shape[1], " at nodes") for name, v in mesh.point_data.items()]
    in_cells = [_named(name, v.shape[1], " in cells") for name, v in mesh.cell_data.items()]
    raise _missing(path, field, at_nodes + in_cells, where)


def field_of_points(path: Path, field: str, where: str) -> ResultField:
    """A field of a CSV file with columns x, y, z.

    Raises:
        CaseError: the file cannot be read, or lacks the field or a coordinate.
    """
    table = read_csv(path, where)
    values, labelled = _field_of_table(table, path, field, where)
    columns = []
    for n, axis in enumerate("xyz"):
        column = table.column(*(name.format(axis=axis, n=n) for name in COORDINATE_NAMES))
        if column is None:
            raise CaseError(
                f"{where}: {path.name} has no column {axis}, only {', '.join(table.names)}; name the "
                "coordinates x, y and z."
            )
        columns.append(column)
    points = np.stack(columns, axis=1)
    if not np.isfinite(points).all():
        raise CaseError(f"{where}: {path.name} has coordinates that are no finite numbers.")
    volumes, reach = _room(points)
    return ResultField(points, volumes, values, labelled, reach)


def field_of_inp(path: Path, csv: Path, field: str, where: str) -> ResultField:
    """A field of an INP mesh, from a CSV with a column of node or element numbers.

    Rows of one number, such as those of the integration points of an element, are averaged; nodes
    and elements without a row are left out.

    Raises:
        CaseError: a file cannot be read, lacks the field or the numbers, or has numbers that are not
            in the mesh.
    """
    try:
        inp = read_inp(path)
    except FeaError as failure:
        raise CaseError(f"{where}: {failure}") from failure
    table = read_csv(csv, where)
    values, labelled = _field_of_table(table, csv, field, where)
    for what, known in (("node", inp.node_ids), ("element", inp.element_ids)):
        numbers = table.column(*(name.format(what) for name in NUMBER_NAMES))
        if numbers is None:
            continue
        place, values = _averaged(numbers, values, known, f"{where}: {csv.name}: {what}")
        if what == "element":
            return _at_cells(inp.mesh, place, values, labelled=labelled)
        everywhere = np.full((len(known), values.shape[1]), np.nan)
        everywhere[place] = values
        found = _at_nodes(inp.mesh, everywhere, labelled=labelled)
        given = np.isin(np.arange(len(known)), place)[inp.mesh.node_volumes > 0]
        return ResultField(
            found.points[given], found.volumes[given], found.values[given], labelled, found.reach
        )
    raise CaseError(
        f"{where}: {csv.name} has no column node or element, only {', '.join(table.names)}; name "
        "the column of numbers so."
    )


def _averaged(
    numbers: Float[np.ndarray, " samples"],
    values: Float[np.ndarray, "samples _"],
    known: Int[np.ndarray, " nodes"],
    where: str,
) -> tuple[Int[np.ndarray, " given"], Float[np.ndarray, "given _"]]:
    """Places among the `known` numbers, each once, and the mean of the values given for it."""
    order = np.argsort(known)
    place = order[np.minimum(np.searchsorted(known[order], numbers), len(known) - 1)]
    strange = known[place] != numbers
    if strange.any():
        raise CaseError(
            f"{where} {numbers[strange][0]:g} and {int(strange.sum()) - 1} more of {len(numbers)} rows "
            "are not in the mesh; give the mesh that was computed."
        )
    once, row, count = np.unique(place, return_inverse=True, return_counts=True)
    sums = np.zeros((len(once), values.shape[1]))
    np.add.at(sums, row, values)
    return once, sums / count[:, None]


def _at_nodes(
    mesh: ResultMesh, values: Float[np.ndarray, "nodes _"], *, labelled: bool
) -> ResultField:
    if mesh.dimension == 0:
        volumes, reach = _room(mesh.points)
        return ResultField(mesh.points, volumes, values, labelled, reach)
    # Nodes without a cell, such as the centre of a load, have no results that mean anything.
    used = mesh.node_volumes > 0
    reach = WITHIN_CELL * mesh.longest_cell
    return ResultField(mesh.points[used], mesh.node_volumes[used], values[used], labelled, reach)


def _at_cells(
    mesh: ResultMesh,
    cells: Int[np.ndarray, " given"],
    values: Float[np.ndarray, "given _"],
    *,
    labelled: bool,
) -> ResultField:
    volumes = mesh.cell_volumes[cells]
    used = volumes > 0
    points = mesh.cell_centres[cells[used]]
    reach = WITHIN_CELL * mesh.longest_cell
    return ResultField(points, volumes[used], values[used], labelled, reach)


def _room(points: Float[np.ndarray, "samples 3"]) -> tuple[Float[np.ndarray, " samples"], float]:
    """What each of scattered points counts, and the usual distance of neighbours."""
    rank = min(DENSITY_NEIGHBOURS, len(points) - 1)
    if rank == 0:
        return np.ones(1), 0.0
    away = KDTree(points).query(points, k=rank + 1)[0][:, -1]
    typical = float(np.median(away))
    # Points that stand on one another many times over still count a little.
    return np.maximum(away, 1e-3 * typical) ** 3, typical


def _field_of_table(
    table: CsvTable, path: Path, field: str, where: str
) -> tuple[Float[np.ndarray, "samples _"], bool]:
    found = table.field(field)
    if found is None:
        there = [_named(name, count, "") for name, count in table.fields().items()]
        raise _missing(path, field, there, where)
    return found


def _named(name: str, components: int, place: str) -> str:
    return f'"{name}" ({components} component{"s" if components > 1 else ""}{place})'


def _missing(path: Path, field: str, there: list[str], where: str) -> CaseError:
    return CaseError(
        f'{where} field = "{field}": {path.name} has no such field, only '
        f"{', '.join(there) or 'none at all'}; give one of these."
    )
