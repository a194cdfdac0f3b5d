"""Supports, and loads as consistent nodal forces, on straight and curved cells.

Every load is integrated against the shape functions, so the resultant force and moment of the
nodal forces are those of the load, whatever the mesh.

Loads follow the shape: each function takes `nodes`, positions to use instead of the mesh's. Where
`nodes`, or the load itself, is a JAX array, the function computes in JAX and returns a JAX array,
so that `jax.grad` of an objective sees how the load changes with them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from fea.elements import TETRAHEDRA, TRIANGLES
from fea.errors import FeaError
from fea.isoparametric import cell_points, facet_points
from fea.precision import refuse_single_precision
from fea.quadrature import TETRAHEDRON_1, TETRAHEDRON_5, TRIANGLE_4, Quadrature
from fea.tet_mesh import TetMesh

# N times the normal of a curved tri6 has degree 4, and N times a quadratic load on a straight one.
FACET_RULE = TRIANGLE_4

# N det J of a curved tet10 has degree 5.
CELL_RULE = TETRAHEDRON_5

# Weight needs N det J alone, which on a tet4 has degree 1.
WEIGHT_RULES = {4: TETRAHEDRON_1, 10: TETRAHEDRON_5}

# A load case with less than this share on free dofs loads nothing: the share is rounding.
LOADS_NOTHING = 1e-9

Values = Float[np.ndarray | Array, "..."]
Nodes = Float[np.ndarray | Array, "nodes 3"]
# Of the kind of what goes in: NumPy, or JAX where anything that goes in is.
Forces = Float[Any, "nodes 3"]
Facets = Int[np.ndarray, "facets corners"]
# A field over space: from positions, one a row, to a value for each.
Field = Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class Support:
    """Nodes whose displacement is prescribed.

    Attributes:
        nodes: the nodes.
        fixed: which of x, y, z are prescribed.
        value: prescribed displacement [mm], one for all nodes or one a node; read where `fixed`.
    """

    nodes: Int[np.ndarray, " nodes"]
    fixed: Bool[np.ndarray, " 3"]
    value: Float[np.ndarray, " 3"] | Float[np.ndarray, "nodes 3"]

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
        FeaError: when supports name nodes that do not exist, prescribe what is not a number, are
            in single precision, or contradict each other.
    """
    fixed = np.zeros((nodes, 3), dtype=bool)
    value = np.zeros((nodes, 3))
    if not supports:
        return fixed, value
    for number, support in enumerate(supports, start=1):
        refuse_single_precision(support.value, f"Values of support {number}")
    count = [len(support.nodes) for support in supports]
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
    x, normal = _facets(mesh, facets, nodes, traction)
    t = _field(traction, x, (3,), "traction")
    return _spread(mesh, facets, _norm(normal)[:, :, None] * t)


