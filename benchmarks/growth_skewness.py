"""Skewness and kurtosis of the single-step model at p_plus and 1 - p_plus: mirror images.

    python benchmarks/growth_skewness.py [--p-plus 0.1] [--side 64] [--replicas 32]

The heights' skewness and excess kurtosis and the curvature's skewness over b, with errors between
runs.
"""

import argparse

import jax
import numpy as np

import jaxsurf as js
from jaxsurf.analysis.snapshots import pool_snapshots


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--p-plus", type=float, default=0.1)
    parser.add_argument("--side", type=int, default=64)
    parser.add_argument("--replicas", type=int, default=32)
    parser.add_argument("--looks", type=int, default=7)
    parser.add_argument("--every", type=int, default=100, help="sweeps between looks")
    options = parser.parse_args()
    first = 4 * options.every
    grown = js.grow_single_step(
        (options.side, options.side),
        p_plus=np.array([options.p_plus, 1 - options.p_plus]),
        sweeps=first + options.every * (options.looks - 1),
        batch=options.replicas,
        snapshots=first + options.every * np.arange(options.looks),
        key=jax.random.key(13),
    )
    maps = np.asarray(grown)
    maps = (maps - maps[..., :1, :1]).astype(np.float32)
    scales = 2 ** np.arange(options.side.bit_length() - 2)
    measures = {
        "skewness of h": js.height_skewness,
        "kurtosis of h": js.height_kurtosis,
        "skewness of C_b": lambda h: js.curvature_skewness(h, scales),
    }
    for name, measure in measures.items():
        for number, p_plus in enumerate((options.p_plus, 1 - options.p_plus)):
            of_model = maps[:, number].reshape(-1, options.side, options.side)
            curve = pool_snapshots(measure(of_model), options.replicas)
            points = zip(curve.scale, curve.mean, curve.stderr, strict=True)
            found = ", ".join(f"{b:g}: {value:+.4f} +- {error:.4f}" for b, value, error in points)
            print(f"{name:15s} p_plus = {p_plus:g}  {found}", flush=True)


if __name__ == "__main__":
    main()
