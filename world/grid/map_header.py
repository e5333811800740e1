"""The YAML file of a ROS map: what its image means, and where the map lies.

The rules are those of nav2's map server (nav2_map_server/src/map_io.cpp). Like it, this reads every scalar as text, so
that 5e-2 and "0.05" are numbers and "true" is a truth value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

from bus.excerpt import shown
from bus.user_file import read_text
from world.grid.geometry import FREE, OCCUPIED, UNKNOWN, GridGeometry, check_grid

__all__ = ["FREE_THRESH", "OCCUPIED_THRESH", "MapHeader", "read_header"]

OCCUPIED_THRESH: Final = 0.65
FREE_THRESH: Final = 0.196

_MOST_BYTES: Final = 2**16
_MODES: Final = ("trinary", "scale", "raw")
_NEGATE: Final = {
    **dict.fromkeys(("0", "n", "no", "false", "off"), False),
    **dict.fromkeys(("1", "y", "yes", "true", "on"), True),
}

_Fields: TypeAlias = dict[str, yaml.Node]


@dataclass(frozen=True)
class MapHeader:
    """A map's YAML file."""

    path: Path
    image: str
    """Path of the image, absolute or relative to the folder of the YAML file."""
    resolution_m: float
    origin: tuple[float, float, float]
    """x and y of the image's lower-left corner in metres, and yaw in radians."""
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float

    def values(self) -> NDArray[np.int8]:
        """(256,) FREE, OCCUPIED or UNKNOWN by the gray level of a pixel.

        In single precision, as nav2 compares. Free beats occupied, as there.
        """
        level = np.arange(256, dtype=np.float32)
        if self.mode == "raw":
            occupancy = level / np.float32(100.0)
        else:
            occupancy = level / np.float32(255.0)
            occupancy = occupancy if self.negate else np.float32(1.0) - occupancy
        values = np.full(256, UNKNOWN, np.int8)
        values[occupancy >= np.float32(self.occupied_thresh)] = OCCUPIED
        values[occupancy <= np.float32(self.free_thresh)] = FREE
        if self.mode == "raw":
            values[level > 100.0] = UNKNOWN
        return values

    def geometry(self, rows: int, cols: int) -> GridGeometry:
        """Where a map with an image of this size lies.

        Raises:
            ValueError: a run can't have such a grid, or it is turned by half a cell or more at its far end.
        """
        x0_m, y0_m, yaw = self.origin
        try:
            geometry = check_grid(rows, cols, self.resolution_m, x0_m, y0_m)
        except ValueError as error:
            raise ValueError(f"{shown(self.path)}: {error}") from None
        if abs(math.remainder(yaw, math.tau)) * max(rows, cols) >= 0.5:
            raise ValueError(
                f"{shown(self.path)}: origin has a yaw of {yaw:g}; only maps without rotation (yaw 0) can be used"
            )
        return geometry


def read_header(path: Path) -> MapHeader:
    """Read the YAML file of a map.

    Raises:
        ValueError: it is missing, or not what it should be; the message names the file and the key.
    """
    fields = _fields(path)
    try:
        header = MapHeader(
            path=path,
            image=_text(fields, "image"),
            resolution_m=_number(fields, "resolution"),
            origin=_origin(fields),
            mode=_text(fields, "mode", "trinary").lower(),
            negate=_negate(fields),
            occupied_thresh=_number(fields, "occupied_thresh", OCCUPIED_THRESH),
            free_thresh=_number(fields, "free_thresh", FREE_THRESH),
        )
        if header.resolution_m <= 0:
            raise ValueError(f"resolution = {header.resolution_m:g} is not above 0")
        if header.mode not in _MODES:
            raise ValueError(f"mode = {shown(header.mode)} is none of {', '.join(_MODES)}")
        if not 0 <= header.free_thresh <= header.occupied_thresh <= 1:
            raise ValueError(
                f"free_thresh = {header.free_thresh:g}, occupied_thresh = {header.occupied_thresh:g}: "
                "needs 0 <= free_thresh <= occupied_thresh <= 1"
            )
    except ValueError as error:
        raise ValueError(f"{shown(path)}: {error}") from None
    return header


def _fields(path: Path) -> _Fields:
    """The nodes of the file's first document by key. Nothing is constructed, so no tag in it has any effect."""
    # Tabs may stand between a key and its value in YAML, but PyYAML knows only blanks.
    text = read_text(path, _MOST_BYTES, errors="replace").replace("\t", " ")
    try:
        root = next(yaml.compose_all(text, yaml.SafeLoader), None)
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f" (line {error.problem_mark.line + 1})"
        raise ValueError(f"{shown(path)}: not a YAML file{line}") from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError):  # it nests too deeply, or has no such character
        raise ValueError(f"{shown(path)}: not a YAML file") from None
    fields: _Fields = {}
    for key, value in root.value if isinstance(root, yaml.MappingNode) else ():
        if not isinstance(key, yaml.ScalarNode):
            continue
        if key.value in fields:
            raise ValueError(f"{shown(path)}: {shown(key.value)} is given twice (line {key.start_mark.line + 1})")
        fields[key.value] = value
    if "image" not in fields:
        raise ValueError(f"{shown(path)}: not a ROS map: it names no image")
    return fields


def _text(fields: _Fields, key: str, default: str | None = None) -> str:
    node = fields.get(key)
    if node is None and default is not None:
        return default
    if node is None:
        raise ValueError(f"{key} is missing")
    return _scalar(node, key)


def _scalar(node: yaml.Node, key: str) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise ValueError(f"{key} is a {'list' if isinstance(node, yaml.SequenceNode) else 'mapping'}, not a value")
    text: str = node.value.strip()
    if not text:
        raise ValueError(f"{key} is empty")
    return text


def _number(fields: _Fields, key: str, default: float | None = None) -> float:
    return _float(_text(fields, key, None if default is None else str(default)), key)


def _float(text: str, key: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{key} = {shown(text)} is not a finite number")
    return value


def _origin(fields: _Fields) -> tuple[float, float, float]:
    node = fields.get("origin")
    if node is None:
        return 0.0, 0.0, 0.0
    if not isinstance(node, yaml.SequenceNode) or not 2 <= len(node.value) <= 3:
        raise ValueError("origin is not [x, y, yaw]")
    numbers = [_float(_scalar(item, "origin"), "origin") for item in node.value]
    return numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0


def _negate(fields: _Fields) -> bool:
    text = _text(fields, "negate", "0")
    if text.lower() not in _NEGATE:
        raise ValueError(f"negate = {shown(text)} is neither 0 nor 1")
    return _NEGATE[text.lower()]
