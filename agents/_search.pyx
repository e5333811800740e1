# cython: language_level=3
"""Shortest paths over the free cells of a map, by Dijkstra's algorithm with buckets (Dial 1969).

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). The map is a window of the caller's, with a rim of cells that are not free, so that no step leaves
it. All indices are cells of the window.
"""

from libc.math cimport INFINITY, hypot, sqrt
from libc.stdint cimport int32_t, int64_t
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
    const int64_t[::1] seeds,
    Bucket* buckets,
    double[::1] found,
) except -1 nogil:
    """Search on from the seeds, cells whose lengths are in `found`, ascending.

    Buckets are narrower than the shortest step. So the cells of a bucket are final when its turn comes, in whatever
    order they are taken, and at most two buckets lie ahead.
    """
    cdef double per_metre = 1.0 / (0.9 * resolution_m), diagonal_m = resolution_m * sqrt(2.0), here, longer
    cdef Bucket* bucket
    cdef Py_ssize_t turn = 0, waiting = 0, k, cell, seed = 0, due
    cdef bint east, west, north, south
    while waiting or seed < seeds.shape[0]:
        if not waiting:
            turn = max(turn, <Py_ssize_t>(found[seeds[seed]] * per_metre))
        bucket = &buckets[<size_t>turn % 3]
        while seed < seeds.shape[0]:
            due = <Py_ssize_t>(found[seeds[seed]] * per_metre)
            if due > turn:
                break
            if due == turn:  # else a shorter way was found since, and was taken in an earlier bucket
                push(bucket, <int32_t>seeds[seed])
                waiting += 1
            seed += 1
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
            east = cells[cell + 1] == 0
            west = cells[cell - 1] == 0
            north = cells[cell + cols] == 0
            south = cells[cell - cols] == 0
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


def lengthen(
    const signed char[::1] cells,
    Py_ssize_t cols,
    double resolution_m,
    const int64_t[::1] seeds,
    double limit_m,
    Py_ssize_t until,
    double[::1] lengths_m,
):
    """Carry path lengths (cells,) in metres on from `seeds` over free cells (0); infinite is where none leads.

    Seeds have a length each, and come in the order of it. A step leads to one of eight neighbors; a diagonal one needs
    both cells that it passes between. No length exceeds `limit_m`. With a cell `until` >= 0 the search ends when that
    one's length is final; longer ones may be missing or too long.
    """
    cdef Bucket buckets[3]
    cdef Py_ssize_t k
    for k in range(3):
        buckets[k].cells = NULL
        buckets[k].count = buckets[k].room = 0
    try:
        with nogil:
            spread(cells, cols, resolution_m, limit_m, until, seeds, buckets, lengths_m)
    finally:
        for k in range(3):
            free(buckets[k].cells)


def path(const double[::1] lengths_m, Py_ssize_t cols, double resolution_m, Py_ssize_t cell):
    """The cells from the source (left out) to `cell`, by the path lengths from the source.

    Of two cells that a path may come from, it comes from the one nearer to the source, else from the lower index.

    Raises:
        ValueError: no path leads there.
    """
    cdef double diagonal_m = resolution_m * sqrt(2.0), step_m
    cdef Py_ssize_t down, right, other, best
    found = []
    while lengths_m[cell] > 0.0:
        found.append(cell)
        best = cell
        if lengths_m[cell] < INFINITY:
            for down in range(-1, 2):
                for right in range(-1, 2):
                    step_m = resolution_m
                    if down != 0 and right != 0:
                        if lengths_m[cell + right] == INFINITY or lengths_m[cell + down * cols] == INFINITY:
                            continue
                        step_m = diagonal_m
                    other = cell + down * cols + right
                    if lengths_m[other] + step_m == lengths_m[cell] and lengths_m[other] < lengths_m[best]:
                        best = other
        if best == cell:
            raise ValueError("no path leads there")
        cell = best
    found.reverse()
    return found


cdef enum:
    BLOCK = 16  # rows and columns of the blocks in which `length_near` looks


def reached_blocks(const double[::1] lengths_m, Py_ssize_t rows, Py_ssize_t cols):
    """First row and column of each block of the window with a reached cell, (n, 2) int64."""
    cdef Py_ssize_t row, col
    out = np.zeros(((rows + BLOCK - 1) // BLOCK, (cols + BLOCK - 1) // BLOCK), np.uint8)
    cdef unsigned char[:, ::1] reached = out
    for row in range(rows):
        for col in range(cols):
            if lengths_m[row * cols + col] < INFINITY:
                reached[row // BLOCK, col // BLOCK] = 1
    return np.ascontiguousarray(BLOCK * np.argwhere(out))


cdef inline double away_m(double west_m, double south_m, double side_m, double x_m, double y_m, bint farthest) nogil:
    """Distance from a place to the nearest point of a square, or to the farthest."""
    cdef double a_m = west_m - x_m, b_m = x_m - west_m - side_m, c_m = south_m - y_m, d_m = y_m - south_m - side_m
    if farthest:
        return hypot(min(a_m, b_m), min(c_m, d_m))
    return hypot(max(a_m, b_m, 0.0), max(c_m, d_m, 0.0))


def length_near(
    const double[::1] lengths_m,
    Py_ssize_t rows,
    Py_ssize_t cols,
    const int64_t[:, ::1] blocks,
    Py_ssize_t first_row,
    Py_ssize_t first_col,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_m,
    double y_m,
):
    """Path length in metres to the reached cell whose center is nearest to a place, and from there straight.

    Args:
        lengths_m: (rows * cols,)
        blocks: (n, 2) of `reached_blocks`
        first_row, first_col: of the window in the grid whose lower-left corner is at x0_m, y0_m.
    """
    cdef Py_ssize_t k, row, col, cell, nearest = -1
    cdef double gap_m, least_m = INFINITY, bound_m = INFINITY, side_m = BLOCK * resolution_m, west_m, south_m
    # A block has a reached cell no farther away than its farthest point. So only blocks that begin within the least of
    # these distances count; one cell more, because of rounding.
    for k in range(blocks.shape[0]):
        west_m = x0_m + (first_col + blocks[k, 1]) * resolution_m
        south_m = y0_m + (first_row + blocks[k, 0]) * resolution_m
        bound_m = min(bound_m, away_m(west_m, south_m, side_m, x_m, y_m, True) + resolution_m)
    for k in range(blocks.shape[0]):
        west_m = x0_m + (first_col + blocks[k, 1]) * resolution_m
        south_m = y0_m + (first_row + blocks[k, 0]) * resolution_m
        if away_m(west_m, south_m, side_m, x_m, y_m, False) > bound_m:
            continue
        for row in range(blocks[k, 0], min(blocks[k, 0] + BLOCK, rows)):
            for col in range(blocks[k, 1], min(blocks[k, 1] + BLOCK, cols)):
                cell = row * cols + col
                if lengths_m[cell] < INFINITY:
                    gap_m = hypot(
                        x0_m + (<double>(first_col + col) + 0.5) * resolution_m - x_m,
                        y0_m + (<double>(first_row + row) + 0.5) * resolution_m - y_m,
                    )
                    if gap_m < least_m or (gap_m == least_m and cell < nearest):
                        least_m = gap_m
                        nearest = cell
    return lengths_m[nearest] + least_m if nearest >= 0 else INFINITY


include "../bus/built.pxi"
