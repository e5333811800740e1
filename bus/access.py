"""Who may log in, and who may put or receive on which key: users, passwords, and the router's access rules.

The rules deny by default. They follow from the list in `bus.keys`, so a key without a row there reaches nobody. They
guard against mistakes and against strangers on the network, not against hostile processes of the same user of the
operating system, which could read this memory anyway.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from bus.keys import ANY, ROWS, Keys
from bus.nodes import node_of_user, user_name

__all__ = ["LEASE_MS", "Login", "credentials", "dictionary", "router_config", "rules", "users_of"]

LEASE_MS: Final = 24 * 3600 * 1000
"""A side of a link that is frozen for longer is taken for gone. Zenoh's 10 s would cost a paused robot its seat, and a
paused medium the run. A process that dies drops its links at once, whatever the lease."""

MOST_BYTES: Final = 65_536
"""The router takes no longer message, which only a stranger sends: ours travel in parts (`bus.mailbox`)."""


MOST_BEATS_PER_S: Final = 10.0
"""The router drops what one login beats beyond that; an honest process beats four times a second. Beats are what a node
may send past the medium. A flood of them would fill the link to the world, and Zenoh's router comes to a stop for ever
if somebody logs in while it waits for room to tell the world of a token."""


@dataclass(frozen=True)
class Login:
    """What one process needs to take part in a run."""

    run: str
    endpoint: str
    """Zenoh endpoint of the router, such as tcp/127.0.0.1:7447 or a local one (`bus.session.local_endpoint`)."""
    user: str
    """world, medium, station, operator, robot-1, robot-2, ..."""
    password: str = field(repr=False)


def credentials(run: str, endpoint: str, robots: int) -> dict[str, Login]:
    """Logins with new random passwords for every process of a run."""
    names = ["world", "medium", "operator", *(user_name(node) for node in range(robots + 1))]
    return {name: Login(run, endpoint, name, secrets.token_hex(16)) for name in names}


def users_of(logins: Mapping[str, Login]) -> dict[str, str]:
    """Passwords by user, for the host of the router."""
    return {name: login.password for name, login in logins.items()}


def dictionary(users: Mapping[str, str]) -> str:
    """Text of Zenoh's user-password dictionary file."""
    return "".join(f"{name}:{password}\n" for name, password in sorted(users.items()))


def rules(run: str, users: Iterable[str]) -> dict[str, Any]:
    """Zenoh's `access_control` section for a run.

    A put or a token passes the router twice: in from the sender (ingress), out to the receiver (egress). A declared
    publisher sends nothing before the router has told it of a subscriber. A liveliness subscriber sees nothing without
    the router's answer. So both need the declarations of the other side on egress.
    """
    keys = Keys(run)
    permits: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for user in sorted(users):
        mine = list(_permits(keys, user))
        permits += mine
        subjects.append({"id": user, "usernames": [user]})
        policies.append({"id": user, "rules": [rule["id"] for rule in mine], "subjects": [user]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": permits,
        "subjects": subjects,
        "policies": policies,
    }


_SENDS = {
    "put": (("ingress", "put"), ("egress", "declare_subscriber")),
    "query": (("ingress", "query"), ("egress", "reply"), ("egress", "declare_queryable")),
    "token": (("ingress", "liveliness_token"),),
}
_RECEIVES = {
    "put": (("ingress", "declare_subscriber"), ("egress", "put")),
    "query": (("ingress", "declare_queryable"), ("ingress", "reply"), ("egress", "query")),
    "token": (
        ("ingress", "declare_liveliness_subscriber"),
        ("ingress", "liveliness_query"),
        ("egress", "liveliness_token"),
    ),
}


def _permits(keys: Keys, user: str) -> Iterable[dict[str, Any]]:
    node = node_of_user(user)
    role = "robot" if node else user
    parties = {role, "node"} if node is not None else {role}
    allowed: dict[tuple[str, str], list[str]] = {}
    for name, row in ROWS.items():
        if parties & set(row.senders):
            # World and medium send to every node. Their own tokens carry node 0.
            own: object = node if node is not None else 0 if row.kind == "token" else ANY
            _add(allowed, _SENDS[row.kind], keys.key(name, node=own, process=user), keys.key(name))
        if parties & set(row.receivers):
            own = node if "node" in row.receivers and row.kind == "put" else ANY
            _add(allowed, _RECEIVES[row.kind], keys.key(name, node=own), keys.key(name))
    for (flow, message), key_exprs in allowed.items():
        yield {
            "id": f"{user} {flow} {message}",
            "permission": "allow",
            "flows": [flow],
            "messages": [message],
            "key_exprs": sorted(set(key_exprs)),
        }


def _add(allowed: dict[tuple[str, str], list[str]], grants: Iterable[tuple[str, str]], own: str, wide: str) -> None:
    """Grant a key to one user: `own` has its node and process filled in, `wide` wildcards instead."""
    for flow, message in grants:
        allowed.setdefault((flow, message), []).append(own)
        if flow == "egress" and message.startswith("declare_"):
            # A declaration leaves the router as it was made: with the other side's key, wildcards included.
            allowed[flow, message].append(wide)


def router_config(run: str, endpoint: str, users: Iterable[str], dictionary_file: Path) -> str:
    """Configuration of an external `zenohd` for a run: the text of its JSON5 file.

    The dictionary file holds `dictionary(users)` and must be readable by nobody else.
    """
    return json.dumps(host_config(run, endpoint, users, dictionary_file), indent=1)


def host_config(run: str, endpoint: str, users: Iterable[str], dictionary_file: Path) -> dict[str, Any]:
    """Zenoh configuration of a router that serves exactly one run."""
    return {
        "mode": "router",
        "listen": {"endpoints": [endpoint], "exit_on_failure": True, "timeout_ms": 0},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": False},
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": {"lowlatency": True, "qos": {"enabled": False}},
            # Room for what a fleet of hundreds sends its watchers at once; one batch is 64 kB.
            "link": {
                "tx": {"queue": {"size": {"data": 16}}, "lease": LEASE_MS},
                "rx": {"max_message_size": MOST_BYTES},
            },
            "auth": {"usrpwd": {"dictionary_file": str(dictionary_file)}},
        },
        "access_control": rules(run, users),
        "downsampling": [
            {
                "id": "beats",
                "flows": ["ingress"],
                "messages": ["put"],
                "rules": [{"key_expr": Keys(run).beat(ANY), "freq": MOST_BEATS_PER_S}],
            }
        ],
    }
