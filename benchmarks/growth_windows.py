"""Why D_f direct of Table II lies below the paper's: the window, the dither, or what R counts?

    python benchmarks/growth_windows.py [--p-plus 0.1 0.3 0.5] [--side 128] [--looks 25]

Loops of the single-step model through random points, and the slope of <s>(R) over several windows:
with R the larger extent of a loop, as here; with R + 1, the sites that the covering box counts; and
with heights dithered by noise of up to most of a step. The paper has 1.38(1), 1.47(1), 1.51(2).
"""

import argparse
import dataclasses

import jax
import numpy as np

import jaxsurf as js
from jaxsurf.analysis.snapshots import pool_snapshots
from jaxsurf.analysis.table2 import paper_entry

WINDOWS = ((3, 30), (5, 64), (10, 40), (10, 100), (20, 64), (30, 100))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--p-plus", type=float, nargs="+", default=[0.1, 0.3, 0.5])
    parser.add_argument("--side", type=int, default=128)
    parser.add_argument("--replicas", type=int, default=8)
    parser.add_argument("--looks", type=int, default=25)
    parser.add_argument("--points", type=int, default=100)
    options = parser.parse_args()
    side, every = options.side, options.side**2 // 400
    for p_plus in options.p_plus:
        heights = np.asarray(
            js.grow_single_step(
                (side, side),
                p_plus=p_plus,
                sweeps=every * (options.looks + 15),
                batch=options.replicas,
                snapshots=every * np.arange(16, options.looks + 16),
                key=jax.random.key(1),
            )
        ).reshape(-1, side, side)
        print(f"p_plus = {p_plus:g}: paper {paper_entry(p_plus, 'D_f direct')}; windows {WINDOWS}")
        loops = js.trace_loops(heights, options.points, rng=1)
        rows = {
            "R": loops,
            "R + 1": dataclasses.replace(loops, radius=loops.radius + 1),
        }
        noise = np.random.default_rng(2).standard_normal(heights.shape)
        for dither in (0.1, 0.3, 0.5, 0.7):
            near = heights - heights[:, :1, :1] + dither * noise
            rows[f"dither {dither:g}"] = js.trace_loops(near, options.points, rng=1)
        for name, found in rows.items():
            curve = pool_snapshots(found.mean_length(), options.replicas)
            fits = [
                js.fit_power_law(curve, window=window, weighting="equal", draws=50)
                for window in WINDOWS
            ]
            slopes = " ".join(
                f"{fit.values['exponent']:.3f}({1e3 * fit.stderr['exponent']:.0f})" for fit in fits
            )
            print(f"  {name:10s} {slopes}", flush=True)


if __name__ == "__main__":
    main()
