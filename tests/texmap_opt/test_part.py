"""Reading, judging and repairing parts; every defect is built here and must be seen."""

import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from texmap_opt.builtin_part import builtin_part
from texmap_opt.case_sections import PartSection
from texmap_opt.edge_pairs import EdgePairs
from texmap_opt.errors import PartError
from texmap_opt.part import Part, read_part, read_surface
from texmap_opt.part_file import read_part_file, read_surface_file
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.thickness import thinnest_wall

PARTS = Path(__file__).parents[2] / "../shared/parts"
has_parts = pytest.mark.skipif(not PARTS.is_dir(), reason="the shared test parts are not here")


def box(low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0)):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    size = dict(zip(("length_mm", "width_mm", "height_mm"), (high - low).tolist(), strict=True))
    surface = builtin_part("cantilever", size)
    return TriMesh(surface.vertices + low, surface.faces)


def is_solid(surface):
    edges = EdgePairs(surface.faces)
    return edges.open.size == 0 and edges.crowded == 0 and bool(edges.agree.all())


def write_stl(path, surface):
    """Binary STL, little-endian, as in the format's 1989 description."""
    corners = surface.vertices[surface.faces].astype("<f4")
    records = b"".join(bytes(12) + c.tobytes() + bytes(2) for c in corners)
    path.write_bytes(bytes(80) + struct.pack("<I", len(corners)) + records)


def write_obj(path, surface):
    lines = ["v " + " ".join(map(repr, v)) for v in surface.vertices.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in f) for f in surface.faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


def write_ply(path, surface):
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(surface.vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(surface.faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    lines = [" ".join(map(repr, v)) for v in surface.vertices.tolist()]
    lines += ["3 " + " ".join(map(str, f)) for f in surface.faces.tolist()]
    path.write_text(head + "\n".join(lines) + "\n")


def write_3mf(path, surface, unit="millimeter"):
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in surface.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in surface.faces)
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?><model unit="{unit}" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{faces}'
        '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>'
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)


WRITERS = {".stl": write_stl, ".obj": write_obj, ".ply": write_ply, ".3mf": write_3mf}


@pytest.mark.parametrize("ending", WRITERS)
def test_a_box_is_read_from_every_format(ending, tmp_path):
    path = tmp_path / f"box{ending}"
    WRITERS[ending](path, box(high=(2.0, 3.0, 4.0)))
    part = read_surface(path, unit="mm")
    assert part.volume == pytest.approx(24)
    assert len(part.surface.vertices) == 8 and part.notes == () and part.name == path.name


def test_units_are_millimetres_inside(tmp_path):
    write_stl(tmp_path / "box.stl", box())
    for unit, mm in {"mm": 1, "cm": 10, "m": 1000, "in": 25.4}.items():
        assert read_surface(tmp_path / "box.stl", unit=unit).volume == pytest.approx(mm**3)
    with pytest.raises(PartError, match="not one of mm"):
        read_surface(tmp_path / "box.stl", unit="ft")


def test_a_size_that_suggests_another_unit_is_noted(tmp_path):
    write_stl(tmp_path / "small.stl", box(high=(0.1, 0.1, 0.1)))
    write_stl(tmp_path / "large.stl", box(high=(100.0, 100.0, 100.0)))
    (small,) = read_surface(tmp_path / "small.stl", unit="mm").notes
    (large,) = read_surface(tmp_path / "large.stl", unit="m").notes
    assert "very small, 0.173 mm" in small and "cm or m or in?" in small
    assert "very large, 1.73e+05 mm" in large and "mm or cm or in?" in large


