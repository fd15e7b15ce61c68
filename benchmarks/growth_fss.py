r"""alpha of the single-step model from finite-size scaling of its loops, beyond the paper's sizes.

    python benchmarks/growth_fss.py [--p-plus 0.1] [--scheme sublattice] [--sizes 64 128 256 512]

The paper's sizes, 32 to 128, leave D_f open to some 0.05, alpha to 0.1. Here as many sites of
each size are grown to saturation, for L^1.6 / 6 sweeps, all loops at all half-integer levels taken,
and <s>(R) and P_>(s) collapsed as in Table II; beside it slopes of the spectrum at the largest
size. Sublattice updates, ten times as fast as random-sequential ones, change amplitudes, not
exponents.
"""

import argparse
import time

import jax
import numpy as np

import jaxsurf as js
from jaxsurf.analysis.snapshots import pool_snapshots


def curves_of(side, options):
    """Loop measures and the spectrum, a row a surface."""
    replicas = max(options.sites // side**2, 6)
    settle = int(side**1.6 / 6)
    every = max(settle // 8, 1)
    state = js.init_single_step(
        (side, side), p_plus=options.p_plus, batch=replicas, scheme=options.scheme
    )
    key = jax.random.fold_in(jax.random.key(options.seed), side)
    state, _ = js.run_single_step(key, state, sweeps=settle)
    found = {"mean_length": [], "length_tail": [], "spectrum": []}
    for look in range(options.looks):
        state, _ = js.run_single_step(key, state, sweeps=every)
        heights = np.asarray(state.heights)
        heights = heights - heights[:, :1, :1]
        rng = np.random.default_rng([options.seed, side, look])
        loops = js.level_loops(heights, 1, placement="half-integers", rng=rng)
        found["mean_length"].append(loops.mean_length())
        found["length_tail"].append(loops.length_tail(share=options.share))
        found["spectrum"].append(js.power_spectrum(heights.astype(np.float32)))
    pooled = {name: pool_snapshots(several, replicas) for name, several in found.items()}
    return pooled, replicas, settle + every * options.looks


def said(value, *errors):
    return f"{value:.4f} +- " + " +- ".join(f"{error:.4f}" for error in errors)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--p-plus", type=float, default=0.1)
    parser.add_argument("--scheme", default="sublattice")
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256, 512])
    parser.add_argument("--sites", type=int, default=2**21, help="of all surfaces of one size")
    parser.add_argument("--looks", type=int, default=8)
    parser.add_argument("--share", default="all", choices=["all", "closed"])
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    began = time.perf_counter()
    curves = {}
    for side in options.sizes:
        curves[side], replicas, sweeps = curves_of(side, options)
        spent = time.perf_counter() - began
        print(f"L = {side}: {replicas} surfaces, {sweeps} sweeps, {spent:.0f} s", flush=True)
    largest = max(options.sizes)
    lowest = 0.99 * 2 * np.pi / largest
    for low, high in ((lowest, 10 * lowest), (lowest, 0.5), (5 * lowest, 0.5)):
        fit = js.fit_power_law(curves[largest]["spectrum"], window=(low, high))
        slope, *errors = (one["exponent"] for one in (fit.values, fit.stderr, fit.systematic))
        alpha = said(-slope / 2 - 1, *(error / 2 for error in errors))
        print(f"spectrum at L = {largest}, {low:.3f} < q < {high:.3f}: alpha = {alpha}", flush=True)

    for smallest in (options.sizes, options.sizes[1:]):
        measures = [
            {side: curves[side][kind] for side in smallest}
            for kind in ("mean_length", "length_tail")
        ]
        for radius in (6.0, 10.0):

            def window(curve, size, radius=radius):
                is_tail = curve.kind == "length_tail"
                return (40.0 * (radius / 6.0) ** 1.3, np.inf) if is_tail else (radius, 0.5 * size)

            fit = js.fit_collapse(measures, window=window, correction="scale", draws=options.draws)
            D_f, tail = fit.values["D_f"], fit.values["tau_minus_2"]
            of_D_f = fit.stderr["D_f"], fit.systematic["D_f"]
            of_tail = fit.stderr["tau_minus_2"], fit.systematic["tau_minus_2"]
            print(f"collapse of L = {smallest}, R > {radius:g}: {fit.status}")
            print(
                f"  D_f = {said(D_f, *of_D_f)}: alpha = "
                + said(3 - 2 * D_f, *(2 * error for error in of_D_f))
            )
            print(
                f"  tau-2 = {said(tail, *of_tail)}: alpha = "
                + said(
                    js.theory.alpha_from_length_tail(tail),
                    *(js.theory.alpha_from_length_tail(tail, error)[1] for error in of_tail),
                ),
                flush=True,
            )
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
