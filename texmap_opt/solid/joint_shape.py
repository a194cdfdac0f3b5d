"""How far a joint's solid reaches in any direction: the union of its struts and ball, with fillets.

Seen from the joint its ball and its half struts are star-shaped, and so is their union. In the
direction omega, at an angle theta to its axis, a round strut of radius r + m z reaches to
r / (sin theta - m cos theta), where it is a cylinder to r / sin theta.

A fillet of radius rho is what a ball of that radius rolled over the outside cannot reach: the
closing of mathematical morphology (Serra 1982), the grow and shrink of Chen (2007). Its surface is
where the nearest place for the ball's centre, on the struts thickened by rho, is rho away.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

# A strut is not looked at nearer its axis than this sine: directions there lie inside its ring.
SMALLEST_SINE = 1e-6
# Most steps towards a fillet's surface, in each of which the rolling ball's place is found anew, and
# the last step, in radii of the fillet, that counts as arrived. Four or five are usual.
FILLET_STEPS = 24
FILLET_PRECISION = 1e-3
# Steps to the ball's place when only a distance is asked for.
RESTING_STEPS = 4
# Cosine of the steepest angle of the way to the ball's centre at which Newton's step is trusted.
LEAST_COSINE = 0.3
# Sets of rests that can carry a step, the newest first: it and none, one or two of the others.
CARRYING = ((0,), (0, 1), (0, 2), (0, 3), (0, 1, 2), (0, 1, 3), (0, 2, 3))
# Most exchanges of rests; three to five are usual.
MAX_EXCHANGES = 16
# Slack of a constraint that counts as kept [mm], and determinant of rests that are independent.
KEPT = 1e-9
INDEPENDENT = 1e-9
# Directions looked at together: rows of 160 kB stay near the processor.
SAMPLES_AT_ONCE = 20_000
# Directions times struts in flight where there are fillets.
IN_FLIGHT = 400_000


@dataclass(frozen=True, eq=False)
class JointShapes:
    """Joints of equal valence.

    Attributes:
        axis: unit directions of the struts, away from the joint.
        u: unit vectors across them; for square struts along a diagonal.
        radius: of round struts; half the diagonal of square ones, at the joint [mm].
        slope: its growth along the axis.
        square: whether sections are square.
        ball: radius of the joint's own ball [mm]; 0 for square struts, which have none.
        back: how far a strut goes on behind the joint [mm]; 0 for round ones.
        fillet: radius of the fillets [mm].
    """

    axis: Float[np.ndarray, "joints slots 3"]
    u: Float[np.ndarray, "joints slots 3"]
    radius: Float[np.ndarray, "joints slots"]
    slope: Float[np.ndarray, "joints slots"]
    square: bool
    ball: Float[np.ndarray, " joints"]
    back: Float[np.ndarray, "joints slots"]
    fillet: Float[np.ndarray, " joints"]

    def reach(
        self, direction: Float[np.ndarray, "samples 3"], joint: Int[np.ndarray, " samples"]
    ) -> Float[np.ndarray, " samples"]:
        """Distance of the surface from the joint, fillets included [mm].

        Args:
            direction: unit vectors outside the struts' rings.
            joint: whose surface is asked for.
        """
        distance = np.zeros(len(direction))
        for start in range(0, len(direction), SAMPLES_AT_ONCE):
            chunk = slice(start, start + SAMPLES_AT_ONCE)
            distance[chunk] = self._union(direction[chunk], joint[chunk])
        filleted = np.flatnonzero(self.fillet[joint] > 0)
        step = max(1, IN_FLIGHT // self.axis.shape[1])
        for start in range(0, len(filleted), step):
            chunk = filleted[start : start + step]
            rolled = self._filleted(direction[chunk], joint[chunk], distance[chunk])
            distance[chunk] = rolled
        return distance

    def distance(
        self, points: Float[np.ndarray, "samples 3"], joint: Int[np.ndarray, " samples"]
    ) -> Float[np.ndarray, " samples"]:
        """Distance of points from the surface [mm], exact near it.

        Args:
            points: from the joint [mm].
            joint: whose surface is asked for.
        """
        result = np.zeros(len(points))
        for start in range(0, len(points), SAMPLES_AT_ONCE):
            chunk = slice(start, start + SAMPLES_AT_ONCE)
            result[chunk] = self._from_union(points[chunk], joint[chunk])
        filleted = np.flatnonzero(self.fillet[joint] > 0)
        step = max(1, IN_FLIGHT // self.axis.shape[1])
        for start in range(0, len(filleted), step):
            chunk = filleted[start : start + step]
            point, owner = points[chunk], joint[chunk]
            centre = point
            for _ in range(RESTING_STEPS):
                centre = self._resting(point, centre, owner)
            arm = point - centre
            result[chunk] = np.abs(np.sqrt(_dot(arm, arm)) - self.fillet[owner])
        return result

    def _from_union(self, point: np.ndarray, joint: np.ndarray) -> np.ndarray:
        """Distance from the surface without fillets [mm]."""
        axis, u, v, radius, slope, back = self._by_slot
        xyz = np.ascontiguousarray(point.T)

        def along(vectors: np.ndarray) -> np.ndarray:
            x, y, z = vectors
            return x[joint] * xyz[0] + y[joint] * xyz[1] + z[joint] * xyz[2]

        square = _dot(point, point)
        nearest = np.full(len(point), np.inf) if self.square else np.sqrt(square) - self.ball[joint]
        for slot in range(len(axis)):
            height = along(axis[slot])
            if self.square:
                across = np.abs(along(u[slot])) + np.abs(along(v[slot]))
                gap = (across - radius[slot][joint] - slope[slot][joint] * height) / np.sqrt(2)
                gap = np.maximum(gap, -height - back[slot][joint])
            else:
                across = np.sqrt(np.maximum(square - height * height, 0))
                gap = across - radius[slot][joint] - slope[slot][joint] * height
                gap[height <= 0] = np.inf
            np.minimum(nearest, gap, out=nearest)
        return np.abs(nearest)

    @cached_property
    def _by_slot(self) -> tuple[np.ndarray, ...]:
        """Axes, directions across, radii, slopes and backs, by slot and by coordinate.

        Long contiguous rows: three times as fast as one joint after the other.
        """
        arrays = (
            self.axis,
            self.u,
            np.cross(self.axis, self.u),
            self.radius,
            self.slope,
            self.back,
        )
        return tuple(np.ascontiguousarray(np.moveaxis(array, 0, -1)) for array in arrays)

    def _union(self, direction: np.ndarray, joint: np.ndarray) -> np.ndarray:
        """Distance of the surface without fillets [mm]."""
        axis, u, v, radius, slope, back = self._by_slot
        xyz = np.ascontiguousarray(direction.T)

        def along(vectors: np.ndarray) -> np.ndarray:
            x, y, z = vectors
            return x[joint] * xyz[0] + y[joint] * xyz[1] + z[joint] * xyz[2]

        farthest = self.ball[joint]
        for slot in range(len(axis)):
            cosine = along(axis[slot])
            if self.square:
                across = np.abs(along(u[slot])) + np.abs(along(v[slot]))
            else:
                across = np.sqrt(np.maximum(1 - cosine * cosine, 0))
            across -= slope[slot][joint] * cosine
            reach = radius[slot][joint] / np.maximum(across, SMALLEST_SINE)
            behind = cosine <= 0
            if self.square:
                end = np.divide(back[slot][joint], -cosine, out=reach.copy(), where=cosine < 0)
                reach[behind] = np.minimum(reach, end)[behind]
            else:
                reach[behind] = 0
            np.maximum(farthest, reach, out=farthest)
        return farthest

    def _filleted(
        self, direction: np.ndarray, joint: np.ndarray, distance: np.ndarray
    ) -> np.ndarray:
        """Distance of the surface with fillets [mm], from that without."""
        result = distance.copy()
        going = np.arange(len(distance))
        centre = distance[:, None] * direction
        for _ in range(FILLET_STEPS):
            along, owner = direction[going], joint[going]
            rho = self.fillet[owner]
            point = result[going, None] * along
            centre = self._resting(point, centre, owner)
            arm = point - centre
            length = np.sqrt(_dot(arm, arm))
            # The point is in the fillet while the ball is farther away than it reaches. Its distance
            # falls at most as fast as the way grows: a step of what is too much never leads too
            # far; Newton's is longer, where the way leads towards the ball.
            cosine = -_dot(arm, along) / np.maximum(length, np.finfo(float).tiny)
            step = (length - rho) / np.where(cosine > LEAST_COSINE, cosine, 1.0)
            result[going] += np.clip(step, -rho / 2, rho)
            open_ = np.abs(step) > FILLET_PRECISION * rho
            going, centre = going[open_], centre[open_]
            if not len(going):
                break
        return np.maximum(result, distance)

    def _resting(self, point: np.ndarray, centre: np.ndarray, joint: np.ndarray) -> np.ndarray:
        """The nearest place to `point` for the centre of a ball that touches the solid.

        Args:
            point: where from [mm].
            centre: an estimate of the place [mm].
            joint: whose solid.
        """
        gap, normal = self._gaps(centre, joint)
        # Linearised: gap + normal . (place - centre) >= rho.
        wanted = self.fillet[joint][:, None] - gap
        wanted -= (normal @ (point - centre)[:, :, None])[..., 0]
        return point + nearest_step(normal, wanted)

    def _gaps(self, point: np.ndarray, joint: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances from the struts and the ball [mm], and unit directions away from them."""
        axis = self.axis[joint]
        along = (axis @ point[:, :, None])[..., 0]
        across = point[:, None] - along[..., None] * axis
        if self.square:
            return self._from_square(axis, joint, along, across)
        # A cone's wall leans: both the distance and its direction turn by the slope.
        slope = self.slope[joint]
        lean = 1 / np.sqrt(1 + slope**2)
        width = np.sqrt(np.einsum("jsd,jsd->js", across, across))
        away = across / np.maximum(width, np.finfo(float).tiny)[..., None]
        away = lean[..., None] * (away - slope[..., None] * axis)
        distance = (width - self.radius[joint] - slope * along) * lean
        length = np.sqrt(_dot(point, point))
        radial = point / np.maximum(length, np.finfo(float).tiny)[:, None]
        # Behind the joint the ball alone counts: a strut is as far there as nothing can be.
        nowhere = 2 * length[:, None] + 2 * self.ball[joint][:, None] + self.fillet[joint][:, None]
        distance = np.where(along > 0, distance, nowhere)
        gap = np.column_stack([distance, length - self.ball[joint]])
        return gap, np.concatenate([away, radial[:, None]], axis=1)

    def _from_square(
        self, axis: np.ndarray, joint: np.ndarray, along: np.ndarray, across: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distance from square columns and their ends, and the direction away from them."""
        u, slope = self.u[joint], self.slope[joint] / np.sqrt(2)
        v = np.cross(axis, u)
        sides = np.stack([u + v, u - v]) / np.sqrt(2)
        half = self.radius[joint] / np.sqrt(2) + slope * along
        place = np.einsum("kjsd,jsd->kjs", sides, across)
        lean = 1 / np.sqrt(1 + slope**2)
        beyond = np.concatenate(
            [lean * (np.abs(place) - half), (-along - self.back[joint])[None]], axis=0
        )
        walls = np.where(place < 0, -1.0, 1.0)[..., None] * sides - slope[..., None] * axis
        walls = np.concatenate([lean[..., None] * walls, -axis[None]], axis=0)
        outside = np.maximum(beyond, 0)
        far = np.sqrt(np.einsum("kjs,kjs->js", outside, outside))
        inside = beyond.max(axis=0)
        nearest = (beyond == inside) / (beyond == inside).sum(axis=0)
        weight = np.where(far > 0, outside / np.where(far > 0, far, 1), nearest)
        away = np.einsum("kjs,kjsd->jsd", weight, walls)
        return np.where(far > 0, far, inside), away


def nearest_step(
    normal: Float[np.ndarray, "samples rests 3"], wanted: Float[np.ndarray, "samples rests"]
) -> Float[np.ndarray, "samples 3"]:
    """The shortest step s with normal . s >= wanted for every rest.

    At most three rests carry it. The rest that a step misses most joins those that carried it; of
    these four the new one and at most two others carry the next step, which is longer, so that the
    search ends (a linear program's way of adding constraints; Seidel 1991). Where rounding leaves
    none that keeps all four, the step stays as it is.

    Args:
        normal: unit vectors.
        wanted: how far along each of them the step must lead at least.
    """
    count, rests = wanted.shape
    best = np.zeros((count, 3))
    # A rest that nothing rests on stands for none.
    normal = np.concatenate([normal, np.zeros((count, 1, 3))], axis=1)
    wanted = np.concatenate([wanted, np.full((count, 1), -np.inf)], axis=1)
    carrying = np.full((count, 3), rests)
    rows = np.arange(count)
    for _ in range(MAX_EXCHANGES):
        left = wanted[rows] - (normal[rows] @ best[rows][:, :, None])[..., 0]
        newest = left.argmax(axis=1)
        missed = left[np.arange(len(rows)), newest] > KEPT
        rows, newest = rows[missed], newest[missed]
        if not len(rows):
            break
        four = np.column_stack([newest, carrying[rows]])
        found, step, chosen = _carried(normal[rows[:, None], four], wanted[rows[:, None], four])
        named = np.column_stack([four, np.full(len(four), rests)])
        carrying[rows] = np.take_along_axis(named, chosen, axis=1)
        rows = rows[found]
        best[rows] = step[found]
    return best


def _carried(
    normal: Float[np.ndarray, "samples 4 3"], wanted: Float[np.ndarray, "samples 4"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The step that the first rest and at most two of the others carry, keeping all four.

    Returns:
        whether there is one, the step, and which rests carry it (4 stands for none).
    """
    count = len(wanted)
    found, step = np.zeros(count, bool), np.zeros((count, 3))
    carrying = np.full((count, 3), 4)
    for chosen in CARRYING:
        rows = np.flatnonzero(~found)
        if not len(rows):
            break
        members = list(chosen)
        push = _pushes(normal[rows][:, members], wanted[rows][:, members])
        tried = np.einsum("ik,ikd->id", push, normal[rows][:, members])
        left = (wanted[rows] - (normal[rows] @ tried[:, :, None])[..., 0]).max(axis=1)
        good = (push >= 0).all(axis=1) & (left <= KEPT)
        rows = rows[good]
        found[rows], step[rows] = True, tried[good]
        carrying[rows, : len(members)] = members
    return found, step, carrying


def _pushes(
    normal: Float[np.ndarray, "samples rests 3"], wanted: Float[np.ndarray, "samples rests"]
) -> Float[np.ndarray, "samples rests"]:
    """Multipliers of the rests whose step leads exactly as far as wanted; -1 where dependent."""
    wanted = np.where(np.isfinite(wanted), wanted, -1.0)
    if wanted.shape[1] == 1:
        return wanted
    a, b = normal[:, 0], normal[:, 1]
    if wanted.shape[1] == 2:
        g = _dot(a, b)
        determinant = 1 - g * g
        push = wanted - g[:, None] * wanted[:, ::-1]
    else:
        # The step is at once in three planes; its multipliers follow from the reciprocal basis.
        c = normal[:, 2]
        reciprocal = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        volume = _dot(a, reciprocal[:, 0])
        step = np.einsum("ik,ikd->id", wanted, reciprocal)
        push = (reciprocal @ step[:, :, None])[..., 0]
        determinant = volume * volume
    sound = determinant > INDEPENDENT
    return np.where(sound[:, None], push / np.where(sound, determinant, 1)[:, None], -1.0)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)
