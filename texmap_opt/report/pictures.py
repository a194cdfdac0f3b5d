"""Draws scenes with VTK: `python -m texmap_opt.report.pictures JOB_DIR`.

Run it in a process of its own (`drawing.draw` does): without a working OpenGL, VTK may abort or
hang. JOB_DIR holds one `NAME.scene` a picture and `eye.npy`; each becomes `NAME.png`.
"""

import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from texmap_opt.report.glyphs import Glyph, axis_arrows, diagonal, glyph
from texmap_opt.report.overlay import (
    DIVERGING,
    SECTION_COLOUR,
    Badge,
    Bar,
    Overlay,
    colour_range,
    kinds_bar,
    paint_section,
    write_picture,
)
from texmap_opt.report.scenes import (
    Action,
    Cell,
    CutOpen,
    LoadedPart,
    Mark,
    PlannedPart,
    Scene,
    StiffnessSurface,
    Struts,
    WarpedGrid,
    Whole,
)
from texmap_opt.report.tubes import LINES_ABOVE, coloured_struts, joint_radii, tubes
from texmap_opt.report.view import HALF_ANGLE_DEG, Eye, Frame, eye_along, fitted_view
from texmap_opt.solid.tri_mesh import TriMesh

WIDTH, HEIGHT = 1200, 900

# Rendered this many times finer and averaged: smooth edges whatever the driver offers.
SUPERSAMPLING = 2

SURFACE_COLOUR = "#d3dae2"
SUPPORT_COLOUR = "#1f6fd6"
LOAD_COLOUR = "#d62828"
EDGE_COLOUR = "#2b333b"
BEHIND_COLOUR = "#93a2b1"

# Opacity of the part around its cells; around cells that reach through it all.
VEIL, LIGHT_VEIL = 0.25, 0.1

# Numbers on the picture keep this distance [pixels].
BADGE_GAP = 34

AXIS_COLOURS = {"x": "#d62828", "y": "#2a9d4b", "z": "#1f6fd6"}

MATT: dict[str, Any] = {"ambient": 0.2, "diffuse": 0.85, "specular": 0.12, "specular_power": 20}

# Edges sharper than this are drawn as lines [degrees].
SHARP_DEG = 35

# Room on the right for a colour bar; and none.
BESIDE_BAR, PLAIN = Frame(right=0.83), Frame()


def main(job: Path) -> None:
    """Draw every scene of the job folder that has no picture yet."""
    eye = Eye(*np.load(job / "eye.npy"))
    for file in sorted(job.glob("*.scene")):
        with file.open("rb") as stream:
            scene: Scene = pickle.load(stream)
        # The name of the scene at work is left behind for the parent, should VTK crash.
        (job / "current").write_text(file.stem)
        draw_scene(scene, eye, file.with_suffix(".png"))


def draw_scene(scene: Scene, eye: Eye, png: Path) -> None:
    """Draw one scene.

    Raises:
        RuntimeError: when the picture comes out blank.
    """
    plotter = pv.Plotter(
        off_screen=True,
        lighting="none",
        window_size=[WIDTH * SUPERSAMPLING, HEIGHT * SUPERSAMPLING],
    )
    plotter.set_background("white")  # pyright: ignore[reportArgumentType]
    _light(plotter)
    draw = {
        LoadedPart: _loaded_part,
        WarpedGrid: _warped_grid,
        Struts: _struts,
        CutOpen: _cut_open,
        Whole: _whole,
        Cell: _cell,
        PlannedPart: _planned_part,
        StiffnessSurface: _stiffness_surface,
    }[type(scene)]
    overlay = draw(plotter, scene, eye)
    image = plotter.screenshot(return_img=True)
    plotter.close()
    fine = np.array(image)[..., :3]
    if overlay.section is not None:
        paint_section(fine, overlay.section)
    pixels = fine.reshape(HEIGHT, SUPERSAMPLING, WIDTH, SUPERSAMPLING, 3).mean(axis=(1, 3))
    if pixels.std() < 1:
        raise RuntimeError("the picture came out blank")
    write_picture(pixels, overlay, png)


def _light(plotter: pv.Plotter) -> None:
    # Fixed to the eye: a key from the upper left, a fill from the right, a little from the front.
    lights = (((-0.9, 1.2, 1.0), 0.62), ((1.2, 0.1, 0.6), 0.26), ((0.0, -0.2, 1.0), 0.3))
    for position, intensity in lights:
        light = pv.Light(position=position, focal_point=(0, 0, 0), intensity=intensity)
        light.set_camera_light()
        plotter.add_light(light)


