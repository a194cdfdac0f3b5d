"""The lattice of a case without end and without a warp: how stiff it is, and so how to turn its cells."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fea.effective_stiffness import EffectiveStiffness
from texmap_opt.case import DesignCase
from texmap_opt.cells.homogenised import fitting_joint_model, homogenised_cell
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.grid_plan import GridPlan


@dataclass(frozen=True, eq=False)
class EndlessLattice:
    """Cubes of one unit cell, next to each other.

    Attributes:
        cell: the unit cell, with the section of its struts.
        radius: of its struts, in edges of the cube.
        nu: Poisson's ratio of the solid.
        joint_model: whether joints are stiffened where the cell has a model for them.
    """

    cell: UnitCell
    radius: float
    nu: float
    joint_model: bool

    @cached_property
    def stiffness(self) -> EffectiveStiffness:
        """Effective stiffness over the solid's Young's modulus, in the cell's axes.

        Raises:
            CellError: for struts that fill the cells.
        """
        stiffened = self.joint_model and self.cell.section == "round"
        model = fitting_joint_model(self.cell, self.radius) if stiffened else None
        homogenised = homogenised_cell(self.cell, radius=self.radius, nu=self.nu, joint_model=model)
        return homogenised.stiffness


def endless_lattice(case: DesignCase, plan: GridPlan, cell: UnitCell) -> EndlessLattice | None:
    """Of a case's struts before sizing; None where they are holes.

    Its cubes have the volume of a cell of the uniform grid. Where those are longer one way, so is
    their stiffness, which this does not know.
    """
    lattice = case.lattice
    if lattice.kind == "plate":
        return None
    return EndlessLattice(
        cell=replace(cell, section=lattice.section),
        radius=plan.radius_mm / float(np.cbrt(plan.grid.uniform_edge.prod())),
        nu=case.material.nu,
        joint_model=case.analysis.joint_model,
    )
