"""CHOLMOD, called directly: parts of its factor are needed that PETSc does not hand out.

The few calls are compiled against the library's own header, once for each environment, as FFCx
does with forms: the layout of its structures differs from version to version.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI, VerificationError
from mpi4py import MPI
from scipy.sparse import csc_matrix, csr_matrix

from toros_fem.base.errors import TorosError
from toros_fem.base.fenicsx import is_whole
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats, LocalInts

DECLARATIONS = """
typedef struct toros_factor toros_factor;
int toros_bisect(int n, int *pointers, int *rows, int *part);
int toros_order(int n, int *pointers, int *rows, int *order);
toros_factor *toros_analyse(int n, int *pointers, int *rows, int *status);
int toros_factorise(toros_factor *f, double *values);
int toros_solve(toros_factor *f, int transposed, double *x);
void toros_corner(toros_factor *f, int first, double *out);
void toros_free(toros_factor *f);
"""

SOURCE = """
#include <cholmod.h>
#include <stdlib.h>
#include <string.h>

typedef struct toros_factor {
    cholmod_common common;
    cholmod_sparse matrix;
    cholmod_factor *factor;
    cholmod_dense *x, *y, *e;
} toros_factor;

static void begin(cholmod_common *common)
{
    cholmod_start(common);
    common->print = 0;
    common->supernodal = CHOLMOD_SUPERNODAL;
    common->quick_return_if_not_posdef = 1;
#if CHOLMOD_MAIN_VERSION >= 4
    common->nthreads_max = 1; /* parts have threads of their own */
#endif
}

static cholmod_sparse lower(int n, int *pointers, int *rows)
{
    cholmod_sparse matrix;
    memset(&matrix, 0, sizeof matrix);
    matrix.nrow = matrix.ncol = n;
    matrix.nzmax = pointers[n];
    matrix.p = pointers;
    matrix.i = rows;
    matrix.stype = -1;
    matrix.itype = CHOLMOD_INT;
    matrix.xtype = CHOLMOD_PATTERN;
    matrix.dtype = CHOLMOD_DOUBLE;
    matrix.sorted = matrix.packed = 1;
    return matrix;
}

int toros_bisect(int n, int *pointers, int *rows, int *part)
{
    cholmod_common common;
    cholmod_sparse matrix = lower(n, pointers, rows);
    begin(&common);
    cholmod_bisect(&matrix, NULL, 0, 1, part, &common);
    int status = common.status;
    cholmod_finish(&common);
    return status;
}

int toros_order(int n, int *pointers, int *rows, int *order)
{
    cholmod_common common;
    cholmod_sparse matrix = lower(n, pointers, rows);
    begin(&common);
    cholmod_factor *factor = cholmod_analyze(&matrix, &common);
    int status = common.status;
    if (factor != NULL)
        memcpy(order, factor->Perm, n * sizeof(int));
    cholmod_free_factor(&factor, &common);
    cholmod_finish(&common);
    return status;
}

toros_factor *toros_analyse(int n, int *pointers, int *rows, int *status)
{
    toros_factor *f = calloc(1, sizeof(toros_factor));
    begin(&f->common);
    f->common.nmethods = 1;
    f->common.method[0].ordering = CHOLMOD_NATURAL;
    f->common.postorder = 0;
    f->matrix = lower(n, pointers, rows);
    f->factor = cholmod_analyze(&f->matrix, &f->common);
    *status = f->common.status;
    f->matrix.xtype = CHOLMOD_REAL;
    return f;
}

int toros_factorise(toros_factor *f, double *values)
{
    f->matrix.x = values;
    cholmod_factorize(&f->matrix, f->factor, &f->common);
    return f->common.status;
}

int toros_solve(toros_factor *f, int transposed, double *x)
{
    size_t n = f->matrix.nrow;
    cholmod_dense b;
    memset(&b, 0, sizeof b);
    b.nrow = b.nzmax = b.d = n;
    b.ncol = 1;
    b.x = x;
    b.xtype = CHOLMOD_REAL;
    b.dtype = CHOLMOD_DOUBLE;
    int ok = cholmod_solve2(transposed ? CHOLMOD_Lt : CHOLMOD_L, f->factor, &b, NULL, &f->x, NULL,
        &f->y, &f->e, &f->common);
    if (ok)
        memcpy(x, f->x->x, n * sizeof(double));
    return ok ? 0 : f->common.status;
}

/* The trailing block of L, with rows and columns reversed: upper triangular, row by row. */
void toros_corner(toros_factor *f, int first, double *out)
{
    cholmod_factor *L = f->factor;
    int *super = L->super, *pi = L->pi, *px = L->px, *s = L->s;
    double *x = L->x;
    int n = (int)L->n, size = n - first;
    for (int k = 0; k < (int)L->nsuper; k++) {
        int begin = super[k], end = super[k + 1], count = pi[k + 1] - pi[k];
        for (int j = begin < first ? first : begin; j < end; j++)
            for (int i = j - begin; i < count; i++)
                out[(size_t)(n - 1 - s[pi[k] + i]) * size + (n - 1 - j)]
                    = x[px[k] + (size_t)(j - begin) * count + i];
    }
}


