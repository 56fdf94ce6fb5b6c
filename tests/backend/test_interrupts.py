"""Ctrl-C and SIGTERM at any time: an exit code, nothing broken, nothing half-written."""

import importlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from belt_fenicsx import Scene, solve
from belt_fenicsx.backend import interrupts

pytestmark = pytest.mark.serial
ROOT = Path(__file__).parents[2]

# Called by PETSc in each iteration.
CALLED = {
    "fitted": ("belt_fenicsx.fitted.newton", "_move_nodes"),
    "augmented-lagrangian": ("belt_fenicsx.lagrangian.newton", "assemble_vector"),
}


@pytest.fixture(autouse=True)
def default_handlers():
    before = {number: signal.signal(number, signal.default_int_handler) for number in interrupts.SIGNALS}
    yield
    assert [signal.getsignal(number) for number in interrupts.SIGNALS] == [signal.default_int_handler] * 2
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_signal_waits_for_the_end_of_the_block():
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts.defer():
        os.kill(os.getpid(), signal.SIGINT)
        done.append("first")
        with interrupts.defer():
            done.append("inner")
        done.append("last")
    assert done == ["first", "inner", "last"]


@pytest.mark.parametrize("number", interrupts.SIGNALS)
def test_a_signal_ends_the_block_where_it_may(number):
    with pytest.raises(KeyboardInterrupt), interrupts.defer():
        interrupts.check()
        os.kill(os.getpid(), number)
        interrupts.check()
        pytest.fail("went on")


def test_ignored_signals_stay_so():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts.defer():
        os.kill(os.getpid(), signal.SIGINT)
        interrupts.check()
    assert signal.signal(signal.SIGINT, signal.default_int_handler) is signal.SIG_IGN


def test_other_threads_have_no_signals():
    done = []

    def work():
        with interrupts.defer():
            interrupts.check()
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [signal.default_int_handler]


@pytest.mark.parametrize("method", CALLED)
def test_a_solve_ends_and_the_next_one_is_as_before(method, monkeypatch):
    before, called = solve(Scene(), method=method), []
    module, name = CALLED[method]
    owner = importlib.import_module(module)
    owner = getattr(owner, "Iteration", None) or owner.petsc
    function = getattr(owner, name)

    def interrupted(*args, **named):
        called.append(os.kill(os.getpid(), signal.SIGINT))
        return function(*args, **named)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, interrupted)
        with pytest.raises(KeyboardInterrupt):
            solve(Scene(), method=method)
    assert called
    again = solve(Scene(), method=method)
    assert (again.omega, again.iterations) == (before.omega, before.iterations)


def test_a_script_that_is_interrupted_ends_by_the_signal():
    code = """
import os, signal
from belt_fenicsx import Scene, solve
from belt_fenicsx.fitted import newton as fitted_newton
moved = fitted_newton.Iteration._move_nodes
fitted_newton.Iteration._move_nodes = lambda *a, **named: os.kill(os.getpid(), signal.SIGINT) or moved(*a, **named)
signal.signal(signal.SIGINT, signal.default_int_handler)
solve(Scene())
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == -signal.SIGINT
    assert "\nKeyboardInterrupt" in result.stderr and "PETSC ERROR" not in result.stderr


SWEEP = ["sweep", "--over", "pulleys.0.x_trans=-0.2:0.2:9000"]


def started(*argv):
    return subprocess.Popen(
        [sys.executable, "-m", "belt_fenicsx", *argv],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # A test run in the background has been told to ignore it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_rows_of_a_sweep_are_kept_and_said_where(number, code, word, tmp_path):
    side = tmp_path / "table.csv.part.0"
    process = started(*SWEEP, "--out", str(tmp_path / "table.csv"))
    while not (side.exists() and side.stat().st_size > 10_000):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(number)
    told = process.communicate(timeout=60)[1]
    rows = sum(1 for line in side.read_text().splitlines() if line)
    assert process.returncode == code
    assert (
        told == f"belt-fenicsx: {word}. {rows} finished rows are kept in {side}; the same command goes on from there.\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == [side.name]


@pytest.mark.parametrize("count", [3, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "argv", [SWEEP, ["--method", "augmented-lagrangian", "--elements", "50000"]], ids=lambda a: a[0]
)
def test_any_time(argv, count):
    times = random.Random(1)
    for number in range(count):
        process = started(*argv)
        time.sleep(times.uniform(0.2, 2.0))
        sent = interrupts.SIGNALS[number % 2]
        process.send_signal(sent)
        told = process.communicate(timeout=60)[1]
        # Python that is still starting ends by the signal itself, before the command line is there.
        before = process.returncode == -sent and "belt_fenicsx/command" not in told
        assert before or process.returncode in (0, 130, 143), told
        assert "Signal" not in told


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_that_an_import_swallows(number, code, tmp_path):
    """As compiled modules do, which turn what comes while they are imported into an error of their own."""
    (tmp_path / "scipy").mkdir()
    (tmp_path / "scipy" / "__init__.py").write_text(
        "import os\n"
        "try:\n"
        f"    os.kill(os.getpid(), {int(number)})\n"
        "    import time; time.sleep(10)\n"
        "except BaseException:\n"
        "    pass\n"
        "raise ImportError('numpy.core.multiarray failed to import')\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "belt_fenicsx", "--method", "bvp"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr
