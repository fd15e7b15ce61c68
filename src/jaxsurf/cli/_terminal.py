"""What the commands share: the application, the terminal, the progress bar."""

import time
from collections.abc import Callable, Iterator, Mapping
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


def reproduce(
    name: str,
    title: str,
    compute: Callable[..., Any],
    settings: Any,
    figures: Callable[[Any], Mapping[str, Any]],
    curves: Callable[[Any], Mapping[str, Any]],
    output: Path,
) -> tuple[Any, float]:
    """Compute one of the paper's tables under a progress bar and write all that belongs to it.

    Arguments:
        name: of the files: name.csv, name.json, name_curves.npz.
        title: of the progress bar.
        compute: settings, progress -> the table.
        settings: what to compute.
        figures: table -> file name -> figure.
        curves: table -> name -> curve, all that were measured.
        output: the folder.

    Returns:
        The table and the seconds it took.
    """
    from jaxsurf.report.folder import write_csv, write_curves, write_folder, write_json

    started = time.perf_counter()
    with progress_bar(title) as report:
        table = compute(settings, progress=report)
        report(1.0, "drawing the pictures")
        seconds = time.perf_counter() - started
        write_folder(
            output,
            {
                f"{name}.csv": write_csv(table.to_rows()),
                f"{name}.json": write_json(table.to_dict() | {"seconds": seconds}),
                f"{name}_curves.npz": write_curves(curves(table)),
                **{f"{file}.png": saver(figure) for file, figure in figures(table).items()},
            },
        )
    return table, seconds
