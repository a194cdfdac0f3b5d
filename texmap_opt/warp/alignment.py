"""What turns cells along the stress: residuals in the frame of a cell's mean edges."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.effective_stiffness import EffectiveStiffness
from fea.plane_stiffness import PlaneStiffness
from fea.voigt import vector
from texmap_opt.errors import WarpError
from texmap_opt.warp.frames import rotations
from texmap_opt.warping_function.warping_function import WarpingFunction

TARGETS = ("energy", "axes")

# Share of its own size by which a compliance must differ from an isotropic one for its cells to have
# a best orientation; homogenised stiffnesses are exact to 1e-10 or so.
ANISOTROPIC = 1e-6

# Voigt components in the plane of the first two axes: xx, yy, xy.
IN_PLANE = np.array([0, 1, 5])


class AbstractAlignment(eqx.Module):
    """Half the sum of squares of residuals that turn cells.

    Attributes:
        weight: of the residuals.
    """

    weight: eqx.AbstractVar[float | Float[Array, ""]]

    @abc.abstractmethod
    def energy(
        self,
        edges: Float[Array, "samples d d"],
        f: WarpingFunction,
        points: Float[Array, "samples d"],
    ) -> Float[Array, ""]:
        """The energy of some cells.

        Args:
            edges: mean edges of each cell as rows, over the edges of a uniform cell.
            f: gives the stress.
            points: coordinates of the centres of the cells [mm].
        """


class Unaligned(AbstractAlignment):
    """Nothing turns the cells.

    Attributes:
        weight: none.
    """

    weight: float = 0.0

    def energy(
        self,
        edges: Float[Array, "samples d d"],
        f: WarpingFunction,
        points: Float[Array, "samples d"],
    ) -> Float[Array, ""]:
        """Zero."""
        return jnp.asarray(0.0)


class NoShear(AbstractAlignment):
    """Cell axes along the principal stresses: in the cell's frame the stress has no shear.

    Residuals sqrt(w) d_i.S d_j over the pairs of axes, d_i the unit mean edges and S the direction of
    the stress: blind to the sign, order and symmetry of the axes, and fading where it is isotropic.

    Attributes:
        weight: w.
        by_energy: whether places count by their stress, S its deviator, as they do in the strain
            energy, and a pair twice, for the stress has both components; then a weight means what
            it means in `EqualStretch`.
    """

    weight: Float[Array, ""]
    by_energy: bool = eqx.field(default=False, static=True)

    def energy(
        self,
        edges: Float[Array, "samples d d"],
        f: WarpingFunction,
        points: Float[Array, "samples d"],
    ) -> Float[Array, ""]:
        """See `AbstractAlignment.energy`."""
        S = f.deviator(points) if self.by_energy else f.direction(points)
        A = _in_frame(_directions(edges), S)
        pairs = [(i, j) for i in range(edges.shape[-1]) for j in range(i)]
        counted = 2.0 if self.by_energy else 1.0
        return 0.5 * self.weight * counted * jnp.sum(jnp.stack([A[i][j] ** 2 for i, j in pairs]))


class EqualStretch(AbstractAlignment):
    """Cell axes where the deviator pulls none of them: the stiffest way for Zener ratios above 1.

    Residuals sqrt(w) d_i.S d_i; an orientation that makes all three zero exists for every deviator.

    Attributes:
        weight: w.
    """

    weight: Float[Array, ""]

    def energy(
        self,
        edges: Float[Array, "samples d d"],
        f: WarpingFunction,
        points: Float[Array, "samples d"],
    ) -> Float[Array, ""]:
        """See `AbstractAlignment.energy`."""
        A = _in_frame(_directions(edges), f.deviator(points))
        diagonal = jnp.stack([A[i][i] ** 2 for i in range(edges.shape[-1])])
        return 0.5 * self.weight * jnp.sum(diagonal)


class LeastEnergy(AbstractAlignment):
    """The orientation of least strain energy sigma:S:sigma for any compliance S, by stress.

    In the frame nearest to the cell's edges (`rotations`). Of S only what turning changes is kept:
    its isotropic part is replaced by the least that keeps the energy from being negative, and the
    rest is scaled so that for a cubic cell the weight means what it means in the other two.

    Attributes:
        weight: w.
        compliance: scaled, of the cell's own axes; Voigt, in two dimensions xx, yy, xy.
    """

    weight: Float[Array, ""]
    compliance: Float[Array, "_ _"]

    def energy(
        self,
        edges: Float[Array, "samples d d"],
        f: WarpingFunction,
        points: Float[Array, "samples d"],
    ) -> Float[Array, ""]:
        """See `AbstractAlignment.energy`."""
        d = edges.shape[-1]
        frame = rotations(edges)
        stress = f.stress(points)[..., :d, :d]
        turned = jnp.einsum("sia,csab,sjb->csij", frame, stress, frame)
        if d == 3:
            pull = vector(turned)
        else:
            pull = jnp.stack([turned[..., 0, 0], turned[..., 1, 1], turned[..., 0, 1]], axis=-1)
        energies = jnp.einsum("csv,vw,csw->cs", pull, self.compliance, pull)
        return 0.5 * self.weight * jnp.sum(energies)


def alignment_for(
    target: str,
    stiffness: EffectiveStiffness | PlaneStiffness | None,
    weight: float | Float[Array, ""],
    *,
    dimensions: int = 3,
) -> AbstractAlignment:
    """What turns the cells of a lattice.

    The energy of a cubic cell is a constant plus 1/2 (s11 - s12 - s44/2) sum of sigma_ii² in its
    frame: axes along the principal stresses are its stiffest orientation where the Zener ratio is
    below 1 (`NoShear`), and its softest where it is above (`EqualStretch`). Places count by their
    stress: those that hardly carry must not drag the others off their best direction.

    Args:
        target: "axes": cell axes along the principal stresses; "energy": the orientation in which
            the cell is stiffest.
        stiffness: of the lattice in the cell's axes; needed for "energy". In two dimensions that of a
            plane, or of space.
        weight: of the residuals; 0: nothing turns the cells.
        dimensions: 2 for cells that are extruded; then the compliance in the plane counts.

    Raises:
        WarpError: unknown target, negative weight, or "energy" without a stiffness.
    """
    if target not in TARGETS:
        raise WarpError(f'The alignment\'s target is "{target}"; give {" or ".join(TARGETS)}.')
    if isinstance(weight, float | int):
        if weight < 0:
            raise WarpError(f"The alignment's weight is {weight:g}; it must be at least 0.")
        if weight == 0:
            return Unaligned()
    w = jnp.asarray(weight, dtype=jnp.float64)
    if target == "axes":
        return NoShear(w)
    if stiffness is None:
        raise WarpError('The alignment\'s target "energy" needs the stiffness of the unit cell.')
    turning = _turning_part(turned_compliance(stiffness, dimensions))
    if turning is None:
        return Unaligned()
    if isinstance(stiffness, EffectiveStiffness) and dimensions == 3 and stiffness.is_cubic:
        return EqualStretch(w) if stiffness.zener_ratio > 1 else NoShear(w, by_energy=True)
    return LeastEnergy(w, jnp.asarray(turning))


def turned_compliance(
    stiffness: EffectiveStiffness | PlaneStiffness, dimensions: int
) -> Float[np.ndarray, "_ _"]:
    """The compliance that turning a cell turns: all of it, in two dimensions what is in the plane."""
    S = stiffness.compliance
    of_space = isinstance(stiffness, EffectiveStiffness)
    return S[np.ix_(IN_PLANE, IN_PLANE)] if of_space and dimensions == 2 else S


def _turning_part(S: Float[np.ndarray, "_ _"]) -> Float[np.ndarray, "_ _"] | None:
    """What of a compliance turning changes, scaled, with the least isotropic part that it needs.

    In Mandel's notation, where turning is a rotation of 6-vectors, the compliance minus its mean
    over all orientations is scaled so that for a cubic cell s11 - s12 - s44/2 becomes 1 in size, and
    raised by its lowest eigenvalue. None where turning changes nothing.
    """
    normal = 3 if len(S) == 6 else 2
    mandel = np.where(np.arange(len(S)) < normal, 1.0, np.sqrt(2.0))
    M = S / np.outer(mandel, mandel)
    # The mean over all orientations keeps the trace, and what a pressure does to the volume.
    pressure = np.where(np.arange(len(S)) < normal, 1.0, 0.0) / np.sqrt(normal)
    P = np.outer(pressure, pressure)
    volumetric = pressure @ M @ pressure
    deviatoric = (np.trace(M) - volumetric) / (len(S) - 1)
    A = M - volumetric * P - deviatoric * (np.eye(len(S)) - P)
    # The norm of A for a cubic (3-D) or square (2-D) cell with |s11 - s12 - s44/2| = 1.
    unit = np.sqrt(1.2) if normal == 3 else np.sqrt(0.5)
    size = float(np.linalg.norm(A)) / unit
    if size < ANISOTROPIC * np.linalg.norm(M):
        return None
    A = A / size - np.linalg.eigvalsh(A / size)[0] * np.eye(len(S))
    return A * np.outer(mandel, mandel)


def _directions(edges: Float[Array, "samples d d"]) -> Float[Array, "samples d d"]:
    """Unit vectors along the edges, as rows."""
    return edges / jnp.sqrt(jnp.sum(edges**2, axis=-1))[..., None]


def _in_frame(
    d: Float[Array, "samples d d"], S: Float[Array, "cases samples d d"]
) -> list[list[Float[Array, "cases samples"]]]:
    """Components d_i.S d_j."""
    pulled = [jnp.einsum("csab,sb->csa", S, d[:, j]) for j in range(d.shape[-1])]
    return [
        [jnp.einsum("sa,csa->cs", d[:, i], pulled_j) for pulled_j in pulled]
        for i in range(d.shape[-1])
    ]
