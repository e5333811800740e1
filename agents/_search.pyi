import numpy as np
from numpy.typing import NDArray

def lengths(
    cells: NDArray[np.int8], cols: int, resolution_m: float, source: int, limit_m: float, until: int
) -> NDArray[np.float64]: ...
def path(lengths_m: NDArray[np.float64], rows: int, cols: int, resolution_m: float, cell: int) -> list[int]: ...
def length_near(
    lengths_m: NDArray[np.float64],
    rows: int,
    cols: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    x_m: float,
    y_m: float,
    index: int,
) -> float: ...
