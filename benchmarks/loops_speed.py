"""Speed of the loop engine against contourpy, scikit-image and a scalar tracer compiled by numba.

Single thread each, alternating, the same maps and levels:

    python benchmarks/loops_speed.py [--sizes 512 2048] [--repeats 9]
        [--only levels|points|scale|threads]

Level sets: `level_loops` (labelled loops with length, radius, area, winding) at one level, against
`contourpy` returning bare lines and `skimage.measure.find_contours`. Points: `trace_loops` through
10,000 points of 25 maps at L = 512 against the scalar tracer. Times are CPU seconds of the thread,
which other processes on the machine disturb less than the clock; ratios are of medians, with the
spread of the ratio over repeats (16th to 84th percentile).
"""

import argparse
import time
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np

import jaxsurf as js

ALPHAS = (0.0, 0.4, 0.8)


def rough(count, side, alpha, seed=0):
    """Gaussian maps with spectrum q^(-2-2 alpha), float32, unit variance."""
    rng = np.random.default_rng(seed)
    q = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.rfftfreq(side), indexing="ij"))
    q[0, 0] = np.inf
    scale = q ** (-1 - alpha)
    scale = scale.astype(np.float32)
    maps = np.empty((count, side, side), np.float32)
    for h in maps:
        modes = np.fft.rfft2(rng.standard_normal((side, side), dtype=np.float32))
        modes *= scale
        h[:] = np.fft.irfft2(modes, (side, side))
        h /= h.std()
    return maps


@numba.njit
def scalar_trace(heights, surface, start_x, start_y):
    """The loop through each start: length, radius, area and winding, one step at a time."""
    side_x, side_y = heights.shape[1], heights.shape[2]
    found = np.zeros((len(start_x), 5), np.int64)
    quarter = np.float32(0.25)
    for k in range(len(start_x)):
        h = heights[surface[k]]
        x, y = start_x[k], start_y[k]
        right, up = (x + 1) % side_x, (y + 1) % side_y
        level = ((h[x, y] + h[right, up]) + (h[right, y] + h[x, up])) * quarter
        signs = (h[x, y] > level, h[right, y] > level, h[right, up] > level, h[x, up] > level)
        d = -1
        for each in range(4):
            if signs[(each + 3) % 4] and not signs[each]:
                d = each
        if d < 0:
            continue
        first_x, first_y, first_d = x, y, d
        at_x = at_y = low_x = low_y = high_x = high_y = steps = area = 0
        while True:
            right = x + 1 if x + 1 < side_x else 0
            up = y + 1 if y + 1 < side_y else 0
            if d == 0:
                left_height, right_height = h[right, up], h[right, y]
            elif d == 1:
                left_height, right_height = h[x, up], h[right, up]
            elif d == 2:
                left_height, right_height = h[x, y], h[x, up]
            else:
                left_height, right_height = h[right, y], h[x, y]
            if left_height > level:
                if right_height > level:
                    d = (d + 3) & 3
            elif not right_height > level:
                d = (d + 1) & 3
            else:
                mean = ((h[x, y] + h[right, up]) + (h[right, y] + h[x, up])) * quarter
                d = (d + 3) & 3 if mean > level else (d + 1) & 3
            if d == 0:
                x = right
                at_x += 1
                high_x = max(high_x, at_x)
            elif d == 1:
                y = up
                at_y += 1
                area += at_x
                high_y = max(high_y, at_y)
            elif d == 2:
                x = x - 1 if x > 0 else side_x - 1
                at_x -= 1
                low_x = min(low_x, at_x)
            else:
                y = y - 1 if y > 0 else side_y - 1
                at_y -= 1
                area -= at_x
                low_y = min(low_y, at_y)
            steps += 1
            if x == first_x and y == first_y and d == first_d:
                break
        found[k] = steps, max(high_x - low_x, high_y - low_y), area, at_x // side_x, at_y // side_y
    return found


def timed(*functions, repeats):
    """CPU seconds [function, repeat], in turns."""
    for function in functions:
        function()
    seconds = np.zeros((len(functions), repeats))
    for k in range(repeats):
        for i, function in enumerate(functions):
            begin = time.thread_time()
            function()
            seconds[i, k] = time.thread_time() - begin
    return seconds


def told(ours, theirs, places=2):
    low, high = np.percentile(ours / theirs, [16, 84])
    ratio = np.median(ours) / np.median(theirs)
    return f"{ratio:6.{places}f} ({low:.{places}f}-{high:.{places}f})"


