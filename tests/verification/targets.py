"""Every target that the mechanics are verified against; run it to print what we reach.

`python3 tests/verification/targets.py > docs/verification.md`
"""

import sys
from dataclasses import dataclass

import jax
from frame_cases import stability, textbook
from lattice_cases import closed_forms, plane
from shell_cases import curved, membrane, plates
from solid_cases import exact_fields, lame_and_kirsch, published, scikit_fem
from target import Benchmark, Target


@dataclass(frozen=True)
class Chapter:
    """Benchmarks of one kind of structure.

    Attributes:
        title: heading.
        introduction: what all of them have in common.
        benchmarks: in the order of the page.
    """

    title: str
    introduction: str
    benchmarks: tuple[Benchmark, ...]


# Deviations below this are rounding, which differs from machine to machine.
NOISE = 1e-10

TOP = """\
# Verification targets and what we reach

Written by `python3 tests/verification/targets.py > docs/verification.md`. The tests in
`tests/verification` check every row that has a tolerance, and that this page is up to date. Rows without
a tolerance are for comparison.
"""

SOLIDS = """\
All quantities of a benchmark come from the mesh named in its row. "tet4" is the linear tetrahedron,
"tet10" the quadratic one, whose mid-edge nodes lie on the curve where a part is curved. Stress is that of
`SolidSolution.stress`, recovered at the nodes, where nothing else is said. Rows without a tolerance
show what linear tetrahedra, or coarse meshes, give.

CalculiX 2.20, an independent program, finds the same displacements, nodal forces and integration-point
stresses on the same mesh to 2e-6 of their largest values, which is as many digits as it prints: tet4 and
curved tet10, isotropic and orthotropic, under forces, pressure, weight and prescribed displacement
(`tests/verification/test_solid_calculix.py`). Where it integrates the pressure over curved facets itself
it differs by up to 0.06 % in displacement and 0.4 % in stress, because it takes three points a facet; with
these three points in place of our six the two agree to 2e-6 again.
"""

FRAMES = """\
Struts are beams of `fea.beam` with rigid joints. Book examples are in the book's units.
"""

SKINS = """\
Flat triangles with six dofs a node: a membrane with drilling rotations and a thin plate. Meshes are
structured; rows of coarser meshes show the convergence.
"""

LATTICES = """\
Effective stiffness of periodic frames, `fea.homogenise_frame`: rigid joints, round struts. The closed
forms are exact for the beam model. Beams against solids: [joint-model.md](joint-model.md).
"""

EXTRUDED = """\
Effective stiffness of extruded (2.5-D) lattices in their plane, per unit depth: periodic frames of
`fea.Wall`. The closed forms are exact for the beam model.
"""

CHAPTERS = (
    Chapter(
        "Solids",
        SOLIDS,
        (
            *exact_fields.BENCHMARKS,
            *lame_and_kirsch.BENCHMARKS,
            *published.BENCHMARKS,
            *scikit_fem.BENCHMARKS,
        ),
    ),
    Chapter("Frames", FRAMES, (*textbook.BENCHMARKS, *stability.BENCHMARKS)),
    Chapter("Skins", SKINS, (*membrane.BENCHMARKS, *plates.BENCHMARKS, *curved.BENCHMARKS)),
    Chapter("Lattices", LATTICES, closed_forms.BENCHMARKS),
    Chapter("Extruded lattices", EXTRUDED, plane.BENCHMARKS),
)

BENCHMARKS = tuple(benchmark for chapter in CHAPTERS for benchmark in chapter.benchmarks)


def page() -> str:
    """All targets and what we reach, as Markdown."""
    lines = [TOP]
    for chapter in CHAPTERS:
        lines += [f"## {chapter.title}\n", chapter.introduction]
        lines += [section(benchmark) for benchmark in chapter.benchmarks]
    return "\n".join(lines)


def section(benchmark: Benchmark) -> str:
    """One benchmark with a row for each target."""
    lines = [
        f"### {benchmark.name}",
        "",
        benchmark.problem,
        "",
        f"Source: {benchmark.source}",
        "",
        "| quantity | target | ours | deviation | tolerance | mesh |",
        "|---|---|---|---|---|---|",
        *(row(target) for target in benchmark.targets),
        "",
    ]
    return "\n".join(lines)


def row(target: Target) -> str:
    """One target and what we reach."""
    measured = target.measure()
    value, deviation = measured.value, target.deviation(measured.value)
    noise = NOISE if target.tolerance is None else min(NOISE, target.tolerance)
    share = target.bound == "relative"
    if abs(deviation) < noise:
        shown, off = f"{target.expected:g}", f"< {noise:g}"
        shown = off if target.expected == 0 else shown
    else:
        shown, off = f"{value:.5g}", _percent(deviation) if share else f"{deviation:+.2g}"
    if target.bound == "least":
        shown, off = f"{value:.5g}", "above" if deviation == 0 else f"{deviation:+.2g}"
    limit = "-"
    if target.tolerance is not None:
        percent = share and target.tolerance > NOISE
        limit = f"{100 * target.tolerance:g} %" if percent else f"{target.tolerance:g}"
    unit = f" {target.unit}" if target.unit else ""
    nodes = ", nodes vary" if measured.nodes is None else f", {measured.nodes} nodes"
    cells = [
        target.quantity,
        f"{target.expected:.7g}{unit}",
        f"{shown}{unit}",
        off,
        limit,
        f"{measured.element}{nodes if measured.nodes != 0 else ''}",
    ]
    return f"| {' | '.join(cells)} |"


def _percent(share: float) -> str:
    rounded = round(100 * share, 2)
    return f"{rounded:+.2f} %" if rounded else "0.00 %"


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.stdout.write(page())
