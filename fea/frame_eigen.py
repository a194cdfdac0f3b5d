"""Right-hand matrices of a frame's eigenproblems K x = lambda B x, and derivatives of eigenvalues.

B is assembled on the pattern of the stiffness, from struts and, where there is a skin, triangles. With
x' B x = 1 a simple eigenvalue changes by

    dlambda = x' (dK - lambda dB) x

(Haftka, Gürdal, Elements of Structural Optimization, 3rd ed., section 7.3), and forms in x need
no matrix. With couplings x = T q, and what T changes of x works against (K - lambda B) x.
"""

import abc
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.sparse import bsr_array

from fea.adjoint import added
from fea.assembly import Pattern
from fea.beam import BLOCK, Strut, StrutMaterial
from fea.beam_eigen import geometric_pairs, geometric_work, inertia_work, mass_pairs
from fea.eigenpairs import EigenPairs, EigenResult
from fea.errors import FeaError
from fea.frame import FrameProblem, FrameSolution, element_dofs
from fea.shell import PAIRS, Triangle
from fea.shell_eigen import shell_geometric_stiffness, shell_mass
from fea.system import Assembled, times
from fea.transfer import Transfer

ArrayLike = Array | np.ndarray

# Elements computed at once where each needs much room.
AT_ONCE = 4096

# Relative distance of neighbouring eigenvalues below which they count as one. A repeated eigenvalue has
# no derivative, and of close ones the modes, hence the derivatives, lose as many digits.
REPEATED = 1e-5

# Gradients by the name of the parameter, as of `AbstractProblem.parameters`.
Gradients = dict[str, np.ndarray]


class AbstractRightHand(abc.ABC):
    """A symmetric matrix B that belongs to a frame."""

    @abc.abstractmethod
    def matrix(self, frame: FrameProblem, pattern: Pattern) -> bsr_array:
        """B without supports."""

    @abc.abstractmethod
    def gradient(
        self, frame: FrameProblem, x: Float[np.ndarray, "joints 6"]
    ) -> tuple[Gradients, Float[np.ndarray, "joints 6"]]:
        """Derivative of x' B x by the frame's parameters, by forces, and by displacements in B."""


@dataclass(frozen=True, eq=False)
class Prestress(AbstractRightHand):
    """Geometric stiffness with its sign changed, -Kg: of struts, skin and the arms of couplings.

    Attributes:
        solution: under the reference load.
        case: which of its loads that is.
    """

    solution: FrameSolution
    case: int

    @property
    def displacement(self) -> Float[np.ndarray, "joints 6"]:
        """Under the reference load."""
        return self.solution.displacement[self.case]

    @property
    def exerted(self) -> Float[np.ndarray, "joints 6"]:
        """Forces and moments that couplings and supports must carry, loads less K u."""
        loads = self.solution.problem.loads[self.case]
        return loads - times(self.solution.system.K, self.displacement[None])[0]

    @property
    def transfer(self) -> Transfer | None:
        """How couplings make joints follow others."""
        return assembled(self.solution.system.form).transfer

    @property
    def arms(self) -> Float[np.ndarray, "joints 3 3"] | None:
        """Geometric stiffness of the couplings' arms by the rotation of each joint; None without."""
        return None if self.transfer is None else self.transfer.geometric_stiffness(self.exerted)

    def matrix(self, frame: FrameProblem, pattern: Pattern) -> bsr_array:
        """See `AbstractRightHand`."""
        u = self.displacement
        struts = geometric_pairs(frame.strut_values(), frame.strut_material, _at(u, frame.struts))
        pairs = [-np.asarray(struts)]
        if frame.skin is not None:
            skin, moved = frame.skin, _at(u, frame.skin.triangles)
            triangles = _shell_geometric_pairs(frame.triangle_values(), skin.E, skin.nu, moved)
            pairs.append(-np.asarray(triangles))
        B, arms = pattern.assemble(*pairs), self.arms
        if arms is not None:
            B.data[pattern.diagonal, 3:, 3:] -= arms
        return B

    def gradient(
        self, frame: FrameProblem, x: Float[np.ndarray, "joints 6"]
    ) -> tuple[Gradients, Float[np.ndarray, "joints 6"]]:
        """See `AbstractRightHand`."""
        u = self.displacement
        fields = _at(u, frame.struts), _at(x, frame.struts)
        struts, by_u = _strut_prestress(frame.strut_values(), frame.strut_material, fields)
        moved = jnp.zeros(x.shape).at[frame.struts].add(by_u.reshape(-1, 2, BLOCK))
        triangles = None
        if frame.skin is not None:
            skin, nodes = frame.skin, frame.skin.triangles
            fields = _at(u, nodes), _at(x, nodes)
            triangles, by_u = _skin_prestress(frame.triangle_values(), skin.E, skin.nu, fields)
            moved = moved.at[nodes].add(by_u.reshape(-1, 3, BLOCK))
        by, by_u = _by_parameters(frame, struts, triangles), np.asarray(moved)
        if self.transfer is not None:
            by_points, field = self.transfer.geometric_gradient(self.exerted, x)
            fields = np.zeros_like(frame.loads)
            fields[self.case] = field
            by = added(by, {frame.positions: by_points})
            by = added(by, frame.load_gradient(fields))
            by = added(by, frame.bilinear_gradient(-field[None], u[None]))
            by_u = by_u - times(self.solution.system.K, field[None])[0]
        return {name: -value for name, value in by.items()}, -by_u


