"""Floor plans: free rectangles carved out of wall, or ROS `map_server` maps (YAML + PGM/PNG), read and written.

The map format is that of ROS `map_server` / `nav2_map_server`: the image's top row is the highest y; a pixel's
occupancy is (255 - value) / 255, or value / 255 with `negate`; above `occupied_thresh` it is occupied, below
`free_thresh` free, between them unknown.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from world.grid import FREE, OCCUPIED, UNKNOWN, GridGeometry

__all__ = ["digest_of_map", "from_rectangles", "load_map", "reachable", "save_map"]

Rectangle = tuple[float, float, float, float]

MAX_CELLS: Final = 25_000_000
_OCCUPIED_THRESH: Final = 0.65
_FREE_THRESH: Final = 0.196
_PIXEL: Final = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}


def from_rectangles(
    size_m: tuple[float, float], free: Sequence[Rectangle], walls: Sequence[Rectangle], resolution_m: float
) -> tuple[NDArray[np.bool_], GridGeometry]:
    """Carve `free` out of solid wall, then put `walls` back; a cell belongs to a rectangle that holds its center.

    Returns:
        (rows, cols) True = wall, and its geometry with the origin at (0, 0).

    Raises:
        ValueError: a rectangle is empty or outside, or the grid is too large.
    """
    cols, rows = (math.ceil(round(length / resolution_m, 6)) for length in size_m)
    _check_size(rows, cols)
    geometry = GridGeometry(rows, cols, resolution_m)
    occupied = np.ones(geometry.size, np.bool_)
    for name, rectangles, wall in (("free", free, False), ("walls", walls, True)):
        for i, (x0, y0, x1, y1) in enumerate(rectangles, 1):
            place = f"{name}[{i}] = {x0:g}, {y0:g}, {x1:g}, {y1:g}"
            if x0 >= x1 or y0 >= y1:
                raise ValueError(f"{place}: a rectangle is x0, y0, x1, y1 with x0 < x1 and y0 < y1")
            if x0 < 0 or y0 < 0 or x1 > size_m[0] or y1 > size_m[1]:
                raise ValueError(f"{place}: outside size_m = {size_m[0]:g}, {size_m[1]:g}")
            occupied[geometry.rectangle(x0, y0, x1, y1)] = wall
    return occupied.reshape(rows, cols), geometry


def reachable(occupied: NDArray[np.bool_], index: int) -> NDArray[np.bool_]:
    """(rows, cols) True = free and connected to the cell `index` over cell sides; all False if that is a wall."""
    free = ~occupied
    rows, cols = _runs(free), _runs(free.T).T
    reached: NDArray[np.bool_] = np.zeros_like(free)
    reached.flat[index] = free.flat[index]
    # Whoever is reached, its whole row and column are, up to the walls; as often as there are turns on the longest way.
    before, count = 0, int(reached.sum())
    while count > before:
        for runs in (rows, cols):
            met = np.zeros(int(runs.max()) + 1, np.bool_)
            met[runs[reached]] = True
            reached = met[runs]
        before, count = count, int(reached.sum())
    return reached


def _runs(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Numbers of the runs of free cells along each row, from 1; 0 for a wall."""
    first = free.copy()
    first[:, 1:] &= ~free[:, :-1]
    return np.where(free, np.cumsum(first).reshape(free.shape), 0)


def load_map(path: Path) -> tuple[NDArray[np.bool_], GridGeometry]:
    """Read a ROS map; unknown counts as wall.

    Returns:
        (rows, cols) True = wall, row 0 at the lowest y, and its geometry.

    Raises:
        ValueError: the YAML or the image is missing or not what it should be.
    """
    fields = _read_yaml(path)
    resolution = _number(path, fields, "resolution", None)
    if resolution <= 0:
        raise ValueError(f"{path}: resolution = {resolution:g} is not above 0")
    x0, y0 = _origin(path, fields)
    occupied_thresh = _number(path, fields, "occupied_thresh", _OCCUPIED_THRESH)
    free_thresh = _number(path, fields, "free_thresh", _FREE_THRESH)
    if not 0 <= free_thresh < occupied_thresh <= 1:
        raise ValueError(f"{path}: needs 0 <= free_thresh < occupied_thresh <= 1")
    negate = fields.get("negate", 0)
    if negate not in (0, 1):
        raise ValueError(f"{path}: negate = {negate!r} is neither 0 nor 1")
    pixels = _read_image(_image_path(path, fields))
    rows, cols = pixels.shape
    _check_size(rows, cols)
    occupancy = pixels / 255.0 if negate else (255.0 - pixels) / 255.0
    return ~(occupancy < free_thresh)[::-1], GridGeometry(rows, cols, resolution, x0, y0)


