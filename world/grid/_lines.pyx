# cython: language_level=3
"""Walls on segments: the loop of `world.grid.lines`.

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). Cells beyond the grid are clamped to it.
"""

from libc.math cimport fabs, floor
from libc.stdint cimport int64_t

import numpy as np


cpdef Py_ssize_t crossed_by(
    const unsigned char[::1] walls,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_a,
    double y_a,
    double x_b,
    double y_b,
) noexcept nogil:
    """Contiguous runs of wall cells on one segment, in metres: the same when its ends are swapped."""
    cdef Py_ssize_t last = walls.shape[0] - 1, cell, along_stride, across_stride, base, crossed = 0
    cdef double along, length, slope, enter, leave
    cdef bint steep, wall, in_wall = False, leaving
    x_a, y_a = (x_a - x0_m) / resolution_m, (y_a - y0_m) / resolution_m
    x_b, y_b = (x_b - x0_m) / resolution_m, (y_b - y0_m) / resolution_m
    steep = fabs(y_b - y_a) > fabs(x_b - x_a)
    if steep:
        x_a, y_a, x_b, y_b = y_a, x_a, y_b, x_b
    if x_a > x_b:
        x_a, y_a, x_b, y_b = x_b, y_b, x_a, y_a
    along_stride = cols if steep else 1
    across_stride = 1 if steep else cols
    length = x_b - x_a
    slope = (y_b - y_a) / length if length > 0 else 0.0
    along = floor(x_a)
    enter = y_a
    while along <= floor(x_b):
        leave = y_a + slope * (min(along + 1.0, x_b) - x_a)
        base = <Py_ssize_t>along * along_stride
        for leaving in range(2):
            cell = base + <Py_ssize_t>floor(leave if leaving else enter) * across_stride
            wall = walls[min(max(cell, 0), last)]
            crossed += wall and not in_wall
            in_wall = wall
        enter = leave
        along += 1.0
    return crossed


def walls_crossed(
    const unsigned char[::1] walls,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    const double[:, :] a_xy,
    const double[:, :] b_xy,
):
    """Contiguous runs of wall cells (n,) on each segment."""
    cdef Py_ssize_t n = a_xy.shape[0], k
    out = np.empty(n, np.int64)
    cdef int64_t[::1] crossed = out
    with nogil:
        for k in range(n):
            crossed[k] = crossed_by(
                walls, cols, resolution_m, x0_m, y0_m, a_xy[k, 0], a_xy[k, 1], b_xy[k, 0], b_xy[k, 1]
            )
    return out


include "../../bus/built.pxi"