@dataclass(frozen=True, eq=False)
class Inertia(AbstractRightHand):
    """Mass of a frame.

    Attributes:
        density: of the struts [tonne/mm³]; the mass of a strut is counted from joint to joint, where
            struts overlap more than once.
        skin_density: of the skin [tonne/mm³].
        masses: further mass at each joint [tonne], without rotary inertia.
    """

    density: float
    skin_density: float | None = None
    masses: Float[np.ndarray, " joints"] | None = None

    def check(self, frame: FrameProblem) -> None:
        """Refuse masses that are none.

        Raises:
            FeaError: for densities and masses that are negative or no numbers, nothing at all, or a
                skin without density.
        """
        given = {"density": self.density, "skin_density": self.skin_density}
        for name, value in given.items():
            if value is not None and not (np.isfinite(value) and value >= 0):
                raise FeaError(
                    f"{name} = {value:g} tonne/mm³: give zero or a positive number (steel: 7.85e-9)."
                )
        if (frame.skin is None) is not (self.skin_density is None):
            word = "has no skin, but" if frame.skin is None else "has a skin, but no"
            raise FeaError(f"The frame {word} skin_density is given; give both or neither.")
        masses = self.masses
        if masses is not None:
            if masses.shape != (len(frame.joints),):
                raise FeaError(
                    f"masses has shape {masses.shape}; give {(len(frame.joints),)}, one a joint."
                )
            wrong = np.flatnonzero(~(np.isfinite(masses) & (masses >= 0)))
            if len(wrong):
                raise FeaError(
                    f"The mass at joint {wrong[0]} is {masses[wrong[0]]:g} tonne; give zero or more."
                )
        if not (self.density or self.skin_density or (masses is not None and masses.any())):
            raise FeaError("Nothing has mass: give a density above zero.")

    def matrix(self, frame: FrameProblem, pattern: Pattern) -> bsr_array:
        """See `AbstractRightHand`."""
        struts = mass_pairs(frame.strut_values(), frame.strut_material, self.density)
        pairs = [np.asarray(struts)]
        if frame.skin is not None and self.skin_density is not None:
            pairs.append(np.asarray(_shell_mass_pairs(frame.triangle_values(), self.skin_density)))
        M = pattern.assemble(*pairs)
        if self.masses is not None:
            for axis in range(3):
                M.data[pattern.diagonal, axis, axis] += self.masses
        return M

    def gradient(
        self, frame: FrameProblem, x: Float[np.ndarray, "joints 6"]
    ) -> tuple[Gradients, Float[np.ndarray, "joints 6"]]:
        """See `AbstractRightHand`."""
        moved = _at(x, frame.struts)
        struts = _strut_inertia(frame.strut_values(), frame.strut_material, self.density, moved)
        triangles = None
        if frame.skin is not None and self.skin_density is not None:
            moved = _at(x, frame.skin.triangles)
            triangles = _skin_inertia(frame.triangle_values(), self.skin_density, moved)
        return _by_parameters(frame, struts, triangles), np.zeros_like(x)


def assembled(form: object) -> Assembled:
    """The form of a stiffness that can be reduced beside another matrix.

    Raises:
        FeaError: when the stiffness was never assembled.
    """
    if not isinstance(form, Assembled):
        raise FeaError(
            'Eigenvalues need an assembled stiffness; solve with another solver than "jax-cg".'
        )
    return form


def eigenvalue_gradient(
    frame: FrameProblem,
    form: Assembled,
    right: AbstractRightHand,
    eigenvalue: float,
    x: Float[np.ndarray, "joints 6"],
) -> tuple[Gradients, Float[np.ndarray, "joints 6"]]:
    """Derivative of a simple eigenvalue by parameters, and by displacements that B depends on.

    Args:
        frame: the frame.
        form: of its stiffness.
        right: B.
        eigenvalue: lambda.
        x: its mode, x' B x = 1.
    """
    gradient = frame.bilinear_gradient(x[None], x[None])
    by, by_u = right.gradient(frame, x)
    gradient = added(gradient, {name: -eigenvalue * value for name, value in by.items()})
    if form.transfer is not None:
        K, B = frame.stiffness(form.pattern), right.matrix(frame, form.pattern)
        force = times(K, x[None]) - eigenvalue * times(B, x[None])
        gradient["joints"] = gradient["joints"] + 2 * form.transfer.gradient(force, x[None])
    return gradient, -eigenvalue * by_u


