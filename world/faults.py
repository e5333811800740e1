"""Faults: their written forms, their checks, and the node that a role stands for at a given moment."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any, Final, get_args

import numpy as np

from bus.codec import MOST_METRES
from bus.excerpt import shown
from bus.nodes import node_name
from bus.numerals import decimal
from world.config import Fault, Verb
from world.feed import Snapshot
from world.messages import Jam
from world.routes import chain_to_station, farthest_search_robots
from world.terms import STATION, TICK_S, tick_of

__all__ = ["NOT_OURS", "check_fault", "describe", "fault_form", "jam_of", "parse_fault", "resolve"]

VERBS: Final = get_args(Verb)

ROLES: Final = "a robot id, station, relay:mid, relay:first, nms-of:ID, sr:far or random"
FORM: Final = "VERB:TARGET@T or VERB:TARGET@T+D, such as kill:relay:mid@90 or pause:4@60+5"

NOT_OURS: Final = "it is external, so that is up to whoever runs its process"
"""Why nothing is done to a process."""

_NUMBER: Final = r"[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?"
_TIMES: Final = re.compile(rf"({_NUMBER})(?:\+({_NUMBER}))?")
_NODE: Final = re.compile("[0-9]{1,5}")
_LONGEST_S: Final = 1e8
"""The longest duration of a run."""


def parse_fault(text: str) -> Fault:
    """Read the command line's form of a fault.

    Raises:
        ValueError: one line that says what is wrong.
    """
    verb, colon, rest = text.partition(":")
    target, at, times = rest.rpartition("@")
    if not colon or not at:
        raise ValueError(f"fault '{shown(text)}': expected {FORM}")
    found = _TIMES.fullmatch(times)
    if found is None:
        raise ValueError(f"fault '{shown(text)}': '{shown(times)}' is not a time in seconds such as 60 or 60+5")
    at_s, for_s = float(found[1]), None if found[2] is None else float(found[2])
    probability = 0.0
    if verb == "loss":
        try:
            probability, target = decimal(target), ""
        except ValueError:
            what = f"'{shown(target)}' is not a probability, as in loss:0.3@50+10"
            raise ValueError(f"fault '{shown(text)}': {what}") from None
    fault = Fault(verb, at_s, target, for_s, probability)  # type: ignore[arg-type]
    try:
        check_fault(fault)
    except ValueError as error:
        raise ValueError(f"fault '{shown(text)}': {error}") from None
    return fault


def check_fault(
    fault: Fault, robots: int | None = None, duration_s: float | None = None, external: Collection[int] = ()
) -> None:
    """Check a fault by itself, and against a run where one is given, with its external robots.

    Raises:
        ValueError: one line that says what is wrong.
    """
    if fault.verb not in VERBS:
        raise ValueError(f"unknown verb '{shown(fault.verb)}', expected one of {', '.join(VERBS)}")
    if not 0 <= fault.at_s <= _LONGEST_S:
        raise ValueError(f"at_s = {fault.at_s:g} is not a time of 0 to {_LONGEST_S:g} s")
    if duration_s is not None and fault.at_s >= duration_s:
        raise ValueError(f"at_s = {fault.at_s:g} is not within the run's duration_s = {duration_s:g}")
    _check_duration(fault)
    if fault.verb == "loss":
        if not 0 < fault.probability <= 1:
            raise ValueError(f"loss needs a probability above 0 and at most 1, not {fault.probability:g}")
    elif fault.probability:
        raise ValueError(f"probability belongs to loss, not to {fault.verb}")
    if fault.verb == "loss":
        if fault.target:
            raise ValueError(f"loss has no target, but a probability: '{shown(fault.target)}'")
    elif fault.verb == "jam":
        _check_jam(fault.target, robots)
    else:
        _check_target(fault.target, robots)
        if fault.target.isdecimal() and int(fault.target) in external:
            raise ValueError(f"{fault.verb} of {node_name(int(fault.target))}: {NOT_OURS}")


def _check_duration(fault: Fault) -> None:
    if fault.verb == "kill":
        if fault.for_s is not None:
            raise ValueError("kill is for good and takes no duration; use restart or pause")
    elif fault.for_s is None:
        raise ValueError(f"{fault.verb} needs a duration (for_s, or +D)")
    elif not fault.for_s <= _LONGEST_S:
        raise ValueError(f"for_s = {fault.for_s:g} is not a duration of up to {_LONGEST_S:g} s")
    elif tick_of(fault.for_s) < 1:
        raise ValueError(f"for_s = {fault.for_s:g} is shorter than a tick of {TICK_S} s")


def _check_target(target: str, robots: int | None) -> None:
    if target in ("station", "relay:mid", "relay:first", "sr:far", "random"):
        return
    number = target.removeprefix("nms-of:")
    if not _NODE.fullmatch(number) or int(number) < 1:
        raise ValueError(f"unknown target '{shown(target)}', expected {ROLES}")
    if robots is not None and int(number) > robots:
        raise ValueError(f"target '{shown(target)}': there are only robots 1 to {robots}")


def _check_jam(target: str, robots: int | None) -> None:
    jam = jam_of(target)
    if jam.pair is not None and robots is not None and max(jam.pair) > robots:
        raise ValueError(f"target '{shown(target)}': there are only nodes 0 (the station) to {robots}")


def jam_of(target: str) -> Jam:
    """The jam that "a,b" (a pair of nodes) or "x0,y0,x1,y1" (a region in metres) stands for.

    Raises:
        ValueError: it is neither.
    """
    wrong = f"jam target '{shown(target)}' is neither a pair such as 3,4 nor a region x0,y0,x1,y1"
    parts = [part.strip() for part in target.split(",")]
    if len(parts) == 2 and all(map(_NODE.fullmatch, parts)):
        a, b = int(parts[0]), int(parts[1])
        if a == b:
            raise ValueError(f"jam target '{shown(target)}' names one node twice")
        return Jam(pair=(a, b))
    try:
        values = [decimal(part) for part in parts]
    except ValueError:
        raise ValueError(wrong) from None
    if len(values) != 4 or not all(abs(value) <= MOST_METRES for value in values):
        raise ValueError(wrong)
    x0, y0, x1, y1 = values
    if x0 >= x1 or y0 >= y1:
        raise ValueError(f"jam target '{shown(target)}': a region needs x0 < x1 and y0 < y1")
    return Jam(region_m=(x0, y0, x1, y1))


def fault_form(fault: Fault) -> dict[str, Any]:
    """The fault as a scenario's [[fault]] has it: only what is set, JSON and TOML types."""
    kept: dict[str, Any] = {"verb": fault.verb, "at_s": fault.at_s}
    if fault.target:
        kept["target"] = fault.target
    if fault.for_s is not None:
        kept["for_s"] = fault.for_s
    if fault.probability:
        kept["probability"] = fault.probability
    return kept


