# cython: language_level=3
"""Loops over the cells of a robot's own map: what a scan shows, cells from elsewhere, and lines.

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). Cells from a peer are checked here (`apply`), segments by the caller (`OwnMap.obstacles`).
"""

from libc.math cimport atan2, ceil, floor, hypot, rint
from libc.stdint cimport int8_t, int64_t, uint32_t

import numpy as np


def seen_free(
    const signed char[::1] cells,
    Py_ssize_t rows,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_m,
    double y_m,
    Py_ssize_t index,
    const int64_t[::1] d_row,
    const int64_t[::1] d_col,
    const double[::1] ranges_m,
    double beams_per_radian,
):
    """Unknown cells (int64) that a scan from the cell `index` shows to be free; (d_row, d_col) are those in range.

    A cell is free if its center is nearer than the range of the beam that points at it (Thrun, Burgard & Fox,
    Probabilistic Robotics, table 9.2).
    """
    cdef Py_ssize_t n = d_row.shape[0], k, row, col, found = 0, beams = ranges_m.shape[0]
    cdef Py_ssize_t at_row = index // cols, at_col = index % cols
    cdef int64_t beam
    cdef double dx, dy
    out = np.empty(n, np.int64)
    cdef int64_t[::1] seen = out
    with nogil:
        for k in range(n):
            row = at_row + d_row[k]
            col = at_col + d_col[k]
            if row < 0 or row >= rows or col < 0 or col >= cols or cells[row * cols + col] != -1:
                continue
            dx = x0_m + (<double>col + 0.5) * resolution_m - x_m
            dy = y0_m + (<double>row + 0.5) * resolution_m - y_m
            beam = <int64_t>rint(atan2(dy, dx) * beams_per_radian)
            beam %= beams
            if beam < 0:
                beam += beams
            if hypot(dx, dy) < ranges_m[beam]:
                seen[found] = row * cols + col
                found += 1
    return out[:found]

def hit(
    const signed char[::1] cells,
    Py_ssize_t rows,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_m,
    double y_m,
    const double[::1] ranges_m,
    const double[::1] cosines,
    const double[::1] sines,
    double range_m,
    double into_wall_m,
):
    """Cells (int64), in the order of the beams, that a scan shows to be walls and that are not known as such."""
    cdef Py_ssize_t n = ranges_m.shape[0], k, found = 0
    cdef double row, col, reach
    out = np.empty(n, np.int64)
    cdef int64_t[::1] met = out
    for k in range(n):
        if ranges_m[k] < range_m:
            reach = ranges_m[k] + into_wall_m
            col = floor((x_m + reach * cosines[k] - x0_m) / resolution_m)
            row = floor((y_m + reach * sines[k] - y0_m) / resolution_m)
            if 0 <= row < rows and 0 <= col < cols and cells[<Py_ssize_t>row * cols + <Py_ssize_t>col] != 1:
                met[found] = <int64_t>row * cols + <int64_t>col
                found += 1
    return out[:found]

def apply(signed char[::1] cells, const uint32_t[::1] theirs, const int8_t[::1] values):
    """Take over the larger of both values; returns the changed cells (int64), a cell that occurs twice perhaps twice.

    Raises:
        IndexError: a cell lies outside the grid; nothing is changed.
    """
    cdef Py_ssize_t n = theirs.shape[0], k, found = 0
    out = np.empty(n, np.int64)
    cdef int64_t[::1] changed = out
    for k in range(n):
        if theirs[k] >= cells.shape[0]:
            raise IndexError("a cell lies outside the grid")
        if values[k] > cells[theirs[k]]:
            changed[found] = k
            found += 1
    # Only now, since every value is compared with what was there before.
    for k in range(found):
        cells[theirs[changed[k]]] = values[changed[k]]
        changed[k] = theirs[changed[k]]
    return out[:found]

def carry_out(signed char[::1] cells, const uint32_t[::1] changed, const int8_t[::1] values):
    """Carry out changes in their order. Each must raise a cell of the grid: else False, and nothing is changed."""
    cdef Py_ssize_t n = changed.shape[0], k, done = 0
    out = np.empty(n, np.int8)
    cdef int8_t[::1] before = out
    while done < n and changed[done] < cells.shape[0] and values[done] > cells[changed[done]]:
        before[done] = cells[changed[done]]
        cells[changed[done]] = values[done]
        done += 1
    if done < n:
        for k in range(done - 1, -1, -1):
            cells[changed[k]] = before[k]
    return done == n

def is_frontier(const signed char[::1] cells, Py_ssize_t cols, Py_ssize_t index):
    """Whether a cell is known free and one of its four neighbors unknown; what is outside counts as known."""
    cdef Py_ssize_t col = index % cols
    return cells[index] == 0 and (
        (col > 0 and cells[index - 1] == -1)
        or (col < cols - 1 and cells[index + 1] == -1)
        or (index >= cols and cells[index - cols] == -1)
        or (index + cols < cells.shape[0] and cells[index + cols] == -1)
    )

def obstacles(const signed char[::1] cells, Py_ssize_t cols, double u0, double v0, double du, double dv):
    """Contiguous runs of cells that are not free on a segment inside the grid, in units of cells."""
    cdef double u1 = u0 + du, v1 = v0 + dv
    cdef double u_low = floor(min(u0, u1)) + 1.0, v_low = floor(min(v0, v1)) + 1.0
    cdef Py_ssize_t u_lines = max(0, <Py_ssize_t>(ceil(max(u0, u1)) - u_low))
    cdef Py_ssize_t v_lines = max(0, <Py_ssize_t>(ceil(max(v0, v1)) - v_low))
    cdef Py_ssize_t i = 0, j = 0, k, runs = 0
    cdef double before = 0.0, t, t_u, t_v, middle
    cdef bint solid, in_run = False
    # Crossings of either axis come in order; merging them sorts all.
    for k in range(u_lines + v_lines + 1):
        t_u = 2.0
        t_v = 2.0
        if i < u_lines:
            t_u = ((u_low + <double>(i if du > 0 else u_lines - 1 - i)) - u0) / du
        if j < v_lines:
            t_v = ((v_low + <double>(j if dv > 0 else v_lines - 1 - j)) - v0) / dv
        if i < u_lines and t_u <= t_v:
            t = t_u
            i += 1
        elif j < v_lines:
            t = t_v
            j += 1
        else:
            t = 1.0
        middle = 0.5 * (t + before)
        solid = cells[<Py_ssize_t>(v0 + middle * dv) * cols + <Py_ssize_t>(u0 + middle * du)] != 0
        runs += solid and not in_run
        in_run = solid
        before = t
    return runs

def newly_free(const int64_t[::1] changed, const signed char[::1] cells, unsigned char[::1] known):
    """The changed cells (int64) that are free and not marked in `known`; marks them."""
    cdef Py_ssize_t n = changed.shape[0], k, found = 0
    out = np.empty(n, np.int64)
    cdef int64_t[::1] new = out
    for k in range(n):
        if cells[changed[k]] == 0 and not known[changed[k]]:
            known[changed[k]] = 1
            new[found] = changed[k]
            found += 1
    return out[:found]


include "../bus/built.pxi"
