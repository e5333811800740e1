"""The file of a recording, and on demand a live view of it.

The number of chunks, not of values, sets a recording's size and cost. So what comes often waits in `Rows`, and many
rows are sent as columns of one chunk.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain as joined
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from monitor_station.config import RecorderConfig
from monitor_station.recording import blueprint
from monitor_station.recording.pipe_file import PipeFile

__all__ = ["Rows", "Stream"]

_TICK_NS: Final = 100_000_000
_BATCH_S: Final = 1.8
"""Wall time after which logged values are sent: a crash may lose two seconds."""


class Rows:
    """Rows of one entity that wait to be sent; each is a tick and a value."""

    def __init__(self) -> None:
        self.ticks: list[int] = []
        self.values: list[Any] = []

    def add(self, tick: int, value: Any) -> None:
        self.ticks.append(tick)
        self.values.append(value)

    def clear(self) -> None:
        self.ticks.clear()
        self.values.clear()

    def joined(self) -> NDArray[Any]:
        """The values of all rows, which are arrays, one after the other."""
        return np.concatenate(self.values)

    @property
    def lengths(self) -> list[int]:
        """Number of elements of each row's value."""
        return [len(value) for value in self.values]


class Stream:
    """One recording under way. All calls must come from one thread."""

    def __init__(self, config: RecorderConfig, path: Path, live_port: int | None) -> None:
        """Open the file; serve it on `live_port` of the loopback interface, too, unless that is None.

        Raises:
            OSError: the file cannot be written.
        """
        self._file = PipeFile(path)
        self._rec = rr.RecordingStream(
            "vds",
            recording_id=config.recording_id or None,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=_BATCH_S, flush_num_bytes=8 << 20),
        )
        self._rec.set_log_time_enabled(False)
        self._rec.set_log_tick_enabled(False)
        sinks: list[Any] = [rr.FileSink(self._file.entrance)]
        if live_port is not None:
            sinks.append(rr.GrpcServerSink(bind_ip="127.0.0.1", port=live_port, server_memory_limit="512MiB"))
        self._rec.set_sinks(*sinks, default_blueprint=blueprint.build(config))
        self._rec.send_recording_name(config.run)
        self._tick = -1
        """Tick of the last logged value."""

    def log_static(self, path: str, *what: Any) -> None:
        """Log what never changes."""
        self._rec.log(path, *what, static=True)

    def log(self, tick: int, path: str, *what: Any) -> None:
        """Log what changes rarely, at its exact tick."""
        if tick != self._tick:
            self._tick = tick
            self._rec.set_time("tick", sequence=tick)
            self._rec.set_time("sim_time", duration=np.timedelta64(tick * _TICK_NS, "ns"))
        self._rec.log(path, *what)

    def send(
        self,
        path: str,
        rows: Rows,
        columns: rr.ComponentColumnList,
        *more: rr.ComponentColumnList,
        lengths: Sequence[int] | None = None,
    ) -> None:
        """Send rows as one chunk and forget them.

        Args:
            path: of the entity.
            rows: for their ticks; at least one.
            columns: the values of all rows one after the other.
            more: further columns, already cut into rows.
            lengths: how many values of `columns` each row has; None: `rows.lengths`.
        """
        numbers = np.array(rows.ticks, np.int64)
        times = (
            rr.TimeColumn("tick", sequence=numbers),
            rr.TimeColumn("sim_time", duration=(numbers * _TICK_NS).astype("timedelta64[ns]")),
        )
        cut = columns.partition(rows.lengths if lengths is None else lengths)
        rr.send_columns(path, times, joined(cut, *more), recording=self._rec)
        rows.clear()

    def close(self) -> None:
        """Write the file's footer.

        Raises:
            OSError: not all of the file could be written.
        """
        self._rec.flush()
        self._rec.disconnect()
        self._file.close()
