"""Periodic solids: homogeneous, laminates, a void, mirror planes; bad input."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fea.effective_stiffness import EffectiveStiffness
from fea.errors import FeaError
from fea.homogenise_solid import homogenise_mirrored, homogenise_solid
from fea.linear_solve import SingularStiffness
from fea.materials import Material, Orthotropic
from fea.stiffness_bounds import hashin_shtrikman_bound
from fea.tet_mesh import TetMesh
from fea.voigt import turned_stiffness

SOFT = Material(1.0, 0.3, 1e-9)
STIFF = Material(20.0, 0.2, 1e-9)
SKEW = Orthotropic(
    (12.0, 3.0, 5.0),
    (0.35, 0.4, 0.45),
    (2.0, 3.0, 4.0),
    1e-9,
    axes=Rotation.from_euler("xyz", [0.3, -0.5, 0.2]).as_matrix(),
)
SIZE = (2.0, 1.0, 1.5)


def jittered(cells=(3, 2, 2), *, quadratic: bool = False) -> TetMesh:
    """A block whose inner nodes are moved; opposite faces match."""
    mesh = TetMesh.box(SIZE, cells)
    x = mesh.nodes.copy()
    inside = ((x > 1e-9) & (x < np.array(SIZE) - 1e-9)).all(axis=1)
    x[inside] += np.random.default_rng(0).uniform(-0.1, 0.1, (int(inside.sum()), 3))
    moved = mesh.with_nodes(x)
    return moved.to_tet10() if quadratic else moved


def sheared(mesh: TetMesh, periods: np.ndarray) -> TetMesh:
    """The block between other period vectors."""
    return TetMesh(mesh.nodes / np.array(SIZE) @ periods, mesh.tets)


def layers(mesh: TetMesh, axis: int, share: float = 0.5) -> np.ndarray:
    """1 above the given share of the block's height, else 0."""
    middle = mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, axis]
    return (middle > share * SIZE[axis]).astype(int)


@pytest.mark.parametrize("material", [SOFT, SKEW], ids=["isotropic", "skew orthotropic"])
@pytest.mark.parametrize("quadratic", [False, True], ids=["tet4", "tet10"])
@pytest.mark.parametrize("cells", [(1, 1, 1), (3, 2, 2)])
def test_a_homogeneous_block_has_the_stiffness_of_its_material(material, quadratic, cells):
    """Also where a cell spans the period, so that its nodes are images of each other."""
    found = homogenise_solid(jittered(cells, quadratic=quadratic), np.diag(SIZE), material)
    C = material.stiffness
    np.testing.assert_allclose(found.C, C, atol=1e-12 * np.abs(C).max())
    np.testing.assert_allclose(found.density, 1, rtol=1e-12)


def test_periods_may_be_oblique():
    periods = np.array([[2.0, 0.3, 0.0], [-0.2, 1.0, 0.4], [0.1, 0.0, 1.5]])
    mesh = sheared(jittered(), periods)
    found = homogenise_solid(mesh, periods, SKEW)
    np.testing.assert_allclose(found.C, SKEW.stiffness, atol=1e-11)


