# cython: language_level=3
"""Loops over the cells of maps: what a scan shows, what it is worth as evidence, and states from elsewhere.

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). Cells from a peer are checked here (`carry_out`, `apply`). What scores, odds and states are stands
in agents/evidence.py.

A scan costs what it shows, not what it covers: `passed` leaves out blocks of cells of which it knows that none counts.
A block is *open* unless a scan found that no miss of any of its cells would count; who changes a score opens its block.
"""

from libc.math cimport INFINITY, M_PI, atan2, ceil, floor, hypot, rint
from libc.stdint cimport int8_t, int32_t, int64_t, uint32_t

import numpy as np

BLOCK = 8
"""Rows and columns of a block."""
cdef enum:
    SIDE = 8  # the same


cdef inline void open_block(unsigned char[:, ::1] opened, int64_t cell, Py_ssize_t cols) noexcept nogil:
    opened[cell // cols // SIDE, cell % cols // SIDE] = 1


cdef inline int64_t odds_of(int64_t score, int64_t worth, int64_t settled) noexcept nogil:
    """The odds of a score: clamped, and above zero in units of a hit."""
    return max(score, -settled) if score <= 0 else min((score + worth - 1) // worth, settled)


cdef inline int64_t score_of(int64_t odds, int64_t worth) noexcept nogil:
    return odds * worth if odds > 0 else odds


cdef inline signed char state_of(int64_t score) noexcept nogil:
    return 0 if score < 0 else 1 if score > 0 else -1


cdef inline bint turn(signed char[::1] states, int64_t cell, int64_t score, Py_ssize_t* lost) noexcept nogil:
    """Whether a cell's state changes with its score; `lost` counts cells that are known to be free no longer."""
    cdef signed char state = state_of(score)
    if state == states[cell]:
        return False
    lost[0] += states[cell] == 0
    states[cell] = state
    return True


cdef inline bint counts(int64_t score, int64_t evidence, int64_t worth, int64_t settled) noexcept nogil:
    """Whether evidence on a cell changes its odds."""
    return odds_of(score + evidence, worth, settled) != odds_of(score, worth, settled)


cdef inline bint holds(const int64_t[::1] ascending, int64_t cell) noexcept nogil:
    cdef Py_ssize_t low = 0, high = ascending.shape[0], middle
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] < cell:
            low = middle + 1
        else:
            high = middle
    return low < ascending.shape[0] and ascending[low] == cell


cdef inline int farther(
    Py_ssize_t row, Py_ssize_t col, double resolution_m, double x0_m, double y0_m, double x_m, double y_m,
    const double[::1] ranges_m, double beams_per_radian, bint both,
) noexcept nogil:
    """How many beams go farther than the center of a cell: of the one that points at it, or of both beside it."""
    cdef double dx = x0_m + (<double>col + 0.5) * resolution_m - x_m
    cdef double dy = y0_m + (<double>row + 0.5) * resolution_m - y_m
    cdef double toward = atan2(dy, dx) * beams_per_radian, pointing = rint(toward), distance = hypot(dx, dy)
    cdef int64_t beams = ranges_m.shape[0], beam = (<int64_t>pointing + beams) % beams
    cdef int found = distance < ranges_m[beam]
    if both:
        found += distance < ranges_m[(beam + (1 if toward > pointing else beams - 1)) % beams]
    return found


def met(
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
    """Cells (int64), in the order of the beams, in which beams of a scan end."""
    cdef Py_ssize_t n = ranges_m.shape[0], k, found = 0
    cdef double row, col, reach
    out = np.empty(n, np.int64)
    cdef int64_t[::1] ends = out
    for k in range(n):
        if ranges_m[k] < range_m:
            reach = ranges_m[k] + into_wall_m
            col = floor((x_m + reach * cosines[k] - x0_m) / resolution_m)
            row = floor((y_m + reach * sines[k] - y0_m) / resolution_m)
            if 0 <= row < rows and 0 <= col < cols:
                ends[found] = <int64_t>row * cols + <int64_t>col
                # Beams side by side mostly end in the same cell.
                found += found == 0 or ends[found] != ends[found - 1]
    return out[:found]

def unreached(
    const int64_t[::1] which,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_m,
    double y_m,
    const double[::1] ranges_m,
    double beams_per_radian,
):
    """Those of some cells (int64) beyond whose centers neither of the beams beside them goes."""
    cdef Py_ssize_t n = which.shape[0], k, found = 0
    out = np.empty(n, np.int64)
    cdef int64_t[::1] kept = out
    for k in range(n):
        if not farther(
            which[k] // cols, which[k] % cols, resolution_m, x0_m, y0_m, x_m, y_m, ranges_m, beams_per_radian, True
        ):
            kept[found] = which[k]
            found += 1
    return out[:found]

cdef void bounds(
    double dx, double dy, double radius_m, const double[::1] ranges_m, double beams_per_radian,
    double* least_m, double* most_m,
) noexcept nogil:
    """The least and the most range of the beams that may be beside a place within a circle around (dx, dy)."""
    cdef double away_m = hypot(dx, dy), toward, spread
    cdef int64_t beams = ranges_m.shape[0], beam, first, count, k
    least_m[0] = 0.0
    most_m[0] = INFINITY
    if away_m <= radius_m:
        return
    toward = atan2(dy, dx) * beams_per_radian
    # asin(s) <= pi / 2 s; and two beams more on each side, because of rounding and for the second beam beside a place.
    spread = 0.5 * M_PI * radius_m / away_m * beams_per_radian + 2.0
    first = <int64_t>floor(toward - spread)
    count = min(<int64_t>ceil(toward + spread) - first + 1, beams)
    beam = (first % beams + beams) % beams
    least_m[0] = most_m[0] = ranges_m[beam]
    for k in range(1, count):
        beam = beam + 1 if beam + 1 < beams else 0
        least_m[0] = min(least_m[0], ranges_m[beam])
        most_m[0] = max(most_m[0], ranges_m[beam])


def passed(
    const int32_t[::1] scores,
    unsigned char[:, ::1] opened,
    Py_ssize_t rows,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    double x_m,
    double y_m,
    const double[::1] ranges_m,
    double beams_per_radian,
    const int64_t[::1] hit,
    bint both,
    int64_t miss,
    int64_t worth,
    int64_t settled,
):
    """Cells (int64), ascending, that a scan shows to be free, if that counts. `opened` are the blocks.

    A cell is free if its center is nearer than the range of the beam that points at it (Thrun, Burgard & Fox,
    Probabilistic Robotics, table 9.2), or of `both` beams beside it, and it is none of those, ascending, that were hit.
    """
    cdef double far = 0.0, radius_m = 0.75 * SIDE * resolution_m, dx, dy, away_m, least_m, most_m
    cdef Py_ssize_t k, row, col, band, block, first_band, end_band, first_block, end_block, looked, found = 0
    cdef int64_t cell
    for k in range(ranges_m.shape[0]):
        far = max(far, ranges_m[k])
    first_band = max(0, <Py_ssize_t>floor((y_m - far - y0_m) / resolution_m)) // SIDE
    end_band = min(opened.shape[0], <Py_ssize_t>floor((y_m + far - y0_m) / resolution_m) // SIDE + 1)
    first_block = max(0, <Py_ssize_t>floor((x_m - far - x0_m) / resolution_m)) // SIDE
    end_block = min(opened.shape[1], <Py_ssize_t>floor((x_m + far - x0_m) / resolution_m) // SIDE + 1)
    out = np.empty(max(0, end_band - first_band) * max(0, end_block - first_block) * SIDE * SIDE, np.int64)
    look, sure, open_cells = (np.empty(opened.shape[1], np.int64) for _ in range(3))
    cdef int64_t[::1] free = out, blocks = look, surely = sure, still_open = open_cells
    with nogil:
        for band in range(first_band, end_band):
            looked = 0
            dy = y0_m + (<double>band + 0.5) * SIDE * resolution_m - y_m
            for block in range(first_block, end_block):
                if opened[band, block]:
                    dx = x0_m + (<double>block + 0.5) * SIDE * resolution_m - x_m
                    bounds(dx, dy, radius_m, ranges_m, beams_per_radian, &least_m, &most_m)
                    away_m = hypot(dx, dy)
                    if away_m - radius_m < most_m:
                        blocks[looked] = block
                        surely[looked] = away_m + radius_m < least_m
                        still_open[looked] = 0
                        looked += 1
            for row in range(band * SIDE, min((band + 1) * SIDE, rows)):
                for k in range(looked):
                    for col in range(blocks[k] * SIDE, min((blocks[k] + 1) * SIDE, cols)):
                        cell = row * cols + col
                        if not counts(scores[cell], -miss, worth, settled):
                            continue  # most cells are settled, and this is the cheapest question
                        still_open[k] = 1
                        if (surely[k] or farther(
                            row, col, resolution_m, x0_m, y0_m, x_m, y_m, ranges_m, beams_per_radian, both
                        ) > both) and not holds(hit, cell):
                            free[found] = cell
                            found += 1
            for k in range(looked):
                opened[band, blocks[k]] = still_open[k]
    return out[:found]

def weigh(
    int32_t[::1] scores, signed char[::1] states, unsigned char[:, ::1] opened, Py_ssize_t cols,
    const int64_t[::1] which, int64_t evidence, int64_t worth, int64_t settled,
):
    """Add evidence to the scores of cells, where it counts.

    Returns:
        The cells where it did; those whose state changed; and how many are known to be free no longer.
    """
    cdef Py_ssize_t n = which.shape[0], k, counted = 0, turned = 0, lost = 0
    cdef int64_t cell
    out, changed = np.empty(n, np.int64), np.empty(n, np.int64)
    cdef int64_t[::1] where = out, new = changed
    for k in range(n):
        cell = which[k]
        if counts(scores[cell], evidence, worth, settled):
            scores[cell] += <int32_t>evidence
            open_block(opened, cell, cols)
            where[counted] = cell
            counted += 1
            if turn(states, cell, scores[cell], &lost):
                new[turned] = cell
                turned += 1
    return out[:counted], changed[:turned], lost

def forget(
    int32_t[::1] scores, signed char[::1] states, unsigned char[:, ::1] opened, Py_ssize_t cols,
    const uint32_t[::1] which, const int8_t[::1] values, int64_t miss, int64_t worth,
):
    """Take the evidence of a report back from the scores.

    Returns:
        The cells (int64) whose state changed, and how many are known to be free no longer.
    """
    cdef Py_ssize_t n = which.shape[0], k, turned = 0, lost = 0
    cdef int64_t cell
    changed = np.empty(n, np.int64)
    cdef int64_t[::1] new = changed
    for k in range(n):
        cell = which[k]
        scores[cell] -= <int32_t>(worth if values[k] else -miss)
        open_block(opened, cell, cols)
        if turn(states, cell, scores[cell], &lost):
            new[turned] = cell
            turned += 1
    return changed[:turned], lost

def tally(
    int32_t[::1] hits, int32_t[::1] misses, const uint32_t[::1] which, const int8_t[::1] values, int8_t[::1] odds,
    int64_t miss, int64_t worth, int64_t settled,
):
    """Count the hits (1) and misses (0) of a report; returns the cells (int64) whose odds changed, a cell once."""
    cdef Py_ssize_t n = which.shape[0], k, found = 0
    cdef int64_t cell, now
    for k in range(n):
        if values[k]:
            hits[which[k]] += 1
        else:
            misses[which[k]] += 1
    out = np.empty(n, np.int64)
    cdef int64_t[::1] changed = out
    for k in range(n):
        cell = which[k]
        now = odds_of(hits[cell] * worth - misses[cell] * miss, worth, settled)
        if now != odds[cell]:
            odds[cell] = <int8_t>now
            changed[found] = cell
            found += 1
    return out[:found]

def apply(
    int8_t[::1] odds, int32_t[::1] scores, signed char[::1] states, unsigned char[:, ::1] opened, Py_ssize_t cols,
    const uint32_t[::1] theirs, const int8_t[::1] values, int64_t worth,
):
    """Replace the odds that the MS gave to cells.

    Returns:
        The cells (int64) whose state changed, perhaps one twice, and how many are known to be free no longer.

    Raises:
        IndexError: a cell lies outside the grid; nothing is changed.
    """
    cdef Py_ssize_t n = theirs.shape[0], k, found = 0, lost = 0
    cdef int64_t cell
    out = np.empty(n, np.int64)
    cdef int64_t[::1] changed = out
    for k in range(n):
        if theirs[k] >= states.shape[0]:
            raise IndexError("a cell lies outside the grid")
    for k in range(n):
        cell = theirs[k]
        scores[cell] += <int32_t>(score_of(values[k], worth) - score_of(odds[cell], worth))
        odds[cell] = values[k]
        open_block(opened, cell, cols)
        if turn(states, cell, scores[cell], &lost):
            changed[found] = cell
            found += 1
    return out[:found], lost

def carry_out(int8_t[::1] odds, const uint32_t[::1] changed, const int8_t[::1] values, int64_t settled):
    """Carry out changes in their order. Each must change a cell of the grid to odds that can be.

    Returns:
        Whether all do; else nothing is changed.
    """
    cdef Py_ssize_t n = changed.shape[0], k, done = 0
    out = np.empty(n, np.int8)
    cdef int8_t[::1] before = out
    while (
        done < n
        and changed[done] < odds.shape[0]
        and values[done] != odds[changed[done]]
        and -settled <= values[done] <= settled
    ):
        before[done] = odds[changed[done]]
        odds[changed[done]] = values[done]
        done += 1
    if done < n:
        for k in range(done - 1, -1, -1):
            odds[changed[k]] = before[k]
    return done == n


include "../bus/built.pxi"