def save_map(path: Path, geometry: GridGeometry, cells: NDArray[np.int8]) -> None:
    """Write `path` (YAML) and, beside it, the image of the same name with the suffix .pgm.

    Args:
        path: of the YAML file.
        geometry: of the grid.
        cells: (rows, cols) or flat, of FREE, OCCUPIED and UNKNOWN.
    """
    grid = np.asarray(cells).reshape(geometry.rows, geometry.cols)
    pixels = np.full(grid.shape, _PIXEL[UNKNOWN], np.uint8)
    pixels[grid == FREE] = _PIXEL[FREE]
    pixels[grid == OCCUPIED] = _PIXEL[OCCUPIED]
    image = path.with_suffix(".pgm")
    Image.fromarray(pixels[::-1]).save(image)
    fields = {
        "image": image.name,
        "resolution": geometry.resolution_m,
        "origin": [geometry.x0_m, geometry.y0_m, 0.0],
        "negate": 0,
        "occupied_thresh": _OCCUPIED_THRESH,
        "free_thresh": _FREE_THRESH,
    }
    path.write_text(yaml.safe_dump(fields, sort_keys=False))


def digest_of_map(path: Path) -> str:
    """SHA-256 over a map's YAML file and its image.

    Raises:
        ValueError: one of them cannot be read.
    """
    image = _image_path(path, _read_yaml(path))
    try:
        return hashlib.sha256(path.read_bytes() + image.read_bytes()).hexdigest()
    except OSError as error:
        raise ValueError(f"{image}: {error.strerror}") from None


def _check_size(rows: int, cols: int) -> None:
    if rows * cols > MAX_CELLS or not rows or not cols:
        raise ValueError(f"a grid of {rows} x {cols} cells; between 1 and {MAX_CELLS} are possible")


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        fields = yaml.safe_load(path.read_text())
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise ValueError(f"{path}: not a YAML file") from None
    if not isinstance(fields, dict) or not isinstance(fields.get("image"), str):
        raise ValueError(f"{path}: not a ROS map: it names no image")
    return fields


def _image_path(path: Path, fields: dict[str, Any]) -> Path:
    image: str = fields["image"]
    return path.parent / image


def _number(path: Path, fields: dict[str, Any], key: str, default: float | None) -> float:
    value = fields.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{path}: {key} = {value!r} is not a finite number")
    return float(value)


def _origin(path: Path, fields: dict[str, Any]) -> tuple[float, float]:
    origin = fields.get("origin", [0.0, 0.0, 0.0])
    numbers = isinstance(origin, list) and 2 <= len(origin) <= 3 and all(type(v) in (int, float) for v in origin)
    if not numbers or not all(map(math.isfinite, origin)):
        raise ValueError(f"{path}: origin = {origin!r} is not [x, y, yaw]")
    if len(origin) == 3 and origin[2]:
        raise ValueError(f"{path}: origin has a yaw of {origin[2]:g}; only maps without rotation can be used")
    return float(origin[0]), float(origin[1])


def _read_image(path: Path) -> NDArray[np.float64]:
    """(rows, cols) mean of the color channels, 0..255, as map_server takes it; transparent counts as unknown."""
    try:
        with Image.open(path) as image:
            alpha = "A" in image.getbands() or "transparency" in image.info
            if alpha:
                channels = np.asarray(image.convert("RGBA"), np.float64)
                seen = channels[..., 3] > 0
                gray: NDArray[np.float64] = np.where(seen, channels[..., :3].mean(axis=2), _PIXEL[UNKNOWN])
            elif image.mode in ("L", "1", "P", "RGB"):
                gray = np.asarray(image.convert("RGB"), np.float64).mean(axis=2)
            else:
                gray = np.asarray(image, np.float64) / 257.0  # sixteen bits a pixel
    except FileNotFoundError:
        raise ValueError(f"{path}: no such image") from None
    except (OSError, Image.DecompressionBombError, SyntaxError, ValueError):
        raise ValueError(f"{path}: not an image that can be read") from None
    if gray.ndim != 2:
        raise ValueError(f"{path}: not a gray or color image")
    return gray
