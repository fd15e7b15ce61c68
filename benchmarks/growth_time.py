"""Growth in time: alpha, beta and z of the single-step model, and percolation beyond xi(t).

    python benchmarks/growth_time.py [--side 256] [--last 11] [--replicas 8] [--p-plus 0.1]

Grows from flat, looks at t = 1, 2, 4, ..., 2^last, and prints the exponents of the collapse in
time, beta of the width, xi(t), and the loop exponents beyond 4 pi t^(1/z) at the earliest times,
where heights are independent and percolation's D_f = 7/4, tau - 2 = 4/7, 2 x_l = 5/4 are due.
"""

import argparse
import time

import jax
import numpy as np

import jaxsurf as js
from jaxsurf.analysis.time_scaling import loops_in_time, scale_in_time

KINDS = {"mean_length": 7 / 4, "length_tail": -4 / 7, "loop_correlation": -5 / 4}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=256)
    parser.add_argument("--last", type=int, default=11, help="log2 of the last time")
    parser.add_argument("--first", type=int, default=4, help="log2 of the first time fitted")
    parser.add_argument("--replicas", type=int, default=8)
    parser.add_argument("--p-plus", type=float, default=0.1)
    parser.add_argument("--points", type=int, default=2000)
    options = parser.parse_args()
    side, times = options.side, 2 ** np.arange(options.last + 1)
    began = time.perf_counter()
    heights = js.grow_single_step(
        (side, side),
        p_plus=options.p_plus,
        sweeps=int(times[-1]),
        batch=options.replicas,
        snapshots=times,
        key=jax.random.key(0),
    )
    heights.block_until_ready()
    print(f"grown in {time.perf_counter() - began:.0f} s", flush=True)
    early = times[1:4]
    for moment, curves in loops_in_time(heights[1:4], early, points=options.points, rng=0).items():
        low = 4 * np.pi * moment ** (1 / 1.6)
        windows = {
            "mean_length": (low, side / 4),
            "length_tail": (low**1.75, (side / 4) ** 1.75),
            "loop_correlation": (low, side / 4),
        }
        print(f"t = {moment:g}: beyond R = {low:.0f}")
        for kind, expected in KINDS.items():
            fit = js.fit_power_law(curves[kind], window=windows[kind], weighting="equal")
            print(
                f"  {kind:17s} {fit.values['exponent']:.3f} +- {fit.stderr['exponent']:.3f} "
                f"+- {fit.systematic['exponent']:.3f}, percolation {expected:.3f}",
                flush=True,
            )
    window = (float(2**options.first), float(times[-1]))
    scaling = scale_in_time(heights, times, window=window)
    print(f"times {window}: collapse {scaling.collapse.status}")
    for name, (value, statistical, systematic) in scaling.exponents.items():
        print(f"  {name:18s} {value:.3f} +- {statistical:.3f} +- {systematic:.3f}")
    for moment, (xi, error) in scaling.correlation_length.items():
        print(f"  xi({moment:g}) = {xi:.1f} +- {error:.1f}")
    mean = np.asarray(scaling.width.mean)
    slopes = np.diff(np.log(mean)) / np.log(2) / 2
    # differences w^2(2t) - w^2(t) are free of the width a lattice surface has at the smallest scale
    growing = np.diff(np.log(np.diff(mean))) / np.log(2) / 2
    print(
        "without the intrinsic width:",
        " ".join(f"{t:g}:{s:.3f}" for t, s in zip(times[2:], growing, strict=True)),
    )
    print("local beta:", " ".join(f"{t:g}:{s:.3f}" for t, s in zip(times[1:], slopes, strict=True)))
    print(f"{time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
