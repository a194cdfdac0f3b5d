"""Where the struts of a trimmed lattice have joint zones, and what these do to the frame.

The joint model of a unit cell (`texmap_opt.cells.joint_model`) is that of struts with a joint at either
end. A trimmed lattice also has ends that the part's surface cuts, ends in the skin and loose ends: they
have no zone, and half of what the model changes of the modulus belongs to each end that has one.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from texmap_opt.case import DesignCase
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.skinned_frame import FrameSkin
from texmap_opt.structure.structure import Structure

# The section that the models are fitted for.
FITTED_SECTION = "round"


@dataclass(frozen=True, eq=False)
class JointZones:
    """Joint zones of a structure, for any radii.

    Attributes:
        model: of the unit cell.
        present: whether each end of a strut has a zone.
        lengths: of the struts, without what lies in the skin [mm].
    """

    model: JointModel
    present: Bool[np.ndarray, "struts 2"]
    lengths: Float[np.ndarray, " struts"]

    @classmethod
    def of(
        cls, structure: Structure, case: DesignCase, skin: FrameSkin | None
    ) -> "JointZones | None":
        """The zones of a trimmed lattice; None where its cell has no joint model, or none is wanted.

        Args:
            structure: the trimmed lattice.
            case: its unit cell, and whether the model is wanted.
            skin: the skin that it hangs on; None: none.
        """
        model = unit_cell(case.lattice.cell, base=case.directory).joint_model
        if model is None or structure.section != FITTED_SECTION or not case.analysis.joint_model:
            return None
        valence = np.bincount(structure.struts.ravel(), minlength=len(structure.joints))
        joined = (valence > 1) & ~structure.cut
        lengths = structure.lengths()
        if skin is not None:
            joined[skin.tie.nodes] = False
            lengths = lengths - skin.rigid_ends.sum(axis=1)
        return cls(model, joined[structure.struts], lengths)

    def rigid_ends(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, "struts 2"]:
        """Rigid length at both ends of each strut [mm], in JAX."""
        return self._counted(radii) * (self.model.rigid_end * self.present)

    def modulus(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, " struts"]:
        """Relative modulus of each strut, in JAX."""
        slenderness = self._counted(radii) / self.lengths[:, None]
        return 1 + self.model.modulus / 2 * jnp.sum(
            self.present.astype(float) * slenderness, axis=1
        )

    def thicker(self, radii: Float[np.ndarray, "struts 2"]) -> float:
        """Share of the struts that are thicker than the model was fitted to."""
        zoned = self.present.any(axis=1)
        over = radii.max(axis=1) > self.model.slenderness * self.lengths
        return float((over & zoned).sum() / max(int(zoned.sum()), 1))

    def _counted(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, "struts 2"]:
        """Radii, up to the thickest that the model was fitted to.

        Beyond that it is held: its zones would meet, and its modulus would fall to zero.
        """
        return jnp.minimum(jnp.asarray(radii), self.model.slenderness * self.lengths[:, None])
