"""Effective stiffness of extruded lattices in their plane: closed forms and their thin limits.

Rigid-jointed walls of thickness t and length L, solid modulus E = 1, nu = 0.3, per unit depth.
phi = 12 E I/(kappa G A L^2) = 2 (1 + nu) (t/L)^2/kappa, zero for Euler-Bernoulli beams; of a wall, k is
the stiffness along it, t/L, and s that of its sway, (t/L)^3/(1 + phi). K is the area modulus. Exact for
the beam model:

* square, and turned by 45 degrees (diamond): along the walls E = k, nu = 0, G = s/2;
* triangular: joints do not turn, by their symmetry, K = sqrt(3) k/2, G = sqrt(3) (k + s)/4;
* kagome: joints move with the mean strain, as each is a centre of inversion, and the three of a cell
  turn: K = sqrt(3) k/4, G = sqrt(3)/8 (k + (t/L)^3/(2 + phi));
* honeycomb: the two joints of a cell shift against each other and do not turn: K = k/(2 sqrt(3)),
  G = k s/(sqrt(3) (k + s));
* hexagons of any angle, re-entrant ones among them: Gibson, Ashby, Cellular Solids, 2nd ed. (1997),
  section 4.3 with its corrections for axial and shear deformation, where phi stands for
  (2.4 + 1.5 nu) (t/l)^2.

Thin limits: Gibson, Ashby; Wang, McDowell, J. Eng. Mater. Technol. 126 (2004) 137.
"""

from dataclasses import dataclass
from functools import cache
from math import cos, pi, sin, sqrt, tan

import numpy as np
from target import Benchmark, Measured, Target

from fea.beam import StrutMaterial
from fea.homogenise import homogenise_frame
from fea.periodic_frame import PeriodicFrame
from fea.plane_stiffness import PlaneStiffness
from fea.sections import Wall
from fea.stiffness_bounds import plane_hashin_shtrikman_bound

NU = 0.3

# None: Cowper's, 10 (1 + nu)/(12 + 11 nu).
EULER, COWPER = float("inf"), None
NAMES = {EULER: "Euler-Bernoulli", COWPER: "Timoshenko"}

# What homogenisation and closed form may differ by: rounding of a dozen unknowns.
EXACT = 1e-8

HEIGHT = sqrt(3) / 2


@dataclass(frozen=True)
class Wires:
    """Centre lines of one period, walls of length one unless stated.

    Attributes:
        joints: positions.
        struts: joint, joint, and the periods from the second to its image.
        periods: one a row.
    """

    joints: tuple[tuple[float, float], ...]
    struts: tuple[tuple[int, int, int, int], ...]
    periods: tuple[tuple[float, float], tuple[float, float]]


def hexagon(h: float, degrees: float) -> Wires:
    """Vertical walls of length h, the others, of length one, at an angle to x; below zero re-entrant."""
    c, s = cos(degrees * pi / 180), sin(degrees * pi / 180)
    return Wires(
        ((0.0, 0.0), (0.0, h)),
        ((0, 1, 0, 0), (1, 0, 0, 1), (1, 0, -1, 1)),
        ((2 * c, 0.0), (c, h + s)),
    )


TRIANGLES = ((1.0, 0.0), (0.5, HEIGHT))
LATTICES = {
    "square": Wires(((0.0, 0.0),), ((0, 0, 1, 0), (0, 0, 0, 1)), ((1.0, 0.0), (0.0, 1.0))),
    "diamond": Wires(
        ((0.0, 0.0),),
        ((0, 0, 1, 0), (0, 0, 0, 1)),
        ((sqrt(0.5), sqrt(0.5)), (-sqrt(0.5), sqrt(0.5))),
    ),
    "triangular": Wires(((0.0, 0.0),), ((0, 0, 1, 0), (0, 0, 0, 1), (0, 0, -1, 1)), TRIANGLES),
    "kagome": Wires(
        ((0.0, 0.0), (1.0, 0.0), (0.5, HEIGHT)),
        ((0, 1, 0, 0), (0, 2, 0, 0), (1, 2, 0, 0), (1, 0, 1, 0), (2, 0, 0, 1), (2, 1, -1, 1)),
        ((2.0, 0.0), (1.0, 2 * HEIGHT)),
    ),
    "honeycomb": hexagon(1.0, 30.0),
}
# Length of the vertical walls and angle.
HEXAGONS = {"stretched hexagons": (1.5, 20.0), "re-entrant hexagons": (2.0, -30.0)}


