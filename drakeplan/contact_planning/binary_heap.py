"""A binary heap of numbered nodes in arrays, cheapest first; it knows where each node is, so that one can get cheaper."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def sift_up(heap: np.ndarray, place: np.ndarray, cost: np.ndarray, k: int) -> None:
    """Moves a node up to where it belongs, after it was added or got cheaper.

    Args:
        heap: (n,) nodes.
        place: (nodes,) where each node is in the heap.
        cost: (nodes,) what they are ordered by.
        k: where the node is now.
    """
    while k > 0:
        parent = (k - 1) >> 1
        if cost[heap[parent]] <= cost[heap[k]]:
            break
        heap[parent], heap[k] = heap[k], heap[parent]
        place[heap[parent]], place[heap[k]] = parent, k
        k = parent


@njit(cache=True)
def pop(heap: np.ndarray, place: np.ndarray, cost: np.ndarray, size: np.ndarray) -> int:
    """Takes the cheapest node off; its own place is left as it was.

    Args:
        heap: (n,) nodes.
        place: (nodes,) where each node is in the heap.
        cost: (nodes,) what they are ordered by.
        size: (1,) how many nodes are in the heap.
    """
    top = heap[0]
    size[0] -= 1
    n = size[0]
    if n > 0:
        heap[0] = heap[n]
        place[heap[0]] = 0
        k = 0
        while True:
            child = 2 * k + 1
            if child >= n:
                break
            if child + 1 < n and cost[heap[child + 1]] < cost[heap[child]]:
                child += 1
            if cost[heap[k]] <= cost[heap[child]]:
                break
            heap[k], heap[child] = heap[child], heap[k]
            place[heap[k]], place[heap[child]] = k, child
            k = child
    return top


@njit(cache=True)
def push(heap: np.ndarray, place: np.ndarray, size: np.ndarray, s: int) -> None:
    """Adds a node at the end of the heap.

    Args:
        heap: (n,) nodes.
        place: (nodes,) where each node is in the heap.
        size: (1,) how many nodes are in the heap.
        s: the node.
    """
    heap[size[0]] = s
    place[s] = size[0]
    size[0] += 1
