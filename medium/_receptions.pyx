# cython: language_level=3
"""Packing and unpacking of receptions: the loops of `medium.messages.Inbox`.

Lengths and nodes are checked before anything is read.
"""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize, PyBytes_GET_SIZE
from cpython.ref cimport Py_INCREF
from cpython.tuple cimport PyTuple_New, PyTuple_SET_ITEM
from libc.stdint cimport uint16_t, uint32_t
from libc.string cimport memcpy


cdef packed struct Heard:
    uint16_t src
    double power_dbm
    uint32_t length

def pack_receptions(tuple receptions):
    """Pack receptions (source, power in dBm, payload), one after the other."""
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
    """Unpack the receptions in `data` from `start` on; None if they are not what `pack_receptions` packs."""
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


include "../bus/built.pxi"
