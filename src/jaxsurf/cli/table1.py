"""`jaxsurf table1`: loop exponents of Gaussian surfaces, ours, the paper's and the theory's."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich import box
from rich.table import Table

from jaxsurf.cli._terminal import app, console, reproduce

SYMBOLS = {"2x_l": "2xₗ", "D_f": "D_f", "tau-2": "τ−2"}


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
    from jaxsurf.report.table1 import table1_figures

    defaults = Table1Settings()
    settings = Table1Settings(
        tuple(alphas or defaults.alphas),
        tuple(sorted(sizes or defaults.sizes)),
        surfaces,
        points,
        seed,
    )
    table, seconds = reproduce(
        "table1", "Table I", reproduce_table1, settings, table1_figures, "alpha={:g}/L={}", output
    )
    console.print(_table1_view(table))
    console.print(
        "Errors are statistical ± systematic (window); the last column is the distance from the "
        f"paper in combined standard errors. {seconds:.0f} s; "
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
