"""The medium: delivers each frame to the live nodes within range of its sender, and keeps the trace digest."""

from __future__ import annotations

import dataclasses
import hashlib
import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from medium.airtime import Airtime
from medium.config import MediumConfig, Radio
from medium.fading import Bursts
from medium.messages import BROADCAST, Frame, Inbox, Reception, Transmission
from medium.propagation import Propagation
from world.messages import Positions
from world.seeds import Stream, sequence

_TICK: Final = struct.Struct("<IH")
_FRAME: Final = struct.Struct("<HiI")


class Medium:
    """Sans-IO core of the radio.

    It sees source, link-layer destination and size of a frame. The digest of a run is SHA-256 over true positions and
    transmissions, tick by tick, in the order of nodes. It covers only the nodes whose transmission counted in the tick.
    """

    def __init__(self, config: MediumConfig) -> None:
        self._config = config
        self._to_come = list(config.changes)
        self._airtime = Airtime(config.radio)
        self._tune(config.radio)
        self._random = sequence(config.seed, Stream.LOSS)
        self._trace = hashlib.sha256()
        self.sent = 0
        self.delivered = 0
        self.rejected = 0
        self.sent_bytes = 0

    def plan(self, changes: Sequence[tuple[int, Radio]], tick: int) -> None:
        """Replace the changes that are to come by those of `changes` from `tick` on, the next that this core steps."""
        self._to_come = [change for change in changes if change[0] >= tick]

    def _tune(self, radio: Radio) -> None:
        """Let the radio have these values from now on."""
        config = self._config
        self._radio = radio
        self._propagation = Propagation(dataclasses.replace(config, radio=radio))
        self._airtime.tune(radio)
        self._bursts = Bursts(config.seed, config.robots, radio) if radio.burst_share > 0.0 else None

    def step(self, positions: Positions, transmissions: Mapping[int, Transmission]) -> dict[int, Inbox]:
        """Carry the frames of tick k; returns the inboxes of tick k + 1, one for each node that transmitted.

        Args:
            positions: the roster of tick k and its true places.
            transmissions: by node; a node of the roster that has none departed during the tick.
        """
        while self._to_come and self._to_come[0][0] <= positions.tick:
            self._tune(self._to_come.pop(0)[1])
        ids = positions.nodes.tolist()
        self._record(positions, transmissions)
        power, heard = self._propagation.received(positions.nodes, positions.xy_m, positions.tick)
        self._jam(positions, heard)
        inboxes: dict[int, list[Reception]] = {node: [] for node in ids if node in transmissions}
        there = np.array([node in inboxes for node in ids], np.bool_)
        links = self._links(positions, power, heard & there[:, None] & there)
        for src, listeners in zip(ids, links, strict=True):
            if src in inboxes:
                for frame in self._sent(src, transmissions[src].frames):
                    self._deliver(src, frame, listeners, inboxes)
        self._airtime.refill(ids, heard)
        told, tick = self._airtime.told, positions.tick + 1
        return {node: Inbox(tick, tuple(heard_frames), *told(node)) for node, heard_frames in inboxes.items()}

    def _links(
        self, positions: Positions, power: NDArray[np.float64], heard: NDArray[np.bool_]
    ) -> list[list[tuple[int, float, float]]]:
        """By sender, in the order of the roster: (node, power there, chance that a frame is lost) of who hears it."""
        senders, receivers = np.nonzero(heard)
        nodes, radio = positions.nodes, self._radio
        kept = np.full(len(senders), (1.0 - radio.loss) * (1.0 - positions.loss))
        if self._bursts is not None:
            bad = self._bursts.bad(positions.tick)[nodes[senders], nodes[receivers]]
            kept[bad] *= 1.0 - radio.burst_loss
        listeners = nodes[receivers].tolist(), power[senders, receivers].tolist(), (1.0 - kept).tolist()
        links = list(zip(*listeners, strict=True))
        ends = np.cumsum(np.bincount(senders, minlength=len(nodes))).tolist()
        return [links[start:end] for start, end in zip([0, *ends], ends, strict=False)]

    def _deliver(
        self,
        src: int,
        frame: Frame,
        listeners: list[tuple[int, float, float]],
        inboxes: dict[int, list[Reception]],
    ) -> None:
        """Put a frame into the inboxes of those it is for.

        Args:
            src: who sent it.
            frame: as sent.
            listeners: (node, power there, chance that the frame is lost), ascending by node.
            inboxes: by node.
        """
        dst, payload = frame
        for node, level, loss in listeners:
            if dst in (BROADCAST, node) and (loss == 0.0 or self._random.random() >= loss):
                inboxes[node].append((src, level, payload))
                self.delivered += 1

    def _sent(self, src: int, frames: tuple[Frame, ...]) -> tuple[Frame, ...]:
        """The first frames, as many as the sender has airtime for; the rest is rejected."""
        for k, (_, payload) in enumerate(frames):
            if not self._airtime.spend(src, len(payload)):
                self.rejected += len(frames) - k
                frames = frames[:k]
                break
        self.sent += len(frames)
        for _, payload in frames:
            self.sent_bytes += len(payload)
        return frames

    def _record(self, positions: Positions, transmissions: Mapping[int, Transmission]) -> None:
        """Add the tick to the digest. A node that left during the tick counts as one that left before it."""
        nodes, xy_m = positions.nodes, positions.xy_m
        if len(transmissions) < len(nodes):
            counted = np.array([node in transmissions for node in nodes.tolist()], np.bool_)
            nodes, xy_m = nodes[counted], xy_m[counted]
        update = self._trace.update
        update(_TICK.pack(positions.tick, len(nodes)))
        update(nodes.tobytes())
        update(xy_m.tobytes())
        for node in nodes.tolist():
            transmission = transmissions[node]
            for dst, payload in transmission.frames:
                update(_FRAME.pack(transmission.src, dst, len(payload)))
                update(payload)

    @staticmethod
    def _jam(positions: Positions, heard: NDArray[np.bool_]) -> None:
        for jam in positions.jams:
            if jam.region_m is not None:
                x0, y0, x1, y1 = jam.region_m
                x, y = positions.xy_m.T
                heard[:, (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)] = False
            elif jam.pair is not None:
                a, b = (np.flatnonzero(positions.nodes == node) for node in jam.pair)
                heard[np.ix_(a, b)] = False
                heard[np.ix_(b, a)] = False

    def final(self) -> dict[str, Any]:
        """Counts at the end of the run, and the trace digest."""
        return {
            "trace_sha256": self._trace.hexdigest(),
            "frames": {
                "sent": self.sent,
                "delivered": self.delivered,
                "rejected": self.rejected,
                "bytes": self.sent_bytes,
            },
        }
