"""The extruded (2.5-D) lattice of a unit cell as a homogeneous solid: its plane, and E along its axis."""

from dataclasses import dataclass

import numpy as np

from fea.beam import StrutMaterial
from fea.plane_stiffness import PlaneStiffness
from fea.sections import section as section_of
from fea.stiffness_bounds import extruded_modulus, plane_hashin_shtrikman_bound
from texmap_opt.cells.homogenised import frame_properties, joints_text
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.cells.unit_cell import UnitCell

# Directions in the plane, by the components of their vectors.
PLANE_DIRECTIONS = {"x": (1.0, 0.0), "xy": (1.0, 1.0), "y": (0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class HomogenisedPlaneCell:
    """What an endless extruded lattice amounts to, for a solid with Young's modulus 1.

    Attributes:
        cell: the unit cell, of two dimensions.
        radius: half the thickness of walls of relative radius 1, in cell edges.
        nu: Poisson's ratio of the solid.
        stiffness: effective stiffness of the plane over the solid's Young's modulus; nothing hinders
            the walls along the axis of extrusion.
        density: relative density, what walls share at joints counted once.
        centre_line_density: the same with every wall counted from joint to joint.
        joint_model: what stiffened the joints; None: beams from joint to joint.
    """

    cell: UnitCell
    radius: float
    nu: float
    stiffness: PlaneStiffness
    density: float
    centre_line_density: float
    joint_model: JointModel | None

    @property
    def extruded_modulus(self) -> float:
        """Young's modulus along the axis of extrusion."""
        return extruded_modulus(1.0, self.density)

    def text(self) -> str:
        """The report in lines; moduli are over that of the solid."""
        effective = self.stiffness
        along = effective.youngs_modulus(np.array(list(PLANE_DIRECTIONS.values())))
        polar = effective.polar_modulus()
        constants = effective.engineering_constants
        bound = plane_hashin_shtrikman_bound(1.0, self.nu, self.density)
        area = effective.reuss_average.area
        lines = [
            f"frame model in the plane, walls twice {self.radius:g} of the cell's first edge thick, "
            f"solid with E = 1 and nu = {self.nu:g}",
            f"joints    {joints_text(self.cell, self.joint_model)}",
            f"density   {self.density:.4g} (centre lines {self.centre_line_density:.4g})",
            "E         "
            + ", ".join(
                f"{E:.4g} along {name}" for name, E in zip(PLANE_DIRECTIONS, along, strict=True)
            )
            + f", {self.extruded_modulus:.4g} along the axis of extrusion",
            f"          in the plane from {polar.E.min():.4g} at {_degrees(polar.softest)} to "
            f"{polar.E.max():.4g} at {_degrees(polar.stiffest)} from x",
            f"G         {constants.G:.4g}",
            f"nu        {constants.nu_xy + 0.0:.4g}, {constants.nu_yx + 0.0:.4g} as nu_xy, nu_yx",
            f"area      modulus {area:.4g}, {100 * area / bound.area:.3g} % of the Hashin-Shtrikman bound",
            f"anisotropy  universal anisotropy {effective.universal_anisotropy:.4g}",
        ]
        return "\n".join(lines)


def homogenised_plane_cell(
    cell: UnitCell,
    *,
    radius: float,
    nu: float = 0.3,
    joint_model: JointModel | None = None,
) -> HomogenisedPlaneCell:
    """Stiffness and density of an endless extruded lattice.

    Args:
        cell: the unit cell, of two dimensions.
        radius: half the thickness of walls of relative radius 1, in cell edges.
        nu: Poisson's ratio of the solid.
        joint_model: None: beams from joint to joint.

    Raises:
        CellError: for a radius that is not positive or so large that the walls fill the cell, or
            a lattice that resists some strain with nothing.
        LatticeError: for walls thicker than the joint model was fitted to.
    """
    material = StrutMaterial(1.0, nu, section_of(cell.section))
    found = frame_properties(cell, material, radius, joint_model, PlaneStiffness)
    return HomogenisedPlaneCell(cell, radius, nu, *found, joint_model)


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.3g}°"
