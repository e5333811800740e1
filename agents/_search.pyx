# cython: language_level=3
"""Shortest paths over the free cells of a map, by Dijkstra's algorithm with buckets (Dial 1969).

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). All indices are the caller's own cells.
"""

from libc.math cimport INFINITY, hypot, sqrt
from libc.stdint cimport int32_t, uint32_t
from libc.stdlib cimport free, realloc

import numpy as np


cdef struct Bucket:
    int32_t* cells
    Py_ssize_t count
    Py_ssize_t room


cdef int push(Bucket* bucket, int32_t cell) except -1 nogil:
    cdef int32_t* more
    if bucket.count == bucket.room:
        bucket.room = max(1024, 2 * bucket.room)
        more = <int32_t*>realloc(bucket.cells, bucket.room * sizeof(int32_t))
        if more == NULL:
            with gil:
                raise MemoryError
        bucket.cells = more
    bucket.cells[bucket.count] = cell
    bucket.count += 1
    return 0


cdef inline int shorten(
    double[::1] found, Py_ssize_t cell, double longer, Bucket* buckets, double per_metre
) except -1 nogil:
    """Take a way to a cell if it is the shortest so far, and queue the cell; returns 1 then, else 0."""
    if longer >= found[cell]:
        return 0
    found[cell] = longer
    push(&buckets[<size_t>(longer * per_metre) % 3], <int32_t>cell)
    return 1


cdef int spread(
    const signed char[::1] cells,
    Py_ssize_t cols,
    double resolution_m,
    double limit_m,
    Py_ssize_t until,
    Bucket* buckets,
    double[::1] found,
) except -1 nogil:
    """Search on from the cells in the first bucket.

    Buckets are narrower than the shortest step. So the cells of a bucket are final when its turn comes, in whatever
    order they are taken, and at most two buckets lie ahead.
    """
    cdef double per_metre = 1.0 / (0.9 * resolution_m), diagonal_m = resolution_m * sqrt(2.0), here, longer
    cdef Bucket* bucket
    cdef Py_ssize_t turn = 0, waiting = 1, size = cells.shape[0], k, cell, col
    cdef bint east, west, north, south
    while waiting:
        bucket = &buckets[<size_t>turn % 3]
        if until >= 0 and found[until] < INFINITY and <Py_ssize_t>(found[until] * per_metre) <= turn:
            break
        for k in range(bucket.count):
            cell = bucket.cells[k]
            here = found[cell]
            if <Py_ssize_t>(here * per_metre) != turn:
                continue  # a shorter way was found since, and was taken in an earlier bucket
            longer = here + resolution_m
            if longer > limit_m:
                continue
            col = <uint32_t>cell % <uint32_t>cols
            east = col + 1 < cols and cells[cell + 1] == 0
            west = col > 0 and cells[cell - 1] == 0
            north = cell + cols < size and cells[cell + cols] == 0
            south = cell >= cols and cells[cell - cols] == 0
            if east:
                waiting += shorten(found, cell + 1, longer, buckets, per_metre)
            if west:
                waiting += shorten(found, cell - 1, longer, buckets, per_metre)
            if north:
                waiting += shorten(found, cell + cols, longer, buckets, per_metre)
            if south:
                waiting += shorten(found, cell - cols, longer, buckets, per_metre)
            longer = here + diagonal_m
            if longer > limit_m:
                continue
            # Most diagonal neighbors have a shorter way already; that is the cheaper question, so it comes first.
            if east and north and longer < found[cell + cols + 1] and cells[cell + cols + 1] == 0:
                waiting += shorten(found, cell + cols + 1, longer, buckets, per_metre)
            if west and north and longer < found[cell + cols - 1] and cells[cell + cols - 1] == 0:
                waiting += shorten(found, cell + cols - 1, longer, buckets, per_metre)
            if east and south and longer < found[cell - cols + 1] and cells[cell - cols + 1] == 0:
                waiting += shorten(found, cell - cols + 1, longer, buckets, per_metre)
            if west and south and longer < found[cell - cols - 1] and cells[cell - cols - 1] == 0:
                waiting += shorten(found, cell - cols - 1, longer, buckets, per_metre)
        waiting -= bucket.count
        bucket.count = 0
        turn += 1
    return 0


