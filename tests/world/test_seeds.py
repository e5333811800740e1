"""No two random streams of a run are alike, and every generator comes from their table."""

from __future__ import annotations

import ast
import itertools

import pytest

from tests import ROOT
from world.seeds import Stream, counted, link_uniforms, node_stream, sequence

PACKAGES = ("agents", "world", "medium", "monitor_station", "deploy")
SEQUENCES = (Stream.CHOICE, Stream.LOSS, Stream.STARTS, Stream.VICTIMS)
COUNTED = (Stream.LIDAR, Stream.POSE, Stream.FADING, Stream.BURSTS, Stream.SHADOWING)
MAKERS = {"Random", "SystemRandom", "SeedSequence", "PCG64", "Philox", "RandomState", "default_rng", "seed"}


def beginnings(seed: int) -> dict[str, tuple[float, ...]]:
    """The first numbers of every stream of a run, in [0, 1)."""
    streams = {stream.name: tuple(sequence(seed, stream).random(4).tolist()) for stream in SEQUENCES}
    for stream, node, tick in itertools.product(COUNTED, range(1, 4), range(3)):
        streams[f"{stream.name} {node} {tick}"] = tuple(counted(seed, stream, node, tick).random(4).tolist())
    for node, incarnation in itertools.product(range(4), range(3)):
        rng = node_stream(seed, node, incarnation)
        streams[f"node {node} {incarnation}"] = tuple(rng.random() for _ in range(4))
    for link in itertools.product((1, 2), (2, 3), (5,), (5, 6), (7,), (8,)):
        streams[f"link {link}"] = link_uniforms(seed, link)
    return streams


def test_the_table_is_tested_as_a_whole() -> None:
    assert {*SEQUENCES, *COUNTED} == set(Stream)
    assert len(set(Stream)) == len(Stream.__members__), "an alias would be one stream with two names"


@pytest.mark.parametrize("seeds", [(0, 1), (1, 2), (7, 2**40 + 7)])
def test_no_two_streams_share_a_number(seeds: tuple[int, ...]) -> None:
    """Of one run, and of two whose seeds are near or alike in their lower bits."""
    streams = {(seed, name): numbers for seed in seeds for name, numbers in beginnings(seed).items()}
    numbers = [number for beginning in streams.values() for number in beginning]
    assert len(set(numbers)) == len(numbers)


def test_a_stream_is_a_function_of_its_seed_and_name() -> None:
    assert beginnings(5) == beginnings(5)


def test_nobody_else_makes_a_generator() -> None:
    """By the name of what is called: `random.Random`, `np.random.default_rng`, and so on."""
    found = []
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                called = node.func
                name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
                if name in MAKERS:
                    found.append(str(path.relative_to(ROOT)))
    others = {"deploy/sweep/campaign.py", "deploy/sweep/statistics.py"}  # samples of a study's points and of its rows
    assert set(found) == {"world/seeds.py"} | others
