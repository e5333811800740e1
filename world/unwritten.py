"""What of a run's files could not be written: the run goes on, keeps the rest, and says so in the end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

__all__ = ["Unwritten"]


class Unwritten:
    """Names of files with the reason, each once."""

    def __init__(self) -> None:
        self._why: dict[str, str] = {}

    def note(self, name: str, error: OSError) -> None:
        """File `name` could not be written, or not all of it."""
        self._why.setdefault(name, error.strerror or str(error))

    @contextlib.contextmanager
    def noting(self, name: str) -> Iterator[None]:
        """Note that file `name` can't be written if what is inside raises `OSError`; go on behind it."""
        try:
            yield
        except OSError as error:
            self.note(name, error)

    @property
    def lines(self) -> tuple[str, ...]:
        """A line each."""
        return tuple(f"{name} could not be written: {why}" for name, why in self._why.items())
