"""A verification target, and what this package computes for it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from fea import TetMesh


@dataclass(frozen=True)
class Measured:
    """What a run gives.

    Attributes:
        value: the quantity.
        element: such as "tet4", or what was computed with instead of a mesh, such as "8 struts".
        nodes: of the mesh; None where the mesher's result varies from run to run, 0 without a mesh.
    """

    value: float
    element: str
    nodes: int | None

    @classmethod
    def on(cls, mesh: TetMesh, value: float | np.floating) -> "Measured":
        """A value computed on a mesh."""
        return cls(float(value), mesh.element, len(mesh.nodes))

    @classmethod
    def by_beams(cls, count: int, value: float | np.floating) -> "Measured":
        """A value computed with so many beam elements."""
        return cls(float(value), f"{count} beam" + "s" * (count > 1), 0)


@dataclass(frozen=True)
class Target:
    """One number to reach.

    Attributes:
        quantity: what it is, and where.
        unit: of the quantity; "" for a pure number.
        expected: the number.
        tolerance: allowed deviation; None where the number is shown for comparison only.
        measure: computes our value.
        bound: what the tolerance limits: the deviation relative to `expected`, the deviation
            itself, or, for "least", how far the value may stay below.
    """

    quantity: str
    unit: str
    expected: float
    tolerance: float | None
    measure: Callable[[], Measured]
    bound: Literal["relative", "absolute", "least"] = "relative"

    def deviation(self, value: float) -> float:
        """Signed deviation from what is expected, in the sense of `bound`."""
        difference = value - self.expected
        if self.bound == "least":
            return min(difference, 0.0)
        return difference / self.expected if self.bound == "relative" else difference

    def met_by(self, value: float) -> bool:
        """Whether a value is within the tolerance; NaN never is."""
        return self.tolerance is None or abs(self.deviation(value)) <= self.tolerance


@dataclass(frozen=True)
class Benchmark:
    """Targets of one problem.

    Attributes:
        name: heading of the page.
        source: where problem and numbers come from.
        problem: what is solved, with units.
        targets: what is to be reached.
    """

    name: str
    source: str
    problem: str
    targets: tuple[Target, ...]


def furthest(values: Float[np.ndarray, "..."], expected: float) -> float:
    """The value that is furthest off, so that all of a field meet a target when this one does."""
    flat = values.ravel()
    return float(flat[np.argmax(np.abs(flat - expected))])
