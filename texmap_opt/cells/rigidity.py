"""Is a cell rigid with pin joints? Counted by Maxwell's rule, and checked by rank."""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.tile import tile

# Singular values below this share of the largest are zero: directions are exact to 1e-16, and the
# smallest true value of a cell with a dozen joints is about 1e-2.
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Mechanisms:
    """What the periodic, pin-jointed lattice can do at no cost in strut length.

    Attributes:
        mechanisms: independent motions with no strut changing length, translations left out.
        strain_producing: how many independent uniform strains they make. Zero means that every
            load stretches struts: the lattice is stretching-dominated.
        self_stresses: independent strut forces in balance without load.
    """

    mechanisms: int
    strain_producing: int
    self_stresses: int


def maxwell_number(cell: UnitCell) -> int:
    """Maxwell's b - 3 j + 6, or b - 2 j + 3 in the plane, for one cell alone.

    Negative means that it cannot be rigid.
    """
    d = cell.dimensions
    return len(cell.struts) - d * len(cell.joints) + d * (d + 1) // 2


def classification(cell: UnitCell) -> str:
    """Whether the lattice is "stretching"- or "bending"-dominated.

    Bending where some uniform strain stretches no strut of the pin-jointed lattice (Deshpande, Ashby,
    Fleck, Acta Mater. 49 (2001) 1035).
    """
    return "bending" if mechanisms(cell).strain_producing else "stretching"


def mechanisms(cell: UnitCell) -> Mechanisms:
    """Rank check on the periodic cell (Hutchinson, Fleck, J. Mech. Phys. Solids 54 (2006) 756).

    Unknowns are the joint displacements u within one period and the uniform strain E; a strut of
    direction n from joint a to joint b lengthens, over its length, by n.(u_b - u_a) / L + n.E n.
    Only motions whose wavelength is the period are seen.
    """
    d = cell.dimensions
    compatibility, joints = _compatibility(cell)
    _, values, rows = np.linalg.svd(compatibility, full_matrices=True)
    rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
    free = rows[rank:]
    strains = np.linalg.svd(free[:, d * joints :], compute_uv=False)
    return Mechanisms(
        mechanisms=len(free) - d,
        strain_producing=int(np.sum(strains > RANK_TOLERANCE)),
        self_stresses=len(compatibility) - rank,
    )


def _compatibility(cell: UnitCell) -> tuple[Float[np.ndarray, "struts dofs"], int]:
    """Matrix from (displacements, strain) to strut elongations, and the joints in one period.

    In the unit cube: stretching a net changes neither its mechanisms nor its self-stresses.
    """
    d = cell.dimensions
    period = TICKS * np.array(cell.period)
    net = tile(cell, cell.period)
    ticks = np.rint(net.joints * TICKS).astype(np.int64)
    places, image = np.unique(ticks % period, axis=0, return_inverse=True)
    image = image.reshape(-1)
    step = ticks[net.struts[:, 1]] - ticks[net.struts[:, 0]]
    ends = image[net.struts]
    # The same strut seen on opposite faces of the block joins the same images by the same step;
    # seen from its other end, the reverse of both.
    swap = (ends[:, 0] > ends[:, 1]) | ((ends[:, 0] == ends[:, 1]) & _is_backward(step))
    ends[swap] = ends[swap][:, ::-1]
    step[swap] *= -1
    bars = np.unique(np.concatenate([ends, step], axis=1), axis=0)
    vector = bars[:, 2:] / TICKS
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    n = vector / length
    matrix = np.zeros((len(bars), len(places), d))
    row = np.arange(len(bars))
    np.add.at(matrix, (row, bars[:, 1]), n / length)
    np.add.at(matrix, (row, bars[:, 0]), -n / length)
    pairs = itertools.combinations_with_replacement(range(d), 2)
    strain = np.stack([n[:, i] * n[:, j] for i, j in pairs], axis=1)
    full = np.concatenate([matrix.reshape(len(bars), -1), strain], axis=1)
    return full, len(places)


def _is_backward(step: np.ndarray) -> np.ndarray:
    """True where the first component that is not zero is negative."""
    first = np.argmax(step != 0, axis=1)
    return np.take_along_axis(step, first[:, None], axis=1)[:, 0] < 0
