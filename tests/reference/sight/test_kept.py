"""Values are kept for as many threads as there are, and in bounded memory."""

from __future__ import annotations

from xfrustum.reference.sight.kept import Kept


def made_for(keys: str, room: int, least: int = 0) -> str:
    """Ask for values in turn, and return those that were made; `C` has a size of 3, others of 1."""
    made: list[str] = []

    def make(key: str) -> str:
        made.append(key)
        return key

    kept = Kept(make=make, size=lambda value: 3 if value == "C" else 1, room=room, least=least, most=3)
    assert [kept(key) for key in keys] == list(keys)
    return "".join(made)


def test_values_that_several_threads_ask_for_in_turn_are_made_once() -> None:
    assert made_for("abdabdabd", room=9) == "abd"


def test_the_value_that_was_asked_for_longest_ago_is_made_again() -> None:
    assert made_for("abdaeab", room=9) == "abdeb"


def test_what_has_no_room_is_not_kept_unless_so_many_are_kept_in_any_case() -> None:
    assert made_for("aCC", room=2) == "aCC"
    assert made_for("aCaC", room=2, least=2) == "aC"
