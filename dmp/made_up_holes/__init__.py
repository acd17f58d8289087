"""Completion learnt from holes that are made up where the truth is known."""
