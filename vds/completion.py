"""Completion of the command `vds` in a shell: `eval "$(vds completion bash)"` in ~/.bashrc."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deploy.command import Parser


def parser() -> Parser:
    """The command line."""
    from deploy.command import Parser, name_of

    p = Parser(
        prog=name_of("completion"),
        description="Print the script by which a shell completes this command: put "
        '`eval "$(vds completion bash)"` into ~/.bashrc, or `vds completion zsh > DIR/_vds` for a DIR of zsh\'s fpath.',
    )
    p.add_argument("shell", choices=["bash", "zsh", "tcsh"])
    return p


def main(arguments: list[str] | None = None) -> int:
    """Print the script; returns the exit status."""
    from deploy.command import refuse, way_to_extra
    from vds import __main__

    options = parser().parse_args(arguments)
    try:
        import shtab
    except ImportError:
        return refuse("completion", f"this needs the package shtab: {way_to_extra('completion')}")
    print(shtab.complete(__main__.parser(), shell=options.shell))
    return 0
