"""Frames: shapes of a run, written one by one while it computes, for reports and animations.

They lie in the folder `frames` of a run (docs/report.md). They are NumPy's npz files without
pickled objects, in SI units.
"""
