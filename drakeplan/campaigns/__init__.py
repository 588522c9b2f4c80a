"""Label campaigns: rows of training data from many processes; the rows depend on the seed alone, also after an interruption."""
