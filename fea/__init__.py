"""Linear elasticity of solids (tetrahedra), frames (beams) and skins (shells), by finite elements.

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

from fea.adaptive import Adapted as Adapted
from fea.adaptive import refine as refine
from fea.adjoint import Sequence as Sequence
from fea.adjoint import compliance_gradient as compliance_gradient
from fea.adjoint import displacement as displacement
from fea.boundary_conditions import Support as Support
from fea.boundary_conditions import body_forces as body_forces
from fea.boundary_conditions import force_on_facets as force_on_facets
from fea.boundary_conditions import gravity_forces as gravity_forces
from fea.boundary_conditions import moment_on_facets as moment_on_facets
from fea.boundary_conditions import pressure_forces as pressure_forces
from fea.boundary_conditions import traction_forces as traction_forces
from fea.couplings import Distributing as Distributing
from fea.couplings import Rigid as Rigid
from fea.couplings import Tie as Tie
from fea.effective_stiffness import EffectiveStiffness as EffectiveStiffness
from fea.error_estimate import ErrorEstimate as ErrorEstimate
from fea.errors import FeaError as FeaError
from fea.frame import FrameProblem as FrameProblem
from fea.frame import FrameSolution as FrameSolution
from fea.frame import solve_frame as solve_frame
from fea.frame_eigen import Inertia as Inertia
from fea.free_vibration import Vibration as Vibration
from fea.free_vibration import frequency as frequency
from fea.free_vibration import vibration as vibration
from fea.ftetwild import tetrahedralise as tetrahedralise
from fea.homogenise import homogenise_frame as homogenise_frame
from fea.homogenise import homogenised as homogenised
from fea.homogenise import homogenised_gradient as homogenised_gradient
from fea.homogenise_solid import homogenise_mirrored as homogenise_mirrored
from fea.homogenise_solid import homogenise_solid as homogenise_solid
from fea.linear_solve import SingularStiffness as SingularStiffness
from fea.linear_solve import SolveResult as SolveResult
from fea.linear_solve import factorise as factorise
from fea.materials import Material as Material
from fea.materials import Orthotropic as Orthotropic
from fea.materials import material as material
from fea.materials import material_names as material_names
from fea.mechanisms import free_body as free_body
from fea.mesh_files import read_surface as read_surface
from fea.mesh_files import read_tets as read_tets
from fea.mesh_files import write_tets as write_tets
from fea.objectives import compliance as compliance
from fea.objectives import mean_displacement as mean_displacement
from fea.objectives import p_norm as p_norm
from fea.objectives import stress_p_norm as stress_p_norm
from fea.periodic_frame import PeriodicFrame as PeriodicFrame
from fea.plane_frame import PlaneFrame as PlaneFrame
from fea.plane_frame import in_plane as in_plane
from fea.plane_stiffness import PlaneStiffness as PlaneStiffness
from fea.precision import require_x64 as require_x64
from fea.rigid_motion import free_motion as free_motion
from fea.rigid_motion import rigid_body_modes as rigid_body_modes
from fea.section_forces import MemberForces as MemberForces
from fea.section_forces import member_forces as member_forces
from fea.section_forces import strut_deflection as strut_deflection
from fea.sections import Round as Round
from fea.sections import Square as Square
from fea.sections import Tube as Tube
from fea.sections import Wall as Wall
from fea.sections import section as section
from fea.shell_stress import skin_stress as skin_stress
from fea.sizing_field import Sizing as Sizing
from fea.skin import Skin as Skin
from fea.skin_loads import skin_gravity_forces as skin_gravity_forces
from fea.skin_loads import skin_pressure_forces as skin_pressure_forces
from fea.skin_loads import skin_traction_forces as skin_traction_forces
from fea.solid import SolidProblem as SolidProblem
from fea.solid import SolidSolution as SolidSolution
from fea.solid import quadrature_stress as quadrature_stress
from fea.solid import solve_solid as solve_solid
from fea.stability import Buckling as Buckling
from fea.stability import buckling as buckling
from fea.stability import buckling_factor as buckling_factor
from fea.strut_loads import strut_weight as strut_weight
from fea.strut_strength import buckling_utilisation as buckling_utilisation
from fea.strut_strength import end_stress as end_stress
from fea.strut_strength import euler_load as euler_load
from fea.strut_strength import euler_utilisation as euler_utilisation
from fea.strut_strength import strut_stress as strut_stress
from fea.strut_strength import strut_utilisation as strut_utilisation
from fea.strut_strength import utilisation as utilisation
from fea.tet_mesh import TetMesh as TetMesh
from fea.voigt import principal_directions as principal_directions
from fea.voigt import principal_values as principal_values
from fea.voigt import von_mises as von_mises
