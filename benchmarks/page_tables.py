"""Tables that benchmarks write into pages of the documentation, between two marks."""

from __future__ import annotations


def replaced(page: str, begin: str, end: str, text: str) -> str:
    """Return a page with another text between two marks.

    Args:
        page: The page.
        begin, end: The marks, lines of their own.
        text: What stands between them.

    Raises:
        ValueError: The page has no such marks.
    """
    before, found, rest = page.partition(begin)
    _, also, after = rest.partition(end)
    if not found or not also:
        raise ValueError(f"the page needs the lines {begin!r} and {end!r}.")
    return f"{before}{begin}\n\n{text}\n\n{end}{after}"