def lengths(
    const signed char[::1] cells,
    Py_ssize_t cols,
    double resolution_m,
    Py_ssize_t source,
    double limit_m,
    Py_ssize_t until,
):
    """Path lengths (cells,) in metres over free cells (0) from the cell `source`; infinite where none leads.

    A step leads to one of eight neighbors; a diagonal one needs both cells that it passes between. No length exceeds
    `limit_m`. With a cell `until` >= 0 the search ends when that one's length is final; longer ones may be missing or
    too long.
    """
    cdef Bucket buckets[3]
    cdef Py_ssize_t k
    out = np.full(cells.shape[0], INFINITY)
    cdef double[::1] found = out
    for k in range(3):
        buckets[k].cells = NULL
        buckets[k].count = buckets[k].room = 0
    try:
        found[source] = 0.0
        with nogil:
            push(&buckets[0], <int32_t>source)
            spread(cells, cols, resolution_m, limit_m, until, buckets, found)
    finally:
        for k in range(3):
            free(buckets[k].cells)
    return out


def path(const double[::1] lengths_m, Py_ssize_t rows, Py_ssize_t cols, double resolution_m, Py_ssize_t cell):
    """The cells from the source (left out) to `cell`, by the path lengths from the source.

    Of two cells that a path may come from, it comes from the one nearer to the source, else from the lower index.

    Raises:
        ValueError: no path leads there.
    """
    cdef double diagonal_m = resolution_m * sqrt(2.0), step_m
    cdef Py_ssize_t row, col, r, c, other, best
    found = []
    while lengths_m[cell] > 0.0:
        found.append(cell)
        row = cell // cols
        col = cell % cols
        best = cell
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                step_m = resolution_m
                if r != row and c != col:
                    if lengths_m[row * cols + c] == INFINITY or lengths_m[r * cols + col] == INFINITY:
                        continue
                    step_m = diagonal_m
                other = r * cols + c
                if lengths_m[other] + step_m == lengths_m[cell] and lengths_m[other] < lengths_m[best]:
                    best = other
        if best == cell:
            raise ValueError("no path leads there")
        cell = best
    found.reverse()
    return found

def length_near(
    const double[::1] lengths_m,
    Py_ssize_t rows,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_m,
    double y_m,
    Py_ssize_t index,
):
    """Path length in metres to the reached cell whose center is nearest to a place, and from there straight.

    It looks ring by ring around the cell `index`, which holds the place or is the nearest to it.
    """
    cdef Py_ssize_t at_row = index // cols, at_col = index % cols, ring, row, col, step, cell, nearest = -1
    cdef double gap_m, least_m = INFINITY, from_cell_m
    from_cell_m = hypot(x0_m + (at_col + 0.5) * resolution_m - x_m, y0_m + (at_row + 0.5) * resolution_m - y_m)
    for ring in range(max(rows, cols)):
        # No center of this ring is nearer than this, wherever the place lies in its cell. One ring more than needed is
        # searched, because of rounding.
        if (ring - 1) * resolution_m - from_cell_m > least_m:
            break
        for row in range(max(at_row - ring, 0), min(at_row + ring + 1, rows)):
            step = 1 if row == at_row - ring or row == at_row + ring else 2 * ring  # its rim only
            col = at_col - ring - step
            while col + step <= at_col + ring:
                col += step
                cell = row * cols + col
                if 0 <= col < cols and lengths_m[cell] < INFINITY:
                    gap_m = hypot(
                        x0_m + (<double>col + 0.5) * resolution_m - x_m, y0_m + (<double>row + 0.5) * resolution_m - y_m
                    )
                    if gap_m < least_m or (gap_m == least_m and cell < nearest):
                        least_m = gap_m
                        nearest = cell
    return lengths_m[nearest] + least_m if nearest >= 0 else INFINITY


include "../bus/built.pxi"
