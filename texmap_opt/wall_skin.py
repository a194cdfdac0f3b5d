"""The skin that the walls of an extruded lattice hang on: a sheet in their plane.

Decision note: docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

import numpy as np

from fea.skin import Skin
from texmap_opt.case import DesignCase
from texmap_opt.part import Part
from texmap_opt.plane_sheet import PlaneSheet, plane_sheet
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.skinned_frame import FrameSkin, tied_joints, within_skin
from texmap_opt.structure.silhouette import silhouette
from texmap_opt.structure.structure import Extrusion, Structure
from texmap_opt.structure.trim import held_by_skin, joint_radii

# Edge of the sheet's triangles over the median length of the walls: four triangles and more a cell,
# about as many unknowns as the walls have.
EDGE_SHARE = 0.5


def wall_skin(
    structure: Structure, walls: Extrusion, part: Part, case: DesignCase
) -> tuple[FrameSkin, PlaneSheet]:
    """Plates and rim of an extruded lattice with how its walls hang on them, and the sheet they are.

    Walls stand between the plates, so that every joint moves with them; the plates hold what of a
    wall's depth lies in them, and the rim what of its length.

    Args:
        structure: the trimmed lattice.
        walls: its extrusion.
        part: what it fills.
        case: the skin's thickness and material.

    Raises:
        LatticeError: the outline of the part is too fine, or a wall misses the sheet.
    """
    skin_mm = case.lattice.skin_mm
    edge = EDGE_SHARE * float(np.median(structure.lengths()))
    sheet = plane_sheet(part, walls, skin_mm=skin_mm, edge=edge)
    everyone = np.arange(len(structure.joints))
    tie, _, distance = tied_joints(structure, everyone, sheet.surface, case)
    outline = Part(silhouette(part.surface, walls.axis), part.name)
    depth = outline.signed_distance.unsigned(structure.joints)[0]
    in_rim = held_by_skin(structure.cut, depth, joint_radii(structure), skin_mm)
    rigid_ends, beyond = within_skin(structure, outline, np.where(in_rim, skin_mm, 0.0))
    middle = structure.joints[structure.struts].mean(axis=1)
    below = SignedDistance(sheet.surface).unsigned(middle)[1]
    shell = Skin(
        sheet.surface.faces + len(structure.joints),
        sheet.thickness,
        E=case.material.E,
        nu=case.material.nu,
    )
    skin = FrameSkin(
        mesh=sheet,
        shell=shell,
        tie=tie,
        rigid_ends=rigid_ends,
        beyond=beyond,
        longest_arm=float(distance.max()),
        plates=sheet.plates[below],
    )
    return skin, sheet
