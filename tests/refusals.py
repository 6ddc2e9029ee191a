"""The law of every refusal."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from deqmcl_gym.validation import InputError


@contextmanager
def refused(*words: str) -> Iterator[pytest.ExceptionInfo[InputError]]:
    """Expect an ``InputError`` of one sentence that has these words; yield what holds it."""
    with pytest.raises(InputError) as caught:
        yield caught
    sentence = str(caught.value)
    assert [word for word in words if word not in sentence] == [], sentence
    assert "\n" not in sentence
    assert sentence.endswith(".")
