"""Booleans of solids and of outlines in a plane, exact to rounding; the only user of manifold3d.

Solids go through `Mesh64`, so vertices stay in double precision, and every result's status is
looked at: manifold3d answers a bad input with an empty solid, not with an exception. Outlines are
rounded to 1e-8 mm, the fixed grid on which Clipper2 computes.
"""

from collections.abc import Sequence

import manifold3d as m3
import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import SolidError
from texmap_opt.solid.tri_mesh import TriMesh

# Solids a union takes at once before the groups are united in turn. Measured on 8,820 octet struts:
# one batch of everything 13.9 s, groups of 30 to 200 neighbours 10.8 s.
UNION_GROUP = 128

_MEANING = {
    m3.Error.NonFiniteVertex: "a vertex is not a finite number",
    m3.Error.InvalidConstruction: "its construction is invalid",
    m3.Error.NotManifold: "some edge does not join exactly two opposite triangles",
    m3.Error.VertexOutOfBounds: "a triangle names a vertex that does not exist",
    m3.Error.ResultTooLarge: "the result has too many triangles",
}
_REMEDY = "Run `texmap check` on it; a coarser tolerance_mm or fewer cells gives a smaller solid."


def union(solids: Sequence[TriMesh]) -> TriMesh:
    """Union of any number of closed, outward oriented surfaces; neighbours are united first."""
    return _surface(_union([_manifold(solid) for solid in solids]))


def difference(minuend: TriMesh, *subtrahends: TriMesh) -> TriMesh:
    """What remains of `minuend` outside all `subtrahends`."""
    solids = [_manifold(solid) for solid in (minuend, *subtrahends)]
    return _surface(m3.Manifold.batch_boolean(solids, m3.OpType.Subtract))


def intersection(*solids: TriMesh) -> TriMesh:
    """What is inside all `solids`."""
    return _surface(m3.Manifold.batch_boolean([_manifold(s) for s in solids], m3.OpType.Intersect))


def carved(body: TriMesh, hollow: TriMesh, kept: TriMesh, holes: Sequence[TriMesh] = ()) -> TriMesh:
    """`body` less what of `hollow` is not in `kept`, less all `holes`.

    As differences of surfaces it takes twice as long: most of that is turning surfaces into solids.
    """
    void = m3.Manifold.batch_boolean([_manifold(hollow), _manifold(kept)], m3.OpType.Subtract)
    solids = [_manifold(body), void, *(_manifold(hole) for hole in holes)]
    return _surface(m3.Manifold.batch_boolean(solids, m3.OpType.Subtract))


def shells(surface: TriMesh) -> list[TriMesh]:
    """The connected closed surfaces a surface consists of, in the order they come out.

    A solid with a closed void has two: the outer one of positive volume, the inner one negative.
    """
    return [_surface(shell) for shell in _manifold(surface).decompose()]


def overlap_volume(solids: Sequence[TriMesh]) -> float:
    """Sum of the solids' volumes less the volume of their union [mm³]: 0 when disjoint."""
    manifolds = [_manifold(solid) for solid in solids]
    return sum(each.volume() for each in manifolds) - _union(manifolds).volume()


def split_by_plane(
    surface: TriMesh, normal: Float[np.ndarray, " 3"], offset: float
) -> tuple[TriMesh, TriMesh]:
    """The parts of a solid in front of and behind the plane `normal . x = offset`, both closed."""
    length = float(np.linalg.norm(normal))
    x, y, z = (float(c) / length for c in normal)
    front, back = _manifold(surface).split_by_plane((x, y, z), offset / length)
    return _surface(front), _surface(back)


def simplified(surface: TriMesh, tolerance: float) -> TriMesh:
    """A surface of fewer triangles within `tolerance` [mm], with a subset of the vertices."""
    # `as_original` first: triangles from different sources are merged only in an original.
    return _surface(_manifold(surface).as_original().simplify(tolerance))


def outline_union(
    polygons: Sequence[Float[np.ndarray, "_ 2"]],
) -> list[Float[np.ndarray, "_ 2"]]:
    """Outline of what any of the polygons covers: outer polygons counter-clockwise, holes clockwise.

    Args:
        polygons: counter-clockwise; they may overlap.
    """
    return m3.CrossSection(list(polygons), m3.FillRule.Positive).to_polygons()


def shadow(
    surface: TriMesh, axes: Float[np.ndarray, "3 3"], *, tolerance: float
) -> list[Float[np.ndarray, "_ 2"]]:
    """Outline of a solid seen along an axis, in coordinates along the two others.

    Args:
        surface: closed, outward oriented [mm].
        axes: unit vectors as rows, right-handed; the third is the direction of sight.
        tolerance: corners closer than this to the line through their neighbours are left out [mm].
    """
    turned = _manifold(TriMesh(surface.vertices @ axes.T, surface.faces))
    return turned.project().simplify(tolerance).to_polygons()


