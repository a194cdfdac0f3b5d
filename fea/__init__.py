"""Linear elasticity of solids (tetrahedra) and frames (beams), by finite elements.

Units: mm, N, MPa = N/mm², tonne/mm³ for density, mm/s² for acceleration, N mm for moments and
energy. Nothing in the mechanics depends on them: any consistent set works.

Signs: tension, and extension, are positive; a positive pressure pushes against the outward
normal. Forces act on the body, reactions are forces of the supports on the body, so that loads and
reactions sum to zero. Moments and rotations follow the right-hand rule.

Voigt order: xx, yy, zz, yz, xz, xy. Stress 6-vectors hold the tensor's components; strain
6-vectors hold engineering shears, gamma_yz = 2 epsilon_yz, so that energy is stress . strain / 2.

Dofs: ux, uy, uz of node 0, then of node 1 and so on; joints of frames carry ux, uy, uz and the
rotations rx, ry, rz.

All numbers are float64: programs switch JAX's `jax_enable_x64` on before they call.
"""

from fea.boundary_conditions import Support as Support
from fea.boundary_conditions import body_forces as body_forces
from fea.boundary_conditions import force_on_facets as force_on_facets
from fea.boundary_conditions import gravity_forces as gravity_forces
from fea.boundary_conditions import moment_on_facets as moment_on_facets
from fea.boundary_conditions import pressure_forces as pressure_forces
from fea.boundary_conditions import traction_forces as traction_forces
from fea.errors import FeaError as FeaError
from fea.linear_solve import SolveResult as SolveResult
from fea.linear_solve import factorise as factorise
from fea.materials import Material as Material
from fea.materials import material as material
from fea.materials import material_names as material_names
from fea.precision import require_x64 as require_x64
from fea.rigid_motion import free_motion as free_motion
from fea.rigid_motion import rigid_body_modes as rigid_body_modes
from fea.solid import SolidModel as SolidModel
from fea.solid import SolidSolution as SolidSolution
from fea.solid import solve_solid as solve_solid
from fea.stress_recovery import nodal_stress as nodal_stress
from fea.tet_mesh import TetMesh as TetMesh
from fea.voigt import von_mises as von_mises
