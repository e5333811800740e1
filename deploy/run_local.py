#!/usr/bin/env python3
"""Run one scenario on this machine, one process per robot: `deploy/run_local.py --robots 9`.

Exit status: 0 when the run ended as asked, 1 when a process failed or no robot was left, 2 for bad input (one line,
before anything starts).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from deploy.command import Parser
    from deploy.run_folder.baseline import Baseline
    from deploy.scenario import Scenario
    from deploy.screen.view import View


class BadInputError(Exception):
    """Something that was asked for can't be; one line for the user."""


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser

    p = Parser(prog="run_local.py", description="Emulate a multi-robot victim search, one process per robot.")
    p.add_argument("--robots", type=int, metavar="N", help="how many robots (default: the scenario's)")
    p.add_argument("--scenario", metavar="NAME|FILE", help="a name (three_cells), a .toml file or a map's .yaml")
    p.add_argument("--radius", type=float, metavar="M", help="transmission radius r_t in metres")
    p.add_argument("--seed", type=int, metavar="N", help="of everything random")
    p.add_argument("--speed", metavar="max|F", help="max, or simulated seconds per wall second")
    p.add_argument("--duration", type=float, metavar="S", help="simulated seconds after which the run ends")
    p.add_argument("--policy", metavar="NAME", help="rules of the robots: vds (the paper's), scout, or module:Class")
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="any other key of a scenario")
    p.add_argument("--fault", action="append", default=[], metavar="VERB:TARGET@T[+D]", help="e.g. kill:relay:mid@90")
    p.add_argument(
        "--replay-faults", type=Path, metavar="RUN_DIR",
        help="all that befell an earlier run, by schedule or by hand (and its scenario, unless --scenario is given)",
    )  # fmt: skip
    p.add_argument(
        "--compare", type=Path, metavar="RUN_DIR", help="a run without the fault: the summary tells the time lost"
    )
    p.add_argument("--hold", action="store_true", help="begin held: `deploy/ctl.py step` or `go` lets it run")
    p.add_argument("--out", type=Path, metavar="DIR", help="run folder (default runs/SCENARIO-TIME)")
    p.add_argument(
        "--port", type=int, metavar="N", help="TCP port of the run's router (default: a free one, or a socket)"
    )
    p.add_argument("--live", action="store_true", help="let a Rerun viewer watch while the run goes on")
    p.add_argument("--in-process", action="store_true", help="the same run in this one process, without a bus")
    p.add_argument("--no-recording", action="store_true", help="leave no recording.rrd")
    p.add_argument("--plain-scheduling", action="store_true", help="leave it to the kernel where processes run")
    p.add_argument("-q", "--quiet", action="store_true", help="show nothing but what failed")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Check everything, then run; returns the exit status."""
    options = parser().parse_args(arguments)
    from deploy.command import refuse, require

    require(Path(__file__))
    try:
        if options.live and (options.no_recording or options.in_process):
            raise BadInputError("--live watches real processes record: not with --in-process or --no-recording")
        scenario = _scenario(options)
        baseline = _baseline(options.compare, scenario)
        endpoint = None if options.port is None else _endpoint(options.port)
        out = _folder(options.out, scenario.name)
    except BadInputError as error:
        return refuse("run_local.py", error)
    return _run(options, scenario, baseline, endpoint, out)


def _scenario(options: argparse.Namespace) -> Scenario:
    from deploy.run_folder.baseline import faults_of
    from deploy.scenario import load, parse_set

    replay: Path | None = options.replay_faults
    given = {
        "robots": options.robots,
        "radius_m": options.radius,
        "seed": options.seed,
        "duration_s": options.duration,
        "speed": _speed(options.speed),
        "policy": options.policy,
        "fault": options.fault or None,
    }
    try:
        overrides = dict(parse_set(text) for text in options.set)
        overrides |= {key: value for key, value in given.items() if value is not None}
        if replay is None:
            return load(options.scenario or "three_cells", overrides)
        overrides["fault"] = faults_of(replay) + options.fault
        return load(options.scenario or replay / "scenario.toml", overrides, own_faults=False)
    except ValueError as error:
        raise BadInputError(str(error)) from error


def _baseline(folder: Path | None, scenario: Scenario) -> Baseline | None:
    from deploy.run_folder.baseline import Baseline

    try:
        return None if folder is None else Baseline.of(folder, scenario)
    except ValueError as error:
        raise BadInputError(f"--compare: {error}") from error


def _speed(text: str | None) -> str | float | None:
    try:
        return text if text is None or text == "max" else float(text)
    except ValueError:
        raise BadInputError(f"--speed {text}: expected max or a number") from None


def _endpoint(port: int) -> str:
    from bus.session import BusError, require_free

    if not 0 < port < 65_536:
        raise BadInputError(f"--port {port}: a port is 1 to 65535")
    endpoint = f"tcp/127.0.0.1:{port}"
    try:
        require_free(endpoint)
    except BusError as error:
        raise BadInputError(f"--port {port}: {error}") from error
    return endpoint


def _folder(asked: Path | None, scenario: str) -> Path:
    """Make the run folder, or say why it can't be."""
    from deploy.processes.operator_file import living_launcher

    out = asked or _new_folder(Path("runs"), f"{scenario}-{time.strftime('%Y%m%d-%H%M%S')}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BadInputError(f"--out {out}: can't write there: {error.strerror}") from error
    if (pid := living_launcher(out)) is not None:
        raise BadInputError(f"--out {out}: a run is under way there (pid {pid})")
    return out


def _new_folder(parent: Path, name: str) -> Path:
    number, path = 1, parent / name
    while path.exists():
        number += 1
        path = parent / f"{name}-{number}"
    return path


def _run(
    options: argparse.Namespace, scenario: Scenario, baseline: Baseline | None, endpoint: str | None, out: Path
) -> int:
    from rich.console import Console

    from deploy.run_folder.writer import RunFolder

    console = Console(stderr=False, quiet=options.quiet)
    with RunFolder(out, scenario, baseline) as folder:
        view = _view(options, console, scenario.cell_names)
        pids = "" if options.in_process else f", process ids in {out / 'pids.json'}"
        view.line(f"run folder {out}{pids}")
        if scenario.remark:
            view.line(scenario.remark)
        if options.in_process:
            from deploy.in_process import run_in_process

            summary, failures = run_in_process(scenario, folder, view, record=not options.no_recording)
        else:
            summary, failures = _run_processes(options, scenario, endpoint, folder, view)
    _report(console, out, summary)
    for failure in failures:
        print(f"run_local.py: failed: {failure}", file=sys.stderr)
    return 1 if failures else 0


def _view(options: argparse.Namespace, console: Console, cells: tuple[str, ...]) -> View:
    from deploy.screen.live_table import LiveTable
    from deploy.screen.plain_lines import PlainLines
    from deploy.screen.view import Silence

    if options.quiet:
        return Silence()
    return LiveTable(console, cells) if console.is_terminal else PlainLines(console)


def _run_processes(
    options: argparse.Namespace, scenario: Scenario, endpoint: str | None, folder: Any, view: View
) -> tuple[dict[str, Any], tuple[str, ...]]:
    from bus.session import free_endpoint, local_endpoint, port_of
    from deploy.processes.fleet import Fleet
    from deploy.processes.launcher import Launcher
    from deploy.screen.live_viewer import LiveViewer, has_display

    live_port = port_of(free_endpoint()) if options.live else None
    with contextlib.ExitStack() as beside:
        if endpoint is None:
            place = Path(beside.enter_context(tempfile.TemporaryDirectory(prefix="vds-")))
            endpoint = local_endpoint(place, scenario.robots)
        fleet = Fleet(
            scenario, folder.path, endpoint, record=not options.no_recording, live_port=live_port,
            held=options.hold, plain_scheduling=options.plain_scheduling,
        )  # fmt: skip
        launcher = Launcher(fleet, folder, view)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda *_: launcher.interrupt())
        if live_port is not None:
            web_port = None if has_display(os.environ) else port_of(free_endpoint())
            beside.enter_context(LiveViewer(live_port, web_port, folder.path / "logs" / "viewer.log", view.line))
        outcome = launcher.run()
    return outcome.summary, outcome.failures


def _report(console: Console, out: Path, summary: dict[str, Any]) -> None:
    def show(words: str) -> None:
        console.print(words, markup=False, highlight=False, soft_wrap=True)

    rates = ", ".join(f"{name} {rate:.0%}" for name, rate in (summary["search_rate"] or {}).items())
    show(f"{summary['status']} after {summary['simulated_s']:.1f} s simulated in {summary['wall_s']:.1f} s "
         f"(real-time factor {summary['real_time_factor']}); searched: {rates}")  # fmt: skip
    show(f"summary: {out / 'summary.json'} (as a page: deploy/report.py {out})")
    if parts := sorted(out.glob("recording*.rrd")):
        show(f"recording: rerun {parts[0] if len(parts) == 1 else out / 'recording*.rrd'}")


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    sys.exit(main())
