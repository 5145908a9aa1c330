"""Hypothesis profiles, folders of the tests' own, and system programs that a test needs."""

import os
import re
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, settings

from tests.flown_once import FOLDER
from tests.orphans import MARK, end_orphans, mark_session

pytest_plugins = ["tests.busy", "tests.matrix"]

# The same examples in every run: `make test` passes or fails by the code alone. `make soak` looks
# further.
settings.register_profile(
    "full",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("quick", settings.get_profile("full"), max_examples=12)
settings.register_profile("big", max_examples=5000, deadline=None, print_blob=True)
settings.load_profile("full")

NOT_RUN = "not run: install "
"""Begins the reason of a test without its program; CI takes it for a failure."""
LEFT_OUT = "left out: "
"""The same where nothing that could be installed would help."""

E2E = "tests/e2e/"

# Debian puts brokers where a user's PATH does not look; $SBIN hides them, for a machine that is to
# look bare.
SBIN = os.environ.get("SBIN", "/usr/local/sbin:/usr/sbin:/sbin")
SEARCH_PATH = os.pathsep.join(filter(None, [os.environ.get("PATH", os.defpath), SBIN]))


# Whatever a shell starts in the background ignores Ctrl-C, and so would every program that a test
# starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# Workers are marked by whoever starts them, and leave the end to that.
OUTERMOST = mark_session()


def pytest_unconfigure() -> None:
    """Nothing that tests have started goes on after them."""
    if OUTERMOST:
        end_orphans(os.environ[MARK])


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files without a test of the kind that is asked for: every worker imports them."""
    asked, lives = str(config.option.markexpr), E2E in f"{collection_path.as_posix()}/"
    if asked.startswith("real_time") and not lives and collection_path.suffix == ".py":
        return (
            None if re.search("real_time|BOTH_LOOPS", collection_path.read_text("utf-8")) else True
        )
    return True if asked.startswith("not (real_time") and lives else None


@pytest.hookimpl(tryfirst=True)  # before ``-m`` chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whole programs live in real time."""
    for item in items:
        if item.nodeid.startswith(E2E):
            item.add_marker(pytest.mark.real_time)


@pytest.fixture(scope="session", autouse=True)
def _not_at_home(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Record and register flights of tests neither among the user's own nor among each other's."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    os.environ["XDG_RUNTIME_DIR"] = str(tmp_path_factory.mktemp("run"))
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    os.environ[FOLDER] = str(shared / "flights")


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A folder in which a socket's path stays below the system's hundred letters."""
    with TemporaryDirectory(prefix="gs-") as folder:
        yield Path(folder)


@pytest.fixture(scope="session")
def needs_program() -> Callable[..., str]:
    """``needs_program("tmux")`` is its full path; without it the test is left out, loudly."""

    def find(name: str) -> str:
        if found := shutil.which(name, path=SEARCH_PATH):
            return found
        pytest.skip(NOT_RUN + name)

    return find


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One line for each missing program, and for whatever else a machine lacks."""
    left_out: Counter[str] = Counter()
    for report in terminalreporter.stats.get("skipped", []):
        reason = (
            str(report.longrepr[2]) if isinstance(report.longrepr, tuple) else str(report.longrepr)
        )
        if said := re.search(f"({NOT_RUN}|{LEFT_OUT}).*", reason):
            left_out[said[0]] += 1
    for reason, tests in sorted(left_out.items()):
        terminalreporter.write_line(
            f"{reason} ({tests} {'test' if tests == 1 else 'tests'})", red=True, bold=True
        )
