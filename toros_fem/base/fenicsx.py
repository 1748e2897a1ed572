"""FEniCSx: differences between its versions, and forms that are compiled and kept on disk.

Differences between dolfinx 0.9 and 0.11 are found by features. What is damaged on disk is compiled
again.
"""

from __future__ import annotations

import ctypes
import fcntl
import hashlib
import os
import platform
import shlex
import struct
import subprocess
import sysconfig
from collections.abc import Callable, Generator, Hashable, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from cffi import VerificationError
from dolfinx import cpp, fem, la, mesh
from dolfinx.graph import adjacencylist
from dolfinx.jit import get_options
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.errors import OutputError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats

LOCK = "compiling.lock"
# s, while which another process may compile the same form, on a machine that is busy.
PATIENCE = 300
UNMADE = (
    "{} cannot be made, where forms are compiled: {}. Give another folder by the variable "
    "XDG_CACHE_HOME."
)
# Modules of compiled forms that this process has seen to be whole.
_WHOLE: set[str] = set()


def adjacency(values: npt.NDArray[np.int32], offsets: npt.NDArray[np.int32]) -> Any:
    """Return a C++ adjacency list."""
    found = adjacencylist(values, offsets)
    return getattr(found, "_cpp_object", found)  # from 0.10 it is wrapped


def index_map(
    comm: MPI.Comm, owned: int, ghosts: npt.NDArray[np.int64], owners: npt.NDArray[np.int32]
) -> Any:
    """Return an index map with given ghosts (collective)."""
    try:
        return cpp.common.IndexMap(comm, owned, ghosts, owners)
    except TypeError:  # from 0.11 a message tag is required
        return cpp.common.IndexMap(comm, owned, ghosts, owners, 1 << 8)


def coordinate_map(geometry: Any) -> Any:
    """Return the C++ coordinate element of a mesh geometry."""
    geometry = getattr(geometry, "_cpp_object", geometry)
    maps = getattr(geometry, "cmaps", None)
    if isinstance(maps, list):  # from 0.11; before, cmaps is a method or missing
        return maps[0]
    return geometry.cmap


def geometry_dofmap(geometry: Any) -> npt.NDArray[np.int32]:
    """Return the geometry points of each local cell, shape (cells, 3)."""
    geometry = getattr(geometry, "_cpp_object", geometry)
    maps = getattr(geometry, "dofmaps", None)
    if isinstance(maps, list):
        return np.asarray(maps[0])
    return np.asarray(geometry.dofmap)


def function_space(domain: mesh.Mesh, element: Any, dofmap: Any, plain: fem.FunctionSpace) -> Any:
    """Return a space on a hand-made C++ dofmap; `plain` gives element and value shape."""
    cpp_element = getattr(plain.element, "_cpp_object", plain.element)
    make = cpp.fem.FunctionSpace_float64
    try:
        space = make(domain._cpp_object, cpp_element, dofmap)
    except TypeError:  # up to 0.9 the value shape is an argument
        space = make(domain._cpp_object, cpp_element, dofmap, plain.value_shape)
    return fem.FunctionSpace(domain, element, space)


def filled_form(
    code: Any,
    module: Any,
    spaces: Sequence[fem.FunctionSpace],
    coefficients: Sequence[fem.Function],
    constants: Sequence[fem.Constant],
    domain: mesh.Mesh,
) -> fem.Form:
    """Return a form on all triangles of a mesh from the code of another one, and its module."""
    address = module.ffi.cast("uintptr_t", module.ffi.addressof(code))
    given = [[one._cpp_object for one in each] for each in (spaces, coefficients, constants)]
    make = cpp.fem.Form_float64
    try:
        form = make(address, *given, {}, {}, domain._cpp_object)
    except TypeError:  # from 0.10 codes and entity maps are lists
        form = make([address], *given, {}, [], domain._cpp_object)
    return fem.Form(form, code, None, module)