void toros_free(toros_factor *f)
{
    cholmod_free_dense(&f->x, &f->common);
    cholmod_free_dense(&f->y, &f->common);
    cholmod_free_dense(&f->e, &f->common);
    cholmod_free_factor(&f->factor, &f->common);
    cholmod_finish(&f->common);
    free(f);
}
"""
# CHOLMOD's status: success, too little memory. A pivot that is not positive is above success.
OK, OUT_OF_MEMORY = 0, -2


def library(comm: MPI.Comm) -> Cholmod | None:
    """Return CHOLMOD: compiled calls, else that of cvxopt, else None (collective)."""
    path = on_first_rank(comm, _build)
    module = None if path is None else _load(path)
    if comm.allreduce(module is not None, op=MPI.LAND):
        return CompiledCholmod(module)
    found = load_cvxopt()
    return found if comm.allreduce(found is not None, op=MPI.LAND) else None


@cache
def _build() -> Path | None:
    """Return the path of the compiled module, made if it is not there; None if that fails."""
    prefixes = [Path(sys.prefix), Path(sys.base_prefix), Path("/usr"), Path("/usr/local")]
    places = [root / place for root in prefixes for place in ("include/suitesparse", "include")]
    header = next((place for place in places if (place / "cholmod.h").exists()), None)
    if header is None:
        return None
    # Another version of the library is another module.
    texts = [path.read_bytes() for path in sorted(header.glob("cholmod*.h"))]
    texts += [text.encode() for text in (SOURCE, DECLARATIONS, sys.version)]
    name = f"toros_cholmod_{hashlib.sha1(b''.join(texts)).hexdigest()[:12]}"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = home / "toros_fem"
    known = [path for path in sorted(folder.glob(f"{name}.*so")) if is_whole(path)]
    if known:
        return known[0]
    builder = FFI()
    builder.cdef(DECLARATIONS)
    builder.set_source(
        name,
        SOURCE,
        libraries=["cholmod"],
        library_dirs=[str(root / "lib") for root in prefixes[:2]],
        include_dirs=[str(header)],
        extra_compile_args=["-O2"],
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as place:
            made = Path(builder.compile(tmpdir=place))
            # At once whole: another process may do the same.
            return made.replace(folder / made.name)
    except (OSError, VerificationError):
        return None


@cache
def _load(path: Path) -> Any | None:
    spec = importlib.util.spec_from_file_location(path.name.split(".")[0], path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except ImportError:
        return None
    return module


class CompiledCholmod:
    """CHOLMOD by the compiled calls.

    A pattern is given by `pointers, rows`: the lower triangle in compressed columns, rows sorted,
    the diagonal first.

    Attributes:
        source: Where it comes from, for reports and logs.
        threads: Whether several threads factorise at the same time.
    """

    source, threads = "its header", True

    def __init__(self, module: Any) -> None:
        self._module = module

    def factor(self, pointers: LocalInts, rows: LocalInts) -> Cholesky:
        """Analyse a pattern, which is kept."""
        return Cholesky(self._module, pointers, rows)

    def order(self, pointers: LocalInts, rows: LocalInts) -> LocalInts:
        """Return the order of elimination that CHOLMOD finds best."""
        return self._filled(self._module.lib.toros_order, pointers, rows)

    def bisect(self, pointers: LocalInts, rows: LocalInts) -> LocalInts:
        """Return the half 0 or 1 of each row, 2 on the separator."""
        return self._filled(self._module.lib.toros_bisect, pointers, rows)

    def _filled(self, call: Any, pointers: LocalInts, rows: LocalInts) -> LocalInts:
        size = len(pointers) - 1
        out: LocalInts = np.zeros(size, dtype=np.int32)
        if size:
            arrays = (_integers(self._module, array) for array in (pointers, rows, out))
            _check(call(size, *arrays), size)
        return out


class Cholesky:
    """Factor L Lᵀ of one symmetric matrix, in the order of its rows, by the compiled calls.

    Too little memory is a TorosError.
    """

    def __init__(self, module: Any, pointers: LocalInts, rows: LocalInts) -> None:
        self._ffi, self._lib = module.ffi, module.lib
        self.size = len(pointers) - 1
        self._kept = _integers(module, pointers), _integers(module, rows)
        status = self._ffi.new("int *")
        factor = self._lib.toros_analyse(self.size, *self._kept, status)
        self._factor = self._ffi.gc(factor, self._lib.toros_free)
        _check(status[0], self.size)

    def factorise(self, values: Floats) -> bool:
        """Factorise for the values of the lower triangle; return whether it is positive definite.

        CHOLMOD stops at the first pivot that is not positive; there are no factors then.
        """
        status = self._lib.toros_factorise(self._factor, self._numbers(values))
        _check(status, self.size)
        return bool(status == OK)

    def forward(self, x: Floats) -> None:
        """Replace x by L⁻¹ x."""
        _check(self._lib.toros_solve(self._factor, 0, self._numbers(x)), self.size)

    def backward(self, x: Floats) -> None:
        """Replace x by L⁻ᵀ x."""
        _check(self._lib.toros_solve(self._factor, 1, self._numbers(x)), self.size)

    def corner(self, count: int) -> Floats:
        """Return the block of L of the last rows and columns, both reversed: upper triangular."""
        out = np.zeros((count, count))
        self._lib.toros_corner(self._factor, self.size - count, self._numbers(out))
        return out

    def _numbers(self, values: Floats) -> Any:
        return self._ffi.from_buffer("double[]", values)


def _integers(module: Any, values: LocalInts) -> Any:
    return module.ffi.from_buffer("int[]", values)


def _check(status: int, size: int) -> None:
    if status == OUT_OF_MEMORY:
        raise too_little_memory(size)
    if status < OK:
        raise TorosError(
            f"CHOLMOD failed on the tangent of {size} unknowns with status {status}. Take MUMPS "
            "by -toros_pc_factor_mat_solver_type mumps."
        )


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
def load_cvxopt() -> CvxoptCholmod | None:
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


Factor = Cholesky | CvxoptFactor
Cholmod = CompiledCholmod | CvxoptCholmod
