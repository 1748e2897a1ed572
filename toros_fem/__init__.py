"""Designs robotic skins: stiffening patterns that make an inflated fabric bend, twist or grip."""

from pathlib import Path

from toros_fem._version import __version__

# In a checkout `forms/` and `meshes/` lie beside this folder, in an installed package inside it.
if not (Path(__file__).parent / "forms").is_dir():
    __path__.append(str(Path(__file__).parent.parent))

__all__ = ["__version__"]
