"""Builds the compiled loops (every `_NAME.pyx`), and with VDS_COMPILED=all the cores by mypyc as well.

VDS_CHECKED=1 builds loops that check every index, for the tests.
"""

import os
import sys
from pathlib import Path

from setuptools import Extension, setup

sys.path.insert(0, str(Path(__file__).parent))

from bus.built import digest
from deploy.build_backend import prepare

LEFT_TO_PYTHON = (
    "__",  # a package's own module, and its command line
    "config.py",  # pydantic reads these classes
    "floor_plan.py",
)
CHECKED = os.environ.get("VDS_CHECKED") == "1"


def loops() -> list[Extension]:
    """The hot loops. They are never fused and know no processor of their own, so all give the same doubles."""
    from Cython.Build import cythonize

    # What Cython adds to each file is built once.
    extensions = [Extension("bus._cython", [], extra_compile_args=["-O2", "-g0"])]
    for source in sorted(Path().glob("[abmw]*/_*.pyx")):
        name = ".".join(source.with_suffix("").parts)
        extensions.append(
            Extension(
                name,
                [str(source)],
                define_macros=[("VDS_SOURCE", digest(name))],
                extra_compile_args=["-O3", "-g0", "-ffp-contract=off"],
            )
        )
    directives = {"boundscheck": CHECKED, "initializedcheck": CHECKED, "wraparound": False, "cdivision": True}
    return cythonize(
        extensions,
        build_dir="build/cython",
        compiler_directives=directives,
        shared_utility_qualified_name="bus._cython",
        quiet=True,
        force=True,
    )


def cores() -> list[Extension]:
    """The modules that a tick runs through, from their own Python."""
    from mypyc.build import mypycify

    names = [*Path("agents").glob("*.py"), *Path("world").glob("*.py"), *Path("medium").glob("*.py")]
    paths = [str(name) for name in names if not any(word in name.name for word in LEFT_TO_PYTHON)]
    station = [f"monitor_station/{name}.py" for name in ("core", "map_merger", "search_rate", "states")]
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
