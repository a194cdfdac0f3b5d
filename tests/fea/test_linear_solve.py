import jax
import numpy as np
import pytest
from jax.tree_util import Partial
from scipy.sparse import bsr_array, csr_array

from fea import FeaError, SolveResult, Support, TetMesh, factorise, material, rigid_body_modes
from fea.linear_solve import ElementOperator, SingularStiffness, cg_jax, choice, mkl_sparse
from fea.linear_solve.direct_pardiso import is_installed
from fea.solid import SolidProblem
from fea.system import Assembled

needs_mkl = pytest.mark.skipif(not is_installed(), reason="pypardiso not installed")
PARDISO = pytest.param("pardiso", marks=needs_mkl)
SOLVERS = [PARDISO, "superlu", "amg", "jax-cg"]
ITERATIVE = ["amg", "jax-cg"]


def solid(supports, *, size=(40.0, 10.0, 10.0), cells=(8, 2, 2), tet10=True):
    """A box of tetrahedra: reduced stiffness and rigid-body modes."""
    mesh = TetMesh.box(size, cells)
    return reduced(mesh.to_tet10() if tet10 else mesh, supports)


def reduced(mesh, supports):
    forces = np.zeros((1, *mesh.nodes.shape))
    problem = SolidProblem.from_supports(mesh, material("steel"), supports(mesh), forces)
    form = Assembled.of(problem)
    modes = rigid_body_modes(mesh.nodes).reshape(-1, 3, 6)
    return form.stiffness(problem)[1], form.restrict(np.moveaxis(modes, -1, 0))


def clamped(mesh):
    return [Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))]


def rollers(mesh):
    """Held along x only: five rigid motions are free, nodes are partly fixed."""
    return [
        Support(
            np.flatnonzero(mesh.nodes[:, 0] < 1e-9), np.array([True, False, False]), np.zeros(3)
        )
    ]


def pin_at_one_node(mesh):
    """One corner held: three rotations are free."""
    return [Support.clamp(np.array([int(np.argmin(mesh.nodes.sum(axis=1)))]))]


def with_values(K, data):
    return bsr_array((data, K.indices, K.indptr), K.shape)


def scaled_rows_and_columns(K, scale):
    """D K D of a diagonal D."""
    nodes = scale.reshape(-1, K.blocksize[0])
    row = np.repeat(np.arange(len(nodes)), np.diff(K.indptr))
    return with_values(K, K.data * nodes[row][:, :, None] * nodes[K.indices][:, None, :])


def hinge():
    """Two boxes that share the nodes of one edge; the first is clamped, the second swings.

    Reduced stiffness and the rigid-body modes of the whole, none of which is free.
    """
    box = TetMesh.box((10.0, 4.0, 4.0), (5, 2, 2))
    edge = np.flatnonzero((box.nodes[:, 0] > 9.9) & (box.nodes[:, 2] > 3.9))
    other = box.nodes + np.array([10.0, 0.0, 4.0])
    number = len(box.nodes) + np.arange(len(box.nodes))
    for node in edge:
        number[np.linalg.norm(other - box.nodes[node], axis=1) < 1e-9] = node
    used, tets = np.unique(np.concatenate([box.tets, number[box.tets]]), return_inverse=True)
    nodes = np.concatenate([box.nodes, other])[used]
    return reduced(TetMesh(nodes, tets.reshape(-1, 4)), clamped)


@pytest.fixture(scope="module")
def system():
    return solid(clamped)


@pytest.fixture(scope="module")
def free_system():
    return solid(rollers)


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_finds_the_solution(system, solver):
    K, modes = system
    expected = np.random.default_rng(0).normal(size=(K.shape[0], 3))
    factor = factorise(K, near_null=modes, solver=solver)
    solution = factor.solve(K @ expected)
    assert factor.name == solver
    assert solution.result is SolveResult.CONVERGED
    assert solution.residual <= 1e-10
    # Condition number 1e5 times the residual.
    np.testing.assert_allclose(solution.x, expected, atol=1e-5)
    one = factor.solve(K @ expected[:, 0])
    np.testing.assert_allclose(one.x, solution.x[:, 0], atol=1e-9)
    factor.free()


