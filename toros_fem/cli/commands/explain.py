"""`toros explain`: what a key of a scene file means."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from typing import Annotated, Any, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import OneOf, key, nearest
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.parser import UsageError
from toros_fem.products.kinds import KINDS


@dataclass(frozen=True, kw_only=True)
class Explain(Command):
    """Says what a key of a scene file means.

    Meaning, unit, bounds and the default in each kind of scene, as `toros new` writes them.
    """

    kind: Annotated[str, OneOf(tuple(KINDS))] | None = key(
        None, "kind of the scene; none: all that have the key"
    )
    key: str = key(MISSING, "key of a scene file, such as filter_radius")

    WORDS: ClassVar = ("key",)
    TAKES: ClassVar = {"kind": "KIND"}
    EXAMPLES: ClassVar = (
        "toros explain filter_radius",
        "toros explain design.levels --kind walker",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Look the key up in all kinds, or in one (collective: kinds are loaded)."""
        name, every = self.key.rpartition(".")[2], set[str]()
        found: dict[tuple[str, str], dict[str, str]] = {}
        for kind in [KINDS[self.kind]] if self.kind else KINDS.values():
            for table, of in {**kind.tables(), **kind.entries()}.items():
                every |= of.described().keys()
                if one := of.described().get(name):
                    value = kind().value(name) if table in kind.tables() else one.default
                    defaults = found.setdefault((table, one.help), {})
                    defaults[kind.KIND] = one.written(value).strip('"')
        if not found and name in KINDS:
            raise UsageError(
                f"toros explain: {name} is a kind of scene; `toros new {name} FILE --all` writes "
                "its keys."
            )
        if not found:
            raise UsageError(f"toros explain: unknown key {name!r}; {nearest(name, sorted(every))}")
        lines, entries = [], list[dict[str, Any]]()
        for (table, text), defaults in found.items():
            lines += [f"[{table}] {name}: {text}"]
            lines += [f"  default {value:14} of {kind}" for kind, value in defaults.items()]
            entries.append({"table": table, "help": text, "default": defaults})
        return Answer("\n".join(lines), {"key": name, "found": entries})