def _look(plotter: pv.Plotter, points: np.ndarray, eye: Eye, frame: Frame) -> None:
    """Place the eye so that the points fill the frame."""
    view = fitted_view(points, eye, frame=frame, aspect=WIDTH / HEIGHT)
    camera = plotter.camera
    camera.position = tuple(view.position)
    camera.focal_point = tuple(view.focal)
    camera.up = tuple(eye.up)
    camera.view_angle = 2 * HALF_ANGLE_DEG
    camera.SetWindowCenter(-view.centre[0], -view.centre[1])
    plotter.renderer.ResetCameraClippingRange()  # pyright: ignore[reportCallIssue]


def _shade_gaps(plotter: pv.Plotter, reach: float) -> None:
    # Darker corners and gaps make the depth of a lattice readable; `reach` in mm.
    plotter.enable_ssao(radius=reach, bias=0.03 * reach, kernel_size=48, blur=True)  # pyright: ignore[reportCallIssue]


def _poly(surface: TriMesh) -> pv.PolyData:
    return pv.PolyData.from_regular_faces(surface.vertices, surface.faces)


def _add(plotter: pv.Plotter, mesh: Any, **look: Any) -> pv.Actor:
    return plotter.add_mesh(mesh, **(MATT | look))


def _add_lines(plotter: pv.Plotter, lines: Any, width: float, **look: Any) -> None:
    """Unlit lines; `width` in pixels of the finished picture."""
    if lines.n_cells:
        plotter.add_mesh(lines, line_width=width * SUPERSAMPLING, lighting=False, **look)


def _add_coloured(plotter: pv.Plotter, mesh: Any, bar: Bar, **look: Any) -> None:
    """A mesh coloured by its array "values" on the scale of the bar."""
    look = {"ambient": 0.35, "diffuse": 0.75} | look
    scale = {"cmap": bar.colours, "clim": (bar.low, bar.high), "n_colors": 256}
    _add(
        plotter,
        mesh,
        scalars="values",
        above_color=bar.beyond_colour,
        show_scalar_bar=False,
        **scale,
        **look,
    )


def _surface(plotter: pv.Plotter, surface: TriMesh, **look: Any) -> None:
    mesh = _poly(surface).compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=SHARP_DEG, consistent_normals=False
    )
    _add(plotter, mesh, **({"color": SURFACE_COLOUR} | look))


def _sharp_edges(plotter: pv.Plotter, surface: TriMesh) -> None:
    edges = _poly(surface).extract_feature_edges(
        feature_angle=SHARP_DEG, non_manifold_edges=False, manifold_edges=False
    )
    _add_lines(plotter, edges, 2, color=EDGE_COLOUR)


def _marks(
    plotter: pv.Plotter, marks: tuple[Mark, ...], part: TriMesh, *, filled: bool
) -> list[Glyph]:
    """Areas filled or outlined, cones at supports, arrows at loads."""
    glyphs = []
    for mark in marks:
        colour = _mark_colour(mark)
        if len(mark.patch.faces):
            area = _poly(mark.patch).clean()
            # Lifted off the surface: on it, both would fight for the same pixels.
            area.points += 0.0015 * diagonal(part) * _vertex_normals(area)
            if filled:
                _add(plotter, area, color=colour, ambient=0.4, diffuse=0.6)
            rim = area.extract_feature_edges(
                feature_edges=False, non_manifold_edges=False, manifold_edges=False
            )
            if not filled:
                _add_lines(plotter, rim, 4, color=colour)
        glyphs.append(glyph(mark, part))
        _surface(plotter, glyphs[-1].shape, color=colour, ambient=0.35, diffuse=0.7)
    return glyphs


def _mark_colour(mark: Mark) -> str:
    return SUPPORT_COLOUR if mark.action is Action.SUPPORT else LOAD_COLOUR


def _vertex_normals(mesh: Any) -> np.ndarray:
    shaded = mesh.compute_normals(
        cell_normals=False,
        split_vertices=False,
        consistent_normals=False,
        auto_orient_normals=False,
    )
    return np.asarray(shaded.point_data["Normals"])


def _loaded_part(plotter: pv.Plotter, scene: LoadedPart, eye: Eye) -> Overlay:
    low, high, beyond = colour_range(scene.von_mises, from_zero=True)
    mesh = _poly(scene.surface)
    mesh["values"] = scene.von_mises
    bar = Bar("von Mises stress\n[MPa]", "viridis", low, high, beyond)
    _add_coloured(plotter, mesh, bar)
    _sharp_edges(plotter, scene.surface)
    glyphs = _marks(plotter, scene.marks, scene.surface, filled=False)
    legend = tuple((0, mark.label, _mark_colour(mark)) for mark in scene.marks)
    seen = np.concatenate([scene.surface.vertices, *(glyph.shape.vertices for glyph in glyphs)])
    _look(plotter, seen, eye, _under_legend(BESIDE_BAR, len(legend)))
    return Overlay(bar, legend=legend)


