"""Archives: what other versions of NumPy write, and numbers of NumPy's own types."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from toros_fem.base.errors import OutputError
from toros_fem.base.files import Archive, read_archive, write_archive


def read(path: Path) -> Archive:
    return read_archive(path, "pattern", lambda archive: archive, OutputError, "Delete it.")


@pytest.mark.parametrize("compress", [True, False])
def test_numpy_before_2_2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compress: bool) -> None:
    """Its `savez` has no `allow_pickle`: whatever is named is an entry of the file."""

    def older(save: Callable[..., None]) -> Callable[..., None]:
        def savez(file: Any, **entries: Any) -> None:
            if "allow_pickle" in entries:  # today's would take it for an option
                entries["of an older version"] = np.asarray(entries.pop("allow_pickle"))
            save(file, **entries)

        return savez

    for name in ("savez", "savez_compressed"):
        monkeypatch.setattr(np, name, older(getattr(np, name)))
    path = tmp_path / "some.npz"
    write_archive(path, Archive("pattern", {"x": np.arange(3.0)}, {"n": 1}), compress=compress)
    assert read(path).arrays["x"].tolist() == [0, 1, 2]


def test_numbers_of_numpy_are_plain_ones(tmp_path: Path) -> None:
    numbers = {"flag": np.True_, "length": np.float32(0.5), "count": np.int64(3)}
    path = tmp_path / "some.npz"
    write_archive(path, Archive("pattern", {}, numbers))
    assert read(path).numbers == {"flag": True, "length": 0.5, "count": 3}
