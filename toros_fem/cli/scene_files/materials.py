"""Materials of a scene by name: the numbers that a name of the library stands for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Key
from toros_fem.base.scene import Scene
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.materials.sheet import Material, print_offset, reinforced

# The role of each name: the kind of material, and the fields that it stands for.
KIND_OF: Mapping[str, str] = MappingProxyType(
    {"fabric": "fabric", "reinforcement": "print", "bladder": "rubber"}
)
_SHEET = ("poisson", "thickness", "c1", "c2")
_PRINT = {f"reinforcement_{name}": name for name in ("young", *_SHEET)}
FIELDS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "fabric": {
            "fabric_young": "young",
            **{name: name for name in (*_SHEET, "knit_ratio")},
            "fabric_mass": "density",
            "tested_stretch": "tested_stretch",
        },
        "reinforcement": {**_PRINT, "print_mass": "density"},
        "bladder": {"bladder_young": "young", "bladder_thickness": "thickness"},
    }
)
NAMES: Mapping[str, Key] = MappingProxyType(
    {
        role: Key(role, str, str, f"name of a {kind}, for its numbers")
        for role, kind in KIND_OF.items()
    }
)
# Fields that not every kind of scene has.
MASSES = ("fabric_mass", "print_mass")


def names_of(kind: type[Scene]) -> dict[str, Key]:
    """Return the keys that name materials; none where a kind has no materials."""
    known = kind.described()
    return {role: one for role, one in NAMES.items() if next(iter(FIELDS[role])) in known}


def numbers_of(
    default: Scene, layers: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], dict[str, LibraryMaterial]]:
    """Return the values of a scene, and the material of each role that is named.

    A number beats a name beside it or before it, a name the numbers before it. A print that is the
    printed layer alone goes onto the fabric that names, numbers or defaults give. Layers have
    values by key, each over those before; materials by their roles.

    Raises:
        ParameterError: A material has a value for which the scene has no field.
    """
    given, materials = dict[str, Any](), dict[str, LibraryMaterial]()
    for layer in layers:
        for role in (role for role in KIND_OF if role in layer):
            materials[role] = layer[role]
            for key in _values(role, layer[role]):
                given.pop(key, None)
        given |= {key: value for key, value in layer.items() if key not in KIND_OF}

    known, found = default.described(), dict[str, Any]()
    for role, entry in materials.items():
        values = _values(role, entry)
        for key in values:
            if key not in known and key not in MASSES:
                raise ParameterError(
                    f"{role}: {entry.name!r} has a {key}, which scenes of this kind have not. "
                    "Give its other numbers instead of its name.",
                    role,
                )
        found |= values
    printed = materials.get("reinforcement")
    if printed is not None and not printed.with_fabric:
        fabric = {key: default.value(key) for key in ("fabric_young", *_SHEET)} | found | given
        found |= _laid(fabric, printed)
    return {key: value for key, value in found.items() if key in known} | given, materials


def _values(role: str, entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields that a material has a value for in its role."""
    values = {key: getattr(entry, name) for key, name in FIELDS[role].items()}
    if entry.with_fabric:  # its density is that of both
        values.pop("print_mass", None)
    return {key: value for key, value in values.items() if value is not None}


def _laid(fabric: Mapping[str, Any], entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields of the reinforcement of a fabric with a printed layer on it."""
    plain = Material(fabric["fabric_young"], *(fabric[key] for key in _SHEET))
    sheet = reinforced(plain, entry.material)
    values = {key: getattr(sheet, name) for key, name in _PRINT.items()}
    for name in ("c1", "c2"):  # bounds of the fabric stay those of the fabric
        if values[f"reinforcement_{name}"] == fabric[name]:
            values[f"reinforcement_{name}"] = None
    offset = print_offset(plain, entry.material)
    return {**values, "print_offset": offset, "print_height": entry.thickness}
