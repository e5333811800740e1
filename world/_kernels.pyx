# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Compiled forms of the few loops that take most of a tick; built by `make compiled`, and used where they are there.

Each gives the same bits as the Python beside it (tests/test_compiled.py): the same operations on the same doubles in the
same order, never fused (-ffp-contract=off).
"""

from cpython cimport array
from cpython.bytearray cimport PyByteArray_AS_STRING
from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize, PyBytes_GET_SIZE
from cpython.ref cimport Py_INCREF
from cpython.tuple cimport PyTuple_New, PyTuple_SET_ITEM
from libc.math cimport INFINITY, atan2, ceil, fabs, floor, hypot, rint, sqrt
from libc.stdint cimport int8_t, int32_t, int64_t, uint16_t, uint32_t, uint64_t
from libc.stdlib cimport free, realloc
from libc.string cimport memcpy

import numpy as np

cdef enum:
    ROW = 28
    INHERENT = 18

cdef packed struct Heard:
    uint16_t src
    double power_dbm
    uint32_t length


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
    """world.lidar.Caster.cast: (beams,) metres to the first wall of each beam; `far` is the range in cells."""
    cdef Py_ssize_t rays = forward.shape[0], beams = rays // 2, cells = free_cells.shape[0]
    cdef Py_ssize_t ray, line, cell
    cdef double col = floor(u), row = floor(v), to_first, beside, distance, nearest
    cdef Py_ssize_t col_cell = <Py_ssize_t>col, row_cell = <Py_ssize_t>row
    out = np.empty(beams)
    cdef double[::1] result = out
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
) noexcept:
    """world.geometry: walls on one segment."""
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


def move(
    const unsigned char[::1] walls,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    const double[:, :] xy_m,
    list velocities_m_s,
    double tick_s,
    double top_speed_m_s,
):
    """world.motion.move: (n, 2) places a tick later; None if a wall may be in somebody's way."""
    cdef Py_ssize_t n = xy_m.shape[0], k
    cdef double x, y, vx, vy, speed, step_x, step_y, col, row, to_col, to_row
    if len(velocities_m_s) != n:
        raise ValueError(f"{len(velocities_m_s)} velocities of {n} robots")
    out = np.empty((n, 2))
    cdef double[:, ::1] wanted = out
    for k in range(n):
        x, y = xy_m[k, 0], xy_m[k, 1]
        vx, vy = velocities_m_s[k]
        step_x, step_y = vx * tick_s, vy * tick_s
        speed = sqrt(vx * vx + vy * vy)
        if speed > top_speed_m_s:
            step_x *= top_speed_m_s / speed
            step_y *= top_speed_m_s / speed
        wanted[k, 0], wanted[k, 1] = x + step_x, y + step_y
        col, row = floor((x - x0_m) / resolution_m), floor((y - y0_m) / resolution_m)
        to_col, to_row = floor((wanted[k, 0] - x0_m) / resolution_m), floor((wanted[k, 1] - y0_m) / resolution_m)
        if to_col != col or to_row != row:
            if fabs(to_col - col) + fabs(to_row - row) != 1.0 or walls[<Py_ssize_t>to_row * cols + <Py_ssize_t>to_col]:
                return None
    return out


def walls_crossed(
    const unsigned char[::1] walls,
    Py_ssize_t cols,
    double resolution_m,
    double x0_m,
    double y0_m,
    const double[:, :] a_xy,
    const double[:, :] b_xy,
):
    """world.geometry.walls_crossed: (n,) walls on each segment."""
    cdef Py_ssize_t n = a_xy.shape[0], k
    out = np.empty(n, np.int64)
    cdef int64_t[::1] crossed = out
    for k in range(n):
        crossed[k] = crossed_by(
            walls, cols, resolution_m, x0_m, y0_m, a_xy[k, 0], a_xy[k, 1], b_xy[k, 0], b_xy[k, 1]
        )
    return out


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
    """agents.own_map.OwnMap._seen_free: unknown cells (int64) that a scan shows to be free."""
    cdef Py_ssize_t n = d_row.shape[0], k, row, col, found = 0, beams = ranges_m.shape[0]
    cdef Py_ssize_t at_row = index // cols, at_col = index % cols
    cdef int64_t beam
    cdef double dx, dy
    out = np.empty(n, np.int64)
    cdef int64_t[::1] seen = out
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
    """agents.own_map.OwnMap._hit: cells (int64), in the order of the beams, not yet known as walls, that are walls."""
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


