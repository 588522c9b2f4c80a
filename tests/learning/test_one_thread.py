"""Products stay on one thread inside a block, and everybody gets the threads back after it."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from learning.one_thread import OneThread, _libraries


def counts() -> list[int]:
    return [library.get_num_threads() for library in _libraries()]


def test_one_thread_inside_and_as_many_as_before_outside() -> None:
    np.ones((2, 2)) @ np.ones((2, 2))
    assert _libraries()
    with threadpool_limits(2, user_api="blas"):
        before = counts()
        with OneThread():
            assert counts() == [1] * len(before)
            with OneThread():
                assert counts() == [1] * len(before)
            assert counts() == [1] * len(before)
        assert counts() == before
        with pytest.raises(ZeroDivisionError), OneThread():
            _ = 1 / 0
        assert counts() == before
