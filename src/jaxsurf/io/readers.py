"""Readers: a file -> HeightMap. One function a format, one line in `READERS`.

Plain arrays (.npy, .npz, .csv and other text tables) need nothing but NumPy. Nothing is unpickled.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxsurf.io.heightmap import HeightMap

HEIGHT_NAMES = ("heights", "height", "elevation", "z", "h")


def read_heights(path: str | Path) -> HeightMap:
    """Read a height map from a file.

    Arguments:
        path: .npy (one array); .npz (an array named heights, height, elevation, z or h, or the only
            two-dimensional one; optionally spacing, length_unit, height_unit); .csv, .txt or .dat
            (a table of numbers separated by commas, semicolons, tabs or spaces).

    Returns:
        The map, in sites and unit heights where the file does not say otherwise.

    Raises:
        FileNotFoundError: no such file.
        ValueError: an unknown suffix, or contents that are not one map of real numbers.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no file at {str(path)!r}. Check the name and the folder.")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"a height map's suffix must be one of {sorted(READERS)}; got {path.suffix!r}. "
            "Export the map as .csv or .npy first."
        )
    return reader(path)


def _read_npy(path: Path) -> HeightMap:
    return _as_map(np.load(path, allow_pickle=False), path)


def _read_npz(path: Path) -> HeightMap:
    with np.load(path, allow_pickle=False) as archive:
        flat = [name for name in archive.files if archive[name].ndim == 2]
        named = [name for name in HEIGHT_NAMES if name in flat] or flat
        if not named or (len(named) > 1 and named == flat):
            raise ValueError(
                f"{path.name} must hold one two-dimensional array; got {flat or 'none'}. "
                f"Name the heights one of {list(HEIGHT_NAMES)}."
            )
        spacing = float(archive["spacing"]) if "spacing" in archive.files else 1.0
        units = [
            str(archive[name]) if name in archive.files else default
            for name, default in (("length_unit", "sites"), ("height_unit", "1"))
        ]
        return _as_map(archive[named[0]], path, spacing, *units)


def _read_text(path: Path) -> HeightMap:
    text = path.read_text(encoding="utf-8-sig")
    first = next((line for line in text.splitlines() if line.strip() and line[0] != "#"), "")
    delimiter = next((mark for mark in (",", ";", "\t") if mark in first), None)
    try:
        table = np.genfromtxt(
            text.splitlines(), delimiter=delimiter, comments="#", dtype=float, invalid_raise=True
        )
    except ValueError as error:
        raise ValueError(
            f"{path.name} must be a table with as many numbers in every row; got {error}. "
            "Remove headers, or mark them with '#'."
        ) from error
    return _as_map(table, path)


def _as_map(
    array: np.ndarray, path: Path, spacing: float = 1.0, length: str = "sites", height: str = "1"
) -> HeightMap:
    try:
        return HeightMap(array, spacing, length, height, path.name)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path.name} does not hold a height map: {error}") from error


READERS: dict[str, Callable[[Path], HeightMap]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".csv": _read_text,
    ".txt": _read_text,
    ".dat": _read_text,
}
