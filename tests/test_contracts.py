"""What ARCHITECTURE.md promises of the sources and import-linter (pyproject.toml) can't see."""

from __future__ import annotations

import ast
import itertools
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import pytest

from bus.built import LOOPS
from tests import ROOT
from tests.helpers.source_names import Names, names_of, read_names

PACKAGES: Final = ("bus", "world", "medium", "agents", "monitor_station", "deploy", "vds")
CORE_PACKAGES: Final = ("agents", "world", "medium", "monitor_station")
SEEDS: Final = "world/seeds.py"
"""The one file that makes generators."""
MAY_SEE: Final = {
    "agents": {"world.messages", "world.terms", "world.grid", "medium.messages"},
    "agents/process.py": {"world.seeds"},
}
"""What agents may import of `world` and `medium`, and what their shell may besides."""
ALLOWED: Final = {
    "__future__", "abc", "annotated_types", "array", "bisect", "collections", "collections.abc", "contextlib",
    "dataclasses", "enum", "functools", "hashlib", "heapq", "itertools", "json", "math", "msgpack", "mypy_extensions",
    "numpy", "numpy.typing", "operator", "random", "re", "scipy.ndimage", "struct", "types", "typing",
}  # fmt: skip
"""All that a core, and whatever it imports, may take from outside of the project: none of it knows a clock, a thread,
a socket, a process or a file."""
LOOPS_MAY: Final = {
    "libc.math", "libc.stdint", "libc.stdlib", "libc.string", "cpython.array", "cpython.bytearray",
    "cpython.bytes", "cpython.long", "cpython.ref", "cpython.tuple", "numpy",
}  # fmt: skip
"""All that compiled loops may import. They compute on what they are given, so they know nothing of the project."""
NUMPY_FILES: Final = (
    "DataSource", "ctypeslib", "fromfile", "fromregex", "genfromtxt", "lib", "load", "loadtxt", "memmap", "save",
    "savetxt", "savez", "savez_compressed",
)  # fmt: skip
OUTSIDE: Final = {
    "open", "print", "input", "breakpoint", "exec", "eval", "compile", "globals", "vars", "__import__", "__builtins__",
    "extern",
}  # fmt: skip
"""Names that lead out of a core, and by which Cython declares C functions."""


def paths(*packages: str, suffix: str = ".py") -> Iterator[Path]:
    yield from sorted(path for package in packages for path in (ROOT / package).rglob(f"*{suffix}"))


def sources(*packages: str) -> Iterator[tuple[str, ast.Module]]:
    for path in paths(*packages):
        yield str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))


def named(*packages: str) -> Iterator[tuple[str, Names]]:
    """Each source, compiled loops too, and what it takes."""
    for path in itertools.chain(paths(*packages), paths(*packages, suffix=".pyx")):
        yield str(path.relative_to(ROOT)), read_names(path)


