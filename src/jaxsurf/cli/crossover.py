"""`jaxsurf crossover`: surfaces with a correlation length, and the knee in four measures."""

from pathlib import Path

from rich import box
from rich.table import Table

from jaxsurf.cli._terminal import app, console, reproduce

NAMES = {
    "curvature_moment": "⟨C²⟩(b)",
    "mean_length": "⟨s⟩(R)",
    "length_tail": "P>(s)",
    "loop_correlation": "G(r)",
}


@app.command
def crossover(
    *,
    alpha: float = 0.4,
    cutoff: float = 16.0,
    side: int = 512,
    surfaces: int = 25,
    points: int = 400,
    seed: int = 0,
    output: Path = Path("crossover"),
) -> None:
    """Reproduce the paper's Fig. 11: the crossover from self-affine to percolation scaling.

    Parameters
    ----------
    alpha:
        Roughness exponent.
    cutoff:
        xi_q, in sites: the spectrum is flat below pi/xi_q.
    side:
        L of the maps.
    surfaces:
        Surfaces with and without the cutoff.
    points:
        Starting points of contour loops on each surface.
    seed:
        Of every random number.
    output:
        Folder for the results (CSV, JSON), the curves (NPZ) and the picture (PNG).
    """
    from jaxsurf.analysis.crossover import CrossoverSettings, reproduce_crossover
    from jaxsurf.report.crossover import crossover_figures

    result, seconds = reproduce(
        "crossover",
        "Fig. 11",
        reproduce_crossover,
        CrossoverSettings(alpha, cutoff, side, surfaces, points, seed=seed),
        crossover_figures,
        lambda result: {
            f"{name}/{kind}": curve
            for name, kinds in result.curves.items()
            for kind, curve in kinds.items()
        },
        output,
    )
    view = Table(
        title=f"Knees at α = {alpha:g}, ξ_q = {cutoff:g}, L = {side}",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    view.add_column("measure", no_wrap=True)
    for heading in ("ξ", "slope beyond", "percolation"):
        view.add_column(heading, justify="right", no_wrap=True)
    for record in result.to_rows():
        beyond = "exponent beyond" in record
        view.add_row(
            NAMES[record["measure"]],
            f"{record['xi']:.2f} ± {record['xi statistical']:.2f} ± {record['xi systematic']:.2f}",
            f"{record['exponent beyond']:.3f} ± {record['statistical']:.3f} ± "
            f"{record['systematic']:.3f}"
            if beyond
            else "",
            f"{record['percolation']:.3f}" if beyond else "",
        )
    console.print(view)
    joint, (chi2, dof) = result.joint, result.agreement
    console.print(
        f"All measures together: α = {joint.values['alpha']:.3f} ± "
        f"{joint.total_error('alpha'):.3f}, ξ = {joint.values['xi']:.2f} ± "
        f"{joint.total_error('xi'):.2f}. That the four ξ are one: χ² = {chi2:.1f} / {dof}. "
        f"Errors are statistical ± systematic. {seconds:.0f} s; results and picture are in "
        f"[bold]{output}[/].",
        highlight=False,
    )
