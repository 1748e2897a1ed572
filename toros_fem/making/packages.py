"""Packages that the machine files need, and that come with an extra."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from toros_fem.base.errors import MissingPackageError


def required(name: str) -> Any:
    """Return a package of the extra `manufacture`, or raise a MissingPackageError."""
    try:
        return import_module(name)
    except ImportError as missing:
        raise MissingPackageError(
            f"machine files need {name} ({missing}); in the checkout: pip install '.[manufacture]'"
        ) from None
