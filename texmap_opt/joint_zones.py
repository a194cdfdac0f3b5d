"""Where the struts of a trimmed lattice have joint zones, and what these do to the frame.

The joint model of a unit cell (`texmap_opt.cells.joint_model`) is that of struts with a joint at either
end. A trimmed lattice also has ends that the part's surface cuts, ends in the skin and loose ends: they
have no zone, and half of what the model changes of the modulus belongs to each end that has one. Where
cells of several kinds meet, no model was fitted to the joints that struts of two kinds share: these have
no zone either.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.case import DesignCase
from texmap_opt.cell_layout import case_cells
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.skinned_frame import FrameSkin
from texmap_opt.structure.structure import Structure

# The section that the models are fitted for.
FITTED_SECTION = "round"


@dataclass(frozen=True, eq=False)
class JointZones:
    """Joint zones of a structure, for any radii.

    Attributes:
        models: joint models by the name of the unit cell, of those that have one.
        model: of each strut as a number in their order; that of a strut without zones is of no effect.
        present: whether each end of a strut has a zone.
        lengths: of the struts, without what lies in the skin [mm].
    """

    models: dict[str, JointModel]
    model: Int[np.ndarray, " struts"]
    present: Bool[np.ndarray, "struts 2"]
    lengths: Float[np.ndarray, " struts"]

    @classmethod
    def of(
        cls, structure: Structure, case: DesignCase, skin: FrameSkin | None
    ) -> "JointZones | None":
        """The zones of a trimmed lattice; None where no cell has a joint model, or none is wanted.

        Args:
            structure: the trimmed lattice; without an origin all of the cell of `[lattice]`.
            case: its unit cells, and whether the model is wanted.
            skin: the skin that it hangs on; None: none.
        """
        if structure.section != FITTED_SECTION or not case.analysis.joint_model:
            return None
        cells = case_cells(case).cells
        models = {cell.name: cell.joint_model for cell in cells if cell.joint_model is not None}
        if not models:
            return None
        kind, kinds = np.zeros(len(structure.struts), np.int64), (cells[0].name,)
        if structure.origin is not None:
            kind, kinds = structure.origin.kind, structure.origin.kinds
        joined = _of_one_kind(structure, kind) & (structure.degrees() > 1) & ~structure.cut
        lengths = structure.lengths()
        if skin is not None:
            joined[skin.tie.nodes] = False
            lengths = lengths - skin.rigid_ends.sum(axis=1)
        names = list(models)
        number = np.array([names.index(name) if name in models else -1 for name in kinds])[kind]
        present = joined[structure.struts] & (number >= 0)[:, None]
        return cls(models, np.maximum(number, 0), present, lengths)

    def rigid_ends(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, "struts 2"]:
        """Rigid length at both ends of each strut [mm], in JAX."""
        share = self._of_struts("rigid_end")[:, None] * self.present
        return self._counted(radii) * jnp.asarray(share)

    def modulus(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, " struts"]:
        """Relative modulus of each strut, in JAX."""
        radius_ratio = self._counted(radii) / self.lengths[:, None]
        zoned = jnp.sum(self.present.astype(float) * radius_ratio, axis=1)
        return 1 + jnp.asarray(self._of_struts("modulus") / 2) * zoned

    def thicker(self, radii: Float[np.ndarray, "struts 2"]) -> float:
        """Share of the struts with zones that are thicker than their model was fitted to."""
        zoned = self.present.any(axis=1)
        over = radii.max(axis=1) > self._of_struts("radius_ratio") * self.lengths
        return float((over & zoned).sum() / max(int(zoned.sum()), 1))

    def _counted(self, radii: Float[Array | np.ndarray, "struts 2"]) -> Float[Array, "struts 2"]:
        """Radii, up to the thickest that the model was fitted to.

        Beyond that it is held: its zones would meet, and its modulus would fall to zero.
        """
        thickest = self._of_struts("radius_ratio") * self.lengths
        return jnp.minimum(jnp.asarray(radii), thickest[:, None])

    def _of_struts(self, name: str) -> Float[np.ndarray, " struts"]:
        """A number of the joint model of each strut."""
        return np.array([getattr(model, name) for model in self.models.values()])[self.model]


def _of_one_kind(
    structure: Structure, kind: Int[np.ndarray, " struts"]
) -> Bool[np.ndarray, " joints"]:
    """Whether all struts at each joint are of the same kind."""
    least = np.full(len(structure.joints), np.iinfo(np.int64).max)
    most = np.full(len(structure.joints), -1)
    np.minimum.at(least, structure.struts, kind[:, None])
    np.maximum.at(most, structure.struts, kind[:, None])
    return least >= most