def _under_legend(frame: Frame, rows: int) -> Frame:
    return Frame(frame.left, frame.right, frame.bottom, frame.top - 0.036 * rows)


def _warped_grid(plotter: pv.Plotter, scene: WarpedGrid, eye: Eye) -> Overlay:
    grid = pv.StructuredGrid(*np.moveaxis(scene.nodes, -1, 0))
    # StructuredGrid counts cells with the first index fastest.
    grid.cell_data["values"] = scene.values.ravel(order="F")
    cells = grid.extract_cells(np.flatnonzero(scene.behind(eye.direction).ravel(order="F")))
    skin = cells.extract_surface(algorithm="dataset_surface")
    if scene.names:
        bar = kinds_bar(scene.names)
    else:
        scale = colour_range(scene.values[scene.meets], middle=scene.middle)
        bar = Bar(scene.quantity, "viridis_r" if scene.middle is None else DIVERGING, *scale)
    thin = 0.8 * SUPERSAMPLING
    _add_coloured(plotter, skin, bar, show_edges=True, edge_color=EDGE_COLOUR, line_width=thin)
    veil = LIGHT_VEIL if 1 in scene.values.shape else VEIL
    _add(plotter, _poly(scene.part), color="white", opacity=veil)
    _sharp_edges(plotter, scene.part)
    frame = _under_legend(PLAIN, len(scene.names)) if scene.names else BESIDE_BAR
    _look(plotter, np.concatenate([skin.points, scene.part.vertices]), eye, frame)
    if not scene.names:
        return Overlay(bar)
    return Overlay(legend=tuple((0, *row) for row in zip(scene.names, bar.colours, strict=True)))


def _struts(plotter: pv.Plotter, scene: Struts, eye: Eye) -> Overlay:
    eye = eye if scene.axis is None else eye_along(scene.axis, eye)
    title = f"{scene.quantity}\n[{scene.unit}]" if scene.unit else scene.quantity
    low, high, beyond = colour_range(scene.values.ravel(), from_zero=scene.limit is not None)
    bar = Bar(title, "viridis", low, high, beyond)
    if scene.limit is not None:
        peak = float(scene.values.max())
        if peak > scene.limit:
            bar = Bar(title, "plasma", 0.0, scene.limit, peak, LOAD_COLOUR)
        else:
            bar = Bar(title, "plasma", low, high, beyond)
    if len(scene.struts) > LINES_ABOVE:
        ends = scene.joints[scene.struts].reshape(-1, 3)
        lines = pv.line_segments_from_points(ends)
        lines.point_data["values"] = scene.values.ravel()
        _add_coloured(plotter, lines, bar, line_width=1.5 * SUPERSAMPLING, lighting=False)
        seen = scene.joints
    else:
        shape, normals, values = coloured_struts(scene)
        mesh = _poly(shape)
        mesh.point_data["values"] = values
        mesh.point_data.active_normals = normals
        _add_coloured(plotter, mesh, bar)
        seen = shape.vertices
        typical = np.linalg.norm(np.diff(scene.joints[scene.struts], axis=1), axis=-1)
        _shade_gaps(plotter, 0.5 * float(np.median(typical)))
    _look(plotter, seen, eye, BESIDE_BAR)
    return Overlay(bar)


def _whole(plotter: pv.Plotter, scene: Whole, eye: Eye) -> Overlay:
    _surface(plotter, scene.surface)
    _shade_gaps(plotter, 0.045 * diagonal(scene.surface))
    _look(plotter, scene.surface.vertices, eye, PLAIN)
    return Overlay()


def _cut_open(plotter: pv.Plotter, scene: CutOpen, eye: Eye) -> Overlay:
    """The cut is along the axis that shows the largest section."""
    bounds = scene.surface.bounds
    extent = bounds[1] - bounds[0]
    axis = int(np.argmax(np.abs(eye.direction) * extent.prod() / extent))
    normal = np.sign(eye.direction[axis]) * np.eye(3)[axis]
    # Not quite in the middle, where a grid of cells may have its own faces.
    origin = bounds.mean(axis=0) + 0.013 * extent * normal
    mesh = _poly(scene.surface)
    rest = mesh.clip(normal=normal, origin=origin)
    # Where the eye meets the inner side of a closed surface there is the section in front of it:
    # painting that side evenly fills the section exactly, with no triangulation that can fail.
    actor = _add(plotter, rest, color=SURFACE_COLOUR)
    actor.backface_prop = pv.Property(
        color=SECTION_COLOUR, ambient=1.0, diffuse=0.0, specular=0.0, lighting=False
    )
    _look(plotter, np.asarray(rest.points), eye, PLAIN)
    plain = np.asarray(plotter.screenshot(return_img=True))[..., :3]
    colour = np.array(pv.Color(SECTION_COLOUR).int_rgb)
    section = np.asarray((np.abs(plain - colour) <= 1).all(axis=-1))
    _shade_gaps(plotter, 0.045 * diagonal(scene.surface))
    return Overlay(section=section)


