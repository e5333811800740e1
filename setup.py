"""Nothing is compiled by default. VDS_COMPILED=all compiles the cores (`make compiled`), =kernels some loops only."""

import os
from pathlib import Path

from setuptools import Extension, setup

LEFT_TO_PYTHON = (
    "__",  # a package's own module, and its command line
    "compiled.py",
    "config.py",  # pydantic reads these classes
    "floor_plan.py",
    "map_file.py",
    "map_header.py",
    "user_file.py",
)


def modules() -> list[str]:
    """The modules that a tick runs through."""
    names = [*Path("agents").glob("*.py"), *Path("world").glob("*.py"), *Path("medium").glob("*.py")]
    paths = [str(name) for name in names if not any(word in name.name for word in LEFT_TO_PYTHON)]
    station = [f"monitor_station/{name}.py" for name in ("core", "map_merger", "search_rate", "states")]
    bus = [f"bus/{name}.py" for name in ("codec", "envelopes", "lockstep", "mailbox", "member", "phases")]
    return sorted([*paths, *station, *bus, "deploy/simulation.py"])


def extensions(what: str) -> list[Extension]:
    if not what:
        return []
    from Cython.Build import cythonize

    # Never fused, so that the same doubles come out as of numpy.
    loops = Extension("world._kernels", ["world/_kernels.pyx"], extra_compile_args=["-O3", "-ffp-contract=off"])
    found = cythonize([loops], build_dir="build/cython", quiet=True)
    if what == "all":
        from mypyc.build import mypycify

        found += mypycify(modules(), opt_level="3", debug_level="0")
    return found


setup(ext_modules=extensions(os.environ.get("VDS_COMPILED", "")))
