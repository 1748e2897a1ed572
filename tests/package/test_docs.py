"""Every code block of the documentation runs, and every command in it has the options it names."""

import importlib
import json
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "demos" / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
# What a page sets up without showing it stands in a comment: <!-- setup … -->.
BLOCK = re.compile(r"^(?:```python\n(.*?)^```|<!-- setup\n(.*?)^-->)", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"python3? ((?:demos|benchmarks|packaging)/\w+\.py)([^\n`]*)")
BENCHMARK = re.compile(r"python3? -m (benchmarks [a-z]+)([^\n`]*)")
TOROS = re.compile(r"(?:^|`|scripts/|-n \w+ )(toros [a-z]+)([^\n`]*)", re.MULTILINE)
FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`[^`\n]+`")
KINDS = (COMMAND, BENCHMARK, TOROS)
# Makes designs of pages short: what they find is of no use, that they run is.
SHORTER = {
    '3e-3, "output/mine", iterations=30, constrained_iterations=20': (
        '6e-3, "output/mine", iterations=1, constrained_iterations=0, '
        "polish_iterations=0, curve_pressure=None"
    ),
    "(tf.Stage(4), tf.Stage(3, constrained=True))": "(tf.Stage(1), tf.Stage(1, constrained=True))",
    "(tf.Stage(2, constrained=True),)": "(tf.Stage(1, constrained=True),)",
    "seed=3).coarse()": "seed=3).coarse().updated(length=0.08, edge_length=4e-3)",
    "iterations=6, constrained_iterations=4": "iterations=1, constrained_iterations=1",
    "edge_length=6e-3, filter_radius=9e-3, it": "edge_length=9e-3, filter_radius=14e-3, it",
    "polish_iterations=0, curve_pressure=None": (
        "polish_iterations=0, corrections=1, estimate_error=False, curve_pressure=None"
    ),
    "iterations=(8, 8)": "iterations=(2, 2)",
    "design(2.5e-3)": "design(3.5e-3)",
    "length=0.08, diameter": "length=0.05, diameter",
}


def blocks(page: Path) -> list[tuple[int, str]]:
    """Line and code of each block."""
    text = page.read_text(encoding="utf-8")
    return [
        (text.count("\n", 0, match.start()) + 1, match.group(1) or match.group(2))
        for match in BLOCK.finditer(text)
    ]


def shorter(code: str) -> str:
    for long, short in SHORTER.items():
        code = code.replace(long, short)
    return code


def test_pages_with_code_are_found() -> None:
    assert sum(len(blocks(page)) for page in PAGES) > 15
    assert blocks(ROOT / "README.md")
    for page in PAGES:
        shown = page.read_text(encoding="utf-8").count("```python\n")
        hidden = page.read_text(encoding="utf-8").count("<!-- setup\n")
        assert len(blocks(page)) == shown + hidden, page
    text = "".join(code for page in PAGES for _, code in blocks(page))
    assert not [long for long in SHORTER if long not in text]


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page)], ids=lambda page: str(page.relative_to(ROOT))
)
def test_code_of_a_page_runs(
    few_pictures: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, page: Path
) -> None:
    """The blocks of a page run one after the other, each with the names of those before it."""
    names: dict[str, object] = {"__name__": "page"}
    monkeypatch.chdir(tmp_path)
    for line, code in blocks(page):
        # Padded, so that a failure names the line of the page.
        exec(compile("\n" * line + shorter(code), str(page), "exec"), names)


def code_of(text: str) -> str:
    """Blocks and inline code of a page: its prose may begin a line with the name of a program."""
    return "\n".join([*FENCED.findall(text), *INLINE.findall(FENCED.sub("", text))])


def commands() -> list[tuple[str, tuple[str, ...]]]:
    """Scripts and commands of `toros` that pages run, and the options that they are run with."""
    found: dict[str, set[str]] = {}
    for page in PAGES:
        text = code_of(page.read_text(encoding="utf-8")).replace("\\\n", " ")
        for script, rest in [one for kind in KINDS for one in kind.findall(text)]:
            options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", rest))
            found.setdefault(script, set()).update(options)
    return [(script, tuple(sorted(options))) for script, options in sorted(found.items())]


def run_program(name: str) -> None:
    """Run a script, or a package by its command."""
    if name in ("toros", "benchmarks"):
        runpy.run_module(name.replace("toros", "toros_fem"), run_name="__main__")
    else:
        runpy.run_path(str(ROOT / name), run_name="__main__")


