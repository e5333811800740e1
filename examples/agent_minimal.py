#!/usr/bin/env python3
"""A robot that needs nothing of the emulator: `python examples/agent_minimal.py runs/NAME/robot-4.json`.

It imports zenoh, msgpack and the standard library only, and follows docs/wire.md. It is a DSDV node: it routes, carries
the scan reports of others, passes acknowledgements on, and walks after its next hop to the monitor station (NMS) when
that link grows weak. It does not explore, so it calls itself a relay. It answers at once, so it sends no beats.
"""

from __future__ import annotations

import json
import math
import os
import queue
import struct
import sys
from pathlib import Path

import msgpack
import zenoh

WIRE_VERSION = 1
DATA, STOP, REFUSED = 0, 2, 3
UPDATE, SCAN_REPORT = 1, 2
STATION, NOBODY, BROADCAST = 0, -1, -1
NO_SCAN = 2**32 - 1
RELAY, INNER, LOST, WAIT = 1, 1, 3, 4
ROW, INHERENT = struct.Struct("<HQ18s"), struct.Struct("<H4i")
MOTION = struct.Struct("<IddB3hBB2d4I")


# What comes in


def open_turn(turn):
    """(sense behind its header, inbox) of a turn."""
    (length,) = struct.unpack_from("<I", turn)
    return turn[4 : 4 + length], turn[4 + length :]


def open_header(message):
    """(kind, incarnation, what follows)."""
    return *struct.unpack_from("<BI", message), message[5:]


def read_sense(sense):
    """A map of what this robot needs of its sense."""
    tick, first, incarnation, beams, x, y = struct.unpack_from("<I?HIdd", sense)
    return {"tick": tick, "first": first, "incarnation": incarnation, "beams": beams, "x_m": x, "y_m": y}


def read_inbox(inbox):
    """(bytes that the radio takes, [(source, power, payload)])."""
    _, room, _ = struct.unpack_from("<III", inbox)
    heard, at = [], 12
    while at < len(inbox):
        src, power_dbm, length = struct.unpack_from("<HdI", inbox, at)
        at += 14 + length
        heard.append((src, power_dbm, inbox[at - length : at]))
    return room, heard


# What goes out


def row(dst, freshness, inherent):
    """A row of an update."""
    return ROW.pack(dst, freshness, inherent)


def inherent_of(x, y, target_x, target_y):
    """What a relay says of itself."""
    return INHERENT.pack(RELAY, *(round(v * 100_000) for v in (x, y, target_x, target_y)))


def update_of(nms, rows, acks, acks_version, ahead):
    """An update of a robot that holds no map (version 0) and holds nobody back."""
    return msgpack.packb([UPDATE, nms, NOBODY, 0, rows, acks, acks_version, *([ahead] if ahead else [])])


def answer_of(incarnation, tick, node, frames, motion):
    """The answer to a turn, behind its header."""
    said = msgpack.packb([tick, node, frames])
    return struct.pack("<BI", DATA, incarnation) + struct.pack("<II", tick, len(said)) + said + motion


def motion_of(tick, velocity, nms, hops, mode, at):
    """A motion of a robot that makes no reports."""
    return MOTION.pack(tick, *velocity, RELAY, nms, NOBODY, NOBODY, hops, mode, *at, 0, 0, 0, 0)


# The robot


