"""Frames: shapes of a run, written one by one while it computes, for reports and animations.

They lie in the folder `frames` of a run (docs/report.md). They are NumPy's npz files without
pickled objects, in SI units.
"""

from toros_fem.results.frames.files import Frame, read_frames, write_frame
from toros_fem.results.frames.shown_skin import ShownSkin, read_skin, write_skin

__all__ = [
    "Frame",
    "ShownSkin",
    "read_frames",
    "read_skin",
    "write_frame",
    "write_skin",
]
