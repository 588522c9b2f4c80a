"""Whether a robot that was pushed can come to rest."""