class Relay:
    """A DSDV node that keeps its link to its NMS. Freshness: sequence number x 256 + 255 - hop count."""

    def __init__(self, config, incarnation, tick):
        """`config`: that of the credentials file; `incarnation` and `tick`: of the first turn."""
        routing, moving = config["rules"]["routing"], config["rules"]["moving"]
        self.node, self.robots, self.config = config["node"], config["robots"], config
        self.timeout, self.silence = routing["neighbor_timeout_ticks"], routing["silence_ticks"]
        self.weak_m = routing["r_in_share"] * config["radius_m"]
        self.speed_m_s = moving["trace_speed_m_s"]
        self.quiet_until = tick + self.timeout + 1 if incarnation else tick
        self.rows = {}  # by destination: [freshness, next hop, inherent]
        self.neighbors = {}  # by id: what its last update said, when it came, and from how far
        self.to_station = inherent_of(*config["station_m"], *config["station_m"])

    def step(self, tick, at, room, heard):
        """One tick: what was heard, then (frames, velocity, NMS, hop count, mode)."""
        if tick < self.quiet_until:
            return [], (0.0, 0.0), NOBODY, 255, WAIT
        before = {dst: known[1] for dst, known in self.rows.items()}
        reports = []
        for src, power_dbm, payload in heard:
            try:
                said = msgpack.unpackb(payload)
                if said[0] == UPDATE:
                    self.absorb(tick, src, power_dbm, said, before)
                elif said[0] == SCAN_REPORT and said[1]:
                    reports.append(msgpack.packb([SCAN_REPORT, said[1] - 1, said[2]]))
            except (ValueError, TypeError, IndexError, struct.error, msgpack.UnpackException):
                continue  # a bad frame is dropped whole
        self.expire(tick)
        nms, hops = self.route(tick)
        velocity, mode, target = self.walk(tick, at, nms)
        self.rows[self.node] = [2 * tick * 256 + 255, self.node, inherent_of(*at, *target)]
        via = self.neighbors.get(nms, {"acks": b"", "acks_version": 0, "ahead": b""})
        rows = b"".join(row(dst, known[0], known[2]) for dst, known in self.rows.items())
        frames = [[BROADCAST, update_of(nms, rows, via["acks"], via["acks_version"], via["ahead"])]]
        frames += [[nms, report] for report in reports if nms != NOBODY]
        fitting = []
        for frame in frames:
            if len(frame[1]) <= room:
                fitting.append(frame)
                room -= len(frame[1])
        return fitting, velocity, nms, hops, mode

    def absorb(self, tick, src, power_dbm, said, before):
        """Take over what is fresher in the update of a neighbor; the row of the MS waits for `route`."""
        _, nms, _, _, rows, acks, acks_version, *ahead = said
        told = list(ROW.iter_unpack(rows))
        for dst, freshness, _ in told:
            hops = 255 - (freshness & 255)
            possible = (freshness >> 9) + (hops if hops < 255 else 0) < tick and dst <= self.robots
            if not possible or (hops == 0) != (dst == src) or (freshness >> 8) % 2 != (hops == 255):
                raise ValueError("a row that can't be")
        if src not in {dst for dst, _, _ in told}:
            raise ValueError("no row of the sender's own")
        to_station = -1
        for dst, freshness, inherent in told:
            finite = freshness & 255 > 0
            if dst == STATION:
                to_station = freshness
            elif dst != self.node:
                present, offered = self.rows.get(dst, [-1])[0], freshness - finite
                if offered > present or (offered == present and finite and before.get(dst) == src):
                    self.rows[dst] = [offered, src if offered & 255 else NOBODY, inherent]
        decades = (self.config["tx_power_dbm"] - self.config["loss_1m_db"] - power_dbm) / (10 * self.config["exponent"])
        old = self.neighbors.get(src, {"acks": b"", "acks_version": 0, "ahead": b""})
        if acks:
            old = {"acks": acks, "acks_version": acks_version, "ahead": ahead[0] if ahead else b""}
        known = {"tick": tick, "nms": nms, "to_station": to_station, "m": 10 ** min(decades, 30)}
        self.neighbors[src] = old | known

    def expire(self, tick):
        """Forget who was silent for too long, and break every route through it: an odd number, no hops."""
        for gone in [n for n, said in self.neighbors.items() if said["tick"] <= tick - self.timeout]:
            del self.neighbors[gone]
            for known in self.rows.values():
                if known[1] == gone:
                    known[:2] = [((known[0] >> 8) + 1) << 8, NOBODY]

    def route(self, tick):
        """Follow the NMS, or adopt one if there is no route; returns (NMS, hop count)."""
        freshness, nms, _ = self.rows.get(STATION, (-1, NOBODY, b""))
        if nms != NOBODY:
            offer = self.neighbors[nms]["to_station"]
            if offer >> 8 > freshness >> 8:
                freshness, nms = (offer - 1, nms) if offer & 255 > 1 else ((offer >> 8 | 1) << 8, NOBODY)
        if nms == NOBODY:
            offers = [
                (said["m"] > self.weak_m, -(said["to_station"] & 255), said["m"], n)
                for n, said in sorted(self.neighbors.items())
                if said["to_station"] & 255 > 1 and said["to_station"] >> 8 > freshness >> 8
                and said["nms"] != self.node and tick - said["tick"] < self.silence
            ]  # fmt: skip
            if offers:
                nms = min(offers)[-1]
                freshness = self.neighbors[nms]["to_station"] - 1
        if freshness >= 0:
            self.rows[STATION] = [freshness, nms, self.to_station]
        return nms, 255 - (freshness & 255) if nms != NOBODY else 255

    def walk(self, tick, at, nms):
        """(velocity, mode, target): stand while the link is good, else go to where the NMS says that it is."""
        if nms == NOBODY:
            return (0.0, 0.0), LOST, at
        said = self.neighbors[nms]
        if said["m"] <= self.weak_m and tick - said["tick"] < self.silence:
            return (0.0, 0.0), WAIT, at
        _, x, y, _, _ = INHERENT.unpack(self.rows[nms][2] if nms != STATION else self.to_station)
        x, y = x / 100_000, y / 100_000
        away = math.hypot(x - at[0], y - at[1])
        if away < 0.1:
            return (0.0, 0.0), WAIT, at
        return ((x - at[0]) / away * self.speed_m_s, (y - at[1]) / away * self.speed_m_s), INNER, (x, y)


