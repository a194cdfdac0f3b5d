"""From regions of a case to supports and nodal forces of the solid analysis."""

from pathlib import Path

import numpy as np
import pytest
from sound_case import case_of

import fea
from texmap_opt.errors import CaseError
from texmap_opt.stress_field import StressField, selected_facets, selected_nodes, stress_field

# The sound case's box, 40 x 20 x 20 mm.
MESH = fea.TetMesh.box((40.0, 20.0, 20.0), (8, 4, 4))


def test_a_force_acts_with_its_full_size_and_the_supports_answer(tmp_path: Path):
    stress = stress_field(case_of(tmp_path), MESH)
    np.testing.assert_allclose(stress.load_forces[0].sum(axis=0), [0, 0, -10], atol=1e-12)
    np.testing.assert_allclose(stress.reaction[0], [0, 0, 10], atol=1e-7)
    assert stress.max_displacement > 0
    assert stress.residual < 1e-8
    assert 0 < stress.estimated_error < 0.5


@pytest.mark.parametrize(
    ("action", "resultant"),
    [
        ("pressure_MPa = 0.5", [-200, 0, 0]),
        ("traction_MPa = [0, 0.5, 0]", [0, 200, 0]),
        ("moment_Nmm = [100, 0, 0]", [0, 0, 0]),
    ],
)
def test_surface_actions_have_their_resultant(tmp_path: Path, action: str, resultant: list[float]):
    """On the end face of 400 mm²; pressure pushes inwards."""
    stress = stress_field(case_of(tmp_path, ("force_N = [0, 0, -10]", action)), MESH)
    np.testing.assert_allclose(stress.load_forces[0].sum(axis=0), resultant, atol=1e-9)


def test_a_moment_acts_with_its_full_size(tmp_path: Path):
    stress = stress_field(
        case_of(tmp_path, ("force_N = [0, 0, -10]", "moment_Nmm = [100, 30, -20]")), MESH
    )
    moment = np.cross(MESH.nodes, stress.load_forces[0]).sum(axis=0)
    np.testing.assert_allclose(moment, [100, 30, -20], rtol=1e-9)


def test_gravity_weighs_the_whole_part(tmp_path: Path):
    """Weight is density x volume x g: 16000 mm³ at the table's density."""
    action = '[[load]]\ncase = "own"\ngravity_m_s2 = [0, 0, -9.81]\n[lattice]'
    case = case_of(tmp_path, ("[lattice]", action))
    stress = stress_field(case, MESH)
    weight = case.material.density * 16000 * 9810
    np.testing.assert_allclose(stress.load_forces[1].sum(axis=0), [0, 0, -weight], rtol=1e-9)
    assert stress.case_names == ("load", "own")


def test_cases_superpose(tmp_path: Path):
    """Two loads in one case give the sum of their solutions in two cases."""
    second = '[[load]]\ncase = "{}"\nregion = {{ plane = {{ point = [0, 0, 20], normal = [0, 0, 1] }} }}\n'
    second += "pressure_MPa = 0.1\n[lattice]"
    apart = stress_field(case_of(tmp_path, ("[lattice]", second.format("other"))), MESH)
    together = stress_field(case_of(tmp_path, ("[lattice]", second.format("load"))), MESH)
    np.testing.assert_allclose(together.displacement[0], apart.displacement.sum(axis=0), atol=1e-12)


def test_a_prescribed_displacement_strains_the_part(tmp_path: Path):
    pulled = (
        "[[load]]",
        "[[support]]\nregion = { plane = { point = [40, 0, 0], normal = [1, 0, 0] } }\n"
        'fix = ["x"]\nvalue_mm = [0.4, 0, 0]\n[[load]]',
    )
    stress = stress_field(case_of(tmp_path, pulled), MESH)
    end = MESH.nodes[:, 0] == 40
    np.testing.assert_allclose(stress.displacement[0, end, 0], 0.4, atol=1e-12)
    np.testing.assert_allclose(stress.reaction[0, 2], 10, rtol=1e-6)


def test_a_region_of_the_surface_is_its_facets_and_nodes(tmp_path: Path):
    region = case_of(tmp_path).loads[0].region
    assert region is not None
    facets = selected_facets(MESH, region)
    assert MESH.facet_areas[facets].sum() == pytest.approx(400)
    assert len(selected_nodes(MESH, region)) == 25


def test_a_case_that_loads_only_held_nodes_is_refused(tmp_path: Path):
    case = case_of(tmp_path, ("point = [40, 0, 0]", "point = [0, 0, 0]"))
    with pytest.raises(CaseError, match="held"):
        stress_field(case, MESH)


def test_arrays_for_the_cache_rebuild_the_field(tmp_path: Path):
    stress = stress_field(case_of(tmp_path), MESH)
    again = StressField.from_arrays(MESH, stress.to_arrays())
    assert again.case_names == stress.case_names
    assert again.residual == stress.residual
    assert again.estimated_error == stress.estimated_error
    np.testing.assert_array_equal(again.von_mises, stress.von_mises)