def obstacles(const signed char[::1] cells, Py_ssize_t cols, double u0, double v0, double du, double dv):
    """agents.own_map.OwnMap.obstacles: runs of cells on a segment that are not free; in units of cells."""
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
    """agents.planner.Planner._discover: the changed cells (int64) that are free and were not known so; now they are."""
    cdef Py_ssize_t n = changed.shape[0], k, found = 0
    out = np.empty(n, np.int64)
    cdef int64_t[::1] new = out
    for k in range(n):
        if cells[changed[k]] == 0 and not known[changed[k]]:
            known[changed[k]] = 1
            new[found] = changed[k]
            found += 1
    return out[:found]


cdef struct Bucket:
    int32_t* cells
    Py_ssize_t count
    Py_ssize_t room


cdef int push(Bucket* bucket, int32_t cell) except -1:
    cdef int32_t* more
    if bucket.count == bucket.room:
        bucket.room = max(1024, 2 * bucket.room)
        more = <int32_t*>realloc(bucket.cells, bucket.room * sizeof(int32_t))
        if more == NULL:
            raise MemoryError
        bucket.cells = more
    bucket.cells[bucket.count] = cell
    bucket.count += 1
    return 0


cdef inline int shorten(
    double[::1] found, Py_ssize_t cell, double longer, Bucket* buckets, double per_metre
) except -1:
    """A way to a cell: 1 if it is shorter than those that were found, and the cell waits for its turn."""
    if longer >= found[cell]:
        return 0
    found[cell] = longer
    push(&buckets[<size_t>(longer * per_metre) % 3], <int32_t>cell)
    return 1


def lengths(
    const signed char[::1] cells,
    Py_ssize_t rows,
    Py_ssize_t cols,
    double resolution_m,
    Py_ssize_t source,
    double limit_m,
    Py_ssize_t until,
):
    """agents.planner.Planner._search: (cells,) path lengths in metres over free cells (0), infinite where none leads.

    With a cell `until` >= 0 the search ends when that one's length is final; longer ones may be missing or too long.

    Dijkstra's algorithm with buckets (Dial 1969) narrower than the shortest step: what a bucket holds when its turn
    comes is final, whatever the order within it, so two lie ahead at most.
    """
    cdef double per_metre = 1.0 / (0.9 * resolution_m), diagonal_m = resolution_m * sqrt(2.0), here, longer
    cdef Bucket buckets[3]
    cdef Bucket* bucket
    cdef Py_ssize_t turn = 0, waiting = 1, k, cell, col
    cdef bint east, west, north, south
    out = np.full(rows * cols, INFINITY)
    cdef double[::1] found = out
    for k in range(3):
        buckets[k].cells = NULL
        buckets[k].count = buckets[k].room = 0
    try:
        found[source] = 0.0
        push(&buckets[0], <int32_t>source)
        while waiting:
            bucket = &buckets[<size_t>turn % 3]
            if until >= 0 and found[until] < INFINITY and <Py_ssize_t>(found[until] * per_metre) <= turn:
                break
            for k in range(bucket.count):
                cell = bucket.cells[k]
                here = found[cell]
                if <Py_ssize_t>(here * per_metre) != turn:
                    continue  # a shorter way was found since, and its turn has been
                longer = here + resolution_m
                if longer > limit_m:
                    continue
                col = <uint32_t>cell % <uint32_t>cols
                east = col + 1 < cols and cells[cell + 1] == 0
                west = col > 0 and cells[cell - 1] == 0
                north = cell + cols < rows * cols and cells[cell + cols] == 0
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
                # Most diagonal neighbors are nearer already, which is sooner seen than whether they are free.
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
    finally:
        for k in range(3):
            free(buckets[k].cells)
    return out


def path(const double[::1] lengths_m, Py_ssize_t rows, Py_ssize_t cols, double resolution_m, Py_ssize_t cell):
    """agents.planner.Reach.path: the cells from the source (left out) to `cell`."""
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
    """agents.planner.Reach.length_near_m: ring by ring around the cell `index`, which is the nearest to the place."""
    cdef Py_ssize_t at_row = index // cols, at_col = index % cols, ring, row, col, step, cell, nearest = -1
    cdef double gap_m, least_m = INFINITY, from_cell_m
    from_cell_m = hypot(x0_m + (at_col + 0.5) * resolution_m - x_m, y0_m + (at_row + 0.5) * resolution_m - y_m)
    for ring in range(max(rows, cols)):
        # No center of this ring is nearer than a ring's width less than that, however the place lies to its cell; one
        # ring more than needed, for the rounding.
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


