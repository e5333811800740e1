"""Maps of ROS `map_server`, a YAML file and an image beside it: read by the rules of nav2's map server, and written."""

from __future__ import annotations

import contextlib
import hashlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from bus.excerpt import shown
from bus.user_file import read_bytes
from world.grid.geometry import FREE, MAX_CELLS, OCCUPIED, UNKNOWN, GridGeometry
from world.grid.map_header import FREE_THRESH, OCCUPIED_THRESH, MapHeader, read_header
from world.own_file import write_whole

__all__ = ["digest_of_map", "load_map", "read_map", "save_map"]

_MOST_BYTES: Final = 2**28
"""Of an image: the largest grid, with four channels of sixteen bits, has fewer."""
_FORMATS: Final = ("PNG", "PPM", "BMP", "JPEG", "TIFF", "GIF")
"""As Pillow calls them; PPM holds PGM and PBM."""
_PIXEL: Final = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}


def load_map(path: Path) -> tuple[NDArray[np.bool_], GridGeometry]:
    """Read a ROS map; unknown counts as wall.

    Returns:
        (rows, cols) True = wall, row 0 at the lowest y, and its geometry.

    Raises:
        ValueError: the YAML or the image is missing or not what it should be.
    """
    cells, geometry = read_map(path)
    return cells != FREE, geometry


def read_map(path: Path, image: str | None = None) -> tuple[NDArray[np.int8], GridGeometry]:
    """Read a ROS map.

    Args:
        path: of the YAML file.
        image: path of the image, relative to the YAML file's folder; None: what the YAML file says.

    Returns:
        (rows, cols) of FREE, OCCUPIED and UNKNOWN, row 0 at the lowest y, and its geometry.

    Raises:
        ValueError: the YAML or the image is missing or not what it should be.
    """
    header = read_header(path)
    image_path = path.parent / (header.image if image is None else image)
    data = _image_bytes(header, image_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of what it puts right, and of sizes that are in our bounds
        with _decoding(header, image_path):
            picture = Image.open(io.BytesIO(data), formats=_FORMATS)
        with picture:
            geometry = header.geometry(picture.height, picture.width)
            with _decoding(header, image_path):
                levels, opaque = _levels(picture)
    cells = header.values()[levels]
    if opaque is not None and header.mode != "raw":
        cells[~opaque] = UNKNOWN
    return cells[::-1], geometry


def _levels(picture: Image.Image) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """(rows, cols) gray levels, and which pixels are opaque; None where all are.

    Raises:
        Exception: of any kind, whatever a decoder stumbles upon.
    """
    transparent = picture.info.get("transparency")
    if picture.mode.startswith("I"):
        if picture.mode == "I" and picture.format == "TIFF":
            raise ValueError("32 bits a pixel")
        deep = np.asarray(picture)  # sixteen bits
        return (deep // 257).astype(np.uint8), None if transparent is None else deep != transparent
    if picture.mode == "F":
        raise ValueError("floating-point pixels")
    alpha = picture.convert("RGBA").getchannel("A") if picture.has_transparency_data else None
    levels = np.asarray(picture.convert("L"))
    return levels, None if alpha is None else np.asarray(alpha) == 255


def save_map(path: Path, geometry: GridGeometry, cells: NDArray[np.int8]) -> None:
    """Write `path` (YAML) and, beside it, the image of the same name with the suffix .pgm.

    Args:
        path: of the YAML file.
        geometry: of the grid.
        cells: (rows, cols) or flat, of FREE, OCCUPIED and UNKNOWN.

    Raises:
        OSError: one of them can't be written.
    """
    grid = np.asarray(cells).reshape(geometry.rows, geometry.cols)
    pixels = np.full(grid.shape, _PIXEL[UNKNOWN], np.uint8)
    pixels[grid == FREE] = _PIXEL[FREE]
    pixels[grid == OCCUPIED] = _PIXEL[OCCUPIED]
    image, content = path.with_suffix(".pgm"), io.BytesIO()
    Image.fromarray(pixels[::-1]).save(content, "PPM")
    write_whole(image, content.getvalue())
    fields = {
        "image": image.name,
        "mode": "trinary",
        "resolution": geometry.resolution_m,
        "origin": [geometry.x0_m, geometry.y0_m, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
    }
    write_whole(path, yaml.safe_dump(fields, sort_keys=False))


def digest_of_map(path: Path) -> str:
    """SHA-256 over a map's YAML file and its image.

    Raises:
        ValueError: one of them cannot be read.
    """
    header = read_header(path)
    image = _image_bytes(header, path.parent / header.image)
    return hashlib.sha256(read_bytes(path, _MOST_BYTES) + image).hexdigest()


def _image_bytes(header: MapHeader, image_path: Path) -> bytes:
    try:
        return read_bytes(image_path, _MOST_BYTES)
    except ValueError as error:
        hint = "; a path has / between its folders" if "\\" in header.image else ""
        raise ValueError(f"{shown(header.path)}: image: {error}{hint}") from None


@contextlib.contextmanager
def _decoding(header: MapHeader, image_path: Path) -> Iterator[None]:
    """One line for whatever a decoder raises; bytes that are no image make Pillow raise almost anything."""
    try:
        yield
    except Image.DecompressionBombError:
        raise ValueError(f"{shown(header.path)}: image: {shown(image_path)}: more than {MAX_CELLS:,} pixels") from None
    except Exception:
        what = "not a complete PNG, PGM, BMP, JPEG, TIFF or GIF"
        raise ValueError(f"{shown(header.path)}: image: {shown(image_path)}: {what}") from None
