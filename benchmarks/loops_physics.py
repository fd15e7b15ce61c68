"""What the loop engine says about exactly known and conjectured exponents.

    python benchmarks/loops_physics.py cardy-ziff     # hulls of percolation: A N(>A) -> 0.04594
    python benchmarks/loops_physics.py free-field     # alpha = 0: D_f = 3/2 exactly
    python benchmarks/loops_physics.py correlation    # 2 x_l for alpha = 0 ... 1, conjectured 1
    python benchmarks/loops_physics.py single-loop    # G_s(r) ~ r^-a, predicted (1 + alpha)/2
    python benchmarks/loops_physics.py half-integers  # dithered and half-integer levels compared
    python benchmarks/loops_physics.py crops          # G(r) of open maps against periodic ones

`--side` and `--surfaces` change the work. Errors are standard errors by the jackknife over
surfaces.
"""

import argparse
import time

import numpy as np
from scipy.optimize import least_squares

import jaxsurf as js


def rough(side, alpha, rng):
    """One Gaussian map with spectrum q^(-2-2 alpha); white noise if alpha is None."""
    noise = rng.standard_normal((side, side), dtype=np.float32)
    if alpha is None:
        return noise
    qx = np.fft.fftfreq(side).astype(np.float32)[:, None]
    qy = np.fft.rfftfreq(side).astype(np.float32)[None, :]
    q = np.hypot(qx, qy)
    q[0, 0] = np.inf
    h = np.fft.irfft2(np.fft.rfft2(noise) * q ** np.float32(-1 - alpha), s=(side, side))
    return (h / h.std()).astype(np.float32)


def curves_of(measure, surfaces, side, alpha, levels, *, paths=False, seed=0, placement="equal"):
    """One curve over all surfaces, one surface in memory at a time."""
    parts = []
    for k in range(surfaces):
        rng = np.random.default_rng([seed, side, k, 0 if alpha is None else int(100 * alpha) + 1])
        h = rough(side, alpha, rng)
        parts.append(measure(js.level_loops(h, levels, placement=placement, rng=k, paths=paths)))
    return js.concatenate(parts)


def jackknife(curve, estimate):
    """An estimate with its standard error over surfaces."""
    count = curve.surfaces
    rows = np.arange(count)
    each = np.array([estimate(curve.resample(rows[rows != k])) for k in range(count)])
    return estimate(curve), np.sqrt((count - 1) / count * ((each - each.mean(0)) ** 2).sum(0))


def slope(low, high, correction=None):
    """Exponent of mean = c x^D (1 + b x^-correction) over a window, by weighted least squares."""

    def estimate(curve):
        part = curve.window(low, high)
        x, y = np.log(part.scale), np.log(part.mean)
        columns = [np.ones_like(x), x]
        if correction is not None:
            columns.append(np.exp(-correction * x))
        # points a ratio 1.1 apart, errors growing as the square root of how few loops there are
        weight = np.sqrt(part.count)[:, None] if part.kind == "mean_length" else 1.0
        return np.linalg.lstsq(weight * np.stack(columns, 1), np.ravel(weight) * y, rcond=None)[0][
            1
        ]

    return estimate


def cardy_ziff(side, surfaces):
    exact = 2 / (8 * np.sqrt(3) * np.pi)
    print(f"A N(>A) of white noise at its median; exact {exact:.5f}; L {side}, {surfaces} surfaces")
    curve = curves_of(js.area_tail, surfaces, side, None, 1, placement="quantiles")
    for area in (50.0, 100.0, 200.0, 400.0, 800.0, 1600.0):
        at = np.searchsorted(curve.scale, area)
        value, error = curve.mean[at] * curve.scale[at], curve.stderr[at] * curve.scale[at]
        print(
            f"A {curve.scale[at]:7.1f}: {value:.5f} +- {error:.5f}  "
            f"off by {100 * (value / exact - 1):+.2f} +- {100 * error / exact:.2f} %"
        )


