"""What should an open map be compared by: tapered heights, curvature, or steps?

    python benchmarks/likelihood_windows.py [--alphas 0.2 0.8] [--masks none discs scattered]

The error of alpha on a 32 x 32 crop of a surface four times as wide, in units of 1.383 / sqrt(valid
sites), of the debiased Whittle likelihood of each; not simulated, but from the dense covariance of
the heights, F^-1 J F^-1. The first line is the exact likelihood of the crop, all that its heights
know with any plane added. `_debiased` uses the steps.
"""

import argparse

import numpy as np
from likelihood import BOUND, masked

SIDE, WIDE = 32, 128
SITES = SIDE * SIDE
PROBES = 40  # of the trace: errors to a percent


def covariances(alpha, cutoff):
    """Of the heights of the crop: itself, and its derivatives by alpha, ln A and ln cutoff."""
    q_1 = 2 * np.pi * np.fft.fftfreq(WIDE)
    q = np.hypot(q_1[:, None], q_1)
    q[0, 0] = 1.0
    bent = np.maximum(q, np.pi / cutoff)
    density = bent ** (-2 - 2 * alpha)
    density[0, 0] = 0.0
    slopes = (-2 * np.log(bent), np.ones_like(q), 2 * (1 + alpha) * (q < np.pi / cutoff))
    x, y = (grid.ravel() for grid in np.mgrid[:SIDE, :SIDE])
    lags = np.subtract.outer(x, x) % WIDE, np.subtract.outer(y, y) % WIDE
    return [np.fft.ifft2(s * density).real[lags] for s in (1.0, *slopes)]


def differences(offsets, mask):
    """Rows: the sum of h(x + e) - h(x) over the offsets, at sites where all exist."""
    x, y = np.mgrid[:SIDE, :SIDE]
    rows, exists = np.zeros((SITES, SITES)), mask.copy()
    for e_x, e_y in offsets:
        inside = (x + e_x >= 0) & (x + e_x < SIDE) & (y + e_y >= 0) & (y + e_y < SIDE)
        exists &= inside & np.roll(mask, (-e_x, -e_y), (0, 1))
    sites = np.flatnonzero(exists)
    for e_x, e_y in offsets:
        rows[sites, sites + e_x * SIDE + e_y] += 1
        rows[sites, sites] -= 1
    return rows, sites


def steps(mask):
    both = []
    for offset in ((1, 0), (0, 1)):
        rows, sites = differences([offset], mask)
        rows[sites] -= rows[sites].mean(0)
        both.append(rows)
    return both


def curvature(mask):
    return [differences([(1, 0), (-1, 0), (0, 1), (0, -1)], mask)[0]]


def levelled_heights(mask, taper):
    """Heights less their plane, times a cosine taper over a share of the map."""
    x, y = (grid.ravel() for grid in np.mgrid[:SIDE, :SIDE])
    plane = np.stack([np.ones(SITES), x, y], 1) * mask.ravel()[:, None]
    edge = np.ones(SIDE)
    if width := int(taper * SIDE / 2):
        edge[:width] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(width) + 0.5) / width)
        edge[-width:] = edge[:width][::-1]
    level = np.diag(mask.ravel().astype(float)) - plane @ np.linalg.pinv(plane)
    return [level * np.outer(edge, edge).reshape(-1, 1)]


def whittle(fields, covariance):
    """F and J of the power of some linear fields of the heights, summed over the fields."""
    expected = np.zeros((4, SIDE, SIDE))
    for rows in fields:
        for k, c in enumerate(covariance):
            modes = np.fft.fft2((rows @ c @ rows.T).reshape((SIDE,) * 4), axes=(0, 1))
            expected[k] += np.einsum("abab->ab", np.fft.ifft2(modes, axes=(2, 3))).real * SITES
    seen = expected[0] > 1e-9 * expected[0].max()
    seen[0, 0] = False
    f = np.where(seen, expected[0], 1.0)
    slopes = [np.where(seen, d / f, 0.0) for d in expected[1:]]

    def form(k, vectors):
        total = np.zeros_like(vectors)
        for rows in fields:
            modes = np.fft.fft2((rows @ vectors).reshape(SIDE, SIDE, -1), axes=(0, 1))
            back = np.fft.ifft2(modes * (slopes[k] / f)[..., None], axes=(0, 1)).real * SITES
            total += rows.T @ back.reshape(SITES, -1)
        return total

    signs = np.random.default_rng(1).choice([-1.0, 1.0], size=(SITES, PROBES))
    spread = covariance[0] @ signs
    left = [form(k, signs) for k in range(3)]
    right = [covariance[0] @ form(k, spread) for k in range(3)]
    trace = np.array([[np.sum(a * b) for b in right] for a in left]) / PROBES
    fisher = np.array([[0.5 * np.sum(a * b) for b in slopes] for a in slopes])
    return fisher, 0.25 * (trace + trace.T)


def exact(mask, covariance):
    x, y = np.nonzero(mask)
    basis, _ = np.linalg.qr(np.stack([np.ones(len(x)), x, y], 1), mode="complete")
    blind = basis[:, 3:]  # to planes
    valid = np.ix_(mask.ravel(), mask.ravel())
    inverse = np.linalg.inv(blind.T @ covariance[0][valid] @ blind)
    forms = [inverse @ (blind.T @ c[valid] @ blind) for c in covariance[1:]]
    fisher = np.array([[0.5 * np.sum(a * b.T) for b in forms] for a in forms])
    return fisher, fisher


def shown(label, fisher, variance, sites):
    errors = []
    for free in (2, 3):  # alpha and amplitude; and the cutoff
        inverse = np.linalg.inv(fisher[:free, :free])
        errors.append(np.sqrt((inverse @ variance[:free, :free] @ inverse)[0, 0] * sites) / BOUND)
    print(f"  {label:<28} cutoff known {errors[0]:.2f}, unknown {errors[1]:.2f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--alphas", type=float, nargs="+", default=[0.2, 0.8])
    parser.add_argument("--masks", nargs="+", default=["none", "discs", "scattered"])
    a = parser.parse_args()
    for alpha in a.alphas:
        covariance = covariances(alpha, 0.96 * SIDE / 8)  # as `likelihood.py open`
        for kind in a.masks:
            mask = masked(SIDE, kind)
            sites = int(mask.sum())
            print(
                f"alpha = {alpha}, cutoff {0.96 * SIDE / 8:.2f}, {kind}: {sites} of {SITES} sites"
            )
            shown("exact likelihood", *exact(mask, covariance), sites)
            shown("steps", *whittle(steps(mask), covariance), sites)
            shown("curvature", *whittle(curvature(mask), covariance), sites)
            for taper in (0.0, 0.5):
                label = f"levelled heights, taper {taper}"
                shown(label, *whittle(levelled_heights(mask, taper), covariance), sites)


if __name__ == "__main__":
    main()
