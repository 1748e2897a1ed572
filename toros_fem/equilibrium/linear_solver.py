"""Factorised tangent, by CHOLMOD on one rank and MUMPS on several; both detect indefiniteness."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.errors import TorosError
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.tangent import UpperTangent

PREFIX = "toros_"
# Codes of MUMPS' INFOG(1): a request for more working space, and a singular matrix.
LARGEST_SPACE = 4000
MORE_SPACE = (-8, -9, -11, -12, -14, -15, -17, -20)
SINGULAR = -10
# Fraction of the diagonal that is added to M.
LEAST = 1e-6
# PETSc's code for a pivot that is not positive, where CHOLMOD stops.
NOT_POSITIVE = 81
# Orderings by MUMPS' INFOG(7), after a sequential and after a parallel analysis.
ORDERINGS = {0: "AMD", 1: "user", 2: "AMF", 3: "SCOTCH", 4: "PORD", 5: "METIS", 6: "QAMD"}
PARALLEL_ORDERINGS = {1: "PT-SCOTCH", 2: "ParMETIS"}


class TangentFactor:
    """Factorised K + τ M, which exists only where that is positive definite.

    M is the tangent's material part: the resistance of strains and curvatures, made positive where
    stress bends or turns a triangle, without the pressure. So K + τ M is positive definite from
    τ of about 1 on, whatever the contrast, except for modes that no strain resists; for these
    M contains the fraction LEAST of the mean diagonal of each vertex. τ is a pure number.

    CHOLMOD (LLᵀ) stops at the first pivot that is not positive; MUMPS (LDLᵀ) counts them.

    Attributes:
        upper: The upper triangle as a compressed-row matrix.
        matrix: The matrix that PETSc factorises: `upper` itself, or in CHOLMOD's format.
        package: "cholmod" or "mumps".
        ordering: Fill-reducing ordering that MUMPS used; None with CHOLMOD, which does not report
            it through PETSc.
        count: Numeric factorisations so far, failed ones included.
        periodic: Rows of a tile's mean deformation gradient; None for a skin that does not repeat.
        scale: Mean diagonal of each vertex, and diagonal of each rotation, in N/m, zero where
            fixed, of the last `assemble`.

    Args:
        model: The skin's model.
    """

    def __init__(self, model: SkinModel) -> None:
        comm = model.skin.comm
        self._model = model
        self._tangent = UpperTangent(model)
        self.periodic = self._tangent.periodic
        self.count = 0
        self.scale: Floats = np.zeros(model.size_local)
        self._exact, self._material, self._data = (
            np.zeros(len(self._tangent.columns)) for _ in range(3)
        )
        self._state, self._has_material = model.assembled, False
        tangent, size = self._tangent, model.size_local
        sizes = ((size, None), (size, None))
        self.upper = PETSc.Mat().createAIJWithArrays(
            sizes, (tangent.indptr, tangent.columns, self._data), comm=comm
        )
        self.upper.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.upper.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
        self.matrix = self.upper
        self._rhs, self._solution = self.upper.createVecRight(), self.upper.createVecLeft()
        default = "cholmod" if comm.size == 1 and _has_cholmod() else "mumps"
        options = PETSc.Options(PREFIX)
        self.package = options.getString("pc_factor_mat_solver_type", default)
        if self.package == "cholmod":
            # CHOLMOD reads this format in place; it copies AIJ, and loses the copy when it fails.
            self.matrix = self.upper.convert("sbaij", PETSc.Mat())
            # Its other method, for small matrices, accepts negative pivots.
            options["mat_cholmod_factor"] = "SUPERNODAL"
            if not options.hasName("mat_cholmod_print"):
                options["mat_cholmod_print"] = 0  # an indefinite tangent is expected here
        self.ksp = PETSc.KSP().create(comm)
        self.ksp.setOptionsPrefix(PREFIX)
        self.ksp.setType(PETSc.KSP.Type.PREONLY)
        self.ksp.setOperators(self.matrix)
        pc = self.ksp.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(self.package)
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        factor.setOptionsPrefix(PREFIX)
        if self.package == "mumps":
            factor.setMumpsIcntl(13, 1)  # no ScaLAPACK root, which would hide its negative pivots
            self._space = 60
            factor.setMumpsIcntl(14, self._space)  # per cent of room for delayed pivots
        self.ksp.setFromOptions()
        # The analysis is done once, on the identity, where it cannot fail.
        self._data[:] = 0.0
        self._data[tangent.diagonal] = 1.0
        self._update()
        self.ksp.setUp()
        self.ordering: str | None = None
        if self.package == "mumps":
            names = PARALLEL_ORDERINGS if factor.getMumpsInfog(32) == 2 else ORDERINGS
            code = factor.getMumpsInfog(7)
            self.ordering = names.get(code, str(code))

    def assemble(self, state: Floats) -> None:
        """Assemble the tangent at a state."""
        self._tangent.assemble(state, self._exact)
        self._state, self._has_material = state, False
        # One value per vertex: a flat membrane has no stiffness across its plane.
        diagonal = np.abs(self._exact[self._tangent.diagonal])
        by_vertex = self._model.positions(diagonal)
        by_vertex[:] = by_vertex.mean(axis=1)[:, None]
        self.scale = diagonal * self._model.free

    def fill(self, shift: float = 0.0, diagonal: float = 0.0) -> None:
        """Put K + shift · M + diagonal · D into the matrix, D the mean diagonal of a vertex."""
        self._data[:] = self._exact
        if diagonal:
            self._data[self._tangent.diagonal] += diagonal * self.scale
        if shift:
            if not self._has_material:
                self._tangent.assemble(self._state, self._material, geometric=0.0)
                self._material[self._tangent.diagonal] += LEAST * self.scale
                self._has_material = True
            self._data += shift * self._material
        self._update()

    def factorise(self, shift: float = 0.0, diagonal: float = 0.0) -> bool:
        """Factorise the matrix of `fill`; return whether it is positive definite, on all ranks."""
        self.fill(shift, diagonal)
        self.ksp.setOperators(self.matrix)
        self.count += 1
        try:
            self.ksp.setUp()
        except PETSc.Error as error:
            if error.ierr != NOT_POSITIVE:
                raise
            return False
        return self.package != "mumps" or self._mumps_outcome(shift, diagonal)

    def multiply(self, x: Floats) -> Floats:
        """Return K x with the last assembled K, without shift, zero at fixed components."""
        return self._tangent.multiply(self._exact, x) * self._model.free

    def solve(self, rhs: Floats) -> Floats:
        """Solve with the last factorisation, whatever has been assembled since.

        Returns:
            The solution, zero at fixed components.
        """
        self._rhs.array[:] = rhs
        # The KSP would factorise again after `fill`.
        self.ksp.getPC().getFactorMatrix().solve(self._rhs, self._solution)
        return self._solution.array * self._model.free

    def _update(self) -> None:
        if self._model.skin.comm.size == 1:
            self.upper.stateIncrease()  # its values are `_data` itself
        else:
            self.upper.setValuesCSR(self._tangent.indptr, self._tangent.columns, self._data)
            self.upper.assemble()
        if self.matrix is not self.upper:
            self.upper.convert("sbaij", self.matrix)

    def _mumps_outcome(self, shift: float, diagonal: float) -> bool:
        factor = self.ksp.getPC().getFactorMatrix()
        code = factor.getMumpsInfog(1)
        if code in MORE_SPACE and self._space < LARGEST_SPACE:
            self._space *= 4
            factor.setMumpsIcntl(14, self._space)
            return self.factorise(shift, diagonal)
        if code < 0 and code != SINGULAR:
            raise TorosError(
                f"MUMPS could not factorise the tangent of {self.matrix.getSize()[0]} unknowns: "
                f"INFOG(1) = {code}, INFOG(2) = {factor.getMumpsInfog(2)}. If memory ran out "
                "(-13), use a coarser mesh or more ranks on other machines."
            )
        return code != SINGULAR and factor.getMumpsInfog(12) == 0


def _has_cholmod() -> bool:
    """Return whether PETSc has CHOLMOD; its list of packages is not always complete."""
    matrix = PETSc.Mat().createSBAIJ((1, 1), 1, nnz=1, comm=PETSc.COMM_SELF)
    matrix.setUp()
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(matrix)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("cholmod")
    try:
        pc.setFactorSetUpSolverType()
    except PETSc.Error:
        return False
    return True
