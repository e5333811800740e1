"""Short missions keep their digests, on any processor, and in the form that mypyc compiles."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT
from tests.helpers.golden import DIGESTS

PLAIN_PROCESSOR = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR AVX2 FMA3 AVX512F AVX512_SKX",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX2_Usable,-FMA,-FMA_Usable,-FMA4,-AVX512F,-AVX512VL",
}
"""numpy and the C library choose other code without these instructions: sines and logarithms differ in the last bit."""

FIXED = {"PYTHONHASHSEED": "0"}


def answer(tree: Path, env: dict[str, str], *arguments: str) -> str:
    path = os.pathsep.join([str(tree), str(ROOT)])
    command = [sys.executable, "-W", "ignore", *arguments]
    done = subprocess.run(
        command, cwd=tree, env=os.environ | env | {"PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("name", DIGESTS)
def test_digests_stay(name: str, pytestconfig: pytest.Config) -> None:
    tree = ROOT / pytestconfig.getoption("--tree")
    form = "import agents.robot, sys; sys.stdout.write(agents.robot.__file__)"
    assert Path(answer(tree, {}, "-c", form)).is_relative_to(tree)
    assert answer(tree, {}, "-m", "tests.helpers.golden", name) == DIGESTS[name]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the instructions are those of x86-64")
@pytest.mark.parametrize("name", DIGESTS)
def test_digests_are_those_of_a_plain_processor(name: str) -> None:
    # That other code is at work shows in last bits, on a processor that has these instructions.
    bits = "import math, numpy; x = numpy.arange(1.0, 999.0); print(math.sin(7.3e5), hash(numpy.cos(x).tobytes()))"
    if "fma" in Path("/proc/cpuinfo").read_text().split():
        assert answer(ROOT, PLAIN_PROCESSOR | FIXED, "-c", bits) != answer(ROOT, FIXED, "-c", bits)
    assert answer(ROOT, PLAIN_PROCESSOR, "-m", "tests.helpers.golden", name) == DIGESTS[name]
