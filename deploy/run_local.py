#!/usr/bin/env python3
"""Run one scenario on this machine, one process per robot: `deploy/run_local.py --robots 9`.

Exit status: 0 when the run ended as asked, by Ctrl-C too; 1 when a process failed, no robot was left or a file could
not be written; 2 for bad input (one line, before anything starts); 130 when it was interrupted before the run began.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from deploy.command import Parser
    from deploy.machine.interrupts import Interrupts
    from deploy.machine.scratch import Scratch
    from deploy.run_folder.baseline import Baseline
    from deploy.run_folder.writer import RunFolder
    from deploy.scenario import Scenario
    from deploy.screen.view import View


class BadInputError(Exception):
    """The run can't be as the command line asks; one line for the user."""


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, a_whole_number, call_of, name_of
    from deploy.scenario_options import add_scenario_options

    p = Parser(prog=name_of("run"), description="Emulate a multi-robot victim search, one process per robot.")
    add_scenario_options(p)
    p.add_argument("--scenario", metavar="NAME|FILE", help="a name (three_cells), a .toml file or a map's .yaml")
    p.add_argument("--speed", metavar="max|F", help="max, or simulated seconds per wall second")
    p.add_argument(
        "--replay-faults", type=Path, metavar="RUN_DIR",
        help="all that befell an earlier run, by schedule or by hand (and its scenario, unless --scenario is given)",
    )  # fmt: skip
    p.add_argument(
        "--compare", type=Path, metavar="RUN_DIR", help="a run without the fault: the summary tells the time lost"
    )
    p.add_argument(
        "--external", type=a_whole_number, action="append", default=[], metavar="ID",
        help="a robot whose process is yours: the run waits for it (docs/wire.md)",
    )  # fmt: skip
    p.add_argument("--hold", action="store_true", help=f"begin held: `{call_of('ctl')} step` or `go` lets it run")
    p.add_argument(
        "--out", type=Path, metavar="DIR", help="run folder, new or empty (default: a new one, runs/SCENARIO-TIME)"
    )
    p.add_argument("--overwrite", action="store_true", help="--out may be an earlier run's folder: replace that run")
    p.add_argument(
        "--port",
        type=a_whole_number,
        metavar="N",
        help="TCP port of the run's router (default: a free one, or a socket)",
    )
    p.add_argument("--live", action="store_true", help="let a Rerun viewer watch while the run goes on")
    p.add_argument("--in-process", action="store_true", help="the same run in this one process, without a bus")
    p.add_argument("--no-recording", action="store_true", help="leave no recording.rrd")
    p.add_argument("--plain-scheduling", action="store_true", help="leave it to the kernel where processes run")
    p.add_argument(
        "--owner", type=a_whole_number, metavar="PID", help=argparse.SUPPRESS
    )  # end as soon as that process is gone
    p.add_argument("-q", "--quiet", action="store_true", help="show nothing but what failed")
    return p


def main(arguments: list[str] | None = None) -> int:
    """Check everything, then run; returns the exit status."""
    options = parser().parse_args(arguments)
    from deploy.command import INTERRUPTED, refuse, require
    from deploy.machine.interrupts import Interrupts, end_with

    interrupts = Interrupts()
    if options.owner is not None:
        try:
            end_with(options.owner)
        except ValueError as error:
            return refuse("run", f"--owner {options.owner}: {error}")
    require("run")
    with contextlib.ExitStack() as held:
        try:
            _refuse_in_process(options)
            if options.live and options.no_recording:
                raise BadInputError("--live watches the station record: not with --no-recording")
            scenario = _scenario(options)
            if options.in_process and scenario.not_in_process:
                raise BadInputError(scenario.not_in_process)
            baseline = _baseline(options.compare, scenario)
            endpoint = None if options.port is None else _endpoint(options.port)
            if not options.in_process:
                _allow_files(scenario.robots)
            if interrupts.count:
                return INTERRUPTED
            folder = held.enter_context(_folder(options, scenario, baseline))
            scratch = None if options.in_process else held.enter_context(_scratch(folder, scenario))
        except BadInputError as error:
            return refuse("run", error)
        return _run(options, scenario, endpoint, folder, scratch, interrupts)


def _refuse_in_process(options: argparse.Namespace) -> None:
    if not options.in_process:
        return
    of_processes = {
        "--hold": options.hold,
        "--speed": options.speed not in (None, "max"),
        "--port": options.port is not None,
        "--live": options.live,
        "--plain-scheduling": options.plain_scheduling,
    }
    for name, given in of_processes.items():
        if given:
            raise BadInputError(
                f"{name} is for real processes: not with --in-process, a run as fast as the machine can"
            )


def _scenario(options: argparse.Namespace) -> Scenario:
    from deploy.run_folder.baseline import faults_of
    from deploy.scenario import load
    from deploy.scenario_options import overrides_of

    replay: Path | None = options.replay_faults
    own = {"speed": _speed(options.speed), "external": options.external or None}
    try:
        overrides = overrides_of(options) | {key: value for key, value in own.items() if value is not None}
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
    from bus.excerpt import shown
    from bus.numerals import decimal

    try:
        return text if text is None or text == "max" else decimal(text)
    except ValueError:
        raise BadInputError(f"--speed {shown(text)}: expected max or a number") from None


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


def _allow_files(robots: int) -> None:
    from deploy.machine.limits import LimitError, allow_files

    try:
        allow_files(robots)
    except LimitError as error:
        raise BadInputError(str(error)) from error


