"""Stress of the solid part under the case's loads: regions become supports and nodal forces."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

import fea
from fea import FeaError, TetMesh
from texmap_opt.case import DesignCase, Load, Support
from texmap_opt.errors import AnalysisError, CaseError
from texmap_opt.region import AbstractRegion

# mm/s² in one m/s².
MM_PER_M = 1000.0


@dataclass(frozen=True, eq=False)
class StressField:
    """What the analysis of the solid part leaves.

    Attributes:
        mesh: the tets.
        case_names: load cases, in the order of the first axis of the arrays.
        displacement: [mm].
        stress: recovered at the nodes [MPa], Voigt order of `fea`.
        load_forces: nodal forces of each load of the case file [N].
        reaction: sum of the support forces [N].
        compliance: u.f of each case [N mm].
        residual: relative true residual of the linear solve.
        estimated_error: of the stress, share of the energy norm, largest over the cases
            (Zienkiewicz and Zhu 1992).
    """

    mesh: TetMesh
    case_names: tuple[str, ...]
    displacement: Float[np.ndarray, "cases nodes 3"]
    stress: Float[np.ndarray, "cases nodes 6"]
    load_forces: Float[np.ndarray, "loads nodes 3"]
    reaction: Float[np.ndarray, "cases 3"]
    compliance: Float[np.ndarray, " cases"]
    residual: float
    estimated_error: float

    @property
    def von_mises(self) -> Float[np.ndarray, "cases nodes"]:
        """Von Mises stress at the nodes [MPa]."""
        return np.asarray(fea.von_mises(self.stress))

    @property
    def max_displacement(self) -> float:
        """Largest displacement of a node in any case [mm]."""
        return float(np.linalg.norm(self.displacement, axis=-1).max())

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Everything but the mesh as arrays, for the cache."""
        return {
            "case_names": np.array(self.case_names),
            "displacement": self.displacement,
            "stress": self.stress,
            "load_forces": self.load_forces,
            "reaction": self.reaction,
            "compliance": self.compliance,
            "residual": np.array(self.residual),
            "estimated_error": np.array(self.estimated_error),
        }

    @staticmethod
    def from_arrays(mesh: TetMesh, arrays: dict[str, np.ndarray]) -> "StressField":
        """The inverse of `to_arrays`."""
        names = tuple(str(name) for name in arrays["case_names"])
        scalars = {name: float(arrays[name]) for name in ("residual", "estimated_error")}
        values = arrays | {"case_names": names, **scalars}
        return StressField(mesh=mesh, **values)  # pyright: ignore[reportArgumentType]


def stress_field(case: DesignCase, mesh: TetMesh) -> StressField:
    """Solve linear elasticity on the part's tets for all load cases at once.

    Raises:
        CaseError: a region selects nothing, or the supports leave a rigid motion.
        AnalysisError: the linear solve failed.
    """
    solution = solid_solution(case, mesh)
    return StressField(
        mesh=mesh,
        case_names=case.load_cases,
        displacement=solution.displacement,
        stress=solution.stress,
        load_forces=_load_forces(case, mesh),
        reaction=solution.reaction.sum(axis=1),
        compliance=solution.compliance,
        residual=solution.residual,
        estimated_error=float(solution.error_estimate.relative.max()),
    )


def solid_solution(case: DesignCase, mesh: TetMesh) -> fea.SolidSolution:
    """The part's tets under the case's loads and supports, solved.

    Raises:
        CaseError: a region selects nothing, or the supports leave a rigid motion.
        AnalysisError: the linear solve failed.
    """
    supports = [_support(mesh, support) for support in case.supports]
    held = _held(mesh, supports)
    body = fea.free_body(mesh, held)
    if body:
        raise CaseError(
            f"{case.path.name}: [[support]]: the part is not held: {body}; add a support or more "
            "directions to `fix`."
        )
    names = case.load_cases
    member = np.array([[load.case == name for load in case.loads] for name in names], float)
    forces = np.einsum("cl,lnd->cnd", member, _load_forces(case, mesh))
    if not any(np.any(support.value) for support in supports):
        _refuse_forces_on_supports(case, forces, held)
    try:
        return fea.solve_solid(
            fea.SolidProblem.from_supports(mesh, case.material, supports, forces)
        )
    except FeaError as failure:
        raise AnalysisError(f"{case.path.name}: the stress analysis failed: {failure}") from failure


