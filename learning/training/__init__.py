"""Training of surrogates: the only place that imports torch."""
