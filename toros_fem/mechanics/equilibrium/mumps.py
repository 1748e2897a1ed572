"""Factors by MUMPS, which PETSc calls: where CHOLMOD is missing or its parts meet too often."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.array_types import Floats, LocalInts
from toros_fem.base.errors import TorosError
from toros_fem.mechanics.equilibrium.petsc_options import PREFIX

# Codes of MUMPS' INFOG(1): a request for more working space, and a singular matrix.
LARGEST_SPACE = 4000
MORE_SPACE = (-8, -9, -11, -12, -14, -15, -17, -20)
SINGULAR = -10
# Orderings by MUMPS' INFOG(7), after a sequential and after a parallel analysis.
ORDERINGS = {0: "AMD", 1: "user", 2: "AMF", 3: "SCOTCH", 4: "PORD", 5: "METIS", 6: "QAMD"}
PARALLEL_ORDERINGS = {1: "PT-SCOTCH", 2: "ParMETIS"}


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
