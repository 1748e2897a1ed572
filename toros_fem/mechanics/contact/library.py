"""The IPC Toolkit, imported by the first scene that has contact."""

from __future__ import annotations

from typing import Any

from toros_fem.base.errors import MissingPackageError


def ipctk() -> Any:
    """Return the module `ipctk`, which then works on one thread: its sums keep their order.

    Raises:
        MissingPackageError: It is not installed.
    """
    try:
        import ipctk as module
    except ImportError as error:
        raise MissingPackageError(
            "contact needs the IPC Toolkit; install it with pip install 'toros_fem[contact]', or "
            "leave the contact out."
        ) from error
    module.set_num_threads(1)
    module.set_logger_level(module.LoggerLevel.error)
    return module
