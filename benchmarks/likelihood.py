"""How good is the likelihood: errors against the Cramer-Rao bound, coverage, and time.

    python benchmarks/likelihood.py periodic [--sides 64 128 512] [--surfaces 400]
    python benchmarks/likelihood.py all-unknown [--sides 256]
    python benchmarks/likelihood.py open [--sides 64] [--masks discs] [--alphas 0.2 0.4 0.8]
    python benchmarks/likelihood.py time

Each prints, for every parameter: the mean, its bias in standard errors, the root mean square error,
the mean quoted error, and how often the 68 % and 95 % intervals hold the truth. The control of
`periodic` and `open` is the straight line through the log-binned spectrum of the same maps; that of
`all-unknown` is the fit without the noise floor.
"""

import argparse
import time
from collections import Counter
from itertools import product

import jax
import numpy as np

import jaxsurf as js

BOUND = 1.383  # times 1/L: the smallest error of alpha on a periodic L x L map
CHUNK = 25  # surfaces at a time, for the memory


def drawn(law, side, surfaces, seed, crop=1):
    """Surfaces in chunks: [chunk, side, side], cut from maps `crop` times as wide."""
    for first in range(0, surfaces, CHUNK):
        key = jax.random.fold_in(jax.random.key(seed), first)
        shape = (crop * side, crop * side)
        wide = js.sample(law, shape, key=key, batch=min(CHUNK, surfaces - first), dtype="float64")
        yield np.asarray(wide)[:, :side, :side]


def report(fits, truth):
    print("  status:", dict(Counter(fit.status.split(":")[0] for fit in fits)))
    for name, exact in truth.items():
        value = np.array([fit.values[name] for fit in fits])
        error = np.array([fit.stderr[name] for fit in fits])
        pull, rmse = np.abs(value - exact) / error, np.sqrt(np.mean((value - exact) ** 2))
        bias = (value.mean() - exact) / (value.std() / np.sqrt(len(fits)))
        print(
            f"  {name:<11} mean {value.mean():.5f} bias {bias:+.2f} se  rmse {rmse:.5f}  quoted "
            f"{np.median(error):.5f}  68 %: {100 * np.mean(pull < 1):.1f}  "
            f"95 %: {100 * np.mean(pull < 1.96):.1f}"
        )


def against_bound(values, exact, sites, label):
    rmse = np.sqrt(np.mean((np.asarray(values) - exact) ** 2))
    print(
        f"  {label}: rmse {rmse:.4f} = {rmse * np.sqrt(sites) / BOUND:.3f} x 1.383 / sqrt(sites)",
        flush=True,
    )


def straight_line(heights, cutoff=None, **how):
    """Alpha from the slope of the log-binned spectrum of each map, beyond the knee if there is."""
    values, window = [], None if cutoff is None else (1.3 * np.pi / cutoff, np.pi)
    for one in heights:
        fit = js.fit_power_law(js.power_spectrum(one[None], **how), window=window, draws=20)
        values.append(-1 - fit.values["exponent"] / 2)
    return values


def curvature_error(fit, q):
    """The error of the cutoff if the likelihood were a parabola about its highest maximum."""
    alpha, amplitude, cutoff, noise = fit.values.values()
    knee = np.pi / cutoff
    bent = np.maximum(q, knee)
    signal = amplitude * bent ** (-2 - 2 * alpha)
    by_log = np.stack([-2 * np.log(bent), np.ones_like(q), 2 * (1 + alpha) * (q < knee)]) * signal
    slopes = np.concatenate([by_log, np.ones_like(q)[None]]) / (signal + noise)
    return cutoff * np.sqrt(np.linalg.inv(0.5 * slopes @ slopes.T)[2, 2])


def periodic(sides, surfaces, alpha):
    for side in sides:
        law = js.SelfAffine(alpha=alpha, amplitude=2.0)
        fits, lines = [], []
        for heights in drawn(law, side, surfaces, seed=side):
            fits += js.fit_likelihood(heights, js.SelfAffine(0.7), each=True)
            lines += straight_line(heights)
        print(f"periodic, L = {side}, {surfaces} surfaces, alpha = {alpha}")
        report(fits, {"alpha": alpha, "amplitude": 2.0})
        against_bound([fit.values["alpha"] for fit in fits], alpha, side**2, "likelihood")
        against_bound(lines, alpha, side**2, "straight line (control)")


def all_unknown(sides, surfaces, alpha):
    for side in sides:
        truth = {"alpha": alpha, "amplitude": 2.0, "cutoff": 15.3, "noise_floor": 0.02}
        law = js.SelfAffine(alpha, 2.0, cutoff=15.3)
        guess, fits, without = js.SelfAffine(0.7, 1.0, cutoff=8.0), [], []
        rng = np.random.default_rng(side)
        for heights in drawn(law, side, surfaces, seed=side):
            noisy = heights + np.sqrt(0.02) * rng.normal(size=heights.shape)
            fits += js.fit_likelihood(noisy, guess, noise=True, each=True)
            if not without:
                without = js.fit_likelihood(noisy, guess, each=True)
        print(f"all unknown, L = {side}, {surfaces} surfaces")
        report(fits, truth)
        q_1 = 2 * np.pi * np.fft.fftfreq(side)
        q = np.hypot(q_1[:, None], q_1).ravel()[1:]
        inside = [abs(f.values["cutoff"] - 15.3) < curvature_error(f, q) for f in fits]
        print(
            f"  cutoff, by the curvature of the likelihood alone  68 %: {100 * np.mean(inside):.1f}"
        )
        print(f"  control, no noise floor, {len(without)} surfaces")
        report(without, {"alpha": alpha})


