import numpy as np
from numpy.typing import NDArray

def lengthen(
    cells: NDArray[np.int8],
    cols: int,
    resolution_m: float,
    seeds: NDArray[np.int64],
    limit_m: float,
    until: int,
    lengths_m: NDArray[np.float64],
) -> None: ...
def path(lengths_m: NDArray[np.float64], cols: int, resolution_m: float, cell: int) -> list[int]: ...
def reached_blocks(lengths_m: NDArray[np.float64], rows: int, cols: int) -> NDArray[np.int64]: ...
def length_near(
    lengths_m: NDArray[np.float64],
    rows: int,
    cols: int,
    blocks: NDArray[np.int64],
    first_row: int,
    first_col: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    x_m: float,
    y_m: float,
) -> float: ...
