"""Home and cache of a process that has none, or may not write there."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

HOME, CACHE = "HOME", "XDG_CACHE_HOME"


def use_writable_places() -> None:
    """Let home and cache be folders that can be used, where they are not, in the temporary one.

    Open MPI does not start without a home, and forms are compiled into the cache. All ranks of a
    machine take the same folder.
    """
    home = os.environ.get(HOME, "")
    if not os.path.isdir(home) and (spare := _spare()):
        os.environ[HOME] = home = str(spare)
    cache = os.environ.get(CACHE) or os.path.join(home, ".cache")
    if not _writable(Path(cache)) and (spare := _spare()):
        os.environ[CACHE] = str(spare)


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError):
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _spare() -> Path | None:
    """Return a temporary folder of this user alone; None if somebody else has its name."""
    folder = Path(tempfile.gettempdir()) / f"toros_fem-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid()
    return folder if own and not about.st_mode & 0o022 else None
