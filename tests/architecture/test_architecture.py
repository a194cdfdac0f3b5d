"""The layout holds: who may import whom, what a file may be called, what importing does."""

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import fea
import texmap_opt

ROOTS = {"fea": Path(fea.__file__).parent, "texmap_opt": Path(texmap_opt.__file__).parent}
FILES = sorted(path for root in ROOTS.values() for path in root.rglob("*.py"))

# One file may know a heavy dependency; whoever needs it calls that file.
ONLY_USER = {
    "pytetwild": {"fea/ftetwild.py"},
    "manifold3d": {"texmap_opt/combine/boolean.py"},
    "igl": {"texmap_opt/signed_distance.py"},
    "pyamg": {"fea/linear_solve/amg.py"},
    "pypardiso": {"fea/linear_solve/direct_pardiso.py"},
    "nlopt": {"texmap_opt/sizing/mma.py"},
    "optimistix": {"texmap_opt/warp/least_squares.py"},
    "trimesh": {"texmap_opt/part_file.py"},
    "rich": {"texmap_opt/progress.py"},
    "tomli_w": {"texmap_opt/case.py"},
    "pyvista": {"texmap_opt/report/pictures.py"},
    "matplotlib": {"texmap_opt/report/plots.py", "texmap_opt/report/overlay.py"},
    "meshio": {"fea/mesh_files.py"},
}
JUNK_DRAWERS = {"utils", "util", "helpers", "common", "misc", "tools"}


def short(path: Path) -> str:
    """Path from the folder that holds the packages, such as fea/solid.py."""
    root = next(root for root in ROOTS.values() if path.is_relative_to(root))
    return path.relative_to(root.parent).as_posix()


def imported(source: str) -> set[str]:
    """Every module name that a source imports, at any depth of the file."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def uses(source: str, package: str) -> bool:
    return any(name == package or name.startswith(f"{package}.") for name in imported(source))


def test_imports_are_seen_wherever_they_stand():
    """Negative control of the scanner that the other tests rely on."""
    source = "def f():\n    from igl.copyleft import cgal\n    import texmap_opt.part as p\n"
    assert uses(source, "igl")
    assert uses(source, "igl.copyleft")
    assert uses(source, "texmap_opt")
    assert not uses(source, "fea")


def test_fea_knows_nothing_of_lattices():
    guilty = [
        short(p) for p in FILES if short(p).startswith("fea/") and uses(p.read_text(), "texmap_opt")
    ]
    assert not guilty


@pytest.mark.parametrize("package", sorted(ONLY_USER))
def test_a_heavy_dependency_has_one_user(package: str):
    users = {short(p) for p in FILES if uses(p.read_text(), package)}
    assert users <= ONLY_USER[package]


def test_nothing_uses_the_gpl_half_of_libigl():
    assert not [short(p) for p in FILES if uses(p.read_text(), "igl.copyleft")]


def test_no_file_is_a_junk_drawer():
    assert not [short(p) for p in FILES if p.stem in JUNK_DRAWERS]


def test_no_shape_is_hidden_from_the_runtime_checks():
    assert not [short(p) for p in FILES if uses(p.read_text(), "__future__.annotations")]


def test_an_abstract_class_is_never_a_leaf_and_a_leaf_never_has_children():
    """Style: a class is an interface (`Abstract...`) or a leaf."""
    bases: dict[str, set[str]] = {}
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                bases[node.name] = {b.id for b in node.bases if isinstance(b, ast.Name)}
    own = set(bases)
    errors = {"TexmapError", "InputError", "FeaError"}
    guilty = [
        f"{name}({base})"
        for name, parents in bases.items()
        for base in parents & own
        if not base.startswith("Abstract") and base not in errors
    ]
    assert not guilty


@pytest.mark.parametrize("package", [fea, texmap_opt], ids=lambda p: p.__name__)
def test_every_public_name_is_there_once_and_in_order(package):
    """Public is what `__init__.py` imports as itself: `from fea.solid import solve_solid as solve_solid`."""
    tree = ast.parse(Path(package.__file__).read_text())
    aliases = [a for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names]
    assert aliases
    assert all(alias.asname == alias.name for alias in aliases)
    names = [alias.name for alias in aliases]
    assert len(set(names)) == len(names)
    for name in names:
        assert hasattr(package, name), name


@pytest.mark.parametrize("package", sorted(ROOTS))
def test_every_module_imports(package: str):
    for module in pkgutil.walk_packages([str(ROOTS[package])], f"{package}."):
        if module.name.rsplit(".", 1)[-1] != "__main__":
            importlib.import_module(module.name)


def test_importing_prints_nothing_and_configures_nothing():
    """JAX's precision, logging and plotting stay as the process had them."""
    probe = (
        "import logging, sys; before = list(logging.root.handlers);"
        "import fea, texmap_opt, jax;"
        "assert not jax.config.jax_enable_x64;"
        "assert logging.root.handlers == before;"
        "assert 'pyvista' not in sys.modules and 'matplotlib' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_package_neither_prints_nor_exits_outside_the_command_line():
    """Programs print; a library does not (style, principle 10)."""
    programs = {"texmap_opt/cli.py"}
    for path in FILES:
        if short(path) in programs:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in {"print", "exit"}, short(path)
