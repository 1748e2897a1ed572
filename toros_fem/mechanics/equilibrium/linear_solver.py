"""Factors of the tangent: by CHOLMOD in parts that meet at an interface, or by MUMPS.

Each part eliminates its own unknowns by itself, on its rank or thread: static condensation. What
remains is a small dense matrix of the interface, the Schur complement. A skin is slender, so that
few unknowns lie between two halves of it.
"""

from __future__ import annotations

import os
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import lapack
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from toros_fem.base.errors import ParameterError, TorosError
from toros_fem.base.mpi import raise_together, sum_over_ranks, together
from toros_fem.base.validation import Bools, Floats, Ints, LocalInts
from toros_fem.mechanics.equilibrium.cholmod import Cholmod, library
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.mechanics.terms.tangent import CONVEX, MATERIAL, STRAINS, Part, UpperTangent

# Of all options of PETSc that this package reads.
PREFIX = "toros_"
# Fraction of the diagonal that is added to M.
LEAST = 1e-6
# Above this shift K lacks the geometric stiffness of bending. Kinks of a shape from a coarser mesh
# would ask for 30, with which strains relax slowly; below it Newton's steps need that stiffness.
MILD = 1.0
PACKAGES = ("cholmod", "mumps")
# Unknowns between the parts, above which the dense matrix there would cost more than MUMPS.
LARGEST_INTERFACE = 4000
FIRST_SHIFT, LARGEST_SHIFT, SMALLEST_SHIFT = 0.03, 1e6, 2e-3
# Factor by which the shift falls after a success, grows where a factorisation fails, and grows
# where no step lowers the energy.
DECAY, GROWTH, REFUSED = 32.0, 4.0, 16.0
# Codes of MUMPS' INFOG(1): a request for more working space, and a singular matrix.
LARGEST_SPACE = 4000
MORE_SPACE = (-8, -9, -11, -12, -14, -15, -17, -20)
SINGULAR = -10
# Orderings by MUMPS' INFOG(7), after a sequential and after a parallel analysis.
ORDERINGS = {0: "AMD", 1: "user", 2: "AMF", 3: "SCOTCH", 4: "PORD", 5: "METIS", 6: "QAMD"}
PARALLEL_ORDERINGS = {1: "PT-SCOTCH", 2: "ParMETIS"}
# Fewer unknowns than these are not worth a thread of their own.
LEAST_PART = 5000


