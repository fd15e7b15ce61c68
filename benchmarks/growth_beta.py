r"""The growth exponent beta of the single-step model at the largest size and time one can afford.

    python benchmarks/growth_beta.py [--side 512] [--last 11] [--replicas 8] [--p-plus 0.1]
        [--scheme random-sequential]

Grows from flat, keeps only each surface's squared width at t = 2^k and 3 2^k, and fits the power
2 beta of $w^2(2t) - w^2(t)$, from which the width a lattice surface has at its smallest scales
drops out. The statistical error is between surfaces; the systematic one is how far beta moves with
the window of times, which starts at --first and at twice and four times that.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

import jaxsurf as js
from jaxsurf.analysis.time_scaling import width_increments
from jaxsurf.curve import Curve


def squared_width(heights):
    near_zero = (heights - heights[..., :1, :1]).astype(jnp.float32)
    return jnp.var(near_zero, (-2, -1))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=512)
    parser.add_argument("--last", type=int, default=11, help="log2 of the last time")
    parser.add_argument("--first", type=float, default=16.0, help="first time fitted")
    parser.add_argument("--replicas", type=int, default=8)
    parser.add_argument("--p-plus", type=float, default=0.1)
    parser.add_argument("--scheme", default="random-sequential")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    began = time.perf_counter()
    doubled = 2 ** np.arange(options.last + 1)
    times = np.union1d(doubled, 3 * doubled[:-2])
    state = js.init_single_step(
        (options.side, options.side),
        p_plus=options.p_plus,
        batch=options.replicas,
        scheme=options.scheme,
    )
    key, kept, done = jax.random.key(options.seed), [], 0
    for moment in times.tolist():
        state, seen = js.run_single_step(
            key, state, sweeps=moment - done, snapshots=[moment - done], observe=squared_width
        )
        kept.append(np.asarray(seen[0], float))
        done = moment
        if moment in doubled[7:]:
            print(f"t = {moment}: {time.perf_counter() - began:.0f} s", flush=True)
    width = Curve("width", times.astype(float), np.stack(kept, 1), units=("sweeps", "1"))
    gain = width_increments(width)
    local = np.log(gain.mean[2:] / gain.mean[:-2]) / np.log(gain.scale[2:] / gain.scale[:-2]) / 2
    print(f"{options.scheme}, p_plus = {options.p_plus:g}, L = {options.side}")
    print("    t      w^2              w^2(2t) - w^2(t)   local beta of w^2, of the difference")
    for i, moment in enumerate(gain.scale.tolist()):
        raw = np.log(width.mean[i + 2] / width.mean[i]) / np.log(times[i + 2] / times[i]) / 2
        print(
            f"{moment:6g}  {width.mean[i]:7.4f} +- {width.stderr[i]:.4f}  {gain.mean[i]:7.4f} +- "
            f"{gain.stderr[i]:.4f}   {raw:.3f}" + (f"  {local[i]:.3f}" if i < len(local) else "")
        )
    values, starts = [], [options.first * factor for factor in (1, 2, 4)]
    for start in starts:
        fit = js.fit_power_law(gain, window=(start, float(gain.scale[-1])))
        values.append((fit.values["exponent"] / 2, fit.stderr["exponent"] / 2))
        print(f"beta from {start:g} on: {values[-1][0]:.4f} +- {values[-1][1]:.4f}", flush=True)
    moved = max(abs(value - values[0][0]) for value, _ in values)
    print(f"beta = {values[0][0]:.3f} +- {values[0][1]:.3f} (surfaces) +- {moved:.3f} (window)")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
