"""The table behind `fit_loops`, and how good its alpha is.

    python benchmarks/likelihood_loops.py table [--sides 64 128 256 512] [--boundary open]
    python benchmarks/likelihood_loops.py check [--sides 512] [--surfaces 100] [--boundary open]

`table` simulates sizes anew and puts them in the shipped table. `check` prints bias, root mean
square error and coverage at each alpha, over maps that the table has not seen; the control is the
slope inverted by the theory, alpha = 3 - 2 D_f.
"""

import argparse
import csv
from pathlib import Path

import jax
import numpy as np

import jaxsurf as js
from jaxsurf.analysis import fit_loops as room

TABLE = Path(room.__file__).parent / "tables" / room.SHIPPED


def table(sides, boundary):
    for side in sides:
        new = room.simulate_statistics(side, boundary)
        old = list(csv.DictReader(TABLE.open())) if TABLE.exists() else []
        kept = [row for row in old if (row["boundary"], int(row["side"])) != (boundary, side)]
        rows = kept + new
        rows.sort(key=lambda row: (row["boundary"], int(row["side"]), float(row["alpha"])))
        room.write_table(TABLE, rows)
        print(f"L = {side}, {boundary}, done", flush=True)


def check(sides, boundary, surfaces):
    for side in sides:
        wide = side * (room.SURROUND if boundary == "open" else 1)
        for alpha in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
            fits, without = [], 0
            for i in range(surfaces):
                key = jax.random.fold_in(jax.random.key(12345), i)
                heights = js.sample(js.SelfAffine(alpha), (wide, wide), key=key)
                cut = np.asarray(heights)[:side, :side]
                found = room.loop_statistics(cut[None], boundary=boundary, rng=10**6 + i)
                if np.isnan(found).any():  # fit_loops says so; the table leaves them out as well
                    without += 1
                    continue
                fits.append(room.fit_loops(cut, boundary=boundary, rng=10**6 + i))
            value = np.array([fit.values["alpha"] for fit in fits])
            error = np.array([fit.total_error("alpha") for fit in fits])
            line = np.array([3 - 2 * fit.details["slope"] for fit in fits])
            chi2 = np.mean([fit.chi2 for fit in fits])
            print(
                f"L = {side}, {boundary}, alpha = {alpha}: bias {value.mean() - alpha:+.4f} +- "
                f"{value.std() / np.sqrt(len(fits)):.4f}, rmse "
                f"{np.sqrt(np.mean((value - alpha) ** 2)):.4f}, quoted {error.mean():.4f}, 68 % "
                f"hold {100 * np.mean(np.abs(value - alpha) < error):.0f}, chi2 {chi2:.2f} / "
                f"{fits[0].dof}, rejected {sum(not fit.converged for fit in fits)}, "
                f"without loops {without}; control "
                f"3 - 2 slope: bias {line.mean() - alpha:+.3f}",
                flush=True,
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["table", "check"])
    parser.add_argument("--sides", type=int, nargs="+")
    parser.add_argument("--surfaces", type=int, default=100)
    parser.add_argument("--boundary", choices=room.BOUNDARIES, default="periodic")
    a = parser.parse_args()
    if a.what == "table":
        table(a.sides or [64, 128, 256, 512], a.boundary)
    else:
        check(a.sides or [512], a.boundary, a.surfaces)


if __name__ == "__main__":
    main()
