"""The station by hand: `python -m monitor_station --connect tcp/HOST:7447 --credentials FILE --out FOLDER`."""

from __future__ import annotations

from pathlib import Path

from setproctitle import setproctitle

from bus.command_line import parse, parser
from monitor_station.config import RecorderConfig, StationConfig
from monitor_station.process import run


def main(arguments: list[str] | None = None) -> None:
    """Run the station until the run ends."""
    made = parser("monitor_station", __doc__ or "")
    made.add_argument("--out", type=Path, default=Path(), help="folder for recording, journal and map")
    made.add_argument("--live", type=int, metavar="PORT", help="serve the recording to viewers on this port")
    options, handover = parse(made, arguments, config=StationConfig, recorder=RecorderConfig | None)
    entries = handover.entries
    options.out.mkdir(parents=True, exist_ok=True)
    setproctitle(f"vds station {handover.login.run}")
    run(entries["config"], handover.login, entries["recorder"], options.out, options.live)


if __name__ == "__main__":
    main()
