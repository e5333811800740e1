import numpy as np
from numpy.typing import NDArray

def cast(
    free_cells: NDArray[np.bool_],
    cols: int,
    u: float,
    v: float,
    far: float,
    forward: NDArray[np.bool_],
    per_line: NDArray[np.float64],
    drift: NDArray[np.float64],
    counts: NDArray[np.int64],
    never: NDArray[np.bool_],
    resolution_m: float,
    range_m: float,
) -> NDArray[np.float64]: ...