def option_used(name: str) -> bool:
    """Return whether anything has asked for an option of PETSc's database."""
    library, used = ctypes.CDLL(PETSc.__file__), ctypes.c_int()
    library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)


# --------------------------------------------------------------------------------- compiled forms


def compiled(form: ufl.Form) -> Any:
    """Compile a form on one mesh to a `dolfinx.fem.Form`, or read it from the cache (collective).

    FFCx makes the C file of a form first and marks it when all is done. A compilation that was
    killed leaves the file without its mark, and FFCx would wait for this mark in vain. A marked
    form whose module is gone or cut short ends the process where it is loaded. So such files are
    removed before, unless another process is compiling.

    Raises:
        OutputError: The cache cannot be made; on all ranks.
        ImportError: The form cannot be compiled; on all ranks.
    """
    folder = form_cache()
    comm = form.ufl_domains()[0].ufl_cargo().comm
    patience = max(PATIENCE, get_options()["timeout"])
    options = {"cache_dir": str(folder), "timeout": patience}
    on_first_rank(comm, lambda: _make(folder))
    # Other ranks read what the first one has compiled.
    with _compiling(folder) if comm.rank == 0 else nullcontext():
        try:
            return fem.form(form, jit_options=options)
        except (VerificationError, RuntimeError, ImportError) as error:
            raise ImportError(
                f"a form cannot be compiled in {folder}: {error}. A C compiler, the header "
                "Python.h and space on the disk are needed",
                name="form",
            ) from error


Kernel = tuple[Any, Any, Sequence[int], Sequence[int], Sequence[int]]
"""Code and module of a compiled form, and which of the symbols of `SharedForms` it reads: those
whose spaces are those of its arguments, its coefficients, and its constants."""
# Those of this process, by the kind of their symbols and their name.
_KERNELS: dict[tuple[Hashable, str], Kernel] = {}


class SharedForms:
    """Forms whose UFL depends on nothing but the kinds of some symbols.

    UFL needs a fifth of a second to state the forms of a skin and to recognise them in the cache,
    and a process makes hundreds of skins of a few kinds. So the forms of the first skin of a kind
    are compiled, and those of others have the same code with their own functions and constants.

    Args:
        domain: The mesh.
        symbols: Functions, constants and arguments of the forms, and all else that decides on their
            UFL, as numbers, types or None. Sequences and dataclasses are entered. With
            NotImplemented among them nothing is shared.
    """

    def __init__(self, domain: mesh.Mesh, symbols: Any) -> None:
        self._domain = domain
        self._symbols: list[Any] = []
        self._kind = domain.ufl_domain().ufl_coordinate_element(), self._kind_of(symbols)
        self._shared = not any(one is NotImplemented for one in self._symbols)

    def _kind_of(self, symbol: Any) -> Hashable:
        if is_dataclass(symbol) and not isinstance(symbol, type):
            symbol = [type(symbol), *(getattr(symbol, field.name) for field in fields(symbol))]
        if isinstance(symbol, list | tuple):
            return tuple(map(self._kind_of, symbol))
        for k, one in enumerate(self._symbols):
            if one is symbol:
                return k
        self._symbols.append(symbol)
        if isinstance(symbol, ufl.Coefficient | ufl.Argument):
            return type(symbol), symbol.ufl_element()
        if isinstance(symbol, ufl.Constant):
            return type(symbol), symbol.ufl_shape
        return type(symbol), symbol

    def compiled(self, name: str, stated: Callable[[], ufl.Form]) -> fem.Form:
        """Return the form of a name; the first of its kind is stated and compiled (collective)."""
        if not self._shared:
            return compiled(stated())
        key = self._kind, name
        # Some ranks may know it from another communicator.
        if not self._domain.comm.allreduce(key in _KERNELS, op=MPI.LAND):
            form = stated()
            made = compiled(form)
            _KERNELS[key] = self._kernel(form, made)
            return made
        code, module, *places = _KERNELS[key]
        spaces, coefficients, constants = ([self._symbols[k] for k in of] for of in places)
        spaces = [one.ufl_function_space() for one in spaces]
        return filled_form(code, module, spaces, coefficients, constants, self._domain)

    def _kernel(self, form: ufl.Form, made: fem.Form) -> Kernel:
        symbols, code = self._symbols, made.ufcx_form
        of_space = [
            one.ufl_function_space() if isinstance(one, ufl.Coefficient | ufl.Argument) else None
            for one in symbols
        ]
        every = form.coefficients()
        used = [every[code.original_coefficient_positions[n]] for n in range(code.num_coefficients)]
        number = {id(one): k for k, one in enumerate(symbols)}
        return (
            code,
            made.module,
            [of_space.index(one.ufl_function_space()) for one in form.arguments()],
            [number[id(one)] for one in used],
            [number[id(one)] for one in form.constants()],
        )


