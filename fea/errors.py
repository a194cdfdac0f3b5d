"""The one error that mechanics raises when an analysis is impossible or its answer unusable."""

import numpy as np
from jaxtyping import Float


class FeaError(Exception):
    """An analysis cannot be set up or solved.

    The message is one sentence: what was wrong, the value, the limit, and the remedy.
    """


def position_text(point: Float[np.ndarray, " d"]) -> str:
    """A position as messages show it, such as "(1, 2.5, 3)"."""
    return f"({', '.join(f'{float(c):.6g}' for c in point)})"
