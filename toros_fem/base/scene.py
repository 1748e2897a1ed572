"""Scenes: all numbers of a design or a simulation, in tables by subject."""

from __future__ import annotations

import functools
import typing
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Self

from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Key, Need, Table, nearest
from toros_fem.base.mpi import require_comm

# Order of tables in files.
ORDER = (
    "target", "object", "skin", "held", "printed", "plain", "material", "pressure", "load",
    "contact", "pull", "objective", "metric", "design", "lines", "print", "results",
)  # fmt: skip
# Marks a field of a scene that is no table of its file.
NO_TABLE: Mapping[str, bool] = MappingProxyType({"outside": True})


class Scene(Table):
    """Base of all scenes: each field is a table of the file, or a tuple of tables of one type.

    A key stands in one table only, so that its name is enough where values are given.

    Attributes:
        FEW: Keys that a new user changes.
        COARSE: Factors of the quick variant, by key.
        DESIGN_FILES, SIMULATION_FILES: Files or folders that a design or a simulation can take, by
            name, with their help.
        EXAMPLE_FILES: Files that a new scene file names.
        OUTLINE: Keys by the words of an `OutlineError` that they are given as.
        NEEDS: What keys need to count in scenes of this kind; tables may have it for their own.
    """

    KIND: ClassVar[str] = ""
    FEW: ClassVar[tuple[str, ...]] = ()
    COARSE: ClassVar[Mapping[str, float]] = {}
    DESIGN_FILES: ClassVar[Mapping[str, str]] = {}
    SIMULATION_FILES: ClassVar[Mapping[str, str]] = {}
    EXAMPLE_FILES: ClassVar[Mapping[str, str]] = {}
    OUTLINE: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[Mapping[str, Need]] = {}

    @classmethod
    def example(cls) -> Self:
        """Return what a new scene file holds: the defaults, if a kind says nothing else."""
        return cls()

    @classmethod
    def pose_keys(cls) -> dict[str, Key]:
        """Return the keys that a further pose may have, by name; none where there are none."""
        return {}

    @classmethod
    def files(cls) -> dict[str, str]:
        """Return the files that a design or a simulation can take, with their help."""
        return {**cls.DESIGN_FILES, **cls.SIMULATION_FILES}

    def of_first_rank(self, comm: MPI.Comm) -> Self:
        """Return the scene of the first rank, whatever the others have (collective)."""
        require_comm(comm)
        return self if comm.size == 1 else comm.bcast(self, root=0)

    def with_files(self, comm: MPI.Comm, files: Mapping[str, Path]) -> Self:
        """Return the scene with what its files hold, by the names in `DESIGN_FILES` (collective).

        Most scenes need none. A TorosError says that one cannot be read, or does not fit.
        """
        del comm, files
        return self

    def groups(self) -> Iterator[Any]:
        """Yield the groups of the scene that are known, of `products.plausibility`."""
        return iter(())

    @classmethod
    def needs(cls) -> dict[str, Need]:
        """Return what keys need to count, by name."""
        own = [getattr(of, "NEEDS", {}) for of in (*cls.tables().values(), cls)]
        return {name: need for of in own for name, need in of.items()}

    def idle(self) -> Iterator[tuple[str, Need]]:
        """Yield the keys that do not count, and what they need; not those left at a default."""
        needs, plain = self.needs(), type(self)()
        left = (plain, plain.coarse()) if needs else ()
        for name, (other, needed) in needs.items():
            value = self.value(other)
            counts = value in needed if needed else value is not None
            if not counts and self.value(name) not in [one.value(name) for one in left]:
                yield name, (other, needed)

    def coarse(self) -> Self:
        """Return the quick variant, a coarse mesh and few steps: values times `COARSE`."""
        return self.updated(**self.coarse_values())

    def coarse_values(self) -> dict[str, Any]:
        """Return the values of the quick variant by key: as many steps as each key needs."""
        known, found = self.described(), dict[str, Any]()
        for key, factor in self.COARSE.items():
            value, least = self.value(key), known[key].within.at_least
            if isinstance(value, int) and value > 0:
                found[key] = max(1, least, round(factor * value))
            elif value:  # what is left out stays so
                found[key] = round(factor * value, 9)
        return found

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return a scene with other values than the defaults, by the names of keys."""
        return cls().updated(**values)

    @classmethod
    def _layout(cls) -> _Layout:
        return _layout_of(cls)  # type: ignore[arg-type]

    @classmethod
    def tables(cls) -> Mapping[str, type[Table]]:
        """Return the type of each table that stands once, by its name, in the order of files."""
        return cls._layout().once

    @classmethod
    def entries(cls) -> Mapping[str, type[Table]]:
        """Return the type of each table that may stand several times, by its name."""
        return cls._layout().several

    @classmethod
    def _own_keys(cls) -> dict[str, Key]:
        """Return its tables, as keys."""
        hints = typing.get_type_hints(cls)
        once = {n: Key(n, hints[n], of, of.holds()) for n, of in cls.tables().items()}
        several = {
            name: Key(name, hints[name], of, of.holds(), several=True)
            for name, of in cls.entries().items()
        }
        return once | several

    @classmethod
    def described(cls) -> dict[str, Key]:
        """Return what is known of each key, by name, of the tables that stand once."""
        return {name: key for of in cls.tables().values() for name, key in of.described().items()}

    @classmethod
    def table_of(cls, key: str) -> str:
        """Return the name of the table that a key stands in."""
        return cls._layout().homes[key]

    def updated(self, **changes: Any) -> Self:
        """Return a copy with other values, by the names of their keys, or whole tables by theirs.

        Raises:
            ParameterError: A name is unknown, or a value is out of its bounds.
        """
        layout, own = self._layout(), {one.name for one in fields(self)}
        whole, by_table = dict[str, Any](), dict[str, dict[str, Any]]()
        for name, value in changes.items():
            if name in own and (isinstance(value, Table) or name in layout.several):
                whole[name] = value
            elif name in layout.homes:
                by_table.setdefault(layout.homes[name], {})[name] = value
            else:
                advice = nearest(name, layout.homes)
                raise ParameterError(f"unknown parameter {name!r}; {advice}", name)
        for table, values in by_table.items():
            whole[table] = whole.get(table, getattr(self, table)).updated(**values)
        return super().updated(**whole)

    def as_dict(self) -> dict[str, Any]:
        """Return all values by the names of their keys, as summaries hold them."""
        several = {name: [asdict(one) for one in getattr(self, name)] for name in self.entries()}
        return {**{name: self.value(name) for name in self.described()}, **several}

    def fixed_and_free(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the values by key that tell a run from others, and those that may change."""
        values, known = self.as_dict(), self.described()
        free = {key: values.pop(key) for key in known if known[key].free}
        return values, free

    def value(self, name: str) -> Any:
        """Return the value of a key of a table that stands once."""
        return getattr(getattr(self, self.table_of(name)), name)


@dataclass(frozen=True)
class _Layout:
    """Types of the tables that stand once and of the others, and the table of each key."""

    once: Mapping[str, type[Table]]
    several: Mapping[str, type[Table]]
    homes: Mapping[str, str]


@functools.cache
def _layout_of(scene: type[Scene]) -> _Layout:
    """Return the layout of a type of scenes; a TypeError where a key stands in two tables."""
    hints = typing.get_type_hints(scene)
    tables = [one.name for one in fields(scene) if not one.metadata.get("outside")]
    parts = {name: typing.get_args(hints[name]) for name in sorted(tables, key=ORDER.index)}
    once = {name: hints[name] for name, of in parts.items() if not of}
    several = {name: of[0] for name, of in parts.items() if of}
    keys = [(key, name) for name, of in once.items() for key in of.described()]
    if len(dict(keys)) < len(keys):
        raise TypeError(f"{scene.__name__} has a key in two tables: {keys}.")
    return _Layout(once, several, dict(keys))
