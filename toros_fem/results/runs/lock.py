"""The lock of a run folder, which a process that has died does not hold."""

from __future__ import annotations

import fcntl
import os
import socket
from pathlib import Path

from toros_fem.base.errors import RunError

NAME = ".lock"


class FolderLock:
    """Lock of a folder for this process (one rank).

    The kernel frees it when the process ends, however it ends.

    Args:
        folder: The folder, which exists.

    Raises:
        RunError: Another process holds it; the message names process and host.
        OSError: The folder cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        self._file: int | None = os.open(folder / NAME, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(self._file, 200).decode(errors="replace").strip()
            self.release()
            raise RunError(
                f"{folder} is in use by a run{f', {holder}' if holder else ''}. Wait for its end, "
                "stop it, or choose another folder."
            ) from None
        except OSError:  # a file system without locks
            self.release()
            raise
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)

    def release(self) -> None:
        """Free the lock."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
