"""Grading by a rule: thick struts where the warping function is large, without a solve on the way."""

import numpy as np
from jaxtyping import Float

from texmap_opt.frame_model import FrameModel
from texmap_opt.sizing.problem import SizingProblem, solve_model
from texmap_opt.sizing.sized import AbstractSizing, Sized, SizingLimits


class Graded(AbstractSizing):
    """The radius a strut comes with times a power of the warping function f at its middle.

    Where f is a stress, and the force in a strut the stress times the area of cell it stands for,
    equal stress in all struts asks for sections that follow f: the radius of a bar goes with f^(1/2),
    the thickness of a wall with f.

    Attributes:
        f: warping function at the middle of each strut, relative to anything.
        exponent: power of it; None: 1/2, or 1 for walls.
    """

    f: Float[np.ndarray, " struts"]
    exponent: float | None = None

    def size(self, model: FrameModel, limits: SizingLimits) -> Sized:
        """See `AbstractSizing.size`; one factor and the bounds make the volume the wanted one."""
        problem = SizingProblem.of(model, limits)
        exponent = 1 / problem.measure.degree if self.exponent is None else self.exponent
        uniform = np.full(model.structure.struts.shape, problem.uniform)
        before = solve_model(model, uniform)
        given = model.structure.radii.mean(axis=1)
        # f over its largest value: no power of it overflows. A strut where f is nothing takes its
        # smallest radius.
        rule = given * (self.f / self.f.max()) ** exponent
        wanted = np.maximum(rule, np.finfo(float).tiny)
        radius = problem.at_volume(wanted)
        bound = np.isclose(radius, problem.lower) | np.isclose(radius, problem.upper)
        graded = solve_model(model, np.repeat(radius[:, None], 2, axis=1), before)
        return problem.finished(
            graded,
            before=float(before.compliance.sum()),
            history=[float(graded.compliance.sum())],
            converged=True,
            message=(
                f"Radii follow f^{exponent:g}; {100 * bound.mean():.0f} % of the struts are at their "
                "smallest or largest radius."
            ),
        )