class TangentFactor:
    """Factorised K + τ M, which exists only where that is positive definite.

    M is the tangent's material part: the resistance of strains and curvatures, made positive where
    stress bends or turns a triangle, without the pressure, and the fraction LEAST of the mean
    diagonal of each vertex, for modes that no strain resists. τ is a pure number: about 1 is enough
    in most states, whatever the contrast, but there is no bound; assembled tubes of 146 to 250
    thousand unknowns need 10. With τ > 0, K has a positive semidefinite part of contact, and above
    MILD no geometric stiffness of bending.

    CHOLMOD factorises, in one part for each rank, or for each thread where there is one rank
    (`CondensedFactor`). MUMPS does where CHOLMOD is missing, where the parts meet at too many
    unknowns, or where the option -toros_pc_factor_mat_solver_type says so.

    Attributes:
        matrix: The matrix of `fill` for PETSc, by its products.
        usable: Whether there are factors, of a state that is not far.
        ordering: Fill-reducing ordering that MUMPS used; None with CHOLMOD, which compares its own.
        values: Entries of the matrix of `fill`, in the order of `UpperTangent.columns`.
        count: Numeric factorisations so far, failed ones included.
        periodic: Of the `UpperTangent`.
        scale: Mean diagonal of each vertex, and diagonal of each rotation, in N/m, zero where
            fixed, of the last `assemble`.
    """

    def __init__(self, model: SkinModel) -> None:
        comm = model.skin.comm
        self._model = model
        self._tangent = UpperTangent(model)
        self.periodic = self._tangent.periodic
        self.count, self.usable = 0, False
        self.couple(None)
        self._full: FullTangent | None = None
        self.scale: Floats = np.zeros(model.size_local)
        self._make_entries()
        self._state = model.assembled
        self._factors: CondensedFactor | MumpsFactor = self._choose()
        self._outgrown = False
        self.ordering = getattr(self._factors, "ordering", None)

        size = (model.size_local, model.space.dofmap.index_map.size_global)
        self.matrix = PETSc.Mat().createPython((size, size), _Matrix(self), comm=comm)
        self.matrix.setUp()

    def _make_entries(self) -> None:
        self._exact, self._data = (np.zeros(len(self._tangent.columns)) for _ in range(2))
        self._parts: dict[Part, Floats] = {}
        self.values: Floats = self._exact

    def _choose(self) -> CondensedFactor | MumpsFactor:
        comm, pattern = self._model.skin.comm, (self._tangent.indptr, self._tangent.columns)
        options = PETSc.Options(PREFIX)
        wanted = options.getString("pc_factor_mat_solver_type", "cholmod")
        if wanted not in PACKAGES and not options.hasName("pc_type"):
            raise ParameterError(
                f"-{PREFIX}pc_factor_mat_solver_type {wanted} does not factorise K + τM here: take "
                f"one of {', '.join(PACKAGES)}, or another preconditioner by -{PREFIX}pc_type."
            )
        calls = None if wanted == "mumps" else library(comm)
        if calls is not None:
            threads = _threads() if comm.size == 1 and calls.threads else 1
            partition = find_partition(comm, calls, *pattern, threads=threads)
            while len(partition.interface) > LARGEST_INTERFACE and threads > 1:
                threads //= 2
                partition = find_partition(comm, calls, *pattern, threads=threads)
            if len(partition.interface) <= LARGEST_INTERFACE:
                self._source = calls.source
                return CondensedFactor(comm, calls, *pattern, partition)
        return MumpsFactor(comm, *pattern)

    def describe(self) -> str:
        """Return what factorises, on which ranks or threads, for reports and logs."""
        ranks = self._model.skin.comm.size
        where = f"{ranks} ranks" if ranks > 1 else "one rank"
        if isinstance(self._factors, MumpsFactor):
            return f"MUMPS through PETSc on {where}, ordering {self.ordering}"
        parts, met = self._factors.parts, len(self._factors.interface)
        threads = f" with {parts} threads" if ranks == 1 and parts > 1 else ""
        joined = f", {parts} parts that meet at {met} unknowns" if parts > 1 else ""
        return f"CHOLMOD on {where}{threads}{joined}, by {self._source}"

    def assemble(self, state: Floats) -> None:
        """Assemble the tangent at a state; the factors stay those of the last `factorise`."""
        if self._tangent.grow(state):
            self._make_entries()
            self._outgrown = True
        self._tangent.assemble(state, self._exact)
        self._state = state
        self._parts.clear()
        # One value per vertex: a flat membrane has no stiffness across its plane. A fixed component
        # has 1 in K, which is no stiffness.
        free, fixed = self._model.free, ~self._model.free
        diagonal = np.abs(self._exact[self._tangent.diagonal])
        diagonal[fixed] = self._model.mean_modulus()
        by_vertex = self._model.positions(diagonal)
        by_vertex[:] = by_vertex.mean(axis=1)[:, None]
        self.scale = diagonal * free

    def fill(self, shift: float = 0.0, diagonal: float = 0.0) -> None:
        """Form K + shift · M + diagonal · D, D the mean diagonal of a vertex.

        With a shift, K is one of its parts, as of the class.
        """
        self.values = self._exact
        if shift:
            self.values = self._data
            np.multiply(self._part(MATERIAL), shift, out=self.values)
            self.values += self._part(CONVEX if shift <= MILD else STRAINS)
        if diagonal:
            if not shift:
                self._data[:] = self._exact
            self.values = self._data
            self.values[self._tangent.diagonal] += diagonal * self.scale
        self.matrix.stateIncrease()
        if self._full is not None:
            self._full.fill(self._tangent.indptr, self._tangent.columns, self.values)

    def _part(self, part: Part) -> Floats:
        """Return the entries of a part of K at its state, which are assembled once."""
        if part == CONVEX and self._model.contact is None:
            return self._exact
        if part not in self._parts:
            self._parts[part] = found = np.zeros_like(self._exact)
            self._tangent.assemble(self._state, found, part)
            if part == MATERIAL:
                found[self._tangent.diagonal] += LEAST * self.scale
        return self._parts[part]

    def assembled_matrix(self) -> PETSc.Mat:
        """Return the matrix of `fill` with all its entries, which it keeps from now on."""
        self._full = self._full or FullTangent(self._model.skin.comm, self._model.size_local)
        return self._full.matrix

    def couple(self, state: Floats | None, *, transposed: bool = False) -> None:
        """Add the derivative of friction by normal forces to `matrix`; None takes it off.

        It is not symmetric.
        """
        self._coupled, self._transposed = state, transposed

    def factorise(self, shift: float = 0.0, diagonal: float = 0.0) -> bool:
        """Factorise the matrix of `fill`; return whether it is positive definite, on all ranks."""
        self.fill(shift, diagonal)
        self.count += 1
        if self._outgrown:  # contact has changed the pattern since it was analysed
            self._factors, self._outgrown = self._choose(), False
        self.usable = self._factors.factorise(self.values)
        return self.usable

    def multiply(self, x: Floats) -> Floats:
        """Return K x with the last assembled K, without shift, zero at fixed components."""
        return self._tangent.multiply(self._exact, x) * self._model.free

    def solve(self, rhs: Floats) -> Floats:
        """Solve with the last factorisation, whatever has been assembled since.

        Returns:
            The solution, zero at fixed components.
        """
        return self._factors.solve(rhs) * self._model.free

    def multiply_filled(self, x: Floats) -> Floats:
        """Return the product of the matrix of `fill` with a vector."""
        product = self._tangent.multiply(self.values, x)
        contact, free = self._model.contact, self._model.free
        if self._coupled is not None and contact is not None:
            transposed = self._transposed
            product += free * contact.coupling(self._coupled, x * free, transposed=transposed)
        return product


