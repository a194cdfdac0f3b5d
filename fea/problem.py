"""What a linear structure is: elements, supports and loads, and what it depends on."""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array

from fea.assembly import Pattern
from fea.couplings import AbstractCoupling
from fea.linear_solve.element_operator import ElementOperator


class AbstractProblem(abc.ABC):
    """A linear structure, its supports and its loads.

    A leaf is a frozen dataclass with, beside its parameters, the fields

    * `fixed: Bool[nodes, block]`: which dofs are prescribed,
    * `value: Float[nodes, block]`: their values, ignored on free dofs,
    * `forces: Float[cases, nodes, block]`: what acts on each dof.

    Attributes:
        positions: name of the parameter that holds `points`.
        couplings: what makes nodes follow others; structures of six dofs a node only.
    """

    positions: ClassVar[str]
    couplings: tuple[AbstractCoupling, ...] = ()

    fixed: Bool[np.ndarray, "nodes block"]
    value: Float[np.ndarray, "nodes block"]
    forces: Float[np.ndarray, "cases nodes block"]

    @property
    @abc.abstractmethod
    def proves_definite(self) -> bool:
        """Whether `check` shows that no motion is free, so that the solver need not look for one."""

    @property
    @abc.abstractmethod
    def points(self) -> Float[np.ndarray, "nodes 3"]:
        """Positions of the nodes [mm]."""

    @property
    @abc.abstractmethod
    def groups(self) -> tuple[Int[np.ndarray, "_ _"], ...]:
        """Nodes of each element, group by group; all elements of a group have equally many."""

    @property
    @abc.abstractmethod
    def loads(self) -> Float[np.ndarray, "cases nodes block"]:
        """All that acts on the nodes: `forces`, and the consistent forces of other loads."""

    @property
    @abc.abstractmethod
    def parameters(self) -> dict[str, np.ndarray]:
        """What the stiffness depends on and can be differentiated by, by name."""

    @abc.abstractmethod
    def with_parameters(self, values: Mapping[str, np.ndarray]) -> "AbstractProblem":
        """The same problem with some parameters, `forces` or `value` replaced."""

    @abc.abstractmethod
    def check(self) -> None:
        """Refuse what cannot be solved, by name.

        Raises:
            FeaError: with what is wrong, where, and the remedy.
        """

    @abc.abstractmethod
    def stiffness(self, pattern: Pattern) -> bsr_array:
        """K of the structure without its supports, in whole blocks of a node's dofs."""

    @abc.abstractmethod
    def operator(self, fixed: Bool[np.ndarray, "nodes block"]) -> ElementOperator:
        """K as a rule for products that is never assembled; fixed dofs act as identity."""

    @abc.abstractmethod
    def solved(self, *, previous: Any = None, solver: str = "auto") -> Any:
        """The solution, an `fea.equilibrium.AbstractSolution`, by `fea.equilibrium.equilibrium`."""

    @abc.abstractmethod
    def bilinear_gradient(
        self,
        v: Float[np.ndarray, "cases nodes block"],
        u: Float[np.ndarray, "cases nodes block"],
    ) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' K u_c by each of `parameters`, v and u held."""

    @abc.abstractmethod
    def load_gradient(self, v: Float[np.ndarray, "cases nodes block"]) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' loads_c by `forces` and the parameters that loads depend on."""
