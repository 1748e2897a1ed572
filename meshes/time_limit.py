"""A limit on the time that other packages take for a file."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


class TimeLimitError(Exception):
    """An action took longer than allowed."""


def within(seconds: float, action: Callable[[], T]) -> T:
    """Return the result of an action, which is interrupted after a time.

    Loops of Python code are interrupted, calls of compiled code are not.

    Args:
        seconds: The longest time.
        action: The action.

    Raises:
        TimeLimitError: It took longer.
    """
    lock, done, thread = threading.Lock(), False, threading.get_ident()

    def interrupt() -> None:
        with lock:
            if not done:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(
                    ctypes.c_ulong(thread), ctypes.py_object(TimeLimitError)
                )

    watch = threading.Timer(seconds, interrupt)
    watch.daemon = True
    watch.start()
    try:
        return action()
    finally:
        with lock:
            done = True
        watch.cancel()
