"""Run folders for tests of reports: short real runs, and one in which every text tries to escape into the HTML."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from deploy.in_process import run_in_process
from deploy.run_folder.writer import RunFolder
from deploy.scenario import load
from deploy.screen.view import NoView

EVIL = "</script><script>alert(1)</script>\"'<img src=http://192.0.2.1/x onerror=alert(1)>"


def short_run(path: Path, *faults: str) -> Path:
    """Fifteen simulated seconds of four robots."""
    asked = {"robots": 4, "duration_s": 15.0, "fault": list(faults)} if faults else {"robots": 4, "duration_s": 15.0}
    scenario = load("three_cells", asked)
    with RunFolder(path, scenario) as folder:
        run_in_process(scenario, folder, NoView(), record=False)
    return path


def evil_run(good: Path, path: Path) -> Path:
    """A copy of a run with hostile text in all texts of its files."""
    shutil.copytree(good, path)
    summary = json.loads((path / "summary.json").read_text())
    summary |= {"status": EVIL, "scenario": EVIL, "why": EVIL, "failures": [EVIL], "trace_sha256": EVIL}
    summary["search_rate"][EVIL] = 0.5
    summary["frames"][EVIL] = EVIL
    summary["tick_ms"], summary["tick_blame"] = {EVIL: EVIL}, {EVIL: 0.4}
    summary["faults"] = [{"verb": EVIL, "target": EVIL, "at_s": 3.0, "for_s": EVIL}]
    summary["recoveries"] = [{"kind": EVIL, "target": EVIL, "orphaned": [EVIL], "recovered": EVIL, "at_s": EVIL}]
    summary["robots_at_end"] = [{"robot": EVIL, "x_m": 20.0, "y_m": 30.0, "class": EVIL, "present": EVIL}]
    (path / "summary.json").write_text(json.dumps(summary))
    metrics = (
        (path / "metrics.csv").read_text().replace("search_rate_1", '"search_rate_' + EVIL.replace('"', '""') + '"')
    )
    (path / "metrics.csv").write_text(metrics)
    with (path / "events.jsonl").open("a") as events:
        events.write(json.dumps({"at_s": 3.0, "kind": "fault", "text": EVIL, "data": EVIL}) + "\n")
        events.write('{"at_s": 4.0, "kind": "fau')
    (path / "scenario.toml").write_text(f"# {EVIL}\n")
    return path
