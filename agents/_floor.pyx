# cython: language_level=3
"""Loops over the floor as a map shows it: frontiers, cells that became known, and lines.

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). Segments are checked by the caller (`OwnMap.obstacles`).
"""

from libc.math cimport ceil, floor
from libc.stdint cimport int64_t

import numpy as np


cpdef bint is_frontier(const signed char[::1] cells, Py_ssize_t cols, Py_ssize_t index):
    """Whether a cell is known free and one of its four neighbors unknown; what is outside counts as known."""
    cdef Py_ssize_t col = index % cols
    return cells[index] == 0 and (
        (col > 0 and cells[index - 1] == -1)
        or (col < cols - 1 and cells[index + 1] == -1)
        or (index >= cols and cells[index - cols] == -1)
        or (index + cols < cells.shape[0] and cells[index + cols] == -1)
    )


def new_frontiers(
    const int64_t[::1] changed, const signed char[::1] cells, Py_ssize_t cols, unsigned char[::1] frontier
):
    """Mark in `frontier` what changes of the map made of cells; returns those (int64) that are frontiers now only."""
    cdef Py_ssize_t n = changed.shape[0], k, found = 0
    cdef int64_t cell
    cdef bint now
    out = np.empty(5 * n, np.int64)
    cdef int64_t[::1] new = out
    cdef int64_t[5] steps = [0, -1, 1, -cols, cols]
    cdef int64_t step
    for k in range(n):
        for step in steps:
            # At the border a step may lead to the next row, or outside: to look at one cell more does no harm.
            cell = changed[k] + step
            if 0 <= cell < cells.shape[0]:
                now = is_frontier(cells, cols, cell)
                if now and not frontier[cell]:
                    new[found] = cell
                    found += 1
                frontier[cell] = now
    return out[:found]


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
