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


cdef enum:
    AHEAD = 8  # buckets; a step of 1.42 cells that leads as far away from the goal as can be skips three


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


cdef struct Search:
    int32_t cols
    double resolution_m
    double per_metre
    Py_ssize_t until
    Bucket buckets[AHEAD]


cdef inline double ahead_m(Search* search, int32_t cell) noexcept nogil:
    """Least length of a way from a cell to the cell `until` if all cells were free; 0 without one."""
    cdef int32_t until = <int32_t>search.until, down, right
    if until < 0:
        return 0.0
    down = cell // search.cols - until // search.cols
    right = cell % search.cols - until % search.cols
    down, right = max(down, -down), max(right, -right)
    # A little less, so that no step leads to where, because of rounding, length and this together are less.
    return (1.0 - 1e-9) * search.resolution_m * (max(down, right) + (sqrt(2.0) - 1.0) * min(down, right))


cdef inline Py_ssize_t due(Search* search, double length_m, Py_ssize_t cell) noexcept nogil:
    """The turn of a cell."""
    return <Py_ssize_t>((length_m + ahead_m(search, <int32_t>cell)) * search.per_metre)


cdef inline int shorten(Search* search, double[::1] found, Py_ssize_t cell, double longer) except -1 nogil:
    """Take a way to a cell if it is the shortest so far, and queue the cell; returns 1 then, else 0."""
    if longer >= found[cell]:
        return 0
    found[cell] = longer
    push(&search.buckets[<size_t>due(search, longer, cell) % AHEAD], <int32_t>cell)
    return 1


cdef int spread(
    const signed char[::1] cells, double limit_m, const int64_t[::1] seeds, Search* search, double[::1] found
) except -1 nogil:
    """Search on from the seeds, cells whose lengths are in `found`, ascending; with `until` there is one.

    A cell's turn is by its length, and with `until` by the least length of a way over it (A*: Hart, Nilsson & Raphael
    1968). A step raises that by less than AHEAD buckets, and never lowers it. Without `until` a bucket is narrower than
    the shortest step. So its cells are final when its turn comes, in whatever order they are taken; with `until` a cell
    that becomes nearer in its turn is taken again.
    """
    cdef double resolution_m = search.resolution_m, diagonal_m = resolution_m * sqrt(2.0), here, longer
    cdef Py_ssize_t cols = search.cols, until = search.until
    cdef Bucket* bucket
    cdef Py_ssize_t turn = 0, waiting = 0, k, cell, seed = 0, its
    cdef bint east, west, north, south
    while waiting or seed < seeds.shape[0]:
        if not waiting:
            turn = max(turn, due(search, found[seeds[seed]], seeds[seed]))
        bucket = &search.buckets[<size_t>turn % AHEAD]
        while seed < seeds.shape[0]:
            its = due(search, found[seeds[seed]], seeds[seed])
            if its > turn:
                break
            if its == turn:  # else a shorter way was found since, and was taken in an earlier bucket
                push(bucket, <int32_t>seeds[seed])
                waiting += 1
            seed += 1
        # All ways as short as the shortest are found, and the cells beside them.
        if until >= 0 and found[until] < INFINITY and due(search, found[until] + resolution_m, until) < turn:
            break
        k = 0
        while k < bucket.count:
            cell = bucket.cells[k]
            k += 1
            here = found[cell]
            if due(search, here, cell) != turn:
                continue  # a shorter way was found since, and was taken in an earlier bucket
            longer = here + resolution_m
            if longer > limit_m:
                continue
            east = cells[cell + 1] == 0
            west = cells[cell - 1] == 0
            north = cells[cell + cols] == 0
            south = cells[cell - cols] == 0
            if east:
                waiting += shorten(search, found, cell + 1, longer)
            if west:
                waiting += shorten(search, found, cell - 1, longer)
            if north:
                waiting += shorten(search, found, cell + cols, longer)
            if south:
                waiting += shorten(search, found, cell - cols, longer)
            longer = here + diagonal_m
            if longer > limit_m:
                continue
            # Most diagonal neighbors have a shorter way already; that is the cheaper question, so it comes first.
            if east and north and longer < found[cell + cols + 1] and cells[cell + cols + 1] == 0:
                waiting += shorten(search, found, cell + cols + 1, longer)
            if west and north and longer < found[cell + cols - 1] and cells[cell + cols - 1] == 0:
                waiting += shorten(search, found, cell + cols - 1, longer)
            if east and south and longer < found[cell - cols + 1] and cells[cell - cols + 1] == 0:
                waiting += shorten(search, found, cell - cols + 1, longer)
            if west and south and longer < found[cell - cols - 1] and cells[cell - cols - 1] == 0:
                waiting += shorten(search, found, cell - cols - 1, longer)
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
    both cells that it passes between. No length exceeds `limit_m`. With a cell `until` >= 0 only its own length and those
    on the shortest ways to it are sure; others may be missing or too long.
    """
    cdef Search search
    cdef Py_ssize_t k
    search.cols, search.resolution_m, search.until = <int32_t>cols, resolution_m, until
    search.per_metre = 1.0 / (0.9 * resolution_m)
    for k in range(AHEAD):
        search.buckets[k].cells = NULL
        search.buckets[k].count = search.buckets[k].room = 0
    try:
        with nogil:
            spread(cells, limit_m, seeds, &search, lengths_m)
    finally:
        for k in range(AHEAD):
            free(search.buckets[k].cells)


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