def module_of(path: str) -> str:
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def no_core(module: str) -> bool:
    """Whether it is a shell, or what serves shells alone: pyproject.toml protects those."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    shells = {name for contract in contracts for name in contract.get("protected_modules", ())}
    return module in shells or module.endswith(".__main__") or module.startswith("monitor_station.recording")


def outside(names: Names) -> set[str]:
    """What a source imports from outside of the project and a core may not."""
    return {
        name
        for name in names.imported
        if name.partition(".")[0] not in PACKAGES and not {name, name.rpartition(".")[0]} & ALLOWED
    }


def reached(names: Names) -> set[str]:
    """The sources of the project that a source imports."""
    found = set()
    for name in names.imported:
        parts = name.split(".")
        for length in range(1, len(parts) + 1):
            at = ROOT.joinpath(*parts[:length])
            found |= {
                str(path.relative_to(ROOT)) for path in (at.with_suffix(".py"), at / "__init__.py") if path.is_file()
            }
    return found


def cores() -> dict[str, Names]:
    """Every core, and everything of the project that one imports, by path."""
    found: dict[str, Names] = {}
    ahead = [str(path.relative_to(ROOT)) for path in paths(*CORE_PACKAGES)]
    while ahead:
        path = ahead.pop()
        if path not in found and not no_core(module_of(path)):
            found[path] = read_names(ROOT / path)
            ahead += sorted(reached(found[path]))
    return found


def taken_by_loops(names: Names) -> set[str]:
    """What compiled loops import and may not."""
    return {name for name in names.imported if not {name, name.rpartition(".")[0]} & LOOPS_MAY}


def files(names: Names) -> set[str]:
    """What a source uses to reach a file or a terminal, or to get around these rules."""
    heads = {f"numpy.{name}" for name in NUMPY_FILES}
    return {
        name
        for name in names.used | names.imported
        if name.removeprefix("builtins.") in OUTSIDE
        or (name == "numpy" and name in names.used)  # under another name
        or ".".join(name.split(".")[:2]) in heads
        or name.rpartition(".")[2] == "tofile"
    }


def global_randomness(names: Names) -> set[str]:
    """What a source takes of `random` and `numpy.random`, besides naming the types of generators."""
    types = {"random.Random", "numpy.random.Generator"}
    taken = (names.used - types) | (names.called & types) | (names.imported - types - {"random"})
    return {name for name in taken if name == "random" or name.startswith(("random.", "numpy.random"))}


def seen_of_others(path: str, names: Names) -> set[str]:
    """What an agents' source imports of `world` and `medium` and may not."""
    may = MAY_SEE["agents"] | MAY_SEE.get(path, set())
    return {
        name
        for name in names.imported
        if name.partition(".")[0] in ("world", "medium")
        and name not in may
        and (name.rpartition(".")[0] not in may or ROOT.joinpath(*name.split(".")).with_suffix(".py").is_file())
    }


def found(rule: Callable[[Names], set[str]], of: Iterable[tuple[str, Names]]) -> dict[str, set[str]]:
    """What a rule finds, by path."""
    return {path: names for path, taken in of if (names := rule(taken))}


def test_cores_and_what_they_import_take_only_what_is_allowed() -> None:
    assert len(cores()) > 60
    assert found(outside, cores().items()) == {}


def test_compiled_loops_import_nothing_but_arithmetic() -> None:
    loops = [(path, names) for path, names in named(*PACKAGES) if path.endswith(".pyx")]
    assert len(loops) >= len(LOOPS)
    assert found(taken_by_loops, loops) == {}


def test_cores_open_print_and_ask_nothing() -> None:
    assert found(files, named(*CORE_PACKAGES)) == {}


def test_cores_draw_from_generators_that_are_passed_in() -> None:
    every = [(path, names) for path, names in named(*CORE_PACKAGES) if path != SEEDS]
    assert found(global_randomness, every) == {}


def test_agents_see_of_world_and_medium_only_messages_terms_and_grid() -> None:
    every = {path: seen_of_others(path, names) for path, names in named("agents")}
    assert {path: names for path, names in every.items() if names} == {}


