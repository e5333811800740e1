"""Nothing is compiled by default. VDS_COMPILED=all, as in `make compiled`, compiles the cores; =kernels the loops only."""

import os
from glob import glob

from setuptools import Extension, setup

LEFT_TO_PYTHON = (
    "__",  # a package's own module, and its command line
    "compiled.py",
    "config.py",  # pydantic reads these classes
    "process.py",  # shells: they wait for messages
    "attendance.py",
    "floor_plan.py",
    "pace.py",
    "stopwatch.py",
)


def cores() -> list[str]:
    """The modules that a tick runs through."""
    paths = [*glob("agents/*.py"), *glob("world/*.py"), *glob("medium/*.py"), "bus/codec.py", "bus/phases.py"]
    paths += [f"monitor_station/{name}.py" for name in ("core", "map_merger", "search_rate", "states")]
    return sorted(path for path in [*paths, "deploy/simulation.py"] if not any(name in path for name in LEFT_TO_PYTHON))


def extensions(what: str) -> list[Extension]:
    if not what:
        return []
    from Cython.Build import cythonize

    # Never fused, so that the same doubles come out as of numpy.
    loops = Extension("world._kernels", ["world/_kernels.pyx"], extra_compile_args=["-O3", "-ffp-contract=off"])
    found = cythonize([loops], build_dir="build/cython", quiet=True)
    if what == "all":
        from mypyc.build import mypycify

        found += mypycify(cores(), opt_level="3", debug_level="0")
    return found


setup(ext_modules=extensions(os.environ.get("VDS_COMPILED", "")))