class _Matrix:
    """Matrix of PETSc's type "python".

    PETSc holds it out of sight of Python's garbage collector: without the weak reference no solver
    would ever be freed.
    """

    def __init__(self, factor: TangentFactor) -> None:
        self._factor = weakref.proxy(factor)

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array_w[:] = self._factor.multiply_filled(x.array_r)

    # The matrix is symmetric; line searches ask for this.
    multTranspose = mult  # noqa: N815


def _threads() -> int:
    text = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return int(text) if text.isdigit() and int(text) > 0 else 1


class FullTangent:
    """A symmetric matrix of type AIJ, for preconditioners of PETSc; its object stays the same."""

    def __init__(self, comm: MPI.Comm, size: int) -> None:
        self.matrix = PETSc.Mat().createAIJ(((size, None), (size, None)), comm=comm)
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.matrix.setUp()

    def fill(self, indptr: LocalInts, columns: LocalInts, values: Floats) -> None:
        """Set all entries from the upper triangle, whose pattern may have grown."""
        matrix, (begin, end) = self.matrix, self.matrix.getOwnershipRange()
        shape = (end - begin, matrix.getSize()[1])
        lower = csr_matrix((values, columns, indptr), shape=shape).T.tocsr()
        rows: Ints = np.flatnonzero(np.diff(lower.indptr))  # of any rank
        pointers = np.append(lower.indptr[rows], lower.nnz).astype(PETSc.IntType)
        matrix.zeroEntries()
        matrix.setValuesCSR(indptr, columns, values)
        matrix.setValuesIJV(
            pointers,
            (lower.indices + begin).astype(PETSc.IntType),
            lower.data,
            rowmap=rows.astype(PETSc.IntType),
        )
        matrix.assemble()


