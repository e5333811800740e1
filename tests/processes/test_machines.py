"""Machines that are not as one expects: long folders, few files, no working folder, no UTF-8."""

from __future__ import annotations

import resource
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.helpers.running import Running, command

pytestmark = pytest.mark.processes

SHORT = ("--robots", 3, "--duration", 3)
Start = Callable[..., Running]


def test_a_long_folder_for_temporary_files_is_no_matter(start: Start, tmp_path: Path) -> None:
    """The path of a socket has 107 bytes at most."""
    long = tmp_path / ("x" * 100)
    long.mkdir()
    running = start(*SHORT, environment={"TMPDIR": str(long)})
    assert running.ended()[::2] == (0, "")
    assert not list(long.iterdir())


def test_a_limit_of_open_files_is_told_before_the_start(start: Start) -> None:
    running = start(*SHORT, first=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (32, 32)))
    status, out, errors = running.ended()
    assert (status, out, errors.count("\n")) == (2, "", 1), errors
    assert "ulimit -n" in errors
    assert not running.out.exists()


@pytest.mark.parametrize("limits", [(32, 200), (40, 2000)])
def test_a_limit_that_may_be_raised_is(start: Start, limits: tuple[int, int]) -> None:
    running = start("--robots", 9, "--duration", 3, first=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, limits))
    assert running.ended()[::2] == (0, "")


def test_one_process_needs_few_files(start: Start) -> None:
    running = start(*SHORT, "--in-process", first=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (32, 32)))
    assert running.ended()[::2] == (0, "")


@pytest.mark.parametrize("engine", [(), ("--in-process",)], ids=["processes", "in process"])
def test_a_working_folder_that_was_deleted(tmp_path: Path, engine: tuple[str, ...]) -> None:
    here = tmp_path / "here"
    for out, status, lines in (tmp_path / "run", 0, 0), ("run", 2, 1):
        here.mkdir()
        words = command(*SHORT, "-q", *engine, "--out", out)
        ended = subprocess.run(
            ["/bin/sh", "-c", 'rmdir "$PWD" && exec "$@"', "sh", *words], cwd=here, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert (ended.returncode, ended.stderr.count("\n")) == (status, lines), ended.stderr
    assert (tmp_path / "run" / "summary.json").exists()
    assert not here.exists()


@pytest.mark.parametrize("engine", [(), ("--in-process",)], ids=["processes", "in process"])
def test_a_locale_without_utf_8_takes_any_name(tmp_path: Path, engine: tuple[str, ...]) -> None:
    ended = subprocess.run(
        command(*SHORT, *engine, "--set", 'name = "Höhle"'), cwd=tmp_path, capture_output=True,
        env={"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"}, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, b"")
    (run,) = (tmp_path / "runs").iterdir()
    assert run.name.startswith("Höhle-")
    assert f"summary: runs/{run.name}/summary.json".encode() in ended.stdout


@pytest.mark.parametrize("name", [b"caf\xe9", b"a\nb", "Höhle é".encode(), b"a#b?c*d", b"@run", b"-x"])
def test_any_folder_will_do(tmp_path: Path, name: bytes) -> None:
    """Also one whose name is no text, or means something to the bus or to a terminal."""
    script = command(*SHORT)
    ended = subprocess.run([*script, b"--out=" + name], cwd=tmp_path, capture_output=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, b"")
    (run,) = tmp_path.iterdir()
    assert bytes(run).endswith(b"/" + name)
    assert (run / "recording.rrd").exists()


def test_output_that_cannot_show_a_name_shows_it_otherwise(tmp_path: Path) -> None:
    ended = subprocess.run(
        command(*SHORT, "--in-process", "--out", "Höhle"), cwd=tmp_path, capture_output=True,
        env={"PYTHONIOENCODING": "ascii", "LC_ALL": "C.UTF-8"}, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert rb"run folder H\xf6hle" in ended.stdout
