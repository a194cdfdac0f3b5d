"""Equal joints are worked out once, and come out as if each had been worked out by itself."""

import numpy as np
import pytest
from lattices import block, jittered, octet, structure
from sound_solid import assert_sound

from texmap_opt.solid import lattice_mesh
from texmap_opt.solid.joint_types import JointTypes, joint_types
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.struts import round_ring
from texmap_opt.structure.structure import Structure


def kinds(lattice: Structure, fillet: np.ndarray | None = None) -> int:
    """How many different joints a lattice has."""
    ends = StrutEnds.of(lattice, round_ring(8))
    if fillet is not None:
        ends = ends.filleted(fillet)
    valences = ends.valence
    return sum(
        len(joint_types(ends, np.flatnonzero(valences == count)).ends)
        for count in np.unique(valences[valences > 0])
    )


def one_by_one(ends: StrutEnds, joints: np.ndarray) -> JointTypes:
    """Every joint a type of its own."""
    return JointTypes(joints, np.arange(len(joints)), ends.ends_of(joints))


def test_a_uniform_octet_has_27_places_for_its_corners_and_few_for_its_faces():
    """Corners of cells: inside, or on any of 6 faces, 12 edges, 8 corners of the block: 27 kinds.

    Middles of faces: 3 orientations, inside or on either side: 9. However large the block is.
    """
    assert kinds(octet(2, 5.0, 0.4)) == kinds(octet(3, 5.0, 0.4)) == 36


def test_every_joint_of_a_jittered_block_is_its_own_kind():
    lattice = jittered(octet(2, 5.0, 0.4), 0.2, seed=1)
    assert kinds(lattice) == len(lattice.joints)


def test_a_radius_a_fillet_or_a_direction_makes_another_kind():
    cube = block("cube", 1, slenderness=0.1)
    whole = kinds(cube)
    radii = cube.radii.copy()
    radii[0, 0] *= 1.001
    assert kinds(structure(cube.joints, cube.struts, radii)) == whole
    larger = block("cube", 2, slenderness=0.1)
    radii = larger.radii.copy()
    radii[0, 0] *= 1.001
    assert kinds(structure(larger.joints, larger.struts, radii)) == kinds(larger)
    uniform = block("cube", 3, slenderness=0.1)
    centre = int(np.argmin(np.linalg.norm(uniform.joints - uniform.joints.mean(axis=0), axis=1)))
    fillet = np.zeros(len(uniform.joints))
    fillet[centre] = 0.1
    assert kinds(uniform, fillet) == kinds(uniform) + 1
    joints = uniform.joints.copy()
    joints[centre] += 1e-3
    # The joint, and the six at the other ends of its struts.
    assert kinds(structure(joints, uniform.struts, uniform.radii)) == kinds(uniform) + 7


@pytest.mark.parametrize("fillet", [0.0, 0.2])
def test_the_surface_is_that_of_joints_worked_out_one_by_one(monkeypatch, fillet):
    """To the steps in which joints are compared, 1e-7 of the radius, which fillets double."""
    lattice = octet(1, 5.0, 0.4)
    hashed = lattice_solid(lattice, tolerance_mm=0.05, fillet_mm=fillet)
    monkeypatch.setattr(lattice_mesh, "joint_types", one_by_one)
    single = lattice_solid(lattice, tolerance_mm=0.05, fillet_mm=fillet)
    assert hashed.joint_types == single.joint_types == len(lattice.joints)
    twice = octet(2, 5.0, 0.4)
    single = lattice_solid(twice, tolerance_mm=0.05, fillet_mm=fillet)
    monkeypatch.undo()
    hashed = lattice_solid(twice, tolerance_mm=0.05, fillet_mm=fillet)
    assert hashed.joint_types == 36 < single.joint_types == len(twice.joints)
    np.testing.assert_allclose(hashed.surface.volume, single.surface.volume, rtol=1e-6)
    assert_sound(hashed.surface, twice)


def test_a_jitter_of_a_nanometre_changes_nothing_but_the_number_of_kinds():
    """1e-6 mm, ten steps of comparison: all joints differ, the volume does not."""
    lattice = octet(2, 5.0, 0.4)
    random = np.random.default_rng(0)
    moved = lattice.joints + random.uniform(-1e-6, 1e-6, lattice.joints.shape)
    one, other = (
        lattice_solid(each, tolerance_mm=0.05)
        for each in (lattice, structure(moved, lattice.struts, lattice.radii))
    )
    assert other.joint_types > 1.5 * one.joint_types
    # Edges that are just as far off as the tolerance allows are divided in one and not in another.
    np.testing.assert_allclose(one.surface.volume, other.surface.volume, rtol=2e-3)
