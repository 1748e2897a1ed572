"""Materials of a scene by name: the numbers that a name of the library stands for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Table
from toros_fem.base.scene import Scene
from toros_fem.materials.library import LibraryMaterial, named, print_offset, reinforced
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
# Fields that not every kind of scene has; a number of them may stand beside the name.
MASSES = ("fabric_mass", "print_mass")
# Fields of the fabric's sheet, as `Material` takes them.
SHEET = ("fabric_young", "poisson", "thickness", "c1", "c2")
# Field that a printed layer sets beside these: where the neutral plane of print and fabric lies.
OFFSET = "print_offset"


def roles_of(config: Table | Scene | type[Scene]) -> tuple[str, ...]:
    """Return the roles that materials have in a configuration; none where it has no materials."""
    return tuple(role for role, names in FIELDS.items() if next(iter(names)) in config.described())


@dataclass
class NamedMaterials:
    """Names of materials and numbers of their fields, given one layer after the other.

    Attributes:
        library: The materials by name.
        names: Name of the material in each role.
        numbers: Fields of the roles that were given as numbers, later than the role's name.
    """

    library: Mapping[str, LibraryMaterial]
    names: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, Any] = field(default_factory=dict)

    def entry(self, role: str, name: str) -> LibraryMaterial:
        """Return the material of a name in a role.

        Raises:
            LibraryError: The library has none of this name, or it is of another kind.
        """
        return named(self.library, name, KIND_OF[role])

    def conflict(self, values: Mapping[str, Any]) -> tuple[str, str] | None:
        """Return a role and a number that is given beside its name; None without.

        Args:
            values: Names by their roles, and numbers by their fields.

        Raises:
            LibraryError: The library has none of this name, or it is of another kind.
        """
        for role in (role for role in FIELDS if role in values):
            given = _values(role, self.entry(role, values[role]))
            # A bladder is poured as thick as one likes: its number goes beside the name.
            beside = ("bladder_thickness", *MASSES)
            number = next((k for k in values if k in given and k not in beside), None)
            if number is not None:
                return role, number
        return None

    def resolve(
        self, config: Table | Scene, default: Table | Scene, values: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return a further layer of values, with numbers in the place of names.

        A name replaces earlier numbers, a number those of an earlier name.

        Args:
            config: The configuration so far.
            default: That with the defaults.
            values: Names by their roles, and numbers by their fields.

        Raises:
            LibraryError: The library has none of this name, or it is of another kind.
            ParameterError: A value has no field in the configuration.
        """
        names = {role: values[role] for role in FIELDS if role in values}
        rest = {key: value for key, value in values.items() if key not in names}
        for role, name in names.items():
            for key in _values(role, self.entry(role, name)):
                self.numbers.pop(key, None)
        self.names.update(names)
        fields = [OFFSET, *(key for role in FIELDS.values() for key in role)]
        self.numbers.update({key: rest[key] for key in rest if key in fields})
        return {**rest, **self._numbers(config, default)}

    @property
    def entries(self) -> dict[str, LibraryMaterial]:
        """The material of each role that has a name, the fabric first."""
        return {role: self.entry(role, self.names[role]) for role in FIELDS if role in self.names}

    def _numbers(self, config: Table | Scene, default: Table | Scene) -> dict[str, Any]:
        """Return the fields of a configuration that names and numbers stand for.

        A print that is the printed layer alone goes onto the fabric of the configuration.

        Args:
            config: The configuration so far, whose fabric a print goes onto.
            default: That with the defaults; fields of a role that its material does not have.

        Raises:
            ParameterError: A value has no field in the configuration.
        """
        known, found = config.described(), dict[str, Any]()
        for role, entry in self.entries.items():
            values = _values(role, entry)
            values = {k: v for k, v in values.items() if k in known or k not in MASSES}
            for key in values:
                if key not in known:
                    raise ParameterError(
                        f"{role}: {entry.name!r} has a {key}, which scenes of this kind have not. "
                        "Give its other numbers instead of its name."
                    )
            found |= {key: default.value(key) for key in FIELDS[role] if key in known}
            found |= values
            if role == "reinforcement":
                names = [key for key in FIELDS["fabric"] if key in known]
                fabric = {key: config.value(key) for key in names} | found | self.numbers
                laid = _laid(fabric, entry, default.value(OFFSET) if OFFSET in known else None)
                found |= {key: value for key, value in laid.items() if key in known}
        return {**found, **self.numbers}


def _values(role: str, entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields that a material has a value for."""
    values = {key: getattr(entry, name) for key, name in FIELDS[role].items()}
    if entry.with_fabric:  # its density is that of both
        values.pop("print_mass", None)
    return {key: value for key, value in values.items() if value is not None}


def _laid(
    fabric: Mapping[str, Any], entry: LibraryMaterial, offset: float | None
) -> dict[str, Any]:
    """Return the fields of the reinforcement of a fabric.

    Args:
        fabric: Fields of the fabric.
        entry: The print.
        offset: Offset of a print that is one sheet with its fabric.
    """
    if entry.with_fabric:
        return {OFFSET: offset}
    plain = Material(*(fabric[key] for key in SHEET))
    sheet = reinforced(plain, entry.material)
    names = {k: name for k, name in FIELDS["reinforcement"].items() if k not in MASSES}
    values = {key: getattr(sheet, name) for key, name in names.items()}
    for name in ("c1", "c2"):  # bounds of the fabric stay those of the fabric
        if values[f"reinforcement_{name}"] == fabric[name]:
            values[f"reinforcement_{name}"] = None
    return {**values, OFFSET: print_offset(plain, entry.material)}
