"""Label campaigns: rows of data made by many workers, the same rows whoever makes them and however often they are stopped."""
