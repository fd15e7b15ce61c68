"""Writing a folder of results so that nobody ever finds half of it.

Everything is written into a hidden folder beside the target, which takes the target's place only
when all of it is there. An interruption leaves what stood there before.
"""

import json
import platform
import shutil
import tempfile
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from jaxsurf.curve import Curve

Writer = Callable[[Path], Any]


def write_folder(folder: str | Path, files: Mapping[str, Writer]) -> Path:
    """Write all files, or none.

    Arguments:
        folder: the target; files of other names in it are kept.
        files: file name -> a function that writes it at the path it is given.

    Returns:
        The folder.

    Raises:
        NotADirectoryError: the target exists and is a file.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{str(folder)!r} must be a folder; got a file. Name another one.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as name:
        scratch = Path(name)
        for file, write in files.items():
            write(scratch / file)
        folder.mkdir(exist_ok=True)
        for file in files:
            shutil.move(scratch / file, folder / file)
    return folder


def write_json(content: Mapping[str, Any]) -> Writer:
    """A writer of JSON with the versions that made it; what is not a number becomes null."""
    versions = {name: version(name) for name in ("jaxsurf", "jax", "jaxlib", "numpy", "optimistix")}
    whole = dict(content) | {"versions": versions | {"python": platform.python_version()}}
    return lambda path: path.write_text(json.dumps(_nullified(whole), indent=1) + "\n")


def write_csv(records: list[dict[str, Any]]) -> Writer:
    """A writer of one record a row, under a header; what is not a number is left empty."""
    header = ",".join(records[0])
    rows = [",".join(_cell(value) for value in record.values()) for record in records]
    return lambda path: path.write_text("\n".join([header, *rows]) + "\n")


def write_curves(curves: Mapping[str, Curve]) -> Writer:
    """A writer of curves as .npz: name/scale, name/samples, name/weights."""
    arrays = {
        f"{name}/{part}": np.asarray(getattr(curve, part))
        for name, curve in curves.items()
        for part in ("scale", "samples", "weights")
    }
    return lambda path: np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]


def _nullified(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _nullified(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_nullified(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        return _nullified(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if np.isfinite(value) else ""
    return str(value)
