"""Time of a collapse with 200 bootstrap refits (bar: 20 s), compilation included and not.

The data are four sizes of P_>(s, L), 25 surfaces each, noisy as sampled loops are.
Run: python benchmarks/collapse_speed.py
"""

import os
import time

import numpy as np

from jaxsurf.curve import Curve
from jaxsurf.fitting.collapse import fit_collapse


def loop_tails(seed: int, loops: int = 400, surfaces: int = 25) -> dict[int, Curve]:
    rng, curves = np.random.default_rng(seed), {}
    for side in (64, 128, 256, 512):
        s = 20 * 1.1 ** np.arange(80)
        s = s[s < 2 * side**1.3]
        tail = 1.2 * s**-0.23 * np.exp(-1.2 * (s / side**1.3) ** 1.5)
        steps = -np.diff(tail, append=0.0)
        drawn = rng.gamma(steps * loops, 1.0, (surfaces, len(s))) / loops
        curves[side] = Curve("length_tail", s, np.cumsum(drawn[:, ::-1], 1)[:, ::-1])
    return curves


def main() -> None:
    for number in range(4):
        wall, processor = time.perf_counter(), time.process_time()
        fit = fit_collapse(loop_tails(number), draws=200)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        name = "with compilation" if number == 0 else "again"
        print(
            f"{name:<17} {wall:6.2f} s, {processor:6.2f} s of processor, load "
            f"{os.getloadavg()[0]:.1f}: D_f = {fit.values['D_f']:.3f}"
        )


if __name__ == "__main__":
    main()
