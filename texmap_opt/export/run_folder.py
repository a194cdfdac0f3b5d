"""The folder of a run: every file of the contract, each whole or not at all."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from texmap_opt.errors import OutputError
from texmap_opt.export.beam_lattice import write_beam_lattice
from texmap_opt.export.metadata import Metadata
from texmap_opt.export.vtk import write_grid, write_stress, write_struts
from texmap_opt.progress import Progress
from texmap_opt.report.drawing import Drawn, draw
from texmap_opt.report.grid_layers import hexahedra
from texmap_opt.report.numbers import peak_memory_mb
from texmap_opt.report.page import write_page
from texmap_opt.report.run_plots import run_plots
from texmap_opt.report.run_scenes import mean_edge, run_scenes
from texmap_opt.run_result import Run
from texmap_opt.structure.structure_xml import write_structure
from texmap_opt.warp import certificate
from texmap_opt.warp.quality import achieved_sizes

# All pictures together; software rendering of a million triangles takes a tenth of it [s].
PICTURES_TIMEOUT_S = 240.0


# Every file a run may write.
FILES = (
    "part.stl",
    "part.3mf",
    "structure.xml",
    "lattice.3mf",
    "stress.vtu",
    "grid.vtu",
    "struts.vtp",
    "report.json",
    "report.html",
    "case.toml",
)


def check_writable(out: Path, inputs: tuple[Path, ...]) -> None:
    """Refuse a folder that cannot be written, before anything is computed.

    Args:
        out: the folder.
        inputs: files that the run reads and must not replace.

    Raises:
        OutputError: naming the folder, or the input that would be lost.
    """
    for path in inputs:
        if path.name in FILES and path.resolve() == (out / path.name).resolve():
            raise OutputError(
                f"--out {out}: the run would replace its own input {path.name}; name another folder."
            )
    if out.exists() and not out.is_dir():
        raise OutputError(f"--out {out}: is a file; name a folder.")
    for name in FILES:
        if (out / name).is_dir():
            raise OutputError(
                f"--out {out}: has a folder named {name}, where a file of the run goes; rename it, or name "
                "another folder."
            )
    parent = out.absolute()
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise OutputError(f"--out {out}: {parent} cannot be written; name another folder.")


def write_run(run: Run, out: Path, progress: Progress) -> dict:
    """Write all files of a run into a folder, which is made when it is not there.

    They are made in a hidden folder and moved when all are there: whatever goes wrong before,
    nothing is left behind.

    Args:
        run: what the stages left.
        out: the folder.
        progress: gets the stages "files" and "pictures".

    Returns:
        The content of report.json, with the times of all stages.

    Raises:
        OutputError: the disk is full, or the folder cannot be written.
    """
    with _staged(out) as folder:
        with progress.stage("files"):
            _write_files(run, folder)
        with progress.stage("pictures"):
            drawn = _draw(run, folder)
            if run.case.output.pictures:
                for name, reason in drawn.missing.items():
                    progress.warn(f"no picture of {name}: {reason}")
            progress.detail(f"{len(drawn.pictures)} drawn")
        report = run.report | {
            "seconds": dict(progress.seconds) | {"total": progress.total()},
            "peak_memory_mb": peak_memory_mb(),
            "warnings": list(progress.warnings),
            "missing_pictures": drawn.missing,
        }
        (folder / "report.json").write_text(json.dumps(report, indent=2, allow_nan=False) + "\n")
        write_page(
            report,
            folder / "report.html",
            pictures=drawn.pictures,
            missing=drawn.missing,
            plot_data=run_plots(
                run.warp,
                run.filling.structure,
                run.part.surface,
                utilisation=None if run.filling.sized is None else run.filling.sized.utilisation,
            ),
        )
        shutil.rmtree(folder / PICTURES)
    return report


# Folder of the pictures while the page is made.
PICTURES = "pictures"


@contextmanager
def _staged(out: Path) -> Iterator[Path]:
    """A hidden folder whose files move into `out` when all went well.

    It lies in `out` where that exists, which may be a disk of its own, and beside it otherwise.
    Files that an earlier run left and this one does not write are removed: they would be taken for
    results of this one.
    """
    place = out if out.is_dir() else out.absolute().parent
    try:
        place.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".texmap-", dir=place))
    except OSError as failure:
        raise OutputError(f"{out}: cannot be written ({failure.strerror}).") from failure
    try:
        yield folder
        out.mkdir(exist_ok=True)
        written = {file.name for file in folder.iterdir()}
        for name in sorted(written):
            (folder / name).replace(out / name)
        for name in set(FILES) - written:
            (out / name).unlink(missing_ok=True)
    except OutputError as failure:
        # The hidden folder is nothing that the user could look for.
        raise OutputError(str(failure).replace(str(folder), str(out))) from failure
    except OSError as failure:
        raise OutputError(
            f"{out}: cannot be written ({failure.strerror}); free some space, or name another folder."
        ) from failure
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _write_files(run: Run, folder: Path) -> None:
    case, structure = run.case, run.filling.structure
    metadata = _metadata(run)
    run.solid.save(folder / "part.stl", metadata)
    run.solid.save(folder / "part.3mf", metadata)
    write_structure(
        structure,
        folder / "structure.xml",
        provenance={
            "program": f"texmap-opt {run.report['version']}",
            "case": case.path.name,
            "case.toml": case.to_toml(),
            "cell": run.cell.name,
            "warp": run.warp.method,
        },
    )
    skin = run.combined.skin
    if case.lattice.kind == "rod" and structure.section == "round":
        write_beam_lattice(
            folder / "lattice.3mf",
            structure,
            clipping=run.part.surface,
            skin=None if skin is None else skin.shell(run.part.surface),
            metadata=metadata,
        )
    stress = run.stress
    write_stress(
        folder / "stress.vtu",
        mesh=(stress.mesh.nodes, stress.mesh.tets),
        case_names=stress.case_names,
        displacement=stress.displacement,
        stress=stress.stress,
        von_mises=stress.von_mises,
    )
    grid = run.warp.grid
    corners = hexahedra(grid)
    shape = tuple(n - 1 for n in corners.shape[:3])
    edge, wanted = mean_edge(grid), run.warp.wanted_size
    jacobian = certificate.grid_coefficients(grid).min(axis=1)
    write_grid(
        folder / "grid.vtu",
        nodes=corners,
        cell_data={
            "size_mm": (edge * achieved_sizes(grid)).reshape(shape),
            "wanted_size_mm": (edge * wanted).reshape(shape),
            "min_jacobian": (jacobian / wanted**grid.dimensions).reshape(shape),
            "kind": run.layout.kinds.astype(float).reshape(shape),
        },
    )
    sized = run.filling.sized
    strut_data = {"length_mm": structure.lengths()}
    if sized is not None and sized.utilisation is not None:
        strut_data["utilisation"] = sized.utilisation
    write_struts(folder / "struts.vtp", structure, strut_data=strut_data)
    (folder / "case.toml").write_text(case.to_toml(), encoding="utf-8")


def _metadata(run: Run) -> Metadata:
    """What the files of the result say of it; the same for the same run."""
    lattice, structure = run.case.lattice, run.filling.structure
    radii = structure.radii
    kinds = ", ".join(cell.name for cell in run.layout.cells)
    bars = "struts" if structure.extrusion is None else "walls"
    skin = f"skin of {lattice.skin_mm:g} mm" if lattice.skin_mm else "no skin"
    return Metadata(
        title=f"{run.part.name} with a lattice",
        description=(
            f"{lattice.kind} kind of {kinds}, {skin}; {len(structure.struts)} {bars} with radii "
            f"from {radii.min():.3g} to {radii.max():.3g} mm; warp {run.warp.method}, sizing "
            f"{run.case.sizing.method}; case {run.case.path.name}"
        ),
    )


def _draw(run: Run, folder: Path) -> Drawn:
    (folder / PICTURES).mkdir()
    if not run.case.output.pictures:
        return Drawn({}, {"all": "the case says [output] pictures = false"})
    return draw(run_scenes(run), folder / PICTURES, timeout_s=PICTURES_TIMEOUT_S)
