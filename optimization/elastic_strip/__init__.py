"""Elastic strip: a motion deformed until its contacts lie in given regions."""

from optimization.elastic_strip.program import ElasticStrip

__all__ = ["ElasticStrip"]
