"""Effective stiffness of periodic lattices: closed forms and their printed numbers.

Rigid-jointed lattices of round struts, cube edge a = 1, strut length L, radius r, solid modulus E = 1.
phi = 12 E I/(kappa G A L^2), zero for Euler-Bernoulli beams; eta = 3 (r/L)^2/(1 + phi); kappa = 0.9 and
nu = 0.3. rho is the centre-line density. The forms are exact for the beam model and tend to the
published limits of thin struts:

* octet: Deshpande, Fleck, Ashby, J. Mech. Phys. Solids 49 (2001) 1747;
* kelvin: Warren, Kraynik, J. Appl. Mech. 64 (1997) 787; Zhu, Knott, Mills, J. Mech. Phys. Solids 45
  (1997) 319;
* diamond: joints do not turn (a rotation has no invariant in the joint's symmetry), so struts are
  springs along and across, Born's crystal: Born, Ann. Phys. 44 (1914) 605; Norris, Proc. R. Soc. A
  470 (2014) 20140522, lattices of similarly situated joints.
"""

from dataclasses import dataclass

import numpy as np
from target import Benchmark, Measured, Target

from fea.beam import StrutMaterial
from fea.effective_stiffness import EffectiveStiffness
from fea.homogenise import homogenise_frame
from fea.sections import Round
from fea.stiffness_bounds import hashin_shtrikman_bound
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.periodic_frame import periodic_frame

EULER, TIMOSHENKO = float("inf"), 0.9
NU = 0.3

# What homogenisation and closed form may differ by: rounding of a few dozen unknowns.
EXACT = 1e-8

LENGTH = {
    "octet": 1 / np.sqrt(2),
    "bcc": np.sqrt(3) / 2,
    "cube": 1.0,
    "kelvin": 1 / (2 * np.sqrt(2)),
    "diamond": np.sqrt(3) / 4,
}
STRUTS = {"octet": 24, "bcc": 8, "cube": 3, "kelvin": 24, "diamond": 16}

# Printed numbers for r = 0.05: E100 and the shear modulus C44, Euler-Bernoulli and Timoshenko.
PRINTED = {
    ("octet", EULER): (0.015399047, 0.0112738),
    ("octet", TIMOSHENKO): (0.015374682, 0.0112669),
    ("bcc", EULER): (2.7071632e-4, 6.07623e-3),
    ("bcc", TIMOSHENKO): (2.6315198e-4, 6.07538e-3),
    ("kelvin", EULER): (2.5148394e-3, 8.43585e-4),
    ("kelvin", TIMOSHENKO): (2.1614025e-3, 7.60189e-4),
}


@dataclass(frozen=True)
class Strut:
    """Section and stiffnesses of a strut."""

    r: float
    L: float
    kappa: float

    @property
    def A(self) -> float:
        return np.pi * self.r**2

    @property
    def second_moment(self) -> float:
        return np.pi / 4 * self.r**4

    @property
    def phi(self) -> float:
        return 12 * self.second_moment * 2 * (1 + NU) / (self.kappa * self.A * self.L**2)

    @property
    def eta(self) -> float:
        return 3 * (self.r / self.L) ** 2 / (1 + self.phi)

    @property
    def ka(self) -> float:
        return self.A / self.L

    @property
    def ks(self) -> float:
        return self.eta * self.ka


def homogenised(name: str, r: float, kappa: float) -> EffectiveStiffness:
    material = StrutMaterial(1.0, NU, Round(shear_factor=kappa))
    frame = periodic_frame(unit_cell(name), edge=1.0, radius=r, material=material)
    return EffectiveStiffness(homogenise_frame(frame).C)


