"""A copy of the sources in which one file at a time is changed, and the tests that run in it."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests import ROOT
from tests.mutants import quick

PACKAGES: Final = ("agents", "bus", "deploy", "docs", "medium", "monitor_station", "tests", "world")
FILES: Final = ("pyproject.toml", "setup.py")
CPU_S: Final = 80
"""Processor time after which tests count as hung. No named set of tests needs a quarter of it."""

BUILD: Final = (
    "import bus.built, runpy, sys\n"
    "bus.built.LOOPS = (sys.argv.pop(),)\n"
    "sys.argv = ['setup.py', '-q', 'build_ext', '--inplace']\n"
    "runpy.run_path('setup.py', run_name='__main__')\n"
)
"""Builds one file of loops alone."""


class TreeError(Exception):
    """The tests could not be run, so they tell nothing."""


class Tree:
    """The copy. Files of loops are built again when they are changed."""

    def __init__(self, folder: Path) -> None:
        """Copy the sources of this repository, as they are now, into an empty folder."""
        self.path = folder
        for name in PACKAGES:
            shutil.copytree(
                ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "images", "results")
            )
        for name in FILES:
            shutil.copy2(ROOT / name, folder / name)
        # Loops of a mutant run once, so the compiler's time is what counts. Doubles are the same.
        setup = folder / "setup.py"
        slow = setup.read_text(encoding="utf-8").replace("-O3", "-O0").replace("-O2", "-O0")
        setup.write_text(slow, encoding="utf-8")
        form = "import agents.vds, sys; sys.stdout.write(agents.vds.__file__)"
        imported = self._python("-c", form).stdout
        if imported != str(folder / "agents" / "vds.py"):
            raise TreeError(f"Python takes {imported}, not the copy in {folder}")

    @contextlib.contextmanager
    def changed(self, path: str, text: str) -> Iterator[None]:
        """While it lasts, the file `path` has this text."""
        source = self.path / path
        original = source.read_text(encoding="utf-8")
        built = sorted(source.parent.glob(f"{source.stem}.*.so")) if source.suffix == ".pyx" else []
        loops = [(library, library.read_bytes()) for library in built]
        try:
            self._write(source, text)
            if source.suffix == ".pyx":
                self._build(source)
            yield
        finally:
            self._write(source, original)
            for library, content in loops:
                library.write_bytes(content)

    def passes(self, tests: tuple[str, ...]) -> bool:
        """Whether tests (files, or tests within them) pass; those that do not even start or end do not.

        Raises:
            TreeError: there are no such tests.
        """
        options = ["-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider"]
        profile = ["-p", quick.__name__, "--hypothesis-profile", quick.PROFILE]
        done = self._python("-m", "pytest", *options, *profile, *tests)
        if done.returncode in (4, 5):
            raise TreeError(f"no tests: {' '.join(tests)}: {(done.stdout + done.stderr).strip()[-300:]}")
        return done.returncode == 0

    @staticmethod
    def _write(source: Path, text: str) -> None:
        source.write_text(text, encoding="utf-8")
        # Bytecode counts as fresh if size and second of the source are those that it was made of.
        Path(importlib.util.cache_from_source(source)).unlink(missing_ok=True)

    def _build(self, source: Path) -> None:
        name = ".".join(source.relative_to(self.path).with_suffix("").parts)
        done = self._python("-c", BUILD, name)
        if done.returncode:
            raise TreeError(f"{source} can't be built: {done.stderr.strip()[-2000:]}")

    def _python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        # With one seed for all hashes a mutant has the same fate at every run.
        environment = os.environ | {"PYTHONPATH": str(self.path), "PYTHONHASHSEED": "0"}
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=self.path, env=environment, capture_output=True, text=True, check=False, preexec_fn=_limit,
        )  # fmt: skip


def _limit() -> None:
    """Who never ends is killed; processor time does not depend on what else the machine does."""
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
