"""ROS maps for the tests to read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from world.grid import FREE, OCCUPIED, GridGeometry
from world.grid.map_file import save_map

YAML = (
    "image: map.png\nresolution: 0.1\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
METRES = "0.1\n"
ORIGIN = "[-1.0, 2.0, 0.0]"


def write(folder: Path, yaml: str | bytes = YAML, pixels: Any = ((254,),), **how: Any) -> Path:
    """A map of these pixels, an image or an array of bytes."""
    image = pixels if isinstance(pixels, Image.Image) else Image.fromarray(np.array(pixels, np.uint8))
    image.save(folder / "map.png", **how)
    path = folder / "map.yaml"
    path.write_bytes(yaml if isinstance(yaml, bytes) else yaml.encode())
    return path


def room_map(folder: Path) -> Path:
    """A ROS map of one closed room of 10 x 8 m with a wall in it."""
    cells = np.full((20, 24), OCCUPIED, np.int8)
    cells[2:18, 2:22] = FREE
    cells[2:10, 5] = OCCUPIED
    path = folder / "room.yaml"
    save_map(path, GridGeometry(20, 24, 0.5, -5.0, -4.0), cells)
    return path


def one_line(message: str) -> None:
    assert message.startswith("map.yaml: ")
    assert message.isprintable()
    assert len(message) < 250
