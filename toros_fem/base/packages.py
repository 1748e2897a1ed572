"""Packages that come with an extra, and the templates of pages that one of them fills."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from toros_fem.base.errors import MissingPackageError


def required(name: str, extra: str = "manufacture") -> Any:
    """Return a package of an extra, or raise a MissingPackageError."""
    try:
        return import_module(name)
    except ImportError as missing:
        what = f"{name} is needed ({missing})"
        raise MissingPackageError(f"{what}; in the checkout: pip install '.[{extra}]'") from None


def template(package: str, name: str, extra: str = "manufacture") -> Any:
    """Return a file of a package as a template, which escapes all that it is given."""
    jinja2 = required("jinja2", extra)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package, ""), autoescape=True,
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}  # tables have an order
    return environment.get_template(name)
