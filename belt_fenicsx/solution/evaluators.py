"""What makes an evaluator again from the arrays of a file, by method: the package hands it in, as methods are above."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from belt_fenicsx.layout.arrays import Array
    from belt_fenicsx.scene.scene import Scene
    from belt_fenicsx.solution.contact import Zone
    from belt_fenicsx.solution.solution import Evaluator

MAKERS: dict[str, Callable[[Scene, tuple[Zone, ...], Mapping[str, Array]], Evaluator]] = {}
