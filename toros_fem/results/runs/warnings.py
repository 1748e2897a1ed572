"""What a reader must know before trusting the figures of a run, told everywhere alike."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from typing import Any

# What faults of a print end in, as sentences.
FAULTS = {
    "islands": (
        "island of the print hangs on",
        "islands of the print hang on",
        "nothing but the fabric",
    ),
    "narrow_places": (
        "place is narrower than",
        "places are narrower than",
        "the printer's least line",
    ),
    "tight_places": ("gap is narrower than", "gaps are narrower than", "the printer's least gap"),
}
# Pressures that a warning names at most.
MOST_NAMED = 6
# Part of the tested strain by which a skin may stretch further without a warning.
BEYOND = 0.02


class WarningList(logging.Handler):
    """Keeps what the package warns of while it is a handler of the package's logger."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the text of a record, which a summary holds as a sentence."""
        self.texts.append(as_sentence(record.getMessage()))


def as_sentence(text: str) -> str:
    """Return a text with a full stop, and without the mark of a warning of Python."""
    text = text.removeprefix("warning: ").strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def notes_at(notes: Iterable[tuple[float, str]]) -> list[str]:
    """Return notes on equilibria, each with the pressures in Pa that it was made at."""
    at: dict[str, list[float]] = {}
    for pressure, note in notes:
        if note:
            at.setdefault(note, []).append(pressure)
    found = []
    for note, pressures in at.items():
        told = ", ".join(f"{pressure / 1e3:.4g} kPa" for pressure in pressures[:MOST_NAMED])
        found.append(f"At {told}{', …' * (len(pressures) > MOST_NAMED)}: {note}")
    return found


def warnings_of(content: Mapping[str, Any]) -> list[str]:
    """Return what the content of a summary gives reason to warn of, as sentences."""
    made, curve = (content.get(key) or {} for key in ("manufacture", "curve"))
    lift = (content.get("load") or {}).get("printed") or {}
    found = [
        as_sentence(f"{what}: {reason}")
        for what, reason in (
            ("The print has no equilibrium", content.get("printed_failure")),
            ("The lift ends early", lift.get("failure")),
            ("The discretisation error is unknown", (content.get("errors") or {}).get("failure")),
            ("The curve ends before lower pressures", curve.get("failure_below")),
            ("The curve ends before higher pressures", curve.get("failure_above")),
        )
        if reason
    ]
    for key, (one, many, than) in FAULTS.items():
        if number := made.get(key):
            found.append(f"{number} {one if number == 1 else many} {than}.")
    if beyond := beyond_tests(content):
        found.append(beyond)
    return found


def beyond_tests(content: Mapping[str, Any]) -> str:
    """Return that a fabric stretches further than it was tested; empty if not, or not known."""
    known, figures = known_use(content), content.get("figures") or ()
    used = next((row["value"] for row in figures if row["name"] == "stretch"), None)
    if known is None or used is None or used <= (1 + BEYOND) * known:
        return ""
    most, tested = (1 + use * (content["inputs"]["c1"] - 1) for use in (used, known))
    return (
        f"The skin stretches up to about {most:.3g}, and the fabric was tested up to {tested:.3g}: "
        "what is told beyond is eq. (1) and no test. Test the fabric further (toros fit), or take "
        "less pressure."
    )


def known_use(content: Mapping[str, Any]) -> float | None:
    """Return the part of the stretch bounds up to which the fabric was tested; None if unknown."""
    inputs = content.get("inputs") or {}
    tested, bound = inputs.get("tested_stretch"), inputs.get("c1")
    return None if tested is None or bound is None else (tested - 1) / (bound - 1)
