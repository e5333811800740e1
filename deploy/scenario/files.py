"""Sources of scenarios: those of the emulator, files of the user, and `KEY=VALUE` of a command line."""

from __future__ import annotations

import copy
import functools
import re
import tomllib
from pathlib import Path
from typing import Any, Final

from bus.excerpt import shown
from bus.user_file import read_text
from deploy.scenario.name import name_of
from deploy.scenario.tables import ScenarioError, nearest

__all__ = ["located", "names", "parse_set", "read_source", "read_toml", "text_of"]

FOLDER: Final = Path(__file__).resolve().parent.parent / "scenarios"
_MOST_BYTES: Final = 2**20
_BARE: Final = re.compile(r"[A-Za-z_][\w:.-]*")


def names() -> list[str]:
    """The scenarios that come with the emulator."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def text_of(name: str) -> str:
    """The file of a scenario that comes with the emulator.

    Raises:
        ScenarioError: there is none of that name.
    """
    if name not in names():
        raise ScenarioError(f"unknown scenario '{shown(name)}', {nearest(name, names())}")
    return (FOLDER / f"{name}.toml").read_text(encoding="utf-8")


def parse_set(text: str) -> tuple[str, Any]:
    """Read KEY=VALUE, such as radio.loss=0.1. VALUE is as in TOML; a bare word is text.

    Raises:
        ScenarioError: it is not of that form.
    """
    key, equals, value = text.partition("=")
    key, value = key.strip(), value.strip()
    said = f"'{shown(text)}'"
    if not equals or not key or not value:
        raise ScenarioError(f"{said}: expected KEY=VALUE, such as radio.loss=0.1")
    try:
        parsed = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        if not _BARE.fullmatch(value):
            raise ScenarioError(
                f'{said}: what follows = is not a TOML value, such as 0.1, true, "text" or [1, 2]'
            ) from None
        return key, value
    if list(parsed) != ["value"]:
        raise ScenarioError(f"{said}: more than one value")
    return key, parsed["value"]


def read_source(source: str) -> tuple[dict[str, Any], Path]:
    """The raw tables of a scenario, and the file whose folder its relative paths start from.

    Args:
        source: name of a scenario that comes with the emulator, path of a .toml file, or path of a ROS map's .yaml.

    Raises:
        ScenarioError: there is no such scenario or file, or it is not TOML.
    """
    path = _at_home(source)
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return {"name": name_of(path.stem), "floor_plan": {"map": path.name}}, path
    if suffix != ".toml":
        if source not in names():
            known = f"{nearest(source, names())} (or give the path of a .toml or a map's .yaml)"
            raise ScenarioError(f"unknown scenario '{shown(source)}', {known}")
        path = FOLDER / f"{source}.toml"
    return read_toml(path), path


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        ScenarioError: it can't be read, or it is not TOML.
    """
    try:
        text = read_text(path, _MOST_BYTES)
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    try:
        return copy.deepcopy(_parsed(text))
    except (ValueError, RecursionError) as error:  # ValueError is also that of a number with thousands of digits
        what = "nested too deeply" if isinstance(error, RecursionError) else shown(error, 120)
        raise ScenarioError(f"{shown(path)}: not TOML: {what}") from None


def located(name: str, folder: Path) -> Path:
    """Where a path of the user's leads, seen from `folder`; ~/ is the home folder, as a shell has it.

    Links are not followed: what a file names beside itself lies beside the link.

    Raises:
        ScenarioError: there is no such path: the working folder is gone, or a name in it is no text.
    """
    try:
        path = (folder / _at_home(name)).absolute()
        str(path).encode()
    except OSError as error:
        raise ScenarioError(f"{shown(name)}: the working folder: {error.strerror}") from None
    except UnicodeEncodeError:
        raise ScenarioError(f"{shown(name)}: its path is not UTF-8, so no scenario can name it; rename it") from None
    return path


def _at_home(name: str) -> Path:
    return Path(name).expanduser() if name.startswith("~/") else Path(name)


@functools.lru_cache(maxsize=16)
def _parsed(text: str) -> dict[str, Any]:
    return tomllib.loads(text)
