"""Every way in for bytes and texts of others: what reads them, valid ones to begin with, and how it may refuse."""

from __future__ import annotations

import ast
import contextlib
import functools
import io
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np

from agents.config import RobotConfig
from agents.dsdv import Router
from agents.forwarding_table import ForwardingTable
from agents.messages import (
    ACK,
    MAP_CHUNK,
    SCAN_REPORT,
    UPDATE,
    MapChunk,
    ScanReport,
    Table,
    Update,
    kind_of,
    one_hop_on,
)  # fmt: skip
from agents.room import Room
from agents.scan_uplink import ScanUplink
from bus.codec import WireError, unpack_map
from bus.command_line import parse, parser
from bus.envelopes import Answer, Flood, Moves, Opening, Refused, Turn
from bus.handover import write as write_handover
from bus.heartbeat import Beat
from bus.keys import Keys
from bus.lockstep import unbatch, unseal
from bus.mailbox import Mailbox
from bus.phases import decode_phases
from bus.session import BusError, Login, port_of
from deploy.buildings.table import COLUMNS, read_table
from deploy.criticality.results import Results as Criticality
from deploy.ctl import show
from deploy.processes.operator_file import living_launcher, read_operator, write_operator
from deploy.run_folder.baseline import Baseline, faults_of
from deploy.run_folder.reader import RunFilesError, read_run
from deploy.scenario import ScenarioError, load, parse_set
from deploy.scenario.files import read_toml
from deploy.scenario.tables import validate
from deploy.sweep.plan import load_study
from deploy.sweep.results import Results, ResultsError
from medium.config import MediumConfig
from medium.messages import Inbox, Transmission
from monitor_station.core import Station
from tests import ROOT
from tests.fuzzing.samples import recorded, scenario
from tests.helpers.report_runs import short_run
from tests.oracles.forwarding_table import check_invariants
from world.config import WorldConfig
from world.control import Control
from world.faults import jam_of, parse_fault
from world.feed import Absence, Event, Signal, Snapshot, unpack_feed
from world.limits import decode_word
from world.messages import Departed, Motion, Positions, Report, Sense, Stop
from world.pace import Pace
from world.seeds import node_stream
from world.terms import STATION

PACKAGES: Final = ("bus", "world", "medium", "agents", "monitor_station", "deploy")
PARSERS: Final = frozenset({
    "unpackb", "loads", "safe_load", "compose_all", "unpack_from", "iter_unpack", "frombuffer", "unpack_receptions",
    "unpacked", "unpack", "head", "column",
})  # fmt: skip
"""Functions that make values of bytes or text: of Python, of libraries, and of `bus.codec`."""
OWN: Final = {
    "world/account.py:Account._photograph": "columns that it has just made",
    "world/account.py:_bytes": "columns that it has just made",
    "world/stopwatch.py:Stopwatch.final": "columns that it has just made",
    "monitor_station/recording/known.py:Known._take_tiles": "its own tiles",
    "deploy/branching/branches.py:_next": "what its own child tells it over a pipe",
    "deploy/branching/trunk.py:main": "what its own parent tells it over a pipe",
    "deploy/emulation.py:Emulation.command": "what the run of a test answers to it",
    "deploy/run_folder/baseline.py:Baseline.of": "the scenario of this very run, as TOML",
    "deploy/sweep/campaign.py:_parameters": "the scenario of this very run, as TOML",
    "deploy/sweep/row.py:_head": "the scenario of this very run, as TOML",
}
"""Functions that parse what nobody else made."""


TABLE: Final = f"{','.join(COLUMNS)}\n{','.join(str(n) for n in range(len(COLUMNS)))}\n".encode()
MOST_WORDS: Final = 400
"""Characters of a refusal."""
MOST_S: Final = 1.0
MOST_FILE_S: Final = 20.0
"""Processor time."""


