"""Pin what pip installs: the newest versions that install together, into scripts/lock/.

    python3.12 packaging/lock.py

It runs in the oldest Python that is supported: newer versions of packages may
not install there. Run the suite both ways with what it writes.
"""

from __future__ import annotations

import subprocess
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# A distribution that has FEniCSx has these too, in versions that belong together.
FENICSX = (
    "cffi", "cvxopt", "dolfinx-solver-real", "fenics-basix", "fenics-ffcx", "fenics-ufl", "gmsh",
    "h5py", "meshio", "mpi4py", "mpich", "numpy", "pycparser", "scipy",
)  # fmt: skip


def main() -> None:
    """Install all groups without pins, and write down what came."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(item for group in groups for item in group)]
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        pip = [f"{folder}/bin/python", "-m", "pip", "--disable-pip-version-check"]
        subprocess.run([*pip, "install", "-q", *wanted], check=True)
        freeze = [*pip, "freeze", "--all", "--exclude", "pip"]
        found = subprocess.run(freeze, check=True, capture_output=True, text=True).stdout
    pins = sorted(line.lower().replace("_", "-") for line in found.split() if "==" in line)
    for name, inside in (("fenicsx", True), ("extras", False)):
        chosen = [pin for pin in pins if (pin.partition("==")[0] in FENICSX) == inside]
        text = "# Written by packaging/lock.py.\n" + "\n".join(chosen) + "\n"
        (ROOT / "scripts" / "lock" / f"{name}.txt").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
