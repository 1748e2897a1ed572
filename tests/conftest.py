"""Shared scenes. A failure under MPI ends all ranks: the others may wait for this one."""

from __future__ import annotations

import gc
import io
import itertools
import os
import sys
from collections.abc import Callable, Generator
from typing import Any

import pytest
from helpers.blank_pictures import blank_pictures
from helpers.scenes import ROOT
from helpers.standing import solver_on_base
from helpers.top_level import files_on_disk
from kit.durations import order_by_durations, write_durations
from kit.kept_meshes import KeptMeshes, mesher
from kit.pin import pin
from kit.skips import unexpected_skips
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin, cylinder, sew


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    if MPI.COMM_WORLD.rank > 0:  # one rank's report is enough
        config.get_terminal_writer()._file = io.StringIO()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-pins", action="store_true", help="write tests/golden/*.csv anew")
    parser.addoption(
        "--write-durations", action="store_true", help="write this leg of tests/durations.csv anew"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out of several ranks what takes no communicator; run the longest files first."""
    ranks = MPI.COMM_WORLD.size
    if ranks > 1:
        alone = [item for item in items if "comm" not in item.fixturenames]  # type: ignore[attr-defined]
        config.hook.pytest_deselected(items=alone)
        items[:] = [item for item in items if item not in set(alone)]
    order_by_durations(items, ranks)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where all must be there and a test was skipped for another reason than its ranks."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if "TOROS_REQUIRE_ALL" not in os.environ or reporter is None:
        return
    if lacking := unexpected_skips(reporter.stats.get("skipped", ())):
        reporter.write_line("\nskipped, but all must be there:\n  " + "\n  ".join(lacking))
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    if config.getoption("--write-durations") and MPI.COMM_WORLD.rank == 0:
        write_durations(itertools.chain(*terminalreporter.stats.values()), MPI.COMM_WORLD.size)


def pytest_collection_finish() -> None:
    """Take modules and tests out of what the garbage collector looks at after each file."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and MPI.COMM_WORLD.size > 1:
        item.config.pluginmanager.getplugin("capturemanager").suspend_global_capture(in_=True)
        who = f"rank {MPI.COMM_WORLD.rank}: {report.nodeid} failed"
        print(f"\n{who}\n{report.longreprtext}", file=sys.stderr, flush=True)
        MPI.COMM_WORLD.Abort(1)
    return report


@pytest.fixture(scope="module", autouse=True)
def _clean_up() -> Generator[None]:
    """Free what a file's tests leave behind, on all ranks together.

    PETSc keeps distributed objects until all ranks have dropped them and meet here.
    """
    yield
    gc.collect()
    PETSc.garbage_cleanup()
    MPI.COMM_WORLD.barrier()


@pytest.fixture(scope="module", autouse=True)
def _nothing_left_behind() -> Generator[None]:
    """No file's tests write into the checkout's top level."""
    before = files_on_disk()
    yield
    assert files_on_disk() == before


@pytest.fixture(scope="session")
def comm() -> MPI.Comm:
    """All ranks. Only tests that take it, by themselves or through a fixture, run on several."""
    return MPI.COMM_WORLD


@pytest.fixture(scope="session")
def alone() -> MPI.Comm:
    """One rank, for what does not depend on their number."""
    return MPI.COMM_SELF


@pytest.fixture
def pinned(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Compare a result with its table in tests/golden: `pinned(name, found, rel=1e-6)`."""
    write = request.config.getoption("--write-pins") and MPI.COMM_WORLD.rank == 0

    def check(name: str, found: Any, *, rel: float = 1e-6, small: float = 1e-12) -> None:
        off = pin(name, found, rel, small, write=write)
        assert not off, f"{len(off)} quantities of {name} changed:\n  " + "\n  ".join(off[:20])

    return check


@pytest.fixture(scope="module")
def kept_meshes(request: pytest.FixtureRequest) -> Generator[None]:
    """Unstructured meshes come from tests/golden/meshes.npz, not from gmsh."""
    kept = KeptMeshes(mesher() if request.config.getoption("--write-pins") else None)
    with pytest.MonkeyPatch.context() as patch:
        kept.patch(patch)
        yield
    if MPI.COMM_WORLD.rank == 0:
        kept.save()


@pytest.fixture(scope="module")
def without_pictures() -> Generator[None]:
    """Runs draw nothing, as where matplotlib is missing: pictures are most of a short run.

    The page of a run is made: its charts, and what it shows of a skin.
    """
    page = {"curves", "style", "shown", "raster"}
    pictures = {path.stem for path in (ROOT / "toros_fem" / "results" / "pictures").glob("*.py")}
    with pytest.MonkeyPatch.context() as patch:
        for name in pictures - page:
            patch.setitem(sys.modules, f"toros_fem.results.pictures.{name}", None)
        yield


@pytest.fixture(scope="module")
def few_pictures() -> Generator[None]:
    """Pictures are empty files; tests/results/pictures looks at them."""
    with blank_pictures():
        yield


@pytest.fixture(scope="session")
def tube(comm: MPI.Comm) -> Skin:
    """A short capped tube of about 600 triangles."""
    return sew(comm, cylinder(comm, 0.06, 0.02, 4.5e-3))


@pytest.fixture(scope="session")
def short_tube(alone: MPI.Comm) -> Skin:
    """The same on one rank."""
    return sew(alone, cylinder(alone, 0.06, 0.02, 4.5e-3))


@pytest.fixture(scope="session")
def short_solver(short_tube: Skin) -> EquilibriumSolver:
    """The same as `tube_solver` on one rank."""
    return solver_on_base(short_tube)


@pytest.fixture(scope="session")
def tube_solver(tube: Skin) -> EquilibriumSolver:
    """The short tube with the default materials, bending included, its base clamped."""
    return solver_on_base(tube)
