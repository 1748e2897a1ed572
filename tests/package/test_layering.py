"""Imports go one way, room by room; `forms` imports ufl alone."""

import ast
import importlib
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

from helpers.scenes import ROOT

# From top to bottom: a module may import from its own room and from rooms below it.
ROOMS = [
    "cli", "products", "results", "making", "design", "mechanics", "measures", "forms", "meshes",
    "materials", "base",
]  # fmt: skip
MOST_FLOORS = 10
HOUSE = SimpleNamespace(**runpy.run_path(str(ROOT / "docs" / "draw_rooms.py")))
SOURCES: list[Path] = HOUSE.sources()


def room_of(path: Path) -> str:
    return str(HOUSE.room_of(HOUSE.module_of(path)))


def ours(path: Path) -> set[str]:
    """Modules of the package that a file imports, and names that it takes from them."""
    return {name for name in HOUSE.imports(path) if name.startswith("toros_fem.")}


def test_every_module_is_seen() -> None:
    """The tests below look at all that is there, and would not pass on nothing."""
    assert len({HOUSE.module_of(path) for path in SOURCES}) == len(SOURCES) > 150
    assert {room_of(path) for path in SOURCES} == {*ROOMS, "", "__main__", "public"}


def test_imports_go_down() -> None:
    level = {room: ROOMS.index(room) for room in ROOMS}
    found = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in SOURCES
        if room_of(path) in level
        for name in sorted(ours(path))
        if level[HOUSE.room_of(name)] < level[room_of(path)]
    ]
    assert found == []


def test_a_file_names_the_module_that_a_name_comes_from() -> None:
    """`from toros_fem import x` would tie it to the whole package."""
    found = [path for path in SOURCES if room_of(path) and "toros_fem" in HOUSE.imports(path)]
    assert [path for path in found if path.name != "__main__.py"] == []


def test_rooms_stand_on_few_floors() -> None:
    below = HOUSE.arrows()
    assert max(HOUSE.floors(below).values()) <= MOST_FLOORS


# Files that hand names on; a folder with both loads them at the first call.
FACES = ("__init__.py", "public.py")


def test_neither_files_nor_folders_import_each_other() -> None:
    """Faces, which hand names on, are left out."""
    modules = {HOUSE.module_of(path): path for path in SOURCES if path.name not in FACES}
    files = {name: (ours(path) & set(modules)) - {name} for name, path in modules.items()}
    HOUSE.floors(files)
    folders: dict[str, set[str]] = {}
    for name, others in files.items():
        folder = name.rpartition(".")[0]
        to = {other.rpartition(".")[0] for other in others}
        folders.setdefault(folder, set()).update(to - {folder})
    HOUSE.floors(folders)


def test_faces_hand_names_on_and_do_nothing_else() -> None:
    for path in SOURCES:
        loads_later = path.name == "__init__.py" and path.with_name("public.py").exists()
        if path.name in FACES and not loads_later and path.parent.name != "toros_fem":
            body = ast.parse(path.read_text(encoding="utf-8")).body
            assert isinstance(body[0], ast.Expr), f"{path} says what it is for"
            kinds = {type(node) for node in body[1:]}
            assert kinds <= {ast.ImportFrom, ast.Assign}, path


def test_an_equilibrium_loads_neither_contact_nor_makers_of_meshes() -> None:
    """A `Contact` brings its own term, and the names of `meshes` are loaded when one is asked for.

    Nor does a design without contact.
    """
    script = (
        "import sys, toros_fem.mechanics.equilibrium.solver, toros_fem.design.loop.loop\n"
        "late = 'meshes.sheets', 'meshes.outlines', 'meshes.tiles', 'mechanics.contact'\n"
        "late = *('toros_fem.' + name for name in late), 'gmsh', 'ipctk'\n"
        "print(*(n for n in sys.modules if n.startswith(late)))\n"
        "from toros_fem.meshes import bordered, cylinder, tile\n"
        "assert callable(bordered) and callable(tile)\n"
        "import toros_fem.meshes as meshes\n"
        "assert set(meshes.__all__) <= set(dir(meshes)) and not hasattr(meshes, 'nothing')\n"
    )
    own = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMI"))}
    done = subprocess.run(
        [sys.executable, "-c", script], env={**own, "PYTHONPATH": str(ROOT)},
        text=True, capture_output=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == ""


def test_drawing_is_that_of_the_code() -> None:
    drawing = HOUSE.DRAWING.read_text(encoding="utf-8")
    assert drawing == HOUSE.svg(), "run python3 docs/draw_rooms.py"


def test_forms_are_pure_ufl() -> None:
    allowed = {"ufl", "typing", "collections.abc", "dataclasses", "itertools", "__future__"}
    paths = sorted((ROOT / "forms").glob("*.py"))
    assert len(paths) > 5
    for path in paths:
        others = {m for m in HOUSE.imports(path) if not m.startswith("toros_fem.forms")}
        assert others <= allowed, path


def test_versions_differ_in_one_place_only() -> None:
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        if path.name not in ("fenicsx.py", "packages.py"):
            assert not re.search(r"(dolfinx|ufl|basix|PETSc|petsc4py)\.__version__", text), path
        if path.name != "__main__.py":
            assert "COMM_WORLD" not in text, f"{path} must take its communicator"


def test_demos_share_public_names_only() -> None:
    demos = sorted((ROOT / "demos").glob("*.py"))
    assert len(demos) > 10
    for path in demos:
        for module in HOUSE.imports(path):
            assert module == "__future__" or "._" not in module, module
            if module.startswith("toros_fem") and module.count(".") < 3:
                importlib.import_module(module.rpartition(".")[0] or module)
    assert "toros_fem.forms" in sys.modules
