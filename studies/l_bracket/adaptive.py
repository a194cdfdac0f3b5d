"""How many nodes a 5 % estimated error takes, with adaptive and with uniform refinement.

    python3 studies/l_bracket/adaptive.py --out DIR [--share 0.05] [--max-nodes 300000]

An L-bracket with a sharp inner corner, clamped at the top of its upright leg and pulled down at the
end of the other. DIR receives results.json, mesh.png (both meshes, coloured by their error) and
convergence.png. Uses `fea` alone.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import numpy as np

import fea
from fea.adaptive import Adapted, Round, refine
from fea.error_estimate import ErrorEstimate
from fea.ftetwild import tetrahedralise

LEG, THICKNESS, WIDTH = 60.0, 20.0, 20.0  # [mm]
FORCE = np.array([0.0, 0.0, -1000.0])  # [N]
MATERIAL = fea.material("Ti-6Al-4V")
# First edge of both, and the steps of uniform refinement: nodes double with each.
FIRST_EDGE, STEP = 8.0, 0.77
MAX_ROUNDS = 8
# Facets of a face lie within the mesher's envelope of its plane [mm].
NEAR_PLANE = 0.1
FLAT = 0.99


def l_bracket() -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an L in the xz plane, swept along y."""
    outline = np.array(
        [(0, 0), (LEG, 0), (LEG, THICKNESS), (THICKNESS, THICKNESS), (THICKNESS, LEG), (0, LEG)]
    )
    n = len(outline)
    vertices = np.zeros((2 * n, 3))
    vertices[:, [0, 2]] = np.tile(outline, (2, 1))
    vertices[n:, 1] = WIDTH
    front = np.array([(0, 1, 3), (1, 2, 3), (0, 3, 5), (3, 4, 5)])
    i = np.arange(n)
    j = (i + 1) % n
    sides = [np.stack([j, i, i + n], axis=1), np.stack([j, i + n, j + n], axis=1)]
    return vertices, np.concatenate([front, front[:, ::-1] + n, *sides])


def solve(mesh: fea.TetMesh) -> fea.SolidSolution:
    """Clamped at z = LEG, pulled down at x = LEG."""
    top = _face(mesh, axis=2)
    problem = fea.SolidProblem.from_supports(
        mesh,
        MATERIAL,
        [fea.Support.clamp(np.unique(top))],
        fea.force_on_facets(mesh, _face(mesh, axis=0), FORCE),
    )
    return fea.solve_solid(problem)


def _face(mesh: fea.TetMesh, *, axis: int) -> np.ndarray:
    """Facets of the bracket's face at LEG across an axis."""
    on_plane = mesh.facet_centroids[:, axis] > LEG - NEAR_PLANE
    return mesh.boundary_facets[on_plane & (mesh.facet_normals[:, axis] > FLAT)]


def adaptive(share: float, max_nodes: int) -> Adapted:
    """Refined where the error is."""
    surface = l_bracket()
    return refine(
        lambda sizing: tetrahedralise(*surface, edge=FIRST_EDGE, sizing=sizing).to_tet10(),
        solve,
        share=share,
        rounds=MAX_ROUNDS,
        max_nodes=max_nodes,
        throw=False,
    )


def uniform(share: float, max_nodes: int) -> tuple[list[Round], ErrorEstimate]:
    """Refined everywhere, until the share is reached or the next mesh would be too large."""
    surface = l_bracket()
    history: list[Round] = []
    edge = FIRST_EDGE
    while True:
        begun = time.perf_counter()
        mesh = tetrahedralise(*surface, edge=edge).to_tet10()
        estimate = solve(mesh).error_estimate
        error = float(estimate.relative.max())
        history.append(Round(len(mesh.nodes), len(mesh.tets), error, time.perf_counter() - begun))
        print(f"uniform, {edge:.2f} mm: {len(mesh.nodes):,} nodes, {100 * error:.2f} %")
        if error <= share or len(mesh.nodes) / STEP**3 > max_nodes:
            return history, estimate
        edge *= STEP


def main() -> None:
    """Refine adaptively and uniformly to the same estimated error; write numbers and pictures."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--share", type=float, default=0.05)
    parser.add_argument("--max-nodes", type=int, default=300_000)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    given.out.mkdir(parents=True, exist_ok=True)
    adapted = adaptive(given.share, given.max_nodes)
    for step in adapted.history:
        print(f"adaptive: {step.nodes:,} nodes, {100 * step.relative:.2f} %")
    print(adapted.message or "adaptive refinement reached its share")
    steps, estimate = uniform(given.share, given.max_nodes)
    results = {
        "share": given.share,
        "adaptive": [vars(step) for step in adapted.history],
        "uniform": [vars(step) for step in steps],
    }
    (given.out / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    draw_meshes(given.out / "mesh.png", adapted.estimate, estimate)
    draw_convergence(given.out / "convergence.png", adapted.history, steps, given.share)


def draw_meshes(path: Path, adapted: ErrorEstimate, uniform: ErrorEstimate) -> None:
    """Both meshes side by side; colour: estimated error of a cell over the root of its volume."""
    import pyvista as pv

    density = [e.cells.max(axis=0) / np.sqrt(e.mesh.volumes) for e in (adapted, uniform)]
    high = max(np.quantile(d, 0.999) for d in density)
    plotter = pv.Plotter(off_screen=True, shape=(1, 2), window_size=[1400, 720], border=False)
    for column, (name, estimate, values) in enumerate(
        zip(("adaptive", "uniform"), (adapted, uniform), density, strict=True)
    ):
        mesh = estimate.mesh
        grid = pv.UnstructuredGrid({pv.CellType.TETRA: mesh.tets[:, :4]}, mesh.nodes)
        grid.cell_data["error density"] = values
        plotter.subplot(0, column)
        plotter.set_background("white")
        error = 100 * estimate.relative.max()
        plotter.add_text(
            f"{name}: {len(mesh.nodes):,} nodes, estimated error {error:.1f} %",
            font_size=13,
            color="black",
        )
        plotter.add_mesh(
            grid.extract_surface(algorithm="dataset_surface"),
            show_edges=True,
            edge_color="grey",
            line_width=0.5,
            lighting=False,
            cmap="inferno_r",
            clim=(high / 1e3, high),
            log_scale=True,
            show_scalar_bar=column == 1,
            scalar_bar_args={
                "title": "estimated error / sqrt(volume) [sqrt(MPa)]",
                "fmt": "%.0e",
                "color": "black",
                "title_font_size": 18,
                "label_font_size": 16,
                "position_x": 0.2,
                "position_y": 0.02,
                "height": 0.08,
            },
        )
        plotter.camera_position = [(150, -190, 130), (30, 10, 26), (0, 0, 1)]
        plotter.camera.zoom(1.45)
    plotter.screenshot(path)
    plotter.close()


def draw_convergence(
    path: Path, adapted: tuple[Round, ...], uniform: list[Round], share: float
) -> None:
    """Estimated error over the number of nodes, both axes logarithmic."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, steps, mark in (("adaptive", adapted, "o-"), ("uniform", uniform, "s--")):
        axes.loglog(
            [step.nodes for step in steps],
            [100 * step.relative for step in steps],
            mark,
            label=name,
        )
    axes.axhline(100 * share, color="grey", linewidth=0.8)
    axes.set(xlabel="nodes (tet10)", ylabel="estimated error / energy norm [%]")
    axes.set_yticks([4, 5, 6, 8, 10, 12], labels=["4", "5", "6", "8", "10", "12"])
    axes.set_yticks([], minor=True)
    axes.legend()
    axes.grid(visible=True, which="both", linewidth=0.3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
