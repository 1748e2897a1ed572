"""The lock of a run folder, which a process that has died does not hold."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import stat
from pathlib import Path

from toros_fem.base.errors import OutputError

NAME = ".lock"
# What the lock of a run begins with, where it is not empty.
HOLDER = b"process "


class FolderLock:
    """Lock of a folder that exists for this process (one rank).

    The kernel frees it when the process ends, however it ends.

    Raises:
        OutputError: Another process holds it; the message names process and host. Or a link or a
            file of somebody else has its name.
        OSError: The folder cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / NAME
        foreign = OutputError(f"{path} is no lock of a run. Move it, or choose another folder.")
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            self._file: int | None = os.open(path, flags, 0o644)
        except OSError as caught:
            strange = caught.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO)
            raise (foreign if strange else caught) from None
        about = os.fstat(self._file)
        own = stat.S_ISREG(about.st_mode) and about.st_nlink == 1
        if not own or os.pread(self._file, len(HOLDER), 0) not in (b"", HOLDER):
            self.release()
            raise foreign
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as caught:
            holder = os.read(self._file, 200).decode(errors="replace").strip()
            self.release()
            in_use = OutputError(
                f"{folder} is in use by a run{f', {holder}' if holder else ''}. Wait for its end, "
                "stop it, or choose another folder."
            )
            # Any other error is that of a file system without locks.
            raise (in_use if isinstance(caught, BlockingIOError) else caught) from None
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)

    def release(self) -> None:
        """Free the lock."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
