"""The lattice of a case without end and without a warp: how stiff it is, and so how to turn its cells."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fea.effective_stiffness import EffectiveStiffness
from fea.plane_stiffness import PlaneStiffness
from texmap_opt.case import DesignCase
from texmap_opt.cells.homogenised import fitting_joint_model, homogenised_cell
from texmap_opt.cells.homogenised_plane import homogenised_plane_cell
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.grid_plan import GridPlan


@dataclass(frozen=True, eq=False)
class EndlessLattice:
    """Copies of one unit cell in its own proportions, next to each other.

    Attributes:
        cell: the unit cell, with the section of its struts.
        radius: of its struts, in units of the cell's proportions (edges of a cube).
        nu: Poisson's ratio of the solid.
        joint_model: whether joints are stiffened where the cell has a model for them.
    """

    cell: UnitCell
    radius: float
    nu: float
    joint_model: bool

    @cached_property
    def stiffness(self) -> EffectiveStiffness | PlaneStiffness:
        """Effective stiffness over the solid's Young's modulus, in the cell's axes.

        In two dimensions that of the plane, per depth of the walls.

        Raises:
            CellError: for struts that fill the cells, or a lattice that resists some strain with
                nothing.
        """
        if self.cell.dimensions == 2:
            return homogenised_plane_cell(self.cell, radius=self.radius, nu=self.nu).stiffness
        stiffened = self.joint_model and self.cell.section == "round"
        model = fitting_joint_model(self.cell, self.radius) if stiffened else None
        homogenised = homogenised_cell(self.cell, radius=self.radius, nu=self.nu, joint_model=model)
        return homogenised.stiffness


def endless_lattice(case: DesignCase, plan: GridPlan, cell: UnitCell) -> EndlessLattice | None:
    """Of a case's struts before sizing; None where they are holes.

    Its cells have the volume of one of the uniform grid, or the area. Where those are longer one way
    than the unit cell is, so is their stiffness, which this does not know.
    """
    lattice = case.lattice
    if lattice.kind == "plate":
        return None
    proportions = np.array(cell.proportions)
    # Edge of a cell of the uniform grid's volume, per unit of the proportions.
    edge = float((plan.grid.uniform_edge / proportions).prod() ** (1 / cell.dimensions))
    return EndlessLattice(
        cell=replace(cell, section=lattice.section or cell.section),
        radius=plan.radius_mm / edge,
        nu=case.material.nu,
        joint_model=case.analysis.joint_model,
    )
