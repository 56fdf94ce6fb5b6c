"""Tables that scripts write into the README of the studies, each between two markers of its own."""

from pathlib import Path

README = Path(__file__).parent / "README.md"


def write_into_readme(name: str, text: str) -> None:
    """Replaces what stands between ``<!-- name -->`` and ``<!-- /name -->``.

    Raises:
        ValueError: The README has no such markers.
    """
    before, start, rest = README.read_text().partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- /{name} -->")
    if not (start and end):
        raise ValueError(f"The README has no place for `{name}`.")
    README.write_text(f"{before}{start}{text}\n{end}{after}")