def closed_forms(name: str, s: Strut) -> dict[str, float]:
    rho = STRUTS[name] * s.A * s.L
    if name == "octet":
        return {
            "E100": rho / 9 * (1 + 3 * s.eta) / (1 + s.eta / 3),
            "G": rho * (1 + s.eta) / 12,
            "nu": (1 - s.eta) / (3 + s.eta),
        }
    if name == "bcc":
        S = 8 * s.L**2 / 9
        return {"E100": 9 * S * s.ka * s.ks / (2 * s.ka + s.ks)}
    if name == "cube":
        return {"E100": rho / 3, "G": 6 * s.second_moment / (1 + s.phi)}
    if name == "kelvin":
        bending = 6 * np.sqrt(2) * s.second_moment / s.L**4
        return {"E100": bending / (1 + 12 * s.second_moment / (s.A * s.L**2) + s.phi)}
    return {
        "K": s.ka / 3,
        "C11 - C12": s.ks,
        "G": 1.5 * s.ka * s.ks / (s.ka + 2 * s.ks),
        "E100": 3 * s.ka * s.ks / (2 * s.ka + s.ks),
    }


def found(effective: EffectiveStiffness) -> dict[str, float]:
    c11, c12, c44 = effective.cubic
    constants = effective.engineering_constants
    return {
        "E100": constants.E[0],
        "G": c44,
        "nu": constants.nu[0],
        "K": effective.bulk_modulus,
        "C11 - C12": c11 - c12,
    }


# Digits of the printed numbers: eight of E, one cut of E with nine, and six of G.
PRINTED_E, PRINTED_G = 4e-8, 5e-6

NAMES = {EULER: "Euler-Bernoulli", TIMOSHENKO: "Timoshenko"}

# Of the isotropic solid with voids, nu = 0.3, E = 1, three digits.
HASHIN_SHTRIKMAN = {0.1: 0.0525, 0.2: 0.111, 0.3: 0.176, 0.5: 0.333}


def _measured(name: str, what: str, kappa: float) -> Measured:
    return Measured(float(found(homogenised(name, 0.05, kappa))[what]), f"{STRUTS[name]} struts", 0)


def _closed(name: str) -> tuple[Target, ...]:
    return tuple(
        Target(
            f"{what}, {NAMES[kappa]}",
            "",
            float(value),
            EXACT,
            lambda what=what, kappa=kappa: _measured(name, what, kappa),
        )
        for kappa in NAMES
        for what, value in closed_forms(name, Strut(0.05, LENGTH[name], kappa)).items()
    )


def _printed(name: str) -> tuple[Target, ...]:
    return tuple(
        Target(
            f"{what}, {NAMES[kappa]}, as printed",
            "",
            value,
            tolerance,
            lambda what=what, kappa=kappa: _measured(name, what, kappa),
        )
        for (cell, kappa), pair in PRINTED.items()
        if cell == name
        for what, value, tolerance in zip(("E100", "G"), pair, (PRINTED_E, PRINTED_G), strict=True)
    )


SOURCES = {
    "octet": "V. S. Deshpande, N. A. Fleck, M. F. Ashby, J. Mech. Phys. Solids 49 (2001) 1747, "
    "for the limit of thin struts.",
    "bcc": "Closed form: struts are springs along and across, joints do not turn.",
    "cube": "Closed form.",
    "kelvin": "W. E. Warren, A. M. Kraynik, J. Appl. Mech. 64 (1997) 787; H. X. Zhu, J. F. Knott, "
    "N. J. Mills, J. Mech. Phys. Solids 45 (1997) 319.",
    "diamond": "M. Born, Ann. Phys. 44 (1914) 605; A. N. Norris, Proc. R. Soc. A 470 (2014) 20140522.",
}

BENCHMARKS = (
    *(
        Benchmark(
            f"Periodic {name}",
            SOURCES[name],
            "Edge 1 mm, r = 0.05 mm, E = 1 MPa, nu = 0.3, kappa = 0.9 or infinite.",
            (*_closed(name), *_printed(name)),
        )
        for name in LENGTH
    ),
    Benchmark(
        "Bounds",
        "Z. Hashin, S. Shtrikman, J. Mech. Phys. Solids 11 (1963) 127.",
        "Largest Young's modulus of an isotropic solid with voids, E = 1 MPa, nu = 0.3, by density.",
        tuple(
            Target(
                f"density {density:g}",
                "MPa",
                E,
                5.1e-4,
                lambda density=density: Measured(
                    float(hashin_shtrikman_bound(1.0, NU, density).E), "formula", 0
                ),
                bound="absolute",
            )
            for density, E in HASHIN_SHTRIKMAN.items()
        ),
    ),
)