def test_no_message_repeats_a_value_whatever_its_length() -> None:
    """`{value!r}` raises for a thousand lists within lists, and repeats a text of any length; `shown` does neither."""
    found = {
        f"{path}:{node.lineno}"
        for path, tree in sources(*PACKAGES)
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
    "missing", "model", "fading",
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
    found = {path: repeated_whole(tree) for path, tree in sources("bus", *CORE_PACKAGES, "deploy", "vds")}
    assert {path: names for path, names in found.items() if names} == {}


@pytest.mark.parametrize(
    "value", ["path", "options.run", "str(target)", "self.text", "module", "', '.join(names_given)"]
)
def test_the_rule_on_refusals_sees(value: str) -> None:
    assert repeated_whole(ast.parse(f"raise ValueError(f'{{{value}}}: no')".replace("', '", '", "')))
    assert not repeated_whole(ast.parse("raise ValueError(f'{shown(path)}: {error}, {ROLES}, {len(x)}, {x:g}')"))


@pytest.mark.parametrize(
    "line",
    [
        "import shutil", "import concurrent.futures", "from concurrent import futures", "import _thread",
        "import ctypes", "import select", "import fcntl", "import mmap", "import glob", "import sched",
        "import logging", "import queue",
        "import urllib.request", "from urllib import request", "import io\nx = io.open('a')", "import os.path as p",
        "from builtins import open as o", "import importlib\nt = importlib.import_module('time')", "import time",
        "import asyncio", "import scipy.io", "from scipy import io", "import numpy.lib.npyio", "import zenoh",
        "def f():\n    import time", "try:\n    import time as t\nfinally:\n    pass",
    ],
)  # fmt: skip
def test_the_rule_on_what_cores_import_sees(line: str) -> None:
    assert outside(names_of(line))


def test_the_rule_on_what_cores_import_follows_the_projects_own_modules() -> None:
    assert "bus/session.py" in reached(names_of("from bus.session import Session"))
    assert "bus/session.py" in reached(names_of("from bus import session as s"))
    assert outside(read_names(ROOT / "bus" / "session.py"))
    assert {"world/core.py", "agents/vds.py", "bus/codec.py", "world/grid/__init__.py"} <= cores().keys()
    assert not {"world/process.py", "world/__main__.py", "agents/policies.py"} & cores().keys()


@pytest.mark.parametrize(
    "line",
    [
        "import time", "from time import time", "from world.core import World", "from world.core cimport World",
        "cimport posix.time", "from libc.stdio cimport fopen", "cdef int f():\n    import os\n    return 1",
        "cdef int f(): import os", "x = 1; import os", "from libc.math cimport floor\nfrom libc cimport time",
        "from cpython cimport pythread", "from .core import World", "from . import core",
    ],
)  # fmt: skip
def test_the_rule_on_compiled_loops_sees(line: str) -> None:
    assert taken_by_loops(names_of(line + "\n", cython=True))


@pytest.mark.parametrize(
    "line",
    [
        "open('a')", "o = open", "import numpy as n\nn.fromfile('a')", "from numpy import fromfile as f",
        "import numpy as np\nm = np", "import numpy as np\nf = np.lib.npyio.load", "import numpy\nnumpy.memmap('a')",
        "import builtins\nbuiltins.open('a')", "def f(a):\n    return a[0].tofile('b')", "x = __builtins__['open']",
        "exec('import time')",
    ],
)  # fmt: skip
@pytest.mark.parametrize("cython", [False, True])
def test_the_rule_on_files_sees(line: str, cython: bool) -> None:
    assert files(names_of(line + "\n", cython=cython))


def test_the_rule_on_files_sees_functions_that_cython_declares() -> None:
    assert files(names_of('cdef extern from "stdio.h":\n    int getchar()\n', cython=True))


@pytest.mark.parametrize(
    "line",
    [
        "import random\nx = random.random()", "import random\nx = random.Random(3)", "from random import choice",
        "import random as r\nr.random()", "import random\nr = random", "from random import Random as R\nR(3)",
        "import numpy as np\nx = np.random.default_rng(1)", "import numpy as np\nnp.random.seed(1)",
        "import numpy as n\nn.random.random()", "from numpy import random", "from numpy.random import default_rng",
        "import numpy.random",
    ],
)  # fmt: skip
@pytest.mark.parametrize("cython", [False, True])
def test_the_rule_on_randomness_sees(line: str, cython: bool) -> None:
    assert global_randomness(names_of(line + "\n", cython=cython))


def test_the_rule_on_randomness_lets_generators_be_passed_in() -> None:
    given = "import random\nimport numpy as np\ndef f(rng: random.Random, g: np.random.Generator): return rng.random()"
    assert not global_randomness(names_of(given))


@pytest.mark.parametrize(
    "line",
    [
        "from world.core import World", "from world import core", "import medium.core", "import world.core as w",
        "from world.seeds import node_stream", "from world.grid import map_file", "from world.grid.lines import pad",
    ],
)  # fmt: skip
def test_the_rule_on_what_agents_see_sees(line: str) -> None:
    assert seen_of_others("agents/vds.py", names_of(line))


def test_the_rule_on_what_agents_see_lets_their_shell_seed() -> None:
    assert not seen_of_others("agents/process.py", names_of("from world.seeds import node_stream"))
    assert not seen_of_others("agents/vds.py", names_of("from world.terms import Cls\nfrom world import grid"))
