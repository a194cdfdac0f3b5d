"""Stress in the struts of a frame against yield."""

import numpy as np
from jaxtyping import Float

from fea.errors import FeaError
from fea.frame import FrameSolution


def end_stress(solution: FrameSolution) -> Float[np.ndarray, "cases struts 2"]:
    """Largest von Mises stress in the section at both ends of each strut [MPa].

    Elementary beam theory with the section's own radius at each end: sigma = |N|/A + |M|/W and
    tau = |T|/W_t at the outermost fibre, sigma = |N|/A and tau = |T|/W_t + V/A_v at the neutral
    axis (peak of the transverse shear), von Mises sqrt(sigma² + 3 tau²), the larger of the two.
    A square's corner and the middle of its side are taken as one point, which is safe. Loads act
    on joints only, so moments are largest at the ends. Notches at joints are not resolved.
    """
    frame = solution.problem
    axis = np.diff(frame.joints[frame.struts], axis=1)[:, 0]
    t = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    ends = solution.end_forces.reshape(len(solution.end_forces), len(t), 2, 2, 3)
    force, moment = ends[..., 0, :], ends[..., 1, :]  # case, strut, end, component

    def split(vector: Float[np.ndarray, "cases struts 2 3"]):
        along = np.einsum("csek,sk->cse", vector, t)
        across = np.linalg.norm(vector - along[..., None] * t[:, None], axis=-1)
        return np.abs(along), across

    (N, V), (T, M) = split(force), split(moment)
    section, r = frame.section, frame.radii
    axial = N / np.asarray(section.area(r))
    torsion = T / np.asarray(section.torsion_modulus(r))
    fibre = np.hypot(axial + M / np.asarray(section.bending_modulus(r)), np.sqrt(3) * torsion)
    shear = torsion + V / np.asarray(section.shear_modulus_area(r))
    return np.maximum(fibre, np.hypot(axial, np.sqrt(3) * shear))


def utilisation(solution: FrameSolution, yield_stress: float) -> Float[np.ndarray, " struts"]:
    """Largest von Mises stress of each strut over its ends and load cases, over yield.

    Raises:
        FeaError: when the yield stress is not positive.
    """
    if not yield_stress > 0:
        raise FeaError(f"yield_stress = {yield_stress:g} MPa: must be positive.")
    return end_stress(solution).max(axis=(0, 2)) / yield_stress
