"""The stress that brings tractions into balance across faces where stress is not continuous."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from fea.elements import STRAIN
from fea.modulus_jumps import InnerFaces
from fea.stress_recovery import RecoveredStress
from fea.voigt import tensor

# Where the faces of a corner are nearly one plane, or their tractions contradict each other, the
# tensor is kept small by this weight on its square, at the cost of as large a share of it.
DAMPING = 0.01


def balancing_stress(
    recovered: RecoveredStress, jumps: InnerFaces
) -> tuple[Int[np.ndarray, " cells"], Float[np.ndarray, "cases cells 4 6"]]:
    """What recovered stress lacks for equal tractions on both sides of every jump.

    On the face both sides ought to have the traction that is nearest to theirs in the energy norm:
    their mean weighed with 1/E. A field in each cell brings the difference in, as it does for the
    fluxes of Cai, He and Zhang (arXiv:1508.00191, 2015), where only normal components are made
    continuous. Here it is a symmetric tensor: at each corner of a cell the one that, in the sense of
    least squares, has the missing tractions on the faces there which are jumps; linear in between.

    Args:
        recovered: stress on both sides.
        jumps: the faces.

    Returns:
        The cells at jumps, in increasing order, and the stress at their corners [MPa].
    """
    n, corners = jumps.normals, jumps.corners[:, :, :3]
    cells, row = np.unique(jumps.cells, return_inverse=True)
    at = recovered.torn.pieces.tets[jumps.cells[:, :, None], corners]
    # case, face, side, corner, space
    traction = np.einsum("sfakij,fkj->sfaki", tensor(recovered.values[:, at]), n)
    flexible = 1 / jumps.modulus
    share = flexible / flexible.sum(axis=1, keepdims=True)
    missing = np.einsum("fa,sfaki->sfki", share, traction)[:, :, None] - traction

    # Traction of a 6-vector: rows of T. Both sides take the same normal: signs cancel.
    T = np.einsum("vij,fkj->fkiv", STRAIN, n)
    square = np.einsum("fkiv,fkiw->fkvw", T, T).reshape(len(n), 1, 3, 36)
    right = np.einsum("fkiv,sfaki->fakvs", T, missing)
    slot = (4 * row.reshape(-1, 2, 1) + corners).ravel()
    total = csr_array(
        (np.ones(len(slot)), (slot, np.arange(len(slot)))), shape=(4 * len(cells), len(slot))
    )
    square = total @ np.repeat(square, 2, axis=1).reshape(len(slot), 36)
    right = total @ right.reshape(len(slot), -1)
    # The square of the tensor counts each shear twice.
    damped = square.reshape(-1, 6, 6) + DAMPING * np.diag([1.0, 1, 1, 2, 2, 2])
    solved = np.linalg.solve(damped, right.reshape(len(right), 6, -1))
    return cells, solved.reshape(len(cells), 4, 6, -1).transpose(3, 0, 1, 2)
