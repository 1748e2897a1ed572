"""CHOLMOD of the package cvxopt, with the order of METIS: where FEniCSx comes from wheels.

These have METIS, but neither CHOLMOD nor its header. cvxopt's calls hold Python's lock, so that
threads wait for each other.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from toros_fem.base.array_types import Floats, LocalInts
from toros_fem.base.errors import TorosError

# Systems of cvxopt's `solve`.
FORWARD, BACKWARD = 4, 5
METIS_OK = 1


class _Factor(ctypes.Structure):
    """The first fields of CHOLMOD's `cholmod_factor`, versions 3 to 5, with long integers."""

    _fields_ = (
        ("n", ctypes.c_size_t),
        ("minor", ctypes.c_size_t),
        *((name, ctypes.c_void_p) for name in ("permutation", "column_count", "inverse")),
        ("nzmax", ctypes.c_size_t),
        *((name, ctypes.c_void_p) for name in ("p", "i", "x", "z", "nz", "next", "prev")),
        *((name, ctypes.c_size_t) for name in ("nsuper", "ssize", "xsize", "maxcsize", "maxesize")),
        *((name, ctypes.c_void_p) for name in ("super", "pi", "px", "s")),
    )


@cache
def load() -> CvxoptCholmod | None:
    """Return the calls; None where cvxopt or METIS is missing, or factors are not as known."""
    wheel = find_spec("dolfinx_solver")
    if wheel is None or wheel.origin is None or find_spec("cvxopt") is None:
        return None
    try:
        found = CvxoptCholmod(Path(wheel.origin).parent / "lib" / "libmetis.so")
        return found if _works(found) else None
    except (ImportError, OSError, AttributeError):
        return None


def _works(cholmod: CvxoptCholmod) -> bool:
    """Return whether the parts of a small factor are where they are read."""
    matrix = np.diag([4.0, 5.0, 6.0]) + np.eye(3, k=1) + np.eye(3, k=-1)
    lower = csc_matrix(np.tril(matrix))
    factor = cholmod.factor(lower.indptr, lower.indices)
    order = cholmod.order(lower.indptr, lower.indices)
    expected = np.linalg.cholesky(matrix)[:0:-1, :0:-1]
    return (
        sorted(order) == [0, 1, 2]
        and factor.factorise(lower.data)
        and np.allclose(factor.corner(2), expected, atol=1e-12)
    )


def too_little_memory(size: int) -> TorosError:
    """Return the error of factors that do not fit into the memory."""
    return TorosError(
        f"too little memory for the factors of {size} unknowns: use a coarser mesh, half a "
        "skin with a symmetry plane, or ranks on several machines."
    )


class CvxoptCholmod:
    """CHOLMOD by cvxopt, see `CompiledCholmod`, and the library METIS with integers of 32 bits."""

    source, threads = "cvxopt", False

    def __init__(self, metis: Path) -> None:
        self._metis = ctypes.CDLL(str(metis))

    def factor(self, pointers: LocalInts, rows: LocalInts) -> CvxoptFactor:
        """Analyse a pattern."""
        return CvxoptFactor(pointers, rows, np.arange(len(pointers) - 1), postorder=False)

    def order(self, pointers: LocalInts, rows: LocalInts) -> LocalInts:
        """Return the order of nested dissection, with the columns of each supernode together."""
        order, inverse = np.zeros((2, len(pointers) - 1), dtype=np.int32)
        self._call("METIS_NodeND", pointers, rows, order, inverse)
        return CvxoptFactor(pointers, rows, order, postorder=True).order()

    def bisect(self, pointers: LocalInts, rows: LocalInts) -> LocalInts:
        """Return the half 0 or 1 of each row, 2 on the separator."""
        size, part = np.zeros(1, dtype=np.int32), np.zeros(len(pointers) - 1, dtype=np.int32)
        self._call("METIS_ComputeVertexSeparator", pointers, rows, size, part)
        return part

    def _call(self, name: str, pointers: LocalInts, rows: LocalInts, *out: LocalInts) -> None:
        """Call METIS with the graph of a pattern, without weights, with its own options."""
        size = len(pointers) - 1
        columns = np.repeat(np.arange(size), np.diff(pointers))
        off = rows != columns
        places = rows[off], columns[off]
        lower = csr_matrix((np.ones(off.sum(), dtype=np.int8), places), shape=(size, size))
        graph = lower + lower.T
        given = [np.array([size], dtype=np.int32), graph.indptr, graph.indices]
        arrays = [array.astype(np.int32).ctypes for array in given]
        call = getattr(self._metis, name)
        if size and call(*arrays, None, None, *(array.ctypes for array in out)) != METIS_OK:
            raise too_little_memory(size)


