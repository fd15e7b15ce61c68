"""`jaxsurf measure`: the roughness exponent of one height map by four measures."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich import box
from rich.table import Table

from jaxsurf.cli._terminal import app, console, saver


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
                **{f"{n}.png": saver(f) for n, f in measure_figures(measurement).items()},
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