@pytest.mark.parametrize("solver", SOLVERS)
def test_blocks_or_single_entries_make_no_difference(system, solver):
    K, modes = system
    b = np.random.default_rng(5).normal(size=K.shape[0])
    whole = factorise(K, near_null=modes, solver=solver).solve(b).x
    single = factorise(K.tocsr(), near_null=modes, solver=solver).solve(b).x
    np.testing.assert_allclose(single, whole, atol=1e-6 * abs(whole).max())


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_factor_follows_new_values_on_its_pattern(system, solver):
    """Stiffness doubled, then made very uneven: kept or rebuilt, the answer is right."""
    K, modes = system
    rng = np.random.default_rng(1)
    b = rng.normal(size=K.shape[0])
    factor = factorise(K, near_null=modes, solver=solver)
    first = factor.solve(b)
    factor = factor.update(with_values(K, 2 * K.data))
    np.testing.assert_allclose(2 * factor.solve(b).x, first.x, atol=1e-6 * abs(first.x).max())
    factor = factor.update(scaled_rows_and_columns(K, 10 ** rng.uniform(-2, 2, K.shape[0])))
    assert factor.solve(b, throw=False).residual < 1e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_two_factors_do_not_disturb_each_other(system, solver):
    """The `spsolve` of pypardiso shares one solver; a factor here stays valid beside others."""
    K, modes = system
    b = np.random.default_rng(2).normal(size=K.shape[0])
    one = factorise(K, near_null=modes, solver=solver)
    before = one.solve(b).x
    two = factorise(with_values(K, 3 * K.data), near_null=modes, solver=solver)
    np.testing.assert_allclose(3 * two.solve(b).x, before, atol=1e-7 * abs(before).max())
    two.free()
    np.testing.assert_array_equal(one.solve(b).x, before)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("supports", [rollers, pin_at_one_node])
def test_a_solid_that_can_move_is_singular_and_its_motion_is_named(solver, supports):
    K, modes = solid(supports)
    for known in (modes, None):
        if known is None and solver in ITERATIVE:
            continue
        with pytest.raises(SingularStiffness, match="Stiffness is singular") as failure:
            factorise(K, near_null=known, solver=solver)
        motion = failure.value.mode
        assert np.abs(motion).max() == 1
        # No force is needed to hold it, measured against the force on one node moved alone.
        assert np.abs(K @ motion).max() < 1e-9 * K.diagonal().max()


@pytest.mark.parametrize("solver", [PARDISO, "superlu"])
@pytest.mark.parametrize("supports", [rollers, pin_at_one_node])
def test_pivots_that_rounding_made_positive_hide_no_free_motion(solver, supports):
    """Here the factorisation itself ends well."""
    K, _ = solid(supports, cells=(40, 1, 1))
    with pytest.raises(SingularStiffness):
        factorise(K, solver=solver)


@pytest.mark.parametrize("solver", [PARDISO, "superlu", "amg"])
def test_a_hinge_is_found_though_no_rigid_motion_is_free(solver):
    """A load that does no work on the swing would be solved, and the answer mean nothing."""
    K, modes = hinge()
    with pytest.raises(SingularStiffness) as failure:
        factorise(K, near_null=modes, solver=solver)
    motion = failure.value.mode
    assert np.abs(K @ motion).max() < 1e-7 * K.diagonal().max()


@pytest.mark.parametrize("solver", [PARDISO, "superlu"])
def test_a_slender_clamped_bar_is_not_singular(solver):
    """1000 times as long as thick: soft, with a smallest eigenvalue near rounding, but held."""
    K, modes = solid(clamped, size=(1000.0, 1.0, 1.0), cells=(40, 1, 1))
    factor = factorise(K, near_null=modes, solver=solver)
    assert factor.name == solver


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_dof_without_stiffness_is_singular(solver):
    K = csr_array((np.array([1.0, 0.0, 2.0]), np.arange(3), np.arange(4)), (3, 3))
    with pytest.raises(SingularStiffness, match="singular") as failure:
        factorise(K, solver=solver)
    np.testing.assert_array_equal(failure.value.mode, [0, 1, 0])


@pytest.mark.parametrize("solver", SOLVERS)
def test_stiffness_that_is_not_a_number_is_refused(solver):
    K = csr_array((np.array([1.0, np.nan]), np.arange(2), np.arange(3)), (2, 2))
    with pytest.raises(FeaError, match="NaN"):
        factorise(K, solver=solver)


