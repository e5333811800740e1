"""Propagation models: how loud a sender is at a receiver, and how loud is loud enough [paper 9.1 to 9.3].

Received power follows the log-distance path loss P_r = P_t - PL0 - 10 n log10(d / 1 m), after Rappaport, Wireless
Communications, and ITU-R P.1238. `disk` and `disk_los` cut it off at the transmission radius. A robot that
inverts the curve then knows the distance exactly [paper 5.3]. `log_distance` adds walls, shadowing and fading, and cuts
the power off at the sensitivity.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from medium.config import NEAREST_M, MediumConfig
from medium.fading import Fading
from medium.shadowing import MOST_SIGMAS, Shadowing
from world.grid.lines import walls_crossed


def distances_m(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, n) distances between all positions."""
    x, y = xy_m.T
    dx, dy = x[:, None] - x, y[:, None] - y
    # Never fused: `einsum` multiplies and adds in one step on some processors.
    distances: NDArray[np.float64] = np.sqrt(dx * dx + dy * dy)
    return distances


class Propagation:
    """Received power and audibility for all pairs of nodes."""

    def __init__(self, config: MediumConfig) -> None:
        self._config = config
        radio = config.radio
        self._at_1m_dbm = radio.tx_power_dbm - radio.loss_1m_db
        self._slope_db = 10.0 * radio.exponent
        self.sensitivity_dbm = self._at_1m_dbm - self._slope_db * math.log10(config.radius_m)
        """Mean power at the transmission radius."""
        self._shadowing = Shadowing(config.seed, radio.shadowing_db, radio.shadowing_correlation_m)
        self._fading = Fading(config.seed, config.robots, radio) if radio.fading != "none" else None

    def received(
        self, nodes: NDArray[np.int16], xy_m: NDArray[np.float64], tick: int
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Power in dBm and audibility, both (n, n) and symmetric, of each node (row) at each other (column).

        Args:
            nodes: (n,) ids, ascending.
            xy_m: (n, 2) their places.
            tick: of the frames; it must not fall from call to call.
        """
        distance_m = distances_m(xy_m)
        power = self._at_1m_dbm - self._slope_db * np.log10(np.maximum(distance_m, NEAREST_M))
        model = self._config.radio.model
        if model == "log_distance":
            if self._fading is not None:
                power += self._fading.power_db(tick)[np.ix_(nodes, nodes)]
            self._obstruct(power, nodes, xy_m)
            heard = power >= self.sensitivity_dbm
        else:
            heard = distance_m <= self._config.radius_m
            if model == "disk_los":
                rows, cols = np.nonzero(np.triu(heard, 1))
                blocked = self._walls(xy_m, rows, cols) > 0
                heard[rows[blocked], cols[blocked]] = heard[cols[blocked], rows[blocked]] = False
        heard.ravel()[:: len(nodes) + 1] = False  # the diagonal
        return power, heard

    def _walls(self, xy_m: NDArray[np.float64], rows: NDArray[np.int64], cols: NDArray[np.int64]) -> NDArray[np.int64]:
        return walls_crossed(self._config.occupied, self._config.geometry, xy_m[rows], xy_m[cols])

    def _obstruct(self, power: NDArray[np.float64], nodes: NDArray[np.int16], xy_m: NDArray[np.float64]) -> None:
        radio = self._config.radio
        # Shadowing is cut off, so no other pair can be heard. Walls are counted for these pairs only.
        hopeful = power + MOST_SIGMAS * radio.shadowing_db >= self.sensitivity_dbm
        rows, cols = np.nonzero(np.triu(hopeful, 1))
        change = -radio.wall_loss_db * self._walls(xy_m, rows, cols)
        if radio.shadowing_db > 0.0:
            links = list(zip(nodes[rows].tolist(), nodes[cols].tolist(), strict=True))
            change = change + self._shadowing.db(links, xy_m[rows], xy_m[cols])
        power[rows, cols] += change
        power[cols, rows] = power[rows, cols]
