"""Volume of a lattice whose struts overlap at the joints, differentiable in radii and joints.

The sum of the struts' own volumes counts the inside of each joint once for every strut there. Seen
from a joint, each half strut is star-shaped: in the direction omega, at an angle theta < 90 degrees
to its axis, it reaches to rho = min(r/sin theta, h/cos theta) with h its length, and a volume is
(1/3) of the integral of rho³ over the unit sphere. So what is counted too much at a joint is

    overlap = (1/3) integral of [sum_i rho_i³ - max(R, max_i rho_i)³] d omega

with R the radius of the joint's ball, its thickest strut; no ball at joints that the part's
surface cuts. Where a strut meets no other, its own rho is the maximum and cancels, so the end at h
leaves no trace. A strut is halved between its joints, unless one of them is a cut that no other
strut shares: then all of it belongs to the other. Not seen: struts that cross without a joint,
overlaps beyond the half, and taper within the joint (the radius at the joint counts).

The quadrature is fixed and has all 48 symmetries of the cube: of the sphere's 48 like triangles
between mirror planes one is cut into m² triangles, and their centres are reflected. So symmetric
lattices have symmetric gradients. No direction lies on a mirror plane, where two struts would be
the farthest and rounding would choose between them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.errors import LatticeError
from texmap_opt.structure.structure import Structure

# Traced by JAX, or the host's.
ArrayLike = Array | np.ndarray

# Parts of an edge of a fundamental triangle: 48 m² directions. Measured: 432 directions are within
# 0.2 % of the volume of an octet of 10 % density, whichever way it is turned.
SUBDIVISIONS = 3

# A square strut of half side h is seen as the circle of the same area, of radius h sqrt(4/pi).
SQUARE_TO_ROUND = float(np.sqrt(4 / np.pi))

# Half struts times directions in flight: 16 MB an array.
IN_FLIGHT = 2_000_000

# Joints are grouped by valence rounded up to a multiple of this: less padding, few compilations.
VALENCE_STEP = 4

# The ball's radius is the mean of the joint's radii with weights exp(100 r/r_mean): the thickest,
# but struts within a percent of it share its derivative, where rounding would choose one of them.
BALL_SHARPNESS = 100.0

# Smallest sin² of an angle to an axis: rounding of 1 - cos², whose root has no derivative at 0.
SMALLEST_SINE_SQUARED = 1e-14

# Uniform radius: relative accuracy of the volume it gives, and the most secant steps towards it
# (four or five are usual).
VOLUME_RTOL = 1e-9
MAX_STEPS = 50

# A uniform radius beyond this fraction of the median strut length leaves no lattice, only joints.
LARGEST_RADIUS_RATIO = 0.5


class Meeting(NamedTuple):
    """Joints of about equal valence and the half struts that meet there.

    Attributes:
        strut: indices of the struts; 0 where padded.
        end: which end of the strut is at the joint.
        share: part of the strut's length that is seen from the joint: 1/2, or 1; 0 where padded.
        ball: 1 where the joint has a ball, else 0.
    """

    strut: Int[ArrayLike, "joints slots"]
    end: Int[ArrayLike, "joints slots"]
    share: Float[ArrayLike, "joints slots"]
    ball: Float[ArrayLike, " joints"]


@dataclass(frozen=True, eq=False)
class LatticeVolume:
    """Overlap-corrected volume of a lattice of given connectivity.

    Attributes:
        struts: joints of each strut.
        square: whether sections are square.
        meetings: joints by valence; those where nothing overlaps are left out.
        directions: of the quadrature.
        weights: their solid angles [sr].
    """

    struts: Int[np.ndarray, "struts 2"]
    square: bool
    meetings: tuple[Meeting, ...]
    directions: Float[np.ndarray, "quad 3"]
    weights: Float[np.ndarray, " quad"]

    @classmethod
    def of(
        cls,
        structure: Structure,
        *,
        subdivisions: int = SUBDIVISIONS,
        seen: Bool[np.ndarray, " joints"] | None = None,
    ) -> "LatticeVolume":
        """Prepare the volume of a structure and of all others with its connectivity.

        Args:
            structure: joints and struts.
            subdivisions: of the quadrature.
            seen: joints whose overlap counts; absent: all.
        """
        directions, weights = sphere_quadrature(subdivisions)
        seen = np.ones(len(structure.joints), bool) if seen is None else seen
        return cls(
            structure.struts,
            structure.section == "square",
            _meetings(structure.struts, structure.cut, seen),
            directions,
            weights,
        )

    def __call__(
        self,
        joints: Float[ArrayLike, "joints 3"],
        radii: Float[ArrayLike, "struts 2"],
    ) -> Float[Array, ""]:
        """Volume [mm³]; JAX differentiates it in both arguments.

        Args:
            joints: positions [mm].
            radii: radius, or half the side, at both ends [mm].
        """
        whole = centre_line_volume(joints, self.struts, self.as_round(radii))
        return whole - self.overlap(joints, radii)

    def overlap(
        self,
        joints: Float[ArrayLike, "joints 3"],
        radii: Float[ArrayLike, "struts 2"],
    ) -> Float[Array, ""]:
        """What the struts' own volumes count too much at the joints [mm³]; arguments as above."""
        joints, radii = jnp.asarray(joints), jnp.asarray(self.as_round(radii))
        return sum(
            (
                _overlap(joints, self.struts, radii, m, self.directions, self.weights)
                for m in self.meetings
            ),
            start=jnp.zeros(()),
        )

    @property
    def value_and_gradient(self) -> Callable:
        """Function of joints and radii: the volume, and its gradient in the radii."""
        return jax.value_and_grad(self.__call__, argnums=1)

    def as_round(self, radii: Float[ArrayLike, "struts 2"]) -> Float[ArrayLike, "struts 2"]:
        """Radii of the round struts of the same area [mm]."""
        return radii * SQUARE_TO_ROUND if self.square else radii


