"""The lattice of a unit cell as a homogeneous solid: stiffness by its frame model, and density."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from fea.beam import StrutMaterial
from fea.effective_stiffness import EffectiveStiffness
from fea.errors import FeaError
from fea.homogenise import homogenise_frame
from fea.plane_stiffness import PlaneStiffness
from fea.sections import section as section_of
from fea.stiffness_bounds import hashin_shtrikman_bound
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.cells.periodic_density import periodic_density
from texmap_opt.cells.periodic_frame import periodic_frame
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CellError

Stiffness = TypeVar("Stiffness", EffectiveStiffness, PlaneStiffness)

# Directions that crystallographers call [100], [110] and [111].
DIRECTIONS = {"100": (1.0, 0.0, 0.0), "110": (1.0, 1.0, 0.0), "111": (1.0, 1.0, 1.0)}


@dataclass(frozen=True, eq=False)
class HomogenisedCell:
    """What an endless lattice of one cell amounts to, for a solid with Young's modulus 1.

    Attributes:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
        nu: Poisson's ratio of the solid.
        stiffness: effective stiffness over the solid's Young's modulus.
        density: relative density, what struts share at joints counted once.
        centre_line_density: the same with every strut counted from joint to joint.
        joint_model: what stiffened the joints; None: beams from joint to joint.
    """

    cell: UnitCell
    radius: float
    nu: float
    stiffness: EffectiveStiffness
    density: float
    centre_line_density: float
    joint_model: JointModel | None

    def text(self) -> str:
        """The report in lines; moduli are over that of the solid."""
        effective = self.stiffness
        along = effective.youngs_modulus(np.array(list(DIRECTIONS.values())))
        surface = effective.directional_modulus()
        constants = effective.engineering_constants
        bound = hashin_shtrikman_bound(1.0, self.nu, self.density)
        hill = effective.hill_average
        anisotropy = f"universal anisotropy {effective.universal_anisotropy:.4g}"
        if effective.is_cubic:
            anisotropy = f"Zener ratio {effective.zener_ratio:.4g}, {anisotropy}"
        lines = [
            f"frame model, radius {self.radius:g} of the cell's edge, solid with E = 1 and nu = "
            f"{self.nu:g}",
            f"joints    {joints_text(self.cell, self.joint_model)}",
            f"density   {self.density:.4g} (centre lines {self.centre_line_density:.4g})",
            "E         "
            + ", ".join(
                f"{E:.4g} along [{name}]" for name, E in zip(DIRECTIONS, along, strict=True)
            ),
            f"          from {surface.E.min():.4g} along {_direction(surface.softest)} to "
            f"{surface.E.max():.4g} along {_direction(surface.stiffest)}",
            f"G         {', '.join(f'{G:.4g}' for G in constants.G)} in yz, xz, xy",
            f"nu        {', '.join(f'{nu:.4g}' for nu in constants.nu)} as nu_yz, nu_xz, nu_xy",
            f"bulk      {effective.bulk_modulus:.4g}, "
            f"{100 * effective.bulk_modulus / bound.bulk:.3g} % of the Hashin-Shtrikman bound",
            f"average   E {hill.E:.4g}, nu {hill.nu:.4g} over all orientations (Hill); "
            f"{100 * hill.E / bound.E:.3g} % of the bound",
            f"anisotropy  {anisotropy}",
        ]
        return "\n".join(lines)


def checked_density(cell: UnitCell, radius: float) -> float:
    """Relative density, of struts that leave some of the cell empty.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.

    Raises:
        CellError: for a radius that is not positive or so large that the struts fill the cell.
    """
    if not (np.isfinite(radius) and radius > 0):
        raise CellError(
            f"the radius is {radius:g} of the cell's edge; it must be a positive number."
        )
    density = periodic_density(cell, radius)
    if not density < 1:
        raise CellError(
            f'unit cell "{cell.name}": struts of radius {radius:g} of the cell\'s edge fill the cell '
            f"(relative density {density:.3g}, must be below 1); take a smaller radius."
        )
    return density


def joints_text(cell: UnitCell, joint_model: JointModel | None) -> str:
    """What stands for the joints, in words."""
    if joint_model is not None:
        return f"stiffened as fitted to solids, within {100 * joint_model.error:.2g} %"
    if cell.joint_model is None:
        return "beams from joint to joint: too soft, the more so the thicker (no joint model)"
    return (
        "beams from joint to joint: thicker than the joint model was fitted to, radius/length "
        f"{cell.joint_model.radius_ratio:g}"
    )


def fitting_joint_model(cell: UnitCell, radius: float) -> JointModel | None:
    """The cell's joint model where it was fitted to struts as thick as these; else None.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
    """
    model = cell.joint_model
    return model if model is not None and radius_ratio(cell, radius) <= model.radius_ratio else None


def radius_ratio(cell: UnitCell, radius: float) -> float:
    """Radius over length of the thickest strut for its length.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
    """
    return radius * float(np.max(cell.relative_radius / np.linalg.norm(cell.edges, axis=1)))


def frame_properties(
    cell: UnitCell,
    material: StrutMaterial,
    radius: float,
    joint_model: JointModel | None,
    stiffness_of: Callable[[Float[np.ndarray, "_ _"]], Stiffness],
) -> tuple[Stiffness, float, float]:
    """Stiffness, density, and density with every strut counted from joint to joint, of an endless lattice.

    Args:
        cell: the unit cell.
        material: of the struts.
        radius: of struts of relative radius 1, in cell edges.
        joint_model: None: beams from joint to joint.
        stiffness_of: makes a stiffness of its matrix, and refuses one that resists some strain with
            nothing.

    Raises:
        CellError: for a radius that is not positive or so large that the struts fill the cell, or
            a lattice that resists some strain with nothing.
        LatticeError: for struts thicker than the joint model was fitted to.
    """
    density = checked_density(cell, radius)
    frame = periodic_frame(
        cell, edge=1.0, radius=radius, material=material, joint_model=joint_model
    )
    try:
        return stiffness_of(homogenise_frame(frame).C), density, frame.density
    except FeaError as failure:
        raise CellError(f'unit cell "{cell.name}": {failure}') from failure


def homogenised_cell(
    cell: UnitCell,
    *,
    radius: float,
    nu: float = 0.3,
    joint_model: JointModel | None = None,
) -> HomogenisedCell:
    """Stiffness and density of an endless lattice.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
        nu: Poisson's ratio of the solid.
        joint_model: None: beams from joint to joint.

    Raises:
        CellError: for a radius that is not positive or so large that the struts fill the cell, or
            a lattice that resists some strain with nothing.
        LatticeError: for struts thicker than the joint model was fitted to.
    """
    material = StrutMaterial(1.0, nu, section_of(cell.section))
    found = frame_properties(cell, material, radius, joint_model, EffectiveStiffness)
    return HomogenisedCell(cell, radius, nu, *found, joint_model)


def _direction(vector: np.ndarray) -> str:
    """Such as "(1, 1, 0)": the largest component is 1, signs are those of an axis."""
    scaled = vector / vector[np.argmax(np.abs(vector))]
    return f"({', '.join(f'{round(float(c), 3) + 0.0:g}' for c in scaled)})"
