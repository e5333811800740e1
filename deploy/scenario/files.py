"""Where scenarios come from: those of the emulator, files of the user, and `KEY=VALUE` of a command line."""

from __future__ import annotations

import copy
import functools
import re
import tomllib
from pathlib import Path
from typing import Any, Final

from deploy.scenario.tables import ScenarioError, nearest

__all__ = ["names", "parse_set", "read_source"]

FOLDER: Final = Path(__file__).resolve().parent.parent / "scenarios"
_BARE: Final = re.compile(r"[A-Za-z_][\w:.-]*")


def names() -> list[str]:
    """The scenarios that come with the emulator."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def parse_set(text: str) -> tuple[str, Any]:
    """Read KEY=VALUE, such as radio.loss=0.1; VALUE as in TOML, or a bare word as text.

    Raises:
        ScenarioError: it is not of that form.
    """
    key, equals, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not equals or not key or not value:
        raise ScenarioError(f"'{text}': expected KEY=VALUE, such as radio.loss=0.1")
    try:
        parsed = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        if not _BARE.fullmatch(value):
            raise ScenarioError(
                f"'{text}': '{value}' is not a TOML value, such as 0.1, true, \"text\" or [1, 2]"
            ) from None
        return key, value
    if list(parsed) != ["value"]:
        raise ScenarioError(f"'{text}': more than one value")
    return key, parsed["value"]


def read_source(source: str) -> tuple[dict[str, Any], Path]:
    """The raw tables of a scenario, and the file whose folder its relative paths start from.

    Args:
        source: name of a scenario that comes with the emulator, path of a .toml file, or path of a ROS map's .yaml.

    Raises:
        ScenarioError: there is no such scenario or file, or it is not TOML.
    """
    path = Path(source)
    if path.suffix in (".yaml", ".yml"):
        return {"name": path.stem, "floor_plan": {"map": path.name}}, path
    if path.suffix != ".toml":
        if source not in names():
            hint = nearest(source, names())
            raise ScenarioError(f"unknown scenario '{source}', {hint} (or give the path of a .toml or a map's .yaml)")
        path = FOLDER / f"{source}.toml"
    try:
        return copy.deepcopy(_parsed(path.read_text("utf-8"))), path
    except OSError as error:
        raise ScenarioError(f"{source}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{source}: not TOML: {error}") from None


@functools.lru_cache(maxsize=16)
def _parsed(text: str) -> dict[str, Any]:
    return tomllib.loads(text)
