# cython: language_level=3
"""Loops over the rows of a forwarding table (`agents.forwarding_table`) and over acknowledgements (`agents.messages`).

The same operations on the same doubles in the same order on every processor: never fused (`-ffp-contract=off`, no
`-march`; setup.py). Rows come from a peer: `merge` checks all of them before it takes any destination for an index.
"""

from cpython cimport array
from cpython.bytearray cimport PyByteArray_AS_STRING
from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize, PyBytes_GET_SIZE
from cpython.long cimport PyLong_AsLongAndOverflow
from libc.math cimport rint
from libc.stdint cimport int32_t, int64_t, uint64_t
from libc.string cimport memcpy

cdef enum:
    ROW = 28
    INHERENT = 18
    ACK = 8
    AHEAD = 16
    STATION = 0

cdef double FARTHEST = 2**31 - 1
"""What lies farther away is said to be here."""


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
    int robots,
    uint64_t tick,
    make_room,
):
    """Take over the fresher rows of the neighbor `sender`; the columns are those of the table of node `me`.

    Args:
        before: next hops before the first update of this tick.
        sticky: a destination whose entry this leaves as it is; nobody adds the hop to this neighbor to it.
        robots: the highest destination that there is.
        tick: in which the rows are heard.
        make_room: called with a destination that the columns do not reach.

    Returns:
        Freshness of the neighbor's own entry for `sticky`, or -1; None, and nothing is taken over, if one of the rows
        can't be.
    """
    cdef const unsigned char* raw = <const unsigned char*>PyBytes_AS_STRING(rows)
    cdef const unsigned char* end = raw + PyBytes_GET_SIZE(rows)
    cdef int dst
    cdef uint64_t freshness, offered
    cdef int64_t present
    cdef object about_sticky = -1
    cdef const short* hops_before = before.data.as_shorts
    cdef Py_ssize_t known_before = len(before), size = len(freshest)
    # Everybody knows where the MS is.
    cdef bint placed = sender == STATION or (sender < size and freshest.data.as_longlongs[sender] >= 0)
    if not all_possible(raw, end, sender, placed, sticky, robots, tick):
        return None
    while raw < end:
        dst = raw[0] | raw[1] << 8
        freshness = uint64_at(raw + 2)
        raw += ROW
        if dst == sticky:
            about_sticky = freshness
            continue
        if dst == me:
            continue
        offered = freshness - 1 if freshness & 255 else freshness
        present = freshest.data.as_longlongs[dst] if dst < size else -1
        if present >= 0 and (
            offered < <uint64_t>present
            or (offered == <uint64_t>present and (dst >= known_before or hops_before[dst] != sender))
        ):
            continue
        if present < 0:
            known.append(dst)
        if dst >= size:
            make_room(dst)
            size = len(freshest)
        freshest.data.as_longlongs[dst] = <int64_t>offered
        next_hop.data.as_shorts[dst] = sender if offered & 255 else -1
        memcpy(PyByteArray_AS_STRING(inherent) + dst * INHERENT, raw - INHERENT, INHERENT)
    return about_sticky

cdef bint all_possible(
    const unsigned char* raw, const unsigned char* end, int sender, bint placed, int sticky, int robots, uint64_t tick
) noexcept:
    """Whether all rows can be (`agents.limits`), and one of them, unless it is `placed`, is the sender's own."""
    cdef int dst
    cdef uint64_t freshness, offered
    cdef unsigned int hop
    while end - raw >= ROW:
        dst = raw[0] | raw[1] << 8
        freshness = uint64_at(raw + 2)
        raw += ROW
        offered = freshness - 1 if freshness & 255 and dst != sticky else freshness
        hop = 255 - (freshness & 255)
        if (
            (offered & 256 == 0) != (offered & 255 > 0)
            or (hop == 0) != (dst == sender)
            or (freshness >> 9) + (hop if hop < 255 else 0) >= tick
            or dst > robots
        ):
            return False
        placed = placed or hop == 0
    return placed and raw == end

