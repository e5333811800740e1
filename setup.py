"""Builds the compiled loops (every `_NAME.pyx`), and with VDS_COMPILED=all the cores by mypyc as well.

VDS_CHECKED=1 builds loops that check every index, for the tests.
"""

import os
import sys
from pathlib import Path

from setuptools import Extension, setup

sys.path.insert(0, str(Path(__file__).parent))

from bus.built import LOOPS, digest
from deploy.build_backend import prepare

LEFT_TO_PYTHON = (
    "__",  # a package's own module, and its command line
    "config.py",  # pydantic reads these classes
    "floor_plan.py",
    "map_file.py",
    "map_header.py",
    "user_file.py",
)
CHECKED = os.environ.get("VDS_CHECKED") == "1"


def loops() -> list[Extension]:
    """The hot loops. They are never fused and know no processor of their own, so all give the same doubles."""
    from Cython.Build import cythonize

    # What Cython adds to each file is built once.
    shared = Extension("bus._cython", [], extra_compile_args=["-O2", "-g0"])
    own = [
        Extension(
            name,
            [f"{name.replace('.', '/')}.pyx"],
            define_macros=[("VDS_SOURCE", digest(name))],
            extra_compile_args=["-O3", "-g0", "-ffp-contract=off"],
        )
        for name in LOOPS
    ]
    directives = {"boundscheck": CHECKED, "initializedcheck": CHECKED, "wraparound": False, "cdivision": True}
    return cythonize(
        [shared, *own],
        build_dir="build/cython",
        compiler_directives=directives,
        shared_utility_qualified_name=shared.name,
        quiet=True,
        force=True,
    )


def cores() -> list[Extension]:
    """The modules that a tick runs through, from their own Python."""
    from mypyc.build import mypycify

    names = [path for package in ("agents", "world", "medium") for path in Path(package).rglob("*.py")]
    paths = [str(name) for name in names if not any(word in name.name for word in LEFT_TO_PYTHON)]
    station = [
        f"monitor_station/{name}.py" for name in ("core", "exhaustion", "map_merger", "search_rate", "recording/states")
    ]
    bus = [
        f"bus/{name}.py"
        for name in ("codec", "envelopes", "lockstep", "mailbox", "malformed", "member", "nodes", "phases")
    ]
    return mypycify(sorted([*paths, *station, *bus, "deploy/simulation.py"]), opt_level="3", debug_level="0")


prepare()
setup(
    ext_modules=loops() + (cores() if os.environ.get("VDS_COMPILED") == "all" else []),
    options={"build_ext": {"parallel": os.cpu_count()}},
)
