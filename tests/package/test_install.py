"""The package works as a wheel and as an editable install; all other tests have the checkout."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from helpers.scenes import ROOT


def dotted(path: Path) -> str:
    """Name by which a file of the checkout is imported."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    whole = parts if parts[0] == "toros_fem" else ("toros_fem", *parts)
    return ".".join(part for part in whole if part != "__init__")


FILES = [p for folder in ("toros_fem", "forms", "meshes") for p in (ROOT / folder).rglob("*.py")]
DRAWS = re.compile(
    r"^(from|import) (matplotlib|mpl_toolkits|toros_fem\.results\.pictures\.(?!view))", re.MULTILINE
)
PICTURES = sorted(dotted(p) for p in FILES if DRAWS.search(p.read_text(encoding="utf-8")))
OTHERS = sorted({dotted(p) for p in FILES} - set(PICTURES))
# Every module of every room is imported, those that draw after all others.
CHECK = f"""
import importlib, sys
for name in {OTHERS}:
    importlib.import_module(name)
assert "matplotlib" not in sys.modules, "who draws no pictures does not pay for them"
for name in {PICTURES}:
    importlib.import_module(name)
import toros_fem
missing = [name for name in toros_fem.__all__ if not hasattr(toros_fem, name)]
assert not missing, missing
print(toros_fem.__version__, toros_fem.__file__, toros_fem.meshes.pattern.__file__)
"""


def run(*command: str | Path, cwd: Path, **extra: str) -> str:
    """Run a command outside of this checkout's PYTHONPATH."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | extra
    # An MPI launched by a test must not take this process for its parent.
    environment = {k: v for k, v in environment.items() if not k.startswith(("OMPI_COMM", "PMI"))}
    # MPI from wheels is looked for in the environment of the calling Python alone.
    if (library := Path(sys.prefix) / "lib" / "libmpi.so.12").exists():
        environment["MPI4PY_LIBMPI"] = str(library)
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, text=True, capture_output=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the package is built from, so that the build leaves nothing behind."""
    copy = tmp_path_factory.mktemp("source")
    for folder in ("toros_fem", "forms", "meshes"):
        shutil.copytree(
            ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
        )
    for name in ("pyproject.toml", "README.md", "COPYING", "COPYING.LESSER"):
        shutil.copy(ROOT / name, copy / name)
    return copy


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("site")


def test_every_room_is_listed_for_the_wheel() -> None:
    """The list in pyproject.toml is made by hand: none of the folders may be missing."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    rooms = {dotted(path) for path in FILES if path.name == "__init__.py"}
    assert len(rooms) > 12
    assert sorted(listed) == sorted(rooms)


@pytest.mark.slow
def test_wheel(source: Path, site: Path) -> None:
    pip = [sys.executable, "-m", "pip", "-qq"]
    options = ["--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    run(*pip, "wheel", *options, "--wheel-dir", site, ".", cwd=source)
    wheel = next(site.glob("toros_fem-*.whl"))
    target = site / "wheel"
    run(
        *pip,
        "install",
        "--no-deps",
        "--disable-pip-version-check",
        "--target",
        target,
        wheel,
        cwd=site,
    )
    said = run(sys.executable, "-c", CHECK, cwd=site, PYTHONPATH=str(target))
    assert str(target / "toros_fem" / "meshes" / "pattern.py") in said
    assert not (target / "forms").exists(), "only one package may be installed"
    page = target / "toros_fem" / "results" / "report" / "page"
    source_page = ROOT / "toros_fem" / "results" / "report" / "page"
    assert {p.name for p in page.iterdir()} == {p.name for p in source_page.iterdir()}
    toros = target / "bin" / "toros"
    version = run(sys.executable, toros, "--version", cwd=site, PYTHONPATH=str(target))
    assert version == f"toros_fem {said.split()[0]}\n"


@pytest.mark.slow
def test_editable(source: Path, site: Path) -> None:
    venv = site / "venv"
    run(sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", venv, cwd=site)
    python = venv / "bin" / "python"
    # The extras live in a virtual environment of their own, which the new one does not see.
    path = os.pathsep.join(entry for entry in sys.path if "site-packages" in entry)
    run(python, "-m", "pip", "-qq", "install", "--no-deps", "--no-build-isolation",
        "--disable-pip-version-check", "--editable", ".", cwd=source, PYTHONPATH=path)  # fmt: skip
    said = run(python, "-c", CHECK, cwd=site, PYTHONPATH=path)  # dependencies, not the package
    assert str(source / "meshes" / "pattern.py") in said


def environment_script(folder: Path, **environment: str) -> str:
    """What scripts/fenicsx says where it fails, with few tools beside those in `folder / "bin"`."""
    tools = folder / "bin"
    tools.mkdir(exist_ok=True)
    for name in ("bash", "dirname", "mkdir", "id", "cksum", "cut", "flock"):
        found = shutil.which(name)
        (tools / name).symlink_to(found)
    done = subprocess.run(
        ["bash", str(ROOT / "scripts" / "fenicsx"), "true"], capture_output=True, text=True,
        check=False, env={"PATH": str(tools), "HOME": str(folder), **environment},
    )  # fmt: skip
    assert done.returncode != 0
    assert "fenicsx: " in done.stderr
    return done.stderr


def test_environment_script_fails_with_advice(tmp_path: Path) -> None:
    """An incomplete tool chain ends in a sentence that says what to do, not in a trace."""
    syntax = subprocess.run(
        ["bash", "-n", ROOT / "scripts" / "fenicsx"], capture_output=True, text=True, check=False
    )
    assert syntax.returncode == 0, syntax.stderr
    assert "Python 3.12 or newer" in environment_script(tmp_path, FENICSX_SUITE="trixie")


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (None, "there is no Python 3.12 or newer on the PATH"),
        ("Python 3.11 is older than 3.12", "there is no Python 3.12 or newer on the PATH"),
        ("Python.h is missing (Debian, Ubuntu: python3-dev)", "python3: Python.h is missing"),
    ],
)
def test_why_there_are_no_wheels(tmp_path: Path, answer: str | None, reason: str) -> None:
    """Python says it itself; one that is too old is no candidate."""
    if answer is not None:
        (tmp_path / "bin").mkdir()
        python = tmp_path / "bin" / "python3"
        python.write_text(f"#!{shutil.which('bash')}\necho '{answer}' >&2\nexit 1\n")
        python.chmod(0o755)
    assert f"wheels: {reason}" in re.sub(
        r"/\S*/", "", environment_script(tmp_path, FENICSX_WHEELS="1")
    )


def test_runs_need_fewer_packages_than_tests() -> None:
    function = "source <(sed -n '/^requirements()/,/^}/p' scripts/fenicsx); checkout=$PWD"
    found = {
        (how, groups): {
            re.split(r"[\[<>=; ]", line)[0]
            for line in run(
                "bash", "-c", f'{function}; requirements "$0" {how} {groups}', sys.executable,
                cwd=ROOT,
            ).splitlines()
        }
        for how in ("with", "beside")
        for groups in ("run", "all")
    }  # fmt: skip
    for how in ("with", "beside"):
        assert found[how, "all"] > found[how, "run"] >= {"scipy", "matplotlib", "ezdxf", "ipctk"}
        assert found[how, "all"] - found[how, "run"] >= {"pytest", "sphinx", "ruff"}
        assert ("dolfinx-solver-real" in found[how, "run"]) == (how == "with")
