"""Search rates of cells, whether they lie apart, overlap or nest; and the measures of the whole map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config import RobotConfig
from monitor_station.config import SearchCell, StationConfig
from monitor_station.search_rate import SearchRate
from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

SIZE = 20
members = st.sets(st.integers(0, SIZE - 1), min_size=1)
states = st.dictionaries(st.integers(0, SIZE - 1), st.sampled_from([UNKNOWN, FREE, OCCUPIED]))


def search_of(*cells: tuple[str, list[int]], size: int = SIZE, noise_m: float = 0.0) -> SearchRate:
    node = RobotConfig(
        0, 1, GridGeometry(1, size), (0.5, 0.5), (0.0, 0.0, 0.0, 0.0), 20.0, 8.0, 180, 0.0, 40.0, 3.0,
        pose_noise_m=noise_m,
    )  # fmt: skip
    walls = np.ones((1, size), bool)
    for _, members in cells:
        walls[0, members] = False
    return SearchRate(StationConfig(node, tuple(SearchCell(name, np.array(inside)) for name, inside in cells), walls))


def see(search: SearchRate, tick: int, seen: dict[int, int]) -> None:
    search.update(tick, np.array(list(seen), np.int64), np.array(list(seen.values()), np.int8))


@given(st.lists(members, min_size=1, max_size=6), st.lists(states, max_size=6))
def test_each_cell_counts_what_is_known_to_be_free_now(cells: list[set[int]], steps: list[dict[int, int]]) -> None:
    search = search_of(*((str(k), sorted(c)) for k, c in enumerate(cells)))
    now = dict.fromkeys(range(SIZE), UNKNOWN)
    times: list[float | None] = [None] * len(cells)
    for tick, changed in enumerate(steps):
        see(search, tick, changed)
        now |= changed
        free = {cell for cell, state in now.items() if state == FREE}
        times = [tick / 10 if time is None and c <= free else time for time, c in zip(times, cells, strict=True)]
        assert search.rates == tuple(len(c & free) / len(c) for c in cells)
        assert search.search_time_s == times
        assert search.searched == all(c <= free for c in cells)
        union = set().union(*cells)
        assert search.known_free == len(union & free) / len(union)


def test_a_cell_within_another_is_part_of_both() -> None:
    search = search_of(("floor", [*range(10)]), ("room", [4, 5]))
    see(search, 7, {4: FREE, 5: FREE})
    assert search.rates == (0.2, 1.0)
    see(search, 9, dict.fromkeys(range(10), FREE))
    assert search.rates == (1.0, 1.0)
    assert search.search_time_s == [0.9, 0.7]


def test_what_the_map_calls_wall_is_not_searched() -> None:
    search = search_of(("a", [1, 2, 3, 4]))
    see(search, 1, {1: FREE, 2: FREE, 3: FREE, 4: OCCUPIED})
    assert (search.rates, search.searched) == ((0.75,), False)
    see(search, 2, {4: FREE, 2: UNKNOWN})
    assert (search.rates, search.searched) == ((0.75,), False)


def test_the_search_time_is_when_all_of_the_area_is_scanned_and_not_a_cell_less() -> None:
    search = search_of(("a", [*range(1000)]), ("b", [*range(1000, 1010)]), size=1010)
    assert search.names == ["a", "b"]
    see(search, 10, dict.fromkeys(range(999), FREE))
    assert search.search_time_s == [None, None]
    see(search, 20, {999: FREE})
    assert search.search_time_s == [2.0, None]
    assert not search.searched
    see(search, 30, {999: UNKNOWN, **dict.fromkeys(range(1000, 1010), FREE)})
    assert search.search_time_s == [2.0, 3.0]
    assert not search.searched, "all of them at once"
    see(search, 40, {999: FREE})
    assert search.searched
    assert search.search_time_s == [2.0, 3.0], "the first time counts"


@pytest.mark.parametrize(("noise_m", "searched"), [(0.0, False), (0.05, True)])
def test_noisy_sensors_have_searched_when_the_search_is_finished(noise_m: float, searched: bool) -> None:
    search = search_of(("a", [*range(1000)]), size=1010, noise_m=noise_m)
    see(search, 10, dict.fromkeys(range(500), FREE))
    see(search, 20, dict.fromkeys(range(500, 994), FREE))
    assert not search.searched
    see(search, 30, {994: FREE, 995: OCCUPIED, 1005: FREE, 1006: OCCUPIED, 1007: OCCUPIED, 1008: OCCUPIED})
    assert search.searched == searched
    see(search, 40, {0: UNKNOWN})
    assert not search.searched, "it is not any more"
    map_now = np.full(1010, UNKNOWN, np.int8)
    map_now[1:995], map_now[995], map_now[1005], map_now[1006:1009] = FREE, OCCUPIED, FREE, OCCUPIED
    assert search.measures(map_now) == {
        "known_free": {"share": 0.994, "t50_s": 1.0, "t90_s": 2.0, "t100_s": 3.0},
        "map_errors": {"free_called_wall": 0.001, "wall_called_free": 0.25},
        "left": {"called_wall": 1, "unknown": 5},
    }
