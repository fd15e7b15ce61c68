"""Dither: noise far below the step of heights that come in steps.

Heights of growth models are whole numbers, those of an image a converter's counts times a scale.
A contour at a height that many sites have is ill-defined: neighbours lie exactly at the level, or a
saddle does. The paper adds one draw per surface of independent Gaussian noise to such heights; here
it has one thousandth of their step. The step is looked for on each surface, or given.

A surface is on a ladder if all differences between its distinct heights are multiples of the
smallest, up to the rounding of its floating-point format. Heights that repeat without a common step
(a plateau filled in, an image rescaled twice) are left alone, and the result says so.

NumPy alone.
"""

from dataclasses import dataclass

import numpy as np

DITHER = 1e-3  # standard deviation of the dither, in steps of the heights
REPEATS = 0.05  # share of repeated heights in a sample from which on a surface may be on a ladder


@dataclass(frozen=True)
class Steps:
    """What is known of the steps of a stack of maps, one entry a surface.

    Attributes:
        step: the step, 0 for none.
        is_whole: whether the heights are whole numbers, whose step is 1.
        is_unclear: whether heights repeat without a common step.
    """

    step: np.ndarray
    is_whole: np.ndarray
    is_unclear: np.ndarray


def steps_of(heights: np.ndarray, valid: np.ndarray | None) -> Steps:
    """Look for the step of each surface `[surface, x, y]`."""
    found = [
        _step_of(each.ravel() if valid is None else each[valid[k]], 2 * each.shape[1])
        for k, each in enumerate(heights)
    ]
    step, is_whole, is_unclear = np.array(found).T
    return Steps(step, is_whole.astype(bool), is_unclear.astype(bool))


def dithered(heights: np.ndarray, steps: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Heights in float64 with noise of a thousandth of each surface's step."""
    width = DITHER * steps[:, None, None]
    return heights + width * rng.standard_normal(heights.shape)


def described(steps: np.ndarray, are_whole: bool) -> str:
    """What was done, in words."""
    name = "whole-number heights" if are_whole else f"heights in steps of {_span(steps)}"
    return f"dithered {name}: Gaussian noise of {_span(DITHER * steps)} added"


def _span(values: np.ndarray) -> str:
    low, high = values.min(), values.max()
    return f"{low:.2g}" if high - low <= 1e-6 * high else f"{low:.2g} to {high:.2g}"


def _step_of(used: np.ndarray, first: int) -> tuple[float, bool, bool]:
    """Step, wholeness and unclearness of one surface; most are found out by their first heights."""
    sample = np.sort(used[:first])
    repeated = np.count_nonzero(sample[1:] == sample[:-1]) > REPEATS * len(sample)
    if sample[0] == np.rint(sample[0]) and np.all(used == np.rint(used)):
        return 1.0, True, False
    if not repeated:
        return 0.0, False, False
    values = np.unique(used).astype(np.float64)
    if len(values) > len(used) / 2:
        return 0.0, False, False
    rounding = 4 * float(np.finfo(used.dtype).eps) * np.abs(values).max()
    gaps = np.diff(values)
    gaps = gaps[gaps > 2 * rounding]  # others separate one height from itself, rounded otherwise
    if len(gaps) == 0:
        return 0.0, False, True
    multiples = np.rint(gaps / gaps.min())
    step = gaps.sum() / multiples.sum()
    # heights are off by rounding, their differences by twice that
    on_ladder = np.all(np.abs(gaps - multiples * step) <= 2 * rounding) and step > 8 * rounding
    return (step, False, False) if on_ladder else (0.0, False, True)
