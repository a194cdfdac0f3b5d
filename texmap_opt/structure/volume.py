"""Volume of a lattice whose struts overlap at the joints, differentiable in radii and joints.

The sum of the struts' own volumes counts the inside of each joint once for every strut there. Seen
from a joint, each half strut is star-shaped: in the direction omega, at an angle theta < 90 degrees
to its axis, it reaches to rho = min(r/(sin theta - m cos theta), h/cos theta) with h its length and
m the growth of its radius along it, and a volume is (1/3) of the integral of rho³ over the unit
sphere. So what is counted too much at a joint is

    overlap = (1/3) integral of [sum_i rho_i³ - max(R, max_i rho_i)³] d omega

with R the radius of the joint's ball, its thickest strut; no ball at joints that the part's
surface cuts. Where a strut meets no other, its own rho is the maximum and cancels, so the end at h
leaves no trace. A strut is halved between its joints, unless one of them is a cut that no other
strut shares: then all of it belongs to the other. Not seen: struts that cross without a joint, and
overlaps beyond the half.

Walls of an extruded lattice overlap in their plane: seen from a joint each half wall reaches to the
same rho, a plane area is (1/2) of the integral of rho² over the circle, the ball is a disc, and an
overlap is as deep as the walls of the joint are on the mean.

The quadratures are in `texmap_opt.structure.directions`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.errors import LatticeError
from texmap_opt.structure.directions import circle_quadrature, sphere_quadrature
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.strut_geometry import strut_lengths

# Traced by JAX, or the host's.
ArrayLike = Array | np.ndarray

# The quadratures have 48 m² directions. Measured: 432 on the sphere are within 0.2 % of the volume of
# an octet of 10 % density, whichever way it is turned.
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
        depth: of the joint's walls, on the mean [mm]; 1 for bars.
    """

    strut: Int[ArrayLike, "joints slots"]
    end: Int[ArrayLike, "joints slots"]
    share: Float[ArrayLike, "joints slots"]
    ball: Float[ArrayLike, " joints"]
    depth: Float[ArrayLike, " joints"]


