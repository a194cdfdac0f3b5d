"""Everything that the warp of a case depends on, brought together before it is computed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fea import Material, TetMesh
from texmap_opt.case import DesignCase
from texmap_opt.case_sections import WarpSection
from texmap_opt.endless_lattice import EndlessLattice
from texmap_opt.given_drivers import GivenDrivers
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField
from texmap_opt.warp.grid import Grid
from texmap_opt.warping_function.imported import ImportedField
from texmap_opt.warping_function.painted import PaintedRegion


@dataclass(frozen=True, eq=False)
class WarpInputs:
    """What a warp is computed from, and all of it: a hash of these values is a key for its result.

    Attributes:
        section: `[warp]`.
        grid: the uniform grid.
        mesh: the tets that carry the stress.
        stress: recovered at the nodes [MPa].
        case_weights: factor on each load case's stress.
        material: of the solid part.
        paint: painted regions.
        imported: a result of another program; None: there is none.
        surface: of the part.
        lattice: whose stiffness says how cells are turned; None where it does not.
    """

    section: WarpSection
    grid: Grid
    mesh: TetMesh
    stress: Float[np.ndarray, "cases nodes 6"]
    case_weights: Float[np.ndarray, " cases"]
    material: Material
    paint: tuple[PaintedRegion, ...]
    imported: ImportedField | None
    surface: TriMesh
    lattice: EndlessLattice | None


def warp_inputs(
    case: DesignCase,
    part: Part,
    stress: StressField,
    grid: Grid,
    lattice: EndlessLattice | None,
    given: GivenDrivers,
) -> WarpInputs:
    """Collects what the case's warp depends on."""
    warp = case.warp
    aligned = warp.method == "least-squares" and warp.alignment > 0
    by_stiffness = aligned and warp.target == "energy"
    factors = warp.case_weights or {}
    return WarpInputs(
        section=warp,
        grid=grid,
        mesh=stress.mesh,
        stress=stress.stress,
        case_weights=np.array([factors.get(name, 1.0) for name in stress.case_names]),
        material=case.material,
        paint=given.paint,
        imported=given.imported,
        surface=part.surface,
        lattice=lattice if by_stiffness else None,
    )
