"""The house: a room imports only rooms above it, and heavy libraries only where they belong."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import jaxsurf

SOURCE = Path(jaxsurf.__file__).parent
ROOMS = [
    "_checks",
    "_grid",
    "theory",
    "laws",
    "curve",
    "surfaces",
    "measures",
    "loops",
    "fitting",
    "io",
    "analysis",
    "sweeps",
    "report",
    "cli",
]
#: library -> the only rooms that may import it; None for nowhere
ONLY = {
    "matplotlib": {"report"},
    "xarray": {"sweeps"},
    "rich": {"cli"},
    "cyclopts": {"cli"},
    "pandas": set(),
    "numba": set(),
}
#: rooms or files that must do without JAX, themselves and all they import of jaxsurf
WITHOUT_JAX = ["theory", "io", "loops/trace", "loops/levels", "loops/loops", "_grid"]


def files():
    return sorted(SOURCE.rglob("*.py"))


def module_of(path):
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path, *, everywhere=True):
    """Modules imported by a file, those inside functions too unless told otherwise."""
    tree = ast.parse(path.read_text())
    found = set()
    skipped = set()
    for node in ast.walk(tree):
        lazy = isinstance(node, ast.FunctionDef) and not everywhere
        typing_only = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        if lazy or typing_only:
            skipped.update(id(inner) for inner in ast.walk(node))
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
            found.add(node.module)
    return found


def room_of(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[0] == "jaxsurf" else None


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(SOURCE)))
def test_a_room_imports_only_rooms_above_it(path):
    own = room_of(module_of(path))
    if own is None:  # the public surface imports from every room
        return
    assert own in ROOMS, f"{own} is not a room of the house"
    for module in imports(path):
        other = room_of(module)
        if other in ROOMS:
            assert ROOMS.index(other) <= ROOMS.index(own), f"{module_of(path)} imports {module}"


def test_rooms_hold_no_circle():
    modules = {module_of(path): path for path in files()}
    edges = {
        name: {m for m in imports(path, everywhere=False) if m in modules and m != name}
        for name, path in modules.items()
        if name != "jaxsurf"
    }
    done, active = set(), []

    def visit(name):
        if name in done or name not in edges:
            return
        assert name not in active, " -> ".join([*active, name])
        active.append(name)
        for other in edges[name]:
            visit(other)
        active.pop()
        done.add(name)

    for name in edges:
        visit(name)


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(SOURCE)))
def test_libraries_stay_in_their_rooms(path):
    own = room_of(module_of(path))
    for module in imports(path):
        library = module.split(".")[0]
        if library in ONLY:
            assert own in ONLY[library], f"{module_of(path)} imports {library}"


@pytest.mark.parametrize("start", WITHOUT_JAX)
def test_numpy_rooms_do_without_jax(start):
    modules = {module_of(path): path for path in files()}
    waiting = [
        module_of(path)
        for path in files()
        if str(path.relative_to(SOURCE).with_suffix("")).startswith(start)
    ]
    seen = set()
    while waiting:
        name = waiting.pop()
        if name in seen or name == "jaxsurf":
            continue
        seen.add(name)
        for module in imports(modules[name], everywhere=False):
            assert module.split(".")[0] not in ("jax", "equinox", "jaxlib"), f"{name}: {module}"
            if module in modules:
                waiting.append(module)


def test_no_file_is_two_concepts():
    for path in files():
        assert len(path.read_text().splitlines()) <= 400, path


@pytest.mark.parametrize(
    ("missing", "module", "remedy"),
    [
        ("cyclopts", "jaxsurf.cli", "jaxsurf[cli]"),
        ("matplotlib", "jaxsurf.report", "jaxsurf[plot]"),
    ],
)
def test_a_missing_extra_is_named(missing, module, remedy):
    program = f"import sys; sys.modules[{missing!r}] = None; import {module}"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert found.returncode != 0
    assert missing in found.stderr
    assert remedy in found.stderr


def test_import_is_light_and_changes_no_setting():
    program = (
        "import jax; before = dict(jax.config.values); import jaxsurf, sys; "
        "assert dict(jax.config.values) == before; "
        "heavy = {'matplotlib', 'xarray', 'rich', 'cyclopts', 'pandas', 'h5py'}; "
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
