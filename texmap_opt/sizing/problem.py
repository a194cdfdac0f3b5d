"""Radii -> compliance and volume with their gradients: what every optimiser of radii works on."""

from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from fea import FeaError
from fea.adjoint import compliance_gradient
from fea.frame import FrameSolution, solve_frame
from texmap_opt.errors import AnalysisError, LatticeError, SizingError
from texmap_opt.frame_model import FrameModel
from texmap_opt.grid_plan import LEAST_PRINTABLE_RADIUS_MM
from texmap_opt.sizing.sized import Sized, SizingLimits, Strength
from texmap_opt.structure.volume import LatticeVolume, uniform_radius

# Default bounds as shares of the uniform radius of the same volume: thin enough for idle struts to
# give up 84 % of their material, thick enough for the few that carry most.
LEAST_SHARE = 0.4
MOST_SHARE = 2.5

# Largest default radius over the strut's length: slenderness below 5 diameters is no beam, and
# thicker struts fill the cell. Struts already shorter than that keep the uniform radius as bound.
STOUTEST = 0.2

# Relative accuracy of the volume of the sized structure, and the most secant steps towards it.
VOLUME_RTOL = 1e-6
MAX_STEPS = 30


@dataclass(frozen=True, eq=False)
class SizedFrame:
    """One trial of the optimiser.

    Attributes:
        solution: the solved frame.
        compliance: sum of u.f over the cases [N mm].
        gradient: its derivative in each strut's radius [N].
    """

    solution: FrameSolution
    compliance: float
    gradient: Float[np.ndarray, " struts"]


