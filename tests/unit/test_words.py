"""The report that shows where our English has to be read twice (`python -m docs.words`)."""

from __future__ import annotations

from docs.words import count, docstrings, markdown, restructured, sentences

PAGE = """\
# A heading

The robot stops. What it does then, nobody knows, e.g. behind a wall.

```bash
one two three four five six
```

- This item is one sentence, with `what in code` left out.
"""


def test_sentences_of_a_page_are_counted_without_its_code() -> None:
    found = list(sentences(markdown(PAGE)))
    assert found == [
        "The robot stops.",
        "What it does then, nobody knows, e.g behind a wall.",
        "This item is one sentence, with CODE left out.",
    ]
    assert count(found)[1:] == (3, 3, 0)  # What, nobody, one


def test_a_sentence_of_more_than_25_words_is_long() -> None:
    assert [count([" ".join(["word"] * number)]).long for number in (25, 26)] == [0, 1]


def test_docstrings_are_read_without_their_formulas() -> None:
    source = 'def f():\n    """Return such a value.\n\n    It obeys\n\n        v = what + one those\n    """\n'
    (found,) = docstrings(source)
    assert list(sentences(restructured(found))) == ["Return such a value."]
