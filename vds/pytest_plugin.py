"""The plugin that pytest finds by itself: the fixture `emulation`, and what a failed test shows of its runs.

Until a test asks for the fixture, nothing of the packages behind `vds` is imported: a user may have packages of the
same names (vds/packages.py).
"""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from vds.packages import ShadowedError, require_ours

if TYPE_CHECKING:
    from deploy.emulation import Emulation

__all__ = ["emulation"]

_KEPT: Final = "vds-runs"
"""Folder of pytest's cache for the runs of failed tests; of each test those of its last failure."""
_LONGEST: Final = 80


class _Runs:
    """The runs of one test."""

    def __init__(self, kept: Path | None) -> None:
        self.kept = kept
        """Where their folders go if the test fails; None = they stay where they are."""
        self.folders: list[Path] = []
        """Also of runs that did not start."""
        self.started: list[Emulation] = []
        self.failed = False
        self.shown: list[Mapping[str, Any]] = []
        """Verdicts that an assertion has shown already."""

    @property
    def verdicts(self) -> list[dict[str, Any]]:
        """All verdicts that the test asked for."""
        return [verdict for run in self.started for verdict in run.verdicts]

    def places(self) -> list[Path]:
        """Where the folders are after a failure."""
        return [folder if self.kept is None else self.kept / folder.name for folder in self.folders if folder.exists()]

    def keep(self) -> None:
        """Put the folders where they stay, in place of those of an earlier failure."""
        if self.kept is None:
            return
        shutil.rmtree(self.kept, ignore_errors=True)
        self.kept.mkdir(parents=True)
        for folder in self.folders:
            if folder.exists():
                shutil.move(folder, self.kept)


_RUNS: Final = pytest.StashKey[_Runs]()


@pytest.fixture
def emulation(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Callable[..., Emulation]]:
    """`emulation(scenario, faults=[...], robots=6, ...)` starts a run, as `vds.Emulation` does without a folder.

    All runs end with the test. If it fails, their folders are kept, and its report names them.
    """
    try:
        require_ours()
    except ShadowedError as error:
        pytest.fail(str(error), pytrace=False)
    from deploy.emulation import Emulation

    record = request.config.getoption("--vds-record")
    runs = request.node.stash[_RUNS] = request.config.stash[_RUNS] = _Runs(_kept(request.config, request.node.nodeid))
    with contextlib.ExitStack() as held:

        def start(scenario: str | Path = "three_cells", **options: Any) -> Emulation:
            folder = tmp_path / f"run-{len(runs.folders) + 1}"
            runs.folders.append(folder)
            run = held.enter_context(Emulation(scenario, folder, **{"record": record} | options))
            runs.started.append(run)
            return run

        yield start
    del request.config.stash[_RUNS]
    if runs.failed:
        runs.keep()


def _kept(config: pytest.Config, test: str) -> Path | None:
    cache = getattr(config, "cache", None)  # None with `-p no:cacheprovider`
    if cache is None:
        return None
    folder: Path = cache.mkdir(_KEPT)
    return folder / re.sub(r"[^\w.=-]+", "-", test)[-_LONGEST:].strip("-")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("vds", "the VDS emulator").addoption(
        "--vds-record", action="store_true", help="runs of the fixture emulation leave recordings"
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Name the runs of a failed test, and its verdicts."""
    report = yield
    runs = item.stash.get(_RUNS, None)
    if runs is not None and report.failed and report.when != "teardown":
        runs.failed = True
        report.sections += [("run folder", str(folder)) for folder in runs.places()]
        more = [verdict for verdict in runs.verdicts if verdict not in runs.shown]
        report.sections += [("verdict", "\n".join(_told(verdict))) for verdict in more]
    return report


def pytest_assertrepr_compare(config: pytest.Config, op: str, left: object, right: object) -> list[str] | None:
    """Show the whole verdict of which one value, or which itself, was compared."""
    runs = config.stash.get(_RUNS, None)
    if runs is None:
        return None
    for verdict in runs.verdicts:
        if any(side is verdict or any(side is value for value in verdict.values()) for side in (left, right)):
            runs.shown.append(verdict)
            return [f"{_shown(left)} {op} {_shown(right)}", "of the verdict", *_told(verdict)]
    return None


def _told(verdict: Mapping[str, Any]) -> list[str]:
    return [f"  {key}: {_shown(value)}" for key, value in verdict.items()]


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]}..."
