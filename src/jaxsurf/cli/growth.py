"""`jaxsurf growth`: how a surface roughens with time, and its loops beyond xi(t)."""

from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from jaxsurf.cli._terminal import app, console, reproduce

NAMES = {"mean_length": "D_f", "length_tail": "-(τ−2)", "loop_correlation": "-2xₗ"}


@app.command
def growth(
    *,
    model: str = "single-step",
    p_plus: float = 0.1,
    side: int = 512,
    last: int = 256,
    first: int = 8,
    replicas: int = 8,
    points: int = 2000,
    scheme: str = "random-sequential",
    seed: int = 0,
    output: Path = Path("growth"),
) -> None:
    """Grow surfaces from flat: width, spectra and xi(t) in time, percolation beyond xi(t).

    Parameters
    ----------
    model:
        "single-step", or a control whose exponents are exact: "edwards-wilkinson" (α = 0, z = 2),
        "mullins-herring" (α = 1, z = 4).
    p_plus:
        Chance of deposition of the single-step model.
    side:
        L of the maps.
    last:
        The last time, a power of 2; the surfaces are looked at at 1, 2, 4, ..., last.
    first:
        The first time that the exponents are fitted to.
    replicas:
        Independent surfaces.
    points:
        Starting points of contour loops on each snapshot.
    scheme:
        Of updates of the single-step model: "random-sequential", "paper" or "sublattice".
    seed:
        Of every random number.
    output:
        Folder for the results (CSV, JSON), the curves (NPZ) and the pictures (PNG).
    """
    from jaxsurf.analysis.growth_in_time import GrowthSettings, reproduce_growth
    from jaxsurf.report.growth import growth_figures

    settings = GrowthSettings(
        model, p_plus, side, last, first, replicas, points, scheme=scheme, seed=seed
    )
    result, seconds = reproduce(
        "growth", "Growth", reproduce_growth, settings, growth_figures, _curves, output
    )
    console.print(_exponents(result))
    if result.beyond:
        console.print(_beyond(result))
    console.print(
        "Errors are statistical ± systematic. Beyond ξ(t) loops are hulls of percolation clusters, "
        f"as those of white noise on a map of this size are. {seconds:.0f} s; results and pictures "
        f"are in [bold]{output}[/].",
        highlight=False,
    )


def _curves(result: Any) -> dict[str, Any]:
    scaling = result.scaling
    return {
        "width": scaling.width,
        "width_increments": scaling.increments,
        "skewness": result.skewness,
        "kurtosis": result.kurtosis,
        **{f"t={time:g}/spectrum": curve for time, curve in scaling.spectra.items()},
        **{
            f"t={time:g}/{kind}": curve
            for time, kinds in result.loops.items()
            for kind, curve in kinds.items()
        },
        **{f"white_noise/{kind}": curve for kind, curve in result.white_noise.items()},
    }


def _exponents(result: Any) -> Table:
    settings = result.settings
    model = settings.model
    if model == "single-step":
        model += f", p₊ = {settings.p_plus:g}"
    view = Table(
        title=f"{model}: L = {settings.side}, t = {settings.first} to {settings.last}",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    view.add_column("exponent", no_wrap=True)
    view.add_column("this run", justify="right", no_wrap=True)
    names = {
        "alpha": "α (collapse of S)",
        "z": "z (collapse of S)",
        "beta": "β = α/z",
        "beta of the width": "β of w²(2t) − w²(t)",
    }
    for name, text in names.items():
        view.add_row(text, _with_errors(result.scaling.exponents[name]))
    for name in ("skewness", "kurtosis"):
        curve = getattr(result, name)
        value, error = float(curve.mean[-1]), float(curve.stderr[-1])
        view.add_row(f"{name} of h at t = {settings.last}", f"{value:+.3f} ± {error:.3f}")
    return view


def _beyond(result: Any) -> Table:
    from jaxsurf.analysis.growth_in_time import PERCOLATION

    view = Table(title="Loops beyond ξ(t)", box=box.SIMPLE_HEAD, pad_edge=False)
    view.add_column("", no_wrap=True)
    view.add_column("slope", no_wrap=True)
    for heading in ("this run", "white noise", "percolation"):
        view.add_column(heading, justify="right", no_wrap=True)
    for time, kinds in result.beyond.items():
        for number, (kind, (grown, white)) in enumerate(kinds.items()):
            view.add_row(
                "" if number else f"t = {time:g}",
                NAMES[kind],
                _with_errors(grown),
                _with_errors(white),
                f"{PERCOLATION[kind]:.3f}",
                end_section=number == len(kinds) - 1,
            )
    return view


def _with_errors(values: tuple[float, float, float]) -> str:
    value, statistical, systematic = values
    return f"{value:.3f} ± {statistical:.3f} ± {systematic:.3f}"
