"""Products of a few rows with a matrix that stays: float32, one thread, and the same sum for a row whatever stands beside it.

C += A B with n = 20 to 60 rows of A, as the layers of a network are for one expansion of a search. NumPy's BLAS is made
for large n: below 100 rows it comes to half of what the processor does, it picks its order of summation by processor and
by n, and it wakes threads that wait busily. Here B is laid out in panels beforehand, as Goto and van de Geijn 2008 sec. 5 do,
and a tile of C stays in registers while k runs:

    tile       up to 8 (6) rows x 2 vectors of C, one fused multiply-add a vector and k
    panel      the columns of B that are as wide as a tile, k after k, without gaps
    order      c_ij + a_i1 b_1j + a_i2 b_2j + ..., from left to right

So an answer depends neither on the batch it is asked in nor on the width of the processor's vectors.
"""

from __future__ import annotations

from collections.abc import Callable

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

# A tile's accumulators, a row of B and one broadcast a_ik fill the registers: 32 of 16 floats, or 16 of 8 floats.
_WIDE = bool(llvm.get_host_cpu_features().get("avx512f", False))
_LANES, _VECTORS, _ROWS = (16, 2, 8) if _WIDE else (8, 2, 6)
PANEL = _LANES * _VECTORS  # columns


@njit(cache=True)
def padded(columns: int) -> int:
    """The least multiple of `PANEL` that is not below this number of columns."""
    return -(-columns // PANEL) * PANEL


def panels(B: np.ndarray) -> np.ndarray:
    """(depth * padded(columns),) float32: a (depth, columns) matrix in panels, with zeros after the last column."""
    depth, columns = B.shape
    wide = np.zeros((depth, padded(columns)), np.float32)
    wide[:, :columns] = B
    return np.ascontiguousarray(wide.reshape(depth, -1, PANEL).transpose(1, 0, 2)).ravel()


def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """(n, columns) float32 product of (n, depth) and (depth, columns); for B that changes NumPy is faster.

    Args:
        A: (n, depth).
        B: (depth, columns).
    """
    C = np.zeros((len(A), padded(B.shape[1])), np.float32)
    add_product(np.ascontiguousarray(A, np.float32), panels(B), 0, B.shape[0], C)
    return C[:, : B.shape[1]]


def _tile(rows: int) -> Callable[..., None]:
    """The innermost loop for this many rows; numba cannot keep an array in registers, so it is written in LLVM's words."""

    @intrinsic
    def add_tile(typing_context, A, i, B, start, depth, C, j):  # noqa: ANN001, ANN202 (types of numba's own)
        """C[i:i + rows, j:j + PANEL] += A[i:i + rows, :depth] times the panel that begins at B[start]."""

        def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202
            pointers = [
                context.make_array(signature.args[k])(context, builder, arguments[k]) for k in (0, 2, 5)
            ]  # fmt: skip
            _write_tile(builder, rows, *pointers, *(arguments[k] for k in (1, 3, 4, 6)))
            return context.get_dummy_value()

        return types.void(A, i, B, start, depth, C, j), generate

    return add_tile


def _write_tile(
    builder: ir.IRBuilder, rows: int, A: object, B: object, C: object, i: ir.Value, start: ir.Value, depth: ir.Value,
    j: ir.Value,
) -> None:  # fmt: skip
    """Emits one tile; LLVM turns the stack slots of the accumulators into registers."""
    vector = ir.VectorType(ir.FloatType(), _LANES)
    fma = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fmuladd.v{_LANES}f32"
    )

    def number(k: int) -> ir.Constant:
        return ir.Constant(ir.IntType(64), k)

    def vector_at(pointer: ir.Value, offset: int) -> ir.Value:
        there = builder.gep(pointer, [number(offset * _LANES)])
        return builder.bitcast(there, vector.as_pointer())  # type: ignore[return-value]

    def row(array: object, k: int) -> ir.Value:
        stride = builder.extract_value(array.shape, 1)  # type: ignore[attr-defined]
        return builder.gep(array.data, [builder.mul(builder.add(i, number(k)), stride)])  # type: ignore[attr-defined]

    tile = [(r, v) for r in range(rows) for v in range(_VECTORS)]
    a, c = [row(A, r) for r in range(rows)], [builder.gep(row(C, r), [j]) for r in range(rows)]
    b = builder.gep(B.data, [start])  # type: ignore[attr-defined]
    total = {rv: cgutils.alloca_once(builder, vector) for rv in tile}
    for r, v in tile:
        builder.store(builder.load(vector_at(c[r], v), align=4), total[r, v])
    with cgutils.for_range(builder, depth) as loop:
        b_k = builder.gep(b, [builder.mul(loop.index, number(PANEL))])
        b_kj = [builder.load(vector_at(b_k, v), align=4) for v in range(_VECTORS)]
        for r in range(rows):
            a_rk = _broadcast(builder, builder.load(builder.gep(a[r], [loop.index])), vector)
            for v in range(_VECTORS):
                builder.store(builder.call(fma, [a_rk, b_kj[v], builder.load(total[r, v])]), total[r, v])
    for r, v in tile:
        builder.store(builder.load(total[r, v]), vector_at(c[r], v), align=4)


def _broadcast(builder: ir.IRBuilder, value: ir.Value | None, vector: ir.VectorType) -> ir.Value:
    lane = ir.IntType(32)
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(lane, 0))
    zeros = ir.Constant(ir.VectorType(lane, vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, nothing, zeros)  # type: ignore[return-value]


_tile1, _tile2, _tile3, _tile4, _tile5, _tile6, _tile7, _tile8 = (_tile(rows) for rows in range(1, 9))


@njit(cache=True)
def add_product(A: np.ndarray, B: np.ndarray, first: int, depth: int, C: np.ndarray) -> None:
    """C += A[:, :depth] B, in place.

    Args:
        A: (n, at least depth) float32, contiguous.
        B: float32 `panels` of a (depth, c) matrix, from index `first` on.
        first: where they begin.
        depth: rows of the matrix.
        C: (n, padded(c)) float32, contiguous.

    Raises:
        ValueError: the arrays are too small: the tiles would reach beyond them.
    """
    n, columns = C.shape
    if A.shape[0] < n or A.shape[1] < depth or columns % PANEL or first < 0 or len(B) < first + depth * columns:
        raise ValueError("matrix product: the arrays are too small")
    blocks = -(-n // _ROWS)
    for j in range(0, columns, PANEL):
        start = first + j * depth
        for block in range(blocks):  # rows in equal shares: a tile of one or two rows would wait for itself
            i = n * block // blocks
            rows = n * (block + 1) // blocks - i
            if rows == 8:
                _tile8(A, i, B, start, depth, C, j)
            elif rows == 7:
                _tile7(A, i, B, start, depth, C, j)
            elif rows == 6:
                _tile6(A, i, B, start, depth, C, j)
            elif rows == 5:
                _tile5(A, i, B, start, depth, C, j)
            elif rows == 4:
                _tile4(A, i, B, start, depth, C, j)
            elif rows == 3:
                _tile3(A, i, B, start, depth, C, j)
            elif rows == 2:
                _tile2(A, i, B, start, depth, C, j)
            else:
                _tile1(A, i, B, start, depth, C, j)
