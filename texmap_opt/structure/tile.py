"""One unit cell put side by side with itself."""

import numpy as np

from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.mixed_net import mixed_net
from texmap_opt.structure.net import Net


def tile(cell: UnitCell, shape: tuple[int, ...]) -> Net:
    """Put copies of a cell side by side and weld what neighbours share.

    Args:
        cell: the unit cell.
        shape: number of cells along each of its axes.
    """
    return mixed_net(Layout((cell,), np.zeros(shape, np.int64)))[0]