def test_a_3mf_that_states_another_unit_is_noted(tmp_path):
    write_3mf(tmp_path / "box.3mf", box(high=(9.0, 9.0, 9.0)), unit="inch")
    (note,) = read_surface(tmp_path / "box.3mf", unit="mm").notes
    assert "says its unit is in" in note


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.step", b"x", "is not one of .stl"),
        ("part.stl", b"", "is empty"),
        ("part.stl", b"rubbish" * 40, "cannot be read|no triangles"),
        ("part.ply", b"ply\nformat ascii 1.0\n", "cannot be read"),
        ("part.3mf", b"PK not a zip", "cannot be read"),
        ("part.obj", b"# nothing\n", "cannot be read|no triangles"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cannot be read|does not have"),
    ],
)
def test_an_unreadable_file_is_one_sentence(name, content, words, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(PartError, match=words) as caught:
        read_surface(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(PartError, match=r"gone\.stl: there is no such file"):
        read_surface(tmp_path / "gone.stl")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_coordinates_that_are_not_numbers_are_counted(bad, tmp_path):
    surface = box()
    vertices = surface.vertices.copy()
    vertices[3, 1] = bad
    write_stl(tmp_path / "bad.stl", TriMesh(vertices, surface.faces))
    with pytest.raises(PartError, match="not finite"):
        read_surface(tmp_path / "bad.stl")


def test_split_vertices_are_welded_exactly_and_near_ones_only_on_open_edges(tmp_path):
    surface = box()
    split = TriMesh(surface.vertices[surface.faces].reshape(-1, 3), np.arange(36).reshape(12, 3))
    jitter = np.random.default_rng(0).uniform(-1e-7, 1e-7, split.vertices.shape)
    write_obj(tmp_path / "exact.obj", split)
    write_obj(tmp_path / "near.obj", TriMesh(split.vertices + jitter, split.faces))
    assert len(read_surface_file(tmp_path / "exact.obj").vertices) == 8
    near = read_part_file(tmp_path / "near.obj")
    assert len(near.surface.vertices) == 8 and "welded 28 vertices" in near.notes[0]
    far = TriMesh(split.vertices + 1e4 * jitter, split.faces)
    write_obj(tmp_path / "far.obj", far)
    assert len(read_surface_file(tmp_path / "far.obj").vertices) > 8


def test_a_part_answers_where_its_surface_is(tmp_path):
    part = Part(box(high=(2.0, 2.0, 2.0)), "box")
    closest, distance, face = part.closest(np.array([[1.0, 1.0, 1.5], [3.0, 1.0, 1.0]]))
    np.testing.assert_allclose(distance, [-0.5, 1.0])
    np.testing.assert_allclose(closest, [[1, 1, 2], [2, 1, 1]])
    assert face.shape == (2,) and list(part.contains(closest * 0.9)) == [True, True]
    assert part.area == pytest.approx(24) and part.diagonal == pytest.approx(np.sqrt(12))


def test_a_case_names_a_file_or_a_builtin_part(tmp_path):
    section = PartSection(builtin="torsion-bar", dimensions={"length_mm": 50.0})
    assert read_part(section).bounds[1, 0] == 50
    write_stl(tmp_path / "box.stl", box())
    file = replace(section, builtin=None, file="box.stl", unit="cm")
    assert read_part(file, tmp_path).volume == pytest.approx(1000)
    with pytest.raises(PartError, match="either file or builtin"):
        read_part(replace(file, file=None))


@pytest.mark.parametrize(
    ("name", "size", "wall"),
    [
        ("cantilever", {"height_mm": 3.0}, 3.0),
        ("torsion-bar", {"diameter_mm": 8.0}, 8.0),
        # From the bolt hole to the rim: inset less radius.
        ("bracket", {"bolt_inset_mm": 7.0}, 3.0),
        ("bracket", {"plate_mm": 4.0}, 4.0),
    ],
)
def test_the_thinnest_wall_is_found(name, size, wall):
    # Between a hole and a flat rim only one line is thinnest; 5 % are thinner than what is said.
    found = thinnest_wall(builtin_part(name, size))
    assert 0.99 * wall <= found <= 1.15 * wall


@has_parts
@pytest.mark.parametrize(
    ("name", "unit", "triangles", "volume", "note"),
    [
        ("beethoven.ply", "cm", 5026, 212.10e3, "dropped 2 zero-volume shells (2, 2 triangles)"),
        ("fandisk.obj", "cm", 12946, 20.24e3, ""),
        ("72214.stl", "mm", 1660, 30300, ""),
        ("spot.obj", "m", 5856, 0.718e9, ""),
    ],
)
def test_real_parts_have_their_known_facts(name, unit, triangles, volume, note):
    part = read_surface(PARTS / name, unit=unit)
    assert len(part.surface.faces) == triangles and is_solid(part.surface)
    assert part.volume == pytest.approx(volume, rel=5e-4)
    assert not note or note in part.notes


@has_parts
def test_the_statue_crosses_itself_a_little_and_says_so():
    part = read_surface(PARTS / "beethoven.ply", unit="cm")
    assert "30 of 5026 triangles cross others (33 pairs)" in part.notes[1]


@has_parts
def test_the_file_of_two_solids_is_counted_and_chosen_from():
    with pytest.raises(PartError, match=r"holds 2 solids \(volumes 1807, 595.4 mm³\)"):
        read_surface(PARTS / "112932.stl")
    for solid, genus_sum in ((1, 5260), (2, 2620)):
        part = read_surface(PARTS / "112932.stl", solid=solid)
        assert len(part.surface.faces) == genus_sum


@has_parts
def test_the_bunny_is_closed_with_a_report():
    part = read_surface(PARTS / "broken/stanford-bunny.obj", unit="m")
    assert "closed 5 holes (largest 80 edges)" in part.notes[0] and is_solid(part.surface)


@has_parts
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("teapot.obj", "open: 160 edges .* 6 holes .* 161 pairs of triangles cross"),
        ("suzanne.obj", "open: 42 edges .* cross each other"),
        ("openscad-nonmanifold-crash.obj", "edges have more than two triangles; .* cross"),
    ],
)
def test_broken_parts_are_refused_by_name_of_their_defects(name, words):
    with pytest.raises(PartError, match=words) as caught:
        read_surface(PARTS / "broken" / name, unit="cm")
    assert "\n" not in str(caught.value) and "Repair it" in str(caught.value)
