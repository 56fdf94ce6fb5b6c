"""Solutions as they show themselves: one line in a terminal, a table and a figure in a notebook."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from belt_fenicsx import Scene, Solution, Status, bvp


@pytest.fixture(scope="module")
def solution():
    return bvp.solve(Scene(), rtol=1e-6)


def failed(message):
    return Solution(scene=Scene(), method="made up", status=Status.CONTACT_LOST, message=message)


class Parts(HTMLParser):
    """The rows of a page's table, and the tags that were opened and not closed."""

    def __init__(self, page):
        super().__init__()
        self.rows, self.open = [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in ("img", "br"):
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "tr" in self.open:
            self.rows[-1].append(data)


def test_repr_is_one_line(solution):
    text = repr(solution)
    assert str(solution) == text
    assert re.fullmatch(
        r"<Solution bvp: SOLVED, omega = 1\.4807\d+ rad/s, contact -0\.2373\d+ \.\.\. 0\.2360\d+ m, "
        r"torque = 610\.\d+ N m, \d+ iterations>",
        text,
    )


def test_repr_of_a_failure():
    assert repr(failed("nowhere")) == "<Solution made up: CONTACT_LOST, 0 iterations>"


def test_solutions_compare_by_their_values():
    solution = replace(failed("one"), error_estimate=0.0)
    assert solution == replace(solution) != replace(solution, message="two")


def test_html_is_a_table_with_a_figure(solution):
    page = solution._repr_html_()
    parts = Parts(page)
    assert parts.open == []
    rows = dict(parts.rows)
    assert rows["omega"].startswith("1.4807") and rows["omega"].endswith(" rad/s")
    assert rows["zones"] == "stick, forward slip"
    assert Status.SOLVED.value in page
    (data,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert base64.b64decode(data).startswith(b"\x89PNG")
    assert len(page) < 60_000


def test_html_of_a_failure_is_marked_and_escaped():
    page = failed("Stage `x`: <b> & more")._repr_html_()
    assert "NO SOLUTION" in page
    assert "&lt;b&gt; &amp; more" in page
    assert "<img" not in page
    assert Parts(page).open == []