def merge(
    bytes rows,
    int me,
    int sender,
    list known,
    array.array freshest,
    array.array next_hop,
    bytearray inherent,
    array.array before,
    int sticky,
    int max_node,
    uint64_t most_fresh,
    make_room,
):
    """agents.forwarding_table.ForwardingTable.merge: freshness of the entry `sticky`, or -1; -2 after a bad row."""
    cdef const unsigned char* raw = <const unsigned char*>PyBytes_AS_STRING(rows)
    cdef const unsigned char* end = raw + PyBytes_GET_SIZE(rows)
    cdef int dst
    cdef uint64_t freshness, offered
    cdef int64_t present
    cdef bint possible
    cdef object about_sticky = -1
    cdef const short* hops_before = before.data.as_shorts
    cdef Py_ssize_t known_before = len(before), size = len(freshest)
    while raw < end:
        dst = raw[0] | raw[1] << 8
        freshness = uint64_at(raw + 2)
        raw += ROW
        offered = freshness - 1 if freshness & 255 and dst != sticky else freshness
        possible = (offered & 256 == 0) == (offered & 255 > 0) and offered < most_fresh
        if dst == sticky:
            if not possible:
                return -2
            about_sticky = freshness
            continue
        if dst == me:
            continue
        if dst > max_node:
            return -2
        present = freshest.data.as_longlongs[dst] if dst < size else -1
        if present >= 0 and (
            offered < <uint64_t>present
            or (offered == <uint64_t>present and (dst >= known_before or hops_before[dst] != sender))
        ):
            continue
        if not possible:
            return -2
        if present < 0:
            known.append(dst)
        if dst >= size:
            make_room(dst)
            size = len(freshest)
        freshest.data.as_longlongs[dst] = <int64_t>offered
        next_hop.data.as_shorts[dst] = sender if offered & 255 else -1
        memcpy(PyByteArray_AS_STRING(inherent) + dst * INHERENT, raw - INHERENT, INHERENT)
    return about_sticky


cdef uint64_t uint64_at(const unsigned char* raw) noexcept:
    cdef uint64_t value = 0
    cdef int byte
    for byte in range(8):
        value |= <uint64_t>raw[byte] << 8 * byte
    return value


def advertised(list known, array.array freshest, bytearray inherent):
    """agents.forwarding_table.ForwardingTable.advertised: the whole table as a run of rows."""
    cdef bytes rows = PyBytes_FromStringAndSize(NULL, ROW * len(known))
    cdef unsigned char* raw = <unsigned char*>PyBytes_AS_STRING(rows)
    cdef const char* said = PyByteArray_AS_STRING(inherent)
    cdef int dst, byte
    cdef uint64_t freshness
    for dst in known:
        freshness = freshest.data.as_longlongs[dst]
        raw[0] = dst & 255
        raw[1] = dst >> 8
        for byte in range(8):
            raw[2 + byte] = freshness >> 8 * byte & 255
        memcpy(raw + 10, said + dst * INHERENT, INHERENT)
        raw += ROW
    return rows


def search_robots(array.array next_hop, bytearray inherent, int me):
    """agents.forwarding_table.ForwardingTable.search_robots"""
    cdef const char* said = PyByteArray_AS_STRING(inherent)
    cdef int dst
    found = []
    for dst in range(<int>len(next_hop)):
        if next_hop.data.as_shorts[dst] != -1 and dst != me and not said[dst * INHERENT] & 1:
            found.append(dst)
    return found


def set_inherent(
    bytearray inherent,
    Py_ssize_t dst,
    int flags,
    double x_m,
    double y_m,
    double target_x_m,
    double target_y_m,
    double per_metre,
):
    """agents.forwarding_table.ForwardingTable.set_inherent: what a destination says of itself, as it travels."""
    cdef unsigned char* raw = <unsigned char*>PyByteArray_AS_STRING(inherent) + dst * INHERENT
    cdef double places[4]
    cdef double place
    cdef int32_t whole
    cdef int k, byte
    places[:] = [x_m, y_m, target_x_m, target_y_m]
    raw[0] = flags & 255
    raw[1] = flags >> 8 & 255
    for k in range(4):
        place = rint(per_metre * places[k])
        if not -2147483648.0 <= place <= 2147483647.0:
            raise OverflowError("a place lies farther away than 21 km")
        whole = <int32_t>place
        for byte in range(4):
            raw[2 + 4 * k + byte] = whole >> 8 * byte & 255


