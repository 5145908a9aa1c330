"""Table of sentences for the operator."""

import pytest

from groundstation.core.messages import NOTICES, NoticeTemplate


def test_a_sentence_is_filled_with_its_numbers_and_followed_by_its_remedy() -> None:
    template = NoticeTemplate("pose.late", "pose age {age_ms:.0f} ms, limit {limit_ms:.0f} ms", "check the network")
    assert str(template.format(age_ms=312.4, limit_ms=150)) == "pose age 312 ms, limit 150 ms: check the network"


def test_a_missing_number_is_an_error() -> None:
    with pytest.raises(KeyError):
        NoticeTemplate("pose.late", "pose age {age_ms:.0f} ms").format()


def test_every_id_is_named_after_a_room_and_a_fact() -> None:
    assert all(key == template.id and "." in key for key, template in NOTICES.items())