class CvxoptFactor:
    """Factor of one symmetric matrix by cvxopt; see `Cholesky`.

    With `postorder` CHOLMOD may change the order to an equivalent one, of larger supernodes.
    """

    def __init__(
        self, pointers: LocalInts, rows: LocalInts, order: LocalInts, *, postorder: bool
    ) -> None:
        import cvxopt
        import cvxopt.cholmod

        self._cvxopt, self.size = cvxopt, len(pointers) - 1
        columns = np.repeat(np.arange(self.size), np.diff(pointers))
        indices = [cvxopt.matrix(array.astype(np.int64)) for array in (rows, columns, order)]
        self._matrix = cvxopt.spmatrix(0.0, *indices[:2], (self.size, self.size), "d")
        with self._calling(postorder=postorder):
            self._factor = cvxopt.cholmod.symbolic(self._matrix, p=indices[2])

    def order(self) -> LocalInts:
        """Return the order of elimination."""
        return self._integers("permutation", self.size).astype(np.int32)

    def factorise(self, values: Floats) -> bool:
        """Factorise for the values of the lower triangle; return whether that works."""
        self._matrix.V = self._cvxopt.matrix(values)
        try:
            with self._calling():
                self._cvxopt.cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError:
            return False
        return True

    def forward(self, x: Floats) -> None:
        """Replace x by L⁻¹ x."""
        self._solve(FORWARD, x)

    def backward(self, x: Floats) -> None:
        """Replace x by L⁻ᵀ x."""
        self._solve(BACKWARD, x)

    def corner(self, count: int) -> Floats:
        """Return the block of L of the last rows and columns, both reversed: upper triangular."""
        out: Floats = np.zeros((count, count))
        last, known = self.size - 1, self._read()
        starts = self._integers("super", known.nsuper + 1)
        rows = self._integers("s", known.ssize)
        row_starts, value_starts = (self._integers(name, known.nsuper + 1) for name in ("pi", "px"))
        values = self._array("x", known.xsize, ctypes.c_double)
        # Each supernode is a dense block, column by column; above its diagonal is no value.
        for k in np.flatnonzero(starts[1:] > self.size - count):
            begin, end = starts[k], starts[k + 1]
            places = last - rows[row_starts[k] : row_starts[k + 1]]
            block = values[value_starts[k] :][: len(places) * (end - begin)]
            block = np.tril(block.reshape(end - begin, len(places)).T)
            own = np.arange(max(begin, self.size - count), end)
            below = own[0] - begin
            out[np.ix_(places[below:], last - own)] = block[below:, below:]
        return out

    def _solve(self, system: int, x: Floats) -> None:
        found = self._cvxopt.matrix(x)
        with self._calling():
            self._cvxopt.cholmod.solve(self._factor, found, sys=system)
        x[:] = np.asarray(found).ravel()

    @contextmanager
    def _calling(self, *, postorder: bool = False) -> Iterator[None]:
        """Call with own options, which cvxopt keeps for the process, and name lack of memory."""
        options = self._cvxopt.cholmod.options
        others = dict(options)
        options.clear()
        options.update(supernodal=2, nmethods=1, postorder=postorder)
        try:
            yield
        except MemoryError:
            raise too_little_memory(self.size) from None
        finally:
            options.clear()
            options.update(others)

    def _read(self) -> _Factor:
        """Return CHOLMOD's own structure, which cvxopt hides in a capsule."""
        name, pointer = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
        name.restype, name.argtypes = ctypes.c_char_p, [ctypes.py_object]
        pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
        return _Factor.from_address(pointer(self._factor, name(self._factor)))

    def _integers(self, name: str, size: int) -> Any:
        return self._array(name, size, ctypes.c_int64)

    def _array(self, name: str, size: int, kind: Any) -> Any:
        place = ctypes.cast(getattr(self._read(), name), ctypes.POINTER(kind))
        return np.ctypeslib.as_array(place, (size,))