@eqx.filter_jit
def centre_line_volume(
    joints: Float[ArrayLike, "joints 3"],
    struts: Int[ArrayLike, "struts 2"],
    radii: Float[ArrayLike, "struts 2"],
) -> Float[Array, ""]:
    """Sum of the volumes of round, tapered struts between their joints' centres [mm³]."""
    ends = jnp.asarray(joints)[struts]
    length = jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    a, b = jnp.asarray(radii).T
    return jnp.pi / 3 * jnp.sum(length * (a * a + a * b + b * b))


def lattice_volume(structure: Structure) -> float:
    """Overlap-corrected volume of a structure with its own radii [mm³]."""
    return float(LatticeVolume.of(structure)(structure.joints, structure.radii))


def uniform_radius(
    structure: Structure, volume: float, *, measure: LatticeVolume | None = None
) -> float:
    """The radius that, given to all struts, makes the lattice's corrected volume equal to `volume`.

    Args:
        structure: joints and struts; its radii are ignored.
        volume: wanted volume [mm³].
        measure: the structure's `LatticeVolume`, when the caller has it already.

    Raises:
        LatticeError: when no radius gives that volume before the cells fill up.
    """
    measure = LatticeVolume.of(structure) if measure is None else measure
    lengths = structure.lengths()
    ones = np.ones((len(structure.struts), 2))

    def volume_of(radius: float) -> float:
        return float(measure(structure.joints, radius * ones))

    largest = LARGEST_RADIUS_RATIO * float(np.median(lengths))
    reach = volume_of(largest)
    if not 0 < volume < reach:
        raise LatticeError(
            f"volume = {volume:.4g} mm³: struts of one radius give 0 to {reach:.4g} mm³ "
            f"(at {largest:.4g} mm, half the median strut length); change the volume fraction, or "
            "take smaller or larger cells."
        )
    # Volume grows about as r², so the secant is drawn through (r², V), kept within the bracket.
    low, high = (0.0, 0.0), (largest**2, reach)
    square = min(volume / (np.pi * lengths.sum()), largest**2 / 2)
    for _ in range(MAX_STEPS):
        now = volume_of(float(np.sqrt(square)))
        if abs(now - volume) <= VOLUME_RTOL * volume:
            return float(np.sqrt(square))
        low, high = ((square, now), high) if now < volume else (low, (square, now))
        square = _between(low, high, volume)
    raise LatticeError(f"No uniform radius found for volume = {volume:.4g} mm³; change the radius.")


def _between(low: tuple[float, float], high: tuple[float, float], volume: float) -> float:
    """Abscissa between two points where a line through them, kept off their ends, is `volume`."""
    fraction = (volume - low[1]) / (high[1] - low[1])
    return low[0] + (high[0] - low[0]) * fraction


