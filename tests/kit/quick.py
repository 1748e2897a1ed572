"""The contracts, and the tests of what changed: `python3 -m kit.quick`, by `make quick`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from helpers.scenes import ROOT


def changed() -> list[str]:
    """Return the files that differ from the main branch, or from the commit before on it."""

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    base = git("merge-base", "HEAD", "main")
    if base == git("rev-parse", "HEAD"):
        base = git("rev-parse", "HEAD~1")
    new = git("ls-files", "--others", "--exclude-standard")
    return [*git("diff", "--name-only", base).split("\n"), *new.split("\n")]


def tests_of(path: str) -> Path | None:
    """Return the folder of tests that mirrors a file's own."""
    parts = Path(path).parent.parts
    if not parts or not path.endswith(".py"):
        return None
    if parts[0] in ("toros_fem", "tests"):
        parts = parts[1:]
    while parts and not (ROOT / "tests" / Path(*parts)).is_dir():
        parts = parts[:-1]
    return ROOT / "tests" / Path(*parts) if parts else None


def main() -> None:
    folders = {ROOT / "tests" / "contracts"}
    folders |= {found for found in map(tests_of, changed()) if found is not None}
    folders = {one for one in folders if not any(one.is_relative_to(o) for o in folders - {one})}
    names = sorted(str(folder.relative_to(ROOT)) for folder in folders)
    print("quick:", *names)
    words = ["-q", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", "-m", "not slow"]
    sys.exit(subprocess.run([sys.executable, "-m", "pytest", *words, *names], cwd=ROOT).returncode)


if __name__ == "__main__":
    main()
