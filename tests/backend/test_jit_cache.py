"""Compiled forms on the disk: whole or not at all, private, and made again where they were damaged."""

import os
import signal
import stat
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from belt_fenicsx.backend import compiling as jit_cache
from belt_fenicsx.backend.compiling import NotCompiled, cached, compiling, private_folder

pytestmark = pytest.mark.serial


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "belt_fenicsx"


class Compiler:
    """Writes a library of one letter, or finds one."""

    def __init__(self):
        self.runs = 0

    def __call__(self, folder):
        library = folder / "a.so"
        if not library.exists():
            self.runs += 1
            (folder / "a.c").write_text("source")
            library.write_text("x" * 1000)
        return library.read_text()


def test_an_entry_is_made_once(cache):
    compiler = Compiler()
    assert [cached(["a", "b"], compiler) for _ in range(3)] == ["x" * 1000] * 3
    assert compiler.runs == 1
    for key in (["a"], ["ab"], ["b", "a"]):
        cached(key, compiler)
    assert compiler.runs == 4 == len(list(cache.iterdir()))


@pytest.mark.parametrize(
    "damage",
    [
        lambda entry: (entry / "a.so").unlink(),
        lambda entry: (entry / "a.so").write_text("x" * 999),
        lambda entry: (entry / "a.so").write_text("x" * 999 + "y"),
        lambda entry: (entry / "a.c").unlink(),
        lambda entry: (entry / "sha256").unlink(),
        lambda entry: (entry / "sha256").write_bytes(b"\xff"),
    ],
)
def test_a_damaged_entry_is_made_again(damage, cache):
    compiler = Compiler()
    cached(["a"], compiler)
    (entry,) = cache.iterdir()
    damage(entry)
    assert cached(["a"], compiler) == cached(["a"], compiler) == "x" * 1000
    assert compiler.runs == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError("disk")])
def test_an_interrupted_compiler_leaves_nothing(error, cache):
    def compiler(folder):
        (folder / "a.c").write_text("half")
        raise error

    with pytest.raises(error if isinstance(error, type) else type(error)):
        cached(["a"], compiler)
    assert list(cache.iterdir()) == []
    assert cached(["a"], Compiler()) == "x" * 1000


def test_two_that_compile_the_same_do_not_disturb_each_other(cache):
    compiler, other = Compiler(), Compiler()

    def slow(folder):
        result = compiler(folder)
        # As another process would do it meanwhile.
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(jit_cache, "_compiling", jit_cache.threading.Lock())
            cached(["a"], other)
        return result

    assert cached(["a"], slow) == "x" * 1000
    assert (compiler.runs, other.runs) == (1, 1)
    assert len(list(cache.iterdir())) == 1
    cached(["a"], compiler)
    assert compiler.runs == 1


def test_threads_compile_one_after_another(cache):
    compiler, running = Compiler(), []

    def slow(folder):
        assert not running
        running.append(folder)
        time.sleep(0.01)
        running.clear()
        return compiler(folder)

    with ThreadPoolExecutor(8) as pool:
        assert len(list(pool.map(lambda _: cached(["a"], slow), range(16)))) == 16
    assert compiler.runs == 1


def test_folders_of_killed_processes_are_removed_at_last(cache):
    cached(["a"], Compiler())
    for name, age in (("old", 90_000.0), ("new", 10.0)):
        folder = cache / f"unfinished-{name}"
        folder.mkdir()
        os.utime(folder, (time.time() - age, time.time() - age))
    cached(["b"], Compiler())
    assert [path.name for path in cache.glob("unfinished-*")] == ["unfinished-new"]


def test_the_folder_is_private_whatever_the_mask(cache):
    before = os.umask(0)
    try:
        assert private_folder() == cache
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    for mode in (0o770, 0o707):
        cache.chmod(mode)
        with pytest.raises(NotCompiled, match=f"others may write to {cache}.*chmod 700.*XDG_CACHE_HOME"):
            cached(["a"], Compiler())
    cache.chmod(0o755)
    assert private_folder() == cache


@pytest.mark.parametrize("value", ["", "here", None])
def test_no_folder_is_the_users_own(value, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    if value is not None:
        monkeypatch.setenv("XDG_CACHE_HOME", value)
    assert private_folder() == tmp_path / ".cache" / "belt_fenicsx"


def test_errors_are_whole_and_name_the_variable():
    with pytest.raises(NotCompiled, match="remove /a/b.c.*XDG_CACHE_HOME") as caught, compiling():
        raise TimeoutError("timed out.\n        Try cleaning cache (e.g. remove /a/b.c) or")
    assert "\n" not in str(caught.value)


def run(tmp_path, *argv, **kwargs):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    return subprocess.run(
        [sys.executable, "-m", "belt_fenicsx", *argv], env=environment, capture_output=True, text=True, **kwargs
    )


def test_damaged_libraries_and_a_killed_compiler_in_a_real_cache(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "belt_fenicsx"], env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    )
    while not list(tmp_path.glob("belt_fenicsx/unfinished-*/*.c")):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert run(tmp_path, timeout=60).returncode == 0
    libraries = sorted(tmp_path.glob("belt_fenicsx/[!u]*/*.so"))
    assert len(libraries) >= 2
    os.truncate(libraries[0], 5000)
    libraries[1].unlink()
    assert run(tmp_path, timeout=60).returncode == 0
    assert sorted(tmp_path.glob("belt_fenicsx/[!u]*/*.so")) == libraries


def test_a_relative_cache_loads_no_code_from_here(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": ""}
    argv = [sys.executable, "-m", "belt_fenicsx", "--method", "augmented-lagrangian", "--elements", "30"]
    result = subprocess.run(argv, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert list(tmp_path.iterdir()) == []