@cache
def sphere_quadrature(
    subdivisions: int,
) -> tuple[Float[np.ndarray, "quad 3"], Float[np.ndarray, " quad"]]:
    """Directions and solid angles: 48 m², symmetric as the cube; the weights sum to 4 pi.

    The solid angle of each triangle is exact: Van Oosterom and Strackee, IEEE Trans. Biomed. Eng.
    30 (1983) 125.
    """
    m = subdivisions
    up = [((i, j), (i + 1, j), (i, j + 1)) for i in range(m) for j in range(m - i)]
    down = [
        ((i + 1, j + 1), (i, j + 1), (i + 1, j)) for i in range(m - 1) for j in range(m - 1 - i)
    ]
    ij = np.array(up + down, float) / m
    share = np.stack([1 - ij.sum(axis=-1), ij[..., 0], ij[..., 1]], axis=-1)
    # Through a face, an edge and a corner of the cube.
    triangle = np.array([[1, 0, 0], [1 / 2, 1 / 2, 0], [1 / 3, 1 / 3, 1 / 3]])
    corner = share @ triangle
    corner /= np.linalg.norm(corner, axis=-1, keepdims=True)
    a, b, c = np.moveaxis(corner, 1, 0)
    triple = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    dots = np.sum(a * b + b * c + c * a, axis=1)
    weight = 2 * np.arctan2(triple, 1 + dots)
    centre = corner.mean(axis=1)
    centre /= np.linalg.norm(centre, axis=1, keepdims=True)
    images = [
        centre[:, order] * signs
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.concatenate(images), np.tile(weight, len(images))


def _meetings(
    struts: Int[np.ndarray, "struts 2"],
    cut: Bool[np.ndarray, " joints"],
    seen: Bool[np.ndarray, " joints"],
) -> tuple[Meeting, ...]:
    """Half struts by joint, joints by valence; a strut alone at a cut overlaps nothing there."""
    ends = struts.reshape(-1)
    valence = np.bincount(ends, minlength=len(cut))
    lone = cut & (valence == 1)
    other_is_lone = lone[struts[:, ::-1]].reshape(-1)
    share = np.where(other_is_lone, 1.0, 0.5)
    order = np.argsort(ends, kind="stable")
    first = np.cumsum(valence) - valence
    slots = -(-valence // VALENCE_STEP) * VALENCE_STEP
    seen = seen & ~lone & (valence > 0)
    meetings = []
    for width in np.unique(slots[seen]):
        here = np.flatnonzero(seen & (slots == width))
        slot = np.arange(width)
        used = slot < valence[here, None]
        half = order[np.where(used, first[here, None] + slot, 0)]
        meetings.append(
            Meeting(
                np.where(used, half // 2, 0),
                np.where(used, half % 2, 0),
                np.where(used, share[half], 0.0),
                np.where(cut[here], 0.0, 1.0),
            )
        )
    return tuple(meetings)


@eqx.filter_jit
def _overlap(
    joints: Float[Array, "joints 3"],
    struts: Int[ArrayLike, "struts 2"],
    radii: Float[Array, "struts 2"],
    meeting: Meeting,
    directions: Float[ArrayLike, "quad 3"],
    weights: Float[ArrayLike, " quad"],
) -> Float[Array, ""]:
    """Overlap summed over the joints of one meeting [mm³]."""
    ends = joints[struts[meeting.strut]]
    here = meeting.end[:, :, None, None]
    out = jnp.where(here[..., 0] == 0, ends[:, :, 1] - ends[:, :, 0], ends[:, :, 0] - ends[:, :, 1])
    length = jnp.linalg.norm(out, axis=-1)
    axis = out / length[..., None]
    radius = radii[meeting.strut, meeting.end]
    used = meeting.share > 0
    height = jnp.where(used, meeting.share * length, 1.0)
    mean = jnp.mean(radius, axis=1, keepdims=True, where=used)
    share = jnp.where(used, BALL_SHARPNESS * radius / mean, -jnp.inf)
    weight = jax.nn.softmax(share, axis=1)
    ball = jnp.sum(weight * radius, axis=1) * meeting.ball

    @jax.checkpoint
    def at_joint(local: tuple[Array, ...]) -> Float[Array, ""]:
        axis, radius, height, used, ball = local
        cosine = axis @ directions.T  # slot, direction
        sine = jnp.sqrt(jnp.maximum(1 - cosine**2, SMALLEST_SINE_SQUARED))
        rho = 1 / jnp.maximum(sine / radius[:, None], cosine / height[:, None])
        rho = jnp.where((cosine > 0) & used[:, None], rho, 0.0)
        union = jnp.maximum(jnp.max(rho, axis=0), ball)
        return jnp.sum((jnp.sum(rho**3, axis=0) - union**3) * weights) / 3

    batch = max(1, IN_FLIGHT // (len(weights) * axis.shape[1]))
    local = (axis, radius, height, used, ball)
    return jnp.sum(jax.lax.map(at_joint, local, batch_size=min(batch, len(axis))))
