"""Which modules and names a source takes, with aliases resolved: of Python by its syntax tree, of Cython by tokens."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Names", "names_of", "read_names"]

_SKIPPED = (tokenize.COMMENT, tokenize.NL, tokenize.INDENT, tokenize.DEDENT)


@dataclass(frozen=True)
class Names:
    """What a source takes from elsewhere."""

    imported: frozenset[str]
    """Every `m` of `import m`, and `m.n` of `from m import n`, which is a module or a name in one."""
    used: frozenset[str]
    """Every name that it reads, as `module.name` where the name or its beginning was imported."""
    called: frozenset[str]
    """Those of them that it calls."""


def read_names(path: Path) -> Names:
    return names_of(path.read_text(encoding="utf-8"), cython=path.suffix == ".pyx")


def names_of(text: str, *, cython: bool = False) -> Names:
    """What a source takes.

    Args:
        text: of the source.
        cython: whether it is Cython: `cimport` is an import there, and what else Python lacks is read over.
    """
    if cython:
        imports, chains = _cython(text)
        tree = ast.parse(imports)
    else:
        tree = ast.parse(text)
        chains = list(_python(tree))
    imported, aliases = set(), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for each in node.names:
                head = each.name.partition(".")[0]
                imported.add(each.name)
                aliases[each.asname or head] = each.name if each.asname else head
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            for each in node.names:
                imported.add(f"{module}.{each.name}")
                aliases[each.asname or each.name] = f"{module}.{each.name}"
    used, called = set(), set()
    for chain, is_called in chains:
        head, dot, rest = chain.partition(".")
        name = aliases.get(head, head) + dot + rest
        used.add(name)
        if is_called:
            called.add(name)
    return Names(frozenset(imported), frozenset(used), frozenset(called))


def _python(tree: ast.Module) -> Iterator[tuple[str, bool]]:
    """Each `a.b.c` that is read, whole, and whether it is called."""
    inner = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name) and id(node) not in inner:
            chain: list[str] = []
            at: ast.expr = node
            while isinstance(at, ast.Attribute):
                chain.insert(0, at.attr)
                at = at.value
            # What hangs on a call or an index hangs on no module, but its own name still tells: `f(x).tofile`.
            yield ".".join([at.id if isinstance(at, ast.Name) else "", *chain]), id(node) in called


def _cython(text: str) -> tuple[str, list[tuple[str, bool]]]:
    """Its imports, as Python's, and each `a.b.c` and whether a bracket follows."""
    tokens = [t for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type not in _SKIPPED]
    imports: list[str] = []
    chains: list[tuple[str, bool]] = []
    at, first = 0, True
    while at < len(tokens):
        token = tokens[at]
        if first and token.string in ("import", "cimport", "from", "include"):
            end = at
            while tokens[end].type not in (tokenize.NEWLINE, tokenize.ENDMARKER) and tokens[end].string != ";":
                end += 1
            words = ["import" if t.string == "cimport" else t.string for t in tokens[at:end]]
            imports += [" ".join(words)] * (token.string != "include")
            at = end
            continue
        if token.type == tokenize.NAME:
            end = at + 1
            while tokens[end].string == "." and tokens[end + 1].type == tokenize.NAME:
                end += 2
            dangling = "." if at and tokens[at - 1].string == "." else ""
            chains.append((dangling + "".join(t.string for t in tokens[at:end]), tokens[end].string == "("))
            at = end
        else:
            at += 1
        first = tokens[at - 1].type == tokenize.NEWLINE or tokens[at - 1].string in (";", ":")
    return "\n".join(imports), chains
