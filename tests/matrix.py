"""``@pytest.mark.tried(N)``: of a long row of cases `make test` tries N, and `make test-all` the
others.

The mark stands at the test, with a remark that says why these will do. Cases left out get the mark
``matrix``, which a test that `make test` leaves out as a whole bears itself.
"""

from collections import defaultdict

import pytest


def spread(tried: int, cases: int) -> set[int]:
    """Return the numbers of the cases tried: ``tried`` of ``cases``, evenly spread."""
    tried = min(tried, cases)
    if tried < 2:
        return set(range(tried))
    return {round(k * (cases - 1) / (tried - 1)) for k in range(tried)}


@pytest.hookimpl(tryfirst=True)  # before ``-m`` chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is left out."""
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("tried"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for found in cases.values():
        mark = found[0].get_closest_marker("tried")
        assert mark is not None, "chosen by it"
        tried = spread(mark.args[0], len(found))
        for number, item in enumerate(found):
            if number not in tried:
                item.add_marker(pytest.mark.matrix)
