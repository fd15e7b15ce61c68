"""The command line: one file a command, registered by being imported here."""

import sys
from collections.abc import Sequence

try:
    import cyclopts as cyclopts
    import rich as rich
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"The command line needs {missing.name}, which is not installed. "
        "Install it by: pip install 'jaxsurf[cli]'"
    ) from missing

from jaxsurf.cli import crossover as crossover
from jaxsurf.cli import growth as growth
from jaxsurf.cli import measure as measure
from jaxsurf.cli import table1 as table1
from jaxsurf.cli import table2 as table2
from jaxsurf.cli._terminal import app, errors


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line; a user's mistake is one red line, an interruption another.

    Arguments:
        words: the command and its options; those of the process if None.
    """
    try:
        app(sys.argv[1:] if words is None else list(words))
    except KeyboardInterrupt:
        errors.print("[yellow]Interrupted: nothing was written, earlier results are untouched.[/]")
        sys.exit(130)
    except (ValueError, TypeError, OSError) as error:
        errors.print(f"[bold red]Error:[/] {error}", highlight=False)
        sys.exit(2)
