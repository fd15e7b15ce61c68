"""How fast the single-step model grows: the paper's longest run, 128^2 for 22,000 sweeps.

    python benchmarks/growth_speed.py [--sweeps 1000]

Times a piece of the run after compilation and scales it to 22,000 sweeps of 8 replicas (a sweep
costs the same at any time once the surface is rough, which the warm-up sees to).
"""

import argparse
import os
import time

import jax

import jaxsurf as js

PAPER_SWEEPS = 22_000


def seconds_per_sweep(scheme, side, replicas, sweeps):
    key = jax.random.key(0)
    state = js.init_single_step((side, side), p_plus=0.1, batch=replicas, scheme=scheme)
    state, _ = js.run_single_step(key, state, sweeps=max(sweeps // 10, 1))
    state.heights.block_until_ready()
    began = time.perf_counter()
    state, _ = js.run_single_step(key, state, sweeps=sweeps)
    state.heights.block_until_ready()
    return (time.perf_counter() - began) / sweeps


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=1000, help="sweeps timed (22000: all)")
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; 128 x 128, p_plus = 0.1")
    runs = {"sublattice": (8, 1.0), "random-sequential": (8, 1.0), "paper": (8, 0.02)}
    for scheme, (replicas, share) in runs.items():
        each = seconds_per_sweep(scheme, 128, replicas, max(int(options.sweeps * share), 1))
        rate = replicas * 128**2 / each / 1e6
        print(
            f"{scheme:18s} {replicas} replicas: {each * 1e3:8.2f} ms a sweep, "
            f"{rate:6.1f} M updates/s, {each * PAPER_SWEEPS:7.0f} s for {PAPER_SWEEPS} sweeps"
        )


if __name__ == "__main__":
    main()
