"""What ARCHITECTURE.md promises of the sources and import-linter (pyproject.toml) can't see."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from tests import ROOT

CORE_PACKAGES = ("agents", "world", "medium", "monitor_station")
SEEDS = "world/seeds.py"
"""The one file that makes generators."""
MAY_SEE = {
    "agents": {"world.messages", "world.terms", "world.grid", "medium.messages"},
    "agents/process.py": {"world.seeds"},
}
"""What agents may import of `world` and `medium`, and what their shell may besides."""


def sources(*packages: str) -> Iterator[tuple[str, ast.Module]]:
    for path in sorted(path for package in packages for path in (ROOT / package).rglob("*.py")):
        yield str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))


def dotted(node: ast.expr) -> str:
    """`a.b.c` of an attribute; empty for anything else."""
    if isinstance(node, ast.Attribute):
        left = dotted(node.value)
        return f"{left}.{node.attr}" if left else ""
    return node.id if isinstance(node, ast.Name) else ""


def imported(tree: ast.Module) -> set[str]:
    """Modules that a source imports, as `package.module` where a module is taken from its package."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            package = "." not in node.module
            found |= {f"{node.module}.{alias.name}" if package else node.module for alias in node.names}
    return found


def global_randomness(tree: ast.Module) -> set[str]:
    """What a source takes of `random` and `numpy.random`, besides naming the types of generators."""
    called = {dotted(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    named = {dotted(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)} - {
        "random.Random", "np.random", "np.random.Generator",
    }  # fmt: skip
    used = called | named | imported(tree)
    return {name for name in used if name.startswith(("random.", "np.random.", "numpy.random"))}


def seen_of_others(path: str, tree: ast.Module) -> set[str]:
    """What an agents' source imports of `world` and `medium` and may not."""
    return (
        {name for name in imported(tree) if name.partition(".")[0] in ("world", "medium")}
        - MAY_SEE["agents"]
        - MAY_SEE.get(path, set())
    )


def test_cores_draw_from_generators_that_are_passed_in() -> None:
    found = {path: global_randomness(tree) for path, tree in sources(*CORE_PACKAGES) if path != SEEDS}
    assert {path: names for path, names in found.items() if names} == {}


def test_agents_see_of_world_and_medium_only_messages_terms_and_grid() -> None:
    found = {path: seen_of_others(path, tree) for path, tree in sources("agents")}
    assert {path: names for path, names in found.items() if names} == {}


def test_no_message_repeats_a_value_whatever_its_length() -> None:
    """`{value!r}` raises for a thousand lists within lists, and repeats a text of any length; `shown` does neither."""
    found = {
        f"{path}:{node.lineno}"
        for path, tree in sources("bus", *CORE_PACKAGES, "deploy")
        for node in ast.walk(tree)
        if isinstance(node, ast.FormattedValue) and node.conversion == ord("r")
    }
    assert not found


OURS = {
    # numbers, and names that the sources give
    "length", "low", "high", "kind", "number", "i", "count", "node", "tick", "robots", "port", "pid", "needed", "hard",
    "line", "lacking", "column", "dtype", "key", "name", "value", "writer", "size", "ndim", "robot",
    # texts that were put together here, of what `shown` and others repeat
    "error", "what", "where", "why", "which", "only", "hint", "known", "said", "place", "problem", "shares", "names",
    "who", "whom",
    # of exceptions and messages
    "strerror", "encoding", "start", "src", "_ticking", "__name__", "stem", "line_num", "verb", "_beams", "lost",
    "missing",
}  # fmt: skip
"""Names of variables and attributes that a refusal may repeat as they are: they have a bounded length by themselves."""


def repeated_whole(tree: ast.Module) -> set[str]:
    """What the refusals of a source repeat that may be of any length: texts of outside, not passed through `shown`."""
    found = set()
    for refusal in ast.walk(tree):
        if not isinstance(refusal, ast.Raise) or refusal.exc is None:
            continue
        for node in ast.walk(refusal.exc):
            if isinstance(node, ast.FormattedValue) and node.format_spec is None and not _is_ours(node.value):
                found.add(ast.unparse(node.value))
    return found


def _is_ours(value: ast.expr) -> bool:
    name = getattr(value, "attr", None) or getattr(value, "id", None)
    if name is not None:
        return name in OURS or name.isupper()
    if isinstance(value, ast.BinOp):
        return all(isinstance(side, ast.Constant) or _is_ours(side) for side in (value.left, value.right))
    if isinstance(value, ast.IfExp):
        return all(isinstance(side, ast.Constant | ast.JoinedStr) for side in (value.body, value.orelse))
    if isinstance(value, ast.Subscript):
        return _is_ours(value.value)
    if isinstance(value, ast.Call):
        named = getattr(value.func, "id", None) or getattr(value.func, "attr", "")
        return named in {"shown", "len", "nearest", "_list", "_tail", "node_name"} or (
            named == "join" and all(getattr(part, "id", "").isupper() for part in value.args)
        )
    return False


def test_no_refusal_repeats_a_text_of_outside_at_its_whole_length() -> None:
    found = {path: repeated_whole(tree) for path, tree in sources("bus", *CORE_PACKAGES, "deploy")}
    assert {path: names for path, names in found.items() if names} == {}


@pytest.mark.parametrize(
    "value", ["path", "options.run", "str(target)", "self.text", "module", "', '.join(names_given)"]
)
def test_the_rule_on_refusals_sees(value: str) -> None:
    assert repeated_whole(ast.parse(f"raise ValueError(f'{{{value}}}: no')".replace("', '", '", "')))
    assert not repeated_whole(ast.parse("raise ValueError(f'{shown(path)}: {error}, {ROLES}, {len(x)}, {x:g}')"))


def test_cores_open_print_and_ask_nothing() -> None:
    builtins = {"open", "print", "input", "breakpoint", "exec", "eval", "__import__"}
    found = [
        (path, node.lineno)
        for path, tree in sources(*CORE_PACKAGES)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in builtins
    ]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        "import random\nx = random.random()", "import random\nx = random.Random(3)", "from random import choice",
        "import numpy as np\nx = np.random.default_rng(1)", "import numpy as np\nnp.random.seed(1)",
        "from numpy.random import default_rng", "import numpy.random",
    ],
)  # fmt: skip
def test_the_rule_on_randomness_sees(line: str) -> None:
    assert global_randomness(ast.parse(line))


def test_the_rule_on_randomness_lets_generators_be_passed_in() -> None:
    given = "import random\nimport numpy as np\ndef f(rng: random.Random, g: np.random.Generator): return rng.random()"
    assert not global_randomness(ast.parse(given))


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("agents/vds.py", "from world.core import World"), ("agents/vds.py", "from world import core"),
        ("agents/vds.py", "import medium.core"), ("agents/vds.py", "from world.seeds import node_stream"),
    ],
)  # fmt: skip
def test_the_rule_on_what_agents_see_sees(path: str, line: str) -> None:
    assert seen_of_others(path, ast.parse(line))
    assert not seen_of_others("agents/process.py", ast.parse("from world.seeds import node_stream"))