class ShiftLadder:
    """The shift of a factorisation, from which the next one begins.

    Attributes:
        shift: τ of the last factorisation.
        first: The shift with which a solve near the last one begins: neighbouring designs need
            like shifts in their first steps.
        renew: Whether the preconditioner factorises; else it keeps the factors that it has.
    """

    def __init__(self, factor: TangentFactor) -> None:
        self.factor = factor
        self.first, self.renew = 0.0, True
        self.reset(near=False)

    def reset(self, *, near: bool) -> None:
        """Begin a solve, near the last one or not: that one may have failed far away."""
        self.shift = self.first if near else 0.0
        # A smaller shift is worth a factorisation only if the last try of one succeeded.
        self._refused = self.shift > 0
        self._begins = True

    @property
    def exhausted(self) -> bool:
        """Whether the shift cannot grow any more."""
        return self.shift >= LARGEST_SHIFT / 8

    def factorise(self) -> bool:
        """Factorise with the smallest shift that leaves no negative pivot; return whether one does.

        The tangent must be assembled (collective).
        """
        shift = self.shift if self._refused else self.shift / DECAY
        shift = shift if shift >= SMALLEST_SHIFT else 0.0
        refused, found = False, self.factor.factorise(shift)
        while not found and shift < LARGEST_SHIFT:
            shift = max(FIRST_SHIFT, GROWTH * shift) if shift else max(FIRST_SHIFT, self.shift)
            refused, found = True, self.factor.factorise(shift)
        if self._begins:
            lower = shift / GROWTH if shift >= GROWTH * SMALLEST_SHIFT else 0.0
            self._begins, self.first = False, shift if refused else lower
        self._refused = refused and not self._refused
        self.shift = shift
        return found

    def enlarge(self) -> None:
        """Let the next factorisation begin with a larger shift: no step lowered the energy."""
        self.shift, self._refused = max(FIRST_SHIFT, REFUSED * self.shift), True


class ShiftedCholesky:
    """Preconditioner of PETSc's type "python": factors of K + τM.

    PETSc holds it out of sight of Python's garbage collector: without the weak reference no solver
    would ever be freed.
    """

    def __init__(self, ladder: ShiftLadder) -> None:
        self._ladder = weakref.proxy(ladder)

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise, unless older factors are to serve."""
        ladder = self._ladder
        if ladder.renew:
            ladder.renew = False  # PETSc asks again, as a shift changes the matrix
            reasons = PETSc.PC.FailedReason
            found = ladder.factorise()
            pc.setFailedReason(reasons.NOERROR if found else reasons.FACTOR_NUMERIC_ZEROPIVOT)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Solve."""
        y.array_w[:] = self._ladder.factor.solve(x.array_r)

    def view(self, _: PETSc.PC, viewer: PETSc.Viewer) -> None:
        """Say what factorises."""
        ladder = self._ladder
        viewer.printfASCII(f"    {ladder.factor.describe()}, last shift {ladder.shift:g}\n")


