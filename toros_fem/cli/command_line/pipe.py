"""Standard output and standard error, which may be closed, full, or lack some letters."""

from __future__ import annotations

import contextlib
import io
import os
from typing import Any, TextIO


class OpenPipe:
    """A stream that goes on into nothing once it cannot be written: a run does not end for that.

    Its reader may go, as `head` does, its disk be full, or it be closed, None. Letters that its
    encoding lacks are written as their numbers. The fault is why it could not be written; None
    where it could, and where its reader went.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream: TextIO = io.StringIO() if stream is None else stream
        self.fault: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text, or drop it."""
        try:
            return self._stream.write(text)
        except UnicodeEncodeError as caught:
            known = text.encode(caught.encoding, "backslashreplace").decode(caught.encoding)
            return self.write(known)
        except OSError as caught:
            self._drop(caught)
        return len(text)

    def flush(self) -> None:
        """Write what is held back, or drop it."""
        try:
            self._stream.flush()
        except OSError as caught:
            self._drop(caught)

    def __getattr__(self, name: str) -> Any:
        """Return what else the stream has."""
        return getattr(self._stream, name)

    def _drop(self, why: OSError) -> None:
        if not isinstance(why, BrokenPipeError):
            self.fault = why
        # What the stream still holds would fail again when Python ends.
        nothing = os.open(os.devnull, os.O_WRONLY)
        with contextlib.suppress(OSError):  # a stream without a file
            os.dup2(nothing, self._stream.fileno())
        os.close(nothing)
