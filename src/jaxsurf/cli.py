"""The command line: `jaxsurf table1`, `jaxsurf measure`."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

try:
    from cyclopts import App, Parameter
    from rich import box
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.table import Table
except ModuleNotFoundError as missing:
    raise SystemExit(
        f"The command line needs {missing.name}, which is not installed. "
        "Install it by: pip install 'jaxsurf[cli]'"
    ) from missing

from jaxsurf import __version__

app = App(
    name="jaxsurf",
    help="How rough is a surface, and can the answer be believed?",
    version=__version__,
    suppress_keyboard_interrupt=False,  # `main` says what an interruption left behind
)
console = Console()
errors = Console(stderr=True)

SYMBOLS = {"2x_l": "2xₗ", "D_f": "D_f", "tau-2": "τ−2"}


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


@app.command
def table1(
    *,
    alphas: Annotated[list[float] | None, Parameter(consume_multiple=True)] = None,
    sizes: Annotated[list[int] | None, Parameter(consume_multiple=True)] = None,
    surfaces: int = 25,
    points: int = 400,
    seed: int = 0,
    output: Path = Path("table1"),
) -> None:
    """Reproduce the direct columns of the paper's Table I, with the theory beside them.

    Parameters
    ----------
    alphas:
        Roughness exponents; -1 is white noise. Default: 0 0.2 0.4 0.6 0.8 1 -1.
    sizes:
        Sides L of the maps; the largest gives the direct exponents, the curves of all are kept.
        Default: 64 128 256 512.
    surfaces:
        Surfaces for each alpha and size.
    points:
        Starting points of contour loops on each surface.
    seed:
        Of every random number: the same seed, the same table.
    output:
        Folder for the table (CSV, JSON), the curves (NPZ) and the pictures (PNG).
    """
    from jaxsurf.analysis.table1 import Table1Settings, reproduce_table1

    defaults = Table1Settings()
    settings = Table1Settings(
        tuple(alphas or defaults.alphas),
        tuple(sorted(sizes or defaults.sizes)),
        surfaces,
        points,
        seed,
    )
    started = time.perf_counter()
    with _progress("Table I") as report:
        table = reproduce_table1(settings, progress=report)
        report(1.0, "drawing the pictures")
        from jaxsurf.report.folder import write_csv, write_curves, write_folder, write_json
        from jaxsurf.report.table1 import table1_figures

        elapsed = time.perf_counter() - started
        curves = {
            f"alpha={alpha:g}/L={size}/{kind}": curve
            for (alpha, size), kinds in table.curves.items()
            for kind, curve in kinds.items()
        }
        write_folder(
            output,
            {
                "table1.csv": write_csv(table.to_rows()),
                "table1.json": write_json(table.to_dict() | {"seconds": elapsed}),
                "curves.npz": write_curves(curves),
                **{f"{n}.png": _saver(f) for n, f in table1_figures(table).items()},
            },
        )
    console.print(_table1_view(table))
    console.print(
        "Errors are statistical ± systematic (window); the last column is the distance from the "
        f"paper in combined standard errors. {time.perf_counter() - started:.0f} s; "
        f"tables and pictures are in [bold]{output}[/].",
        highlight=False,
    )


def _table1_view(table: Any) -> Table:
    from jaxsurf.analysis.table1 import EXPONENTS, name_of

    settings = table.settings
    view = Table(
        title=f"Table I, direct: L = {table.side}, {settings.surfaces} surfaces × "
        f"{settings.points} points",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    view.add_column("surface", no_wrap=True)
    view.add_column("", no_wrap=True)
    view.add_column("this run", justify="right", no_wrap=True)
    view.add_column("paper", justify="right", style="cyan", no_wrap=True)
    view.add_column("theory", justify="right", style="green", no_wrap=True)
    view.add_column("apart", justify="right", style="dim", no_wrap=True)
    for row in table.rows:
        for name in EXPONENTS:
            statistical, systematic = row.errors(name)
            quoted = row.paper.get(name)
            view.add_row(
                name_of(row.alpha) if name == next(iter(EXPONENTS)) else "",
                SYMBOLS[name],
                f"{row.value(name):.3f} ± {statistical:.3f} ± {systematic:.3f}",
                f"{quoted[0]:g} ± {quoted[1]:g}" if quoted else "",
                f"{row.theory[name]:.3f}",
                f"{row.pull(name):+.1f} σ" if quoted else "",
                end_section=name == list(EXPONENTS)[-1],
            )
    return view


@app.command
def measure(
    file: Path | None = None,
    /,
    *,
    demo: Annotated[bool, Parameter(negative=())] = False,
    spacing: float | None = None,
    unit: str | None = None,
    height_unit: str | None = None,
    points: int = 1000,
    seed: int = 0,
    output: Path = Path("measure"),
) -> None:
    """Measure the roughness exponent of one height map by four independent measures.

    Parameters
    ----------
    file:
        The map: .npy, .npz, or a table of numbers (.csv, .txt, .dat).
    demo:
        Take matplotlib's sample landscape instead of a file.
    spacing:
        Distance between neighbouring sites, if the file does not say it.
    unit:
        Unit of the spacing.
    height_unit:
        Unit of the heights.
    points:
        Starting points of contour loops.
    seed:
        Of the starting points.
    output:
        Folder for the results (JSON), the curves (NPZ) and the pictures (PNG).
    """
    from dataclasses import replace

    from jaxsurf.analysis.measure import measure_map
    from jaxsurf.io.readers import read_heights
    from jaxsurf.report.folder import write_curves, write_folder, write_json
    from jaxsurf.report.measure import demo_map, measure_figures

    if (file is None) != demo:
        raise ValueError(
            f"measure takes a FILE or --demo; got {'both' if demo else 'neither'}. "
            "Try `jaxsurf measure --demo`."
        )
    surface = demo_map() if file is None else read_heights(file)
    given = {"spacing": spacing, "length_unit": unit, "height_unit": height_unit}
    surface = replace(surface, **{k: v for k, v in given.items() if v is not None})
    with console.status("measuring"):
        measurement = measure_map(surface, points=points, seed=seed)
        write_folder(
            output,
            {
                "measure.json": write_json(measurement.to_dict()),
                "curves.npz": write_curves(measurement.curves),
                **{f"{n}.png": _saver(f) for n, f in measure_figures(measurement).items()},
            },
        )
    console.print(repr(measurement.surface), highlight=False)
    view = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("measure", "slope", "window", "α"):
        view.add_column(heading, justify="left" if heading == "measure" else "right")
    for name, road in measurement.roads.items():
        low, high = road.fit.details["window"]
        scale_unit = road.fit.details["units"][0]
        view.add_row(
            name,
            f"{road.slope[0]:.3f}",
            f"{low:.3g}–{high:.3g} {scale_unit}",
            f"{road.alpha[0]:.2f} ± {road.alpha[1]:.2f} ± {road.alpha[2]:.2f}",
        )
    console.print(view)
    for note in measurement.notes:
        console.print(f"Note: {note}.", highlight=False)
    console.print(
        f"Errors are statistical (between quarters of the map) ± systematic (window). "
        f"{measurement.share_open:.0%} of the loops leave the map and were set aside. "
        f"Results and pictures are in [bold]{output}[/].",
        highlight=False,
    )


def _saver(figure: Any) -> Callable[[Path], None]:
    return lambda path: figure.savefig(path)


@contextmanager
def _progress(title: str) -> Iterator[Callable[[float, str], None]]:
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


if __name__ == "__main__":
    main()