class MumpsFactor:
    """Factors LDLᵀ of a symmetric matrix, as of `CondensedFactor`; all methods are collective.

    Attributes:
        ordering: Fill-reducing ordering that MUMPS used.
    """

    def __init__(self, comm: MPI.Comm, indptr: LocalInts, columns: LocalInts) -> None:
        self._comm = comm
        self._indptr, self._columns = indptr, columns
        self._data: Floats = np.zeros(len(columns))
        size = len(indptr) - 1
        self._upper = PETSc.Mat().createAIJWithArrays(
            ((size, None), (size, None)), (indptr, columns, self._data), comm=comm
        )
        self._upper.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._upper.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
        self._rhs, self._solution = self._upper.createVecRight(), self._upper.createVecLeft()
        self._pc = PETSc.PC().create(comm)
        self._pc.setOperators(self._upper)
        self._pc.setType(PETSc.PC.Type.CHOLESKY)
        self._pc.setFactorSolverType("mumps")
        self._pc.setFactorSetUpSolverType()
        factor = self._pc.getFactorMatrix()
        factor.setOptionsPrefix(PREFIX)
        factor.setMumpsIcntl(13, 1)  # no ScaLAPACK root, which would hide its negative pivots
        self._space = 60
        factor.setMumpsIcntl(14, self._space)  # per cent of room for delayed pivots
        # The analysis is done once, on the identity, where it cannot fail.
        identity: Floats = np.zeros(len(columns))
        identity[indptr[:-1]] = 1.0
        self._update(identity)
        self._pc.setUp()
        names = PARALLEL_ORDERINGS if factor.getMumpsInfog(32) == 2 else ORDERINGS
        code = factor.getMumpsInfog(7)
        self.ordering = names.get(code, str(code))

    def factorise(self, values: Floats) -> bool:
        """Factorise for the entries of the owned rows; return whether all is positive definite.

        Raises:
            TorosError: MUMPS failed for another reason, such as too little memory.
        """
        self._update(values)
        self._pc.setOperators(self._upper)
        self._pc.setUp()
        factor = self._pc.getFactorMatrix()
        code = factor.getMumpsInfog(1)
        if code in MORE_SPACE and self._space < LARGEST_SPACE:
            self._space *= 4
            factor.setMumpsIcntl(14, self._space)
            return self.factorise(values)
        if code < 0 and code != SINGULAR:
            raise TorosError(
                f"MUMPS could not factorise the tangent of {self._upper.getSize()[0]} unknowns: "
                f"INFOG(1) = {code}, INFOG(2) = {factor.getMumpsInfog(2)}. If memory ran out "
                "(-13), use a coarser mesh or more ranks on other machines."
            )
        return code != SINGULAR and factor.getMumpsInfog(12) == 0

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative pivots of MUMPS' last factors; None where the matrix is singular."""
        factor = self._pc.getFactorMatrix()
        singular = factor.getMumpsInfog(1) == SINGULAR
        return None if singular else int(factor.getMumpsInfog(12))

    def solve(self, rhs: Floats) -> Floats:
        """Solve with the last factors, for and at the owned unknowns."""
        self._rhs.array[:] = rhs
        self._pc.getFactorMatrix().solve(self._rhs, self._solution)
        return np.array(self._solution.array_r)

    def _update(self, values: Floats) -> None:
        if self._comm.size == 1:
            self._data[:] = values  # the matrix reads this array itself
            self._upper.stateIncrease()
        else:
            self._upper.setValuesCSR(self._indptr, self._columns, values)
            self._upper.assemble()


@dataclass(frozen=True, eq=False)
class Partition:
    """Parts of the unknowns, the same on all ranks.

    Attributes:
        part: Part of each unknown, by its global number.
        parts: Number of parts: that of the ranks, or of the threads of one rank.
        interface: Numbers of the interface's unknowns, sorted: without these no entry joins two
            parts.
    """

    part: Ints
    parts: int
    interface: Ints


def find_partition(
    comm: MPI.Comm, cholmod: Cholmod, indptr: LocalInts, columns: LocalInts, *, threads: int
) -> Partition:
    """Find the parts of a matrix of `CondensedFactor`: one for each rank, or thread of one rank."""
    sizes = np.array(comm.allgather(len(indptr) - 1), dtype=np.int64)
    if comm.size > 1:
        part, parts = np.repeat(np.arange(comm.size), sizes), comm.size
    else:
        part = _split(cholmod, indptr, columns, threads)
        parts = int(part.max(initial=0)) + 1
    rows = sizes[: comm.rank].sum() + np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    across = np.flatnonzero(part[rows] != part[columns])
    pairs = np.stack([rows[across], columns[across].astype(np.int64)], axis=1)
    return Partition(part, parts, _cover(np.concatenate(comm.allgather(pairs)), part))


