"""Cross-sections of struts: round, tubular, square, wall, and by given constants."""

import math
from typing import ClassVar

from fea.abstract_section import AbstractSection, Radius
from fea.errors import FeaError
from fea.taper import AbstractTaper, OneEdge, Similar

# Torsion of a square of side s: J = 0.1406 s^4 and peak shear stress T/(0.2082 s^3), at the
# middle of a side. Timoshenko, Goodier, Theory of Elasticity, 3rd ed., section 109, table, b/a = 1.
SQUARE_TORSION_CONSTANT = 0.140577
SQUARE_TORSION_MODULUS = 0.208165

# Peak over mean of the shear stress that a transverse force makes, at the neutral axis:
# V Q/(I b) of elementary beam theory.
ROUND_SHEAR_PEAK = 4 / 3
RECTANGLE_SHEAR_PEAK = 3 / 2


class Round(AbstractSection):
    """Solid circle of the given radius.

    Attributes:
        shear_factor: None for Cowper's 6 (1 + nu)/(7 + 6 nu); 0.9 is the other common choice.
    """

    taper: ClassVar[AbstractTaper] = Similar()
    shear_factor: float | None = None

    def size(self, radius: Radius) -> Radius:
        """The radius."""
        return radius

    @property
    def unit_area(self) -> float:
        """Area π r²."""
        return math.pi

    @property
    def unit_second_moment(self) -> float:
        """Second moment π r⁴/4."""
        return math.pi / 4

    @property
    def unit_torsion_constant(self) -> float:
        """Torsion constant π r⁴/2."""
        return math.pi / 2

    def cowper(self, nu: float) -> float:
        """6 (1 + nu)/(7 + 6 nu)."""
        return 6 * (1 + nu) / (7 + 6 * nu)

    def bending_modulus(self, radius: Radius) -> Radius:
        """I/r = π r³/4 [mm³]."""
        return math.pi / 4 * radius**3

    def torsion_modulus(self, radius: Radius) -> Radius:
        """J/r = π r³/2 [mm³]."""
        return math.pi / 2 * radius**3

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """3/4 of the area [mm²]."""
        return self.area(radius) / ROUND_SHEAR_PEAK


class Tube(AbstractSection):
    """Circular tube whose outer radius is the given radius.

    Attributes:
        ratio: inner over outer radius, the same along a tapered strut.
        shear_factor: None for Cowper's value of a hollow circle.

    Raises:
        FeaError: when the ratio is not in [0, 1).
    """

    taper: ClassVar[AbstractTaper] = Similar()
    ratio: float
    shear_factor: float | None = None

    def __check_init__(self):
        if not 0 <= self.ratio < 1:
            raise FeaError(
                f"ratio = {self.ratio:g}: inner over outer radius of a tube; give 0 <= ratio < 1."
            )

    def size(self, radius: Radius) -> Radius:
        """The outer radius."""
        return radius

    @property
    def unit_area(self) -> float:
        """Area π r² (1 - m²), m the ratio."""
        return math.pi * (1 - self.ratio**2)

    @property
    def unit_second_moment(self) -> float:
        """Second moment π r⁴ (1 - m⁴)/4."""
        return math.pi / 4 * (1 - self.ratio**4)

    @property
    def unit_torsion_constant(self) -> float:
        """Torsion constant π r⁴ (1 - m⁴)/2."""
        return math.pi / 2 * (1 - self.ratio**4)

    def cowper(self, nu: float) -> float:
        """6 (1 + nu) (1 + m²)²/((7 + 6 nu) (1 + m²)² + (20 + 12 nu) m²), m the ratio."""
        m2 = self.ratio**2
        square = (1 + m2) ** 2
        return 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * m2)

    def bending_modulus(self, radius: Radius) -> Radius:
        """I over the outer radius [mm³]."""
        return self.unit_second_moment * radius**3

    def torsion_modulus(self, radius: Radius) -> Radius:
        """J over the outer radius [mm³]."""
        return self.unit_torsion_constant * radius**3

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """V over V Q/(I b) at the neutral axis, b twice the wall: 3/4 A (1 + m²)/(1 + m + m²)."""
        m = self.ratio
        return self.area(radius) / ROUND_SHEAR_PEAK * ((1 + m**2) / (1 + m + m**2))


