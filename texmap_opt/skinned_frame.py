"""What a skin makes of a frame: strut ends tied to shells, and struts that lie in the skin.

Decision notes: docs/decisions/0002-supports-and-loads-on-frames.md, and for walls
docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea import TetMesh
from fea.couplings import Tie
from fea.elements import TRIANGLE_EDGES
from fea.errors import position_text
from fea.frame_checks import pieces_of
from fea.skin import Skin
from texmap_opt.case import DesignCase
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.plane_sheet import PlaneSheet
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.skin_mesh import SkinMesh
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.trim import FUSED, held_by_skin, joint_radii

# Points along a strut at which it is asked how deep it lies; the depth is linear between.
SAMPLES = 17

# Section of a strut that the skin holds altogether, over its own: of no weight, and not singular.
ABSENT = 1e-6


@dataclass(frozen=True, eq=False)
class FrameSkin:
    """The skin of a frame, and how the struts hang on it.

    Attributes:
        mesh: the middle surface, or the sheet that plates and rim of walls are; its vertices are
            joints of the frame, after those of the struts.
        shell: the same with its material, numbered among all joints.
        tie: fastens the joints that the skin holds to triangles.
        rigid_ends: length at each end of a strut that lies in the skin and so moves with it [mm].
        beyond: distance from the axis of a strut along the skin to the inner face of the skin [mm],
            negative when the axis lies below it; minus infinity for the others.
        longest_arm: largest distance of a joint from where it is fastened [mm].
        plates: how much of each wall's depth lies in the plates at its ends [mm]; None: struts are
            bars.
    """

    mesh: SkinMesh | PlaneSheet
    shell: Skin
    tie: Tie
    rigid_ends: Float[np.ndarray, "struts 2"]
    beyond: Float[np.ndarray, " struts"]
    longest_arm: float
    plates: Float[np.ndarray, " struts"] | None = None

    def shares(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, " struts"]:
        """Share of each strut's section that the skin does not hold already, in JAX.

        The segment of its circle beyond the chord on the inner face of the skin; of a wall the part
        of its thickness beyond the inner face of the rim.
        """
        along = np.isfinite(self.beyond)
        x = np.where(along, self.beyond, 0.0) / jnp.mean(jnp.asarray(radii), axis=1)
        if self.plates is not None:
            return jnp.maximum(jnp.where(along, jnp.clip((1 - x) / 2, 0.0, 1.0), 1.0), ABSENT)
        cuts = along & (jnp.abs(x) < 1)
        # Values that are not taken must not be singular: their derivative counts.
        inner = jnp.where(cuts, x, 0.0)
        segment = (jnp.arccos(inner) - inner * jnp.sqrt(1 - inner**2)) / jnp.pi
        whole = jnp.where(along & (x >= 1), 0.0, 1.0)
        return jnp.maximum(jnp.where(cuts, segment, whole), ABSENT)


def frame_skin(
    structure: Structure, part: Part, case: DesignCase, mesh: TetMesh
) -> tuple[FrameSkin, SkinMesh]:
    """The skin that a lattice hangs on, and its middle surface.

    Args:
        structure: the trimmed lattice.
        part: what it fills.
        case: the skin's thickness and material.
        mesh: tets of the part.

    Raises:
        LatticeError: a strut ends at the part's surface, but the skin's triangles are elsewhere, or
            the skin, that of a cavity for instance, holds no strut.
    """
    skin = SkinMesh.of(mesh, case.lattice.skin_mm)
    depth = part.signed_distance.unsigned(structure.joints)[0]
    held = np.flatnonzero(
        held_by_skin(structure.cut, depth, joint_radii(structure), case.lattice.skin_mm)
    )
    if len(held) == 0:
        raise LatticeError(
            f"{case.path.name}: [lattice] skin_mm = {case.lattice.skin_mm:g}: no strut reaches the "
            "skin, so nothing holds the lattice; use smaller cells."
        )
    tie, face, distance = tied_joints(structure, held, skin.surface, case)
    _check_every_skin_is_held(skin.surface, face, case)
    thickness = np.zeros(len(structure.joints))
    thickness[held] = skin.thickness[face]
    rigid_ends, beyond = within_skin(structure, part, thickness)
    first = len(structure.joints)
    shell = Skin(skin.surface.faces + first, skin.thickness, E=case.material.E, nu=case.material.nu)
    return FrameSkin(skin, shell, tie, rigid_ends, beyond, float(distance.max())), skin


def forces_on_skin(
    mesh: TetMesh, skin: SkinMesh, nodal: Float[np.ndarray, "nodes 3"]
) -> Float[np.ndarray, "vertices 6"]:
    """Forces [N] and moments [N mm] on the skin's vertices of forces on nodes of the surface.

    Half the force on a mid-edge node goes to either end of its edge; the moment of each about the
    place where it was stays.
    """
    vertex = np.full(len(mesh.nodes), -1)
    vertex[skin.nodes] = np.arange(len(skin.nodes))
    facets = mesh.boundary_facets
    sources, targets, shares = (
        [skin.nodes],
        [np.arange(len(skin.nodes))],
        [np.ones(len(skin.nodes))],
    )
    if facets.shape[1] > 3:
        middle, first = np.unique(facets[:, 3:], return_index=True)
        ends = vertex[facets[:, TRIANGLE_EDGES].reshape(-1, 2)[first]]
        sources += [np.repeat(middle, 2)]
        targets += [ends.ravel()]
        shares += [np.full(2 * len(middle), 0.5)]
    source, target = np.concatenate(sources), np.concatenate(targets)
    force = np.concatenate(shares)[:, None] * nodal[source]
    arm = mesh.nodes[source] - skin.surface.vertices[target]
    both = np.hstack([force, np.cross(arm, force)])
    result = np.zeros((len(skin.nodes), 6))
    np.add.at(result, target, both)
    return result


def tied_joints(
    structure: Structure, held: Int[np.ndarray, " held"], surface: TriMesh, case: DesignCase
) -> tuple[Tie, Int[np.ndarray, " held"], Float[np.ndarray, " held"]]:
    """Joints fastened to the nearest points of the skin, the triangles these lie in, and how far.

    Args:
        structure: the lattice.
        held: its joints that are fastened.
        surface: the skin's triangles.
        case: thickness of the skin, and the file in messages.

    Raises:
        LatticeError: a joint that is farther off than the triangles explain.
    """
    points = structure.joints[held]
    distance, face, foot = SignedDistance(surface).unsigned(points)
    _check_meets(structure, held, distance, surface, face, case)
    corners = surface.faces[face]
    shape = barycentric(surface.vertices[corners], foot)
    return Tie(held, corners + len(structure.joints), shape), face, distance


def _check_meets(
    structure: Structure,
    held: Int[np.ndarray, " held"],
    distance: Float[np.ndarray, " held"],
    surface: TriMesh,
    face: Int[np.ndarray, " held"],
    case: DesignCase,
) -> None:
    """Refuse strut ends that are farther from the skin than its triangles explain."""
    x = surface.vertices[surface.faces[face]]
    longest = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1)
    reach = case.lattice.skin_mm + joint_radii(structure)[held] + longest / 2
    off = distance - reach
    worst = int(np.argmax(off))
    if off[worst] > 0:
        raise LatticeError(
            f"{case.path.name}: [analysis] edge_mm: the strut that ends at "
            f"{position_text(structure.joints[held[worst]])} mm misses the skin's triangles by "
            f"{distance[worst]:.3g} mm, more than {reach[worst]:.3g} mm; a smaller edge_mm makes them "
            "follow the part."
        )


def _check_every_skin_is_held(
    surface: TriMesh, face: Int[np.ndarray, " held"], case: DesignCase
) -> None:
    """Refuse a closed surface, such as that of a cavity, whose skin no strut reaches."""
    piece = pieces_of(len(surface.vertices), [surface.faces])[1]
    bare = np.flatnonzero(~np.isin(piece, piece[surface.faces[face, 0]]))
    if len(bare):
        middle = surface.vertices[piece == piece[bare[0]]].mean(axis=0)
        raise LatticeError(
            f"{case.path.name}: [lattice] skin_mm = {case.lattice.skin_mm:g}: no strut reaches the "
            f"skin of the cavity about {position_text(middle)} mm, so it hangs in the air; fill the "
            "cavity, or use smaller cells."
        )


def barycentric(
    corners: Float[np.ndarray, "n 3 3"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Barycentric coordinates of points that lie in triangles, from 0 to 1, of sum 1."""
    a, b, c = np.moveaxis(corners, 1, 0)
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = (np.einsum("ni,ni->n", p, q) for p, q in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("ni,ni->n", w, u), np.einsum("ni,ni->n", w, v)
    det = uu * vv - uv**2
    s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
    shape = np.clip(np.stack([1 - s - t, s, t], axis=1), 0.0, 1.0)
    return shape / shape.sum(axis=1, keepdims=True)


def within_skin(
    structure: Structure, part: Part, thickness: Float[np.ndarray, " joints"]
) -> tuple[Float[np.ndarray, "struts 2"], Float[np.ndarray, " struts"]]:
    """Lengths at both ends that lie in the skin, and how far struts along the skin lie above its face.

    Args:
        structure: the lattice.
        part: gives depths.
        thickness: of the skin that holds each joint; zero where none does [mm].
    """
    skin = thickness[structure.struts]
    some = np.flatnonzero(skin.any(axis=1))
    ends = structure.joints[structure.struts[some]]
    along = np.linspace(0, 1, SAMPLES)
    points = ends[:, :1] + along[:, None] * (ends[:, 1:] - ends[:, :1])
    depth = part.signed_distance.unsigned(points.reshape(-1, 3))[0].reshape(len(some), SAMPLES)
    length = structure.lengths()[some]
    rigid = np.stack(
        [_entry(depth, skin[some, 0]) * length, _entry(depth[:, ::-1], skin[some, 1]) * length],
        axis=1,
    )
    both = skin[some].min(axis=1) > 0
    inner = skin[some].mean(axis=1)
    deepest = depth.max(axis=1)
    lies = both & (deepest <= inner + FUSED * structure.radii[some].mean(axis=1))
    rigid_ends = np.zeros(structure.struts.shape)
    rigid_ends[some] = np.where(lies[:, None], 0.0, rigid)
    beyond = np.full(len(structure.struts), -np.inf)
    beyond[some[lies]] = inner[lies] - deepest[lies]
    return rigid_ends, beyond


def _entry(
    depth: Float[np.ndarray, "struts samples"], thickness: Float[np.ndarray, " struts"]
) -> Float[np.ndarray, " struts"]:
    """Position 0 to 1 along each strut at which it first is deeper than the skin is thick."""
    below = depth > thickness[:, None]
    first = np.argmax(below, axis=1)
    before = np.maximum(first - 1, 0)
    rows = np.arange(len(depth))
    d0, d1 = depth[rows, before], depth[rows, first]
    rise = np.where(first > 0, d1 - d0, 1.0)
    position = (before + (thickness - d0) / rise) / (depth.shape[1] - 1)
    return np.where(first > 0, position, 0.0)
