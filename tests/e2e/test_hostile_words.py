"""What an autopilot says on the wire, on the screen of a real `fly`."""

import subprocess
import sys

from tests.e2e.stations import served

HOSTILE = (
    "\x1b]0;owned\x07\x1b[2J"  # names the window, clears the screen
    "\r9.999 landed: all is well"  # a line of ours, forged
    "\n9.999 landed: all is well\x7f\x08[red]"  # another one, DEL, backspace, a style
)


def test_an_autopilot_that_refuses_in_escape_sequences_steers_no_terminal_and_forges_no_line() -> None:
    with served(says=HOSTILE) as room:
        run = subprocess.run(
            room.station("fly", "--arm", "mqx"),
            capture_output=True,
            check=False,
            text=True,
            timeout=60,
            stdin=subprocess.DEVNULL,
        )
        assert run.returncode == 1, run.stdout + run.stderr
        shown = [run.stdout, run.stderr]
        for path in room.recordings.glob("*.mcap"):
            for words in (["logs", str(room.recordings)], ["replay", str(path)]):
                again = subprocess.run(
                    [sys.executable, "-m", "groundstation", *words], capture_output=True, check=False, text=True
                )
                shown += [again.stdout, again.stderr]
    assert "refused to arm" in run.stdout
    assert "[red]" in run.stdout, "the words themselves are shown"
    lines = [line for text in shown for line in text.split("\n")]
    assert all(line.isprintable() for line in lines), shown
    assert not any(line.startswith("9.999") for line in lines)
