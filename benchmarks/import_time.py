"""How long does `import jaxsurf` take beside `import jax, optimistix`, its own core?

    python benchmarks/import_time.py [--runs 9]

Prints both medians, and the median of the ratios of neighbouring runs with its range.
"""

import argparse
import subprocess
import sys
import time

import numpy as np


def seconds(statement: str) -> float:
    started = time.perf_counter()
    subprocess.run([sys.executable, "-c", statement], check=True)
    return time.perf_counter() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    runs = parser.parse_args().runs
    seconds("import jaxsurf")  # the files come from the disk once
    pairs = np.array(
        [(seconds("import jax, optimistix"), seconds("import jaxsurf")) for _ in range(runs)]
    )
    ratios = pairs[:, 1] / pairs[:, 0]
    core, ours = np.median(pairs, 0)
    print(f"jax, optimistix {core:.2f} s; jaxsurf {ours:.2f} s")
    print(f"ratio {np.median(ratios):.2f} [{ratios.min():.2f}, {ratios.max():.2f}]")


if __name__ == "__main__":
    main()
