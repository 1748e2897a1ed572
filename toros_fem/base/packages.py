"""Packages that come with an extra, templates of pages, and names that are loaded late."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
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


def late_names(
    package: str, own: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package whose public names load at the first call.

    They are those of its module `public`; `own` are further ones, which it has from the start.
    """

    def load(name: str) -> Any:
        here = vars(sys.modules[package])
        if name == "__all__" or not name.startswith("__"):
            public = import_module(f"{package}.public")
            here.update({one: getattr(public, one) for one in public.__all__})
            here["__all__"] = [*own, *public.__all__]
            if name in here:
                return here[name]
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def listed() -> list[str]:
        return sorted({*vars(sys.modules[package]), *load("__all__")})

    return load, listed
