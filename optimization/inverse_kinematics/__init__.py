"""Whole-body postures that hold contacts."""
