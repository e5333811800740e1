"""The file that a process started by hand reads: its login and its configuration, as JSON.

`{"login": {"run", "endpoint", "user", "password"}, "config": {...}, ...}`. A configuration is a dataclass: its fields
stand under their names, an array as its shape and its values. The file holds a password, so only its owner may read it.
"""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from pathlib import Path
from typing import Any, Final, Union, get_args, get_origin

import numpy as np

from bus.access import Login
from bus.excerpt import shown
from bus.keys import check_run
from bus.user_file import read_text

__all__ = ["UNFIT", "Handover", "build", "contents", "plain", "read", "write"]

UNFIT: Final = (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)
"""What a file that is no such file may lead to."""

_MOST_BYTES: Final = 2**30
"""As many as the largest map takes, with room."""
_KINDS: Final = {int: "whole number", str: "text", bool: "true or false"}


@dataclasses.dataclass(frozen=True)
class Handover:
    """Contents of such a file: a login, and further entries in JSON types, which `build` turns back."""

    login: Login
    entries: dict[str, Any]


def write(path: Path, login: Login, **entries: Any) -> None:
    """Write the file for one process. Each entry is a dataclass, of JSON types, or None."""
    path.touch(mode=0o600)
    path.chmod(0o600)
    path.write_text(contents(login, **entries))


def contents(login: Login, **entries: Any) -> str:
    """What `write` writes."""
    return json.dumps({"login": plain(login)} | {name: plain(entry) for name, entry in entries.items()})


def read(path: Path, *, connect: str | None = None) -> Handover:
    """Read such a file; `connect` replaces the router's endpoint.

    Raises:
        ValueError: the file is missing or is no such file; the message is fit for a user.
    """
    try:
        content = json.loads(read_text(path, _MOST_BYTES))
        login = build(Login, content.pop("login"))
        check_run(login.run)
    except UNFIT as error:
        raise ValueError(f"{shown(path)} is no credentials file: {shown(error, 200)}") from error
    if connect is not None:
        login = dataclasses.replace(login, endpoint=connect)
    return Handover(login, content)


def plain(value: Any) -> Any:
    """A configuration in JSON types."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        # A list would lose the shape of an empty array.
        return {"shape": list(value.shape), "values": value.ravel().tolist()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        return {str(name): plain(item) for name, item in value.items()}
    return value


def build(hint: Any, value: Any) -> Any:
    """The value of type `hint` from which `plain` made `value`.

    Raises:
        One of UNFIT: the value does not fit.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is typing.Annotated:
        return build(arguments[0], value)
    if origin in (Union, types.UnionType) and type(None) in arguments:
        if value is None:
            return None
        return build(next(argument for argument in arguments if argument is not type(None)), value)
    if origin is np.ndarray:
        dtype = np.dtype(get_args(arguments[1])[0])
        return np.array(value["values"], dtype).reshape(value["shape"])
    if origin is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return tuple(build(arguments[0], item) for item in value)
        return tuple(build(argument, item) for argument, item in zip(arguments, value, strict=True))
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            raise ValueError(f"no {hint.__name__} there")
        hints = typing.get_type_hints(hint, include_extras=True)
        return hint(**{name: _named(name, hints[name], item) for name, item in value.items()})
    return _scalar(hint, value)


def _named(name: str, hint: Any, value: Any) -> Any:
    """A field; an error names it."""
    try:
        return build(hint, value)
    except ValueError as error:
        raise ValueError(f"{shown(name)}: {error}") from None


def _scalar(hint: Any, value: Any) -> Any:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is dict:
        if not isinstance(value, dict):
            raise ValueError(f"'{shown(value)}' is no table")
        return {build(arguments[0], name): build(arguments[1], item) for name, item in value.items()}
    if origin is typing.Literal:
        if value not in arguments:
            raise ValueError(f"'{shown(value)}' is none of {shown(', '.join(map(str, arguments)))}")
        return value
    if hint is float:
        if type(value) not in (int, float):
            raise ValueError(f"'{shown(value)}' is no number")
        return float(value)
    if hint in (int, str, bool) and type(value) is not hint:
        raise ValueError(f"'{shown(value)}' is no {_KINDS[hint]}")
    if isinstance(value, str) and value.encode(errors="ignore").decode() != value:
        raise ValueError(f"'{shown(value)}' is no text")
    return value