@dataclass(frozen=True, eq=False)
class SizingProblem:
    """Least compliance at a given volume, one radius a strut.

    Attributes:
        model: the structure under its loads.
        measure: its overlap-corrected volume.
        volume: wanted [mm³].
        uniform: the one radius of all struts that gives this volume [mm].
        lower: smallest radius of each strut [mm].
        upper: largest radius of each strut [mm].
    """

    model: FrameModel
    measure: LatticeVolume
    volume: float
    uniform: float
    lower: Float[np.ndarray, " struts"]
    upper: Float[np.ndarray, " struts"]

    @classmethod
    def of(cls, model: FrameModel, limits: SizingLimits) -> "SizingProblem":
        """Fill in the defaults and check that the volume can be met.

        Raises:
            SizingError: when it cannot, with the range that can.
        """
        structure = model.structure
        measure = LatticeVolume.of(structure)
        volume = limits.volume
        if volume is None:
            volume = float(measure(structure.joints, structure.radii))
        try:
            uniform = uniform_radius(structure, volume, measure=measure)
        except LatticeError as failure:
            raise SizingError(f"[sizing] volume_fraction: {failure}") from failure
        ones = np.ones(len(structure.struts))
        lower = limits.min_radius_mm
        if lower is None:
            lower = max(LEAST_SHARE * uniform, min(uniform, LEAST_PRINTABLE_RADIUS_MM))
        lower = lower * ones
        if limits.max_radius_mm is None:
            stout = np.maximum(STOUTEST * structure.lengths(), uniform)
            upper = np.maximum(np.minimum(MOST_SHARE * uniform, stout), lower)
        else:
            upper = limits.max_radius_mm * ones
        problem = cls(model, measure, volume, uniform, lower, upper)
        problem._check_reach()
        return problem

    def solve(
        self, radius: Float[np.ndarray, " struts"], previous: FrameSolution | None = None
    ) -> SizedFrame:
        """Compliance and its gradient.

        Args:
            radius: of each strut [mm].
            previous: solution of an earlier trial, whose factorisation is taken over.

        Raises:
            AnalysisError: when the frame cannot be solved.
        """
        solution = solve_model(self.model, _both_ends(radius), previous)
        gradient = compliance_gradient(solution)
        values, pull = jax.vjp(self.model.parameters, jnp.asarray(_both_ends(radius)))
        (into_radii,) = pull({name: jnp.asarray(gradient[name]) for name in values})
        by_strut = np.asarray(into_radii).sum(axis=1)
        return SizedFrame(solution, float(solution.compliance.sum()), by_strut)

    def volume_of(self, radius: Float[np.ndarray, " struts"]) -> float:
        """Overlap-corrected volume [mm³]."""
        return float(self.measure(self.model.structure.joints, _both_ends(radius)))

    def own_slope(self, radius: Float[np.ndarray, " struts"]) -> Float[np.ndarray, " struts"]:
        """Derivative of each strut's own volume, overlaps apart, in its radius [mm²]."""
        own = self.measure.strut_volumes(self.model.structure.joints, _both_ends(radius))
        return self.measure.degree * np.asarray(own) / radius

    def volume_gradient(
        self, radius: Float[np.ndarray, " struts"]
    ) -> tuple[float, Float[np.ndarray, " struts"]]:
        """Volume [mm³] and its derivative in each strut's radius [mm²]."""
        joints = jnp.asarray(self.model.structure.joints)
        value, gradient = self.measure.value_and_gradient(joints, jnp.asarray(_both_ends(radius)))
        return float(value), np.asarray(gradient).sum(axis=1)

    def at_volume(self, radius: Float[np.ndarray, " struts"]) -> Float[np.ndarray, " struts"]:
        """The radii times one factor, within the bounds, so that the volume is the wanted one."""

        def scaled(factor: float) -> Float[np.ndarray, " struts"]:
            return np.clip(factor * radius, self.lower, self.upper)

        def excess(factor: float) -> float:
            return self.volume_of(scaled(factor)) / self.volume - 1

        low, high = float((self.lower / radius).min()), float((self.upper / radius).max())
        before, now = (1.0, excess(1.0)), (1.0, 0.0)
        if abs(before[1]) <= VOLUME_RTOL:
            return scaled(1.0)
        factor = float(np.clip((1 + before[1]) ** (-1 / self.measure.degree), low, high))
        for _ in range(MAX_STEPS):
            now = (factor, excess(factor))
            if abs(now[1]) <= VOLUME_RTOL:
                break
            # Volume grows with the factor: the bracket only ever shrinks.
            low, high = (factor, high) if now[1] < 0 else (low, factor)
            slope = (now[1] - before[1]) / (now[0] - before[0]) if now[0] != before[0] else 0.0
            secant = now[0] - now[1] / slope if slope > 0 else np.nan
            before = now
            factor = float(secant) if low < secant < high else (low + high) / 2
        return scaled(factor)

    @cached_property
    def start(self) -> Float[np.ndarray, " struts"]:
        """The uniform radius, moved into the bounds at the wanted volume."""
        return self.at_volume(
            np.clip(np.full(len(self.lower), self.uniform), self.lower, self.upper)
        )

    def before(self) -> SizedFrame:
        """All struts of equal radius at the wanted volume: what sizing is measured against."""
        return self.solve(np.full(len(self.lower), self.uniform))

    def finished(
        self,
        solution: FrameSolution,
        *,
        before: float,
        history: list[float],
        converged: bool,
        message: str,
    ) -> Sized:
        """The result of a way of sizing.

        Args:
            solution: the frame with the final radii, solved.
            before: compliance of equal radii [N mm].
            history: compliance of each iteration [N mm].
            converged: whether the optimiser stopped by itself.
            message: how it ended.
        """
        radii = solution.problem.radii
        return Sized(
            structure=self.model.structure.with_radii(radii),
            solution=solution,
            iterations=len(history),
            converged=converged,
            compliance_before=before,
            compliance_after=float(solution.compliance.sum()),
            volume=float(self.measure(self.model.structure.joints, radii)),
            history=np.array(history),
            strength=Strength.of(self.model, solution),
            message=message,
        )

    def _check_reach(self) -> None:
        if (self.lower > self.upper).any():
            raise SizingError(
                f"[sizing] min_radius_mm = {self.lower.max():.4g}: is above the largest radius, "
                f"{self.upper.min():.4g} mm; lower it or raise max_radius_mm."
            )
        least, most = self.volume_of(self.lower), self.volume_of(self.upper)
        if not least <= self.volume <= most:
            raise SizingError(
                f"[sizing]: a lattice of {self.volume:.5g} mm³ is out of reach: radii from "
                f"{self.lower.min():.4g} to {self.upper.max():.4g} mm give {least:.5g} to "
                f"{most:.5g} mm³; change volume_fraction, min_radius_mm or max_radius_mm."
            )


def solve_model(
    model: FrameModel, radii: Float[np.ndarray, "struts 2"], previous: FrameSolution | None = None
) -> FrameSolution:
    """Solve the frame of a model with the given radii [mm].

    Raises:
        AnalysisError: when it cannot be solved.
    """
    try:
        return solve_frame(model.problem(radii), previous=previous)
    except FeaError as failure:
        raise AnalysisError(f"The lattice's frame could not be solved: {failure}") from failure


def _both_ends(radius: Float[np.ndarray, " struts"]) -> Float[np.ndarray, "struts 2"]:
    return np.repeat(radius[:, None], 2, axis=1)