def selected_facets(mesh: TetMesh, region: AbstractRegion) -> Int[np.ndarray, " facets"]:
    """Boundary facets whose centroid and normal are in a region."""
    inside = region.contains(
        mesh.facet_centroids, mesh.facet_normals, slack=region_slack(mesh.nodes)
    )
    return np.flatnonzero(inside)


def selected_nodes(mesh: TetMesh, region: AbstractRegion) -> Int[np.ndarray, " nodes"]:
    """Surface nodes in a region; their normal is that of any facet they are a corner of."""
    facets = mesh.boundary_facets
    corners = mesh.nodes[facets].reshape(-1, 3)
    normals = np.repeat(mesh.facet_normals, facets.shape[1], axis=0)
    inside = region.contains(corners, normals, slack=region_slack(mesh.nodes))
    return np.unique(facets.reshape(-1)[inside])


def region_slack(points: Float[np.ndarray, "nodes 3"]) -> float:
    """How far outside a region a point may be and still count [mm].

    A millionth of the bounding box: rounding, not tolerance.
    """
    return 1e-6 * float(np.linalg.norm(np.ptp(points, axis=0)))


def _support(mesh: TetMesh, support: Support) -> fea.Support:
    nodes = selected_nodes(mesh, support.region)
    if len(nodes) == 0:
        raise _selects_nothing(mesh, support.where, support.region)
    fixed = np.array([axis in support.fix for axis in "xyz"])
    return fea.Support(nodes, fixed, np.array(support.value_mm or (0.0, 0.0, 0.0), float))


def _held(mesh: TetMesh, supports: list[fea.Support]) -> Bool[np.ndarray, "nodes 3"]:
    held = np.zeros(mesh.nodes.shape, bool)
    for support in supports:
        held[support.nodes] |= np.asarray(support.fixed)
    return held


def _load_forces(case: DesignCase, mesh: TetMesh) -> Float[np.ndarray, "loads nodes 3"]:
    """Nodal forces of each load entry [N]."""
    return np.stack([_forces(case, mesh, load) for load in case.loads])


def _forces(case: DesignCase, mesh: TetMesh, load: Load) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces of one load entry [N]; its actions add up."""
    forces = np.zeros_like(mesh.nodes)
    if load.gravity_m_s2 is not None:
        acceleration = MM_PER_M * np.array(load.gravity_m_s2)
        forces += fea.gravity_forces(mesh, case.material.density, acceleration)
    if load.region is None:
        return forces
    facets = selected_facets(mesh, load.region)
    if len(facets) == 0:
        raise _selects_nothing(mesh, load.where, load.region)
    corners = mesh.boundary_facets[facets]
    if load.force_N is not None:
        forces += fea.force_on_facets(mesh, corners, np.array(load.force_N))
    if load.moment_Nmm is not None:
        try:
            forces += fea.moment_on_facets(mesh, corners, np.array(load.moment_Nmm))
        except FeaError as failure:
            raise CaseError(f"{load.where} moment_Nmm: {failure}") from failure
    if load.pressure_MPa is not None:
        forces += fea.pressure_forces(mesh, corners, load.pressure_MPa)
    if load.traction_MPa is not None:
        forces += fea.traction_forces(mesh, corners, np.array(load.traction_MPa))
    return forces


def _refuse_forces_on_supports(
    case: DesignCase,
    forces: Float[np.ndarray, "cases nodes 3"],
    held: Bool[np.ndarray, "nodes 3"],
) -> None:
    """A load case whose every force acts on held nodes does nothing at all."""
    for name, force in zip(case.load_cases, forces, strict=True):
        if not np.any(force[~held]):
            raise CaseError(
                f'{case.path.name}: [[load]] case = "{name}": acts only where the part is held, '
                "so nothing is loaded; move the load's region away from the supports."
            )


def _selects_nothing(mesh: TetMesh, where: str, region: AbstractRegion) -> CaseError:
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    box = " to ".join("[" + ", ".join(f"{x:.4g}" for x in corner) + "]" for corner in (low, high))
    return CaseError(
        f"{where} region: {region.describe()} selects nothing of the part, which spans {box} mm; "
        "move or widen the region."
    )
