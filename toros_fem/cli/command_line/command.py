"""A command of `toros`: its help, its options, and what it does."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

log = logging.getLogger("toros_fem.cli.commands")


@dataclass(frozen=True)
class Answer:
    """What a command found.

    Attributes:
        text: Lines for a reader.
        figures: The same for a program, as `--json` prints it.
        code: Exit code.
    """

    text: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    code: int = 0


@dataclass(frozen=True)
class Command:
    """A command of `toros`.

    Attributes:
        details: What it does, in some lines.
        examples: Lines that may be typed.
        add_options: Adds its options to a parser.
        run: Runs it on all ranks (collective); the options are in the namespace.
    """

    details: str
    examples: tuple[str, ...]
    add_options: Callable[[argparse.ArgumentParser], None]
    run: Callable[[MPI.Comm, argparse.Namespace], Answer]