def work_vector(space: fem.FunctionSpace) -> la.Vector:
    """Return a vector to assemble into; made once, since planning its exchange is expensive."""
    return la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)


def assembled(form: Any, vector: la.Vector) -> Floats:
    """Return the owned entries of an assembled linear form."""
    vector.array[:] = 0
    fem.assemble_vector(vector.array, form)
    vector.scatter_reverse(la.InsertMode.add)
    return np.array(vector.array[: vector.index_map.size_local * vector.block_size])


@cache
def form_cache() -> Path:
    """Return the folder of compiled forms of this compiler, its options and this processor."""
    options = get_options()
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    try:
        told = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
        version = told.stdout.partition("\n")[0]
    except OSError:  # all that is needed may be in the cache
        version = ""
    flags = options["cffi_extra_compile_args"]
    facts = repr([compiler, version, flags, platform.machine(), _processor()])
    key = hashlib.sha1(facts.encode()).hexdigest()[:12]
    return Path(options["cache_dir"]) / f"toros_fem-{key}"


def _processor() -> str:
    """Return the model of the processor, "" where the system does not tell."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if "model name" in line), "")


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(UNMADE.format(folder, error.strerror)) from None


@contextmanager
def _compiling(folder: Path) -> Generator[None]:
    """Hold the cache's lock, shared, after removing what is damaged.

    The kernel frees the lock of a process that ends, however it ends.
    """
    try:
        file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError:  # FFCx tells it
        yield
        return
    try:
        with suppress(OSError):  # another process compiles, or there are no locks here
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _remove_damaged(folder)
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_SH)
        yield
    finally:
        os.close(file)


def _remove_damaged(folder: Path) -> None:
    """Remove the forms without a mark, and those whose module is gone or cut short."""
    names = set(os.listdir(folder))
    for source in names:
        form, ending = os.path.splitext(source)
        if ending != ".c" or not form.startswith("libffcx_"):
            continue
        mark, modules = f"{source}.cached", {form + suffix for suffix in EXTENSION_SUFFIXES} & names
        whole = bool(modules) and all(name in _WHOLE or is_whole(folder / name) for name in modules)
        if mark in names and whole:
            _WHOLE.update(modules)
            continue
        _WHOLE.difference_update(modules)
        for name in {source, mark, *modules}:
            (folder / name).unlink(missing_ok=True)


def is_whole(module: Path) -> bool:
    """Return whether a file is as long as its ELF header says; True of other formats.

    To load a shared library that is cut short ends the process by SIGBUS.
    """
    size = module.stat().st_size
    with module.open("rb") as file:
        head = file.read(64)
    if size < 64 or head[:4] != b"\x7fELF":
        return size > 64
    order, wide = "<" if head[5] == 1 else ">", head[4] == 2
    (table,) = struct.unpack_from(f"{order}{'Q' if wide else 'I'}", head, 40 if wide else 32)
    entry, entries = struct.unpack_from(f"{order}HH", head, 58 if wide else 46)
    return bool(size >= table + entry * entries)
