"""Where struts begin: the rings at which they leave their joints.

Seen from its joint a strut of radius r + m z fills a cap of directions, wider near the joint. Two
struts at an angle theta meet at the crotch where both are seen at the same distance,

    r_i / (sin a - m_i cos a) = r_j / (sin b - m_j cos b),    a + b = theta,

which gives tan a = (r_i (sin theta - m_j cos theta) + r_j m_i) / (r_j + r_i (cos theta + m_j sin
theta)); for equal radii a is half of theta. Likewise a strut leaves the joint's ball at sin a =
r_i / R. The ring lies a little beyond the farthest of these, where the strut's corners are seen at a
smaller angle than from any of them: so rings do not meet, and nothing else reaches over them.

With a fillet the crotch is that of struts thickened by the fillet's radius, where a ball of that
radius rests on both.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.solid.struts import frames
from texmap_opt.structure.structure import Structure

# Share of the angle to the crotch at which a ring is seen: what is left keeps rings apart.
CAP_SHARE = 0.98
# The same for the place where a strut leaves the ball: balls of facets stand out by a tenth.
BALL_SHARE = 0.9
# Widest cap [rad]: rings are then nearer than a radius to their joint. A lone end, where nothing
# else has to fit, may be wider: struts cut off close to a joint keep a length of their own.
WIDEST_CAP = np.deg2rad(50.0)
WIDEST_LONE_CAP = np.deg2rad(80.0)
# Share of a strut's length that the rings at its ends may use up.
USABLE_LENGTH = 0.98
# Largest fillet, over the radius at which the places of its ball are bent.
FILLET_SHARE = 0.9
# Factor by which a fillet without room is made smaller, and how often: at last to 4 % of it.
CLAMPING = 0.85
MAX_CLAMPS = 20
# Digits of a direction that put the struts of a joint in order.
DIGITS = 7
# Joints times pairs of struts in flight: arrays of 16 MB.
IN_FLIGHT = 2_000_000


@dataclass(frozen=True, eq=False)
class StrutEnds:
    """The ends of all struts, joint by joint.

    In each joint they are ordered by their directions, so that equal joints have equal ends.

    Attributes:
        structure: joints, struts and radii.
        section: corners of the section of unit radius, counter-clockwise, corner k at k turns/n.
        end: strut times two, plus 1 for its second end.
        first: where the ends of each joint begin; one more entry than joints.
        axis: unit direction of the strut, away from the joint.
        u: unit vector across it, towards the first corner of the section.
        radius: of the strut at the joint [mm].
        slope: growth of the radius along the axis.
        fillet: radius of the fillets at each joint [mm].
    """

    structure: Structure
    section: Float[np.ndarray, "corners 2"]
    end: Int[np.ndarray, " ends"]
    first: Int[np.ndarray, " bounds"]
    axis: Float[np.ndarray, "ends 3"]
    u: Float[np.ndarray, "ends 3"]
    radius: Float[np.ndarray, " ends"]
    slope: Float[np.ndarray, " ends"]
    fillet: Float[np.ndarray, " joints"]

    @classmethod
    def of(cls, structure: Structure, section: Float[np.ndarray, "corners 2"]) -> "StrutEnds":
        """The ends of a structure's struts, without fillets."""
        start, end = np.moveaxis(structure.joints[structure.struts], 1, 0)
        length = np.linalg.norm(end - start, axis=1)
        axis = (end - start) / length[:, None]
        u, v = frames(axis)
        if len(section) == 4:  # a flat of the square, not a corner, looks along the frame
            u = (u + v) / np.sqrt(2)
        radii = structure.radii
        slope = (radii[:, 1] - radii[:, 0]) / length
        both = np.stack([axis, -axis], axis=1).reshape(-1, 3)
        # Rounded, so that equal directions have equal places; 0.0 turns -0.0 into it.
        x, y, z = (np.round(both, DIGITS) + 0.0).T
        joint = structure.struts.reshape(-1)
        order = np.lexsort((z, y, x, joint))
        valence = np.bincount(joint, minlength=len(structure.joints))
        return cls(
            structure,
            section,
            order,
            np.concatenate([[0], np.cumsum(valence)]),
            both[order],
            np.repeat(u, 2, axis=0)[order],
            radii.reshape(-1)[order],
            np.stack([slope, -slope], axis=1).reshape(-1)[order],
            np.zeros(len(structure.joints)),
        )

    @property
    def corner_radius(self) -> float:
        """Distance of the section's corners from its middle, for a radius of 1."""
        return float(np.linalg.norm(self.section[0]))

    @property
    def square(self) -> bool:
        """Whether sections are square."""
        return self.structure.section == "square"

    @property
    def valence(self) -> Int[np.ndarray, " joints"]:
        """Struts at each joint."""
        return np.diff(self.first)

    @cached_property
    def joint(self) -> Int[np.ndarray, " ends"]:
        """Joint of each end."""
        return np.repeat(np.arange(len(self.valence)), self.valence)

    @cached_property
    def thick(self) -> Float[np.ndarray, " ends"]:
        """Distance of the section's corners from the axis at the joint, and the fillet [mm]."""
        return self.corner_radius * self.radius + self.fillet[self.joint]

    @cached_property
    def cap(self) -> Float[np.ndarray, " ends"]:
        """Angle at which each strut's corners, thickened by the fillet, are seen at its ring [rad]."""
        thickest = np.zeros(len(self.valence))
        np.maximum.at(thickest, self.joint, self.thick)
        # Where r / (sin a - m cos a) = R: the angle leans with the strut's wall.
        lean = self.corner_radius * self.slope
        sine = BALL_SHARE * self.thick / thickest[self.joint] / np.sqrt(1 + lean**2)
        cap = np.arcsin(sine) + np.arctan(lean)
        lone = self.valence[self.joint] == 1
        cap = np.minimum(cap, np.where(lone, WIDEST_LONE_CAP, WIDEST_CAP))
        for ends in self._meetings():
            cap[ends] = np.minimum(cap[ends], self._shared(ends))
        return cap

    @cached_property
    def widest_fillet(self) -> Float[np.ndarray, " ends"]:
        """Largest fillet between each strut and any other of its joint [mm]; inf without others."""
        widest = np.full(len(self.end), np.inf)
        for ends in self._meetings():
            axis, radius = self.axis[ends], self.corner_radius * self.radius[ends]
            chord = np.linalg.norm(axis[:, :, None] - axis[:, None], axis=-1)
            share = FILLET_SHARE * chord / 2
            mean = (radius[:, :, None] + radius[:, None]) / 2
            bent = mean * share / (1 - share)
            itself = np.arange(ends.shape[1])
            bent[:, itself, itself] = np.inf
            widest[ends] = bent.min(axis=2)
        return widest

    def _meetings(self) -> Iterator[Int[np.ndarray, "joints slots"]]:
        """Ends that meet others, joints of equal valence together."""
        for valence in np.unique(self.valence[self.valence > 1]):
            joints = np.flatnonzero(self.valence == valence)
            step = max(1, IN_FLIGHT // int(valence) ** 2)
            for start in range(0, len(joints), step):
                yield self.ends_of(joints[start : start + step])

    def ends_of(self, joints: Int[np.ndarray, " chosen"]) -> Int[np.ndarray, "chosen slots"]:
        """Numbers of the ends of joints that have equally many."""
        return self.first[joints, None] + np.arange(int(self.valence[joints[0]]))

    def _shared(self, ends: np.ndarray) -> np.ndarray:
        """The part of the narrowest angle to another strut that is each strut's own."""
        axis, radius = self.axis[ends], self.thick[ends]
        slope = self.corner_radius * self.slope[ends]
        cosine = np.einsum("jad,jbd->jab", axis, axis)
        # Near 1 the cosine has no digits left for the sine: the cross product has.
        sine = np.linalg.norm(np.cross(axis[:, :, None], axis[:, None]), axis=-1)
        mine, other = radius[:, :, None], radius[:, None]
        m_i, m_j = slope[:, :, None], slope[:, None]
        share = np.arctan2(
            mine * (sine - m_j * cosine) + other * m_i, other + mine * (cosine + m_j * sine)
        )
        # Behind its joint a strut is nothing: there the ball is met.
        share = np.where(np.arctan2(sine, cosine) - share < np.pi / 2, share, np.inf)
        itself = np.arange(ends.shape[1])
        share[:, itself, itself] = np.inf
        return CAP_SHARE * share.min(axis=2)

    @cached_property
    def ring(self) -> Float[np.ndarray, " ends"]:
        """Distance of each ring from its joint along the axis [mm]; inf where there is none.

        The corners of the section, thickened by the fillet, are seen at the angle of the cap.
        """
        opening = np.tan(self.cap) - self.corner_radius * self.slope
        sound = (self.cap > 0) & (opening > 0)
        return np.divide(self.thick, opening, out=np.full_like(opening, np.inf), where=sound)

    @cached_property
    def used(self) -> Float[np.ndarray, " struts"]:
        """Length of each strut that the rings at its two ends leave behind them [mm]."""
        return self.by_strut(self.ring).sum(axis=1)

    @cached_property
    def place(self) -> Int[np.ndarray, " ends"]:
        """Where the ends of each strut, its first and its second, are found here."""
        place = np.zeros(len(self.end), np.int64)
        place[self.end] = np.arange(len(self.end))
        return place

    def by_strut(self, values: Float[np.ndarray, " ends"]) -> Float[np.ndarray, "struts 2"]:
        """Values of the ends, in the order of the structure's struts."""
        return values[self.place].reshape(-1, 2)

    @cached_property
    def short(self) -> Bool[np.ndarray, " struts"]:
        """Struts whose rings leave no strut between them."""
        return ~(self.used <= USABLE_LENGTH * self.structure.lengths())

    def ring_corners(
        self, chosen: Int[np.ndarray, " chosen"] | None = None
    ) -> Float[np.ndarray, "chosen corners 3"]:
        """Positions of the corners of rings, seen from outside counter-clockwise [mm].

        Corner l at the second end of a strut continues corner -l at its first.

        Args:
            chosen: numbers of the ends; absent: all.
        """
        e = np.arange(len(self.end)) if chosen is None else chosen
        # Rings that are nowhere belong to clusters, which do not use them.
        ring = np.where(np.isfinite(self.ring[e]), self.ring[e], 0.0)
        radius = self.radius[e] + self.slope[e] * ring
        middle = self.structure.joints[self.joint[e]] + ring[:, None] * self.axis[e]
        return middle[:, None] + radius[:, None, None] * self.across(e)

    def sections(self, chosen: Int[np.ndarray, " chosen"]) -> Float[np.ndarray, "chosen corners 3"]:
        """Corners of struts at their joints, in the order of those of the rings [mm]."""
        joint = self.structure.joints[self.joint[chosen]]
        return joint[:, None] + self.radius[chosen, None, None] * self.across(chosen)

    def across(self, chosen: Int[np.ndarray, " chosen"]) -> Float[np.ndarray, "chosen corners 3"]:
        """From the axis to the corners of a section of unit radius."""
        u, v = self.u[chosen], np.cross(self.axis[chosen], self.u[chosen])
        return self.section[:, 0, None] * u[:, None] + self.section[:, 1, None] * v[:, None]

    def filleted(self, fillet: Float[np.ndarray, " joints"]) -> "StrutEnds":
        """The same ends with fillets at the joints [mm]."""
        return replace(self, fillet=fillet)


def clamped_fillets(ends: StrutEnds, fillet: float) -> Float[np.ndarray, " joints"]:
    """Fillets up to `fillet` [mm] that have room.

    In the plane of two struts of mean radius r at an angle theta, the places where a ball of radius rho
    rests on both are bent with the radius (r + rho) sin(theta/2): a fillet stays below
    `FILLET_SHARE` of it. Where a strut is left without a length of its own, the fillets at both its
    joints are made smaller by steps of `CLAMPING`.
    """
    radius = np.where(ends.valence > 1, fillet, 0.0)
    np.minimum.at(radius, ends.joint, ends.widest_fillet)
    struts = ends.structure.struts
    for k in range(MAX_CLAMPS):
        tight = np.unique(struts[ends.filleted(radius).short & ~ends.short])
        if not len(tight):
            break
        radius[tight] *= CLAMPING if k + 1 < MAX_CLAMPS else 0.0
    return radius