@pytest.mark.parametrize(("script", "options"), commands(), ids=lambda value: str(value)[:40])
def test_commands_have_their_options(
    script: str,
    options: tuple[str, ...],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", [*script.split(), "--help"])
    with pytest.raises(SystemExit) as end:
        run_program(script.split()[0])
    assert not end.value.code
    text = capsys.readouterr().out
    for option in set(options) - {"--help"}:  # it has given this text
        assert option in text, f"{script} has no {option}"


SCENES = [
    (page, number, text)
    for page in PAGES
    for number, text in enumerate(
        re.findall(r"^```toml\n(kind = .*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)
    )
]


@pytest.mark.parametrize(
    ("page", "number", "text"), SCENES, ids=lambda value: getattr(value, "stem", str(value)[:8])
)
def test_scene_of_a_page_is_read(tmp_path: Path, page: Path, number: int, text: str) -> None:
    path = tmp_path / f"{page.stem}-{number}.toml"
    path.write_text(text, encoding="utf-8")
    assert f'"{read_scene(path).kind.KIND}"' in text.splitlines()[0]


# Makes a design of the tutorial, and its probe, short: what it finds is of no use, that it ends is.
SHORT = (
    "length=0.08 edge_length=6e-3 filter_radius=10e-3 levels=1 iterations=1 "
    "constrained_iterations=1 polish_iterations=0 corrections=0 "
    "curve_pressure=none estimate_error=false"
)


@pytest.mark.slow
def test_commands_of_the_tutorial_run_one_after_the_other(
    alone: MPI.Comm, few_pictures: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (ROOT / "docs" / "tutorial" / "first_design.md").read_text(encoding="utf-8")
    lines = re.findall(r"^toros (.+)$", text, re.MULTILINE)
    assert [line.split()[0] for line in lines][:4] == ["new", "check", "design", "view"]
    monkeypatch.chdir(tmp_path)
    for line in lines:
        words = shlex.split(line)
        if words[0] in ("check", "design"):
            words += [word for change in SHORT.split() for word in ("--set", change)]
        assert run(alone, words) == 0, f"toros {line}"
    assert Path("run", "report.html").stat().st_size > 100_000
    assert Path("run-90", "pattern.svg").is_file()


NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
FEW = (
    "scene = scene.updated(edge_length=6e-3, filter_radius=10e-3, levels=1, iterations=2)\n"
    "scene = scene.updated(constrained_iterations=1, polish_iterations=0, corrections=0)\n"
    "scene = scene.updated(length=0.08, estimate_error=False, curve_steps=2)\n"
    "import sys\n"
    "sys.modules['toros_fem.results.pictures.of_run'] = None  # a run draws nothing"
)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_its_source_makes(path: Path) -> None:
    """One whose source has changed is stale: `make pictures` runs it."""
    pytest.importorskip("nbclient")
    sys.path.append(str(ROOT / "docs"))
    runner = importlib.import_module("run_notebook")
    notebook = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert notebook["metadata"][runner.SOURCE] == runner.digest(code)
    assert [cell["execution_count"] for cell in code] == [*range(1, len(code) + 1)]
    shown = [output for cell in code for output in cell["outputs"]]
    kinds = {kind for output in shown for kind in output.get("data", ())}
    assert {"image/png", "text/html"} <= kinds
    assert not any(output["output_type"] in ("stream", "error") for output in shown)
    assert "/tmp" not in json.dumps(notebook)
    code[0]["source"] = ["scene = None"]
    assert notebook["metadata"][runner.SOURCE] != runner.digest(code)


@pytest.mark.slow
def test_the_first_notebook_runs(tmp_path: Path) -> None:
    """Its scene is made short. It shows figures, the skin in space, tables and a curve."""
    nbclient, nbformat = map(pytest.importorskip, ("nbclient", "nbformat"))
    (path,) = NOTEBOOKS
    notebook = nbformat.read(path, as_version=4)
    first = next(k for k, cell in enumerate(notebook.cells) if "scene =" in cell.source)
    notebook.cells.insert(first + 1, nbformat.v4.new_code_cell(FEW))
    (picture,) = (cell for cell in notebook.cells if "Image(" in cell.source)
    notebook.cells.remove(picture)
    stages = next(cell for cell in notebook.cells if "stages =" in cell.source)
    stages.source = re.sub(r"Stage\(\d+", "Stage(1", stages.source)
    client = nbclient.NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    shown = [
        (kind, content)
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        for kind, content in output.get("data", {}).items()
    ]
    assert max(len(content) for kind, content in shown if kind == "text/plain") < 1000
    pages = [content for kind, content in shown if kind == "text/html"]
    assert any("<td>angle</td>" in page for page in pages)
    assert any("<iframe" in page and "height: 480px" in page for page in pages)
    assert any("angle_deg" in page for page in pages)
    assert any(kind == "image/png" for kind, _ in shown)
    assert (tmp_path / "output" / "first" / "pattern.svg").is_file()
