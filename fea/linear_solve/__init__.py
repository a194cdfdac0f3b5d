"""K u = f for symmetric positive definite K: one file a solver, one rule that chooses."""

from fea.linear_solve.choice import factorise as factorise
from fea.linear_solve.element_operator import ElementOperator as ElementOperator
from fea.linear_solve.interface import Factor as Factor
from fea.linear_solve.solve_result import SingularStiffness as SingularStiffness
from fea.linear_solve.solve_result import Solution as Solution
from fea.linear_solve.solve_result import SolveResult as SolveResult
