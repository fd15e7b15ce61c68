"""How far is Table I from the paper, over several seeds, and what does one run cost?

    python benchmarks/table1.py [--seeds 5]

Prints, for each entry, the mean and scatter of our direct value over seeds, the mean total error of
one run, the paper's value, and how often one run lies within two combined standard errors of it;
then the time and the memory of the runs. One run is what `jaxsurf table1` does, without pictures.
"""

import argparse
import resource
import time

import numpy as np

from jaxsurf.analysis.table1 import EXPONENTS, Table1Settings, name_of, reproduce_table1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    seeds = parser.parse_args().seeds
    tables, seconds = [], []
    for seed in range(seeds):
        started = time.perf_counter()
        tables.append(reproduce_table1(Table1Settings(seed=seed)))
        seconds.append(time.perf_counter() - started)
    print(f"{'surface':12} {'':6} {'mean ± scatter':>16} {'error':>7} {'paper':>14}  within 2")
    inside = np.zeros(seeds, int)
    for i, row in enumerate(tables[0].rows):
        for name in EXPONENTS:
            rows = [table.rows[i] for table in tables]
            values = np.array([r.value(name) for r in rows])
            errors = np.array([np.hypot(*r.errors(name)) for r in rows])
            within = np.array([abs(r.pull(name)) <= 2 for r in rows])
            inside += within
            quoted = "{:g} ± {:g}".format(*row.paper[name])
            print(
                f"{name_of(row.alpha):12} {name:6} {values.mean():8.3f} ± {values.std():.3f} "
                f"{errors.mean():7.3f} {quoted:>14}  {within.sum()}/{seeds}"
            )
    entries = len(tables[0].rows) * len(EXPONENTS)
    print(f"entries within 2 combined standard errors, seed by seed: {inside} of {entries}")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"seconds: {np.round(seconds, 1)} (the first compiles), median {np.median(seconds):.1f}; "
        f"peak memory {memory:.2f} GiB"
    )


if __name__ == "__main__":
    main()
