"""Sizing by optimality criteria.

At the least compliance of a given volume every strut between its bounds has the same ratio
B = -(dC/dr)/(lambda dV/dr) = 1, with lambda the multiplier of the volume. Struts with more are made
thicker, with less thinner: Bendsøe and Sigmund, Topology Optimization (2003), section 1.2.1, with
the strut's area in place of the density.
"""

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import SizingError
from texmap_opt.frame_model import FrameModel
from texmap_opt.sizing.problem import SizedFrame, SizingProblem
from texmap_opt.sizing.sized import AbstractSizing, Sized, SizingLimits

# The radius follows B to a power, by the power of the radius that a strut's volume follows. Bars: area
# follows B^(1/2), which is exact in one step for a statically determinate truss; in pure bending it
# overshoots by half and still converges. Walls: 1/2 would be exact for the truss, and 1/4 in pure
# bending, where 1/2 goes to and fro for ever; 1/3 leaves a third of the way in either.
EXPONENT = {2: 1 / 4, 1: 1 / 3}

# Slope of volume in a radius, at least this share of that of the strut alone: struts buried in a
# joint would cost nothing.
LEAST_SLOPE = 1e-2

# The multiplier lies within the factor e^100 of the largest pull (radii differ by far less than
# e^25), and halving that bracket 60 times leaves rounding.
LOG_BRACKET = 100.0
BISECTIONS = 60


class OptimalityCriteria(AbstractSizing):
    """Fixed-point iteration on the optimality conditions.

    Attributes:
        iterations: most iterations.
        move: largest relative change of a radius in one iteration.
        radius_tolerance: stop when no radius changes by more than this share.
        compliance_tolerance: or when compliance changes by less than this share twice in a row.
    """

    iterations: int = 60
    move: float = 0.2
    radius_tolerance: float = 5e-3
    compliance_tolerance: float = 2e-4

    def size(self, model: FrameModel, limits: SizingLimits) -> Sized:
        """See `AbstractSizing.size`."""
        problem = SizingProblem.of(model, limits)
        now = problem.before()
        before = now.compliance
        if not before > 0:
            raise SizingError(
                f"[sizing]: the loads do no work (compliance {before:.3g} N mm), so there is "
                'nothing to size for; add a force, or give method = "none".'
            )
        radius = problem.start
        if not np.allclose(radius, problem.uniform):
            now = problem.solve(radius, now.solution)
        best, history, calm = now, [now.compliance], 0
        converged = False
        message = f"Stopped after {self.iterations} iterations, still improving; allow more."
        for count in range(1, self.iterations + 1):
            trial = self._step(problem, radius, now)
            change = float(np.abs(trial / radius - 1).max())
            radius = trial
            now = problem.solve(radius, now.solution)
            gain = abs(now.compliance / history[-1] - 1)
            history.append(now.compliance)
            best = min(best, now, key=_compliance)
            calm = calm + 1 if gain < self.compliance_tolerance else 0
            if change < self.radius_tolerance or calm == 2:
                converged = True
                message = (
                    f"Converged in {count} iterations: last changes {gain:.1e} of the compliance, "
                    f"{change:.1e} of a radius."
                )
                break
        return problem.finished(
            best.solution, before=before, history=history[1:], converged=converged, message=message
        )

    def _step(
        self, problem: SizingProblem, radius: Float[np.ndarray, " struts"], now: SizedFrame
    ) -> Float[np.ndarray, " struts"]:
        """The next radii, at the wanted volume."""
        volume, slope = problem.volume_gradient(radius)
        slope = np.maximum(slope, LEAST_SLOPE * problem.own_slope(radius))
        degree = problem.measure.degree
        exponent = EXPONENT[degree]
        # Own weight can make a strut's thickening harmful; it then shrinks as fast as allowed.
        pull = np.maximum(-now.gradient, 0.0) / slope
        low = np.maximum(radius / (1 + self.move), problem.lower)
        high = np.minimum(radius * (1 + self.move), problem.upper)

        drawn = radius * pull**exponent
        # Volume is linear in r², of walls in r, which is exact but for the overlaps; `at_volume`
        # does the rest.
        slope = slope / (degree * radius ** (degree - 1))

        def stepped(log_multiplier: float) -> Float[np.ndarray, " struts"]:
            return np.clip(drawn * np.exp(-exponent * log_multiplier), low, high)

        def excess(trial: Float[np.ndarray, " struts"]) -> float:
            return volume + float(slope @ (trial**degree - radius**degree)) - problem.volume

        centre = float(np.log(max(pull.max(), np.finfo(float).tiny)))
        below, above = centre - LOG_BRACKET, centre + LOG_BRACKET
        for _ in range(BISECTIONS):
            middle = (below + above) / 2
            below, above = (middle, above) if excess(stepped(middle)) > 0 else (below, middle)
        return problem.at_volume(stepped((below + above) / 2))


def _compliance(frame: SizedFrame) -> float:
    return frame.compliance
