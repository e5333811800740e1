"""JSON Schema of a scenario, made from the dataclasses that check it: editors complete and check TOML files by it."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import re
from collections.abc import Iterator
from typing import Any, get_type_hints

from deploy.scenario.tables import TABLES, Tables, dataclass_in

__all__ = ["schema"]


def schema() -> dict[str, Any]:
    """The schema, of draft 2020-12, with the sources' own words on every key.

    It has all bounds of single keys. What several keys must be together is checked when a scenario is loaded.
    """
    whole = _without_null(TABLES.json_schema())
    for kind in _kinds(Tables):
        table = whole if kind is Tables else whole["$defs"][kind.__name__]
        words = _words_on(kind)
        for key, value in table["properties"].items():
            value.pop("title", None)  # the key once more, in capitals
            if key in words:
                value["description"] = words[key]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **whole,
        "title": "A scenario of the VDS emulator",
    }


def _kinds(kind: Any) -> Iterator[Any]:
    """A dataclass, and all that are within it."""
    yield kind
    for hint in get_type_hints(kind, include_extras=True).values():
        if (inner := dataclass_in(hint)) is not None:
            yield from _kinds(inner)


def _words_on(kind: Any) -> dict[str, str]:
    """By field of a dataclass: the text that stands below it, in one line."""
    body = ast.parse(inspect.getsource(kind)).body[0]
    assert isinstance(body, ast.ClassDef)
    words = {}
    for field, below in itertools.pairwise(body.body):
        if (
            isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        ):  # fmt: skip
            # A file has no None: there the key is left out.
            text = re.sub(r"\bNone( =|:)", "left out:", str(below.value.value))
            words[field.target.id] = " ".join(text.split())
    assert set(words) <= {field.name for field in dataclasses.fields(kind)}
    return words


def _without_null(value: Any) -> Any:
    """The schema without null, which TOML lacks: a key whose default is None is left out."""
    if isinstance(value, list):
        return [_without_null(item) for item in value]
    if not isinstance(value, dict):
        return value
    kept = {key: _without_null(item) for key, item in value.items() if not (key == "default" and item is None)}
    members = [member for member in kept.get("anyOf", ()) if member != {"type": "null"}]
    if len(members) == 1:
        del kept["anyOf"]
        kept |= members[0]
    elif members:
        kept["anyOf"] = members
    return kept
