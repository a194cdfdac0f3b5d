"""VTK reads back what was written."""

from pathlib import Path

import numpy as np
import pytest
import pyvista

from texmap_opt.export import vtk
from texmap_opt.export.vtk import write_grid, write_stress, write_struts
from texmap_opt.structure.structure import Structure


@pytest.fixture
def bow() -> Structure:
    """Two struts that share a joint, and a joint no strut uses."""
    return Structure(
        joints=np.array([[0.0, 0, 0], [9, 9, 9], [4, 0, 0], [4, 3, 0]]),
        struts=np.array([[0, 2], [3, 2]]),
        radii=np.array([[0.5, 0.25], [0.3, 0.4]]),
        cut=np.zeros(4, dtype=bool),
        cell_size=np.ones(2),
    )


@pytest.mark.parametrize("at_once", [vtk._CHUNK, 1, 7])
def test_vtk_reads_back_what_was_written(
    at_once: int, tmp_path: Path, bow: Structure, monkeypatch: pytest.MonkeyPatch
):
    """Whatever the size of the pieces: three bytes are four letters of base64."""
    monkeypatch.setattr(vtk, "_CHUNK", at_once)
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tets = np.array([[0, 1, 2, 3]])
    stress = np.arange(48.0).reshape(2, 4, 6)
    write_stress(
        tmp_path / "s.vtu",
        mesh=(nodes, tets),
        case_names=["lift", "brake & turn"],
        displacement=np.arange(24.0).reshape(2, 4, 3),
        stress=stress,
        von_mises=np.arange(8.0).reshape(2, 4),
    )
    mesh = pyvista.read(tmp_path / "s.vtu")
    assert mesh.n_cells == 1
    assert mesh.volume == pytest.approx(1 / 6)
    np.testing.assert_array_equal(mesh["von_mises_MPa brake & turn"], [4, 5, 6, 7])
    np.testing.assert_array_equal(mesh["stress_MPa lift"][:, 3], stress[0][:, 5])  # xy
    grid = np.stack(np.meshgrid([0.0, 1, 3], [0.0, 2], [0.0, 1], indexing="ij"), axis=-1)
    write_grid(tmp_path / "g.vtu", nodes=grid, cell_data={"size": np.array([[[1.0]], [[2.0]]])})
    mesh = pyvista.read(tmp_path / "g.vtu")
    np.testing.assert_allclose(mesh.compute_cell_sizes()["Volume"], [2, 4])
    np.testing.assert_array_equal(mesh["size"], [1, 2])
    write_struts(tmp_path / "s.vtp", bow, strut_data={"utilisation": np.array([0.1, 0.9])})
    lines = pyvista.read(tmp_path / "s.vtp")
    np.testing.assert_allclose(lines.compute_cell_sizes()["Length"], [4, 3])
    np.testing.assert_array_equal(lines["radius_mm"], bow.radii.ravel())
    np.testing.assert_array_equal(lines["utilisation"], [0.1, 0.9])
