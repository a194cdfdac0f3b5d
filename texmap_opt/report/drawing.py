"""Pictures drawn in a process of their own: without a display or OpenGL the run still ends well."""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fea.effective_stiffness import DirectionalModulus
from fea.plane_stiffness import PolarModulus
from texmap_opt.errors import OutputError
from texmap_opt.export.picture_file import require_png, write_png
from texmap_opt.export.whole_file import whole_file
from texmap_opt.report.overlay import write_polar
from texmap_opt.report.scenes import Cell, LoadedPart, PlannedPart, Scene, StiffnessSurface, Whole
from texmap_opt.report.view import Eye, best_eye, eyes
from texmap_opt.solid.extruded import extruded_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure

REMEDY = (
    "VTK needs OpenGL, in software if need be: on Debian and Ubuntu `apt-get install libegl1 "
    "libgl1`, on Fedora `dnf install mesa-libEGL mesa-libGL`; no display is needed"
)

# A cell is drawn in a second or two; a first start of VTK on a cold disk takes longer.
CELL_TIMEOUT_S = 120.0

# Largest distance of the polygons at joints of walls from their circles, over the radius.
ROUNDNESS = 0.01

# Windows tells crashes by larger codes.
LARGEST_EXIT_CODE = 255

# A failure that mentions one of these is for want of a graphics library.
GRAPHICS_HINTS = ("OpenGL", ".so", "blank")

# So much of what VTK wrote is repeated in a reason.
MESSAGE_LENGTH = 200


@dataclass(frozen=True)
class Drawn:
    """What came of the scenes.

    Attributes:
        pictures: the PNG file of each scene that was drawn.
        missing: why each of the others was not, and what to do about it.
    """

    pictures: dict[str, Path]
    missing: dict[str, str]


def draw(
    scenes: Mapping[str, Scene], out_dir: Path, *, timeout_s: float, up: int | None = None
) -> Drawn:
    """Draw each scene to `out_dir/NAME.png`; never raises for want of graphics.

    All scenes of a call are seen from one direction: the one that shows most of the supports and
    loads, where a scene has any.

    Args:
        scenes: what to draw, by name.
        out_dir: folder for the pictures; must exist.
        timeout_s: for all of them together [s].
        up: the axis that is upright; None: y for a part with marks that stands so, else z.
    """
    pictures: dict[str, Path] = {}
    missing: dict[str, str] = {}
    deadline = time.monotonic() + timeout_s
    with tempfile.TemporaryDirectory(prefix="texmap-pictures-") as folder:
        job = Path(folder)
        eye = _eye(scenes, up)
        np.save(job / "eye.npy", np.stack([eye.direction, eye.up]))
        for name, scene in scenes.items():
            with (job / f"{name}.scene").open("wb") as stream:
                pickle.dump(scene, stream, protocol=5)
        waiting = set(scenes)
        while waiting:
            (job / "current").unlink(missing_ok=True)
            failure = _run(job, deadline - time.monotonic())
            done = {name for name in waiting if (job / f"{name}.png").exists()}
            for name in done:
                # Read and written, not moved: the folders may lie on different disks.
                pictures[name] = out_dir / f"{name}.png"
                pictures[name].write_bytes((job / f"{name}.png").read_bytes())
                (job / f"{name}.scene").unlink()
            waiting -= done
            culprit = _text(job / "current")
            if failure is None or culprit not in waiting or not pictures:
                # Nothing can be drawn here, or nobody is to blame: the rest would fail alike.
                missing |= dict.fromkeys(waiting, failure or REMEDY)
                break
            missing[culprit] = failure
            (job / f"{culprit}.scene").unlink()
            waiting.discard(culprit)
    order = {name: i for i, name in enumerate(scenes)}
    return Drawn(
        {name: pictures[name] for name in sorted(pictures, key=order.__getitem__)},
        {name: missing[name] for name in sorted(missing, key=order.__getitem__)},
    )


def cell_scene(structure: Structure) -> Cell | Whole:
    """One unit cell, or a block of them: struts in their cube, or the solid of their walls."""
    if structure.extrusion is None:
        return Cell(structure.joints, structure.struts, structure.radii)
    tolerance = ROUNDNESS * float(structure.radii.max())
    return Whole(extruded_solid(structure, structure.extrusion, tolerance_mm=tolerance))


