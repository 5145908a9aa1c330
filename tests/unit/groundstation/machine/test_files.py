"""Text files are UTF-8 in any locale and written whole or not at all; no output ends a program."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from groundstation.machine import open_whole, write_whole

ASCII_LOCALE = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"}
"""The locale of a machine that has none, with what Python does about it switched off."""


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_text_is_there_as_a_whole_or_what_was_there_before(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    write_whole(path, "² before\n")
    path.chmod(0o640)
    with pytest.raises(ZeroDivisionError), open_whole(path) as file:
        file.write("half of")
        1 / 0  # noqa: B018
    assert path.read_bytes() == "² before\n".encode()
    write_whole(path, "after\r\n")
    assert path.read_bytes() == b"after\r\n"
    assert path.stat().st_mode & 0o777 == 0o640
    assert names_in(tmp_path) == ["lab.toml"]


def test_a_link_stays_a_link_and_a_pipe_is_written_to(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_whole(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    write_whole(Path(os.devnull), "nobody reads this")
    assert Path(os.devnull).is_char_device()


def test_what_cannot_be_written_is_said_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path, "text")
    with pytest.raises(FileNotFoundError) as nowhere:
        write_whole(tmp_path / "nowhere" / "a", "text")
    assert nowhere.value.filename == str(tmp_path / "nowhere" / "a")
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(NotADirectoryError) as within:
        write_whole(tmp_path / "file" / "a", "text")
    assert within.value.filename == str(tmp_path / "file" / "a")
    assert names_in(tmp_path) == ["file"]


def run(
    *command: str, folder: Path, locale: dict[str, str] = ASCII_LOCALE
) -> subprocess.CompletedProcess[bytes]:
    program = Path(sys.executable).with_name(command[0])
    env = {**os.environ, **locale}
    return subprocess.run(
        [program, *command[1:]], cwd=folder, env=env, capture_output=True, check=False
    )


def test_a_flight_in_a_locale_without_utf_8_leaves_the_same_files(tmp_path: Path) -> None:
    """Also where the folder's own name, and so a path in the configuration, is no ASCII."""
    folder = tmp_path / "Mü"
    folder.mkdir()
    (folder / "lab.toml").write_text('[mqtt]\nusername = "a"\npassword_file = "pass"\n', "utf-8")
    command = ("groundstation-sim", "fly", "--duration", "1", "--config", "lab.toml", "--out")
    plain, utf_8 = (
        run(*command, "c", folder=folder),
        run(*command, "u", folder=folder, locale={"PYTHONUTF8": "1"}),
    )
    assert plain.returncode == utf_8.returncode == 0, plain.stderr.decode()
    assert names_in(folder / "c") == names_in(folder / "u")
    texts = [(folder / out / "config.toml").read_text("utf-8") for out in ("c", "u")]
    assert texts[0] == texts[1]
    assert tomllib.loads(texts[0])["mqtt"]["password_file"] == str(folder / "pass")
    shown = run("groundstation", "report", "c/flight.mcap", folder=folder)
    assert shown.returncode == 0, shown.stderr.decode()


def test_what_a_shell_writes_into_a_file_is_utf_8_too(tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("groundstation")
    with (tmp_path / "lab.toml").open("wb") as file:
        subprocess.run(
            [program, "config", "show"], env={**os.environ, **ASCII_LOCALE}, stdout=file, check=True
        )
    assert "m/s²" in (tmp_path / "lab.toml").read_text("utf-8")
    shown = run("groundstation", "config", "show", "lab.toml", folder=tmp_path)
    assert shown.returncode == 0, shown.stderr.decode()
    assert b"m/s?" in shown.stdout