def _cell(plotter: pv.Plotter, scene: Cell, eye: Eye) -> Overlay:
    low, high = scene.joints.min(axis=0), scene.joints.max(axis=0)
    shape, normals = tubes(scene.joints, scene.struts, scene.radii, sides=48)
    mesh = _poly(shape)
    mesh.point_data.active_normals = normals
    _add(plotter, mesh, color=SURFACE_COLOUR)
    largest = joint_radii(len(scene.joints), scene.struts, scene.radii)
    for joint, radius in zip(scene.joints, largest, strict=True):
        ball = pv.Sphere(
            radius=float(radius), center=tuple(joint), theta_resolution=48, phi_resolution=48
        )
        _add(plotter, ball, color=SURFACE_COLOUR, smooth_shading=True)
    box = pv.Box(bounds=tuple(np.stack([low, high], 1).ravel()))
    _add_lines(plotter, box.extract_all_edges(), 1.5, color=BEHIND_COLOUR)
    _shade_gaps(plotter, 0.25 * float((high - low).max()))
    grown = np.concatenate([np.asarray(box.points), shape.vertices])
    _look(plotter, grown, eye, PLAIN)
    return Overlay()


def _stiffness_surface(plotter: pv.Plotter, scene: StiffnessSurface, eye: Eye) -> Overlay:
    bar = Bar(scene.quantity, "viridis", *scene.colour_range)
    mesh = _poly(scene.surface).compute_normals(cell_normals=False, split_vertices=False)
    mesh.point_data["values"] = scene.modulus
    _add_coloured(plotter, mesh, bar, smooth_shading=True)
    axes = axis_arrows(scene.surface)
    for axis, colour in zip(axes, AXIS_COLOURS.values(), strict=True):
        _surface(plotter, axis, color=colour)
    seen = np.concatenate([shape.vertices for shape in (scene.surface, *axes)])
    _look(plotter, seen, eye, BESIDE_BAR)
    return Overlay(bar, legend=tuple((0, *item) for item in AXIS_COLOURS.items()))


def _planned_part(plotter: pv.Plotter, scene: PlannedPart, eye: Eye) -> Overlay:
    _surface(plotter, scene.part)
    _sharp_edges(plotter, scene.part)
    glyphs = _marks(plotter, scene.marks, scene.part, filled=True)
    for axis in range(3):
        # The three faces of the grid behind the part.
        ends = np.take(scene.grid, [0, -1], axis=axis)
        far = 0 if np.diff(ends, axis=axis).mean(axis=(0, 1, 2)) @ eye.direction > 0 else 1
        face = np.take(ends, [far], axis=axis)
        sheet = pv.StructuredGrid(*np.moveaxis(face, -1, 0)).extract_all_edges()
        _add_lines(plotter, sheet, 0.7, color=BEHIND_COLOUR)
    seen = [scene.grid.reshape(-1, 3), *(glyph.shape.vertices for glyph in glyphs)]
    _look(plotter, np.concatenate(seen), eye, _under_legend(PLAIN, len(scene.marks)))
    badges: list[Badge] = []
    middle = np.array(_pixel(plotter, scene.part.bounds.mean(axis=0)))
    for number, (mark, sign) in enumerate(zip(scene.marks, glyphs, strict=True), start=1):
        # Beside the anchor farthest out, where nothing hides it, but clear of other numbers.
        places = np.array([_pixel(plotter, anchor) for anchor in sign.anchors])
        out = np.linalg.norm(places - middle, axis=1)
        for badge in badges:
            gap = np.linalg.norm(places - [badge.x, badge.y], axis=1)
            out = np.where(gap < BADGE_GAP, out - 1e4 + gap, out)
        x, y = places[np.argmax(out)]
        badges.append(Badge(float(x), float(y), number, _mark_colour(mark)))
    legend = tuple((b.number, m.label, b.colour) for b, m in zip(badges, scene.marks, strict=True))
    return Overlay(badges=tuple(badges), legend=legend)


def _pixel(plotter: pv.Plotter, point: np.ndarray) -> tuple[float, float]:
    """Where a point appears [pixels of the finished picture from its top left]."""
    renderer = plotter.renderer
    x, y, z = (float(coordinate) for coordinate in point)
    renderer.SetWorldPoint(x, y, z, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    return x / SUPERSAMPLING, HEIGHT - y / SUPERSAMPLING


if __name__ == "__main__":
    main(Path(sys.argv[1]))
