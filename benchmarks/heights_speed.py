"""Speed and memory of the height measures, side by side with tamaas and SurfaceTopography.

    python benchmarks/heights_speed.py [--rounds 5] [--size 512] [--batch 25] [--largest 4096]

Every round times all competitors one after the other, so that a busy machine slows all of them; a
ratio is ours over the fastest peer's in the same round, reported as median [least, largest]. Peers
work in float64, the only precision they have; ours in float32, JAX's default, and in float64.
"""

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import jax
import numpy as np
import tamaas
from SurfaceTopography import Topography
from SurfaceTopography.Generation import fourier_synthesis

import jaxsurf as js
from jaxsurf.measures import curvature, differences, fourier, patches, smoothing

LAW = js.SelfAffine(alpha=0.4)


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    jax.block_until_ready(work())
    return time.perf_counter() - start


def compare(
    name: str, bar: float, rounds: int, ours: dict, peers: dict, per: dict[str, int]
) -> None:
    """Print the time of each competitor per unit of work, and our ratios to the fastest peer."""
    everyone = ours | peers
    for work in everyone.values():
        seconds(work)  # compile, plan, load
    times = {who: [] for who in everyone}
    for _ in range(rounds):
        for who, work in everyone.items():
            times[who].append(seconds(work) / per.get(who, 1))
    print(f"\n{name} (bar: {bar:g})")
    for who, measured in times.items():
        print(f"  {who:28} {statistics.median(measured) * 1e3:10.3f} ms")
    for who in ours:
        ratio = [
            a / min(b)
            for a, b in zip(times[who], zip(*(times[p] for p in peers), strict=True), strict=True)
        ]
        middle = statistics.median(ratio)
        verdict = "met" if middle <= bar else "MISSED"
        print(f"  ratio of {who:19} {middle:10.4f} [{min(ratio):.4f}, {max(ratio):.4f}]  {verdict}")


def generation(size: int, batch: int, rounds: int) -> None:
    shape, key = (size, size), jax.random.key(0)
    generator = tamaas.SurfaceGeneratorFilter2D([size, size])
    spectrum = tamaas.Isopowerlaw2D()
    spectrum.q0, spectrum.q1, spectrum.q2, spectrum.hurst = 1, 1, size // 2, 0.4
    generator.spectrum = spectrum
    compare(
        f"Generating {size}^2 surfaces, per surface",
        0.4,
        rounds,
        {
            "jaxsurf": lambda: js.sample(LAW, shape, key=key, batch=batch),
            "jaxsurf float64": lambda: js.sample(
                LAW, shape, key=key, batch=batch, dtype=np.float64
            ),
        },
        {
            "tamaas filter": lambda: [generator.buildSurface() for _ in range(3)],
            "SurfaceTopography": lambda: [
                fourier_synthesis(shape, (1.0, 1.0), 0.4, rms_height=1.0) for _ in range(3)
            ],
        },
        {"jaxsurf": batch, "jaxsurf float64": batch, "tamaas filter": 3, "SurfaceTopography": 3},
    )


def quadratic(size: int, batch: int, rounds: int) -> None:
    wide = np.asarray(js.sample(LAW, (size, size), key=jax.random.key(1), batch=batch), np.float64)
    maps = jax.numpy.asarray(wide, np.float32)
    one = np.ascontiguousarray(wide[0])
    topography = Topography(one, (float(size), float(size)), periodic=True)
    per = {"jaxsurf": batch, "jaxsurf float64": batch}
    compare(
        f"Radial spectrum of {size}^2, per map (tamaas: the 2-D spectrum, not averaged)",
        0.7,
        rounds,
        {
            "jaxsurf": lambda: js.power_spectrum(maps).samples,
            "jaxsurf float64": lambda: js.power_spectrum(wide).samples,
        },
        {
            "tamaas": lambda: tamaas.Statistics2D.computePowerSpectrum(one),
            "SurfaceTopography": topography.power_spectrum_from_area,
        },
        per,
    )
    compare(
        f"Height correlation of {size}^2, per map (tamaas: the 2-D map, not averaged)",
        0.7,
        rounds,
        {
            "jaxsurf": lambda: js.height_correlation(maps).samples,
            "jaxsurf float64": lambda: js.height_correlation(wide).samples,
        },
        {
            "tamaas": lambda: tamaas.Statistics2D.computeAutocorrelation(one),
            "SurfaceTopography": topography.autocorrelation_from_area,
        },
        per,
    )


