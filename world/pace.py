"""Pace of a run: how fast simulated time runs against the wall clock, and the commands that change it."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from typing import Any, Final

from bus.excerpt import shown
from bus.numerals import decimal
from world.terms import TICK_S

__all__ = ["COMMANDS", "Pace"]

COMMANDS: Final = "hold, step [N], go, speed F|max, fault VERB:TARGET@T[+D], interrupt or status"


class Pace:
    """Says when the next tick may begin. Commands come from another thread."""

    def __init__(self, speed: float, now_s: Callable[[], float], *, held: bool = False) -> None:
        """Pace of a run.

        Args:
            speed: simulated seconds per wall second; 0 = as fast as possible.
            now_s: the wall clock.
            held: begin held.
        """
        self._lock = threading.Lock()
        self._now_s = now_s
        self._speed = speed
        self._steps: int | None = 0 if held else None
        """Ticks that a held run may still take; None = not held."""
        self._base: tuple[int, float] | None = None
        """(tick, wall time) from which the schedule counts; set anew after every change."""
        self.interrupted = False

    def delay_s(self, tick: int) -> float:
        """Wall time until `tick` may begin; infinite while held."""
        with self._lock:
            if self.interrupted:
                return 0.0
            if self._steps is not None:
                return 0.0 if self._steps > 0 else math.inf
            if self._speed == 0.0:
                return 0.0
            now = self._now_s()
            if self._base is None:
                self._base = (tick, now)
            base_tick, base_s = self._base
            return max(0.0, base_s + (tick - base_tick) * TICK_S / self._speed - now)

    def began(self) -> None:
        """A tick has begun."""
        with self._lock:
            if self._steps:
                self._steps -= 1

    def interrupt(self) -> None:
        """End the run at the next tick's end."""
        self.interrupted = True

    def command(self, line: str, status: Callable[[], dict[str, Any]]) -> str:
        """Obey one of COMMANDS except `fault` (world/control.py); returns JSON."""
        words = line.split()
        try:
            self._obey(words)
        except ValueError as error:
            return json.dumps({"error": str(error)})
        with self._lock:
            mine = {"held": self._steps is not None, "speed": self._speed or "max", "interrupted": self.interrupted}
        return json.dumps(status() | mine)

    def _obey(self, words: list[str]) -> None:
        with self._lock:
            match words:
                case ["status"]:
                    pass
                case ["hold"]:
                    self._steps = 0
                case ["step"]:
                    self._steps = 1
                case ["step", count] if count.isascii() and count.isdecimal() and len(count) < 10 and int(count) > 0:
                    self._steps = int(count)
                case ["go"]:
                    self._steps = self._base = None
                case ["speed", value]:
                    self._speed = _speed(value)
                    self._steps = self._base = None
                case ["interrupt"]:
                    self.interrupted = True
                case _:
                    raise ValueError(f"unknown command '{shown(' '.join(words))}', expected {COMMANDS}")


def _speed(text: str) -> float:
    if text == "max":
        return 0.0
    try:
        speed = decimal(text)
    except ValueError:
        speed = math.nan
    if not (math.isfinite(speed) and speed > 0):
        raise ValueError(f"speed '{shown(text)}' is neither max nor a number above 0")
    return speed
