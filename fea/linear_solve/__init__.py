"""K u = f for symmetric positive definite K: one file a solver, one rule that chooses."""

from fea.linear_solve.choice import factorise as factorise
from fea.linear_solve.interface import Factor as Factor
from fea.linear_solve.interface import Solution as Solution
from fea.linear_solve.interface import SolveResult as SolveResult
