"""What an elasticity matrix says: constants along directions, anisotropy and averages."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fea.errors import FeaError
from fea.materials import Orthotropic
from fea.precision import as_float64
from fea.stiffness_bounds import IsotropicModuli
from fea.voigt import turned_stiffness, vector

# With shears times sqrt(2) 6-vectors have the norm of their tensors, and C the eigenvalues of the
# fourth-order tensor (Mehrabadi, Cowin, Q. J. Mech. Appl. Math. 43 (1990) 15).
MANDEL = np.sqrt(np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]))

# C given as measured or computed is symmetric to this share of its largest entry.
SYMMETRIC = 1e-6

# Least over largest eigenvalue: below it a strain costs nothing. Lattices of slender struts that bend
# have (r/L)^2, 1e-6.
POSITIVE = 1e-12

# Share of C that may be missing from a symmetry for C to count as having it.
HAS_SYMMETRY = 1e-6

# Steps along each edge of the octahedron that becomes the sphere of directions: half a degree, as
# lattices that bend are needles along their struts; a multiple of 2 and 3, so that the axes, the edges'
# and the space diagonals of a cube are among the directions.
SPHERE_STEPS = 192

# Moduli that differ by less than this share are one value and rounding.
EQUAL = 1e-9

STRAIN_NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")


@dataclass(frozen=True)
class EngineeringConstants:
    """Constants along the axes; nu_xy is the contraction along y under tension along x.

    Attributes:
        E: Young's moduli along x, y, z [MPa].
        nu: Poisson's ratios nu_yz, nu_xz, nu_xy.
        G: shear moduli of yz, xz, xy [MPa].
    """

    E: tuple[float, float, float]
    nu: tuple[float, float, float]
    G: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class DirectionalModulus:
    """Young's modulus over the sphere of directions, as a triangulated surface.

    Attributes:
        directions: unit vectors.
        faces: triangles of them, counter-clockwise seen from outside.
        E: Young's modulus along each direction [MPa].
    """

    directions: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    E: Float[np.ndarray, " vertices"]

    @property
    def vertices(self) -> Float[np.ndarray, "vertices 3"]:
        """Points whose distance from the origin is Young's modulus in that direction [MPa]."""
        return self.directions * self.E[:, None]

    @property
    def softest(self) -> Float[np.ndarray, " 3"]:
        """Direction of the least modulus among those sampled; of equals one of positive components."""
        return self.directions[np.flatnonzero((1 + EQUAL) * self.E.min() >= self.E)[-1]]

    @property
    def stiffest(self) -> Float[np.ndarray, " 3"]:
        """Direction of the largest modulus among those sampled; of equals as before."""
        return self.directions[np.flatnonzero((1 - EQUAL) * self.E.max() <= self.E)[-1]]


def stable_stiffness(
    C: Float[np.ndarray, "_ _"],
    mandel: Float[np.ndarray, " _"],
    names: Sequence[str],
    *,
    add: str,
) -> Float[np.ndarray, "_ _"]:
    """An elasticity matrix in double precision, symmetric to the last bit.

    Args:
        C: as given [MPa].
        mandel: factor of each strain component that makes energy the norm of the vector.
        names: of the strain components.
        add: what a cell that is a mechanism lacks, for messages.

    Raises:
        FeaError: when C has another shape, is not finite or not symmetric, or some strain costs no
            energy; the message names that strain.
    """
    C, n = as_float64(C, "Entries of the elasticity matrix"), len(names)
    if C.shape != (n, n) or not np.isfinite(C).all():
        raise FeaError(f"The elasticity matrix has shape {C.shape}; give {n} x {n} finite numbers.")
    skew = float(np.abs(C - C.T).max())
    if not skew <= SYMMETRIC * float(np.abs(C).max()):
        raise FeaError(
            f"The elasticity matrix is not symmetric: entries differ by {skew:.3g} MPa from those "
            "across the diagonal; check how it was made."
        )
    C = (C + C.T) / 2
    energy, strain = np.linalg.eigh(C * np.outer(mandel, mandel))
    if not energy[0] > POSITIVE * energy[-1]:
        softest = mandel * strain[:, 0]
        # By its largest component, which is positive.
        softest = softest / softest[np.argmax(np.abs(softest))]
        parts = [
            f"{value:.3g} {name}"
            for value, name in zip(softest, names, strict=True)
            if abs(value) > 1e-3
        ]
        raise FeaError(
            f"The stiffness does not resist the strain {' + '.join(parts)} (stiffness "
            f"{energy[0]:.3g} of {energy[-1]:.3g} MPa): the cell is a mechanism; add {add} that "
            "resist it."
        )
    return C


