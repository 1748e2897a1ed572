"""Parser of command lines: an unknown word is answered by the nearest known one."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from toros_fem.base.errors import TorosError
from toros_fem.base.keys import nearest


class UsageError(TorosError, ValueError):
    """The command line is not understood; the message names the word and the nearest known one."""


class SuggestingParser(argparse.ArgumentParser):
    """A parser that suggests the nearest option or command for an unknown one, by a UsageError.

    Only the first rank prints.
    """

    def __init__(self, *, first_rank: bool, **rest: Any) -> None:
        self._first_rank = first_rank
        super().__init__(
            formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False, **rest
        )

    def error(self, message: str) -> NoReturn:
        """Raise an error instead of the end of the program."""
        raise UsageError(f"{self.prog}: {message}")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and refuse options that are not known, with the nearest of this very command."""
        found, extra = super().parse_known_args(args, namespace)
        options = [word.partition("=")[0] for word in extra if word.startswith("--")]
        if options:
            known = [flag for action in self._actions for flag in action.option_strings]
            advice = nearest(options[0], known, "--help lists all options.")
            self.error(f"unknown option {options[0]}; {advice}")
        change = next((word for word in extra if "=" in word), None)
        if change is not None and "--set" in self._option_string_actions:
            self.error(f"{change} stands alone; write --set before each KEY=VALUE.")
        return found, extra

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            what = str(action.metavar or action.dest).lower()
            self.error(f"unknown {what} {value!r}; {nearest(value, map(str, action.choices))}")

    def _print_message(self, message: str, file: Any = None) -> None:
        if self._first_rank:
            super()._print_message(message, file)