def check_simple(found: EigenPairs, mode: int, what: str) -> None:
    """Refuse to differentiate an eigenvalue that was not found or has a neighbour.

    Args:
        found: the lowest eigenvalues, the next above `mode` among them where there is one.
        mode: which one.
        what: its name in the message.

    Raises:
        FeaError: when it is missing or did not converge, or when another lies within `REPEATED`,
            relative.
    """
    values = found.values
    last = found.result is EigenResult.TOO_FEW and np.isfinite(values[mode])
    if found.result is not EigenResult.CONVERGED and not last:
        raise FeaError(found.result.value)
    gap = np.abs(values / values[mode] - 1)
    gap[mode] = np.inf
    other = int(np.nanargmin(gap))
    if gap[other] < REPEATED:
        raise FeaError(
            f"{what} {mode} = {values[mode]:.9g} and {other} = {values[other]:.9g} are one within "
            f"{REPEATED:g}: a repeated eigenvalue has no derivative; break the symmetry, or "
            "differentiate another mode."
        )


def _at(fields: Float[np.ndarray, "joints 6"], nodes: np.ndarray) -> Float[Array, "elements dofs"]:
    return jnp.asarray(element_dofs(fields[None], nodes)[0])


def _by_parameters(frame: FrameProblem, struts: Strut, triangles: Triangle | None) -> Gradients:
    """From derivatives by elements to those by the parameters that elements are made of."""
    values = {name: jnp.asarray(value) for name, value in frame.parameters.items()}
    _, pull = jax.vjp(lambda given: frame.strut_values(**given), values)
    (total,) = pull(struts)
    if triangles is not None:
        _, pull = jax.vjp(lambda given: frame.triangle_values(**given), values)
        (more,) = pull(triangles)
        total = {name: total[name] + more[name] for name in total}
    return {name: np.asarray(value) for name, value in total.items()}


@eqx.filter_jit
def _strut_prestress(
    struts: Strut,
    material: StrutMaterial,
    fields: tuple[Float[Array, "struts 12"], Float[Array, "struts 12"]],
) -> tuple[Strut, Float[Array, "struts 12"]]:
    """Derivatives of x' Kg(u) x by each strut and by its u."""
    slope = jax.grad(lambda strut, u, x: geometric_work(strut, material, u, x), argnums=(0, 1))
    return jax.lax.map(lambda given: slope(*given), (struts, *fields), batch_size=AT_ONCE)


@eqx.filter_jit
def _skin_prestress(
    triangles: Triangle,
    E: float,
    nu: float,
    fields: tuple[Float[Array, "faces 18"], Float[Array, "faces 18"]],
) -> tuple[Triangle, Float[Array, "faces 18"]]:
    """Derivatives of x' Kg(u) x by each triangle and by its u."""
    slope = jax.grad(
        lambda triangle, u, x: x @ shell_geometric_stiffness(triangle, E, nu, u) @ x,
        argnums=(0, 1),
    )
    return jax.lax.map(lambda given: slope(*given), (triangles, *fields), batch_size=AT_ONCE)


@eqx.filter_jit
def _strut_inertia(
    struts: Strut, material: StrutMaterial, density: float, x: Float[Array, "struts 12"]
) -> Strut:
    """Derivative of x' M x by each strut."""
    slope = jax.grad(lambda strut, x: inertia_work(strut, material, density, x))
    return jax.lax.map(lambda given: slope(*given), (struts, x), batch_size=AT_ONCE)


@eqx.filter_jit
def _skin_inertia(triangles: Triangle, density: float, x: Float[Array, "faces 18"]) -> Triangle:
    """Derivative of x' M x by each triangle."""
    slope = jax.grad(lambda triangle, x: x @ shell_mass(triangle, density) @ x)
    return jax.lax.map(lambda given: slope(*given), (triangles, x), batch_size=AT_ONCE)


@eqx.filter_jit
def _shell_geometric_pairs(
    triangles: Triangle, E: float, nu: float, u: Float[Array, "faces 18"]
) -> Float[Array, "faces 6 6 6"]:
    def blocks(given: tuple[Triangle, Float[Array, "18"]]) -> Float[Array, "6 6 6"]:
        triangle, u = given
        return _pairs(shell_geometric_stiffness(triangle, E, nu, u))

    return jax.lax.map(blocks, (triangles, u), batch_size=AT_ONCE)


@eqx.filter_jit
def _shell_mass_pairs(triangles: Triangle, density: float) -> Float[Array, "faces 6 6 6"]:
    return jax.lax.map(
        lambda triangle: _pairs(shell_mass(triangle, density)), triangles, batch_size=AT_ONCE
    )


def _pairs(matrix: Float[Array, "18 18"]) -> Float[Array, "6 6 6"]:
    """Blocks of a triangle's matrix in the order of assembly."""
    a, b = PAIRS
    return matrix.reshape(3, BLOCK, 3, BLOCK)[a, :, b]