class CondensedFactor:
    """Factors of a symmetric matrix whose rows are distributed; all methods are collective.

    With I the inner unknowns of a part and B those of the interface that it touches, the part
    factorises the principal submatrix of I and B. B comes last, so that its corner of L holds
    L_BB L_BBᵀ = K_BB − K_BI K_II⁻¹ K_IB. The Schur complement is the interface's own matrix less
    K_BI K_II⁻¹ K_IB of all parts; each rank factorises it. The whole matrix is positive definite
    if and only if all of these are.

    The matrix is given by the upper triangle of the owned rows: `indptr` and global `columns`,
    sorted, the diagonal first.

    Attributes:
        parts: Number of parts on all ranks.
        interface: Global numbers of the interface's unknowns.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        cholmod: Cholmod,
        indptr: LocalInts,
        columns: LocalInts,
        partition: Partition,
    ) -> None:
        self._comm, self.parts, self.interface = comm, partition.parts, partition.interface
        size = len(indptr) - 1
        starts = np.append(0, np.cumsum(comm.allgather(size)))
        begin = int(starts[comm.rank])
        # The lists of entries are the largest arrays of a set-up: numbers have four bytes in them.
        part = partition.part.astype(np.int32)
        rows = np.repeat(np.arange(begin, begin + size, dtype=np.int32), np.diff(indptr))
        numbers = [comm.rank] if comm.size > 1 else range(partition.parts)
        count = len(self.interface)
        at = np.full(starts[-1], -1, dtype=np.int32)
        at[self.interface] = np.arange(count)

        # Entries in a row of the interface may belong to any part: all ranks get them.
        on = (at[rows] >= 0) & ((at[columns] >= 0) | (part[columns] != part[rows]))
        self._shared = np.flatnonzero(on)
        self._counts = np.array(comm.allgather(len(self._shared)), dtype=np.int64)
        shared = np.concatenate(comm.allgather(np.stack([rows[on], columns[on]], axis=1)))
        corner = np.flatnonzero((at[shared] >= 0).all(axis=1))
        self._corner = np.sort(at[shared[corner]], axis=1), corner

        mine = at[begin : begin + size]
        self._own = np.flatnonzero(mine >= 0), mine[mine >= 0]
        keep, zero = np.flatnonzero(~on).astype(np.int32), len(rows) + len(shared)
        entries = np.empty((3, len(keep) + len(shared)), dtype=np.int32)
        entries[:, len(keep) :] = [*shared.T, np.arange(len(rows), zero)]
        for place, own in enumerate((rows[keep], columns[keep], keep)):
            entries[place, : len(keep)] = own
        del on, keep, rows, columns
        self._values = np.zeros(zero + 1)
        with together(comm):
            self._parts = [
                _Part(cholmod, np.flatnonzero((part == p) & (at < 0)), at, entries, zero, begin)
                for p in numbers
            ]
        self._pool = ThreadPoolExecutor(len(self._parts)) if len(self._parts) > 1 else None
        self._schur: Floats = np.zeros((count, count))

    def factorise(self, values: Floats) -> bool:
        """Factorise for the entries of the owned rows; return whether all is positive definite."""
        comm, count = self._comm, len(self.interface)
        self._values[: len(values)] = values
        shared = self._values[len(values) : -1]
        comm.Allgatherv(values[self._shared], [shared, self._counts])
        good, error = False, None
        try:
            good = all(self._each(lambda part: part.factorise(self._values)))
        except TorosError as caught:
            error = caught
        if self.parts == 1:
            raise_together(comm, error)
            return good
        # One sum over the ranks tells whether all succeeded, and adds what remains.
        total: Floats = np.zeros(count * count + 1)
        square = total[:-1].reshape(count, count)
        total[-1] = float(not good)
        if good and count:
            for part in self._parts:
                square[np.ix_(part.place, part.place)] += part.schur()
        comm.Allreduce(MPI.IN_PLACE, total)
        if total[-1]:
            raise_together(comm, error)
            return False
        if not count:
            return True
        (row, column), source = self._corner[0].T, self._corner[1]
        square[row, column] += shared[source]
        self._schur, info = lapack.dpotrf(square.T, lower=1, clean=0, overwrite_a=1)
        return bool(comm.bcast(info == 0))

    def solve(self, rhs: Floats) -> Floats:
        """Solve with the last factors, for and at the owned unknowns."""
        comm, count = self._comm, len(self.interface)
        forces = self._each(lambda part: part.condense(rhs))
        at_interface: Floats = np.zeros(count)
        if count:
            local, place = self._own
            at_interface[place] = rhs[local]
            for part, share in zip(self._parts, forces, strict=True):
                at_interface[part.place] += share
            at_interface = sum_over_ranks(comm, at_interface)
            at_interface = lapack.dpotrs(self._schur, at_interface, lower=1)[0]
        out = np.empty(len(rhs))
        self._each(lambda part: part.expand(at_interface, out))
        if count:
            out[local] = at_interface[place]
        return out

    def _each(self, action: Any) -> list[Any]:
        if self._pool is None:
            return [action(part) for part in self._parts]
        return list(self._pool.map(action, self._parts))


class _Part:
    """Inner unknowns of one part, with its interface behind them in reversed order.

    `inner` are their global numbers, `begin` the first one of this rank, and `at` the place of each
    global number in the interface, −1 for none. Entries have global rows and columns, and the
    place of their value, (3, k); `zero` is that of a zero.

    Attributes:
        place: Places in the interface that the part touches.
    """

    def __init__(
        self,
        cholmod: Cholmod,
        inner: Ints,
        at: LocalInts,
        entries: LocalInts,
        zero: int,
        begin: int,
    ) -> None:
        size, (rows, columns, source) = len(inner), entries
        number: LocalInts = np.full(len(at), -1, dtype=np.int32)
        number[inner] = np.arange(size)
        # Only what the part touches of the interface.
        one, two = number[rows] >= 0, number[columns] >= 0
        touched = columns[one & (at[columns] >= 0)], rows[two & (at[rows] >= 0)]
        edge = np.unique(np.append(*touched))
        self.place, count = at[edge], len(edge)
        chosen = np.flatnonzero(one & two)
        order = cholmod.order(*_lower(number[rows[chosen]], number[columns[chosen]], size)[:2])
        self._inner, self._count = inner[order] - begin, count
        number[inner[order]] = np.arange(size)
        number[edge] = size + np.arange(count)[::-1]
        i, j = number[rows], number[columns]
        chosen = np.flatnonzero((i >= 0) & (j >= 0) & ((i < size) | (j < size)))
        pointers, lower, place = _lower(i[chosen], j[chosen], size)
        # The corner fills up anyway; as a dense pattern it is sure to stay last in one piece.
        corner = np.flatnonzero((i >= size) & (j >= size))
        dense: Ints = np.full((count, count), zero)
        dense[np.minimum(i, j)[corner] - size, np.maximum(i, j)[corner] - size] = source[corner]
        upper = np.triu_indices(count)
        self._source = np.append(source[chosen][place], dense[upper]).astype(np.intp)
        lower = np.append(lower, (size + upper[1]).astype(np.int32))
        ends = pointers[-1] + np.cumsum(np.arange(count, 0, -1))
        pointers = np.append(pointers, ends.astype(np.int32))
        self.factor = cholmod.factor(pointers, lower)
        self._entries: Floats = np.zeros(len(lower))
        self._corner: Floats = np.zeros((count, count))

    def factorise(self, values: Floats) -> bool:
        np.take(values, self._source, out=self._entries, mode="clip")
        good = self.factor.factorise(self._entries)
        if good and self._count:
            self._corner = self.factor.corner(self._count)
        return good

    def schur(self) -> Floats:
        """Return −K_BI K_II⁻¹ K_IB of the part, the upper triangle at its `place`."""
        if not self._count:  # LAPACK complains of empty matrices on stdout
            return self._corner
        product, _ = lapack.dlauum(self._corner.T, lower=1)
        square = np.asarray(product.T)
        # In the part K_BB comes last, column by column, in reversed order.
        begin = len(self._entries) - self._count * (self._count + 1) // 2
        for last in range(self._count - 1, -1, -1):
            square[last::-1, last] -= self._entries[begin : begin + last + 1]
            begin += last + 1
        return square

    def condense(self, rhs: Floats) -> Floats:
        """Eliminate the inner unknowns; return the forces that this leaves on the interface."""
        self._x = np.zeros(len(self._inner) + self._count)
        self._x[: len(self._inner)] = rhs[self._inner]
        self.factor.forward(self._x)
        return np.asarray(self._corner @ self._x[: -self._count - 1 : -1])

    def expand(self, at_interface: Floats, out: Floats) -> None:
        """Write the inner unknowns that follow from those of the interface."""
        x = self._x
        x[: -self._count - 1 : -1] = self._corner.T @ at_interface[self.place]
        self.factor.backward(x)
        out[self._inner] = x[: len(self._inner)]


def _lower(
    rows: LocalInts, columns: LocalInts, size: int
) -> tuple[LocalInts, LocalInts, LocalInts]:
    """Return pointers and rows of the first columns of a lower triangle, and their entries.

    Rows and columns are places of its entries or of their mirror images, each once.
    """
    first, second = np.minimum(rows, columns), np.maximum(rows, columns)
    shape = (size, int(second.max(initial=-1)) + 1)
    places = np.arange(len(rows), dtype=np.int32)
    matrix = csr_matrix((places, (first, second)), shape=shape)
    matrix.sort_indices()
    return matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data


def _split(cholmod: Cholmod, indptr: LocalInts, columns: LocalInts, threads: int) -> Ints:
    """Return the part of each unknown, for as many parts as threads, rounded to a power of 2."""
    part: Ints = np.zeros(len(indptr) - 1, dtype=np.int64)
    whole = csr_matrix((np.ones(len(columns), dtype=np.int8), columns, indptr))
    for count in 2 ** np.arange(int(np.log2(threads))):
        for p in range(count):
            members = np.flatnonzero(part == p)
            if len(members) < 2 * LEAST_PART:
                continue
            block = whole[members][:, members]
            block.sort_indices()
            half = cholmod.bisect(block.indptr, block.indices)
            part[members[half > 0]] += count
    return np.unique(part, return_inverse=True)[1]


def _cover(pairs: Ints, part: Ints) -> Ints:
    """Return a smallest set of unknowns that meets every pair, for each two parts in turn.

    It is smallest by Kőnig's theorem: from a maximum matching, the unknowns of the first part that
    alternating paths from its unmatched ones do not reach, and those of the second that they do.
    """
    covered: Bools = np.zeros(len(part), dtype=bool)
    swap = part[pairs[:, 0]] > part[pairs[:, 1]]
    first, second = np.where(swap[:, None], pairs[:, ::-1], pairs).T
    parts = int(part.max(initial=0)) + 1
    which = part[first] * parts + part[second]
    for one in np.unique(which):
        chosen = (which == one) & ~covered[first] & ~covered[second]
        a, rows = np.unique(first[chosen], return_inverse=True)
        b, columns = np.unique(second[chosen], return_inverse=True)
        graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(a), len(b)))
        match = maximum_bipartite_matching(graph, perm_type="column")
        matched = np.flatnonzero(match >= 0)
        reached, right = match < 0, np.zeros(len(b), dtype=bool)
        count = -1
        while count < reached.sum():
            count = int(reached.sum())
            right = graph.T @ reached > 0
            reached[matched[right[match[matched]]]] = True
        covered[a[~reached]] = True
        covered[b[right]] = True
    return np.flatnonzero(covered)