def masked(side, kind):
    """10 % of the sites hidden: "discs" of radius L/16, "scattered" sites; or "none"."""
    rng, mask = np.random.default_rng(0), np.ones((side, side), bool)
    if kind == "scattered":
        return rng.uniform(size=mask.shape) > 0.1
    x, y = np.mgrid[:side, :side]
    while kind == "discs" and mask.mean() > 0.9:
        centre = rng.uniform(0, side, 2)
        mask &= np.hypot(x - centre[0], y - centre[1]) > side / 16
    return mask


def open_maps(sides, surfaces, alphas, kinds):
    for side, alpha, kind in product(sides, alphas, kinds):
        cutoff = 0.96 * side / 8
        law, mask = js.SelfAffine(alpha, 2.0, cutoff=cutoff), masked(side, kind)
        x, y = np.mgrid[:side, :side]
        guess = js.SelfAffine(0.5, 1.0, cutoff=side / 6)
        known = js.SelfAffine(0.5, 1.0, cutoff=cutoff)
        how, free, given, lines = {"boundary": "open", "mask": mask}, [], [], []
        for heights in drawn(law, side, surfaces, seed=side, crop=4):
            tilted = heights + 0.3 * x - 0.2 * y
            free += js.fit_likelihood(tilted, guess, each=True, **how)
            given += js.fit_likelihood(tilted, known, fixed=("cutoff",), each=True, **how)
            lines += straight_line(tilted, cutoff, **how)
        valid = int(mask.sum())
        print(
            f"open, L = {side}, {surfaces} tilted crops, {kind}, {valid} valid sites of "
            f"{side**2}; alpha = {alpha}, cutoff {cutoff:.2f}"
        )
        report(free, {"alpha": alpha, "amplitude": 2.0, "cutoff": cutoff})
        print("  the cutoff known")
        report(given, {"alpha": alpha, "amplitude": 2.0})
        chi2 = np.array([[fit.chi2, fit.dof] for fit in given]).mean(0)
        print(f"  mean chi2 of the residual spectrum {chi2[0]:.1f} / {chi2[1]:.0f}")
        for fits, label in ((free, "cutoff unknown"), (given, "cutoff known")):
            values = [fit.values["alpha"] for fit in fits]
            against_bound(values, alpha, valid, f"likelihood, {label}")
        against_bound(lines, alpha, valid, "straight line (control)")


def timing():
    plain, bent = (
        np.asarray(js.sample(law, (512, 512), key=jax.random.key(0), batch=9, dtype="float64"))
        for law in (js.SelfAffine(0.4), js.SelfAffine(0.4, 2.0, cutoff=25.0))
    )
    bent = bent + 0.1 * np.random.default_rng(0).normal(size=bent.shape)
    knee, noisy = js.SelfAffine(0.7, 1.0, cutoff=40.0), {"noise": True}
    for label, maps, guess, how in (
        ("alpha, amplitude", plain, js.SelfAffine(0.7), {}),
        ("all four", bent, knee, noisy),
        ("alpha, amplitude; open", plain, js.SelfAffine(0.7), {"boundary": "open"}),
        ("all four; open", bent, knee, noisy | {"boundary": "open"}),
    ):
        spent = []
        for one in maps:
            began = time.perf_counter()
            js.fit_likelihood(one, guess, **how)
            spent.append(time.perf_counter() - began)
        print(
            f"512 x 512, {label}: first {spent[0]:.2f} s, then {np.median(spent[1:]):.3f} s a fit",
            flush=True,
        )
    for side, surfaces in ((64, 400), (512, 40)):
        law, key = js.SelfAffine(0.4), jax.random.key(1)
        maps = np.asarray(js.sample(law, (side, side), key=key, batch=surfaces, dtype="float64"))
        for attempt in ("with compilation", "again"):
            began = time.perf_counter()
            js.fit_likelihood(maps, js.SelfAffine(0.7), each=True)
            spent = time.perf_counter() - began
            print(f"{surfaces} maps of {side} x {side} in one batch, {attempt}: {spent:.2f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["periodic", "all-unknown", "open", "time"])
    parser.add_argument("--sides", type=int, nargs="+")
    parser.add_argument("--surfaces", type=int, default=400)
    parser.add_argument("--alpha", type=float, default=0.5)
    parser.add_argument("--alphas", type=float, nargs="+", default=[0.4])
    parser.add_argument("--masks", nargs="+", default=["discs"])
    a = parser.parse_args()
    if a.what == "periodic":
        periodic(a.sides or [64, 128, 512], a.surfaces, a.alpha)
    elif a.what == "all-unknown":
        all_unknown(a.sides or [256], a.surfaces, a.alpha)
    elif a.what == "open":
        open_maps(a.sides or [64], a.surfaces, a.alphas, a.masks)
    else:
        timing()


if __name__ == "__main__":
    main()
