"""The table of every key of a scenario, for docs/scenario-keys.md: made from the schema."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from deploy.scenario.schema import schema

__all__ = ["keys_page"]

_HEAD: Final = """\
# Keys of a scenario

Written by `vds scenario --keys` from the tables that check a scenario. `vds scenario --schema` writes the same as JSON
Schema. After `vds scenario --schema > scenario.schema.json`, an editor with a TOML language server, such as Taplo,
completes and checks a scenario beside it whose first line is `#:schema ./scenario.schema.json`.

A key without a default must be given. Where the default is \u2013, the key is left out, and its line says what follows.
A policy may have defaults of its own ([writing-a-policy.md](writing-a-policy.md)). Any key can be set on the command
line: `--set radio.loss=0.1`. No number is above 1e9 or below -1e9, and most have closer bounds. A tick is 0.1 s.
"""
_UNITS: Final = {
    "_bytes_s": "bytes/s", "_m_s": "m/s", "_dbm": "dBm", "_db": "dB", "_ticks": "ticks", "_s": "s", "_m": "m",
}  # fmt: skip
"""By the end of a key's name, the longest first."""
_MOST: Final = 1e9


def keys_page() -> str:
    """The page, as Markdown."""
    whole = schema()
    lines = [_HEAD]
    for path, table in _tables(whole, whole, ""):
        title = f"`{path}`" if path else "At the top"
        lines += [f"## {title}", ""]
        if path:
            lines += [table["description"].replace("\n", " "), ""]
        lines += ["| key | default | unit | bounds | what |", "|---|---|---|---|---|"]
        required = table.get("required", ())
        for key, value in table["properties"].items():
            if _table_in(whole, value) is None:
                cells = (f"`{key}`", _default(value, key in required), _unit(key), _bounds(value), _words(value))
                lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def _tables(whole: Mapping[str, Any], table: Mapping[str, Any], path: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """All tables by their heads in a file, each with its schema."""
    if any(_table_in(whole, value) is None for value in table["properties"].values()):
        yield path, table
    for key, value in table["properties"].items():
        inner = _table_in(whole, value)
        if inner is not None:
            dotted = f"{path.strip('[]')}.{key}".strip(".")
            yield from _tables(whole, inner, f"[[{dotted}]]" if "items" in value else f"[{dotted}]")


def _table_in(whole: Mapping[str, Any], value: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The table that a key holds, or a list of which; None for a plain value."""
    name = value.get("items", value).get("$ref")
    return None if name is None else whole["$defs"][name.rpartition("/")[2]]


def _default(value: Mapping[str, Any], required: bool) -> str:
    if required:
        return ""
    if "default" not in value:
        return "\u2013"
    default = value["default"]
    return f"`{default:.6g}`" if isinstance(default, float) else f"`{json.dumps(default)}`"


def _unit(key: str) -> str:
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")


def _bounds(value: Mapping[str, Any]) -> str:
    """The bounds of a number or of the numbers of a list, the words that a text may be, or what else it is."""
    if "anyOf" in value:
        return " or ".join(_bounds(member) for member in value["anyOf"])
    if "const" in value or "enum" in value:
        return ", ".join(f"`{word}`" for word in value.get("enum", [value.get("const")]))
    kind = value["type"]
    if kind == "array":
        inner = value["prefixItems"][0] if "prefixItems" in value else value["items"]
        count = f"{len(value['prefixItems'])} numbers" if "prefixItems" in value else "list of"
        return f"{count} {_bounds(inner).removesuffix('any')}".strip()
    if kind == "boolean":
        return "true, false"
    if kind == "string":
        least, most = value.get("minLength"), value.get("maxLength")
        return "text" + (f" of {least} to {most} characters" if most else ", not empty" if least else "")
    ends = [
        f"{sign} {value[name]:{'d' if isinstance(value[name], int) else 'g'}}"
        for name, sign in (("minimum", "\u2265"), ("exclusiveMinimum", ">"), ("maximum", "\u2264"))
        if name in value and abs(value[name]) != _MOST
    ]
    return " ".join(["whole number" if kind == "integer" else "", ", ".join(ends) or "any"]).strip()


def _words(value: Mapping[str, Any]) -> str:
    return str(value.get("description", "")).replace("|", "\\|")
