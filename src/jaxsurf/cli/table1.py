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
    fss: Annotated[bool, Parameter(negative=())] = False,
    fss_sizes: Annotated[list[int] | None, Parameter(consume_multiple=True)] = None,
    fss_sites: int | None = None,
    fss_same: Annotated[bool, Parameter(negative=())] = False,
    output: Path = Path("table1"),
) -> None:
    """Reproduce the paper's Table I: direct exponents, on request finite-size scaling, and theory.

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
    fss:
        Also the FSS columns, from collapses of whole level sets of several sizes: 14 minutes.
    fss_sizes:
        Their sizes. Default: 64 128 256 512 1024 2048.
    fss_sites:
        Sites of all maps of one size together. Default: 67108864.
    fss_same:
        The FSS columns from the curves of the direct table instead: the paper's sizes and
        statistics, a minute.
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
        "table1",
        "Table I",
        reproduce_table1,
        settings,
        table1_figures,
        lambda table: {
            f"alpha={alpha:g}/L={side}/{kind}": curve
            for (alpha, side), kinds in table.curves.items()
            for kind, curve in kinds.items()
        },
        output,
    )
    title = f"Table I, direct: L = {table.side}, {surfaces} surfaces × {points} points"
    console.print(_view(table.rows, title, "paper"))
    console.print(
        "Errors are statistical ± systematic (window); the last column is the distance from the "
        f"paper in combined standard errors. {seconds:.0f} s; "
        f"tables and pictures are in [bold]{output}[/].",
        highlight=False,
    )
    if fss_same:
        from jaxsurf.analysis.finite_size import collapse_table1

        _finite_size(collapse_table1, table, output)
    elif fss or fss_sizes or fss_sites:
        from jaxsurf.analysis.finite_size import FiniteSizeSettings, reproduce_finite_size

        given = {
            "alphas": tuple(alpha for alpha in settings.alphas if alpha >= 0),
            "sizes": tuple(sorted(fss_sizes)) if fss_sizes else None,
            "sites": fss_sites,
            "seed": seed,
        }
        chosen = FiniteSizeSettings(**{name: v for name, v in given.items() if v is not None})
        _finite_size(reproduce_finite_size, chosen, output)


def _finite_size(compute: Any, given: Any, output: Path) -> None:
    """The FSS columns: a function of settings, or of the direct table, with its argument."""
    from jaxsurf.analysis.table1 import name_of
    from jaxsurf.report.collapse import finite_size_figures

    table, seconds = reproduce(
        "fss",
        "Table I, FSS",
        compute,
        given,
        finite_size_figures,
        lambda table: {
            f"alpha={alpha:g}/L={side}/{kind}": curve
            for alpha, kinds in table.curves.items()
            for kind, sides in kinds.items()
            for side, curve in sides.items()
        },
        output,
    )
    sides = sorted(table.curves[table.rows[0].alpha]["mean_length"])
    title = f"Table I, FSS: L = {sides[0]} to {sides[-1]}"
    console.print(_view(table.rows, title, "theory"))
    relations = Table(title="Scaling relations, left less right", box=box.SIMPLE_HEAD)
    relations.add_column("surface", no_wrap=True)
    for name in ("D_f(τ−1) = 2−α", "D_f(3−τ) = 2−2xₗ"):
        relations.add_column(name, justify="right", no_wrap=True)
    for row in table.rows:
        closes = [f"{value:+.3f} ± {error:.3f}" for value, error in row.relations().values()]
        relations.add_row(name_of(row.alpha), *closes)
    console.print(relations)
    nearer = [row.nearer(name) for row in table.rows for name in SYMBOLS]
    console.print(
        "Errors are statistical ± systematic (sizes, scales); the last column is the distance "
        "from theory, which takes 2xₗ = 1 for granted; the scaling relations do not. "
        f"{nearer.count(True)} of {len(nearer) - nearer.count(None)} values are "
        f"nearer to theory than the paper's. {seconds:.0f} s.",
        highlight=False,
    )


def _view(rows: Any, title: str, apart_from: str) -> Table:
    from jaxsurf.analysis.table1 import name_of

    view = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False)
    view.add_column("surface", no_wrap=True)
    view.add_column("", no_wrap=True)
    view.add_column("this run", justify="right", no_wrap=True)
    view.add_column("paper", justify="right", style="cyan", no_wrap=True)
    view.add_column("theory", justify="right", style="green", no_wrap=True)
    view.add_column("apart", justify="right", style="dim", no_wrap=True)
    for row in rows:
        for name, symbol in SYMBOLS.items():
            statistical, systematic = row.errors(name)
            quoted = row.paper.get(name)
            view.add_row(
                name_of(row.alpha) if name == "2x_l" else "",
                symbol,
                f"{row.value(name):.3f} ± {statistical:.3f} ± {systematic:.3f}",
                f"{quoted[0]:g} ± {quoted[1]:g}" if quoted else "",
                f"{row.theory[name]:.3f}",
                f"{row.pull(name):+.1f} σ" if quoted or apart_from == "theory" else "",
                end_section=name == "tau-2",
            )
    return view
