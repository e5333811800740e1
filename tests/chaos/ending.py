"""How a short run has to end, and what of it did not hold."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bus.nodes import process_name
from deploy.run_folder.baseline import faults_of
from deploy.scenario import load
from deploy.simulation import Simulation
from tests.chaos.short_run import ShortRun
from world.terms import STATION

__all__ = ["AS_ASKED", "IN_ORDER", "LOST", "UNWRITTEN", "Expected", "problems"]

AS_ASKED: Final[Mapping[int, Sequence[str]]] = {0: ("time_limit", "searched")}
"""By exit status: the statuses that the summary may have. None at all where there need not be a summary."""
IN_ORDER: Final[Mapping[int, Sequence[str]]] = {0: ("interrupted", "time_limit", "searched"), 130: ()}
LOST: Final[Mapping[int, Sequence[str]]] = {1: ("failed",)}
UNWRITTEN: Final = " could not be written: "
_ENDS_WITHIN_S: Final = 100.0
_LEFT_WITHIN_S: Final = 20.0
_NOTICED_S: Final = 1.0
"""A death that is no longer before the end of the last tick may not have been noticed."""


@dataclass(frozen=True)
class Expected:
    """How a run ends after some trouble."""

    ends: Mapping[int, Sequence[str]]
    """By exit status: the statuses that the summary may have; none where there need not be a summary."""
    faulty: frozenset[str] = frozenset()
    """Processes besides those that were struck that the run may leave out."""
    honest: bool = True
    """Whether only processes of the run took part: then every scan report is accounted for."""
    digest: bool = True
    """Whether the summary must have one."""
    failures: str | None = None
    """A pattern of all failures; None: they are not looked at."""
    also: tuple[str, ...] = ()
    """What the trouble itself saw that should not be."""


def problems(run: ShortRun, expected: Expected) -> list[str]:
    """Wait for the end of a run, look at all that it leaves, and run it again; tells what did not hold."""
    status = run.end(_ENDS_WITHIN_S)
    found = [*expected.also, *_left_behind(run)]
    if status is None:
        return [f"ended within {_ENDS_WITHIN_S:g} s", *found]
    if status not in expected.ends:
        said = run.errors.decode(errors="replace")[:1500]
        found.append(f"exit status {' or '.join(map(str, expected.ends))}, and it was {status}: {said}")
    found += _said(run, status, expected)
    summary = run.summary()
    endings = expected.ends.get(status, ())
    if summary is not None and status in (0, 1):
        if endings and summary["status"] not in endings:
            found.append(f"status {' or '.join(endings)} in the summary, and it was {summary['status']}")
        found += _verdicts(run, summary, expected)
        found += _failures(summary, status, expected)
        found += _run_again(run, summary, expected)
    elif endings and f"summary.json{UNWRITTEN}".encode() not in run.errors:
        found.append("a summary")
    return found


def _left_behind(run: ShortRun) -> Iterator[str]:
    deadline = time.monotonic() + _LEFT_WITHIN_S
    while (there := run.place.processes()) and time.monotonic() < deadline:
        time.sleep(0.05)
    for pid in there:
        yield f"no process left, and {pid} is there ({_title(pid)})"
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    if left := sorted(str(path.relative_to(run.place.path)) for path in run.place.path.rglob("*")):
        yield f"no temporary file left, and there are {left[:5]}"
    if (run.out / "operator.json").exists():
        yield "no login left, and operator.json is there"
    drafts = sorted(path.name for path in run.out.glob("*.part"))
    if drafts and run.process.returncode != -signal.SIGKILL:  # a launcher that is killed can't take them away
        yield f"no half file, and there is {drafts}"


def _title(pid: int) -> str:
    with contextlib.suppress(OSError):
        title = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ")
        return title.decode(errors="replace").strip()[:80]
    return "gone meanwhile"


def _said(run: ShortRun, status: int, expected: Expected) -> Iterator[str]:
    errors = run.errors.decode(errors="replace")
    if "Traceback" in errors:
        yield f"no traceback on standard error, and it was {errors[-1500:]!r}"
    if status == 0 and errors:
        yield f"nothing on standard error, and it was {errors[:500]!r}"
    if status == 2 and errors.count("\n") != 1:
        yield f"one line on standard error, and it was {errors[:500]!r}"
    if status == 1 and not errors:
        yield "a line on standard error"
    for log in sorted(run.out.glob("logs/*.log")):
        text = log.read_text(encoding="utf-8", errors="replace")
        if "Traceback" in text or "panicked" in text:
            yield f"no traceback in {log.name}, and it was {text[-1500:]!r}"
    if expected.failures is None and UNWRITTEN in errors:
        yield f"all files written, and it said {errors[:500]!r}"


def _failures(summary: Mapping[str, Any], status: int, expected: Expected) -> Iterator[str]:
    failures = summary["failures"]
    if status == 0 and failures:
        yield f"no failures in the summary, and there are {failures}"
    for failure in failures if expected.failures is not None else ():
        if not re.fullmatch(expected.failures, failure, re.DOTALL):
            yield f"no failure but '{expected.failures}', and there is {failure!r}"


def _verdicts(run: ShortRun, summary: Mapping[str, Any], expected: Expected) -> Iterator[str]:
    """Faults are those of who was struck, each has its verdict, and no scan report is lost."""
    if summary["status"] == "failed":
        return  # the world was lost, with all that it knew
    told = {process_name(STATION if f["target"] == "station" else int(f["target"])) for f in summary["faults"]}
    if strangers := sorted(told - run.struck - expected.faulty):
        yield f"no faults but of {sorted(run.struck | expected.faulty)}, and there are of {strangers}"
    if silent := sorted(_noticed(run, summary) - told):
        yield f"a fault for each process that was killed, and none of {silent}"
    given = [verdict["fault"] for verdict in summary["recoveries"]]
    if len(given) != len(summary["faults"]):
        yield f"a verdict on each of {len(summary['faults'])} faults, and there are {given}"
    if any(verdict["recovered"] not in (True, False, "not affected") for verdict in summary["recoveries"]):
        yield f"verdicts that are one of three, and they are {summary['recoveries']}"
    reports = summary["scan_reports"]
    if expected.honest and (reports["lost"] or reports["foreign"]):
        yield f"every scan report accounted for, and there are {reports}"
    if expected.honest and any(verdict["scan_reports"]["lost"] for verdict in summary["recoveries"]):
        yield "no scan report lost by a fault"


def _noticed(run: ShortRun, summary: Mapping[str, Any]) -> set[str]:
    """Nodes that were killed so long before the end that the world knows."""
    if summary["ticked_unix_s"] is None:
        return set()
    first_unix_s, last_unix_s = summary["ticked_unix_s"]
    return {
        strike.name
        for strike in run.strikes
        if strike.number == signal.SIGKILL
        and strike.at_unix_s < last_unix_s - _NOTICED_S
        and strike.name not in ("launcher", "world", "medium")
        # It is started again at once, so it may still be there in time for the first tick.
        and not (strike.name == "station" and strike.at_unix_s < first_unix_s)
    }


def _run_again(run: ShortRun, summary: Mapping[str, Any], expected: Expected) -> Iterator[str]:
    """The same faults at the same ticks give the same digest."""
    if summary["status"] == "failed" or not summary["ticks"]:
        return
    if summary["trace_sha256"] is None:
        if expected.digest:
            yield "a digest in the summary"
        return
    scenario = load(run.out / "scenario.toml", {"fault": faults_of(run.out)}, own_faults=False)
    again = Simulation(scenario)
    for _ in range(summary["ticks"]):
        again.step()
    if again.medium.final()["trace_sha256"] != summary["trace_sha256"]:
        yield f"the digest of the replay, and it was another (faults: {summary['faults']})"
    if again.world.final()["faults"] != summary["faults"]:
        yield f"the faults of the replay, and they were {summary['faults']} and {again.world.final()['faults']}"
