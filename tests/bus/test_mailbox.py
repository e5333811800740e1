"""Messages of any length come out whole, or not at all."""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.mailbox import MOST_WAITING, PART_BYTES, Mailbox, in_parts

MARK = struct.Struct("<III")
"""Message, part, parts."""


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


def test_parts_that_no_process_of_ours_sends_are_not_kept() -> None:
    """One who raises the number of parts with each part, and one whose parts are longer than a link takes."""
    mailbox = Mailbox()
    for part in range(9):
        mailbox.put(Sample("k", Bytes(b"x"), Bytes(MARK.pack(7, part, 5000 + part))))  # type: ignore[arg-type]
    mailbox.put(Sample("k", Bytes(bytes(PART_BYTES + 1)), Bytes(MARK.pack(8, 0, 2))))  # type: ignore[arg-type]
    assert emptied(mailbox) == []
    assert not any(mailbox._begun.values())


def test_a_key_of_which_too_much_waits_is_muted_until_it_is_pardoned() -> None:
    mailbox = Mailbox()
    flood, honest = Sample("tx/4", Bytes(b"flood"), None), Sample("tx/3", Bytes(b"honest"), None)
    for _ in range(2 * MOST_WAITING):
        mailbox.put_bounded(flood)
    mailbox.put_bounded(honest)
    assert mailbox.excess == {"tx/4": MOST_WAITING}
    assert emptied(mailbox) == [("tx/4", b"flood")] * MOST_WAITING + [("tx/3", b"honest")]
    mailbox.put_bounded(flood)
    assert emptied(mailbox) == [], "nothing waits any more, but it is muted"
    assert (mailbox.floods(), mailbox.floods()) == (["tx/4"], [])
    assert mailbox.pardon("tx/4") == MOST_WAITING + 1
    mailbox.put_bounded(flood)
    assert emptied(mailbox) == [("tx/4", b"flood")]
    mailbox.mute("tx/3")
    mailbox.put_bounded(honest)
    assert (emptied(mailbox), mailbox.excess) == ([], {"tx/3": 1})
    mailbox.mute("tx/4")
    assert mailbox.floods() == ["tx/3", "tx/4"], "a pardoned one is told again"


def test_an_honest_sender_may_put_any_number_if_they_are_taken_out() -> None:
    mailbox = Mailbox()
    for _ in range(2 * MOST_WAITING):
        mailbox.put_bounded(Sample("tx/4", Bytes(b"answer"), None))
        assert mailbox.get(0.0) == ("tx/4", b"answer")
    assert mailbox.excess == {}


def test_what_comes_in_meanwhile_is_left_for_later() -> None:
    mailbox = Mailbox()
    mailbox.put(("key", b"first"))
    seen = []
    for message in mailbox.waiting():
        seen.append(message)
        mailbox.put(("key", b"another"))
    assert seen == [("key", b"first")]
    assert emptied(mailbox) == [("key", b"another")]


def test_a_message_that_is_too_long_for_the_bus_is_refused_before_it_is_sent() -> None:
    class Long(bytes):
        def __len__(self) -> int:
            return MOST_WAITING * PART_BYTES + 1

    with pytest.raises(ValueError, match=r"131072001 bytes, where 131072000 are the most"):
        in_parts(lambda *_: pytest.fail("a part was sent"))(Long())
