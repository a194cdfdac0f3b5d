"""A topology's joint model, fitted to solids of its own cell.

Young's modulus E(n) of a cubic cell obeys 1/E = 1/E100 + t (1/E111 - 1/E100), with t between 0 and 1 a
function of the direction n (Nye, Physical Properties of Crystals, 1957, chapter VIII): an error of at
most e in E100 and E111 is at most e in every direction. So these two and C44 are what is fitted: the
logarithms of frame over solid are made least in the mean square. The bulk modulus is not. What it
lacks is that a joint pulled in all directions at once is stiffer than its struts, which no property
of single struts can give; it is reported beside the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from fea import Material, section
from fea.beam import StrutMaterial
from fea.effective_stiffness import EffectiveStiffness
from fea.homogenise import homogenise_frame
from fea.homogenise_solid import homogenise_mirrored
from texmap_opt.cells.joint_model import JointModel, radius_ratio
from texmap_opt.cells.periodic_frame import periodic_frame
from texmap_opt.cells.periodic_tets import EDGE_PER_RADIUS, is_cubic, mirrored_tets
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CellError

# Of the solid that models are fitted with: stiffness is relative to its E, and metals have about
# this nu.
POISSON = 0.3

# Where the fit starts, and the parameters that it does not leave: rigid ends meet in the middle of
# struts, or the modulus is no longer positive.
START = (0.5, 0.0)
ROOM = 0.999

# E100, E111 and C44, the first of `CellModuli.array`, are fitted.
FITTED = 3

# Relative, of the parameters and the sum of squares; the solids are known to a percent.
FIT_TOLERANCE = 1e-6


@dataclass(frozen=True)
class CellModuli:
    """Moduli of a cubic cell over Young's modulus of its material.

    Attributes:
        E100: Young's modulus along a cell axis.
        E111: Young's modulus along a space diagonal.
        C44: shear modulus in planes across the axes.
        bulk: pressure over the share of volume that is lost.
    """

    E100: float
    E111: float
    C44: float
    bulk: float

    @classmethod
    def of(cls, stiffness: EffectiveStiffness) -> "CellModuli":
        """Those of the nearest cubic stiffness; E of the material is 1."""
        C11, C12, C44 = stiffness.cubic
        K, shear = (C11 + 2 * C12) / 3, (C11 - C12) / 2
        return cls(9 * K * shear / (3 * K + shear), 9 * K * C44 / (3 * K + C44), C44, K)

    @property
    def nu(self) -> float:
        """Poisson's ratio under tension along an axis."""
        return (1 - self.E100 / (3 * self.bulk)) / 2

    @property
    def array(self) -> Float[np.ndarray, " 4"]:
        """E100, E111, C44 and the bulk modulus."""
        return np.array([self.E100, self.E111, self.C44, self.bulk])


@dataclass(frozen=True)
class SolidCell:
    """A homogenised solid cell.

    Attributes:
        radius: of struts of relative radius 1, in cell edges.
        tet_edge: wanted edge of the tets over the thinnest radius.
        nodes: of the tet10 mesh between mirror planes.
        density: volume of the mesh over that of its cube.
        moduli: over E of the material, whose Poisson's ratio is `POISSON`.
    """

    radius: float
    tet_edge: float
    nodes: int
    density: float
    moduli: CellModuli


def solid_cell(cell: UnitCell, radius: float, *, tet_edge: float = EDGE_PER_RADIUS) -> SolidCell:
    """Mesh and homogenise the solid of a cubic cell with mirror planes: about a minute.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
        tet_edge: wanted edge of the tets over the thinnest radius.

    Raises:
        CellError: for a cell that is not cubic or has no mirror planes.
        FeaError: when the mesher or the solver fails.
    """
    if not is_cubic(cell):
        raise CellError(
            f'unit cell "{cell.name}" changes when its axes are exchanged, so three moduli do not '
            "describe it; joint models are fitted to cubic cells only."
        )
    thinnest = radius * float(cell.relative_radius.min())
    tets = mirrored_tets(cell, edge=1.0, radius=radius, tet_edge=tet_edge * thinnest).to_tet10()
    solid = homogenise_mirrored(tets, Material(E=1.0, nu=POISSON, density=1e-9))
    return SolidCell(
        radius=radius,
        tet_edge=tet_edge,
        nodes=len(tets.nodes),
        density=solid.density,
        moduli=CellModuli.of(EffectiveStiffness(solid.C)),
    )


def frame_moduli(cell: UnitCell, radius: float, joint_model: JointModel | None) -> CellModuli:
    """Moduli of the cell's frame, of the same radius and material as `solid_cell`.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
        joint_model: None: beams from joint to joint.

    Raises:
        LatticeError: for struts thicker than the joint model was fitted to.
    """
    material = StrutMaterial(1.0, POISSON, section(cell.section))
    frame = periodic_frame(
        cell, edge=1.0, radius=radius, material=material, joint_model=joint_model
    )
    return CellModuli.of(EffectiveStiffness(homogenise_frame(frame).C))


def frame_errors(
    cell: UnitCell, solids: Sequence[SolidCell], joint_model: JointModel | None
) -> Float[np.ndarray, "samples 4"]:
    """Frame over solid less one, of `CellModuli.array`, one row a solid."""
    frames = [frame_moduli(cell, solid.radius, joint_model).array for solid in solids]
    return np.array(frames) / np.array([solid.moduli.array for solid in solids]) - 1


def fitted_joint_model(cell: UnitCell, solids: Sequence[SolidCell]) -> JointModel:
    """The joint model that comes closest to solids of several radii.

    Args:
        cell: the unit cell.
        solids: of this cell.

    Raises:
        CellError: for fewer than two solids, which two parameters fit whatever they are.
    """
    if len(solids) < 2:
        raise CellError(
            f'unit cell "{cell.name}": {len(solids)} solids to fit its joint model to; give at '
            "least two of different radii."
        )
    thickest = max(solid.radius for solid in solids)
    limit = _largest_radius_ratio(cell, thickest)

    def model(parameters: Float[np.ndarray, " 2"], *, error: float = 0.0) -> JointModel:
        return JointModel(float(parameters[0]), float(parameters[1]), limit, error)

    def errors(parameters: Float[np.ndarray, " 2"]) -> Float[np.ndarray, "samples 3"]:
        return frame_errors(cell, solids, model(parameters))[:, :FITTED]

    fit = least_squares(
        lambda parameters: np.log1p(errors(parameters)).ravel(),
        START,
        bounds=([0.0, -ROOM / limit], [ROOM / (2 * limit), np.inf]),
        xtol=FIT_TOLERANCE,
        ftol=FIT_TOLERANCE,
    )
    return model(fit.x, error=float(np.abs(errors(fit.x)).max()))


def _largest_radius_ratio(cell: UnitCell, radius: float) -> float:
    ends = cell.joints[cell.struts]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    radii = np.repeat(radius * cell.relative_radius[:, None], 2, axis=1)
    return float(np.max(np.asarray(radius_ratio(radii, lengths))))
