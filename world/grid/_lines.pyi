import numpy as np
from numpy.typing import NDArray

def crossed_by(
    walls: NDArray[np.bool_],
    cols: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    x_a: float,
    y_a: float,
    x_b: float,
    y_b: float,
) -> int: ...
def walls_crossed(
    walls: NDArray[np.bool_],
    cols: int,
    resolution_m: float,
    x0_m: float,
    y0_m: float,
    a_xy: NDArray[np.float64],
    b_xy: NDArray[np.float64],
) -> NDArray[np.int64]: ...
