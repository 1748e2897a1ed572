"""Inflate a small tube with the installed package: what a new environment must be able to do."""

import numpy as np
from mpi4py import MPI

import toros_fem as tf

comm = MPI.COMM_WORLD
pattern = tf.meshes.cylinder(comm, length=0.04, diameter=0.02, edge_length=6e-3)
skin = tf.sew(comm, pattern)
solver = tf.EquilibriumSolver(skin, tf.Composite(), tf.clamp(pattern, ["base"]))
result = solver.solve(np.zeros(len(skin.owned_cells)), 1e3)
assert result.converged, result.reason
swelling = tf.swelling(pattern, skin.gather_vertices(result.positions))
assert 1.05 < swelling < 1.5, swelling
if comm.rank == 0:
    print(f"toros_fem {tf.__version__} in {tf.__file__}")
    print(f"a tube of it grew to {swelling:.3f} times its radius")
