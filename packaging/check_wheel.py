"""Build source archive and wheel, and use the wheel in an environment without the checkout.

    scripts/fenicsx python3 packaging/check_wheel.py --output dist

FEniCSx is that of the calling Python: its packages are visible in the new environment. Nothing is
downloaded. The checkout is copied before it is built, so that nothing is left in it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PARTS = ("toros_fem", "forms", "meshes", "pyproject.toml", "README.md", "COPYING", "COPYING.LESSER")


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Run a command without this checkout in its path; return what it printed."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMI"))}
    inherited.pop("PYTHONPATH", None)
    # MPI from wheels is looked for in the environment of the calling Python alone.
    if (library := Path(sys.prefix) / "lib" / "libmpi.so.12").exists():
        inherited["MPI4PY_LIBMPI"] = str(library)
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env={**inherited, **environment}, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        sys.exit(f"{command[0]} failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def build(work: Path) -> tuple[Path, Path]:
    """Return source archive and wheel of the checkout, the wheel built from the archive."""
    source = work / "source"
    for part in PARTS:
        if (ROOT / part).is_dir():
            ignore = shutil.ignore_patterns("__pycache__", "*.egg-info")
            shutil.copytree(ROOT / part, source / part, ignore=ignore)
        else:
            shutil.copy(ROOT / part, source / part)
    run(
        sys.executable, "-m", "build", "--no-isolation", "--outdir", work / "dist", source, cwd=work
    )
    (archive,), (wheel,) = (work / "dist").glob("*.tar.gz"), (work / "dist").glob("*.whl")
    return archive, wheel


def missing_files(archive: Path, wheel: Path, source: Path) -> list[str]:
    """Return the files of the package, data too, and the licences that an archive lacks."""
    with tarfile.open(archive) as tar:
        packed = {name.partition("/")[2] for name in tar.getnames()}
    with zipfile.ZipFile(wheel) as installed:
        names = set(installed.namelist())
    missing = [name for name in ("COPYING", "COPYING.LESSER") if name not in packed]
    for folder in ("toros_fem", "forms", "meshes"):
        for path in (source / folder).rglob("*"):
            if path.is_file() and "egg-info" not in str(path):
                place = path.relative_to(source).as_posix()
                inside = place if folder == "toros_fem" else f"toros_fem/{place}"
                missing += [place] * (place not in packed) + [inside] * (inside not in names)
    return missing


def check(wheel: Path, work: Path) -> str:
    """Install a wheel into a new environment and use it there; return what it says."""
    venv = work / "venv"
    run(sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", venv, cwd=work)
    site = next(venv.glob("lib/python3*/site-packages"))
    # The calling Python may itself be a virtual environment, which the new one does not see.
    seen = [entry for entry in sys.path if entry.endswith("-packages")]
    (site / "parent.pth").write_text("\n".join(seen) + "\n", encoding="utf-8")
    python = venv / "bin" / "python"
    install = (
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        "--disable-pip-version-check",
    )
    run(python, *install, "--ignore-installed", wheel, cwd=work)
    said = run(python, ROOT / "packaging" / "tiny_solve.py", cwd=work)
    if str(venv) not in said:
        sys.exit(f"the package that was used is not the installed one: {said}")
    usage = run(venv / "bin" / "toros", "--help", cwd=work)
    if "Usage: toros" not in usage:
        sys.exit(f"the command toros does not say how it is used:\n{usage}")
    return said


def main() -> None:
    """Build and check, and keep the archives if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, help="folder that the archives are copied to")
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as folder:
        archive, wheel = build(Path(folder))
        missing = missing_files(archive, wheel, Path(folder) / "source")
        if missing:
            sys.exit(f"the archives lack {', '.join(missing)}")
        print(check(wheel, Path(folder)).strip())
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
            for path in (archive, wheel):
                shutil.copy(path, output)
                print(output / path.name)


if __name__ == "__main__":
    main()