def level_sets(sizes, repeats):
    import contourpy
    from skimage.measure import find_contours

    print("level sets at the median: ms ours, contourpy, skimage; ratios ours/theirs")
    for side in sizes:
        for alpha in ALPHAS:
            h = rough(1, side, alpha)[0]
            level = float(np.median(h)) + 1e-4
            contenders = (
                lambda h=h, level=level: js.level_loops(h, [level]),
                lambda h=h, level=level: contourpy.contour_generator(z=h).lines(level),
                lambda h=h, level=level: find_contours(h, level),
            )
            ours, bare = timed(*contenders[:2], repeats=repeats)
            again, slow = timed(contenders[0], contenders[2], repeats=max(3, repeats // 2))
            found = js.level_loops(h, [level])
            print(
                f"L {side:5d} alpha {alpha:.1f}: {1e3 * np.median(ours):8.2f} "
                f"{1e3 * np.median(bare):8.2f} {1e3 * np.median(slow):9.1f}"
                f"   contourpy {told(ours, bare)}   skimage {told(again, slow, 3)}"
                f"   {len(found)} loops, {found.length.sum()} bonds",
                flush=True,
            )


def points(repeats):
    print("10,000 points, 25 maps of L = 512: s ours, numba; ns a step; ratio")
    for alpha in ALPHAS:
        h = rough(25, 512, alpha)
        rng = np.random.default_rng(0)
        surface = np.repeat(np.arange(25), 400)
        x, y = rng.integers(0, 512, (2, 10_000))
        times = timed(
            lambda h=h: js.trace_loops(h, 400, rng=0),
            lambda h=h, surface=surface, x=x, y=y: scalar_trace(h, surface, x, y),
            repeats=repeats,
        )
        ours = js.trace_loops(h, 400, rng=0).length.sum()
        theirs = scalar_trace(h, surface, x, y)[:, 0].sum()
        steps = np.array([ours, theirs])[:, None]
        ns = 1e9 * times / steps
        middle = np.median(times, 1)
        print(
            f"alpha {alpha:.1f}: {middle[0]:.3f} {middle[1]:.3f} s, {ours:.3g} steps, "
            f"{np.median(ns[0]):.1f} {np.median(ns[1]):.1f} ns, ratio a step {told(*ns)}",
            flush=True,
        )


def threads(repeats):
    """What a pool of two threads over the surfaces of a batch would gain, by the clock."""
    print("eight level sets of a batch: s in one call, in two threads; gain")
    for alpha, side, count in ((0.0, 512, 8), (0.4, 512, 8), (0.4, 2048, 2), (0.4, 128, 64)):
        h = rough(count, side, alpha)
        halves = np.array_split(h, 2)
        seconds = np.zeros((repeats, 2))
        js.level_loops(h, 8, rng=0)
        for row in seconds:
            begin = time.perf_counter()
            js.level_loops(h, 8, rng=0)
            middle = time.perf_counter()
            with ThreadPoolExecutor(2) as pool:
                list(pool.map(lambda half: js.level_loops(half, 8, rng=0), halves))
            row[:] = middle - begin, time.perf_counter() - middle
        one, two = np.median(seconds, 0)
        gain = np.median(seconds[:, 0] / seconds[:, 1])
        print(
            f"L {side:5d} alpha {alpha:.1f} x {count:2d}: {one:.3f} {two:.3f}   {gain:.2f}",
            flush=True,
        )


def scale():
    """A million points over 2,500 maps, and the largest level set, with the memory they take."""
    import resource

    def peak():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20

    begin, clock, making = time.thread_time(), time.perf_counter(), [0.0]

    def maps():
        for k in range(100):
            start = time.thread_time()
            h = rough(25, 512, 0.4, seed=k)
            making[0] += time.thread_time() - start
            yield h

    before = peak()
    found = js.trace_loops(maps(), 400, rng=0, correlation=True)
    seconds = time.thread_time() - begin - making[0]
    steps = found.length.sum()
    print(
        f"{len(found)} points over {found.surfaces} maps of 512 x 512 with G(r): "
        f"{seconds:.0f} s and {making[0]:.0f} s for making the maps, "
        f"{time.perf_counter() - clock:.0f} s by the clock; {steps:.3g} steps, "
        f"{1e9 * seconds / steps:.0f} ns each; peak {peak():.2f} GiB, {before:.2f} before",
        flush=True,
    )
    del found
    js.level_loops(rough(1, 64, 0.4)[0], 1)  # what is imported and compiled once
    for side in (1024, 2048, 4096, 8192):
        h = rough(1, side, 0.4)[0]
        begin = time.thread_time()
        found = js.level_loops(h, 1, placement="quantiles")
        seconds = time.thread_time() - begin
        bonds = found.length.sum()
        print(
            f"level set L {side}: {seconds:.2f} s, {bonds} bonds of {side**2} sites, "
            f"{1e9 * seconds / bonds:.0f} ns a bond, {1e9 * seconds / side**2:.1f} ns a site, "
            f"peak {peak():.2f} GiB with the map's making",
            flush=True,
        )
        del h, found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="*", default=[512, 2048])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--only", choices=["levels", "points", "scale", "threads"])
    chosen = parser.parse_args()
    if chosen.only in (None, "levels"):
        level_sets(chosen.sizes, chosen.repeats)
    if chosen.only in (None, "points"):
        points(chosen.repeats)
    if chosen.only in (None, "scale"):
        scale()
    if chosen.only in (None, "threads"):
        threads(chosen.repeats)
