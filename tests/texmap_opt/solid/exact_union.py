"""The union of struts that meet in one joint, exactly, by another way than the mesher's.

Seen from the joint its ball and its struts are star-shaped, so that in every direction the farthest
of them is the union's surface. What struts and ball count more than once is an integral over the
directions; the far ends are bodies of revolution in closed form.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from texmap_opt.structure.structure import Structure

# Directions of the quadrature: 0.3 degrees apart, a sixteenth of the smallest angle of the tests.
DIRECTIONS = 400_000
# Directions at once: arrays of 200 kB stay near the processor.
AT_ONCE = 25_000
# Directions of a first look for where a ball rests, and how often a finer one follows.
EVERYWHERE = 20_000
LEVELS = 16
# Sine of an angle inside of which a strut's wall counts as infinitely far.
NO_ANGLE = 1e-12


# Steps about the best place: a cube's worth, which has some in every direction.
PATTERN = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Star:
    """Tapered round struts from the origin, with balls at all their ends.

    Attributes:
        axes: unit directions.
        lengths: of the struts [mm].
        radii: at the origin and at the far end [mm].
        given_ball: radius of the ball at the origin [mm]; 0: that of the thickest strut.
    """

    axes: Float[np.ndarray, "struts 3"]
    lengths: Float[np.ndarray, " struts"]
    radii: Float[np.ndarray, "struts 2"]
    given_ball: float = 0.0

    @classmethod
    def of_equal(cls, axes: np.ndarray, *, length: float, radius: float) -> "Star":
        """Cylinders of one size along vectors of any length."""
        axes = np.asarray(axes, float) / np.linalg.norm(axes, axis=1, keepdims=True)
        return cls(axes, np.full(len(axes), length), np.full((len(axes), 2), radius))

    def structure(self) -> Structure:
        """As the mesher gets it; joint 0 is the origin."""
        n = len(self.axes)
        return Structure(
            np.concatenate([np.zeros((1, 3)), self.lengths[:, None] * self.axes]),
            np.column_stack([np.zeros(n, np.int64), np.arange(1, n + 1)]),
            self.radii.copy(),
            np.zeros(n + 1, bool),
            np.ones(n),
        )

    @property
    def slopes(self) -> Float[np.ndarray, " struts"]:
        """Growth of the radius along each strut."""
        return (self.radii[:, 1] - self.radii[:, 0]) / self.lengths

    @property
    def ball(self) -> float:
        """Radius of the ball at the origin [mm]."""
        return self.given_ball or float(self.radii[:, 0].max())

    def reaches(
        self, directions: Float[np.ndarray, "samples 3"]
    ) -> Float[np.ndarray, "struts samples"]:
        """How far each strut, cut flat at its far end, goes on in each direction [mm]."""
        cosine = self.axes @ directions.T
        sine = np.linalg.norm(np.cross(self.axes[:, None], directions), axis=2)
        opening = sine - self.slopes[:, None] * cosine
        wall = self.radii[:, :1] / np.maximum(opening, NO_ANGLE)
        lid = self.lengths[:, None] / np.maximum(cosine, NO_ANGLE)
        return np.where(cosine > 0, np.minimum(wall, lid), 0.0)

    def reach(self, directions: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, " samples"]:
        """How far the union goes on in each direction [mm]."""
        return np.maximum(self.reaches(directions).max(axis=0), self.ball)

    def grown(self, by: float) -> "Star":
        """Everything within a distance of the union: walls that lean by m are moved out along z."""
        out = by * np.sqrt(1 + self.slopes**2)[:, None]
        thick = self.radii + out
        # The thickest strut's ball may belong to a strut whose wall leans more, or less.
        return Star(self.axes, self.lengths, thick, self.ball + by)

    def overlap(self, count: int = DIRECTIONS) -> float:
        """What the struts count more than once, less what the ball at the origin adds [mm³]."""
        directions = sphere_points(count)
        total = 0.0
        for start in range(0, count, AT_ONCE):
            each = self.reaches(directions[start : start + AT_ONCE])
            union = np.maximum(each.max(axis=0), self.ball)
            total += float(((each**3).sum(axis=0) - union**3).sum())
        return total / count * 4 * np.pi / 3

    def ends(self) -> float:
        """What the balls at the far ends add [mm³].

        Half a ball of radius b, and, before the end, what stands out of a strut that grows towards
        it: up to s = 2 b m/(1 + m²), where both are equally thick, the integral of
        pi (b² - s² - (b - m s)²), which is pi b m s²/3.
        """
        b, m = self.radii[:, 1], np.maximum(self.slopes, 0)
        s = 2 * b * m / (1 + m**2)
        return float((2 / 3 * np.pi * b**3 + np.pi * b * m * s**2 / 3).sum())

    def volume(self, count: int = DIRECTIONS) -> float:
        """Of the union [mm³]; the far ends must not meet other struts."""
        a, b = self.radii.T
        struts = np.pi * self.lengths / 3 * (a**2 + a * b + b**2)
        return float(struts.sum()) + self.ends() - self.overlap(count)


@cache
def sphere_points(count: int) -> Float[np.ndarray, "samples 3"]:
    """Unit directions that stand for equal areas: a spiral by the golden section.

    Swinbank and Purser, Fibonacci grids (2006).
    """
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def named_stars() -> dict[str, Star]:
    """Joints of usual lattices, and one of five uneven struts."""
    signs = (-1.0, 1.0)
    axes = {
        "diamond": [[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]],
        "corner": np.eye(3),
        "cube": np.concatenate([np.eye(3), -np.eye(3)]),
        "bcc": [[x, y, z] for x in signs for y in signs for z in signs],
        "fcc": [v for x in signs for y in signs for v in ([x, y, 0], [x, 0, y], [0, x, y])],
    }
    stars = {
        name: Star.of_equal(np.array(each), length=9.0, radius=0.5) for name, each in axes.items()
    }
    stars["uneven"] = Star(
        np.array([[1.0, 0, 0], [0.6, 0.8, 0], [0, 0.28, 0.96], [-0.8, 0, 0.6], [0, -0.6, -0.8]]),
        np.full(5, 8.0),
        np.array([[0.5, 0.3], [0.3, 0.4], [0.4, 0.4], [0.25, 0.5], [0.6, 0.3]]),
    )
    return stars


def exact_volume(lattice: Structure, count: int = 20_000) -> float:
    """Of a lattice whose struts meet at joints only [mm³]: frusta less what each joint overlaps.

    Args:
        lattice: round struts.
        count: directions of the quadrature of each joint.
    """
    line = lattice.joints[lattice.struts]
    length = lattice.lengths()
    axis = (line[:, 1] - line[:, 0]) / length[:, None]
    a, b = lattice.radii.T
    volume = float((np.pi * length / 3 * (a**2 + a * b + b**2)).sum())
    for joint in np.unique(lattice.struts):
        strut, end = np.nonzero(lattice.struts == joint)
        outward = np.where(end == 0, 1.0, -1.0)[:, None] * axis[strut]
        radii = np.stack([lattice.radii[strut, end], lattice.radii[strut, 1 - end]], axis=1)
        volume -= Star(outward, length[strut], radii).overlap(count)
    return volume


def closing_reach(
    star: Star, fillet: float, directions: Float[np.ndarray, "samples 3"]
) -> tuple[Float[np.ndarray, " samples"], Float[np.ndarray, " samples"]]:
    """How far the closing of a union by a ball goes on, and the cosine of its normal's angle there.

    A place is outside the closing when a ball of the fillet's radius, that touches no strut, covers
    it. Places for its centre c end at the union grown by the radius, of which every direction has
    one. A ray is met by the ball at c . w - sqrt(rho² - |c - (c . w) w|²); the nearest of these,
    over all c, is where the closing ends: looked for everywhere, then ever more finely about the
    best.

    Args:
        star: struts.
        fillet: radius of the ball [mm].
        directions: unit vectors, outside the struts' ends.
    """
    grown = star.grown(fillet)
    everywhere = sphere_points(EVERYWHERE)
    centres = grown.reach(everywhere)[:, None] * everywhere
    best, meeting = [], []
    for direction in directions:
        along, u = direction, everywhere[np.argmin(_met(centres, direction, fillet))]
        spread = 3 / np.sqrt(EVERYWHERE)
        for _ in range(LEVELS):
            near = u + spread * PATTERN
            near /= np.linalg.norm(near, axis=1, keepdims=True)
            c = grown.reach(near)[:, None] * near
            k = int(np.argmin(_met(c, along, fillet)))
            u, spread = near[k], spread * 0.6
        best.append(float(_met(c[k : k + 1], along, fillet)[0]))
        meeting.append(float((c[k] @ along - best[-1]) / fillet))
    return np.array(best), np.array(meeting)


def _met(
    centres: Float[np.ndarray, "places 3"], direction: Float[np.ndarray, " 3"], radius: float
) -> Float[np.ndarray, " places"]:
    """Where a ray from the origin enters balls [mm]; inf where it passes them."""
    along = centres @ direction
    left = radius**2 - np.maximum((centres**2).sum(axis=1) - along**2, 0)
    entry = along - np.sqrt(np.maximum(left, 0))
    return np.where((left >= 0) & (entry > 0), entry, np.inf)


def planar_seam_reach(
    axes: Float[np.ndarray, "struts 3"], radius: float, directions: Float[np.ndarray, "samples 3"]
) -> Float[np.ndarray, " samples"]:
    """How far a union of equal cylinders and their ball goes on: |x|² = R² + max(0, x . d_i)².

    Two of them meet where x . d_i = x . d_j: in a plane.
    """
    along = np.maximum((directions @ axes.T).max(axis=1), 0)
    return radius / np.sqrt(np.maximum(1 - along**2, NO_ANGLE**2))


def random_star(seed: int) -> Star:
    """1 to 20 struts at angles down to 5 degrees, radii up to four times as thick as others.

    Struts are some 1.4 times as long as the rings at their ends need.
    """
    random = np.random.default_rng(seed)
    valence = int(random.integers(1, 21))
    least = np.deg2rad(random.choice([5.0, 10.0, 20.0, 30.0]))
    axes: list[np.ndarray] = []
    for _ in range(5000):
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        if axes and random.random() < 0.3:  # right beside another one
            other = axes[int(random.integers(len(axes)))]
            across = np.cross(other, axis)
            axis = other + np.tan(1.02 * least) * across / np.linalg.norm(across)
            axis /= np.linalg.norm(axis)
        if all(axis @ other < np.cos(least) for other in axes):
            axes.append(axis)
        if len(axes) == valence:
            break
    near = random.uniform(0.25, 1.0, len(axes))
    radii = np.column_stack([near, near * random.uniform(0.6, 1.3, len(axes))])
    return Star(np.array(axes), _lengths(np.array(axes), radii), radii)


def _lengths(axes: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Lengths beyond the places where struts part, with room for the far ends [mm].

    Two struts of radii r and s at an angle t part at most at (r + s)/sin(t) from the joint.
    """
    widest = radii.max(axis=1)
    cosine = np.clip(axes @ axes.T, -1, 1)
    np.fill_diagonal(cosine, -1)
    sine = np.where(cosine > 0, np.sqrt(1 - cosine**2), 1.0)
    parting = ((widest[:, None] + widest) / sine).max(axis=1)
    return 1.4 * (parting + 2 * widest.max())
