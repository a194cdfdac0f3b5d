"""Sizing by the method of moving asymptotes; the only user of nlopt.

Svanberg, "A class of globally convergent optimization methods based on conservative convex
separable approximations", SIAM J. Optim. 12 (2002) 555-573, as implemented in NLopt (LD_MMA).
"""

import nlopt
import numpy as np
from jaxtyping import Float

from texmap_opt.errors import SizingError
from texmap_opt.frame_model import FrameModel
from texmap_opt.sizing.problem import SizedFrame, SizingProblem
from texmap_opt.sizing.sized import AbstractSizing, Sized, SizingLimits

# Relative violation of the volume that the optimiser may leave; the result is scaled to the volume.
CONSTRAINT_TOLERANCE = 1e-6

# NLopt begins with convex terms of curvature one in each variable. Compliance and volume are
# therefore scaled by the number of struts, which makes their slopes about one; with slopes of one
# over that number its first steps are so small that it takes them for convergence.


class MovingAsymptotes(AbstractSizing):
    """Gradient descent by convex separable approximations.

    Attributes:
        iterations: most solves of the frame.
        compliance_tolerance: stop when a step changes compliance by less than this share.
    """

    iterations: int = 60
    compliance_tolerance: float = 1e-4

    def size(self, model: FrameModel, limits: SizingLimits) -> Sized:
        """See `AbstractSizing.size`."""
        problem = SizingProblem.of(model, limits)
        start = problem.before()
        if not start.compliance > 0:
            raise SizingError(
                f"[sizing]: the loads do no work (compliance {start.compliance:.3g} N mm), so "
                'there is nothing to size for; add a force, or give method = "none".'
            )
        path = _Path(problem, start)
        unit = problem.uniform
        optimiser = nlopt.opt(nlopt.LD_MMA, len(problem.lower))
        optimiser.set_lower_bounds(problem.lower / unit)
        optimiser.set_upper_bounds(problem.upper / unit)
        optimiser.set_min_objective(path.objective)
        tolerance = CONSTRAINT_TOLERANCE * path.scale
        optimiser.add_inequality_constraint(path.constraint, tolerance)
        optimiser.set_ftol_rel(self.compliance_tolerance)
        optimiser.set_maxeval(self.iterations)
        found = optimiser.optimize(problem.start / unit)
        code = optimiser.last_optimize_result()
        converged = code in (nlopt.FTOL_REACHED, nlopt.XTOL_REACHED, nlopt.SUCCESS)
        best = problem.solve(problem.at_volume(unit * found), path.now.solution)
        ending = "Converged in" if converged else "Stopped, still improving, after"
        return problem.finished(
            best.solution,
            before=start.compliance,
            history=path.history,
            converged=converged,
            message=f"{ending} {len(path.history)} solves of the frame.",
        )


class _Path:
    """The optimiser's view of the problem: radii over the uniform one, scaled functions."""

    def __init__(self, problem: SizingProblem, start: SizedFrame):
        self.problem = problem
        self.scale = float(len(problem.lower))
        self.before = start.compliance
        self.now = start
        self.history: list[float] = []

    def objective(self, x: Float[np.ndarray, " struts"], gradient: np.ndarray) -> float:
        """Compliance over that of equal radii, scaled."""
        unit = self.problem.uniform
        self.now = self.problem.solve(unit * x, self.now.solution)
        self.history.append(self.now.compliance)
        if gradient.size:
            gradient[:] = self.scale * unit * self.now.gradient / self.before
        return self.scale * self.now.compliance / self.before

    def constraint(self, x: Float[np.ndarray, " struts"], gradient: np.ndarray) -> float:
        """Volume over the wanted one, less one, scaled; at most zero."""
        unit, wanted = self.problem.uniform, self.problem.volume
        if not gradient.size:
            return self.scale * (self.problem.volume_of(unit * x) / wanted - 1)
        volume, slope = self.problem.volume_gradient(unit * x)
        gradient[:] = self.scale * unit * slope / wanted
        return self.scale * (volume / wanted - 1)