def update_possible(fields, int robots, long changes, uint64_t tick):
    """Whether the fields of an update have their types and can be heard in `tick` (`agents.limits`), its rows aside.

    Args:
        robots: the highest node that can be named.
        changes: the highest version of the MS's map.
    """
    if type(fields) is not list or not 7 <= len(<list>fields) <= 8:
        return False
    _, nms, hold, version, rows, acks, acks_version = (<list>fields)[:7]
    if type(rows) is not bytes or type(acks) is not bytes:
        return False
    if not (within(nms, -1, robots) and within(hold, -1, robots)):
        return False
    if not (within(version, 0, changes) and within(acks_version, 0, changes)):
        return False
    if len(<list>fields) == 8:
        ahead = (<list>fields)[7]
        if type(ahead) is not bytes or not acks or not ahead or not ahead_possible(ahead, robots, tick):
            return False
    return acks_possible(acks, robots, tick)

cdef bint within(object value, long low, long high) noexcept:
    cdef int overflow = 0
    cdef long number
    if type(value) is not int:
        return False
    number = PyLong_AsLongAndOverflow(value, &overflow)
    return not overflow and low <= number <= high

cdef bint acks_possible(bytes acks, int robots, uint64_t tick) noexcept:
    """Whether acknowledgements are ascending by robot and incarnation, and of reports that can be by `tick`."""
    cdef const unsigned char* raw = <const unsigned char*>PyBytes_AS_STRING(acks)
    cdef const unsigned char* end = raw + PyBytes_GET_SIZE(acks)
    cdef int robot
    cdef int64_t source, before = -1
    cdef uint64_t number
    while end - raw >= ACK:
        robot = raw[0] | raw[1] << 8
        source = <int64_t>robot << 16 | raw[2] | raw[3] << 8
        number = raw[4] | raw[5] << 8 | raw[6] << 16 | <uint64_t>raw[7] << 24
        if not 1 <= robot <= robots or source <= before or (source & 0xFFFF) + number > tick:
            return False
        before = source
        raw += ACK
    return raw == end

cdef bint ahead_possible(bytes ahead, int robots, uint64_t tick) noexcept:
    """The same of acknowledgements beyond gaps, each of one report at least."""
    cdef const unsigned char* raw = <const unsigned char*>PyBytes_AS_STRING(ahead)
    cdef const unsigned char* end = raw + PyBytes_GET_SIZE(ahead)
    cdef int robot
    cdef int64_t source, before = -1
    cdef uint64_t newest, mask
    while end - raw >= AHEAD:
        robot = raw[0] | raw[1] << 8
        source = <int64_t>robot << 16 | raw[2] | raw[3] << 8
        newest = (raw[4] | raw[5] << 8 | raw[6] << 16 | <uint64_t>raw[7] << 24) + 1
        mask = uint64_at(raw + 8)
        if not 1 <= robot <= robots or source <= before or mask == 0:
            return False
        while mask:
            newest += 1
            mask >>= 1
        if (source & 0xFFFF) + newest > tick:
            return False
        before = source
        raw += AHEAD
    return raw == end

cdef uint64_t uint64_at(const unsigned char* raw) noexcept:
    cdef uint64_t value = 0
    cdef int byte
    for byte in range(8):
        value |= <uint64_t>raw[byte] << 8 * byte
    return value

def advertised(list known, array.array freshest, bytearray inherent):
    """The whole table as a sequence of rows, in the order of `known`."""
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

def announce(bytearray inherent, int dst, int flags, double x, double y, double target_x, double target_y):
    """Write the inherent elements of `dst`; `x` and the others, in steps, are rounded and kept within 32 bits."""
    cdef unsigned char* raw = <unsigned char*>PyByteArray_AS_STRING(inherent) + dst * INHERENT
    cdef double[4] steps = [x, y, target_x, target_y]
    cdef int place, byte
    cdef int32_t value
    raw[0] = flags & 255
    raw[1] = flags >> 8
    for place in range(4):
        value = <int32_t>rint(min(max(steps[place], -FARTHEST), FARTHEST))
        for byte in range(4):
            raw[2 + 4 * place + byte] = value >> 8 * byte & 255

def search_robots(array.array next_hop, bytearray inherent, int me):
    """Destinations, ascending, that have a route and the class SR, without `me`."""
    cdef const char* said = PyByteArray_AS_STRING(inherent)
    cdef int dst
    found = []
    for dst in range(<int>len(next_hop)):
        if next_hop.data.as_shorts[dst] != -1 and dst != me and not said[dst * INHERENT] & 1:
            found.append(dst)
    return found

include "../bus/built.pxi"
