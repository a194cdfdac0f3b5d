"""How two kinds of unit cells are joined: one picture of three pairs, and their numbers.

`python3 studies/two_cells/interface.py --out DIR` writes DIR/two_cells.png, which is
docs/images/two_cells.png, and prints the numbers of docs/several-cells.md.
"""

import argparse
import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.errors import OutputError
from texmap_opt.report.drawing import draw
from texmap_opt.report.scenes import Struts
from texmap_opt.structure.face_overlay import face_overlay
from texmap_opt.structure.interface import Interface
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.mixed_net import mixed_net

PAIRS = (("octet", "kelvin"), ("bcc", "kelvin"), ("diamond", "octet"))
# Cells along x and y, and of each kind along z.
ACROSS, ALONG = 2, 1
EDGE_MM, RADIUS_MM = 10.0, 0.35
# Drawing three scenes takes some seconds.
TIMEOUT_S = 300.0
# Of the picture's width, without the colour bar.
SHOWN = 0.78


def block(lower: UnitCell, upper: UnitCell) -> tuple[Struts, Interface]:
    """Cells of one kind below another, coloured by kind, and how they are joined."""
    kinds = np.zeros((ACROSS, ACROSS, 2 * ALONG), np.int64)
    kinds[:, :, ALONG:] = 1
    net, (interface,) = mixed_net(Layout((lower, upper), kinds))
    ticks = [EDGE_MM * np.arange(n + 1) for n in kinds.shape]
    nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
    structure = map_structure(net, nodes, RADIUS_MM)
    kind = np.repeat(net.kind[:, None].astype(float), 2, axis=1)
    return Struts(structure.joints, structure.struts, structure.radii, kind, "kind", ""), interface


def draw_face(ax: Axes, lower: UnitCell, upper: UnitCell, colours: np.ndarray) -> None:
    """What lies in one face between the two, seen along z."""
    still = ((False,) * 3, (False,) * 3)
    overlay = face_overlay((lower, upper), still, axis=2)
    places = overlay.points / TICKS
    for ends, side in zip(overlay.pieces, overlay.piece_side, strict=True):
        ax.plot(*places[ends].T, color=colours[side], linewidth=3)
    for ends in overlay.transitions:
        ax.plot(*places[ends].T, color=colours[2], linewidth=3)
    for side in (0, 1):
        ax.plot(*places[overlay.of_kind[:, side]].T, "o", color=colours[side], markersize=9)
    crossings = places[~overlay.of_kind.any(axis=1)]
    ax.plot(*crossings.T, "o", color="black", markersize=6, fillstyle="none")
    ax.set(aspect="equal", xlim=(-0.15, 1.15), ylim=(-0.15, 1.15))
    ax.axis("off")


def cropped(picture: np.ndarray) -> np.ndarray:
    """Without the colour bar and the white around."""
    picture = picture[:, : int(SHOWN * picture.shape[1]), :3]
    inked = picture.min(axis=2) < 1
    rows, columns = (np.unique(place) for place in np.nonzero(inked))
    return picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def main() -> None:
    """Draw the blocks over the faces between their kinds and print how they are joined."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    cells = [(unit_cell(lower), unit_cell(upper)) for lower, upper in PAIRS]
    scenes = {}
    for name, pair in zip(map("-".join, PAIRS), cells, strict=True):
        scenes[name], interface = block(*pair)
        print(json.dumps(interface.numbers()))
    figure, axes = plt.subplots(2, len(PAIRS), figsize=(13, 8), height_ratios=(3, 2))
    with tempfile.TemporaryDirectory() as folder:
        drawn = draw(scenes, Path(folder), timeout_s=TIMEOUT_S)
        if drawn.missing:
            raise OutputError("; ".join(drawn.missing.values()))
        for column, (name, pair) in enumerate(zip(scenes, cells, strict=True)):
            most = scenes[name].values.max()
            colours = plt.get_cmap("viridis")(np.arange(3) / most)
            axes[0, column].imshow(cropped(plt.imread(drawn.pictures[name])))
            axes[0, column].axis("off")
            draw_face(axes[1, column], *pair, colours)
            words = [*PAIRS[column], "transition"][: int(most) + 1]
            axes[1, column].legend(
                handles=[Patch(color=c, label=w) for c, w in zip(colours, words, strict=False)],
                loc="upper center",
                bbox_to_anchor=(0.5, 0.02),
                ncols=3,
                frameon=False,
            )
    figure.tight_layout()
    figure.savefig(out / "two_cells.png", dpi=80)


if __name__ == "__main__":
    main()