def corrected_power_law(curves, low, share):
    """D, omega and b of <s>(R) = c R^D (1 + b R^-omega), all sizes together, R from low to share L.

    Returns the three values and chi2 per degree of freedom.
    """
    parts = [curve.window(low, share * side) for side, curve in curves.items()]
    scale, mean, stderr = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("scale", "mean", "stderr")
    )
    seen = stderr > 0  # in two surfaces at least
    x, y, error = np.log(scale[seen]), np.log(mean[seen]), stderr[seen] / mean[seen]

    def residuals(parameters):
        log_c, exponent, omega, b = parameters
        return (log_c + exponent * x + np.log1p(b * np.exp(-omega * x)) - y) / error

    found = least_squares(residuals, (1.0, 1.5, 0.8, 2.0), x_scale=(1.0, 0.1, 0.1, 1.0))
    return np.append(found.x[1:], 2 * found.cost / (len(x) - 4))


def free_field(side, surfaces, draws=100):
    work = {side // 8: 4 * surfaces, side // 4: 2 * surfaces, side // 2: surfaces, side: surfaces}
    print(f"alpha = 0: <s>(R) ~ R^D, exactly D = 3/2; L: surfaces {work}")
    curves = {
        size: curves_of(lambda loops: loops.mean_length(), count, size, 0.0, 8)
        for size, count in work.items()
    }
    for size, curve in curves.items():
        edges = 2.0 ** np.arange(1, int(np.log2(size)) - 2)
        said = []
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            value, error = jackknife(curve, slope(low, high))
            said.append(f"{low:.0f}-{high:.0f}: {value:.4f}({error:.4f})")
        print(f"L {size}: local slopes  {'  '.join(said)}", flush=True)
    rng = np.random.default_rng(0)
    drawn = [
        {
            size: curve.resample(rng.integers(0, curve.surfaces, curve.surfaces))
            for size, curve in curves.items()
        }
        for _ in range(draws)
    ]
    print("<s> = c R^D (1 + b R^-omega), everything free, all sizes; errors by bootstrap")
    for share in (1 / 16, 1 / 8):
        for low in (3.0, 4.0, 6.0, 8.0, 12.0):
            value = corrected_power_law(curves, low, share)
            error = np.std([corrected_power_law(each, low, share) for each in drawn], 0)
            print(
                f"R {low:.0f} to L/{1 / share:.0f}: D = {value[0]:.4f}({error[0]:.4f})  "
                f"omega = {value[1]:.3f}({error[1]:.3f})  b = {value[2]:.2f}({error[2]:.2f})  "
                f"chi2/dof {value[3]:.2f}",
                flush=True,
            )


def correlation(side, surfaces, alphas, fields):
    print(f"2 x_l from all pairs, L {side}, {surfaces} surfaces, {fields} fields; conjectured 1")
    for alpha in alphas:
        begin = time.time()
        curve = curves_of(
            lambda loops: loops.correlation(fields=fields), surfaces, side, alpha, 8, paths=True
        )
        said = []
        for low, high in ((4.0, 16.0), (8.0, 32.0), (16.0, 64.0), (32.0, 128.0), (64.0, 256.0)):
            if high <= side / 8:
                value, error = jackknife(curve, slope(low, high))
                said.append(f"{low:.0f}-{high:.0f}: {-value:.4f}({error:.4f})")
        value, error = jackknife(curve, slope(4.0, side / 16, 1.0))
        said.append(f"4-{side / 16:.0f} with r^-1: {-value:.4f}({error:.4f})")
        print(f"alpha {alpha:.1f}  {'  '.join(said)}  {time.time() - begin:.0f} s", flush=True)


def single_loop(side, surfaces, alphas, fields):
    print(f"G_s(r) ~ r^-a of loops of one length, L {side}, {surfaces} surfaces")
    for alpha in alphas:
        dimension = js.theory.fractal_dimension(alpha)
        length = (side / 8) ** dimension
        wanted = (length, 2 * length)
        curve = curves_of(
            lambda loops, wanted=wanted: loops.correlation(fields=fields, lengths=wanted),
            surfaces,
            side,
            alpha,
            4,
            paths=True,
        )
        said = []
        for low, high in ((2.0, 8.0), (4.0, 16.0), (8.0, 32.0)):
            value, error = jackknife(curve, slope(low, high))
            said.append(f"{low:.0f}-{high:.0f}: {-value:.4f}({error:.4f})")
        print(f"alpha {alpha:.1f}  predicted {(1 + alpha) / 2:.2f}  {'  '.join(said)}", flush=True)


def crops(side, surfaces, alphas):
    print(f"G(r) of crops of {side // 4} sites against that of the periodic maps of {side}")
    for alpha in alphas:
        whole, cut, closed = [], [], []
        for k in range(surfaces):
            h = rough(side, alpha, np.random.default_rng([5, side, k]))
            levels = np.linspace(-0.5, 0.5, 3)
            parts = h.reshape(4, side // 4, 4, side // 4).swapaxes(1, 2)
            loops = js.level_loops(h, levels, paths=True)
            pieces = js.level_loops(
                parts.reshape(-1, side // 4, side // 4), levels, boundary="open", paths=True
            )
            whole.append(loops.correlation(share="all", pieces=True))
            cut.append(pieces.correlation(share="all", pieces=True))
            closed.append(pieces.correlation())
        truth, cut, closed = (js.concatenate(each) for each in (whole, cut, closed))
        for r in (2.0, 4.0, 8.0, 16.0, 32.0):
            at = int(np.argmin(np.abs(np.log(cut.scale / r))))
            reference = int(np.argmin(np.abs(np.log(truth.scale / r))))
            print(
                f"alpha {alpha:.1f}  r {cut.scale[at]:5.1f}: whole {truth.mean[reference]:.4f}"
                f"({truth.stderr[reference]:.4f})  pieces {cut.mean[at]:.4f}({cut.stderr[at]:.4f})"
                f"  closed loops {closed.mean[at]:.4f}({closed.stderr[at]:.4f})"
            )


def half_integers(side, surfaces):
    import jax

    print(f"single-step model at p = 1/2, L {side}, {surfaces} surfaces grown for 1000 sweeps")
    heights = js.grow_single_step(
        (side, side), p_plus=0.5, sweeps=1000, key=jax.random.key(0), batch=surfaces
    )
    for name, loops in (
        ("dithered, means of plaquettes", js.trace_loops(heights, 400, rng=0)),
        ("half-integer levels", js.level_loops(heights, 1, placement="half-integers", rng=0)),
    ):
        length, tail = loops.mean_length(), loops.length_tail()
        dimension, tail_slope = (
            jackknife(length, slope(5.0, 30.0)),
            jackknife(tail, slope(11.0, 301.0)),
        )
        at, longer = np.searchsorted(length.scale, 10.0), np.searchsorted(tail.scale, 101.0)
        print(
            f"{name:30s} D_f {dimension[0]:.3f}({dimension[1]:.3f})  "
            f"tau-2 {-tail_slope[0]:.3f}({tail_slope[1]:.3f})  "
            f"<s>(R = 10) {length.mean[at]:.1f}({length.stderr[at]:.1f})  "
            f"P_>({tail.scale[longer]:.0f}) {tail.mean[longer]:.3f}({tail.stderr[longer]:.3f})"
        )


#: what -> side and surfaces, unless told otherwise
WORK = {
    "cardy-ziff": (2048, 48),
    "free-field": (4096, 40),
    "correlation": (2048, 16),
    "single-loop": (1024, 24),
    "half-integers": (128, 16),
    "crops": (512, 12),
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=list(WORK))
    parser.add_argument("--side", type=int)
    parser.add_argument("--surfaces", type=int)
    parser.add_argument("--alphas", type=float, nargs="*", default=[0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    parser.add_argument("--fields", type=int, default=16)
    chosen = parser.parse_args()
    side, surfaces = WORK[chosen.what]
    side, surfaces = chosen.side or side, chosen.surfaces or surfaces
    if chosen.what == "cardy-ziff":
        cardy_ziff(side, surfaces)
    elif chosen.what == "free-field":
        free_field(side, surfaces)
    elif chosen.what == "correlation":
        correlation(side, surfaces, chosen.alphas, chosen.fields)
    elif chosen.what == "single-loop":
        single_loop(side, surfaces, chosen.alphas, chosen.fields)
    elif chosen.what == "crops":
        crops(side, surfaces, chosen.alphas)
    else:
        half_integers(side, surfaces)