@dataclass(frozen=True, eq=False)
class LatticeVolume:
    """Overlap-corrected volume of a lattice of given connectivity.

    Attributes:
        struts: joints of each strut.
        square: whether sections are square.
        depth: of each wall [mm]; None: struts are bars.
        meetings: joints by valence; those where nothing overlaps are left out.
        directions: of the quadrature.
        weights: their solid angles [sr], or their angles [rad] in the plane of walls.
    """

    struts: Int[np.ndarray, "struts 2"]
    square: bool
    depth: Float[np.ndarray, " struts"] | None
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
        walls = structure.extrusion
        directions, weights = (
            sphere_quadrature(subdivisions)
            if walls is None
            else circle_quadrature(subdivisions, walls.axis)
        )
        seen = np.ones(len(structure.joints), bool) if seen is None else seen
        depth = None if walls is None else walls.depth
        return cls(
            structure.struts,
            structure.section == "square",
            depth,
            _meetings(structure, seen, _joint_depths(structure)),
            directions,
            weights,
        )

    @property
    def degree(self) -> int:
        """Power of the radius that the volume of a strut follows: 2, or 1 for walls."""
        return 2 if self.depth is None else 1

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
        return jnp.sum(self.strut_volumes(joints, radii)) - self.overlap(joints, radii)

    def strut_volumes(
        self,
        joints: Float[ArrayLike, "joints 3"],
        radii: Float[ArrayLike, "struts 2"],
    ) -> Float[ArrayLike, " struts"]:
        """Each tapered strut's own volume between its joints' centres [mm³]; arguments as above.

        Of NumPy's arrays it is one of these, of JAX's one of JAX.
        """
        length = strut_lengths(joints, self.struts)  # pyright: ignore[reportArgumentType]
        a, b = self.as_round(radii).T
        if self.depth is None:
            return np.pi / 3 * length * (a * a + a * b + b * b)
        return self.depth * length * (a + b)

    def overlap(
        self,
        joints: Float[ArrayLike, "joints 3"],
        radii: Float[ArrayLike, "struts 2"],
    ) -> Float[Array, ""]:
        """What the struts' own volumes count too much at the joints [mm³]; arguments as above."""
        joints, radii = jnp.asarray(joints), jnp.asarray(self.as_round(radii))
        ends, quadrature = joints[self.struts], (self.directions, self.weights)
        return sum(
            (_overlap(ends, radii, m, quadrature, self.degree + 1) for m in self.meetings),
            start=jnp.zeros(()),
        )

    def host_volume(
        self,
        joints: Float[np.ndarray, "joints 3"],
        radii: Float[np.ndarray, "struts 2"],
        *,
        share: Float[np.ndarray, " struts"],
    ) -> float:
        """The same volume by NumPy [mm³]: quicker for a few joints, as nothing is compiled for them.

        Args:
            joints: positions [mm].
            radii: radius, or half the side, at both ends [mm].
            share: of each strut's own volume that counts.
        """
        radii_of_round = self.as_round(radii)
        ends, quadrature = joints[self.struts], (self.directions, self.weights)
        volume = float(share @ self.strut_volumes(joints, radii))
        for meeting in self.meetings:
            seen = _half_struts(ends, radii_of_round, meeting)
            volume -= float(meeting.depth @ _joint_overlaps(seen, quadrature, self.degree + 1))
        return volume

    @property
    def value_and_gradient(self) -> Callable:
        """Function of joints and radii: the volume, and its gradient in the radii."""
        return jax.value_and_grad(self.__call__, argnums=1)

    def as_round(self, radii: Float[ArrayLike, "struts 2"]) -> Float[ArrayLike, "struts 2"]:
        """Radii of the round struts of the same area [mm]."""
        return radii * SQUARE_TO_ROUND if self.square else radii


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
    # Volume grows about as r², of walls as r, so the secant is drawn through (r², V) or (r, V), kept
    # within the bracket.
    power = measure.degree
    low, high = (0.0, 0.0), (largest**power, reach)
    unit = float(jnp.sum(measure.strut_volumes(structure.joints, ones)))
    grown = min(volume / unit, largest**power / 2)
    for _ in range(MAX_STEPS):
        radius = float(grown ** (1 / power))
        now = volume_of(radius)
        if abs(now - volume) <= VOLUME_RTOL * volume:
            return radius
        low, high = ((grown, now), high) if now < volume else (low, (grown, now))
        grown = _between(low, high, volume)
    raise LatticeError(f"No uniform radius found for volume = {volume:.4g} mm³; change the radius.")


def _between(low: tuple[float, float], high: tuple[float, float], volume: float) -> float:
    """Abscissa between two points where a line through them, kept off their ends, is `volume`."""
    fraction = (volume - low[1]) / (high[1] - low[1])
    return low[0] + (high[0] - low[0]) * fraction


def _joint_depths(structure: Structure) -> Float[np.ndarray, " joints"]:
    """Mean depth of the walls at each joint [mm]; ones where struts are bars."""
    if structure.extrusion is None:
        return np.ones(len(structure.joints))
    total = np.zeros(len(structure.joints))
    np.add.at(total, structure.struts, structure.extrusion.depth[:, None])
    return total / np.maximum(structure.degrees(), 1)


def _meetings(
    structure: Structure,
    seen: Bool[np.ndarray, " joints"],
    depth: Float[np.ndarray, " joints"],
) -> tuple[Meeting, ...]:
    """Half struts by joint, joints by valence; a strut alone at a cut overlaps nothing there."""
    struts, cut = structure.struts, structure.cut
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
                depth[here],
            )
        )
    return tuple(meetings)


