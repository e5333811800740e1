"""Every decoder, core and shell survives what is no message: a few inputs here, many by `make fuzz`."""

from __future__ import annotations

import logging
import random
from collections.abc import Callable

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.codec import WireError
from tests.fuzzing.decoders import OWN, WayIn, parsers, reached, ways_in
from tests.fuzzing.hostile import HostileRun
from tests.fuzzing.mutations import mutated
from tests.fuzzing.samples import recorded
from tests.fuzzing.shells import medium_goes_on, node_goes_on, world_goes_on

PACKED_LISTS = (
    "positions", "transmission", "report", "departed", "stop", "signal", "event", "snapshot", "table", "payload 1",
    "payload 2", "payload 3",
)  # fmt: skip
seeds = st.integers(0, 2**32)


@pytest.fixture(autouse=True)
def _quiet() -> None:
    logging.getLogger().setLevel(logging.CRITICAL)


def test_every_function_that_parses_is_fuzzed() -> None:
    """A new decoder is reached by valid samples of its own (tests/fuzzing/decoders.py), or this fails."""

    def read_all() -> None:
        for way in ways_in():
            for sample in way.samples[:30]:
                assert way.try_on(sample), f"{way.name} refuses a valid sample"

    found = parsers()
    assert found - reached(read_all) - OWN.keys() == set()
    assert OWN.keys() <= found, "no longer there"


@pytest.mark.parametrize("way", ways_in(), ids=lambda way: way.name)
@settings(max_examples=6, deadline=None)
@given(seed=seeds)
def test_a_decoder_reads_or_refuses_in_few_words(way: WayIn, seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(2 if way.slow else 40):
        way.try_on(mutated(rng, rng.choice(way.samples), way.samples))


@pytest.mark.parametrize("depth", [2, 500, 1000, 1020])
@pytest.mark.parametrize("kind", PACKED_LISTS)
def test_lists_within_lists_in_any_field_are_refused(kind: str, depth: int) -> None:
    (way,) = (way for way in ways_in() if way.name == kind)
    fields = msgpack.unpackb(recorded().packed[kind][0])
    for index in range(len(fields)):
        if kind.startswith("payload") and index == 0:
            continue  # its kind, which whoever decodes it has read
        parts = [msgpack.packb(field) for field in fields]
        parts[index] = b"\x91" * depth + b"\x01"
        with pytest.raises(WireError) as refusal:
            way.read(bytes([0x90 | len(fields)]) + b"".join(parts))
        assert len(str(refusal.value)) < 100


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_the_cores_take_whatever_the_decoders_let_through(seed: int) -> None:
    run = HostileRun(random.Random(seed))
    for _ in range(40):
        if not run.tick():
            break
    assert run.inputs


@pytest.mark.parametrize("goes_on", [medium_goes_on, world_goes_on, node_goes_on])
@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_a_shell_goes_on_whatever_it_hears(goes_on: Callable[[random.Random, int], None], seed: int) -> None:
    goes_on(random.Random(seed), 20)
