"""CHOLMOD, called directly: parts of its factor are needed that PETSc does not hand out.

The few calls are compiled against the library's own header, once for each environment, as FFCx
does with forms: the layout of its structures differs from version to version.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI, VerificationError
from mpi4py import MPI

from toros_fem.base.array_types import Floats, LocalInts
from toros_fem.base.compiled_forms import is_whole
from toros_fem.base.errors import TorosError
from toros_fem.base.mpi import on_first_rank
from toros_fem.mechanics.equilibrium import cvxopt_cholmod

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
    found = cvxopt_cholmod.load()
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
        raise cvxopt_cholmod.too_little_memory(size)
    if status < OK:
        raise TorosError(
            f"CHOLMOD failed on the tangent of {size} unknowns with status {status}. Take MUMPS "
            "by -toros_pc_factor_mat_solver_type mumps."
        )


Factor = Cholesky | cvxopt_cholmod.CvxoptFactor
Cholmod = CompiledCholmod | cvxopt_cholmod.CvxoptCholmod
