"""Supports and loads of a case as marks on a picture."""

import numpy as np
from jaxtyping import Float

from texmap_opt.case import Load, Support
from texmap_opt.report.scenes import Action, Mark
from texmap_opt.solid.tri_mesh import TriMesh


def mark_of(
    action: Support | Load, patch: TriMesh, label: str, resultant: Float[np.ndarray, " 3"]
) -> Mark:
    """The mark of a support or load.

    Args:
        action: what it is.
        patch: the facets it acts on.
        label: one line for the legend.
        resultant: total force [N]; acceleration for gravity.
    """
    if isinstance(action, Support):
        return Mark(Action.SUPPORT, label, patch, np.zeros(3))
    if action.region is None:
        return Mark(Action.GRAVITY, label, patch, resultant)
    if action.moment_Nmm is not None and not resultant.any():
        return Mark(Action.MOMENT, label, patch, np.array(action.moment_Nmm, float))
    if action.pressure_MPa is not None and action.force_N is None and action.traction_MPa is None:
        kind = Action.PRESSURE if action.pressure_MPa > 0 else Action.SUCTION
        return Mark(kind, label, patch, np.zeros(3))
    return Mark(Action.FORCE, label, patch, resultant)