@dataclass(frozen=True)
class WayIn:
    """One decoder."""

    name: str
    read: Callable[[bytes], object]
    samples: tuple[bytes, ...]
    """Valid input."""
    refuses: tuple[type[Exception], ...] = (WireError,)
    """How it may say no."""
    slow: bool = False
    """It takes files, so it gets fewer inputs."""

    def try_on(self, data: bytes) -> bool:
        """Let it read something; False if it refuses.

        Raises:
            AssertionError: it takes too long, or repeats at length what it was given.
            Exception: whatever is no refusal of its kind.
        """
        since_s = time.process_time()
        try:
            self.read(data)
            taken, words = True, 0
        except self.refuses as refusal:
            taken, words = False, len(str(refusal))
        assert words <= MOST_WORDS, f"{words} characters of refusal"
        took_s = time.process_time() - since_s
        assert took_s < (MOST_FILE_S if self.slow else MOST_S), f"{took_s:.1f} s for {len(data)} bytes"
        return taken


@functools.cache
def ways_in() -> tuple[WayIn, ...]:
    """All of them."""
    return (*_messages(), *_texts(), *_files(Path(tempfile.mkdtemp(prefix="vds-fuzz-"))))


def _messages() -> Iterator[WayIn]:
    packed = recorded().packed
    robot = scenario().robot_config(1)
    by_kind: dict[str, Callable[[bytes], object]] = {
        "sense": lambda data: Sense.decode(data, robot.lidar_beams),
        "inbox": lambda data: Inbox.decode(data, robot.robots),
        "positions": Positions.decode, "opening": Opening.decode, "turn": Turn.decode, "answer": Answer.decode,
        "moves": Moves.decode, "flood": Flood.decode, "beat": Beat.decode, "absence": Absence.decode,
        "refused": Refused.decode,
        "transmission": Transmission.decode, "departed": Departed.decode, "stop": Stop.decode,
        "signal": Signal.decode, "event": Event.decode, "snapshot": Snapshot.decode, "feed": unpack_feed,
        "batch": unbatch, "table": Table.decode, "phases": decode_phases, "final": unpack_map, "sealed": unseal,
        "motion": lambda data: _word(1, Motion, data), "report": lambda data: _word(STATION, Report, data),
        f"payload {UPDATE}": Update.decode, f"payload {MAP_CHUNK}": MapChunk.decode,
        f"payload {SCAN_REPORT}": ScanReport.decode, "rows": _merge, "acks": _acknowledge,
        "ahead": lambda ahead: _acknowledge(ACK.pack(1, 0, 1), ahead),
    }  # fmt: skip
    for kind, read in by_kind.items():
        yield WayIn(kind, read, tuple(packed[kind]))
    payloads = tuple(payload for kind in (UPDATE, SCAN_REPORT, MAP_CHUNK) for payload in packed[f"payload {kind}"][:40])
    yield WayIn("kind of payload", kind_of, payloads)
    yield WayIn("carried report", one_hop_on, tuple(packed[f"payload {SCAN_REPORT}"]))
    yield WayIn("journal", _restore, tuple(packed["journal"]), (), slow=True)
    yield WayIn("parts of a message", _join, tuple(packed["answer"]), ())


def _word(node: int, kind: type[Motion | Report], data: bytes) -> object:
    config = scenario().medium_config()
    return decode_word(node, kind.decode(data).tick, data, robots=config.robots, cells=config.cells)


def _merge(rows: bytes) -> object:
    table = ForwardingTable(1, 4)
    try:
        return table.merge(2, rows, table.next_hops(), STATION, 100)
    finally:
        check_invariants(table)
        for dst in table.known:
            assert 0 <= dst <= 4
            table.location_m(dst), table.target_m(dst), table.cls(dst)


def _acknowledge(acks: bytes, ahead: bytes = b"") -> object:
    config = scenario().robot_config(1)
    payload = Update(-1, -1, 0, b"", acks, 0, ahead).encode()
    Router(config, node_stream(1, 1, 0), 0).limits.decode_update(payload, 100)
    uplink = ScanUplink(1, 0, config.rules.reporting)
    for _ in range(20):
        uplink.make(0, np.zeros(0, np.uint32), np.zeros(0, np.int8), ())
    uplink.due(100, 1, Room(None, limited=False))
    return uplink.acknowledge(100, acks, ahead)