class _HalfStruts(NamedTuple):
    """Half struts as their joints see them.

    Attributes:
        axis: unit vectors away from the joint.
        radius: at the joint, of round struts, or half the thickness of walls [mm].
        slope: growth of the radius along the axis.
        height: how far each reaches [mm].
        used: False where padded.
        ball: radius of each joint's ball [mm]; 0 where it has none.
    """

    axis: Float[ArrayLike, "*joints slots 3"]
    radius: Float[ArrayLike, "*joints slots"]
    slope: Float[ArrayLike, "*joints slots"]
    height: Float[ArrayLike, "*joints slots"]
    used: Bool[ArrayLike, "*joints slots"]
    ball: Float[ArrayLike, "*joints"]


@eqx.filter_jit
def _overlap(
    strut_ends: Float[Array, "struts 2 3"],
    radii: Float[Array, "struts 2"],
    meeting: Meeting,
    quadrature: tuple[Float[ArrayLike, "quad 3"], Float[ArrayLike, " quad"]],
    power: int,
) -> Float[Array, ""]:
    """Overlap summed over the joints of one meeting [mm³].

    Args:
        strut_ends: positions of the joints of each strut [mm].
        radii: of round struts, or half the thickness of walls [mm].
        meeting: the joints.
        quadrature: directions and their weights.
        power: 3 in space, 2 in the plane of walls.
    """
    seen = _half_struts(strut_ends, radii, meeting)

    @jax.checkpoint
    def at_joint(of_one: _HalfStruts) -> Float[ArrayLike, ""]:
        return _joint_overlaps(of_one, quadrature, power)

    joints, slots = seen.radius.shape
    batch = max(1, IN_FLIGHT // (len(quadrature[1]) * slots))
    return jnp.sum(meeting.depth * jax.lax.map(at_joint, seen, batch_size=min(batch, joints)))


def _half_struts(
    strut_ends: Float[ArrayLike, "struts 2 3"],
    radii: Float[ArrayLike, "struts 2"],
    meeting: Meeting,
) -> _HalfStruts:
    """What the joints of a meeting see, by NumPy or JAX as the radii are; arguments of `_overlap`."""
    xp = radii.__array_namespace__()
    ends = strut_ends[meeting.strut]
    here = meeting.end[:, :, None]
    out = xp.where(here == 0, ends[:, :, 1] - ends[:, :, 0], ends[:, :, 0] - ends[:, :, 1])
    length = xp.linalg.norm(out, axis=-1)
    radius = radii[meeting.strut, meeting.end]
    slope = (radii[meeting.strut, 1 - meeting.end] - radius) / length
    used = meeting.share > 0
    mean = xp.mean(radius, axis=1, keepdims=True, where=used)
    share = xp.where(used, BALL_SHARPNESS * radius / mean, -xp.inf)
    # Over the largest: the exponentials do not overflow.
    weight = xp.exp(share - xp.max(share, axis=1, keepdims=True))
    ball = xp.sum(weight * radius, axis=1) / xp.sum(weight, axis=1)
    return _HalfStruts(
        axis=out / length[..., None],
        radius=radius,
        slope=slope,
        height=xp.where(used, meeting.share * length, 1.0),
        used=used,
        ball=ball * meeting.ball,
    )


def _joint_overlaps(
    seen: _HalfStruts,
    quadrature: tuple[Float[ArrayLike, "quad 3"], Float[ArrayLike, " quad"]],
    power: int,
) -> Float[ArrayLike, "*joints"]:
    """Overlap at one joint or at each of several [mm³], by NumPy or JAX as the radii are."""
    xp = seen.radius.__array_namespace__()
    directions, weights = quadrature
    cosine = seen.axis @ directions.T  # slot, direction
    sine = xp.sqrt(xp.maximum(1 - cosine**2, SMALLEST_SINE_SQUARED))
    opening = sine - seen.slope[..., None] * cosine
    rho = 1 / xp.maximum(opening / seen.radius[..., None], cosine / seen.height[..., None])
    rho = xp.where((cosine > 0) & seen.used[..., None], rho, 0.0)
    union = xp.maximum(xp.max(rho, axis=-2), seen.ball[..., None])
    return ((xp.sum(rho**power, axis=-2) - union**power) @ weights) / power