def _folder(options: argparse.Namespace, scenario: Scenario, baseline: Baseline | None) -> RunFolder:
    """Claim the run folder."""
    from deploy.run_folder.claim import ClaimError, new_folder
    from deploy.run_folder.writer import RunFolder

    read = (options.scenario, scenario.tables.floor_plan.map, options.replay_faults, options.compare)
    try:
        out = options.out or new_folder(Path("runs"), f"{scenario.name}-{time.strftime('%Y%m%d-%H%M%S')}")
        return RunFolder(
            out, scenario, baseline, overwrite=options.overwrite, reads=[Path(path) for path in read if path]
        )
    except ClaimError as error:
        raise BadInputError(f"--out {error}") from error


def _scratch(folder: RunFolder, scenario: Scenario) -> Scratch:
    """What must not outlive the run, passwords of its operator and of external robots included."""
    from deploy.machine.scratch import Scratch, ScratchError
    from deploy.processes.operator_file import OPERATOR, credentials_name

    path = folder.path.resolve()
    try:
        names = [OPERATOR, *map(credentials_name, scenario.external)]
        return Scratch([path / name for file in names for name in (file, f"{file}.part")])
    except ScratchError as error:
        folder.discard()
        raise BadInputError(str(error)) from error


def _run(
    options: argparse.Namespace,
    scenario: Scenario,
    endpoint: str | None,
    folder: RunFolder,
    scratch: Scratch | None,
    interrupts: Interrupts,
) -> int:
    from rich.console import Console

    from deploy.command import name_of

    out = folder.path
    console = Console(stderr=False, quiet=options.quiet)
    view = _view(options, console, scenario.cell_names)
    pids = "" if options.in_process else f", process ids in {out / 'pids.json'}"
    view.line(f"run folder {out}{pids}")
    if scenario.remark:
        view.line(scenario.remark)
    if scratch is None:
        if scenario.speed:
            view.line(
                f"the scenario's speed = {scenario.speed:g} is for real processes: this run is as fast as it can be"
            )
        from deploy.in_process import run_in_process

        summary, failures = run_in_process(
            scenario, folder, view, record=not options.no_recording, interrupts=interrupts
        )
    else:
        summary, failures = _run_processes(options, scenario, endpoint, folder, scratch, view, interrupts)
    _report(console, out, summary)
    for failure in failures:
        print(f"{name_of('run')}: failed: {failure}", file=sys.stderr)
    return 1 if failures else 0


def _view(options: argparse.Namespace, console: Console, cells: tuple[str, ...]) -> View:
    from deploy.screen.live_table import LiveTable
    from deploy.screen.plain_lines import PlainLines
    from deploy.screen.view import NoView

    if options.quiet:
        return NoView()
    return LiveTable(console, cells) if console.is_terminal else PlainLines(console)


def _run_processes(
    options: argparse.Namespace,
    scenario: Scenario,
    endpoint: str | None,
    folder: RunFolder,
    scratch: Scratch,
    view: View,
    interrupts: Interrupts,
) -> tuple[dict[str, Any], tuple[str, ...]]:
    from bus.session import free_endpoint, local_endpoint, port_of
    from deploy.machine.scratch import home_of_tempfile
    from deploy.processes.fleet import Fleet
    from deploy.processes.launcher import Launcher
    from deploy.screen.live_viewer import LiveViewer, has_display

    live_port = port_of(free_endpoint()) if options.live else None
    with contextlib.ExitStack() as beside:
        beside.enter_context(home_of_tempfile(scratch.path))
        fleet = Fleet(
            scenario, folder.path, endpoint or local_endpoint(scratch.path, scenario.robots),
            record=not options.no_recording, live_port=live_port, held=options.hold,
            plain_scheduling=options.plain_scheduling,
        )  # fmt: skip
        launcher = Launcher(fleet, folder, view)
        interrupts.pass_to(launcher.interrupt)
        if live_port is not None:
            web_port = None if has_display(os.environ) else port_of(free_endpoint())
            beside.enter_context(LiveViewer(live_port, web_port, folder.path / "logs" / "viewer.log", view.line))
        outcome = launcher.run()
    return outcome.summary, outcome.failures


def _report(console: Console, out: Path, summary: dict[str, Any]) -> None:
    from deploy.command import call_of
    from deploy.run_folder.summary import remainder

    def show(words: str) -> None:
        console.print(words, markup=False, highlight=False, soft_wrap=True)

    rates = ", ".join(f"{name} {rate:.0%}" for name, rate in (summary["search_rate"] or {}).items())
    show(f"{summary['status']} after {summary['simulated_s']:.1f} s simulated in {summary['wall_s']:.1f} s "
         f"(real-time factor {summary['real_time_factor']}); searched: {rates}")  # fmt: skip
    if words := remainder(summary):
        show(f"left: {words}")
    show(f"summary: {out / 'summary.json'} (as a page: {call_of('report')} {out})")
    if parts := sorted(out.glob("recording*.rrd")):
        show(f"recording: {_view_of(parts[0] if len(parts) == 1 else out / 'recording*.rrd')}")


def _view_of(recording: Path) -> str:
    """The command that shows it, as the user can type it here."""
    from deploy.command import call_of, name_of

    if name_of("run") == call_of("run"):
        return f"{call_of('open')} {recording.parent}"
    viewer, near = Path(sys.executable).with_name("rerun"), Path(".venv/bin/rerun")
    return f"{near if near.exists() and near.samefile(viewer) else viewer} {recording}"


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    from deploy.command import entry

    entry(main)
