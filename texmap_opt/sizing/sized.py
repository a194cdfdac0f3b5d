"""What sizing takes and leaves, and the interface that every way of sizing has."""

import abc
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from fea.columns import columns
from fea.frame import FrameSolution
from fea.shell_stress import skin_stress
from fea.strut_strength import buckling_utilisation, utilisation
from texmap_opt.frame_model import FrameModel
from texmap_opt.structure.structure import Structure


@dataclass(frozen=True)
class SizingLimits:
    """What the radii must respect.

    Attributes:
        volume: wanted overlap-corrected volume [mm³]; None: that of the structure as it comes.
        min_radius_mm: smallest radius; None: a share of the uniform one.
        max_radius_mm: largest radius; None: from the uniform one and the strut's length.
    """

    volume: float | None = None
    min_radius_mm: float | None = None
    max_radius_mm: float | None = None


@dataclass(frozen=True, eq=False)
class Strength:
    """How much struts and skin are asked for, the worst over the load cases.

    Attributes:
        utilisation: von Mises stress over yield of each strut; None without a yield stress.
        euler_utilisation: compressive force of each strut over its Euler load, ends hinged; struts in
            a row are one column (`fea.columns`). Zero for struts along the skin, which cannot buckle
            by themselves. Walls buckle in their plane, those in a side of the part as the half inside.
        skin_von_mises: von Mises stress of each triangle of the skin [MPa], at the worst of bottom,
            middle and top; None without a skin.
    """

    utilisation: Float[np.ndarray, " struts"] | None
    euler_utilisation: Float[np.ndarray, " struts"]
    skin_von_mises: Float[np.ndarray, " faces"] | None

    @classmethod
    def of(cls, model: FrameModel, solution: FrameSolution) -> "Strength":
        """Of a solved frame.

        Where the skin holds part of a strut's section, the frame's strut is the rest with the whole
        section's area; its stress is that of the rest. Walls have a section of unit depth there. One
        of which a share s of the thickness t is in the part has s times the depth d, and the frame's
        second moment s d t³/12; it buckles with s² times as much, that of the depth d and thickness s t.

        Args:
            model: what was solved.
            solution: its solution.
        """
        yield_stress = model.material.yield_stress
        share = np.asarray(model.section_shares(solution.problem.radii))
        return cls(
            utilisation=None
            if yield_stress is None
            else utilisation(solution, yield_stress) / (share * model.section_depths),
            euler_utilisation=np.where(
                share < 1, 0.0, buckling_utilisation(solution) / _thinnest(model, solution) ** 2
            ),
            skin_von_mises=_skin_von_mises(solution),
        )


@dataclass(frozen=True, eq=False)
class Sized:
    """A structure with its final radii.

    Attributes:
        structure: the struts, sized.
        solution: the frame solved with these radii.
        iterations: solves of the frame on the way.
        converged: whether the optimiser stopped by itself.
        compliance_before: sum of u.f over the cases with equal radii of the same volume [N mm].
        compliance_after: the same with the final radii [N mm].
        volume: overlap-corrected volume [mm³].
        history: compliance of each iteration [N mm].
        strength: of the struts with these radii, and of the skin.
        message: how it ended, one sentence.
    """

    structure: Structure
    solution: FrameSolution
    iterations: int
    converged: bool
    compliance_before: float
    compliance_after: float
    volume: float
    history: Float[np.ndarray, " samples"]
    strength: Strength
    message: str

    @property
    def utilisation(self) -> Float[np.ndarray, " struts"] | None:
        """Worst von Mises stress over yield of each strut, or None without a yield stress."""
        return self.strength.utilisation

    @property
    def max_utilisation(self) -> float | None:
        """Largest utilisation, or None without a yield stress."""
        return None if self.utilisation is None else float(self.utilisation.max())

    @property
    def min_radius(self) -> float:
        """Smallest radius [mm]."""
        return float(self.structure.radii.min())

    @property
    def max_radius(self) -> float:
        """Largest radius [mm]."""
        return float(self.structure.radii.max())


class AbstractSizing(eqx.Module):
    """A way to choose the radii of a structure's struts."""

    @abc.abstractmethod
    def size(self, model: FrameModel, limits: SizingLimits) -> Sized:
        """Choose radii.

        Args:
            model: the structure under its loads.
            limits: volume and bounds.

        Raises:
            SizingError: when the limits cannot be met.
            AnalysisError: when the frame cannot be solved.
        """


def _thinnest(model: FrameModel, solution: FrameSolution) -> Float[np.ndarray, " struts"]:
    """Least share of a wall's thickness that is in the part, of each strut's column.

    Under a skin one: what is not in the part is none of the frame's section there.
    """
    share = np.ones(len(model.structure.struts))
    if model.skin is not None:
        return share
    column = columns(solution.problem)
    np.minimum.at(share, column, model.shares_inside)
    return share[column]


def _skin_von_mises(solution: FrameSolution) -> Float[np.ndarray, " faces"] | None:
    frame = solution.problem
    if frame.skin is None:
        return None
    stress = skin_stress(frame.skin, frame.joints, solution.displacement)
    return np.asarray(stress.von_mises).max(axis=(0, 2))