def inset(
    outline: Sequence[Float[np.ndarray, "_ 2"]], distance: float, *, tolerance: float
) -> list[Float[np.ndarray, "_ 2"]]:
    """Outline of what lies at least a distance inside another; none where nothing does.

    Args:
        outline: outer polygons counter-clockwise, holes clockwise, none crossing another [mm].
        distance: 0 for the outline itself [mm].
        tolerance: corners closer than this to the line through their neighbours are left out [mm].
    """
    shape = m3.CrossSection(list(outline)).offset(-distance, m3.JoinType.Miter)
    return shape.simplify(tolerance).to_polygons()


def closing(
    outline: Sequence[Float[np.ndarray, "_ 2"]], radius: float, *, segments: int
) -> list[Float[np.ndarray, "_ 2"]]:
    """An outline grown by a radius and shrunk by it: hollow corners get that radius, no others.

    Args:
        outline: outer polygons counter-clockwise, holes clockwise, none crossing another [mm].
        radius: of the fillets [mm].
        segments: of a whole circle of that radius.
    """
    grown = m3.CrossSection(list(outline)).offset(
        radius, m3.JoinType.Round, circular_segments=segments
    )
    shrunk = grown.offset(-radius, m3.JoinType.Round, circular_segments=segments)
    return shrunk.to_polygons()


def prism(
    outline: Sequence[Float[np.ndarray, "_ 2"]],
    axes: Float[np.ndarray, "3 3"],
    heights: Float[np.ndarray, " 2"],
) -> TriMesh:
    """The solid over an outline, the inverse of `shadow`.

    Args:
        outline: outer polygons counter-clockwise, holes clockwise, none crossing another [mm].
        axes: unit vectors as rows, right-handed; the outline has coordinates along the first two.
        heights: coordinates of its two ends along the third [mm].

    Raises:
        SolidError: when nothing comes out.
    """
    low, high = (float(height) for height in heights)
    upright = _surface(m3.Manifold.extrude(m3.CrossSection(list(outline)), high - low))
    raised = upright.vertices + np.array([0.0, 0.0, low])
    return TriMesh(raised @ axes, upright.faces)


def genus(surface: TriMesh) -> int:
    """Genus, 1 - (V - E + F)/2; of several shells the sum of theirs less their number, plus 1."""
    return int(_manifold(surface).genus())


def fault(surface: TriMesh) -> str:
    """Why manifold3d refuses a surface, in words; empty when it accepts it."""
    status = _unchecked(surface).status()
    return "" if status == m3.Error.NoError else _MEANING.get(status, str(status))


def _union(solids: list[m3.Manifold]) -> m3.Manifold:
    groups = _neighbours([solid.bounding_box() for solid in solids])
    united = [m3.Manifold.batch_boolean([solids[i] for i in g], m3.OpType.Add) for g in groups]
    return m3.Manifold.batch_boolean(united, m3.OpType.Add)


def _neighbours(boxes: list[tuple[float, ...]]) -> list[Int[np.ndarray, " members"]]:
    """Indices in groups of at most UNION_GROUP, halved along the longest side of their extent."""
    if not boxes:
        return []
    bounds = np.array(boxes)
    centres = (bounds[:, :3] + bounds[:, 3:]) / 2
    # Deterministic: a stable sort, and the order of the input where centres are equal.
    pending, groups = [np.arange(len(boxes))], []
    while pending:
        members = pending.pop()
        if len(members) <= UNION_GROUP:
            groups.append(members)
            continue
        axis = int(np.argmax(np.ptp(centres[members], axis=0)))
        members = members[np.argsort(centres[members, axis], kind="stable")]
        half = len(members) // 2
        pending += [members[half:], members[:half]]
    return groups


def _unchecked(surface: TriMesh) -> m3.Manifold:
    vertices = np.array(surface.vertices, dtype=np.float64, order="C")
    faces = np.array(surface.faces, dtype=np.uint64, order="C")
    return m3.Manifold(m3.Mesh64(vertices, faces))


def _manifold(surface: TriMesh) -> m3.Manifold:
    return _checked(_unchecked(surface), "A surface cannot enter a boolean")


def _surface(solid: m3.Manifold) -> TriMesh:
    mesh = _checked(solid, "A boolean failed").to_mesh64()
    return TriMesh(
        np.array(mesh.vert_properties, dtype=np.float64)[:, :3],
        np.array(mesh.tri_verts, dtype=np.int64),
    )


def _checked(solid: m3.Manifold, what: str) -> m3.Manifold:
    status = solid.status()
    if status != m3.Error.NoError:
        raise SolidError(f"{what}: {_MEANING.get(status, str(status))}. {_REMEDY}")
    return solid
