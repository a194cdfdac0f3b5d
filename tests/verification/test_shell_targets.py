"""How errors of shells fall; the published values are in `targets.py`."""

import numpy as np
import pytest
from shell_cases import plates


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        (
            lambda n: plates.bending("clamped", "uniform", n),
            plates.DEFLECTIONS["clamped", "uniform"],
        ),
        (lambda n: plates.frequency("clamped", 0, n), plates.FREQUENCIES["clamped"][0]),
    ],
    ids=["deflection", "frequency"],
)
def test_errors_of_clamped_plates_fall_as_the_square_of_the_size(measure, expected):
    coarse, fine = (abs(measure(n).value - expected) for n in (6, 12))
    # Second order, seen on meshes that are coarse enough for the next order to show.
    assert 1.6 < np.log2(coarse / fine) < 2.4
