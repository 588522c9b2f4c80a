"""Decide it exactly: one mathematical program per file, balance, posture and momentum."""

import scenes  # noqa: F401  (chooses the folder of compiled kernels before numba is imported)