def wires(name: str) -> Wires:
    return hexagon(*HEXAGONS[name]) if name in HEXAGONS else LATTICES[name]


def frame(name: str, t: float, kappa: float | None, depth: float = 1.0) -> PeriodicFrame:
    lattice = wires(name)
    struts = np.array(lattice.struts)
    return PeriodicFrame(
        joints=np.array(lattice.joints),
        struts=struts[:, :2],
        offsets=struts[:, 2:],
        periods=np.array(lattice.periods),
        radii=np.full((len(struts), 2), t / 2),
        material=StrutMaterial(1.0, NU, Wall(depth=depth, shear_factor=kappa)),
    )


@cache
def homogenised(name: str, t: float, kappa: float | None) -> PlaneStiffness:
    return PlaneStiffness(homogenise_frame(frame(name, t, kappa)).C)


def shear_flexibility(t: float, kappa: float | None) -> float:
    factor = Wall().cowper(NU) if kappa is None else kappa
    return 2 * (1 + NU) * t**2 / factor


def closed_forms(name: str, t: float, kappa: float | None) -> dict[str, float]:
    phi = shear_flexibility(t, kappa)
    k, s = t, t**3 / (1 + phi)
    if name in HEXAGONS:
        return _hexagons(name, t, phi)
    if name == "square":
        return {"Ex": k, "Ey": k, "G": s / 2, "nu_xy": 0.0}
    if name == "diamond":
        # 1/E = (2/k + 1/G)/4 along the diagonal; the shear along it is tension along both walls.
        E = 4 / (2 / k + 2 / s)
        return {"Ex": E, "Ey": E, "G": k / 2, "nu_xy": (k - s) / (k + s)}
    K, G = {
        "triangular": (HEIGHT * k, HEIGHT / 2 * (k + s)),
        "kagome": (HEIGHT / 2 * k, HEIGHT / 4 * (k + t**3 / (2 + phi))),
        "honeycomb": (k / (2 * sqrt(3)), k * s / (sqrt(3) * (k + s))),
    }[name]
    E = 4 * K * G / (K + G)
    return {"Ex": E, "Ey": E, "G": G, "nu_xy": (K - G) / (K + G)}


def _hexagons(name: str, t: float, phi: float) -> dict[str, float]:
    h, degrees = HEXAGONS[name]
    theta = degrees * pi / 180
    rise = h + sin(theta)
    across = 1 + phi + t**2 / tan(theta) ** 2
    along = 1 + phi + t**2 * (tan(theta) ** 2 + 2 * h / cos(theta) ** 2)
    lateral = 1 + phi - t**2
    return {
        "Ex": t**3 * cos(theta) / (rise * sin(theta) ** 2) / across,
        "Ey": t**3 * rise / cos(theta) ** 3 / along,
        "nu_xy": cos(theta) ** 2 / (rise * sin(theta)) * lateral / across,
        "nu_yx": rise * sin(theta) / cos(theta) ** 2 * lateral / along,
    }


def found(effective: PlaneStiffness) -> dict[str, float]:
    constants = effective.engineering_constants
    return {
        "Ex": constants.E[0],
        "Ey": constants.E[1],
        "G": constants.G,
        "nu_xy": constants.nu_xy,
        "nu_yx": constants.nu_yx,
    }


def _measured(name: str, what: str, t: float, kappa: float | None, scale: float = 1.0) -> Measured:
    value = found(homogenised(name, t, kappa))[what] / scale
    return Measured(float(value), f"{len(wires(name).struts)} struts", 0)


