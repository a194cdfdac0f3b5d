"""What a run will take: seconds of its stages, memory and triangles, foreseen from its counts."""

from dataclasses import dataclass

from texmap_opt.case import DesignCase
from texmap_opt.part import Part
from texmap_opt.tetrahedralise import default_edge_mm, estimated_counts
from texmap_opt.warp.grid import Grid

# Seconds on two cores without any cache, JAX's compiled code included, fitted to the runs of
# `tests/texmap_opt/test_run_cost.py`: each has a share that every case pays, most of it compilation, and
# one in proportion to a count.
START_S = 3.0
MESH_S, TET_S = 1.0, 8e-4  # tets and their stress
UNIFORM_S, WARP_S, CELL_S = 3.5, 7.5, 4e-3
FRAME_S, SKIN_FRAME_S = 2.0, 1.0
GIVEN_S, OPTIMISED_S, SKIN_SIZING_S, STRUT_SIZING_S = 1.0, 7.0, 8.0, 3e-3
# Steps of the method of moving asymptotes over those of optimality criteria.
MMA_STEPS = 1.5
LATTICE_S, SKIN_S = 5e-3, 6e-3  # per strut: its solid, and its union with a skin
WALLS_S = 2e-3  # per wall: its solid and the result
PICTURES_S, PICTURE_S = 9.0, 1e-3
# Runs that sizing and meshing are repeated where a density is asked for (see `filling`).
DENSITY_RUNS = 2
# Estimates and measured times were within this factor of each other, both ways.
SPREAD = 1.4

START_MB, NODE_MB, STRUT_MB = 700.0, 0.015, 0.25
TRIANGLES_PER_STRUT = 60


@dataclass(frozen=True)
class RunCost:
    """What a run without cache takes on two cores.

    Attributes:
        triangles: of the result.
        stages: seconds of each stage, by the names that the run gives them; "start" is what passes
            before the first of them [s].
        memory_mb: at its peak [MB].
    """

    triangles: int
    stages: dict[str, float]
    memory_mb: float

    @property
    def seconds(self) -> float:
        """All stages together [s]."""
        return sum(self.stages.values())

    @property
    def time_text(self) -> str:
        """The range in which the time is expected."""
        low, high = self.seconds / SPREAD, self.seconds * SPREAD
        return f"{_two_digits(low)} to {_two_digits(high)} s"


def run_cost(case: DesignCase, part: Part, grid: Grid, struts: int) -> RunCost:
    """Foresee a run; refinement of the tets by `max_error` is not counted.

    Args:
        case: what is asked.
        part: what is filled.
        grid: the planned uniform grid.
        struts: of the trimmed lattice.
    """
    edge = case.analysis.edge_mm or default_edge_mm(part)
    tets = estimated_counts(part, edge_mm=edge, element=case.analysis.element)
    rods, skin = case.lattice.kind == "rod", case.lattice.skin_mm > 0
    uniform = case.warp.method == "uniform"
    runs = DENSITY_RUNS if case.lattice.relative_density is not None else 1
    if grid.dimensions == 3:
        lattice, result = LATTICE_S * struts, SKIN_S * struts * skin
    else:
        lattice, result = WALLS_S * struts, 0.0
    stages = {
        "start": START_S,
        "tets and stress": MESH_S + TET_S * tets.tets,
        "warp": UNIFORM_S if uniform else WARP_S + CELL_S * grid.cell_count,
        "frame": (FRAME_S + SKIN_FRAME_S * skin) * rods,
        "sizing": runs * _sizing(case, struts) * rods,
        "lattice": runs * lattice,
        "result": result,
        "pictures": (PICTURES_S + PICTURE_S * struts) * case.output.pictures,
    }
    triangles = int(TRIANGLES_PER_STRUT * struts) + 4 * len(part.surface.faces)
    memory = START_MB + NODE_MB * tets.nodes + STRUT_MB * struts
    return RunCost(triangles, stages, float(memory))


def _sizing(case: DesignCase, struts: int) -> float:
    """Seconds of sizing once."""
    if case.sizing.method in ("none", "graded"):
        return GIVEN_S
    steps = MMA_STEPS if case.sizing.method == "mma" else 1.0
    cases = len({load.case for load in case.loads})
    fixed = OPTIMISED_S + SKIN_SIZING_S * (case.lattice.skin_mm > 0)
    return fixed + steps * cases * STRUT_SIZING_S * struts


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):.0f}"
