"""Library of materials: fabrics, prints and rubbers by name, with source, trust and range."""

from toros_fem.materials.library.files import named, read_library, write_material
from toros_fem.materials.library.material import MATERIAL_KINDS, TRUSTS, LibraryMaterial
from toros_fem.materials.library.reinforced import print_offset, reinforced

__all__ = [
    "MATERIAL_KINDS",
    "TRUSTS",
    "LibraryMaterial",
    "named",
    "print_offset",
    "read_library",
    "reinforced",
    "write_material",
]
