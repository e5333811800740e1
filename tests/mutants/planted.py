"""Mutants by hand (planted.toml): rules of the paper, their numbers, and the compiled loops."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Final

from tests.mutants.mutant import Mutant

_LIST: Final = Path(__file__).with_name("planted.toml")


class PlantedError(Exception):
    """The text of a mutant does not stand in its file exactly once."""


def planted(root: Path) -> list[Mutant]:
    """All of them.

    Raises:
        PlantedError: one does not fit its file any more.
    """
    mutants = []
    for entry in tomllib.loads(_LIST.read_text(encoding="utf-8"))["mutant"]:
        what, path, old = entry["what"], entry["path"], entry["old"]
        text = (root / path).read_text(encoding="utf-8")
        if text.count(old) != 1:
            raise PlantedError(f"{what}: {path} has {text.count(old)} times, not once: {old.strip()}")
        start = text.index(old)
        mutants.append(Mutant(path, start, start + len(old), entry["new"], what, (entry["tests"],)))
    return mutants
