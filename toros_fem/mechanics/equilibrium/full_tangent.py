"""Both halves of the tangent as a matrix that PETSc's own preconditioners can read."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from toros_fem.base.array_types import Floats, Ints, LocalInts


class FullTangent:
    """A symmetric matrix of type AIJ, made where a preconditioner of PETSc asks for it.

    Attributes:
        matrix: The matrix; its object stays the same.

    Args:
        comm: Communicator; all methods are collective.
        size: Number of owned rows.
    """

    def __init__(self, comm: MPI.Comm, size: int) -> None:
        self.matrix = PETSc.Mat().createAIJ(((size, None), (size, None)), comm=comm)
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.matrix.setUp()

    def fill(self, indptr: LocalInts, columns: LocalInts, values: Floats) -> None:
        """Set all entries from the upper triangle; its pattern may have grown.

        Args:
            indptr, columns: Compressed owned rows: global columns, sorted, the diagonal first.
            values: Their entries.
        """
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