def test_single_precision_and_wrong_sizes_are_refused(system):
    K, modes = system
    with pytest.raises(FeaError, match="stiffness matrix are float32"):
        factorise(with_values(K, K.data.astype(np.float32)), near_null=modes)
    factor = factorise(K, near_null=modes)
    with pytest.raises(FeaError, match="Loads are float32"):
        factor.solve(np.ones(K.shape[0], np.float32))
    with pytest.raises(FeaError, match="shape \\(3,\\)"):
        factor.solve(np.ones(3))
    with pytest.raises(FeaError, match="factorise it afresh"):
        factor.update(bsr_array(np.eye(6), blocksize=(3, 3)))
    with pytest.raises(FeaError, match="square matrix"):
        factorise(bsr_array(np.ones((3, 6)), blocksize=(3, 3)))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_fully_supported_model_has_nothing_to_solve(solver):
    K = csr_array((0, 0))
    assert factorise(K, solver=solver).solve(np.zeros((0, 2))).x.shape == (0, 2)


@pytest.mark.parametrize("solver", SOLVERS)
def test_nodes_that_are_not_coupled_are_solved_each_for_itself(solver):
    """No aggregates can be made of them; they are more than the coarsest level holds."""
    stiffness = np.arange(1.0, 301.0)
    K = csr_array((stiffness, np.arange(300), np.arange(301)), (300, 300))
    np.testing.assert_allclose(factorise(K, solver=solver).solve(stiffness).x, 1.0)


@pytest.mark.parametrize("solver", ITERATIVE)
def test_iterations_start_from_a_given_solution_and_repeat_themselves(system, solver):
    K, modes = system
    b = np.random.default_rng(3).normal(size=K.shape[0])
    cold = factorise(K, near_null=modes, solver=solver).solve(b)
    factor = factorise(K, near_null=modes, solver=solver)
    np.testing.assert_array_equal(factor.solve(b).x, cold.x)
    # A guess for a structure half as stiff is scaled to fit.
    warm = factor.solve(b, x0=2 * cold.x)
    assert warm.iterations <= 1 < cold.iterations


@pytest.mark.parametrize("solver", ITERATIVE)
def test_a_load_of_zero_takes_no_iteration(system, solver):
    K, modes = system
    solution = factorise(K, near_null=modes, solver=solver).solve(np.zeros(K.shape[0]))
    assert not solution.x.any()
    assert solution.iterations == 0


def test_multigrid_leaves_the_global_generator_alone(system):
    K, modes = system
    before = np.random.get_state()[1].copy()  # noqa: NPY002 - the state that must not change
    factorise(K, near_null=modes, solver="amg").solve(np.ones(K.shape[0]))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


