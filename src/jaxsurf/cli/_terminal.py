"""What the commands share: the application, the terminal, the progress bar."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cyclopts import App
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from jaxsurf import __version__

app = App(
    name="jaxsurf",
    help="How rough is a surface, and can the answer be believed?",
    version=__version__,
    suppress_keyboard_interrupt=False,  # `main` says what an interruption left behind
    result_action="return_value",
)
console = Console()
errors = Console(stderr=True)


def saver(figure: Any) -> Callable[[Path], None]:
    return lambda path: figure.savefig(path)


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[float, str], None]]:
    """A bar with the elapsed and the remaining time; yields a function (share, what comes next)."""
    bar = Progress(
        TextColumn("[bold]{task.fields[title]}[/]"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("[dim]{task.description}[/]"),
        console=errors,
        transient=True,
    )
    with bar:
        task = bar.add_task("starting", total=1.0, title=title)
        yield lambda share, text: bar.update(task, completed=share, description=text)
