"""Builds this package by setuptools, with a C compiler from PyPI where the machine has none.

pyproject.toml names it as the build backend, so that `pip install .`, `pip install -e .` and `python -m build` all need
nothing but Python and its headers. `python deploy/build_backend.py` says in one line what is missing.
"""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path
from typing import Any

from setuptools.build_meta import (
    build_editable,
    build_sdist,
    build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "complaint",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

ZIG = "ziglang>=0.13"


def has_compiler() -> bool:
    """Whether the C compiler that this Python would call is there."""
    command = os.environ.get("CC") or str(sysconfig.get_config_var("CC") or "cc")
    return shutil.which(shlex.split(command)[0]) is not None


def complaint() -> str:
    """What no package of PyPI can supply; empty if nothing is missing."""
    if Path(sysconfig.get_path("include"), "Python.h").exists():
        return ""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    packages = f"python{version}-dev (Debian, Ubuntu) or python3-devel (Fedora)"
    return f"the headers of Python {version} are missing: install {packages}"


def prepare() -> None:
    """Let distutils call the compiler that there is; for setup.py.

    Raises:
        SystemExit: Python's headers are missing, or there is no compiler at all; one line.
    """
    if complaint():
        sys.exit(complaint())
    if has_compiler():
        return
    if importlib.util.find_spec("ziglang") is None:
        sys.exit(f"there is no C compiler: install gcc, or `pip install '{ZIG}'`")
    # The plainest processor, as of any compiler that is not told otherwise.
    os.environ["CC"] = f"{shlex.quote(sys.executable)} -m ziglang cc -mcpu=baseline"
    os.environ["LDSHARED"] = f"{os.environ['CC']} -shared"


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:  # noqa: ARG001
    """Besides what pyproject.toml lists: a compiler where there is none. setuptools would run setup.py to answer."""
    return [] if has_compiler() else [ZIG]


get_requires_for_build_editable = get_requires_for_build_sdist = get_requires_for_build_wheel


if __name__ == "__main__":
    if complaint():
        print(complaint(), file=sys.stderr)
        sys.exit(2)
