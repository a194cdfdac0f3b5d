"""Supports, and loads as consistent nodal forces, on straight and curved cells.

Every load is integrated against the shape functions, so the resultant force and moment of the
nodal forces are those of the load, whatever the mesh.

Loads follow the shape: each function takes `nodes`, positions to use instead of the mesh's. Where
`nodes`, or the load itself, is a JAX array, the function computes in JAX and returns a JAX array,
so that `jax.grad` of an objective sees how the load changes with them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, Int

from fea.errors import FeaError, position_text
from fea.load_values import Field, Values, constant, field
from fea.nodal_forces import (
    Facets,
    Forces,
    Nodes,
    check_area,
    forces_of_cells,
    forces_of_facets,
    in_cells,
    norms,
    on_facets,
)
from fea.precision import as_float64, refuse_single_precision
from fea.quadrature import TETRAHEDRON_1, TETRAHEDRON_5
from fea.tet_mesh import TetMesh

# N det J of a curved tet10 has degree 5.
CELL_RULE = TETRAHEDRON_5

# Weight needs N det J alone, which on a tet4 has degree 1.
WEIGHT_RULES = {4: TETRAHEDRON_1, 10: TETRAHEDRON_5}

# A load case with less than this share on free dofs loads nothing: the share is rounding.
LOADS_NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class Support:
    """Nodes whose displacement is prescribed; lists and integers are made arrays of float64.

    Attributes:
        nodes: their numbers, as from `TetMesh.nodes_where`.
        fixed: which of x, y, z are prescribed.
        value: prescribed displacement [mm], one for all nodes or one a node; read where `fixed`.

    Raises:
        FeaError: when nodes are not integers (a mask, say), or shapes are not these.
    """

    nodes: Int[np.ndarray, " nodes"]
    fixed: Bool[np.ndarray, " 3"]
    value: Float[np.ndarray, " 3"] | Float[np.ndarray, "nodes 3"]

    def __post_init__(self):
        nodes, fixed = np.asarray(self.nodes), np.asarray(self.fixed)
        value = as_float64(self.value, "Displacements of a support")
        if nodes.dtype == bool:
            raise FeaError(
                f"Nodes of a support are a mask of shape {nodes.shape}; give their numbers: "
                "np.flatnonzero(mask), or mesh.nodes_where(test)."
            )
        if nodes.ndim != 1 or (nodes.size and nodes.dtype.kind not in "iu"):
            raise FeaError(
                f"Nodes of a support are {nodes.dtype} of shape {nodes.shape}; give integers in one "
                "row, as mesh.nodes_where(test) does (np.unique makes one of facets)."
            )
        if fixed.dtype != bool or fixed.shape != (3,):
            raise FeaError(
                f"The directions that a support fixes are {fixed.dtype} of shape {fixed.shape}; give "
                "three truth values, for x, y and z."
            )
        if value.shape not in ((3,), (len(nodes), 3)):
            raise FeaError(
                f"Displacements of a support have shape {value.shape}; give x, y, z once, or in "
                f"{len(nodes)} rows, one a node."
            )
        for name, array in (("nodes", nodes.astype(np.int64)), ("fixed", fixed), ("value", value)):
            object.__setattr__(self, name, array)

    @classmethod
    def clamp(cls, nodes: Int[np.ndarray, " nodes"]) -> "Support":
        """All three displacements zero."""
        return cls(nodes, np.ones(3, dtype=bool), np.zeros(3))


def prescribed_dofs(
    supports: Sequence[Support], nodes: int
) -> tuple[Bool[np.ndarray, "nodes 3"], Float[np.ndarray, "nodes 3"]]:
    """Which displacements are prescribed, and their values [mm].

    Args:
        supports: they may overlap where they agree.
        nodes: number of nodes of the mesh.

    Raises:
        FeaError: when supports name no nodes or some that do not exist, prescribe what is not a
            number, or contradict each other.
    """
    fixed = np.zeros((nodes, 3), dtype=bool)
    value = np.zeros((nodes, 3))
    if not supports:
        return fixed, value
    count = [len(support.nodes) for support in supports]
    if 0 in count:
        raise FeaError(
            f"Support {count.index(0) + 1} names no node, so it holds nothing; widen the region that "
            "chooses its nodes, or leave it out."
        )
    owner = np.repeat(np.arange(1, len(supports) + 1), count)
    node = np.concatenate([support.nodes for support in supports])
    axes = np.repeat(np.stack([support.fixed for support in supports]), count, axis=0)
    given = np.concatenate(
        [np.broadcast_to(support.value, (len(support.nodes), 3)) for support in supports]
    )
    outside = (node < 0) | (node >= nodes)
    if outside.any():
        first = int(np.argmax(outside))
        raise FeaError(
            f"Support {owner[first]} names node {node[first]}, a node outside 0 to {nodes - 1}."
        )
    unknown = axes & ~np.isfinite(given)
    if unknown.any():
        row, axis = np.argwhere(unknown)[0]
        raise FeaError(
            f"Support {owner[row]} prescribes a displacement that is not a number "
            f"({given[row, axis]} along {'xyz'[axis]} at node {node[row]})."
        )
    # Written from last to first, the first support's value stays; one that differs finds another.
    row, axis = np.nonzero(axes)
    fixed[node[row], axis] = True
    value[node[row[::-1]], axis[::-1]] = given[row[::-1], axis[::-1]]
    clash = value[node[row], axis] != given[row, axis]
    if clash.any():
        one = int(np.argmax(clash))
        there = int(node[row[one]])
        raise FeaError(
            f"Support {owner[row[one]]} prescribes {given[row[one], axis[one]]:g} mm along "
            f"{'xyz'[axis[one]]} at node {there}, where another support prescribes "
            f"{value[there, axis[one]]:g} mm; make them agree."
        )
    return fixed, value


def traction_forces(
    mesh: TetMesh, facets: Facets, traction: Values | Field, *, nodes: Nodes | None = None
) -> Forces:
    """Nodal forces [N] of a traction [MPa] on facets.

    Args:
        mesh: the mesh.
        facets: rows of `mesh.boundary_facets`.
        traction: a vector, or a function from positions [n, 3] in mm to vectors [n, 3].
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when facets are not of this mesh, or the traction is not a number.
    """
    x, normal = on_facets(mesh, facets, nodes, traction)
    t = field(traction, x, (3,), "traction")
    return forces_of_facets(mesh, facets, norms(normal)[:, :, None] * t)


def pressure_forces(
    mesh: TetMesh, facets: Facets, pressure: Values | Field, *, nodes: Nodes | None = None
) -> Forces:
    """Nodal forces [N] of a pressure [MPa]; positive pushes against the outward normal.

    Args:
        mesh: the mesh.
        facets: rows of `mesh.boundary_facets`.
        pressure: a number, or a function from positions [n, 3] in mm to numbers [n].
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when facets are not of this mesh, or the pressure is not a number.
    """
    x, normal = on_facets(mesh, facets, nodes, pressure)
    p = field(pressure, x, (), "pressure")
    return forces_of_facets(mesh, facets, -p[:, :, None] * normal)


def force_on_facets(
    mesh: TetMesh, facets: Facets, force: Values, *, nodes: Nodes | None = None
) -> Forces:
    """Nodal forces [N] of a resultant force [N] spread over facets as a uniform traction.

    Args:
        mesh: the mesh.
        facets: rows of `mesh.boundary_facets`.
        force: the resultant, a vector.
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when facets have no area or are not of this mesh, or the force is not a number.
    """
    check_area(mesh, facets)
    _, normal = on_facets(mesh, facets, nodes, force)
    area = norms(normal)
    t = constant(force, (3,), "force") / area.sum()
    return forces_of_facets(mesh, facets, area[:, :, None] * t[None, None, :])


def moment_on_facets(
    mesh: TetMesh, facets: Facets, moment: Values, *, nodes: Nodes | None = None
) -> Forces:
    """Nodal forces [N] of a moment [N mm] about the facets' centroid, with zero resultant force.

    The traction is t = a x (x - c), c the centroid; then M = J a with the facets' second moment
    of area J = ∫ |r|² 1 - r rᵀ, r = x - c.

    Args:
        mesh: the mesh.
        facets: rows of `mesh.boundary_facets`.
        moment: a vector, by the right-hand rule.
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when facets have no area or are not of this mesh, or the moment is not a number.
    """
    check_area(mesh, facets)
    x, normal = on_facets(mesh, facets, nodes, moment)
    xp = normal.__array_namespace__()
    area = norms(normal)
    r = x - (xp.einsum("fq,fqx->x", area, x) / area.sum())[None, None, :]
    second = xp.einsum("fq,fqx,fqy->xy", area, r, r)
    M = constant(moment, (3,), "moment")
    a = xp.linalg.solve(xp.trace(second) * np.eye(3) - second, M[:, None])[:, 0]
    return forces_of_facets(mesh, facets, area[:, :, None] * xp.cross(a[None, None, :], r))


def gravity_forces(
    mesh: TetMesh, density: Values, g: Values, *, nodes: Nodes | None = None
) -> Forces:
    """Nodal forces [N] of the weight.

    Args:
        mesh: the mesh.
        density: [tonne/mm³], one for all cells or one a cell.
        g: acceleration, a vector [mm/s²]; 9810 towards the ground.
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when density or acceleration are not numbers, or not of these shapes, or the
            density is negative, or zero everywhere.
    """
    rule = WEIGHT_RULES[mesh.tets.shape[1]]
    _, volume = in_cells(mesh, nodes, rule, density, g)
    cells = (len(mesh.tets),)
    rho = constant(density, cells if np.ndim(density) else (), "density")
    _check_density(rho)
    mass = volume * (rho[:, None] if rho.ndim else rho)
    acceleration = constant(g, (3,), "acceleration")
    return forces_of_cells(mesh, mass[:, :, None] * acceleration[None, None, :], rule)


def body_forces(mesh: TetMesh, force: Values | Field, *, nodes: Nodes | None = None) -> Forces:
    """Nodal forces [N] of a force per volume [N/mm³].

    Args:
        mesh: the mesh.
        force: a vector, or a function from positions [n, 3] in mm to vectors [n, 3].
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when the force is not a number.
    """
    x, volume = in_cells(mesh, nodes, CELL_RULE, force)
    b = field(force, x, (3,), "force per volume")
    return forces_of_cells(mesh, volume[:, :, None] * b, CELL_RULE)


def load_on_supports(
    fixed: Bool[np.ndarray, "nodes dofs"], forces: Float[np.ndarray, "cases nodes dofs"]
) -> Float[np.ndarray, " cases"]:
    """Share of each load case that acts on fixed dofs: it goes into the supports, and loads nothing.

    By sum of magnitudes: of the forces, or of a frame's moments where theirs is larger, as N and
    N mm do not add up. Zero for a case without loads.

    Args:
        fixed: dofs whose displacement is prescribed.
        forces: nodal forces, and moments.
    """
    total, held = _loads_and_held(fixed, forces)
    return (held / np.where(total > 0, total, 1.0)).max(axis=1)


def _loads_and_held(
    fixed: Bool[np.ndarray, "nodes dofs"], forces: Float[np.ndarray, "cases nodes dofs"]
) -> tuple[Float[np.ndarray, "cases kinds"], Float[np.ndarray, "cases kinds"]]:
    """Sums of magnitudes, of forces and (frames) of moments: of all, and of those on fixed dofs."""
    size = np.abs(forces).reshape(*forces.shape[:2], -1, 3)
    held = fixed.astype(float).reshape(len(fixed), -1, 3)
    return size.sum(axis=(1, 3)), np.einsum("snkx,nkx->sk", size, held)


def check_loads(
    fixed: Bool[np.ndarray, "nodes dofs"],
    forces: Float[np.ndarray, "..."],
    *,
    moved: bool = False,
    points: Float[np.ndarray, "nodes 3"] | None = None,
) -> None:
    """Raise unless every load case is a load that can be solved for.

    Args:
        fixed: dofs whose displacement is prescribed.
        forces: nodal forces, [cases, nodes, dofs]; of a frame moments too.
        moved: whether supports prescribe displacements other than zero; then a load case that is
            zero, or acts on supports alone, still has an answer.
        points: positions of the nodes [mm], for the message.

    Raises:
        FeaError: for forces of another number of nodes, in single precision or not numbers, or a
            load case that is zero or whose forces and moments act on fixed dofs only.
    """
    if forces.ndim != 3 or forces.shape[1:] != fixed.shape:
        raise FeaError(
            f"Forces have shape {forces.shape}; give one of shape {fixed.shape} for each load case."
        )
    refuse_single_precision(forces, "Forces")
    finite = np.isfinite(forces)
    if not finite.all():
        case, node, dof = np.argwhere(~finite)[0]
        raise FeaError(
            f"Load case {case} (from 0) has a force that is not a number, {forces[case, node, dof]}"
            f" at node {node}; check the load that it comes from."
        )
    if moved:
        return
    total, held = _loads_and_held(fixed, forces)
    empty = np.flatnonzero(~total.any(axis=1))
    if empty.size:
        raise FeaError(
            f"Load case {empty[0]} (from 0) is zero, so there is nothing to solve; give it a load, "
            "leave it out, or prescribe a displacement."
        )
    # Each kind against itself: a large moment on a held joint does not hide a force elsewhere.
    useless = np.flatnonzero((total - held <= LOADS_NOTHING * total).all(axis=1))
    if useless.size:
        case = int(useless[0])
        node = int(np.abs(forces[case]).max(axis=1).argmax())
        where = "" if points is None else f" at {position_text(points[node])} mm"
        raise FeaError(
            f"Load case {case} (from 0) acts only where the structure is held, so nothing is loaded "
            f"(most of it is on node {node}{where}); move the load away from the supports, or "
            "release them there."
        )


def _check_density(density: Any) -> None:
    if isinstance(density, Tracer):
        return
    least, most = float(density.min()), float(density.max())
    if least < 0:
        raise FeaError(f"The density is {least:g} tonne/mm³ somewhere; it must not be negative.")
    if most == 0:
        raise FeaError(
            "The density is zero, so nothing has weight; give the material its own, such as 7.85e-9 "
            "tonne/mm³ of steel."
        )
