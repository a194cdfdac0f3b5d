"""Whether the loads of a case act in the plane of an extruded lattice's walls.

The rules are those of docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.box import Box
from texmap_opt.case import DesignCase, Load
from texmap_opt.errors import CaseError
from texmap_opt.stress_field import StressField
from texmap_opt.structure.structure import Extrusion

# Share of a load that may act out of the plane and is left out: 0.6 degrees, finer than loads are
# known, and more than the rounding of directions with two digits.
OUT_OF_PLANE = 1e-2

# Distance of a load's line of action from the plane half way between the ends of the walls, over
# their depth, from which on the user is told.
NOTABLE_ECCENTRICITY = 0.1


REASON = (
    ", but the walls of an extruded lattice bend about that axis only, and carry no load along it in "
    "this model"
)
# Share of a load's forces that may act along the axis and balance each other, as on sides with a draft.
BALANCED = 0.1
REMEDY = (
    "extrude along another axis, take a 3-D cell, or give [sizing] method = "
    '"none" for the geometry without its mechanics.'
)
# What a load's vectors are called.
FORCES = ("force_N", "traction_MPa", "gravity_m_s2")


def require_loads_in_plane(case: DesignCase, box: Box) -> None:
    """Refuse loads that the case itself puts out of the plane of walls, before anything is computed.

    Args:
        case: its loads; where nothing is sized, all are let pass.
        box: of the grid; in three dimensions there are no walls.

    Raises:
        CaseError: naming the load, its direction and the reason.
    """
    if box.dimensions == 3 or case.sizing.method == "none":
        return
    for load in case.loads:
        fault = _stated(load, box.axes[2])
        if fault is not None:
            raise CaseError(f"{load.where} {fault}{REASON}; {REMEDY}")


def out_of_plane_load(case: DesignCase, stress: StressField, walls: Extrusion) -> str | None:
    """What is wrong with the first load that does not act in the plane of the walls, in a clause.

    Args:
        case: the loads.
        stress: their forces on the nodes of the solid part.
        walls: axis and heights of the extrusion.
    """
    for load, nodal in zip(case.loads, stress.load_forces, strict=True):
        fault = _fault(load, _Resultant.of(load, nodal, stress, walls), walls)
        if fault is not None:
            return f"{load.where} {fault}{REASON}"
    return None


def eccentric_loads(case: DesignCase, stress: StressField, walls: Extrusion) -> list[str]:
    """A sentence for every load that acts in a plane well above or below the middle of the walls."""
    notes = []
    depth = walls.high - walls.low
    for load, nodal in zip(case.loads, stress.load_forces, strict=True):
        off = _Resultant.of(load, nodal, stress, walls).eccentricity
        if off > NOTABLE_ECCENTRICITY * depth:
            notes.append(
                f"{load.where}: acts {off:.3g} mm off the middle of the {depth:.3g} mm deep walls, and "
                "counts as acting in it; the bending that makes out of the plane is left out"
            )
    return notes


@dataclass(frozen=True)
class _Resultant:
    """Force and moment of a load on the surface, in the plane of the walls and out of it.

    Attributes:
        size: sum of the sizes of the forces [N].
        force: along the axis of extrusion [N].
        along: sum of the sizes of the forces along it, balanced or not [N].
        within: size of the force in the plane [N].
        moment: size of the moment about axes in the plane through its middle [N mm].
    """

    size: float
    force: float
    along: float
    within: float
    moment: float

    @classmethod
    def of(
        cls,
        load: Load,
        nodal: Float[np.ndarray, "nodes 3"],
        stress: StressField,
        walls: Extrusion,
    ) -> "_Resultant":
        if load.region is None:
            return cls(0.0, 0.0, 0.0, 0.0, 0.0)
        axis, along = walls.axis, nodal @ walls.axis
        flat = nodal - along[:, None] * axis
        height = stress.mesh.nodes @ axis - (walls.low + walls.high) / 2
        # Forces along the axis turn the part about axes in the plane by themselves, whatever the
        # origin, when their resultant is nothing.
        centre = stress.mesh.nodes[nodal.any(axis=1)].mean(axis=0)
        arm = stress.mesh.nodes - centre
        arm -= (arm @ axis)[:, None] * axis
        moment = np.cross(axis, (height[:, None] * flat).sum(axis=0))
        moment = moment + np.cross(arm, along[:, None] * axis).sum(axis=0)
        return cls(
            float(np.linalg.norm(nodal, axis=1).sum()),
            float(along.sum()),
            float(np.abs(along).sum()),
            float(np.linalg.norm(flat.sum(axis=0))),
            float(np.linalg.norm(moment)),
        )

    @property
    def eccentricity(self) -> float:
        """Distance of the force in the plane from the middle of the walls [mm]; 0 without force."""
        return self.moment / self.within if self.within > OUT_OF_PLANE * self.size else 0.0


def _stated(load: Load, axis: Float[np.ndarray, " 3"]) -> str | None:
    """Which vector of a load points out of the plane, in words; None: none does."""
    for name in FORCES:
        value = getattr(load, name)
        if value is not None and abs(np.array(value) @ axis) > OUT_OF_PLANE * np.linalg.norm(value):
            return f"{name} = {list(value)}: acts along the axis of extrusion {_text(axis)}"
    if load.moment_Nmm is not None:
        moment = np.array(load.moment_Nmm)
        bending = np.linalg.norm(moment - moment @ axis * axis)
        if bending > OUT_OF_PLANE * np.linalg.norm(moment):
            return f"moment_Nmm = {list(load.moment_Nmm)}: turns across the axis of extrusion {_text(axis)}"
    return None


def _text(axis: Float[np.ndarray, " 3"]) -> str:
    return "[" + ", ".join(f"{c + 0.0:.3g}" for c in axis) + "]"


def _fault(load: Load, resultant: _Resultant, walls: Extrusion) -> str | None:
    """What of a load acts out of the plane, in words; None: nothing."""
    stated = _stated(load, walls.axis)
    if stated is not None:
        return stated
    axis = _text(walls.axis)
    if abs(resultant.force) > OUT_OF_PLANE * resultant.size:
        return (
            f"acts with {resultant.force:.3g} N along the axis of extrusion {axis}, more than "
            f"{100 * OUT_OF_PLANE:g} % of its {resultant.size:.3g} N"
        )
    if resultant.along > BALANCED * resultant.size:
        return (
            f"acts with {resultant.along:.3g} N to and fro along the axis of extrusion {axis}, more than "
            f"{100 * BALANCED:g} % of its {resultant.size:.3g} N"
        )
    reach = (walls.high - walls.low) / 2
    if resultant.moment > (1 + OUT_OF_PLANE) * reach * max(
        resultant.within, OUT_OF_PLANE * resultant.size
    ):
        return (
            f"turns the part with {resultant.moment:.3g} N mm across the axis of extrusion {axis}, more "
            f"than its force in the plane does anywhere in the walls"
        )
    return None
