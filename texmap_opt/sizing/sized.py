"""What sizing takes and leaves, and the interface that every way of sizing has."""

import abc
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from fea.frame import FrameSolution
from fea.strut_strength import utilisation
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
        utilisation: worst von Mises stress over yield of each strut; None without a yield stress.
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
    utilisation: Float[np.ndarray, " struts"] | None
    message: str

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


def strut_utilisation(
    model: FrameModel, solution: FrameSolution
) -> Float[np.ndarray, " struts"] | None:
    """Worst von Mises stress over yield of each strut; None when the yield stress is unknown."""
    yield_stress = model.material.yield_stress
    return None if yield_stress is None else utilisation(solution, yield_stress)