def is_frontier(const signed char[::1] cells, Py_ssize_t cols, Py_ssize_t index):
    """agents.own_map.OwnMap.is_frontier"""
    cdef Py_ssize_t col = index % cols
    return cells[index] == 0 and (
        (col > 0 and cells[index - 1] == -1)
        or (col < cols - 1 and cells[index + 1] == -1)
        or (index >= cols and cells[index - cols] == -1)
        or (index + cols < cells.shape[0] and cells[index + cols] == -1)
    )


def apply(signed char[::1] cells, const uint32_t[::1] theirs, const int8_t[::1] values):
    """agents.own_map.OwnMap.apply: takes better values over; the changed cells (int64), some perhaps twice."""
    cdef Py_ssize_t n = theirs.shape[0], k, found = 0
    out = np.empty(n, np.int64)
    cdef int64_t[::1] changed = out
    for k in range(n):
        if theirs[k] >= cells.shape[0]:
            raise IndexError("a cell lies outside the grid")
        if values[k] > cells[theirs[k]]:
            changed[found] = k
            found += 1
    # Only now: what is better is told from what was there before.
    for k in range(found):
        cells[theirs[changed[k]]] = values[changed[k]]
        changed[k] = theirs[changed[k]]
    return out[:found]


def distances(const double[:, :] xy_m):
    """medium.propagation.Propagation.received: (n, n) distances between all places."""
    cdef Py_ssize_t n = xy_m.shape[0], i, j
    cdef double dx, dy
    out = np.empty((n, n))
    cdef double[:, ::1] result = out
    for i in range(n):
        for j in range(n):
            dx = xy_m[i, 0] - xy_m[j, 0]
            dy = xy_m[i, 1] - xy_m[j, 1]
            result[i, j] = sqrt(dx * dx + dy * dy)
    return out


def pack_receptions(tuple receptions):
    """medium.messages.Inbox.encode: the receptions, one after the other."""
    cdef Py_ssize_t length = 0
    cdef Heard head
    cdef tuple reception
    cdef bytes payload
    for reception in receptions:
        payload = reception[2]
        length += sizeof(Heard) + PyBytes_GET_SIZE(payload)
    cdef bytes packed = PyBytes_FromStringAndSize(NULL, length)
    cdef char* raw = PyBytes_AS_STRING(packed)
    for reception in receptions:
        payload = reception[2]
        head.src = reception[0]
        head.power_dbm = reception[1]
        head.length = <uint32_t>PyBytes_GET_SIZE(payload)
        memcpy(raw, &head, sizeof(Heard))
        memcpy(raw + sizeof(Heard), PyBytes_AS_STRING(payload), head.length)
        raw += sizeof(Heard) + head.length
    return packed


def unpack_receptions(bytes data, Py_ssize_t start, int max_node):
    """medium.messages.Inbox.decode: the receptions in `data` from `start` on; None if they are not what they should be."""
    cdef const char* raw = PyBytes_AS_STRING(data)
    cdef Py_ssize_t size = PyBytes_GET_SIZE(data), at = start, count = 0
    cdef Heard head
    cdef tuple heard, reception
    while at < size:
        if size - at < <Py_ssize_t>sizeof(Heard):
            return None
        memcpy(&head, raw + at, sizeof(Heard))
        at += sizeof(Heard)
        if head.length > size - at or head.src > max_node or head.power_dbm - head.power_dbm != 0.0:
            return None
        at += head.length
        count += 1
    heard = PyTuple_New(count)
    at = start
    for count in range(count):
        memcpy(&head, raw + at, sizeof(Heard))
        at += sizeof(Heard)
        reception = (head.src, head.power_dbm, PyBytes_FromStringAndSize(raw + at, head.length))
        at += head.length
        Py_INCREF(reception)
        PyTuple_SET_ITEM(heard, count, reception)
    return heard


def all_below(const uint32_t[::1] cells, Py_ssize_t size):
    """world.grid.GridGeometry.holds"""
    cdef Py_ssize_t k
    for k in range(cells.shape[0]):
        if cells[k] >= size:
            return False
    return True
