"""What counts as a node's answer: all of it is possible, or none of it counts."""

from __future__ import annotations

from bus.codec import WireError
from bus.envelopes import Answer
from medium.config import MediumConfig
from medium.messages import Transmission
from world.limits import decode_word

__all__ = ["transmission_of"]


def transmission_of(node: int, answer: Answer, config: MediumConfig) -> Transmission:
    """The frames of an answer that counts.

    The motion is looked at, too, by the world's own rule, though nothing is done with it here. If frames went on the
    air whose motion the world then refuses, the digest would have a node that took no part in the tick.

    Raises:
        WireError: frames or motion are malformed, or of another node or tick.
    """
    decode_word(node, answer.tick, answer.motion, robots=config.robots, cells=config.cells)
    said = Transmission.decode(answer.transmission)
    if said.src != node or said.tick != answer.tick:
        raise WireError(f"frames of node {said.src} in tick {said.tick}, where node {node} is in {answer.tick}")
    return said