# Thickness of thin walls, over their length, and what is left of the next order, (t/l)^2 times a few.
THIN = 1e-3
THIN_TOLERANCE = 1e-5

# By powers of t/l, thin; of hexagons Gibson and Ashby's equations 4.7 to 4.13.
THIN_LIMITS = {
    "square": {"Ex": (1, 1.0), "G": (3, 0.5)},
    "diamond": {"Ex": (3, 2.0), "G": (1, 0.5)},
    "triangular": {"Ex": (1, 2 / sqrt(3)), "nu_xy": (0, 1 / 3)},
    "kagome": {"Ex": (1, 1 / sqrt(3)), "nu_xy": (0, 1 / 3)},
    "honeycomb": {"Ex": (3, 4 / sqrt(3)), "nu_xy": (0, 1.0), "G": (3, 1 / sqrt(3))},
    **{
        name: {
            "G": (
                3,
                (h + sin(degrees * pi / 180)) / (h**2 * (1 + 2 * h) * cos(degrees * pi / 180)),
            )
        }
        for name, (h, degrees) in HEXAGONS.items()
    },
}
POWER = {0: "", 1: " over t/l", 3: " over (t/l)^3"}


def _closed(name: str) -> tuple[Target, ...]:
    return tuple(
        Target(
            f"{what}, {NAMES[kappa]}",
            "",
            float(value),
            EXACT,
            lambda what=what, kappa=kappa: _measured(name, what, 0.1, kappa),
            bound="relative" if value else "absolute",
        )
        for kappa in NAMES
        for what, value in closed_forms(name, 0.1, kappa).items()
    )


def _thin(name: str) -> tuple[Target, ...]:
    return tuple(
        Target(
            f"{what}{POWER[power]}, t/l = {THIN:g}",
            "",
            value,
            THIN_TOLERANCE,
            lambda what=what, power=power: _measured(name, what, THIN, COWPER, THIN**power),
        )
        for what, (power, value) in THIN_LIMITS[name].items()
    )


SOURCES = {
    "square": "Closed form; thin: A.-J. Wang, D. L. McDowell, J. Eng. Mater. Technol. 126 (2004) 137.",
    "diamond": "Closed form of the square lattice, turned by 45 degrees.",
    "triangular": "Closed form; thin: Gibson, Ashby, section 4.3.",
    "kagome": "Closed form; thin: Wang, McDowell (2004).",
    "honeycomb": "Closed form; thin: Gibson, Ashby, Cellular Solids, 2nd ed. (1997), section 4.3.",
}
HEXAGON_SOURCE = "Gibson, Ashby, section 4.3, with axial and shear deformation; G the thin limit."

# E rho/(3 - 2 rho).
HASHIN_SHTRIKMAN = {0.1: 0.1 / 2.8, 0.3: 0.3 / 2.4, 0.5: 0.25}

BENCHMARKS = (
    *(
        Benchmark(
            f"Extruded {name}",
            SOURCES.get(name, HEXAGON_SOURCE),
            "Walls of length 1 mm, t = 0.1 mm, E = 1 MPa, nu = 0.3, in the plane."
            if name in SOURCES
            else "Vertical walls of {:g} mm, others of 1 mm at {:g} degrees to x, t = 0.1 mm, E = 1 MPa, "
            "nu = 0.3, in the plane.".format(*HEXAGONS[name]),
            (*_closed(name), *_thin(name)),
        )
        for name in (*LATTICES, *HEXAGONS)
    ),
    Benchmark(
        "Bounds in the plane",
        "Z. Hashin, J. Mech. Phys. Solids 13 (1965) 119.",
        "Largest Young's modulus of an isotropic sheet with holes, E = 1 MPa, nu = 0.3, by density.",
        tuple(
            Target(
                f"density {density:g}",
                "MPa",
                E,
                1e-12,
                lambda density=density: Measured(
                    plane_hashin_shtrikman_bound(1.0, NU, density).E, "formula", 0
                ),
            )
            for density, E in HASHIN_SHTRIKMAN.items()
        ),
    ),
)
