"""Search times of an independent prototype, with which the results are compared.

The prototype was one process on the same arena. Its robots were points and shared one map at once. Each point is of ten
seeds, 4,000 s at most.
"""

from __future__ import annotations

from typing import Final

__all__ = ["PROTOTYPE_FIG6_S", "PROTOTYPE_FIG7_S"]

PROTOTYPE_FIG7_S: Final[dict[tuple[int, float], tuple[float, float] | None]] = {
    (robots, radius_m): value
    for radius_m, row in {
        6.0: (None, None, (954.0, 133.0)),
        7.0: (None, (1383.0, 330.0), (896.0, 112.0)),
        8.0: (None, (1109.0, 141.0), (878.0, 140.0)),
        9.0: (None, (950.0, 117.0), (840.0, 140.0)),
        10.0: ((1383.0, 296.0), (1003.0, 178.0), (731.0, 101.0)),
        12.0: ((1051.0, 141.0), (801.0, 75.0), (624.0, 167.0)),
        15.0: ((966.0, 144.0), (702.0, 116.0), (539.0, 158.0)),
        18.0: ((945.0, 100.0), (595.0, 140.0), (398.0, 108.0)),
        20.0: ((1050.0, 85.0), (589.0, 114.0), (393.0, 117.0)),
        25.0: ((700.0, 242.0), (342.0, 55.0), (284.0, 84.0)),
        30.0: ((310.0, 20.0), (277.0, 28.0), (251.0, 31.0)),
        35.0: ((235.0, 17.0), (226.0, 9.0), (219.0, 12.0)),
        50.0: ((232.0, 22.0), (223.0, 11.0), (216.0, 11.0)),
    }.items()
    for robots, value in zip((6, 9, 12), row, strict=True)
}
"""Search time of all cells by (N, r_t): mean and standard deviation; None: no run finished."""

PROTOTYPE_FIG6_S: Final[dict[int, tuple[float, float]]] = {12: (341.0, 721.0), 9: (456.0, 881.0)}
"""Search times of cells 1 and 2 by N. With N = 6 no run finishes a cell: 36 % and 11 % are reached at 2,000 s."""
