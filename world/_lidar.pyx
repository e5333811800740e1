# cython: language_level=3
"""The loop of the exact lidar: `world.lidar` says what a ray is.

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). Cells beyond the padded floor plan are clamped to it.
"""

from libc.math cimport floor
from libc.stdint cimport int64_t

import numpy as np


def cast(
    const unsigned char[::1] free_cells,
    Py_ssize_t cols,
    double u,
    double v,
    double far,
    const unsigned char[::1] forward,
    const double[::1] per_line,
    const double[::1] drift,
    const int64_t[::1] counts,
    const unsigned char[::1] never,
    double resolution_m,
    double range_m,
):
    """Metres (beams,) to the first wall of each beam from the place (u, v), in cells; `far` is the range in cells."""
    cdef Py_ssize_t rays = forward.shape[0], beams = rays // 2, cells = free_cells.shape[0]
    cdef Py_ssize_t ray, line, cell
    cdef double col = floor(u), row = floor(v), to_first, beside, distance, nearest
    cdef Py_ssize_t col_cell = <Py_ssize_t>col, row_cell = <Py_ssize_t>row
    out = np.empty(beams)
    cdef double[::1] result = out
    with nogil:
        for ray in range(rays):
            to_first = u - col if ray < beams else v - row
            if forward[ray]:
                to_first = 1.0 - to_first
            beside = to_first * drift[ray] + (v if ray < beams else u)
            to_first *= per_line[ray]
            nearest = far
            for line in range(counts[ray]):
                cell = <Py_ssize_t>(beside + <double>line * drift[ray])
                if ray < beams:
                    cell = cell * cols + (line + 1 if forward[ray] else -line - 1) + col_cell
                else:
                    cell += ((line + 1 if forward[ray] else -line - 1) + row_cell) * cols
                cell = min(max(cell, 0), cells - 1)
                if not free_cells[cell]:
                    # Later crossings of the same beam are farther.
                    if not never[ray]:
                        distance = to_first + <double>line * per_line[ray]
                        nearest = min(nearest, distance)
                    break
            if ray < beams:
                result[ray] = nearest
            else:
                result[ray - beams] = min(min(result[ray - beams], nearest) * resolution_m, range_m)
    return out


include "../bus/built.pxi"
