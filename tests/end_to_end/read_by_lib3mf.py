"""A 3MF package as the 3MF Consortium's own library reads it, which serves several tests."""

from dataclasses import dataclass
from pathlib import Path

import lib3mf
import numpy as np

from texmap_opt.solid.tri_mesh import TriMesh

LIBRARY = lib3mf.get_wrapper()
MILLIMETRE = lib3mf.ModelUnit.MilliMeter
CAPS = {mode.value: mode.name for mode in lib3mf.BeamLatticeCapMode}
CLIPPING = {mode.value: mode.name for mode in lib3mf.BeamLatticeClipMode}


@dataclass(frozen=True, eq=False)
class Object:
    """A mesh and its beams.

    `clipping` and `preview` are names of other objects, `cap` is of both ends of every beam.
    """

    mesh: TriMesh
    manifold: bool
    beams: np.ndarray
    radii: np.ndarray
    caps: frozenset[str]
    min_length: float
    clipping: tuple[str, str | None]
    preview: str | None


@dataclass(frozen=True, eq=False)
class Package:
    """Objects by name; the names of the built ones, those of assemblies in their place."""

    objects: dict[str, Object]
    built: tuple[str, ...]
    unit: object
    metadata: dict[str, str]
    warnings: tuple[str, ...]


def read_package(path: Path) -> Package:
    model = LIBRARY.CreateModel()
    reader = model.QueryReader("3mf")
    reader.ReadFromFile(str(path))
    meshes = list(_all(model.GetMeshObjects(), "GetCurrentMeshObject"))
    names = {m.GetResourceID(): m.GetName() for m in meshes}
    entries = model.GetMetaDataGroup()
    entries = [entries.GetMetaData(k) for k in range(entries.GetMetaDataCount())]
    return Package(
        objects={m.GetName(): _object(m, names) for m in meshes},
        built=tuple(
            name
            for item in _all(model.GetBuildItems(), "GetCurrent")
            for name in _names(model, item.GetObjectResource())
        ),
        unit=model.GetUnit(),
        metadata={entry.GetName(): entry.GetValue() for entry in entries},
        warnings=tuple(str(reader.GetWarning(k)) for k in range(reader.GetWarningCount())),
    )


def _all(iterator, current: str):
    while iterator.MoveNext():
        yield getattr(iterator, current)()


def _names(model, built) -> list[str]:
    if built.IsMeshObject():
        return [built.GetName()]
    assembly = model.GetComponentsObjectByID(built.GetUniqueResourceID())
    parts = [assembly.GetComponent(k) for k in range(assembly.GetComponentCount())]
    return [name for part in parts for name in _names(model, part.GetObjectResource())]


def _object(mesh, names: dict[int, str]) -> Object:
    vertices = np.array([tuple(v.Coordinates) for v in mesh.GetVertices()]).reshape(-1, 3)
    faces = np.array([tuple(t.Indices) for t in mesh.GetTriangleIndices()], np.int64)
    lattice = mesh.BeamLattice()
    beams = lattice.GetBeams()
    mode, clipping = lattice.GetClipping()
    shown, preview = lattice.GetRepresentation()
    return Object(
        TriMesh(vertices, faces.reshape(-1, 3)),
        mesh.IsManifoldAndOriented(),
        np.array([tuple(beam.Indices) for beam in beams], np.int64).reshape(-1, 2),
        np.array([tuple(beam.Radii) for beam in beams]).reshape(-1, 2),
        frozenset(CAPS[cap] for beam in beams for cap in beam.CapModes),
        lattice.GetMinLength(),
        (CLIPPING[mode], names.get(clipping)),
        names[preview] if shown else None,
    )
