"""Imports go one way, room by room; `forms` imports ufl alone."""

import ast
import importlib
import sys
from pathlib import Path

import pytest
from helpers.scenes import ROOT

# From top to bottom: a module may import from its own room and from rooms above it.
ROOMS = [
    ["errors", "_types", "_version"],
    ["_compat", "_validate"],
    ["_mpi"],
    ["_files"],
    ["config", "units"],
    ["toml_files"],
    ["materials"],
    ["library"],
    ["meshes", "forms"],
    ["density", "objectives", "mma", "lines"],
    ["contact"],
    ["mechanics"],
    ["equilibrium"],
    ["analysis", "design"],
    ["relaxed"],
    ["fabrication"],
    ["runs"],
    ["frames"],
    ["output"],
    ["manufacture"],
    ["workshop"],
    ["report"],
    ["actuators", "tiles"],
    ["characterisation"],
    ["scenes"],
    ["scene_files"],
    ["tolerance"],
    ["command_line"],
    ["commands"],
    ["__main__"],
]
LEVEL = {name: level for level, names in enumerate(ROOMS) for name in names}
FOLDERS = ("toros_fem", "forms", "meshes")


def sources() -> list[Path]:
    return [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def module_of(path: Path) -> str:
    """Its dotted name, as it is imported."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    whole = parts if parts[0] == "toros_fem" else ("toros_fem", *parts)
    return ".".join(part for part in whole if part != "__init__")


def room_of(module: str) -> str:
    """The folder of a module, or the module itself where it lies in none; "" for the package."""
    return (*module.split("."), "")[1]


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
            if node.module.startswith("toros_fem"):
                found.update(f"{node.module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return found


def test_every_module_is_seen() -> None:
    """The tests below look at all that is there, and would not pass on nothing."""
    seen = {module_of(path) for path in sources()}
    assert len(seen) == len(sources()) > 130
    rooms = {room_of(module) for module in seen} - {""}
    assert rooms == set(LEVEL), "each room has its place in ROOMS, and no place is empty"
    for room in (name for name in rooms if (ROOT / "toros_fem" / name).is_dir()):
        files = len(list((ROOT / "toros_fem" / room).glob("*.py")))
        assert 2 < files <= 15, f"{room} holds {files} files: a room is one subject"


@pytest.mark.parametrize("path", sources(), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_upwards(path: Path) -> None:
    room = room_of(module_of(path))
    if not room:
        return  # the package itself offers names from everywhere
    for module in imports(path):
        if not module.startswith("toros_fem."):
            continue
        other = room_of(module)
        assert other in LEVEL, f"{path} must name the module that {module} comes from"
        assert other == room or LEVEL[other] < LEVEL[room], f"{path} must not import {module}"


def test_no_module_imports_in_a_circle() -> None:
    """Inside a room too: files are sorted so that each imports from those before it."""
    modules = {module_of(path): path for path in sources() if room_of(module_of(path))}
    waiting = {
        name: {other for other in imports(path) if other in modules and other != name}
        for name, path in modules.items()
        if path.name != "__init__.py"
    }
    waiting = {name: {o for o in others if o in waiting} for name, others in waiting.items()}
    while waiting:
        ready = {name for name, others in waiting.items() if not others}
        assert ready, f"these import each other: {sorted(waiting)}"
        waiting = {name: others - ready for name, others in waiting.items() if name not in ready}


@pytest.mark.parametrize("path", sorted((ROOT / "forms").glob("*.py")), ids=lambda p: p.name)
def test_forms_are_pure_ufl(path: Path) -> None:
    allowed = {"ufl", "typing", "collections.abc", "dataclasses", "__future__"}
    for module in imports(path):
        assert module in allowed or module.startswith("toros_fem.forms"), module


def test_versions_differ_in_one_place_only() -> None:
    for path in sources():
        text = path.read_text(encoding="utf-8")
        if path.name not in ("_compat.py", "_version.py", "__init__.py", "files.py"):
            assert "__version__" not in text, path
        if path.name != "__main__.py":
            assert "COMM_WORLD" not in text, f"{path} must take its communicator"


def test_demos_share_public_names_only() -> None:
    demos = sorted((ROOT / "demos").glob("*.py"))
    assert len(demos) > 10
    for path in demos:
        for module in imports(path):
            assert module == "__future__" or "._" not in module, module
            if module.startswith("toros_fem") and module.count(".") < 3:
                importlib.import_module(module.rpartition(".")[0] or module)
    assert "toros_fem.forms" in sys.modules
