"""Write tests/vectors and the tables of docs/wire.md: `python -m tests.wire`."""

from __future__ import annotations

import sys

from tests.wire import page, vectors


def main() -> int:
    """Write them; 2 if an encoding has changed and its version has not."""
    try:
        for message in vectors.ALL:
            message.write()
    except ValueError as error:
        print(f"tests.wire: {error}", file=sys.stderr)
        return 2
    page.PAGE.write_text(page.filled(page.PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
