"""Centroidal dynamics: one program over many contacts."""
