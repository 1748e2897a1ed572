"""Array types of all modules."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]
LocalInts: TypeAlias = npt.NDArray[np.int32]
"""Numbers local to a rank, as dolfinx keeps them."""
Bools: TypeAlias = npt.NDArray[np.bool_]
