"""The documentation site: every page is on it, every link works, every public name is in it."""

import os
import re
import runpy
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
from helpers.scenes import ROOT

import toros_fem
from benchmarks.accuracy.command import KNOWN, sections
from benchmarks.bench import ROWS, read
from toros_fem import meshes
from toros_fem.materials.library.files import read_library
from toros_fem.products.common.plausibility import RANGES
from toros_fem.products.kinds import KINDS

DOCS = ROOT / "docs"
ALONE = {"__version__", "errors", "meshes"}  # no page has these names
PAGES = sorted(DOCS.rglob("*.md"))
READ_HERE = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "demos" / "README.md", *PAGES]
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]+)(?:#[^)]*)?\)")


def entries(page: Path) -> list[Path]:
    """Pages in the toctrees of a page."""
    found = []
    for tree in TOCTREE.findall(page.read_text(encoding="utf-8")):
        for line in tree.splitlines():
            if line and not line.startswith(":"):
                found.append((page.parent / f"{line}.md").resolve())
    return found


def test_every_page_is_in_one_toctree() -> None:
    listed = [entry for page in PAGES for entry in entries(page)]
    assert sorted(listed) == [page for page in PAGES if page != DOCS / "index.md"]


@pytest.mark.parametrize("page", READ_HERE, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_a_page_lead_to_files(page: Path) -> None:
    """Pages are read in a checkout too, where nothing resolves a link."""
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_links_have_words() -> None:
    """Without the site an empty link shows nothing."""
    assert not [page for page in PAGES if "[](" in page.read_text(encoding="utf-8")]


def test_theory_has_every_equation() -> None:
    text = "\n".join(p.read_text(encoding="utf-8") for p in (DOCS / "theory").glob("*.md"))
    assert sorted(map(int, re.findall(r"\\tag\{(\d+)\}", text))) == list(range(1, 20))


def test_files_that_pages_name_exist() -> None:
    """A name counts from the top of a checkout, from the package, from the demos or benchmarks."""
    places = [ROOT, *(ROOT / name for name in ("toros_fem", "demos", "benchmarks"))]
    named = [
        (page.name, name)
        for page in READ_HERE
        for name in re.findall(r"`([\w/]+\.py)`", page.read_text(encoding="utf-8"))
    ]
    assert len(named) > 60
    gone = {(page, name) for page, name in named if not any((p / name).is_file() for p in places)}
    assert gone == set()


def test_tables_of_the_docs_are_those_of_the_code() -> None:
    made = runpy.run_path(str(DOCS / "make_tables.py"))
    stale = [p.name for p, text in made["pages"]().items() if p.read_text("utf-8") != text]
    assert stale == [], "run python3 docs/make_tables.py"
    tables = {mark: [*rows()] for mark, (_, rows, _) in made["TABLES"].items()}
    assert all(len({len(row) for row in rows}) == 1 for rows in tables.values())
    listed = {name for row in tables["keys of scenes"][1:] for name in row[-1].split(", ")}
    assert listed == set(KINDS)
    assert len(tables["usual ranges"]) == 1 + len(RANGES)
    assert {row[1] for row in tables["materials"][1:]} == set(read_library())
    assert {row[0] for row in tables["names"][1:]} == set(toros_fem.public.__all__) - ALONE


def test_tables_are_plain_markdown() -> None:
    """A reader of the checkout sees no table that a directive would fetch from a file."""
    fetched = [page.name for page in PAGES if "csv-table" in page.read_text(encoding="utf-8")]
    assert fetched == []


def test_the_first_page_has_links_to_all_pages() -> None:
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = LINK.findall(text[text.index("## All pages") : text.index("```{toctree}")])
    outside = runpy.run_path(str(DOCS / "conf.py"))["OUTSIDE"]
    known = {f"../{source}.md": f"{page}.md" for source, page in outside.items()}
    found = [(DOCS / known.get(link, link)).resolve() for link in listed]
    assert found == entries(DOCS / "index.md")


def test_the_site_has_all_cases_of_accuracy() -> None:
    heads = [h for h in sections(read(ROWS / "accuracy.csv")).splitlines() if h[:4] == "### "]
    assert {head.removeprefix("### ") for head in heads} == {known.name for known in KNOWN}


def public_names() -> list[str]:
    """Names of the package and of `meshes`, each in its shortest form."""
    rooms = [(toros_fem.__all__, "toros_fem"), (meshes.__all__, "toros_fem.meshes")]
    names = {name: room for of, room in reversed(rooms) for name in of}
    return [f"{room}.{name}" for name, room in names.items() if name not in ALONE]


def test_few_public_names_by_task() -> None:
    """The table in the reference has each of them once."""
    assert len(toros_fem.public.__all__) <= 61
    text = (DOCS / "reference" / "index.md").read_text(encoding="utf-8")
    listed = re.findall(r"~toros_fem\.(\w+)", text)
    assert listed == [name for name in toros_fem.public.__all__ if name not in ALONE]


@pytest.mark.slow
def test_site_has_every_public_name_and_no_warning(tmp_path: Path) -> None:
    site = tmp_path / "site"
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX"))}
    command = ["sphinx", "-q", "--fail-on-warning", "--keep-going", "-d", str(tmp_path / "trees")]
    done = subprocess.run(
        [sys.executable, "-m", *command, str(DOCS), str(site)],
        env={**environment, "PYTHONPATH": str(ROOT)}, text=True, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    inventory = (site / "objects.inv").read_bytes().split(b"\n", 4)
    assert toros_fem.__version__.encode() in inventory[2]
    known = {line.split()[0] for line in zlib.decompress(inventory[4]).decode().splitlines()}
    names = public_names()
    assert len(names) > 90
    assert [name for name in names if name not in known] == []
    loaded = re.compile(r'<(?:script|img|link|iframe)\b[^>]*(?:src|href)="((?:https?:)?//[^"]*)')
    for page in site.rglob("*.html"):
        assert loaded.findall(page.read_text(encoding="utf-8")) == [], f"{page} needs a network"