def laminate(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """Exact stiffness of two materials in layers across z, the second's share given.

    Tractions across the layers and strains along them are common to both (Backus, J. Geophys. Res.
    67 (1962) 4427; Milton, The Theory of Composites (2002), chapter 9).
    """
    across, along = [2, 3, 4], [0, 1, 5]
    mean = {}
    for name in ("inverse", "coupled", "rest"):
        mean[name] = np.zeros((3, 3))
    for C, part in ((first, 1 - share), (second, share)):
        A, B, D = (
            C[np.ix_(across, across)],
            C[np.ix_(across, along)],
            C[np.ix_(along, along)],
        )
        mean["inverse"] += part * np.linalg.inv(A)
        mean["coupled"] += part * np.linalg.inv(A) @ B
        mean["rest"] += part * (D - B.T @ np.linalg.inv(A) @ B)
    C = np.zeros((6, 6))
    A = np.linalg.inv(mean["inverse"])
    C[np.ix_(across, across)] = A
    C[np.ix_(across, along)] = A @ mean["coupled"]
    C[np.ix_(along, across)] = (A @ mean["coupled"]).T
    C[np.ix_(along, along)] = mean["rest"] + mean["coupled"].T @ A @ mean["coupled"]
    return C


@pytest.mark.parametrize("second", [STIFF, SKEW], ids=["isotropic", "skew orthotropic"])
def test_a_laminate_is_that_of_backus(second):
    """Strains are constant in each layer, so linear tetrahedra are exact."""
    mesh = TetMesh.box(SIZE, (1, 2, 4))
    found = homogenise_solid(mesh, np.diag(SIZE), [SOFT, second], material_of=layers(mesh, 2, 0.75))
    expected = laminate(SOFT.stiffness, second.stiffness, 0.25)
    np.testing.assert_allclose(found.C, expected, atol=1e-11 * np.abs(expected).max())
    # The order of the materials is told apart.
    other = laminate(SOFT.stiffness, second.stiffness, 0.75)
    assert np.abs(found.C - other).max() > 0.1


def test_a_laminate_turns_with_its_layers():
    mesh = TetMesh.box(SIZE, (4, 1, 1))
    found = homogenise_solid(mesh, np.diag(SIZE), [SOFT, STIFF], material_of=layers(mesh, 0))
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # z to x
    expected = turned_stiffness(laminate(SOFT.stiffness, STIFF.stiffness, 0.5), turn)
    np.testing.assert_allclose(found.C, expected, atol=1e-11 * np.abs(expected).max())


# A void in the middle of a cube -----------------------------------------------------------------


def eighth_with_void(void: float, divisions: int) -> TetMesh:
    """An eighth of a cube of edge 1 around a ball that holds the given share of it.

    Three blocks, from a third of the ball's octant each to a face of the cube.
    """
    radius = (3 * void / (4 * np.pi)) ** (1 / 3)
    unit = TetMesh.box((1.0, 1.0, 1.0), (divisions, divisions, 2 * divisions))
    u, v, t = unit.nodes.T
    points, tets = [], []
    for axis in range(3):
        face = np.ones((len(u), 3))
        face[:, [k for k in range(3) if k != axis]] = np.stack([u, v], axis=1)
        ball = radius * face / np.linalg.norm(face, axis=1, keepdims=True)
        outward = (t**1.5)[:, None]  # finer at the ball
        points.append((1 - outward) * ball + outward * face / 2)
        tets.append(unit.tets + axis * len(u))
    return welded(np.concatenate(points), np.concatenate(tets))


def welded(points: np.ndarray, tets: np.ndarray) -> TetMesh:
    keys = np.rint(points * 1e9).astype(np.int64)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    x, tets = points[first], number.reshape(-1)[tets]
    inverted = np.linalg.det(x[tets[:, 1:]] - x[tets[:, :1]]) < 0
    tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
    return TetMesh(x, tets)


def reflected(eighth: TetMesh) -> TetMesh:
    """The whole cell around the origin."""
    signs = np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, 8).T
    points = np.concatenate([eighth.nodes * sign for sign in signs])
    tets = np.concatenate([eighth.tets + k * len(eighth.nodes) for k in range(8)])
    return welded(points, tets)


def test_an_eighth_between_mirror_planes_is_the_whole_cell():
    eighth = eighth_with_void(0.2, 3)
    whole = reflected(eighth)
    expected = homogenise_solid(whole, np.eye(3), SOFT)
    found = homogenise_mirrored(eighth, SOFT)
    np.testing.assert_allclose(found.C, expected.C, atol=1e-12)
    np.testing.assert_allclose(found.density, expected.density, rtol=1e-12)


def test_an_eighth_of_an_orthotropic_composite_is_the_whole_cell():
    """Two materials, three different axes."""
    eighth = TetMesh.box((0.5, 0.4, 0.3), (3, 3, 3))
    middle = eighth.nodes[eighth.tets].mean(axis=1)
    of = (middle < [0.2, 0.3, 0.15]).all(axis=1).astype(int)
    whole = reflected(eighth)
    inside = np.abs(whole.nodes[whole.tets].mean(axis=1)) < [0.2, 0.3, 0.15]
    expected = homogenise_solid(
        whole,
        np.diag([1.0, 0.8, 0.6]),
        [SOFT, STIFF],
        material_of=inside.all(axis=1).astype(int),
    )
    found = homogenise_mirrored(eighth, [SOFT, STIFF], material_of=of)
    np.testing.assert_allclose(found.C, expected.C, atol=1e-12)
    assert len(set(np.round(np.diag(found.C), 6))) == 6


def test_a_dilute_ball_of_nothing_softens_as_eshelby_says():
    """Eshelby, Proc. R. Soc. A 241 (1957) 376, with Mori, Tanaka, Acta Metall. 21 (1973) 571.

    For voids in a matrix Mori and Tanaka's estimate is Hashin and Shtrikman's bound (Weng, Int. J. Eng.
    Sci. 28 (1990) 1111). What the void takes away from the moduli is compared.
    """
    found = homogenise_mirrored(eighth_with_void(0.01, 4).to_tet10(), SOFT)
    effective, bound = EffectiveStiffness(found.C), hashin_shtrikman_bound(1.0, 0.3, found.density)
    K, G = 1 / (3 * (1 - 0.6)), 1 / 2.6
    # The ball is a polyhedron, and the cubic array is no random one: 0.1 and 0.23 %, which fall to
    # 0.02 and 0.04 % with six divisions.
    np.testing.assert_allclose(K - effective.bulk_modulus, K - bound.bulk, rtol=2e-3)
    np.testing.assert_allclose(G - effective.voigt_average.shear, G - bound.shear, rtol=4e-3)
    # Nearly isotropic.
    np.testing.assert_allclose(effective.zener_ratio, 1, atol=1e-3)


