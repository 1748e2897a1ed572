"""The IPC Toolkit, imported where a scene has contact."""

from __future__ import annotations

from typing import Any

from toros_fem.errors import MissingPackageError


def ipctk() -> Any:
    """Return the module `ipctk`.

    Raises:
        MissingPackageError: It is not installed.
    """
    try:
        import ipctk as module
    except ImportError as error:
        raise MissingPackageError(
            "contact needs the IPC Toolkit; install it with pip install toros_fem[contact]."
        ) from error
    module.set_num_threads(1)  # sums in one order: the same result in every run
    return module
