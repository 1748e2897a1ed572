"""Materials of a scene by name: the numbers that a name of the library stands for."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Table
from toros_fem.base.scene import Scene
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.materials.library.reinforced import print_offset, reinforced
from toros_fem.materials.sheet import Material

# Table of the scene, key that names a file of materials, and the role of each name: the kind of
# material, and the fields that it stands for.
TABLE, FILE = "material", "materials"
KIND_OF: Mapping[str, str] = MappingProxyType(
    {"fabric": "fabric", "reinforcement": "print", "bladder": "rubber"}
)
FIELDS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "fabric": {
            "fabric_young": "young",
            "poisson": "poisson",
            "thickness": "thickness",
            "c1": "c1",
            "c2": "c2",
            "knit_ratio": "knit_ratio",
            "fabric_mass": "density",
        },
        "reinforcement": {
            "reinforcement_young": "young",
            "reinforcement_poisson": "poisson",
            "reinforcement_thickness": "thickness",
            "reinforcement_c1": "c1",
            "reinforcement_c2": "c2",
            "print_mass": "density",
        },
        "bladder": {"bladder_young": "young", "bladder_thickness": "thickness"},
    }
)
# Fields that not every kind of scene has.
MASSES = ("fabric_mass", "print_mass")
# Fields of the fabric's sheet, as `Material` takes them.
SHEET = ("fabric_young", "poisson", "thickness", "c1", "c2")
# Field that a printed layer sets beside these: where the neutral plane of print and fabric lies.
OFFSET = "print_offset"


def roles_of(config: Table | Scene | type[Scene]) -> tuple[str, ...]:
    """Return the roles that materials have in a configuration; none where it has no materials."""
    return tuple(role for role, names in FIELDS.items() if next(iter(names)) in config.described())


def numbers_of(
    materials: Mapping[str, LibraryMaterial], given: Mapping[str, Any], default: Table | Scene
) -> dict[str, Any]:
    """Return the fields that materials stand for, without those that are given as numbers.

    A print that is the printed layer alone goes onto the fabric that names, numbers or defaults
    give.

    Args:
        materials: Material of each role.
        given: Fields given as numbers, which beat those of names.
        default: Configuration with the defaults, also of fields that a material does not have.

    Raises:
        ParameterError: A material has a value for which the configuration has no field.
    """
    known, found = default.described(), dict[str, Any]()
    for role, entry in materials.items():
        values = values_of(role, entry)
        for key in values:
            if key not in known and key not in MASSES:
                raise ParameterError(
                    f"{role}: {entry.name!r} has a {key}, which scenes of this kind have not. "
                    "Give its other numbers instead of its name.",
                    role,
                )
        found |= {key: default.value(key) for key in FIELDS[role] if key in known}
        found |= {key: value for key, value in values.items() if key in known}
    if (layer := materials.get("reinforcement")) is not None:
        if layer.with_fabric:
            laid = {OFFSET: default.value(OFFSET) if OFFSET in known else None}
        else:
            plain = {key: default.value(key) for key in SHEET}
            laid = _laid({**plain, **found, **given}, layer)
        found |= {key: value for key, value in laid.items() if key in known}
    return {key: value for key, value in found.items() if key not in given}


def values_of(role: str, entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields that a material has a value for in its role."""
    values = {key: getattr(entry, name) for key, name in FIELDS[role].items()}
    if entry.with_fabric:  # its density is that of both
        values.pop("print_mass", None)
    return {key: value for key, value in values.items() if value is not None}


def _laid(fabric: Mapping[str, Any], entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields of the reinforcement of a fabric with a printed layer on it."""
    plain = Material(*(fabric[key] for key in SHEET))
    sheet = reinforced(plain, entry.material)
    names = {k: name for k, name in FIELDS["reinforcement"].items() if k not in MASSES}
    values = {key: getattr(sheet, name) for key, name in names.items()}
    for name in ("c1", "c2"):  # bounds of the fabric stay those of the fabric
        if values[f"reinforcement_{name}"] == fabric[name]:
            values[f"reinforcement_{name}"] = None
    return {**values, OFFSET: print_offset(plain, entry.material)}
