from array import array
from collections.abc import Callable

def merge(
    rows: bytes,
    me: int,
    sender: int,
    known: list[int],
    freshest: array[int],
    next_hop: array[int],
    inherent: bytearray,
    before: array[int],
    sticky: int,
    robots: int,
    tick: int,
    make_room: Callable[[int], None],
) -> int | None: ...
def update_possible(fields: object, robots: int, changes: int, tick: int) -> bool: ...
def advertised(known: list[int], freshest: array[int], inherent: bytearray) -> bytes: ...
def announce(
    inherent: bytearray, dst: int, flags: int, x: float, y: float, target_x: float, target_y: float
) -> None: ...
def search_robots(next_hop: array[int], inherent: bytearray, me: int) -> list[int]: ...
