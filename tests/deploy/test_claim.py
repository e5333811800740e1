"""A run's folder is new, empty or an earlier run's, and belongs to one run at a time."""

from __future__ import annotations

import fcntl
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest

from deploy.processes.operator_file import OPERATOR
from deploy.run_folder.claim import LOCK, Claim, ClaimError, new_folder, take_lock
from deploy.run_folder.writer import RunFolder
from deploy.scenario import load
from tests import ROOT

LEFT = (
    "summary.json", "recording.rrd", "recording-2.rrd", "journal", "map.yaml", "map.pgm", "logs/world.log",
    "report.html",
)  # fmt: skip
"""Of an earlier run."""


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """The folder of a run that has ended."""
    RunFolder(tmp_path / "run", load("three_cells")).close()
    (tmp_path / "run" / "logs").mkdir()
    for name in LEFT:
        (tmp_path / "run" / name).write_text("old")
    return tmp_path / "run"


@pytest.fixture
def claim() -> Iterator[Callable[..., Claim]]:
    held: list[Claim] = []

    def take(path: Path, *, overwrite: bool = False, reads: tuple[Path, ...] = ()) -> Claim:
        held.append(Claim(path, overwrite=overwrite, reads=reads))
        return held[-1]

    yield take
    for each in held:
        each.release()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_new_and_an_empty_folder_are_taken(tmp_path: Path, claim: Callable[..., Claim]) -> None:
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "a" / "b"):
        claim(folder)
        assert contents(folder).keys() == {LOCK}


@pytest.mark.parametrize("name", ["map.yaml", "scenario.toml", "notes.txt", ".hidden", "logs/world.log"])
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_of_the_users_is_left_alone(tmp_path: Path, name: str, overwrite: bool) -> None:
    """Even if every name in it is one that a run writes, too."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(ClaimError, match=f"holds {name.partition('/')[0]}, which no run wrote"):
        Claim(tmp_path, overwrite=overwrite)
    assert contents(tmp_path) == {name: b"mine"}


def test_an_earlier_run_is_replaced_only_if_asked_and_then_whole(earlier: Path, claim: Callable[..., Claim]) -> None:
    before = contents(earlier)
    with pytest.raises(ClaimError, match="--overwrite"):
        Claim(earlier)
    assert contents(earlier) == before
    claim(earlier, overwrite=True)
    assert contents(earlier).keys() == {LOCK}


@pytest.mark.parametrize("name", ["notes.txt", "logs/notes.txt"])
def test_what_the_user_put_beside_an_earlier_run_is_safe(earlier: Path, name: str) -> None:
    (earlier / name).write_text("mine")
    before = contents(earlier)
    with pytest.raises(ClaimError, match=f"holds {name}, which no run wrote"):
        Claim(earlier, overwrite=True)
    assert contents(earlier) == before


def test_a_run_does_not_replace_what_it_reads(earlier: Path, tmp_path: Path) -> None:
    before = contents(earlier)
    (tmp_path / "link").symlink_to(earlier)
    for read in (earlier, earlier / "map.yaml", tmp_path / "link" / "scenario.toml"):
        with pytest.raises(ClaimError, match="this run reads"):
            Claim(earlier, overwrite=True, reads=[read])
    assert contents(earlier) == before


def test_links_are_removed_and_never_followed(earlier: Path, tmp_path: Path, claim: Callable[..., Claim]) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    (earlier / "journal").unlink()
    (earlier / "journal").symlink_to(tmp_path / "mine" / "notes.txt")
    (earlier / "recording-3.rrd").symlink_to(tmp_path / "mine")
    claim(earlier, overwrite=True)
    assert contents(tmp_path / "mine") == {"notes.txt": b"mine"}
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / LOCK).symlink_to(tmp_path / "mine" / "notes.txt")
    with pytest.raises(ClaimError):
        Claim(tmp_path / "other")
    assert contents(tmp_path / "mine") == {"notes.txt": b"mine"}


def test_of_two_runs_in_one_folder_the_second_is_refused(tmp_path: Path, claim: Callable[..., Claim]) -> None:
    claim(tmp_path / "run")
    with pytest.raises(ClaimError, match=r"a run is under way there \(pid \d+\)"):
        Claim(tmp_path / "run", overwrite=True)


def test_a_lock_on_a_file_that_was_removed_meanwhile_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between its opening and its locking the earlier holder gave up, and a third run has made the file anew."""
    flock = fcntl.flock

    def late(lock: IO[bytes], how: int) -> None:
        (tmp_path / LOCK).unlink()
        (tmp_path / LOCK).touch()
        flock(lock, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(ClaimError, match="a run is under way there"):
        take_lock(tmp_path / LOCK)


def test_what_the_user_puts_there_before_the_lock_is_safe(earlier: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def late(path: Path) -> IO[bytes]:
        (path.parent / "notes.txt").write_text("mine")
        return take_lock(path)

    monkeypatch.setattr("deploy.run_folder.claim.take_lock", late)
    before = contents(earlier)
    with pytest.raises(ClaimError, match=r"holds notes\.txt, which no run wrote"):
        Claim(earlier, overwrite=True)
    assert {name: text for name, text in contents(earlier).items() if name != LOCK} == {
        name: text for name, text in before.items() if name != LOCK
    } | {"notes.txt": b"mine"}


HOLDER = """
import sys
from pathlib import Path
from deploy.run_folder.claim import Claim
held = Claim(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def test_a_lock_goes_with_who_holds_it(tmp_path: Path, claim: Callable[..., Claim]) -> None:
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "run")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        with pytest.raises(ClaimError, match=f"pid {holder.pid}"):
            Claim(tmp_path / "run")
        holder.kill()
    claim(tmp_path / "run")


def test_two_runs_that_start_at_once_get_folders_of_their_own(tmp_path: Path) -> None:
    made = [new_folder(tmp_path / "runs", "three_cells") for _ in range(3)]
    assert [path.name for path in made] == ["three_cells", "three_cells-2", "three_cells-3"]


def test_a_run_that_cannot_begin_leaves_nothing(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "new" / "run", load("three_cells"))
    (folder.path / OPERATOR).touch()
    folder.discard()
    assert not (tmp_path / "new" / "run").exists()
    (tmp_path / "empty").mkdir()
    RunFolder(tmp_path / "empty", load("three_cells")).discard()
    assert not list((tmp_path / "empty").iterdir())