def test_quadratic_displacements_soften_a_composite():
    """They contain the linear ones, and energies come down to the true ones (Bathe, section 4.3)."""
    mesh = jittered((2, 2, 2))
    middle = mesh.nodes[mesh.tets].mean(axis=1) / SIZE
    of = ((middle > 0.5).sum(axis=1) >= 2).astype(int)
    linear, quadratic = (
        homogenise_solid(each, np.diag(SIZE), [SOFT, STIFF], material_of=of).C
        for each in (mesh, mesh.to_tet10())
    )
    assert np.linalg.eigvalsh(linear - quadratic).min() > 0


def test_multigrid_and_direct_solver_agree():
    mesh = reflected(eighth_with_void(0.2, 3))
    direct = homogenise_solid(mesh, np.eye(3), SOFT, solver="superlu")
    multigrid = homogenise_solid(mesh, np.eye(3), SOFT, solver="amg")
    assert multigrid.iterations > 0
    # Energies are off by the square of the residual, 1e-8, times what the cell's condition makes of it.
    np.testing.assert_allclose(multigrid.C, direct.C, atol=1e-12)


# Mechanisms and bad input ---------------------------------------------------------------------


def kept(mesh: TetMesh, cells: np.ndarray) -> TetMesh:
    nodes, tets = np.unique(mesh.tets[cells], return_inverse=True)
    return TetMesh(mesh.nodes[nodes], tets.reshape(-1, mesh.tets.shape[1]))


def part(low, high) -> TetMesh:
    """The part of a cube of 4 x 4 x 4 blocks whose blocks lie between two corners."""
    mesh = TetMesh.box((4.0, 4.0, 4.0), (4, 4, 4))
    middle = mesh.nodes[mesh.tets].mean(axis=1)
    return kept(mesh, ((middle > low) & (middle < high)).all(axis=1))


def test_a_sheet_resists_in_its_plane_only():
    """Plane stress: E/(1 - nu^2) along the sheet, times its share of the volume."""
    found = homogenise_solid(part((0, 0, 1), (4, 4, 3)), 4 * np.eye(3), SOFT)
    np.testing.assert_allclose(found.C[0, 0], 0.5 / (1 - 0.09), rtol=1e-12)
    np.testing.assert_allclose(found.C[2:5], 0, atol=1e-12)
    with pytest.raises(FeaError, match="does not resist the strain"):
        EffectiveStiffness(found.C)


def test_a_fibre_that_turns_about_itself_is_a_mechanism():
    with pytest.raises(
        SingularStiffness, match=r"periodic solid is a mechanism: .* turn about an axis along x"
    ):
        homogenise_solid(part((0, 1, 1), (4, 3, 3)), 4 * np.eye(3), SOFT)


def test_two_sheets_that_nothing_joins_are_refused():
    mesh = TetMesh.box((4.0, 4.0, 4.0), (4, 4, 4))
    middle = mesh.nodes[mesh.tets].mean(axis=1)
    sheets = kept(mesh, (middle[:, 2] < 1) | ((middle[:, 2] > 2) & (middle[:, 2] < 3)))
    with pytest.raises(FeaError, match="solid falls into 2 parts"):
        homogenise_solid(sheets, 4 * np.eye(3), SOFT)


def test_a_facet_without_a_match_in_the_opposite_face_is_named():
    mesh = part((0, 0, 0), (4, 4, 4))
    middle = mesh.nodes[mesh.tets].mean(axis=1)
    dented = kept(mesh, ~((middle > 3) & (middle < 4)).all(axis=1))
    with pytest.raises(FeaError, match=r"not repeat with period 1: its facet at \(0, 3\."):
        homogenise_solid(dented, 4 * np.eye(3), SOFT)


def test_faces_with_other_nodes_are_named():
    mesh = jittered()
    x = mesh.nodes.copy()
    # A node in the middle of the face x = 2 slides in it.
    node = int(np.argmin(np.linalg.norm(x - [2.0, 0.5, 0.75], axis=1)))
    x[node, 1] += 0.01
    with pytest.raises(FeaError, match="does not repeat with period 1"):
        homogenise_solid(mesh.with_nodes(x), np.diag(SIZE), SOFT)
    x[node, 1] += -0.01 + 5e-6
    with pytest.raises(FeaError, match="but for 5e-06 periods"):
        homogenise_solid(mesh.with_nodes(x), np.diag(SIZE), SOFT)


def test_impossible_cells_are_named():
    mesh = jittered()
    with pytest.raises(FeaError, match="spans 2 periods along period 1"):
        homogenise_solid(mesh, np.diag([1.0, 1.0, 1.5]), SOFT)
    with pytest.raises(FeaError, match="span no volume"):
        homogenise_solid(mesh, np.diag([2.0, 1.0, 0.0]), SOFT)
    with pytest.raises(FeaError, match="say which cell is of which"):
        homogenise_solid(mesh, np.diag(SIZE), [SOFT, STIFF])
    of = np.full(len(mesh.tets), 2)
    with pytest.raises(FeaError, match="from 0 to 1"):
        homogenise_solid(mesh, np.diag(SIZE), [SOFT, STIFF], material_of=of)
    with pytest.raises(FeaError, match="not its own mirror image"):
        homogenise_mirrored(mesh, SKEW)
