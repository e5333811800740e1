"""Credentials files of processes that are started by hand: strict types, and few words on what is wrong."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from agents.config import RobotConfig
from bus.access import Login
from bus.handover import build, plain
from bus.session import BusError, Session
from deploy.scenario import load
from medium.config import MediumConfig
from monitor_station.config import RecorderConfig, StationConfig
from world.config import WorldConfig


def _scalars(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of all scalars in a configuration's JSON, but for those of its arrays."""
    if isinstance(value, dict) and value.keys() != {"shape", "values"}:
        for name, item in value.items():
            yield from _scalars(item, (*path, name))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _scalars(item, (*path, index))
    elif value is not None and not isinstance(value, dict):
        yield path


def _with(whole: Any, path: tuple[str | int, ...], value: object) -> Any:
    changed = json.loads(json.dumps(whole))
    inner = changed
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    return changed


@pytest.mark.parametrize("kind", [RobotConfig, WorldConfig, MediumConfig, StationConfig, RecorderConfig, Login])
def test_every_scalar_of_a_credentials_file_has_its_type(kind: type) -> None:
    scenario = load("three_cells", {"robots": 2, "fault": ["kill:1@5", "pause:2@5+1"]})
    good = {
        RobotConfig: scenario.robot_config(1), WorldConfig: scenario.world_config(),
        MediumConfig: scenario.medium_config(), StationConfig: scenario.station_config(),
        RecorderConfig: scenario.recorder_config("run"), Login: Login("run", "tcp/127.0.0.1:7447", "world", "x"),
    }[kind]  # fmt: skip
    whole = json.loads(json.dumps(plain(good)))
    assert plain(build(kind, whole)) == plain(good)
    paths = list(_scalars(whole))
    assert len(paths) >= 4
    for path in paths:
        was: Any = whole
        for step in path:
            was = was[step]
        wrong: tuple[object, ...] = ([], {}, "\ud800", 7 if isinstance(was, str) else "x" * 20_000)
        for value in (*wrong, True) if not isinstance(was, bool) else wrong:
            with pytest.raises(ValueError, match=r"no |none of") as caught:
                build(kind, _with(whole, path, value))
            assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "endpoint", ["e" * 20_000, "tcp/" + "e" * 20_000 + ":7447", "tcp/127.0.0.1:\u0661", "tcp/\x1b[2J:7447"]
)
def test_an_endpoint_of_any_length_is_repeated_in_part(endpoint: str) -> None:
    login = Login("run", endpoint, "u" * 20_000, "secret")
    for attempt in (lambda: Session.connect(login, timeout_s=0.1), lambda: Session.host(login, {"world": "secret"})):
        with pytest.raises(BusError) as caught:
            attempt()
        assert len(str(caught.value)) < 600
        assert str(caught.value).isprintable()
