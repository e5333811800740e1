# The end of every file of compiled loops: it is not used when it was built from another text than the one beside it.
cdef extern from *:
    """
    #define VDS_TEXT(digest) VDS_QUOTED(digest)
    #define VDS_QUOTED(digest) #digest
    """
    const char* VDS_SOURCE_SHA256 "VDS_TEXT(VDS_SOURCE)"

from bus.built import check

check(__name__, VDS_SOURCE_SHA256.decode())
