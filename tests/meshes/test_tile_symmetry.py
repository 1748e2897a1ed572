"""The operations of the symmetries of a tile."""

import numpy as np

from toros_fem.meshes import SYMMETRIES


def test_symmetries_are_groups_with_the_identity_first() -> None:
    assert [len(group) for group in SYMMETRIES.values()] == [1, 4, 4, 8]
    for group in SYMMETRIES.values():
        assert (group[0] == np.eye(2)).all()
        members = {tuple(operation.ravel()) for operation in group}
        assert {tuple((a @ b).ravel()) for a in group for b in group} == members