@pytest.mark.parametrize("solver", ITERATIVE)
def test_an_indefinite_matrix_ends_as_singular(solver):
    """Entries that no stiffness has: the diagonal is positive, an eigenvalue is not."""
    K = csr_array(np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(SingularStiffness):
        factorise(K, solver=solver).solve(np.array([1.0, -1.0]))


def test_unknown_missing_and_unfit_solvers_are_refused(system, monkeypatch):
    with pytest.raises(FeaError, match="choose one of"):
        choice.chosen(10, "lu", block=3, has_modes=True)
    operator = cg_jax.assembled_operator(system[0])
    with pytest.raises(FeaError, match="needs an assembled matrix"):
        factorise(operator, solver="amg")
    monkeypatch.setattr(choice, "is_installed", lambda: False)
    with pytest.raises(FeaError, match="install pypardiso"):
        choice.chosen(10, "pardiso", block=3, has_modes=True)
    assert choice.chosen(10, "auto", block=3, has_modes=True) == "superlu"


def test_an_operator_that_is_never_assembled_is_solved_like_a_matrix(system):
    K, modes = system
    operator = cg_jax.assembled_operator(K)
    x = np.random.default_rng(6).normal(size=(K.shape[0], 2))
    np.testing.assert_allclose(operator @ x, K @ x, rtol=1e-12, atol=1e-9 * K.diagonal().max())
    factor = factorise(operator, near_null=modes)
    assert factor.name == "jax-cg"
    solution = factor.solve(K @ x)
    assert solution.residual <= 1e-10
    np.testing.assert_allclose(solution.x, x, atol=1e-5)


def test_an_operator_with_free_motion_is_singular(free_system):
    K, modes = free_system
    with pytest.raises(SingularStiffness):
        factorise(cg_jax.assembled_operator(K), near_null=modes)
    nothing = ElementOperator(
        Partial(lambda scale, x: scale * x, jax.numpy.asarray(np.nan)),
        jax.numpy.asarray(np.tile(np.eye(3), (2, 1, 1))),
    )
    with pytest.raises(FeaError, match="NaN"):
        factorise(nothing)


def test_new_values_do_not_compile_the_jax_solver_again():
    traced = []

    def product(scale, x):
        traced.append(x.shape)
        return scale * x

    def operator(scale):
        values = jax.numpy.asarray(scale)
        blocks = jax.numpy.asarray(np.tile(scale * np.eye(3), (5, 1, 1)))
        return ElementOperator(Partial(product, values), blocks)

    factor = factorise(operator(2.0))
    np.testing.assert_allclose(factor.solve(np.ones(15)).x, 0.5)
    assert traced
    traced.clear()
    np.testing.assert_allclose(factor.update(operator(4.0)).solve(np.full(15, 3.0)).x, 0.75)
    assert not traced


@needs_mkl
@pytest.mark.parametrize("blocks", [(1, 1), (2, 2), (3, 3), (6, 6), (3, 6), (4, 6)])
def test_threaded_products_are_those_of_scipy(blocks):
    rng = np.random.default_rng(7)
    rows, columns = blocks
    graph = csr_array(rng.random((40, 30)) * (rng.random((40, 30)) < 0.2))
    data = rng.normal(size=(graph.nnz, rows, columns))
    A = bsr_array((data, graph.indices, graph.indptr), (40 * rows, 30 * columns))
    x, y = rng.normal(size=A.shape[1]), rng.normal(size=A.shape[0])
    threaded = mkl_sparse.ThreadedMatrix(A)
    scale = abs(A) @ abs(x)
    assert (abs(threaded.times(x) - A @ x) <= 1e-15 * scale).all()
    into = y.copy()
    threaded.times(x, into, alpha=-2.0, beta=0.5)
    assert (abs(into - (0.5 * y - 2 * (A @ x))) <= 4e-15 * (scale + abs(y))).all()


@pytest.mark.parametrize("library", [pytest.param("mkl", marks=needs_mkl), "scipy"])
def test_products_of_matrices_and_changes_of_blocks_keep_every_entry(library, monkeypatch):
    if library == "scipy":
        monkeypatch.setattr(mkl_sparse, "mkl_library", lambda: None)
    rng = np.random.default_rng(8)
    dense = [rng.normal(size=shape) for shape in [(12, 18), (18, 6)]]
    dense[0][:3, :3] = 0
    A, B = (bsr_array(matrix, blocksize=(3, 3)) for matrix in dense)
    product = mkl_sparse.multiply(A, B)
    assert product.has_sorted_indices
    np.testing.assert_allclose(product.toarray(), dense[0] @ dense[1], atol=1e-13)
    wide = bsr_array(dense[1], blocksize=(3, 6))
    small = mkl_sparse.in_blocks(wide, 3)
    assert small.blocksize == (3, 3)
    np.testing.assert_array_equal(small.toarray(), dense[1])
    square = bsr_array(dense[1] @ dense[1].T, blocksize=(3, 3))
    large = mkl_sparse.merged_blocks(square, 6)
    assert large.blocksize == (6, 6)
    np.testing.assert_array_equal(large.toarray(), square.toarray())


def test_multigrid_without_mkl_gives_the_same_answer(system, monkeypatch):
    K, modes = system
    b = np.random.default_rng(9).normal(size=K.shape[0])
    threaded = factorise(K, near_null=modes, solver="amg").solve(b)
    monkeypatch.setattr(mkl_sparse, "mkl_library", lambda: None)
    plain = factorise(K, near_null=modes, solver="amg").solve(b)
    np.testing.assert_allclose(plain.x, threaded.x, atol=1e-7 * abs(threaded.x).max())
    assert plain.iterations == threaded.iterations


def test_auto_takes_the_direct_solver_for_small_and_multigrid_for_large_models(monkeypatch):
    monkeypatch.setattr(choice, "is_installed", lambda: True)
    for dofs, block, name in [
        (1_000, 3, "pardiso"),
        (25_000, 3, "pardiso"),
        (40_000, 3, "amg"),
        (40_000, 6, "pardiso"),
        (60_000, 6, "amg"),
    ]:
        assert choice.chosen(dofs, "auto", block=block, has_modes=True) == name
    # Without rigid-body modes multigrid is too slow to be chosen.
    assert choice.chosen(150_000, "auto", block=3, has_modes=False) == "pardiso"
