"""`jaxsurf table2`: the single-step growth model at three strengths of growth."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich import box
from rich.table import Table

from jaxsurf.cli._terminal import app, console, reproduce


@app.command
def table2(
    *,
    p_plus: Annotated[list[float] | None, Parameter(consume_multiple=True)] = None,
    sizes: Annotated[list[int] | None, Parameter(consume_multiple=True)] = None,
    quick: Annotated[bool, Parameter(negative=())] = False,
    equilibrate: int | None = None,
    measure: int | None = None,
    snapshots: int | None = None,
    replicas: int | None = None,
    points: int | None = None,
    scheme: str | None = None,
    seed: int = 0,
    output: Path = Path("table2"),
) -> None:
    """Reproduce the paper's Table II: surfaces of the single-step growth model.

    Parameters
    ----------
    p_plus:
        Chances of deposition. Default: 0.1 0.3 0.5.
    sizes:
        Even sides L of the maps; the largest gives the direct columns. Default: 32 64 128.
    quick:
        The whole path in about a minute, with short runs.
    equilibrate:
        Sweeps before the first look, at the largest size.
    measure:
        Sweeps during which the surfaces are looked at, at the largest size.
    snapshots:
        How many looks, a multiple of 10.
    replicas:
        Independent runs for each p_plus and size.
    points:
        Starting points of contour loops on each snapshot.
    scheme:
        "random-sequential" (the local rule), "paper" or "sublattice".
    seed:
        Of every random number: the same seed, the same table.
    output:
        Folder for the table (CSV, JSON), the curves (NPZ) and the pictures (PNG).
    """
    from jaxsurf.analysis.table2 import Table2Settings, reproduce_table2
    from jaxsurf.report.table2 import table2_figures

    given = {
        "p_plus": tuple(p_plus) if p_plus else None,
        "sizes": tuple(sorted(sizes)) if sizes else None,
        "equilibrate": equilibrate,
        "measure": measure,
        "snapshots": snapshots,
        "replicas": replicas,
        "points": points,
        "scheme": scheme,
    }
    base = Table2Settings.quick(seed) if quick else Table2Settings(seed=seed)
    settings = replace(base, **{name: v for name, v in given.items() if v is not None})
    table, seconds = reproduce(
        "table2",
        "Table II",
        reproduce_table2,
        settings,
        table2_figures,
        lambda table: {
            f"p_plus={p:g}/L={side}/{name}": curve
            for (p, side), named in table.curves.items()
            for name, curve in named.items()
        },
        output,
    )
    console.print(_view(table))
    console.print(
        "Errors are statistical ± systematic; the last column is the distance from the paper in "
        "combined standard errors, the paper's errors of α propagated anew. "
        f"{seconds:.0f} s; tables and pictures are in [bold]{output}[/].",
        highlight=False,
    )


def _view(table: Any) -> Table:
    settings = table.settings
    view = Table(
        title=f"Table II: L = {table.side}, {settings.replicas} runs × {settings.snapshots} looks",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    view.add_column("growth", no_wrap=True)
    view.add_column("", no_wrap=True)
    view.add_column("this run", justify="right", no_wrap=True)
    view.add_column("paper", justify="right", style="cyan", no_wrap=True)
    view.add_column("apart", justify="right", style="dim", no_wrap=True)
    for row in table.rows:
        columns = list(row.entries)
        for name, entry in row.entries.items():
            view.add_row(
                f"p₊ = {row.p_plus:g}" if name == columns[0] else "",
                name.replace("alpha", "α").replace("tau", "τ").replace("C2", "⟨C²⟩"),
                f"{entry.value:.3f} ± {entry.statistical:.3f} ± {entry.systematic:.3f}",
                f"{entry.paper[0]:g} ± {entry.paper[1]:.2g}" if entry.paper else "",
                f"{entry.pull:+.1f} σ" if entry.paper else "",
            )
        for name, (value, error) in (("skewness", row.skewness), ("kurtosis", row.kurtosis)):
            view.add_row(
                "", f"{name} of h", f"{value:+.3f} ± {error:.3f}", end_section=name == "kurtosis"
            )
    return view
