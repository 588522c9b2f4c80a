"""Networks as an ONNX model in memory, so that onnxruntime can be measured beside this project's own products.

An ONNX file is one protocol buffer (github.com/onnx/onnx, onnx.proto; encoding: protobuf.dev/programming-guides/encoding).
A chain of matrix products needs five of its messages, which is less than the package that writes them all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from learning.network import Mlp

IR_VERSION, OPSET, FLOAT = 8, 17, 1


def onnx_model(members: Sequence[Mlp]) -> bytes:
    """The mean of networks of one shape: input "x" (n, inputs), output "y" (n, outputs), float32."""
    nodes, constants, outputs = [], [], []
    for m, mlp in enumerate(members):
        y = "x"
        for k, (W, b) in enumerate(zip(mlp.weights, mlp.biases, strict=True)):
            constants += [_tensor(f"W{m}.{k}", W), _tensor(f"b{m}.{k}", b)]
            nodes.append(_node("Gemm", (y, f"W{m}.{k}", f"b{m}.{k}"), f"z{m}.{k}"))
            y = f"z{m}.{k}"
            if k < len(mlp.weights) - 1:
                nodes.append(_node("Relu", (y,), f"h{m}.{k}"))
                y = f"h{m}.{k}"
        if mlp.skip is not None:
            constants.append(_tensor(f"S{m}", mlp.skip))
            nodes.append(_node("Gemm", ("x", f"S{m}", y), f"y{m}"))
            y = f"y{m}"
        outputs.append(y)
    nodes.append(_node("Mean", outputs, "y"))
    ends = [_bytes(11, _matrix("x", members[0].shape[0])), _bytes(12, _matrix("y", members[0].shape[-1]))]
    graph = [_bytes(1, node) for node in nodes] + [_text(2, "surrogate")] + [_bytes(5, c) for c in constants] + ends
    return _number(1, IR_VERSION) + _bytes(7, b"".join(graph)) + _bytes(8, _number(2, OPSET))


def _node(operator: str, inputs: Sequence[str], output: str) -> bytes:
    """NodeProto: input 1, output 2, op_type 4."""
    return b"".join(_text(1, name) for name in inputs) + _text(2, output) + _text(4, operator)


def _tensor(name: str, array: np.ndarray) -> bytes:
    """TensorProto: dims 1, data_type 2, name 8, raw_data 9."""
    dims = b"".join(_number(1, d) for d in array.shape)
    return dims + _number(2, FLOAT) + _text(8, name) + _bytes(9, np.ascontiguousarray(array, "<f4").tobytes())


def _matrix(name: str, columns: int) -> bytes:
    """ValueInfoProto of (n, columns) float32: name 1, type 2 (tensor_type 1 with elem_type 1, shape 2 of dim 1)."""
    shape = _bytes(1, _text(2, "n")) + _bytes(1, _number(1, columns))
    return _text(1, name) + _bytes(2, _bytes(1, _number(1, FLOAT) + _bytes(2, shape)))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _text(field: int, value: str) -> bytes:
    return _bytes(field, value.encode())


def _bytes(field: int, value: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    """Seven bits a byte, least first, the eighth set on all but the last."""
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _varint(rest) if rest else bytes([low])
