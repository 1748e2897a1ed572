"""Signals that ask a run to stop, or to write its state, at the end of a step."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
from mpi4py import MPI

# Open MPI's mpirun passes the second user signal on, but ends the ranks itself at the others.
STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR2)


class Signals:
    """Handlers of SIGINT, SIGTERM and the user signals while a run is open.

    SIGUSR1 asks for a write, the others for an end: the first of them at the end of the step.
    Where nothing is to be written, outside of design loops, or at a second one, the run stops at
    once by `stop`. Handlers are installed in the main thread alone.

    Attributes:
        waits: Whether a design loop will look at what is asked soon.
        stopped_at_once: Number of the signal that did not wait; 0 for none.
    """

    def __init__(self, comm: MPI.Comm, stop: Callable[[int], None]) -> None:
        self._comm, self._stop = comm, stop
        self._asked, self._write = 0, False
        self.waits = False
        self.stopped_at_once = 0
        self._before: dict[int, Any] = {}

    def install(self) -> None:
        """Install the handlers."""
        if threading.current_thread() is threading.main_thread():
            for number in (*STOPS, signal.SIGUSR1):
                self._before[number] = signal.signal(number, self._handle)

    def restore(self) -> None:
        """Restore the handlers from before."""
        for number, handler in self._before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        self._before.clear()

    def _handle(self, number: int, _: FrameType | None) -> None:
        if number == signal.SIGUSR1:
            self._write = True
            return
        again, self._asked = self._asked > 0, number
        if again and self._comm.size > 1:  # the others may wait for this rank
            sys.stderr.write("stopped at once; the state on disk is that of the last write\n")
            sys.stderr.flush()
            self._comm.Abort(128 + number)
        if again or (self._comm.size == 1 and not self.waits):
            self.stopped_at_once = number
            self._stop(number)

    def asked(self, comm: MPI.Comm) -> tuple[int, bool]:
        """Return the signal that asks for an end, or 0, and whether to write (collective)."""
        found = np.zeros(2, dtype=np.int64)
        own = np.array([self._asked, self._write], dtype=np.int64)
        self._write = False
        comm.Allreduce(own, found, op=MPI.MAX)
        return int(found[0]), bool(found[1])
