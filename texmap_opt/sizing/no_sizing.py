"""The baseline: the radii stay as they come."""

import numpy as np

from texmap_opt.frame_model import FrameModel
from texmap_opt.sizing.problem import solve_model
from texmap_opt.sizing.sized import AbstractSizing, Sized, SizingLimits, Strength
from texmap_opt.structure.volume import lattice_volume


class NoSizing(AbstractSizing):
    """Leave the radii alone; report compliance and utilisation."""

    def size(self, model: FrameModel, limits: SizingLimits) -> Sized:
        """See `AbstractSizing.size`; the limits have no effect."""
        solution = solve_model(model, model.structure.radii)
        compliance = float(solution.compliance.sum())
        return Sized(
            structure=model.structure,
            solution=solution,
            iterations=0,
            converged=True,
            compliance_before=compliance,
            compliance_after=compliance,
            volume=lattice_volume(model.structure),
            history=np.array([compliance]),
            strength=Strength.of(model, solution),
            message="Radii were not sized.",
        )