def draw_cell(structure: Structure, png: Path) -> None:
    """Draw one unit cell.

    Raises:
        InputError: when the file is not named .png.
        OutputError: when this machine cannot draw, or the file cannot be written.
    """
    _draw_one(cell_scene(structure), png)


def draw_stiffness(modulus: DirectionalModulus, png: Path, *, quantity: str) -> None:
    """Draw the surface of Young's modulus over all directions.

    Args:
        modulus: the surface.
        png: where the picture goes.
        quantity: what the modulus is, for the colour bar.

    Raises:
        InputError: when the file is not named .png.
        OutputError: when this machine cannot draw, or the file cannot be written.
    """
    # Over its largest value: pictures do not depend on the unit.
    surface = TriMesh(modulus.vertices / modulus.E.max(), modulus.faces)
    _draw_one(StiffnessSurface(surface, modulus.E, quantity), png)


def draw_polar_stiffness(modulus: PolarModulus, png: Path, *, quantity: str) -> None:
    """Draw Young's modulus over all directions of the plane, as a curve round the origin.

    Args:
        modulus: the curve.
        png: where the picture goes.
        quantity: what the modulus is.

    Raises:
        InputError: when the file is not named .png.
        OutputError: when it cannot be written.
    """
    require_png(png)
    with whole_file(png) as file:
        write_polar(modulus.angle, modulus.E, file, quantity=quantity)


def _draw_one(scene: Scene, png: Path) -> None:
    require_png(png)
    with tempfile.TemporaryDirectory(prefix="texmap-cell-") as folder:
        drawn = draw({"scene": scene}, Path(folder), timeout_s=CELL_TIMEOUT_S)
        if drawn.missing:
            raise OutputError(f"{png}: no picture: {drawn.missing['scene']}.")
        write_png(png, drawn.pictures["scene"].read_bytes())


def _eye(scenes: Mapping[str, Scene], up: int | None) -> Eye:
    for scene in scenes.values():
        if isinstance(scene, LoadedPart | PlannedPart):
            part = scene.surface if isinstance(scene, LoadedPart) else scene.part
            return best_eye(part.bounds[1] - part.bounds[0], scene.marks, up)
    points = [_points(scene) for scene in scenes.values()]
    extent = np.ptp(points[0], axis=0) if points else np.ones(3)
    return eyes(extent, 2 if up is None else up)[0]


def _points(scene: Scene) -> np.ndarray:
    for name in ("surface", "part"):
        if hasattr(scene, name):
            return getattr(scene, name).vertices
    return scene.joints  # pyright: ignore[reportAttributeAccessIssue]


def _run(job: Path, seconds: float) -> str | None:
    """Run the drawing process; returns why it failed, or None."""
    if seconds <= 0:
        return "drawing took longer than allowed"
    command = [sys.executable, "-m", "texmap_opt.report.pictures", str(job)]
    # The same packages as here, wherever this process was started and has them from.
    path = os.pathsep.join(entry or str(Path.cwd()) for entry in sys.path)
    with (job / "log").open("wb") as log:
        try:
            # A group of its own, so that Ctrl-C in the terminal reaches only this process, which
            # then ends the other one.
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                env=os.environ | {"PYTHONPATH": path},
            )
        except OSError as failure:
            return f"the drawing process could not be started ({failure.strerror})"
        try:
            code = process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            return f"drawing did not end within the {seconds:.0f} s left for it; {REMEDY}"
        finally:
            if process.poll() is None:
                _end(process)
    if code == 0:
        return None
    return _reason(code, _text(job / "log"))


def _reason(code: int, log: str) -> str:
    last = (log.strip().splitlines() or [""])[-1][:MESSAGE_LENGTH]
    if code < 0 or code > LARGEST_EXIT_CODE:
        name = signal.Signals(-code).name if code < 0 else hex(code)
        return f"VTK crashed ({name}); {REMEDY}"
    reason = f"drawing failed: {last}" if last else f"drawing failed with exit code {code}"
    return f"{reason}; {REMEDY}" if any(hint in last for hint in GRAPHICS_HINTS) else reason


def _end(process: subprocess.Popen) -> None:
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""