# The connection


def connect(login):
    """A Zenoh session of this robot's own; it keeps its link for a day, so that it may be stopped for a while."""
    return zenoh.open(zenoh.Config.from_json5(json.dumps({
        "mode": "client",
        "connect": {"endpoints": [login["endpoint"]], "exit_on_failure": True, "timeout_ms": 20_000},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "unicast": {"lowlatency": True, "qos": {"enabled": False}},
            "link": {"tx": {"lease": 24 * 3600 * 1000}},
            "auth": {"usrpwd": {"user": login["user"], "password": login["password"]}},
        },
    })))  # fmt: skip


def joined(parts, key, attachment, data):
    """The whole message if this was its last part, or its only one; else None."""
    if attachment is None:
        return data
    message, part, of = struct.unpack("<III", attachment)
    so_far = parts.setdefault((key, message), [])
    if len(so_far) != part:  # one was dropped
        del parts[key, message]
        return None
    so_far.append(data)
    return b"".join(parts.pop((key, message))) if part + 1 == of else None


def take_turn(turn, incarnation, config, robot):
    """(robot, answer) after one turn; the robot is made at its first one."""
    sense, inbox = open_turn(turn)
    kind, to, sense = open_header(sense)
    if kind != DATA or to != incarnation:
        return robot, None  # a turn of another process
    sensed = read_sense(sense)
    tick, at = sensed["tick"], (sensed["x_m"], sensed["y_m"])
    robot = robot or Relay(config, sensed["incarnation"], tick)
    room, heard = read_inbox(inbox) if inbox and not sensed["first"] else (2**32 - 1, [])
    frames, velocity, nms, hops, mode = robot.step(tick, at, room, heard)
    return robot, answer_of(incarnation, tick, robot.node, frames, motion_of(tick, velocity, nms, hops, mode, at))


def main():
    """Take part in a run until it ends: status 0; 3 if world or medium are lost, 4 if this robot is refused."""
    handed = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    login, config = handed["login"], handed["config"]
    node, base = config["node"], f"vds/{login['run']}"
    incarnation = int.from_bytes(os.urandom(4), "big")
    came = queue.SimpleQueue()
    session = connect(login)

    def put(sample):
        attachment = sample.attachment.to_bytes() if sample.attachment else None
        gone = sample.kind == zenoh.SampleKind.DELETE
        came.put((str(sample.key_expr), None if gone else sample.payload.to_bytes(), attachment))

    word, turns = f"{base}/@sim/word/{node}", f"{base}/@sim/rx/{node}/{incarnation:08x}"
    kept = [session.declare_subscriber(key, put) for key in (word, turns)]
    kept += [
        session.liveliness().declare_subscriber(f"{base}/alive/{role}/*/*/*", put, history=True)
        for role in ("world", "medium")
    ]
    answers = session.declare_publisher(
        f"{base}/@sim/tx/{node}", congestion_control=zenoh.CongestionControl.BLOCK, express=True
    )
    # The token comes last: who sees it relies on the subscriptions.
    kept.append(session.liveliness().declare_token(f"{base}/alive/robot/{node}/{WIRE_VERSION}/{incarnation:08x}"))
    robot, parts, lost = None, {}, False
    try:
        while True:
            try:
                key, data, attachment = came.get(timeout=2.0 if lost else None)
            except queue.Empty:
                print("world or medium are gone", file=sys.stderr)
                return 3
            if data is None:
                lost = True  # the last word may come a little later
            elif key.startswith(f"{base}/alive/"):
                version = key.split("/")[-2]
                if version != str(WIRE_VERSION):
                    print(f"the run speaks version {version} of the wire, not {WIRE_VERSION}", file=sys.stderr)
                    return 4
            elif (whole := joined(parts, key, attachment, data)) is not None and key == turns:
                robot, answer = take_turn(whole, incarnation, config, robot)
                if answer is not None:
                    answers.put(answer)
            elif whole is not None:
                kind, to, message = open_header(whole)
                if kind == STOP:
                    return 0
                if kind == REFUSED and to == incarnation:
                    print(f"refused: {msgpack.unpackb(message)[0]}", file=sys.stderr)
                    return 4
    finally:
        session.close()


if __name__ == "__main__":
    sys.exit(main())
