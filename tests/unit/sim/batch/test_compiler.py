"""Where there is no compiler numpy flies and says so; what others could have written is never loaded."""

import ctypes
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.config import ConfigError
from sim.batch import Compiled, Numpy, choose_stages
from sim.batch import kernel as compiler
from sim.batch.kernel import built

TEXT = "double half(double x) { return 0.5 * x; }\n"


@pytest.fixture(autouse=True)
def kept(needs_program: Callable[..., str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Where compiled text is kept in this test."""
    needs_program("cc")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    compiler.find_compiler.cache_clear()
    return tmp_path / "groundstation" / "kernels"


def _count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Let a script be the compiler that writes down every call of itself."""
    script, calls = tmp_path / "counting-cc", tmp_path / "calls"
    script.write_text(f'#!/bin/sh\necho x >> {calls}\nexec cc "$@"\n')
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    return calls


def test_what_was_compiled_before_is_not_compiled_again(
    kept: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls = _count(monkeypatch, tmp_path)
    built(TEXT)
    assert len(calls.read_text().split()) == 2  # its version, and the text
    built(TEXT)
    assert len(calls.read_text().split()) == 2
    built(TEXT.replace("0.5", "0.25"))
    assert len(calls.read_text().split()) == 3
    assert len(list(kept.iterdir())) == 2
    assert kept.stat().st_mode & 0o777 == 0o700


def _planted(kept: Path) -> Path:
    """Other code in the place of what would be made of ``TEXT``, which it is not: it halves wrongly."""
    with pytest.MonkeyPatch.context() as patch:
        # Elsewhere, as this process keeps what it has once loaded from a path.
        patch.setenv("XDG_CACHE_HOME", str(kept.parents[1] / "workshop"))
        built(TEXT)
        (made,) = (kept.parents[1] / "workshop").rglob("*.so")
        built(TEXT.replace("0.5", "0.25"))
        (other,) = set(made.parent.iterdir()) - {made}
    kept.mkdir(mode=0o700, parents=True)
    return Path(shutil.copy(other, kept / made.name))


def _half(x: float) -> float:
    half = built(TEXT).half
    half.argtypes, half.restype = [ctypes.c_double], ctypes.c_double
    return float(half(x))


def test_what_is_in_the_cache_is_what_runs(kept: Path) -> None:
    _planted(kept)
    assert _half(8.0) == 2.0


@pytest.mark.parametrize(
    "spoil", ["writable folder", "writable root", "linked folder", "writable file", "linked file", "no library"]
)
def test_what_someone_else_could_have_written_is_never_loaded(kept: Path, tmp_path: Path, spoil: str) -> None:
    made, elsewhere = _planted(kept), tmp_path / "elsewhere"
    match spoil:
        case "writable folder":
            kept.chmod(0o777)
        case "writable root":
            kept.parents[1].chmod(0o777)
        case "linked folder":
            kept.rename(elsewhere)
            kept.symlink_to(elsewhere)
        case "writable file":
            made.chmod(0o722)
        case "linked file":
            made.rename(elsewhere)
            made.symlink_to(elsewhere)
        case _:
            made.write_bytes(b"")
    assert _half(8.0) == 4.0


@pytest.mark.skipif(os.geteuid() != 0, reason="left out: only root can give a folder away")
@pytest.mark.parametrize("what", ["root", "folder", "file"])
def test_what_is_someone_elses_is_never_loaded(kept: Path, what: str) -> None:
    made = _planted(kept)
    os.chown({"root": kept.parent, "folder": kept, "file": made}[what], 12345, 12345)
    assert _half(8.0) == 4.0


def test_without_a_compiler_numpy_flies_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -O3")
    stages, note = choose_stages("auto")
    assert stages is Numpy
    assert "no C compiler: 'no-such-compiler' is not installed" in note
    assert choose_stages("numpy") == (Numpy, "")
    with pytest.raises(ConfigError, match="--kernel: no C compiler"):
        choose_stages("c")


def test_where_the_compiler_fails_numpy_flies_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "cc -fno-such-flag")
    stages, note = choose_stages("auto")
    assert stages is Numpy
    assert "'cc' fails: " in note
    assert "no-such-flag" in note


def test_with_a_compiler_flights_are_compiled() -> None:
    assert choose_stages("auto") == (Compiled, "")
    assert choose_stages("c") == (Compiled, "")


def test_without_a_home_it_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    (tmp_path / "file").write_text("")
    assert built(TEXT).half is not None
