"""The demos as notebooks, executed: written into demos/output.

python demos/notebooks.py [NAME ...]
"""

from __future__ import annotations

import sys
from pathlib import Path

import jupytext
import nbformat
from gallery import picture
from nbclient import NotebookClient

HERE = Path(__file__).parent


def notebook(script: Path) -> nbformat.NotebookNode:
    """A demo as a notebook, which runs beside its script."""
    made = jupytext.read(script, fmt="py:percent")
    shown = f"from IPython.display import Image\n\nImage('output/{picture(script.stem.removeprefix('demo_'))}')"
    made.cells.insert(0, nbformat.v4.new_code_cell(f"__file__ = {script.name!r}"))
    made.cells.append(nbformat.v4.new_code_cell(shown))
    made.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return made


def executed(script: Path) -> nbformat.NotebookNode:
    """The same with all its outputs."""
    made = notebook(script)
    NotebookClient(made, timeout=600, resources={"metadata": {"path": str(script.parent)}}).execute()
    return made


def main(names: list[str]) -> None:
    """Writes the notebooks of some demos, or of all."""
    scripts = [HERE / f"demo_{name}.py" for name in names] or sorted(HERE.glob("demo_*.py"))
    (HERE / "output").mkdir(exist_ok=True)
    for script in scripts:
        nbformat.write(executed(script), HERE / "output" / f"{script.stem}.ipynb")


if __name__ == "__main__":
    main(sys.argv[1:])
