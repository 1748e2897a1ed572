"""What to type next works where the program runs."""

import shutil
import sys

import pytest

from toros_fem.base.packages import VARIABLE, program


def test_the_command_that_works_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
    assert program() == "toros"
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["my env/bin/toros", "new"])
    assert program() == "'my env/bin/toros'"
    monkeypatch.setattr(sys, "argv", ["x/toros_fem/__main__.py", "new"])
    monkeypatch.setattr(sys, "executable", "v/bin/python")
    assert program() == "v/bin/python -m toros_fem"
    monkeypatch.setenv(VARIABLE, "scripts/toros")
    assert program() == "scripts/toros"