def curvatures(size: int, batch: int, rounds: int) -> None:
    scales = np.unique(np.geomspace(1, size // 4, 26).astype(np.int32))[:20]
    wide = np.asarray(js.sample(LAW, (size, size), key=jax.random.key(1), batch=batch), np.float64)
    maps = jax.numpy.asarray(wide, np.float32)
    topography = Topography(wide[0], (float(size), float(size)), periodic=True)

    def moments(along_x: np.ndarray, along_y: np.ndarray) -> list[float]:
        return [np.mean(along_x**q) + np.mean(along_y**q) for q in (2, 3, 4)]

    compare(
        f"Curvature moments 2-4 of {size}^2, per map and scale, {len(scales)} scales",
        1 / 50,
        rounds,
        {"jaxsurf": lambda: curvature.moments(maps, scales, orders=(2, 3, 4))},
        {
            "SurfaceTopography": lambda: topography.scale_dependent_statistical_property(
                moments, n=2, distance=[float(b) for b in scales[::4]]
            )
        },
        {"jaxsurf": batch * len(scales), "SurfaceTopography": len(scales[::4])},
    )


def whole_set(maps: jax.Array) -> dict[str, Callable[[np.ndarray], object]]:
    """Every measure as a function of its scales."""
    shape = (maps.shape[-2], maps.shape[-1])
    return {
        "spectrum": lambda b: fourier.radial(fourier.density(maps), shape=shape),
        "height correlation": lambda b: differences.ring_means(
            *differences.correlation_map(maps), shape=shape
        ),
        "D_q along {10}": lambda b: differences.moments(maps, b, orders=(1.5, 3)),
        "curvature 2-4": lambda b: curvature.moments(maps, b, orders=(2, 3, 4)),
        "patches 2-3": lambda b: patches.moments(maps, b, orders=(2, 3)),
        "smoothed, box": lambda b: smoothing.moments(maps, b, orders=(2, 3)),
        "smoothed, Gaussian": lambda b: smoothing.moments(
            maps, b, orders=(2, 3), window="gaussian"
        ),
    }


def growth(largest: int, rounds: int) -> None:
    """The exponent of the cost in the number of sites, at the same 8 scales."""
    sides = [n for n in (128, 256, 512, 1024, 2048, 4096) if n <= largest]
    scales = np.array([1, 2, 3, 5, 8, 13, 21, 32], np.int32)
    times: dict[str, list[float]] = {}
    for side in sides:
        maps = js.sample(LAW, (side, side), key=jax.random.key(2), batch=max(1, 512**2 // side**2))
        for name, work in whole_set(maps).items():
            seconds(lambda work=work: work(scales))
            best = min(seconds(lambda work=work: work(scales)) for _ in range(rounds))
            times.setdefault(name, []).append(best / maps.shape[0])
    print(f"\nCost per map against the number of sites, L = {sides[0]} ... {sides[-1]} (bar: 1.15)")
    for name, cost in times.items():
        exponent = np.polyfit(2 * np.log(sides), np.log(cost), 1)[0]
        shown = "  ".join(f"{1e3 * t:.2f}" for t in cost)
        verdict = "met" if exponent <= 1.15 else "MISSED"
        print(f"  {name:20} {exponent:6.3f}  {verdict}   [{shown}] ms")


def compilation() -> None:
    """Seconds to compile the whole set, and whether other scales or alphas compile again."""
    maps = js.sample(LAW, (512, 512), key=jax.random.key(3), batch=2)
    first = np.array([1, 2, 4, 8, 16], np.int32)
    work = whole_set(maps)
    wall, processor = {}, {}
    for name, f in work.items():
        processor[name] = -time.process_time()
        wall[name] = seconds(lambda f=f: f(first))
        processor[name] += time.process_time()
        wall[name] -= seconds(lambda f=f: f(first))
    print(
        f"\nCompiling the whole set at 512^2: {sum(wall.values()):.1f} s by the clock, "
        f"{sum(processor.values()):.1f} s of the processor (bar: 10)"
    )
    print("  " + ", ".join(f"{name} {t:.1f}" for name, t in wall.items()))
    cores = (curvature.stencil_moments, patches.moments, smoothing.moments)
    counts = [f._cache_size() for f in cores]
    for f in work.values():
        f(first + 3)
    js.sample(js.SelfAffine(alpha=0.7), (512, 512), key=jax.random.key(3), batch=2)
    again = [f._cache_size() for f in cores]
    print(f"  new scales compiled anew: {'yes' if again != counts else 'no'}")


PEAK = """
import resource, sys, jax, numpy as np
name, side, batch = sys.argv[1], 512, int(sys.argv[2])
maps = jax.numpy.asarray(np.random.default_rng(0).normal(size=(batch, side, side)), np.float32)
import importlib.util
spec = importlib.util.spec_from_file_location("bench", sys.argv[3])
bench = importlib.util.module_from_spec(spec); spec.loader.exec_module(bench)
b = np.array([1, 2, 4, 8, 16], np.int32)
jax.block_until_ready(bench.whole_set(maps[:1])[name](b))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
jax.block_until_ready(bench.whole_set(maps)[name](b))
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 / maps.nbytes)
"""


def memory(batch: int) -> None:
    """Growth of the peak of a fresh process over the batch's own bytes."""
    print(f"\nMemory beside the batch of {batch} x 512^2, in the batch's bytes (bar: 12)")
    for name in whole_set(jax.numpy.zeros((1, 8, 8))):
        run = subprocess.run(
            [sys.executable, "-c", PEAK, name, str(batch), __file__],
            capture_output=True,
            text=True,
            check=True,
        )
        factor = float(run.stdout)
        print(f"  {name:20} {factor:6.2f}  {'met' if factor <= 12 else 'MISSED'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--batch", type=int, default=25)
    parser.add_argument("--largest", type=int, default=4096)
    parser.add_argument(
        "--only", default="compilation,generation,quadratic,curvatures,growth,memory"
    )
    asked = parser.parse_args()
    only = asked.only.split(",")
    if "compilation" in only:
        compilation()
    if "generation" in only:
        generation(asked.size, asked.batch, asked.rounds)
    if "quadratic" in only:
        quadratic(asked.size, asked.batch, asked.rounds)
    if "curvatures" in only:
        curvatures(asked.size, asked.batch, asked.rounds)
    if "growth" in only:
        growth(asked.largest, max(2, asked.rounds // 2))
    if "memory" in only:
        memory(2 * asked.batch)


if __name__ == "__main__":
    main()
