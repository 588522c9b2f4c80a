"""Products in tiles: the matrix product within rounding, and one order of summation for every row."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learning.matrix_product import PANEL, add_product, padded, panels, product

SIZE = st.integers(1, 70)


def matrices(n: int, depth: int, columns: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, depth)).astype(np.float32), rng.normal(size=(depth, columns)).astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 40), SIZE, SIZE, st.integers(0, 100))
def test_it_is_the_matrix_product_within_the_rounding_of_its_sums(n: int, depth: int, columns: int, seed: int) -> None:
    """Error of a sum of k products: at most k u |a| |b| (Higham 2002, eq. 3.5), u = 2^-24."""
    A, B = matrices(n, depth, columns, seed)
    bound = (depth + 1) * 2.0**-24 * (np.abs(A).astype(float) @ np.abs(B))
    assert (np.abs(product(A, B) - A.astype(float) @ B.astype(float)) <= bound + 1e-30).all()


def test_a_row_gets_the_same_bits_whatever_stands_beside_it() -> None:
    A, B = matrices(40, 101, 192)
    whole = product(A, B)
    for n in range(1, 24):  # tiles of every height
        np.testing.assert_array_equal(product(A[:n], B), whole[:n])
        np.testing.assert_array_equal(product(A[40 - n :], B), whole[40 - n :])


def test_terms_are_added_from_left_to_right() -> None:
    """On any processor the same: fused, or on one without such an instruction rounded twice."""
    A, B = matrices(13, 57, 33)
    fused, rounded = np.zeros((13, 33), np.float32), np.zeros((13, 33), np.float32)
    for k in range(57):
        exact = A[:, k : k + 1].astype(float) * B[k].astype(float)  # 48 bits: without error
        fused = (fused + exact).astype(np.float32)
        rounded = rounded + exact.astype(np.float32)
    ours = product(A, B)
    assert (ours == fused).all() or (ours == rounded).all()


def test_it_adds_to_what_is_there_from_any_place_in_the_panels() -> None:
    A, B = matrices(9, 12, PANEL + 3)
    C = np.ones((9, padded(PANEL + 3)), np.float32)
    add_product(A, np.concatenate([np.full(5, np.nan, np.float32), panels(B)]), 5, 12, C)
    np.testing.assert_allclose(C[:, : PANEL + 3], 1.0 + A @ B, rtol=1e-4, atol=1e-5)
    assert (C[:, PANEL + 3 :] == 1.0).all()  # nothing is added beyond the matrix


def test_arrays_that_are_too_small_are_refused_and_nothing_beyond_them_is_read() -> None:
    A, B = matrices(4, 8, 8)
    C, packed = np.zeros((4, PANEL), np.float32), panels(B)
    for wrong in (
        (A[:3], packed, 0, 8, C), (A, packed, 0, 9, C), (A, packed, 1, 8, C), (A, packed, -1, 8, C),
        (A, packed, 0, 8, np.zeros((4, PANEL + 1), np.float32)), (A, packed, 0, 8, np.zeros((4, 2 * PANEL), np.float32)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="too small"):
            add_product(*wrong)


NARROW = """
import sys
import llvmlite.binding as llvm
features = llvm.get_host_cpu_features()
features["avx512f"] = False
llvm.get_host_cpu_features = lambda: features
import numpy as np
from learning.matrix_product import PANEL, product
assert PANEL == 16
A, B = (np.load(path) for path in sys.argv[1:3])
np.save(sys.argv[3], product(A, B))
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="other processors have vectors of one width here")
def test_a_processor_with_vectors_half_as_wide_says_the_same_to_the_bit(tmp_path) -> None:
    A, B = matrices(29, 101, 50)
    paths = [str(tmp_path / f"{name}.npy") for name in "ABC"]
    np.save(paths[0], A)
    np.save(paths[1], B)
    haswell = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+avx,+sse4.2"}
    environment = os.environ | haswell | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-c", NARROW, *paths], check=True, env=environment, timeout=120)
    np.testing.assert_array_equal(np.load(paths[2]), product(A, B))
