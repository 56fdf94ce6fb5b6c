"""Which subpackage may import which: the table of `belt_fenicsx/README.md`, held by the code."""

from __future__ import annotations

import ast
import graphlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "belt_fenicsx"
MODULES = sorted(PACKAGE.rglob("*.py"))

BELOW = {
    "scene": {"scene"},
    "mechanics": {"mechanics"},
    "backend": {"scene"},
    "layout": {"scene"},
    "solution": {"scene", "backend", "layout"},
    "taut_string": {"scene", "layout", "solution"},
    "search": {"scene", "layout", "solution", "taut_string"},
    "fitted": {"scene", "mechanics", "backend", "layout", "solution", "taut_string", "search"},
    "lagrangian": {"scene", "mechanics", "backend", "layout", "solution", "taut_string", "search"},
    "bvp": {"scene", "layout", "solution", "taut_string", "search"},
}
FACES = {"", "solver", "safety", "sweeps", "command"}  # which may import whatever is below them
THIRD_PARTIES = {  # of those that may not import all
    "scene": set(),
    "mechanics": {"ufl"},
    "layout": {"numpy"},
    "search": {"numpy"},
    "bvp": {"numpy", "scipy"},
}


def imports(path: Path) -> Iterator[str]:
    """Modules that a file imports when it runs, those inside of functions, too."""
    tree = ast.parse(path.read_text())
    typing = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and ast.unparse(branch.test) == "TYPE_CHECKING"
        for node in ast.walk(branch)
    }
    for node in ast.walk(tree):
        if id(node) in typing:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def subpackage(path: Path) -> str:
    inside = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if inside[-1] in ("__init__", "__main__") and len(inside) < 3 else inside[0]


def module(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.mark.parametrize("path", MODULES, ids=module)
def test_subpackages_import_what_is_below_them(path):
    own = subpackage(path)
    if own in FACES:
        return
    for name in imports(path):
        top, *inside = name.split(".")
        if top == "belt_fenicsx":
            assert inside[0] in BELOW[own] | {own}, name
        elif top not in sys.stdlib_module_names:
            assert top in THIRD_PARTIES.get(own, {top}), name


def test_no_circle():
    names, graph = set(map(module, MODULES)), graphlib.TopologicalSorter[str]()
    for path in MODULES:
        # What is imported is a module, or stands in one.
        wanted = {name if name in names else name.rpartition(".")[0] for name in imports(path)}
        graph.add(module(path), *wanted & names)
    graph.prepare()


def test_the_map_tells_the_same():
    text = (PACKAGE / "README.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", text, re.MULTILINE))
    assert {own: set(re.findall(r"`(\w+)`", rows[own])) for own in BELOW} == {own: BELOW[own] - {own} for own in BELOW}
    assert FACES - {"", "solver"} == rows.keys() - BELOW.keys()
    for name in re.findall(r"^\d\. `([\w.]+)`", text, re.MULTILINE):
        assert (PACKAGE / name.replace(".", "/")).with_suffix(".py").is_file(), name
