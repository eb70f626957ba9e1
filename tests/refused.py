"""Tables of what is refused."""

import pytest


def refusals(error, *rows):
    """Return a test of rows (call, words): each call is refused in its words."""

    @pytest.mark.parametrize(("call", "words"), rows)
    def test(call, words):
        with pytest.raises(error, match=words):
            call()

    return test
