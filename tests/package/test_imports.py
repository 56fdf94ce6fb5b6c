"""Which room may import which: the table of `belt_fenicsx/README.md`, held by the code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "belt_fenicsx"

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
FACES = {"", "solver", "sweeps", "command"}  # which may import whatever is below them
STANDS_ALONE = {
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


def room(path: Path) -> str:
    inside = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if inside[-1] in ("__init__", "__main__") and len(inside) < 3 else inside[0]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_rooms_import_what_is_below_them(path):
    own = room(path)
    if own in FACES:
        return
    for name in imports(path):
        top, *inside = name.split(".")
        if top == "belt_fenicsx":
            assert inside[0] in BELOW[own] | {own}, name