@dataclass(frozen=True, eq=False)
class EffectiveStiffness:
    """A stable linear elastic stiffness of any anisotropy.

    Attributes:
        C: elasticity matrix [MPa], Voigt order, engineering shears.

    Raises:
        FeaError: when C is not 6 x 6, not finite or not symmetric, or some strain costs no energy;
            the message names that strain.
    """

    C: Float[np.ndarray, "6 6"]

    def __post_init__(self):
        C = stable_stiffness(self.C, MANDEL, STRAIN_NAMES, add="struts or material")
        object.__setattr__(self, "C", C)

    @cached_property
    def compliance(self) -> Float[np.ndarray, "6 6"]:
        """S = C⁻¹: strain 6-vector = S stress 6-vector [1/MPa]."""
        S = np.linalg.inv(self.C)
        return (S + S.T) / 2

    def turned(self, R: Float[np.ndarray, "3 3"]) -> "EffectiveStiffness":
        """The stiffness of the body turned by R."""
        return EffectiveStiffness(turned_stiffness(self.C, R))

    # Along directions ------------------------------------------------------------------------

    def youngs_modulus(self, directions: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Young's modulus under tension along directions [MPa]: 1/E = n_i n_j S_ijkl n_k n_l.

        Args:
            directions: of any length but zero.
        """
        n = _unit(directions)
        pull = vector(n[..., :, None] * n[..., None, :])
        return np.asarray(1 / np.einsum("...v,vw,...w->...", pull, self.compliance, pull))

    def poissons_ratio(
        self, along: Float[np.ndarray, "*n 3"], across: Float[np.ndarray, "*n 3"]
    ) -> Float[np.ndarray, "*n"]:
        """Contraction across over extension along, under tension along.

        Args:
            along: directions of tension.
            across: directions at right angles to them.

        Raises:
            FeaError: when two are not at right angles.
        """
        n, m = _orthogonal(along, across)
        pull = vector(n[..., :, None] * n[..., None, :])
        width = vector(m[..., :, None] * m[..., None, :])
        lateral = np.einsum("...v,vw,...w->...", width, self.compliance, pull)
        return np.asarray(-lateral * self.youngs_modulus(n))

    def shear_modulus(
        self, normal: Float[np.ndarray, "*n 3"], along: Float[np.ndarray, "*n 3"]
    ) -> Float[np.ndarray, "*n"]:
        """Shear modulus of planes that slide along a direction [MPa].

        Args:
            normal: normals of the planes.
            along: directions in the planes.

        Raises:
            FeaError: when two are not at right angles.
        """
        n, m = _orthogonal(normal, along)
        shear = n[..., :, None] * m[..., None, :]
        stress = vector(shear + np.swapaxes(shear, -1, -2))
        return np.asarray(1 / np.einsum("...v,vw,...w->...", stress, self.compliance, stress))

    def directional_modulus(self, steps: int = SPHERE_STEPS) -> DirectionalModulus:
        """Young's modulus over all directions, as a surface.

        Args:
            steps: along an edge of the octahedron; 4 steps² + 2 directions.
        """
        directions, faces = _octasphere(steps)
        return DirectionalModulus(directions, faces, self.youngs_modulus(directions))

    # Along the axes --------------------------------------------------------------------------

    @property
    def engineering_constants(self) -> EngineeringConstants:
        """Constants under a single stress along the axes, whatever else that stress causes."""
        S = self.compliance
        E = 1 / np.diag(S)
        nu = [-S[i, j] * E[i] for i, j in ((1, 2), (0, 2), (0, 1))]
        x, y, z, yz, xz, xy = E.tolist()
        return EngineeringConstants(
            (x, y, z), (float(nu[0]), float(nu[1]), float(nu[2])), (yz, xz, xy)
        )

    def as_material(self, density: float, *, name: str = "homogenised") -> Orthotropic:
        """The solid that stands for the cell in a coarse model.

        Args:
            density: [tonne/mm³], void included.
            name: what reports call it.

        Raises:
            FeaError: when the planes normal to the axes are not planes of symmetry.
        """
        if self.departure_from_orthotropy > HAS_SYMMETRY:
            raise FeaError(
                f"The stiffness differs from an orthotropic one by {self.departure_from_orthotropy:.2g} "
                f"of its size, limit {HAS_SYMMETRY:g}; turn it to its axes of symmetry first."
            )
        constants = self.engineering_constants
        return Orthotropic(constants.E, constants.nu, constants.G, density, name=name)

    # Symmetry --------------------------------------------------------------------------------

    @property
    def cubic(self) -> tuple[float, float, float]:
        """C11, C12, C44 [MPa] of the nearest stiffness that is cubic along the axes."""
        C = self.C
        normal, off = np.diag(C)[:3].mean(), (C[0, 1] + C[0, 2] + C[1, 2]) / 3
        return float(normal), float(off), float(np.diag(C)[3:].mean())

    @property
    def departure_from_cubic(self) -> float:
        """Norm of what is not cubic along the axes over the norm of the stiffness tensor."""
        c11, c12, c44 = self.cubic
        nearest = np.diag([c11 - c12] * 3 + [c44] * 3)
        nearest[:3, :3] += c12
        return self._share(self.C - nearest)

    @property
    def is_cubic(self) -> bool:
        """Whether the stiffness is cubic along the axes, to `HAS_SYMMETRY` of its size."""
        return self.departure_from_cubic <= HAS_SYMMETRY

    @property
    def departure_from_orthotropy(self) -> float:
        """Norm of what couples normal stress and shear, or shears, over the norm of the tensor."""
        rest = self.C.copy()
        rest[:3, :3] = 0.0
        rest[[3, 4, 5], [3, 4, 5]] = 0.0
        return self._share(rest)

    def _share(self, part: Float[np.ndarray, "6 6"]) -> float:
        weight = np.outer(MANDEL, MANDEL)
        return float(np.linalg.norm(weight * part) / np.linalg.norm(weight * self.C))

    @property
    def zener_ratio(self) -> float:
        """2 C44/(C11 - C12), one where isotropic (Zener, Elasticity and Anelasticity of Metals, 1948).

        Raises:
            FeaError: when the stiffness is not cubic along the axes.
        """
        if not self.is_cubic:
            raise FeaError(
                f"Zener's ratio is defined for cubic stiffness, from which this one differs by "
                f"{self.departure_from_cubic:.2g} of its size, limit {HAS_SYMMETRY:g}; use "
                "universal_anisotropy."
            )
        c11, c12, c44 = self.cubic
        return 2 * c44 / (c11 - c12)

    @property
    def universal_anisotropy(self) -> float:
        """5 G_V/G_R + K_V/K_R - 6, zero where isotropic.

        Ranganathan, Ostoja-Starzewski, Phys. Rev. Lett. 101 (2008) 055504.
        """
        stiff, soft = self.voigt_average, self.reuss_average
        # Not below zero by its definition, but by rounding.
        return max(5 * stiff.shear / soft.shear + stiff.bulk / soft.bulk - 6, 0.0)

    # Averages over all orientations (Hill, Proc. Phys. Soc. A 65 (1952) 349) -------------------

    @property
    def bulk_modulus(self) -> float:
        """Pressure over volume lost under uniform pressure [MPa]: Reuss's average."""
        return self.reuss_average.bulk

    @property
    def voigt_average(self) -> IsotropicModuli:
        """Moduli of a polycrystal with uniform strain."""
        normal, off, shear = _sums(self.C)
        return IsotropicModuli((normal + 2 * off) / 9, (normal - off + 3 * shear) / 15)

    @property
    def reuss_average(self) -> IsotropicModuli:
        """Moduli of a polycrystal with uniform stress."""
        normal, off, shear = _sums(self.compliance)
        return IsotropicModuli(1 / (normal + 2 * off), 15 / (4 * normal - 4 * off + 3 * shear))

    @property
    def hill_average(self) -> IsotropicModuli:
        """Means of Voigt's and Reuss's moduli."""
        stiff, soft = self.voigt_average, self.reuss_average
        return IsotropicModuli((stiff.bulk + soft.bulk) / 2, (stiff.shear + soft.shear) / 2)


def _sums(matrix: Float[np.ndarray, "6 6"]) -> tuple[float, float, float]:
    """Sums of the normal, the normal coupling and the shear entries."""
    off = matrix[0, 1] + matrix[0, 2] + matrix[1, 2]
    return float(np.trace(matrix[:3, :3])), float(off), float(np.trace(matrix[3:, 3:]))


def _unit(directions: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    length = np.linalg.norm(directions, axis=-1, keepdims=True)
    if not (length > 0).all():
        raise FeaError("A direction has no length; give vectors that are not zero.")
    return directions / length


def _orthogonal(
    first: Float[np.ndarray, "*n 3"], second: Float[np.ndarray, "*n 3"]
) -> tuple[Float[np.ndarray, "*n 3"], Float[np.ndarray, "*n 3"]]:
    n, m = _unit(first), _unit(second)
    cosine = np.abs(np.einsum("...i,...i->...", n, m)).max()
    if cosine > HAS_SYMMETRY:
        raise FeaError(
            f"Two directions are not at right angles (cosine {cosine:.2g}, limit {HAS_SYMMETRY:g}); "
            "make them so."
        )
    return n, m


def _octasphere(
    steps: int,
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """The octahedron with `steps` along each edge, taken out to the unit sphere."""
    i, j = np.meshgrid(np.arange(steps), np.arange(steps), indexing="ij")
    up, down = (i + j < steps).ravel(), (i + j < steps - 1).ravel()
    corner = np.stack([i, j], axis=-1).reshape(-1, 1, 2)
    plane = np.concatenate(
        [
            corner[up] + np.array([[0, 0], [1, 0], [0, 1]]),
            corner[down] + np.array([[1, 0], [1, 1], [0, 1]]),
        ]
    )
    patch = np.concatenate([plane, steps - plane.sum(axis=-1, keepdims=True)], axis=-1)
    octants = []
    for sign in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, -1).T:
        # A reflection turns triangles inside out.
        order = [0, 1, 2] if sign.prod() > 0 else [0, 2, 1]
        octants.append((patch * sign)[:, order])
    places = np.concatenate(octants).reshape(-1, 3)
    # One number a place, in the order of x, then y, then z.
    key = (places + steps) @ (2 * steps + 1) ** np.array([2, 1, 0])
    _, first, faces = np.unique(key, return_index=True, return_inverse=True)
    return _unit(places[first].astype(float)), faces.reshape(-1, 3).astype(np.int64)