def describe(fault: Fault) -> str:
    """The fault as the command line has it, to twelve digits."""
    what = f"{fault.probability:.12g}" if fault.verb == "loss" else fault.target
    lasting = "" if fault.for_s is None else f"+{fault.for_s:.12g}"
    return f"{fault.verb}:{what}@{fault.at_s:.12g}{lasting}"


def resolve(
    target: str, snapshot: Snapshot, station_m: tuple[float, float], generator: np.random.Generator
) -> int | None:
    """The node that a target stands for at this moment, or None if no node has that role.

    `relay:mid` and `relay:first` follow the NMS pointers from the farthest search robot whose pointers reach the MS
    over a relay; the first relay is the one next to the MS. `nms-of:7` is always a robot: None while the MS is the NMS
    of 7.
    """
    present = snapshot.nodes[snapshot.present.astype(bool)]
    if target == "station":
        return STATION
    if target == "random":
        return int(generator.choice(present)) if len(present) else None
    if target == "sr:far":
        ranked = farthest_search_robots(snapshot, station_m)
        return ranked[0] if ranked else None
    if target.startswith("relay:"):
        for robot in farthest_search_robots(snapshot, station_m):
            relays = chain_to_station(robot, snapshot)[1:-1]
            if relays:
                return relays[-1] if target == "relay:first" else relays[len(relays) // 2]
        return None
    if target.startswith("nms-of:"):
        robot = int(target.removeprefix("nms-of:"))
        if robot not in present:
            return None
        nms = int(snapshot.nms[robot - 1])
        return nms if nms in present else None
    return int(target)
