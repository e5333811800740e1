import numpy as np
from numpy.typing import NDArray

BLOCK: int

def met(
    rows: int,
    cols: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    x_m: float,
    y_m: float,
    ranges_m: NDArray[np.float64],
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
    range_m: float,
    into_wall_m: float,
) -> NDArray[np.int64]: ...
def unreached(
    which: NDArray[np.int64],
    cols: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    x_m: float,
    y_m: float,
    ranges_m: NDArray[np.float64],
    beams_per_radian: float,
) -> NDArray[np.int64]: ...
def passed(
    scores: NDArray[np.int32],
    opened: NDArray[np.uint8],
    rows: int,
    cols: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    x_m: float,
    y_m: float,
    ranges_m: NDArray[np.float64],
    beams_per_radian: float,
    hit: NDArray[np.int64],
    both: bool,
    miss: int,
    worth: int,
    settled: int,
) -> NDArray[np.int64]: ...
def weigh(
    scores: NDArray[np.int32],
    states: NDArray[np.int8],
    opened: NDArray[np.uint8],
    cols: int,
    which: NDArray[np.int64],
    evidence: int,
    worth: int,
    settled: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]: ...
def forget(
    scores: NDArray[np.int32],
    states: NDArray[np.int8],
    opened: NDArray[np.uint8],
    cols: int,
    which: NDArray[np.uint32],
    values: NDArray[np.int8],
    miss: int,
    worth: int,
) -> tuple[NDArray[np.int64], int]: ...
def tally(
    hits: NDArray[np.int32],
    misses: NDArray[np.int32],
    which: NDArray[np.uint32],
    values: NDArray[np.int8],
    odds: NDArray[np.int8],
    miss: int,
    worth: int,
    settled: int,
) -> NDArray[np.int64]: ...
def apply(
    odds: NDArray[np.int8],
    scores: NDArray[np.int32],
    states: NDArray[np.int8],
    opened: NDArray[np.uint8],
    cols: int,
    theirs: NDArray[np.uint32],
    values: NDArray[np.int8],
    worth: int,
) -> tuple[NDArray[np.int64], int]: ...
def carry_out(odds: NDArray[np.int8], changed: NDArray[np.uint32], values: NDArray[np.int8], settled: int) -> bool: ...