def _restore(journal: bytes) -> object:
    station = Station(scenario().station_config(), node_stream(1, STATION, 1), 1, 100)
    assert 0 <= station.restore(journal) <= len(journal)
    return station.final()


def _join(data: bytes) -> object:
    """Parts with marks that are as wrong as the data."""
    mailbox = Mailbox()
    for start in range(0, len(data), 60):
        mailbox._joined("key", data[start : start + 12], data[start + 12 : start + 60])
    return mailbox


def _text(read: Callable[[str], object]) -> Callable[[bytes], object]:
    return lambda data: read(data.decode(errors="replace"))


def _texts() -> Iterator[WayIn]:
    faults = ["kill:relay:mid@90", "pause:4@60+5", "jam:3,4@1+2", "jam:0,0,20,10@60+5.5", "loss:0.3@5e1+10"]
    commands = ["status", "hold", "step", "step 12", "go", "speed 2.5", "speed max", *(f"fault {f}" for f in faults)]
    control = Control(Pace(0.0, lambda: 0.0), 4, dict)
    answers = [json.dumps({"tick": 3, "robots": [1, 2], "held": False}), json.dumps({"error": "no"})]
    acted = {"at_s": 0.3, "node": 4, "text": "kill:4@0.3", "done": True}
    answers += [
        json.dumps({"tick": 3, "robots": [1], "speed": 2.5, "search_rate": [0.5], "waiting_for": ["robot 1"]}),
        json.dumps({"tick": 3, "fault": "kill:4@0", "acted": acted}),
    ]
    keys = Keys("run")
    told: tuple[tuple[str, Callable[[str], object], list[str], tuple[type[Exception], ...]], ...] = (
        ("fault", parse_fault, faults, (ValueError,)),
        ("jam", jam_of, ["3,4", "0,0,20,10", "-1.5,2e1,3,1e3"], (ValueError,)),
        ("command", lambda line: json.loads(control.answer(line)), commands, ()),
        ("answer to a command", lambda answer: _silently(_shown_by_ctl, answer), answers, ()),
        ("setting", parse_set, ["radio.loss=0.1", "robots = 9", "policy=scout", "cell=[{name='a'}]"], (ScenarioError,)),
        ("endpoint", port_of, ["tcp/127.0.0.1:7447", "tcp/[::1]:1"], (BusError,)),
        ("run", Keys, ["three_cells-1", "a.b"], (ValueError,)),
        ("key of a node", keys.node_of, [keys.tx(4), keys.table(12)], (WireError,)),
        (
            "token",
            keys.token_of,
            [keys.alive("robot", 4, "0123abcd", 1), keys.alive("world", 0, "ffffffff", 65_535)],
            (WireError,),
        ),
    )
    for name, read, samples, refuses in told:
        yield WayIn(name, _text(read), tuple(sample.encode() for sample in samples), refuses)


def _shown_by_ctl(answer: str) -> None:
    for words in (["status"], ["kill", "relay:mid"], ["pause", "4", "5"], ["step", "3"], ["speed", "2"]):
        for whole in (False, True):
            show(answer, words, "run", whole=whole)


def _silently(act: Callable[[str], object], text: str) -> object:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return act(text)


