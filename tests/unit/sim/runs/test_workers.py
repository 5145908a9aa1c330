"""Worker processes: what is left of their work where Ctrl-C ends them."""

from concurrent.futures import Future  # noqa: TID251  # no flight sees it
from typing import Any

import pytest

from sim.runs import Workers


def test_what_ctrl_c_leaves_undone_is_for_the_pools_own_thread_to_give_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads that both end one future make the second tell a traceback."""
    begun: list[Future[Any]] = []

    def begin(_: Workers, work: Any, item: int) -> Future[Any]:
        begun.append(Future())
        if item == 0:
            begun[-1].set_result(work(item))
        elif item == 2:
            begun[-1].set_exception(KeyboardInterrupt())
        return begun[-1]

    monkeypatch.setattr(Workers, "submit", begin)
    with pytest.raises(KeyboardInterrupt):
        list(Workers(2).each(str, [0, 2, 3, 4]))
    assert [future.done() for future in begun] == [True, True, False, False]