def pressure_forces(
    mesh: TetMesh, facets: Facets, pressure: float | Values | Field, *, nodes: Nodes | None = None
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
    x, normal = _facets(mesh, facets, nodes, pressure)
    p = _field(pressure, x, (), "pressure")
    return _spread(mesh, facets, -p[:, :, None] * normal)


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
    _check_area(mesh, facets)
    _, normal = _facets(mesh, facets, nodes, force)
    area = _norm(normal)
    t = _constant(force, (3,), "force") / area.sum()
    return _spread(mesh, facets, area[:, :, None] * t[None, None, :])


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
    _check_area(mesh, facets)
    x, normal = _facets(mesh, facets, nodes, moment)
    xp = normal.__array_namespace__()
    area = _norm(normal)
    r = x - (xp.einsum("fq,fqx->x", area, x) / area.sum())[None, None, :]
    second = xp.einsum("fq,fqx,fqy->xy", area, r, r)
    M = _constant(moment, (3,), "moment")
    a = xp.linalg.solve(xp.trace(second) * np.eye(3) - second, M[:, None])[:, 0]
    return _spread(mesh, facets, area[:, :, None] * xp.cross(a[None, None, :], r))


def gravity_forces(
    mesh: TetMesh, density: float | Values, g: Values, *, nodes: Nodes | None = None
) -> Forces:
    """Nodal forces [N] of the weight.

    Args:
        mesh: the mesh.
        density: [tonne/mm³], one for all cells or one a cell.
        g: acceleration, a vector [mm/s²]; 9810 towards the ground.
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when density or acceleration are not numbers, or not of these shapes.
    """
    rule = WEIGHT_RULES[mesh.tets.shape[1]]
    _, volume = _cells(mesh, nodes, rule, density, g)
    cells = (len(mesh.tets),)
    rho = _constant(density, cells if np.ndim(density) else (), "density")
    mass = volume * (rho[:, None] if rho.ndim else rho)
    g = _constant(g, (3,), "acceleration")
    return _into_cells(mesh, mass[:, :, None] * g[None, None, :], rule)


def body_forces(mesh: TetMesh, force: Values | Field, *, nodes: Nodes | None = None) -> Forces:
    """Nodal forces [N] of a force per volume [N/mm³].

    Args:
        mesh: the mesh.
        force: a vector, or a function from positions [n, 3] in mm to vectors [n, 3].
        nodes: positions to use instead of the mesh's.

    Raises:
        FeaError: when the force is not a number.
    """
    x, volume = _cells(mesh, nodes, CELL_RULE, force)
    b = _field(force, x, (3,), "force per volume")
    return _into_cells(mesh, volume[:, :, None] * b, CELL_RULE)


def load_on_supports(
    fixed: Bool[np.ndarray, "nodes dofs"], forces: Float[np.ndarray, "cases nodes dofs"]
) -> Float[np.ndarray, " cases"]:
    """Share of each load case's forces, by sum of magnitudes, that acts on fixed dofs.

    Such forces go into the supports and load nothing else. Zero for a case without forces.

    Args:
        fixed: dofs whose displacement is prescribed.
        forces: nodal forces.
    """
    size = np.abs(forces)
    total = size.sum(axis=(1, 2))
    held = np.einsum("snd,nd->s", size, fixed.astype(float))
    return held / np.where(total > 0, total, 1.0)


def check_loads(
    fixed: Bool[np.ndarray, "nodes dofs"], forces: Float[np.ndarray, "..."], *, moved: bool = False
) -> None:
    """Raise unless every load case is a load that can be solved for.

    Args:
        fixed: dofs whose displacement is prescribed.
        forces: nodal forces, [cases, nodes, dofs].
        moved: whether supports prescribe displacements other than zero; then a load case that
            acts on supports alone still has an answer.

    Raises:
        FeaError: for forces of another number of nodes, in single precision or not numbers, or a
            load case, not zero, whose forces act on fixed dofs only.
    """
    if forces.shape[1:] != fixed.shape:
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
    share = load_on_supports(fixed, forces)
    useless = np.flatnonzero(share > 1 - LOADS_NOTHING)
    if useless.size:
        raise FeaError(
            f"Load case {useless[0]} (from 0) acts only where the structure is held, so nothing is "
            "loaded; move the load away from the supports, or release them there."
        )


def _namespace(*given: object) -> Any:
    return jnp if any(isinstance(value, jax.Array) for value in given) else np


def _facets(
    mesh: TetMesh, facets: Facets, nodes: Nodes | None, load: object
) -> tuple[Values, Values]:
    """Quadrature points of facets, normals times area there."""
    corners = 3 if mesh.element == "tet4" else 6
    if facets.ndim != 2 or facets.shape[1] != corners:
        raise FeaError(
            f"Facets have shape {facets.shape}; a {mesh.element} mesh takes {corners} nodes a row, "
            "as in mesh.boundary_facets[chosen] or mesh.facets_where(test)."
        )
    if facets.size and not 0 <= facets.min() <= facets.max() < len(mesh.nodes):
        raise FeaError(
            f"Facets refer to nodes {facets.min()} to {facets.max()}, but the mesh has nodes 0 to "
            f"{len(mesh.nodes) - 1}; take them from this mesh."
        )
    return facet_points(_positions(mesh, nodes, load)[facets], FACET_RULE)


def _cells(
    mesh: TetMesh, nodes: Nodes | None, rule: Quadrature, *loads: object
) -> tuple[Values, Values]:
    """Quadrature points of cells, volumes that they stand for."""
    return cell_points(_positions(mesh, nodes, *loads)[mesh.tets], rule)


def _positions(mesh: TetMesh, nodes: Nodes | None, *loads: object) -> Any:
    x = mesh.nodes if nodes is None else nodes
    if x.shape != mesh.nodes.shape:
        raise FeaError(f"`nodes` has shape {x.shape}, but the mesh has {mesh.nodes.shape}.")
    return _namespace(x, *loads).asarray(x)


def _field(load: Any, x: Values, shape: tuple[int, ...], what: str) -> Any:
    """Values at quadrature points, [elements, quad, *shape]; one point for a uniform load."""
    if not isinstance(load, Callable):
        return _constant(load, shape, what)[None, None]
    values: Any = load(x.reshape(-1, 3))
    expected = (x.shape[0] * x.shape[1], *shape)
    if np.shape(values) != expected:
        raise FeaError(
            f"The {what} as a function of position returns shape {np.shape(values)} for positions "
            f"of shape {(expected[0], 3)}; return shape {expected}."
        )
    _check_numbers(values, what)
    return values.reshape(*x.shape[:2], *shape)


def _constant(load: Any, shape: tuple[int, ...], what: str) -> Any:
    if np.shape(load) != shape:
        raise FeaError(f"The {what} has shape {np.shape(load)}; give one of shape {shape}.")
    _check_numbers(load, what)
    return _namespace(load).asarray(load)


def _check_numbers(values: Any, what: str) -> None:
    """JAX arrays may be traced, without values yet: the forces are checked before a solve."""
    if isinstance(values, jax.Array):
        return
    refuse_single_precision(np.asarray(values), f"Numbers of the {what}")
    if not np.isfinite(values).all():
        raise FeaError(f"The {what} is not a number somewhere ({values}); give finite numbers.")


def _check_area(mesh: TetMesh, facets: Facets) -> None:
    # By the mesh's own nodes, as the moved ones may be traced.
    if not (facets.size and mesh.facet_integrals(facets)[0].sum() > 0):
        raise FeaError("A load acts on facets without area; choose a region with facets in it.")


def _norm(normal: Any) -> Any:
    return normal.__array_namespace__().linalg.norm(normal, axis=-1)


def _spread(mesh: TetMesh, facets: Facets, load: Any) -> Any:
    """Nodal forces of loads at the facets' quadrature points, each times the area it stands for."""
    return _accumulate(mesh, facets, load, TRIANGLES[facets.shape[1]].shape(FACET_RULE.points))


def _into_cells(mesh: TetMesh, load: Any, rule: Quadrature) -> Any:
    """Nodal forces of loads at the cells' quadrature points, each times its volume."""
    return _accumulate(mesh, mesh.tets, load, TETRAHEDRA[mesh.tets.shape[1]].shape(rule.points))


def _accumulate(
    mesh: TetMesh, owners: Int[np.ndarray, "elements corners"], load: Any, N: np.ndarray
) -> Any:
    xp = load.__array_namespace__()
    forces = xp.einsum("eqx,qn->enx", load, N).reshape(-1, 3)
    node, count = owners.ravel(), len(mesh.nodes)
    if xp is np:
        columns = [np.bincount(node, weights=column, minlength=count) for column in forces.T]
        return np.stack(columns, axis=1)
    return xp.zeros((count, 3)).at[node].add(forces)