def _files(folder: Path) -> Iterator[WayIn]:
    login = Login("run", "tcp/127.0.0.1:7447", "robot-1", "secret")
    handover, operator = folder / "handover.json", folder / "operator"
    write_handover(
        handover, login, config=scenario().robot_config(1), world=scenario().world_config(),
        medium=scenario().medium_config(), users={"robot-1": "secret"},
    )  # fmt: skip
    operator.mkdir()
    write_operator(operator, login)
    study = (ROOT / "deploy" / "studies" / "policies_limits.toml").read_bytes()
    results = Results(folder / "results")
    results.claim()
    results.note({"command": "study"})
    row = {"key": "a", "variant": "base", "status": "searched", "seed": 1, "robots": 2, "radius_m": 20.0}
    part = json.dumps({"row": row, "series": {"time_s": [0.0], "1": [0.5]}}).encode()

    def through(path: Path, read: Callable[[], object], *samples: bytes) -> tuple[Callable[[bytes], object], Any]:
        def write_and_read(data: bytes) -> object:
            path.write_bytes(data)
            return read()

        return write_and_read, samples or (path.read_bytes(),)

    yield WayIn("handover", *through(handover, lambda: _configurations(handover)), (ValueError,), slow=True)
    yield WayIn("operator", *through(operator / "operator.json", lambda: read_operator(operator)), (ValueError,))
    yield WayIn("launcher", *through(operator / "operator.json", lambda: living_launcher(operator)), ())
    toml = folder / "scenario.toml"
    tables = scenario().to_toml().encode()
    yield WayIn("scenario", *through(toml, lambda: validate(read_toml(toml)), tables), (ScenarioError,), slow=True)
    plan = folder / "study.toml"
    yield WayIn("study", *through(plan, lambda: load_study(str(plan)), study), (ScenarioError,), slow=True)
    yield WayIn("finished run", *through(folder / "results" / "parts" / "a.json", results.rows, part), (), slow=True)
    yield WayIn("facts of a study", *through(folder / "results" / "study.json", results.noted), (), slow=True)
    failures = Criticality(folder / "whatif", {}, "")
    failure = json.dumps({"robot": 1, "at_s": 10.0, "orphans": 0, "recovered": True, "cost_robot_s": 0.5}).encode()
    yield WayIn("tried failures", *through(folder / "whatif" / "rows.jsonl", failures.rows, failure), ())
    table = folder / "buildings.csv"
    yield WayIn("table of buildings", *through(table, lambda: read_table(table), TABLE), (ResultsError,))
    run = short_run(folder / "run")
    known = load(run / "scenario.toml")
    for name in ("summary.json", "metrics.csv", "events.jsonl", "map.yaml", "map.pgm", "scenario.toml"):
        path, whole = run / name, (run / name).read_bytes()
        yield WayIn(f"run {name}", _mended(path, whole, lambda: read_run(run)), (whole,), (RunFilesError,), slow=True)
    summary = run / "summary.json"
    whole = summary.read_bytes()
    yield WayIn(
        "faults of a run", _mended(summary, whole, lambda: faults_of(run)), (whole,), (ScenarioError,), slow=True
    )
    compare = _mended(summary, whole, lambda: Baseline.of(run, known).lost_s({"1": 3.0, "all": None}))
    yield WayIn("baseline", compare, (whole,), (ScenarioError,), slow=True)


def _mended(path: Path, whole: bytes, read: Callable[[], object]) -> Callable[[bytes], object]:
    """Reads with another content of a file, which gets its own back."""

    def write_and_read(data: bytes) -> object:
        path.write_bytes(data)
        try:
            return read()
        finally:
            path.write_bytes(whole)

    return write_and_read


def _configurations(path: Path) -> object:
    """As a process by hand reads it, which ends with one line if it can't."""
    words = io.StringIO()
    try:
        with contextlib.redirect_stderr(words):
            hints = {
                "config": RobotConfig,
                "world": WorldConfig,
                "medium": MediumConfig,
                "users": dict[str, str] | None,
            }
            return parse(parser("fuzz", ""), ["--credentials", str(path)], **hints)
    except SystemExit:
        raise ValueError(words.getvalue()) from None


def parsers() -> set[str]:
    """Every function of the sources that parses, as `path:qualified name`."""
    found = set()
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for name, function in _functions(ast.parse(path.read_text(encoding="utf-8")), ""):
            calls = (node.func for node in ast.walk(function) if isinstance(node, ast.Call))
            if any((getattr(call, "attr", None) or getattr(call, "id", "")) in PARSERS for call in calls):
                found.add(f"{path.relative_to(ROOT)}:{name}")
    return found


def _functions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, ast.AST]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def reached(act: Callable[[], object]) -> set[str]:
    """Functions of the sources that are entered meanwhile, as `parsers` names them."""
    entered = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(str(ROOT)):
            path = Path(frame.f_code.co_filename).relative_to(ROOT)
            entered.add(f"{path}:{frame.f_code.co_qualname.replace('<locals>.', '')}")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(before)
    return entered
