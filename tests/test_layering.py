"""Each layer imports only from those above it; `forms` imports ufl alone."""

import ast
import importlib
import sys
from pathlib import Path

import pytest
from conftest import ROOT

# From top to bottom; a module may import what stands before its own line.
LAYERS = [
    ["errors", "_mpi", "_compat"],
    ["parameters"],
    ["meshes"],
    ["forms"],
    ["feasibility", "supports", "density", "continuation", "loads", "tile_file"],
    ["hinges", "chambers"],
    ["lattice"],
    ["patch", "assembly"],
    ["pressure"],
    ["model"],
    ["images"],
    ["tangent", "displacement", "request"],
    ["factor"],
    ["newton"],
    ["minimise"],
    ["reasons"],
    ["equilibrium", "tile"],
    ["profile"],
    ["profile_objective", "pull_test"],
    ["rotation", "slabs"],
    ["measure"],
    ["estimate", "path"],
    ["objective"],
    ["alignment", "sections", "grasp"],
    ["stencil", "projection"],
    ["strip"],
    ["cone", "helmholtz"],
    ["filters", "perimeter"],
    ["length_scale"],
    ["chain"],
    ["design", "tile_design", "approximation"],
    ["subproblem"],
    ["mma"],
    ["stages"],
    ["variables"],
    ["scaled"],
    ["optimise"],
    ["contours", "widths", "io"],
    ["pieces", "sample"],
    ["manufacture", "pulled_sheet"],
    ["export", "plotting", "printed"],
    ["comparison", "sample_plot", "surface_plot"],
    ["report"],
    ["settings", "tile_pieces"],
    ["scene", "tile_scene"],
    ["tile_print"],
    ["tile_search"],
    ["profile_plot"],
    ["tile_report"],
    ["cli", "tube", "limb"],
    ["gait", "grasp_report"],
]
RANK = {name: level for level, names in enumerate(LAYERS) for name in names}


def sources() -> list[Path]:
    return [path for folder in ("toros_fem", "forms", "meshes")
            for path in sorted((ROOT / folder).glob("*.py"))]  # fmt: skip


def imports(path: Path) -> set[str]:
    """Modules imported at run time, those for type checking only left out."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            assert node.module is not None
            found.add(node.module)
            if node.module == "toros_fem":
                found.update(f"toros_fem.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def module_of(path: Path) -> str:
    return path.parent.name if path.parent.name != "toros_fem" else path.stem


@pytest.mark.parametrize("path", sources(), ids=lambda p: f"{p.parent.name}/{p.name}")
def test_imports_go_upwards(path: Path) -> None:
    name = module_of(path)
    if name == "__init__":
        return
    assert name in RANK, f"give {name} a place in LAYERS"
    for module in imports(path):
        if not module.startswith("toros_fem."):
            continue
        other = module.split(".")[1]
        assert RANK[other] < RANK[name] or other == name, f"{path.name} must not import {module}"


@pytest.mark.parametrize("path", sorted((ROOT / "forms").glob("*.py")), ids=lambda p: p.name)
def test_forms_are_pure_ufl(path: Path) -> None:
    allowed = {"ufl", "typing", "collections.abc", "dataclasses", "__future__"}
    for module in imports(path):
        assert module in allowed or module.startswith("toros_fem.forms"), module


def test_versions_differ_in_one_place_only() -> None:
    for path in sources():
        text = path.read_text(encoding="utf-8")
        if path.name not in ("_compat.py", "io.py"):
            assert "__version__" not in text or path.name == "__init__.py", path
        assert "COMM_WORLD" not in text, f"{path} must take its communicator"
        assert len(text.splitlines()) < 400, f"{path} is more than one concept"


def test_demos_and_package_share_public_names_only() -> None:
    for path in sorted((ROOT / "demos").glob("*.py")):
        for module in imports(path):
            assert module == "__future__" or "._" not in module, module
            if module.startswith("toros_fem"):
                importlib.import_module(module)
    assert "toros_fem.forms" in sys.modules
