"""The recording in a real viewer, headless: pictures at three moments, judged by their pixels.

The pictures are kept in the folder that VDS_ARTIFACTS names, else in pytest's own.
"""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from rerun.experimental import ViewerClient

from monitor_station.recording import palette
from tests.helpers.synthetic import Mission, Moment, record
from tests.helpers.waiting import wait_until

pytestmark = pytest.mark.processes

KILL_TICK = 450
MOMENTS = (250, 440, 700)
UNKNOWN = (112, 137, 134)
"""RViz's color of unknown cells."""

Pixels = NDArray[np.int16]


def _has_software_gpu() -> bool:
    return any(Path("/usr/share/vulkan/icd.d").glob("*.json"))


@pytest.fixture
def viewer() -> Iterator[ViewerClient]:
    if not _has_software_gpu():
        pytest.skip("no Vulkan driver: install mesa-vulkan-drivers and libvulkan1")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # Beside this Python, whether or not its environment is on the PATH.
    viewer_path = str(Path(sys.executable).with_name("rerun"))
    with ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True, executable_path=viewer_path) as client:
        yield client


def near(pixels: Pixels, color: tuple[int, int, int], tolerance: int = 14) -> NDArray[np.bool_]:
    """(h, w) pixels that have a color."""
    return np.asarray((np.abs(pixels - np.array(color)) <= tolerance).all(axis=-1))


class Picture:
    """A screenshot, and where on it the map lies."""

    def __init__(self, path: Path, mission: Mission) -> None:
        with Image.open(path) as image:
            whole = np.asarray(image.convert("RGB"), np.int16)
        self.map = whole[:, : int(whole.shape[1] * 0.4)]
        unknown = near(self.map, UNKNOWN, 3)
        rows, cols = np.flatnonzero(unknown.sum(axis=1) > 20), np.flatnonzero(unknown.sum(axis=0) > 20)
        self.found = len(rows) > 100 and len(cols) > 100
        if self.found:
            self._top, self._left = rows[0], cols[0]
            geometry = mission.config.geometry
            self.px_per_m = (cols[-1] + 1 - cols[0]) / (geometry.cols * geometry.resolution_m)
            self._height_m = geometry.rows * geometry.resolution_m

    def around(self, x_m: float, y_m: float, radius_px: int) -> Pixels:
        """The square around a place."""
        col = int(self._left + x_m * self.px_per_m)
        row = int(self._top + (self._height_m - y_m) * self.px_per_m)
        return self.map[row - radius_px : row + radius_px + 1, col - radius_px : col + radius_px + 1]

    def chain_pixels(self) -> int:
        return int(near(self.map, palette.CHAIN).sum())


def take(
    viewer: ViewerClient, mission: Mission, path: Path, tick: int, seen: Callable[[Picture], int], wanted: int
) -> Picture:
    """A picture of a tick, once its chunks are loaded: the viewer does not tell, so look until enough is `seen`."""
    viewer.set_time("sim_time", duration=tick / 10, play_state="paused")
    taken: list[Picture] = []

    def complete() -> bool:
        viewer.save_screenshot(str(path))
        taken.append(Picture(path, mission))
        return taken[-1].found and seen(taken[-1]) >= wanted

    wait_until(complete, f"{wanted} of what is looked for in {path}")
    return taken[-1]


def shown_class(picture: Picture, x_m: float, y_m: float) -> dict[str, int]:
    """Pixels of each color in the middle of a robot's dot."""
    spot = picture.around(x_m, y_m, 5)
    colors = {"search": palette.ORANGE, "relay": palette.SKY, "no contact": palette.NO_CONTACT}
    return {name: int(near(spot, color).sum()) for name, color in colors.items()}


def in_the_clear(mission: Mission, moment: Moment) -> list[tuple[float, float]]:
    """Places of the robots that do not stand behind the label of a search cell."""
    labels = [((x0 + x1) / 2, y1) for x0, _, x1, y1 in mission.config.cell_rectangles_m]
    return [
        (x, y)
        for x, y in moment.view.xy_m.tolist()
        if all(abs(x - label_x) > 3.2 or abs(y - label_y) > 2.0 for label_x, label_y in labels)
    ]


def robots_seen(picture: Picture, places: list[tuple[float, float]]) -> int:
    return sum(max(shown_class(picture, x, y).values()) >= 8 for x, y in places)


def test_viewer_shows_map_robots_chain_and_the_kill(viewer: ViewerClient, tmp_path: Path) -> None:
    folder = Path(os.environ.get("VDS_ARTIFACTS", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    mission = Mission(9, seed=9, kill_tick=KILL_TICK)
    _, moments = record(mission, tmp_path / "run.rrd", MOMENTS[-1] + 50)
    viewer.open(str(tmp_path / "run.rrd"))
    pictures = []
    for tick in MOMENTS:
        places = in_the_clear(mission, moments[tick])
        assert len(places) >= 8
        path = folder / f"recording_{tick / 10:.0f}s.png"
        picture = take(viewer, mission, path, tick, partial(robots_seen, places=places), len(places))
        assert robots_seen(picture, places) == len(places), f"robots are missing at tick {tick}"
        pictures.append(picture)
    for picture in pictures:
        assert near(picture.map, (255, 255, 255), 6).sum() > 3_000, "no explored map"
        assert near(picture.map, (0, 0, 0), 6).sum() > 500, "no walls"
    free = [int(near(picture.map, (255, 255, 255), 6).sum()) for picture in pictures]
    assert free[0] < free[1] < free[2], "the map does not grow"
    assert pictures[0].chain_pixels() > 100, "no chain"

    x, y = moments[KILL_TICK].snapshot.xy_m[mission.killed - 1].tolist()
    before = shown_class(pictures[1], *moments[MOMENTS[1]].snapshot.xy_m[mission.killed - 1].tolist())
    after = shown_class(pictures[2], x, y)
    assert max(before, key=before.__getitem__) != "no contact"
    assert max(after, key=after.__getitem__) == "no contact", "the killed robot kept its color"
    rim = int(near(pictures[2].around(x, y, 14), palette.VERMILION).sum())
    assert rim > 40, "the killed robot has no red rim"
