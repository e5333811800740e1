"""An answer counts as a whole or not at all, so that digest and world agree on who took part in a tick."""

from __future__ import annotations

import numpy as np
import pytest

from bus.envelopes import NO_TICK, Answer, Moves, Opening
from bus.lockstep import Kind, seal
from medium.core import Medium
from medium.messages import BROADCAST, Transmission
from medium.process import Shell
from tests.fuzzing.samples import scenario
from tests.fuzzing.shells import DeadSession, word
from world.messages import Departed, Positions
from world.terms import STATION

CONFIG = scenario().medium_config()
NODES = range(CONFIG.robots + 1)
LIAR = 2
HONEST = [node for node in NODES if node != LIAR]


def token(node: int) -> int:
    return node + 1


def frames(node: int, tick: int) -> bytes:
    return Transmission(tick, node, ((BROADCAST, b"hello"),)).encode()


class Ticks:
    """A medium's shell without a bus."""

    def __init__(self) -> None:
        self.session, self.core = DeadSession(), Medium(CONFIG)
        self._shell = Shell(self.core, CONFIG, self.session, hosts=True)  # type: ignore[arg-type]  # has no bus

    def begin(self, tick: int, tokens: dict[int, int]) -> None:
        at_m = np.array([(28.0 + node, 35.0) for node in tokens])
        positions = Positions(tick, np.array(list(tokens), np.int16), at_m).encode()
        senses = [(node, seal(Kind.DATA, token, b"sense")) for node, token in tokens.items()]
        self._take(self.session.keys.positions, seal(Kind.DATA, 0, Opening(positions, senses).encode()))

    def answer(self, node: int, answer: Answer, token: int) -> None:
        self._take(self.session.keys.tx(node), seal(Kind.DATA, token, answer.encode()))

    def depart(self, tick: int, node: int) -> None:
        self._take(self.session.keys.positions, seal(Kind.DEPARTED, 0, Departed(tick, node).encode()))

    def _take(self, key: str, data: bytes) -> None:
        self._shell._mailbox.put((key, data))
        assert self._shell._receive(0.0)

    @property
    def moves(self) -> list[Moves]:
        return [Moves.decode(moved) for moved in self.session.sent[self.session.keys.moved]]

    @property
    def counted(self) -> list[int]:
        """Nodes whose answers the world is told to count."""
        return [node for moves in self.moves for node, *_ in moves.answers]


def honest_tick(ticks: Ticks, tick: int, nodes: list[int]) -> None:
    for node in nodes:
        ticks.answer(node, Answer(tick, frames(node, tick), word(node, tick, CONFIG.cells)), token(node))


@pytest.mark.parametrize(
    "said",
    [
        Answer(0, b"", b""),
        Answer(0, frames(LIAR, 0), b""),
        Answer(0, b"", word(LIAR, 0, CONFIG.cells)),
        Answer(0, frames(LIAR, 0), word(LIAR, 1, CONFIG.cells)),
        Answer(0, frames(LIAR, 1), word(LIAR, 0, CONFIG.cells)),
        Answer(0, frames(LIAR + 1, 0), word(LIAR, 0, CONFIG.cells)),
        Answer(0, frames(LIAR, 0), word(STATION, 0, CONFIG.cells)),
        Answer(1, frames(LIAR, 1), word(LIAR, 1, CONFIG.cells)),
    ],
)
def test_a_node_that_gives_no_whole_answer_has_no_part_in_the_tick(said: Answer) -> None:
    lied, silent = Ticks(), Ticks()
    for ticks in lied, silent:
        ticks.begin(0, {node: token(node) for node in NODES})
        if ticks is lied:
            ticks.answer(LIAR, said, token(LIAR))
        honest_tick(ticks, 0, HONEST)
        assert not any(moves.complete == 0 for moves in ticks.moves), "nobody but the world leaves it out"
        ticks.depart(0, LIAR)
        assert ticks.moves[-1].complete == 0
        assert ticks.counted == HONEST
        ticks.begin(1, {node: token(node) for node in HONEST})
        honest_tick(ticks, 1, HONEST)
        assert ticks.moves[-1].complete == 1
    assert lied.core.final() == silent.core.final()


def test_an_answer_before_its_tick_is_a_stray_and_the_tick_waits_for_another() -> None:
    ticks = Ticks()
    tokens = {node: token(node) for node in NODES}
    ticks.begin(0, tokens)
    honest_tick(ticks, 0, list(NODES))
    honest_tick(ticks, 1, [LIAR])
    assert ticks.moves[-1].strays == [(LIAR, token(LIAR))]
    ticks.begin(1, tokens)
    honest_tick(ticks, 1, HONEST)
    assert [moves.complete for moves in ticks.moves if moves.complete != NO_TICK] == [0]
    honest_tick(ticks, 1, [LIAR])
    assert ticks.moves[-1].complete == 1


@pytest.mark.parametrize("given", [0, 77])
def test_only_the_process_that_has_the_turn_answers(given: int) -> None:
    """Token 0 is that of a node whose process was gone when the tick began."""
    ticks = Ticks()
    tokens = {node: token(node) for node in NODES} | {LIAR: 0}
    ticks.begin(0, tokens)
    honest_tick(ticks, 0, HONEST)
    ticks.answer(LIAR, Answer(0, frames(LIAR, 0), word(LIAR, 0, CONFIG.cells)), given)
    assert ticks.moves[-1].strays == [(LIAR, given)]
    assert ticks.moves[-1].complete == NO_TICK
    ticks.depart(0, LIAR)
    assert ticks.moves[-1].complete == 0
    assert ticks.counted == HONEST
