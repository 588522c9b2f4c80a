"""Guess it quickly: learned stand-ins for the programs of `optimization`."""

import scenes  # noqa: F401  (chooses the folder of compiled kernels before numba is imported)