class Square(AbstractSection):
    """Solid square, the radius being half its side.

    Attributes:
        shear_factor: None for Cowper's 10 (1 + nu)/(12 + 11 nu).
    """

    taper: ClassVar[AbstractTaper] = Similar()
    shear_factor: float | None = None

    def size(self, radius: Radius) -> Radius:
        """Half the side."""
        return radius

    @property
    def unit_area(self) -> float:
        """Area (2 h)²."""
        return 4.0

    @property
    def unit_second_moment(self) -> float:
        """Second moment (2 h)⁴/12."""
        return 4 / 3

    @property
    def unit_torsion_constant(self) -> float:
        """Torsion constant 0.1406 (2 h)⁴."""
        return 16 * SQUARE_TORSION_CONSTANT

    def cowper(self, nu: float) -> float:
        """10 (1 + nu)/(12 + 11 nu)."""
        return 10 * (1 + nu) / (12 + 11 * nu)

    def bending_modulus(self, radius: Radius) -> Radius:
        """I over half the diagonal [mm³]: bending about a diagonal, the worst direction."""
        return self.unit_second_moment / math.sqrt(2) * radius**3

    def torsion_modulus(self, radius: Radius) -> Radius:
        """0.2082 (2 h)³ [mm³]."""
        return 8 * SQUARE_TORSION_MODULUS * radius**3

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """2/3 of the area [mm²]."""
        return self.area(radius) / RECTANGLE_SHEAR_PEAK


class Wall(AbstractSection):
    """Wall of an extruded lattice, the radius being half its thickness: a beam in one plane.

    Its depth is along the axis of extrusion, which it bends about; out of its plane it is a plate, which
    no beam is, so frames of walls are held in their plane (`fea.in_plane`). With walls of several depths
    give the section unit depth and `modulus` of each strut times its depth in mm: displacements, forces in
    the struts, compliance and loads at which they buckle are then exact; stress is too large by that
    factor, mass and weight too small.

    Attributes:
        depth: of all walls [mm].
        shear_factor: None for Cowper's rectangle, 10 (1 + nu)/(12 + 11 nu).

    Raises:
        FeaError: when the depth is not positive.
    """

    taper: ClassVar[AbstractTaper] = OneEdge()
    depth: float = 1.0
    shear_factor: float | None = None

    def __check_init__(self):
        if not 0 < self.depth < math.inf:
            raise FeaError(f"depth = {self.depth:g} mm of a wall: give a positive number.")

    def size(self, radius: Radius) -> Radius:
        """Half the thickness."""
        return radius

    @property
    def unit_area(self) -> float:
        """Area 2 r b, b the depth."""
        return 2 * self.depth

    @property
    def unit_second_moment(self) -> float:
        """Second moment b (2 r)³/12 about the axis of extrusion."""
        return 2 / 3 * self.depth

    @property
    def unit_torsion_constant(self) -> float:
        """Twice the second moment, a value that nothing in the plane depends on."""
        return 4 / 3 * self.depth

    def cowper(self, nu: float) -> float:
        """10 (1 + nu)/(12 + 11 nu)."""
        return 10 * (1 + nu) / (12 + 11 * nu)

    def bending_modulus(self, radius: Radius) -> Radius:
        """Depth times (2 r)²/6 [mm³]."""
        return 2 / 3 * self.depth * radius**2

    def torsion_modulus(self, radius: Radius) -> Radius:
        """Twice the bending modulus; no torque acts in the plane."""
        return 4 / 3 * self.depth * radius**2

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """2/3 of the area [mm²]."""
        return self.area(radius) / RECTANGLE_SHEAR_PEAK


class Given(AbstractSection):
    """A section with given constants, whatever the radius: for textbook frames.

    Attributes:
        A: area [mm²].
        I: second moment of area [mm⁴].
        J: torsion constant [mm⁴].
        shear_factor: infinity (the default) neglects shear deformation.

    Raises:
        FeaError: when a constant is not positive.
    """

    taper: ClassVar[AbstractTaper] = Similar()
    A: float
    I: float
    J: float
    shear_factor: float | None = float("inf")

    def __check_init__(self):
        for name in ("A", "I", "J"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise FeaError(f"{name} = {value:g} of a section: give a positive number.")

    def size(self, radius: Radius) -> Radius:
        """1: such struts are prismatic, whatever their radii."""
        return 0 * radius + 1

    @property
    def unit_area(self) -> float:
        """A."""
        return self.A

    @property
    def unit_second_moment(self) -> float:
        """I."""
        return self.I

    @property
    def unit_torsion_constant(self) -> float:
        """J."""
        return self.J

    def cowper(self, nu: float) -> float:
        """Not defined for a section whose shape is unknown."""
        raise FeaError(
            f"The shear factor of a section given by its constants (nu = {nu:g}) must be given too."
        )

    def bending_modulus(self, radius: Radius) -> Radius:
        """I over the radius, which is the distance of the outermost fibre."""
        return self.I / radius

    def torsion_modulus(self, radius: Radius) -> Radius:
        """J over the radius."""
        return self.J / radius

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """The area: a mean shear stress, since the shape is unknown."""
        return self.area(radius)


def section(name: str) -> AbstractSection:
    """The section called "round", "square" or "wall" (of unit depth), with Cowper's shear factor.

    Raises:
        FeaError: for any other name.
    """
    known = {"round": Round, "square": Square, "wall": Wall}
    if name not in known:
        raise FeaError(f'section = "{name}" is unknown; known: {", ".join(known)}.')
    return known[name]()
