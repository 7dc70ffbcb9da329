"""Numbers with their noun, words in a row."""

import pytest

from tpmsd.foundation.english import counted, listed


@pytest.mark.parametrize(("number", "text"), [(0, "0 cars"), (1, "1 car"), (2, "2 cars")])
def test_a_noun_follows_its_number(number: int, text: str) -> None:
    assert counted(number, "car") == text


@pytest.mark.parametrize(
    ("words", "text"), [([], ""), (["a"], "a"), (["a", "b"], "a or b"), (["a", "b", "c"], "a, b or c")]
)
def test_words_stand_in_a_row(words: list[str], text: str) -> None:
    assert listed(words, last="or") == text
