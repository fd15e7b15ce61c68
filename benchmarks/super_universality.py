"""Is 2x_l = 1 at every alpha? Exponents from size to size, on rough and on smooth lattices.

    python benchmarks/super_universality.py [--alpha 0 0.4] [--cut 0.25] [--share closed]

The correction to scaling that one would blame is the lattice's. So the same exponents are measured
on surfaces without waves shorter than 2 / cut sites, whose contours the lattice resolves: were the
lattice at fault, they would differ. Prints 2x_l and D_f from each size to the next at a fixed share
of the map, and from the first to the middle one; alpha = 0, where 2x_l = 1 exactly, is the control.

The mean square slope of a surface has a correction L^-2(1-alpha); a collapse of G(r) that allows
for one is shown too. With `--share closed` G is a share of the closed loops, as in the paper.
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np

import jaxsurf as js

SIZES = (64, 128, 256, 512, 1024)
BATCH_SITES = 2**22


class Resolved(js.SelfAffine):
    """A self-affine law without waves beyond a share of the largest wave number pi."""

    cut: float = 1.0

    def __call__(self, q):
        """S(q), zero beyond the cut."""
        return jnp.where(q <= self.cut * jnp.pi, super().__call__(q), 0.0)


def curves_of(law, side, surfaces, seed, share):
    """G(r) and <s>(R) of whole level sets."""
    parts, step = [], max(1, BATCH_SITES // side**2)
    for first in range(0, surfaces, step):
        key = jax.random.fold_in(jax.random.key(seed), 10_000 * side + first)
        batch = min(step, surfaces - first)
        heights = np.asarray(js.sample(law, (side, side), key=key, batch=batch))
        loops = js.level_loops(heights, 8, rng=first, paths=True)
        parts.append((js.all_pairs_correlation(loops, share=share), loops.mean_length()))
    return [js.concatenate(several) for several in zip(*parts, strict=True)]


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--alpha", type=float, nargs="+", default=[0.0, 0.4, 0.8])
    parser.add_argument("--cut", type=float, nargs="+", default=[1.5, 0.25])
    parser.add_argument("--sites", type=int, default=2**24)
    parser.add_argument("--most", type=int, default=6000)
    parser.add_argument("--share", choices=("all", "closed"), default="all")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for alpha in options.alpha:
        for cut in options.cut:
            law = Resolved(alpha, cut=cut)
            curves = {"2x_l": {}, "D_f": {}}
            for side in SIZES:
                surfaces = int(np.clip(options.sites // side**2, 8, options.most))
                pair = curves_of(law, side, surfaces, options.seed, options.share)
                curves["2x_l"][side], curves["D_f"][side] = pair
            for name, sign in (("2x_l", -1), ("D_f", 1)):
                steps = js.local_exponents(curves[name])
                row = " ".join(f"{sign * step.value:.3f}({step.error:.3f})" for step in steps)
                (whole,) = js.local_exponents({side: curves[name][side] for side in SIZES[:3:2]})
                print(
                    f"alpha = {alpha:g}, waves to {cut:g} pi, {name}: {row}   {SIZES[0]} to "
                    f"{SIZES[2]}: {sign * whole.value:.3f}({whole.error:.3f})",
                    flush=True,
                )
            if 0 < alpha < 1:
                fit = js.fit_collapse(
                    curves["2x_l"],
                    window=lambda curve, size: (4.0, 0.4 * size),
                    correction="size",
                    omega=2 * (1 - alpha),
                    draws=40,
                )
                value, error = fit.values["two_x_l"], fit.total_error("two_x_l")
                print(f"    with L^-{2 * (1 - alpha):.1f}: 2x_l = {value:.3f}({error:.3f})")


if __name__ == "__main__":
    main()
