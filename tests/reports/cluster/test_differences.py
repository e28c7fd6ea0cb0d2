"""A folder of other work says in words what differs."""

from __future__ import annotations

from xfrustum.reports.cluster.differences import differences_words


def test_short_values_are_told_and_hashes_are_not() -> None:
    found = {"settings": [{"near": 0.1, "depth": "d24"}], "scene": {"content": "a" * 64}, "hogels": [1, 2]}
    wanted = {"settings": [{"near": 0.2, "depth": "d24"}], "scene": {"content": "b" * 64}, "hogels": [1, 2]}
    assert differences_words(found, wanted) == "other settings (near was 0.1, now 0.2) and another scene"


def test_content_and_what_is_new_are_told() -> None:
    found = {"content": {"judged": False, "channels": ["color"]}}
    wanted = {"content": {"judged": True, "channels": ["color", "height"]}, "tracer": None}
    told = 'other content (judged was false, now true; channels was ["color"], now ["color", "height"])'
    assert differences_words(found, wanted) == told
    assert differences_words(None, wanted) == "another description"


def test_a_part_of_several_words_is_one_thing_if_its_first_word_is() -> None:
    told = differences_words({"state of the images": "a" * 64}, {"state of the images": "b" * 64})
    assert told == "another state of the images"
