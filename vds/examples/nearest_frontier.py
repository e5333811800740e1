"""A policy of one's own: the paper's, but a search robot simply takes the nearest frontier."""

from __future__ import annotations

import numpy as np

from vds import Place, Policy


class NearestFrontier(Policy):
    """Greedy exploration (Yamauchi 1997): no utility, no regard for the targets of others."""

    def choose_target(self) -> Place | None:
        """The frontier with the shortest path; None if there is none."""
        body = self.body
        geometry = body.map.geometry
        cells = body.map.frontiers()
        reach = body.planner.reach(body.planner.nearest_free(geometry.index(*body.at)))
        lengths_m = reach.lengths_m(cells)
        if not np.isfinite(lengths_m).any():
            return None
        target = geometry.center(int(cells[np.argmin(lengths_m)]))
        self.to_target.take(body.tick, body.at, target, reach)
        return target
