"""Messages of any length come out whole, or not at all."""

from __future__ import annotations

import random
from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from bus.mailbox import PART_BYTES, Mailbox, in_parts


@dataclass(frozen=True)
class Bytes:
    data: bytes

    def to_bytes(self) -> bytes:
        return self.data


@dataclass(frozen=True)
class Sample:
    """Samples as Zenoh delivers them."""

    key_expr: str
    payload: Bytes
    attachment: Bytes | None


def samples_of(key: str, message: bytes) -> list[Sample]:
    made: list[Sample] = []

    def put(data: bytes, attachment: bytes | None = None) -> None:
        made.append(Sample(key, Bytes(data), None if attachment is None else Bytes(attachment)))

    in_parts(put)(message)
    return made


def emptied(mailbox: Mailbox) -> list[tuple[str, bytes | None]]:
    out = []
    while (message := mailbox.get(0.0)) is not None:
        out.append(message)
    return out


lengths = st.one_of(st.integers(0, 20), st.integers(-2, 2).map(lambda k: 2 * PART_BYTES + k), st.just(5 * PART_BYTES))


@given(
    st.lists(st.tuples(st.sampled_from("ab"), lengths), max_size=6), st.randoms(use_true_random=False), st.booleans()
)
def test_whole_messages_come_in_the_order_of_their_sender(
    sent: list[tuple[str, int]], chance: random.Random, lossy: bool
) -> None:
    """Senders interleave; of one, and on one key, parts come in order, and some of them may be lost."""
    queues: dict[str, list[tuple[Sample, int]]] = {"a": [], "b": []}
    hurt: set[int] = set()
    messages = []
    for k, (key, length) in enumerate(sent):
        messages.append((key, bytes([k]) * length))
        for sample in samples_of(*messages[-1]):
            if lossy and chance.random() < 0.2:
                hurt.add(k)
            else:
                queues[key].append((sample, k))
    mailbox = Mailbox()
    while any(queues.values()):
        key = chance.choice([key for key, queue in queues.items() if queue])
        mailbox.put(queues[key].pop(0)[0])  # type: ignore[arg-type]
    came = emptied(mailbox)
    for key in "ab":
        assert [m for m in came if m[0] == key] == [m for k, m in enumerate(messages) if m[0] == key and k not in hurt]


def test_a_part_is_no_longer_than_a_link_takes_and_small_messages_travel_as_they_are() -> None:
    assert all(len(s.payload.data) <= PART_BYTES for s in samples_of("k", bytes(1_000_000)))
    (sample,) = samples_of("k", b"small")
    assert sample == Sample("k", Bytes(b"small"), None)


def test_what_a_stranger_attaches_is_left_to_the_decoders() -> None:
    mailbox = Mailbox()
    mailbox.put(Sample("k", Bytes(b"x"), Bytes(b"?")))  # type: ignore[arg-type]
    assert emptied(mailbox) == [("k", b"x")]
