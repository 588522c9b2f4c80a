"""What there is: terrain, robots, contacts, stances and the next contacts in reach."""

from pathlib import Path

from scenes.files.cache_folder import choose_kernel_cache

# Every package of drakeplan imports this one before any kernel: numba reads its cache folder when it is imported.
choose_kernel_cache(Path(__file__).resolve().parents[1])
